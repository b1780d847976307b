# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What officials write before a race, and whether it is right.

It imports ``rules``.
"""
