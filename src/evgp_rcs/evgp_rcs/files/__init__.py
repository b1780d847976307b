# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The files that officials write before a race, and their checks.

It imports ``rules``.
"""
