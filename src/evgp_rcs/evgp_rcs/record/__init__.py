# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The evidence: the stream of a run on the disk, its replay, and the reports from it.

This package imports ``rules``, and uses no socket, no kart and no ROS.
"""
