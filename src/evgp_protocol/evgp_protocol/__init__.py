# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What goes over the wire between the EVGP race control and a kart; needs no ROS."""
