# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The TCP protocol between EVGP race control and a kart; needs no ROS."""
