# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Timing turns the reports from devices at the line into laps and results."""
