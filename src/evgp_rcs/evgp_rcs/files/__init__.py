# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What officials write before a race, and where race control keeps its files.

It imports ``rules``.
"""
