# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The half that officials reach by ROS: node, topics, services, messages, settings.

It imports all rooms except ``spare``. No decision that a stop waits for is made here.
"""
