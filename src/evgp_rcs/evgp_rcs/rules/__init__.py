# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What may happen in a race, and what officials see of it: rules, commands, inputs, snapshot.

The code is pure: it uses no clock, socket, thread, file, ROS or log, and no other room.
"""
