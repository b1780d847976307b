# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What may happen in a race, and what officials see of it: rules, commands, inputs, snapshot.

Pure: nothing here uses a clock, a socket, a thread, a file, ROS, a log, or any other room.
"""
