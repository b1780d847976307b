# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What may happen in a race, and what there is to see of it: rules, commands, inputs, snapshot.

Pure: nothing here knows a clock, a socket, a thread, a file, ROS or a log, and none of the other
rooms.
"""
