# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The ROS half, for officials: the node, its topics and services, messages and settings.

This package imports all other packages of race control except ``spare``. It makes no decision that
a stop must wait for.
"""
