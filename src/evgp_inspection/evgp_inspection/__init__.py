# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks whether a kart or its network is fit to race and writes a report. It needs no ROS."""

VERSION = '0.1.0'
"""The version of the inspection, as in package.xml; every report shows it."""
