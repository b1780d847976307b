# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The spare machine, which keeps a copy of race control's files and can take over from race control.

This package imports the other packages of race control, and none of them imports this one.
"""
