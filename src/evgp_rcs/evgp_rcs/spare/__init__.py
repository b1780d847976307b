# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The spare machine, which keeps a copy of race control's files and can take over from it.

This package imports the other packages of race control. None of them imports this package.
"""
