# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The process that stops karts: sockets, links, the beat; and the process that writes the record.

It imports ``rules``, ``files`` and ``record``, but not ROS.
"""
