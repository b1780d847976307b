# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The evidence: the stream of a run on the disk, its replay, and what is read out of it.

It imports ``rules`` and ``files``. It never knows a socket, a kart or ROS.
"""
