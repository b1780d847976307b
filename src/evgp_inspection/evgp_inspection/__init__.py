# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Is this kart, or this race control, fit to race? Clauses, checks, verdicts, a report; no ROS."""

VERSION = '0.1.0'
"""The version of the inspection, as in package.xml; every report names it."""
