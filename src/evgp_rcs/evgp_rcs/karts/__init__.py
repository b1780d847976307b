# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The kart server's process, which stops karts, and the process that writes the record.

This package imports ``rules``, ``files`` and ``record``, but not ROS.
"""
