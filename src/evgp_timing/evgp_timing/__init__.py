# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Timing: devices that report karts at the line, and the laps and results made of that."""
