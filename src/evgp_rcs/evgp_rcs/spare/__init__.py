# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A second machine that can become race control: its copy of everything, and the takeover.

It imports all other rooms; no other room imports it.
"""
