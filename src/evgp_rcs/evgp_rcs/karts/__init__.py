# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Two processes: the kart server, which stops karts, and the one that writes the record.

This package imports ``rules`` and ``record``, but not ROS.
"""
