# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What race control's node and the bridge's have in common as ROS processes.

It comes before rclpy in all of them, which ends a process as it is imported, in its own words and
with an exit code of its own, where RMW_IMPLEMENTATION is not there.
"""

import os
import sys


def _refuse_absent_middleware(wanted: str) -> None:
    """End the process, in one sentence, if this ROS middleware is not installed."""
    from ament_index_python import get_resources  # not where nobody asks: it takes time

    try:
        there = sorted({*get_resources('rmw_typesupport')} - {'rmw_implementation'})
    except OSError:  # nobody knows, as without AMENT_PREFIX_PATH
        return
    if there and wanted not in there:
        print(
            f'RMW_IMPLEMENTATION is {wanted}, which is not installed here. Unset it, or set it to '
            + ' or '.join(there),
            file=sys.stderr,
        )
        sys.exit(2)


if os.environ.get('RMW_IMPLEMENTATION'):
    _refuse_absent_middleware(os.environ['RMW_IMPLEMENTATION'])
