# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The code that race control's node, the bridge and our other ROS processes share.

Each of these processes imports this package before rclpy. If the middleware in RMW_IMPLEMENTATION
is not installed, this package ends the process with exit code 2 and a clear sentence, as rclpy
would not.
"""

import os
import sys


def _refuse_absent_middleware(wanted: str) -> None:
    """End the process with one sentence if this ROS middleware is not installed."""
    from ament_index_python import get_resources  # slow, so imported only when it is needed

    try:
        there = sorted({*get_resources('rmw_typesupport')} - {'rmw_implementation'})
    except OSError:  # without AMENT_PREFIX_PATH, nobody can tell
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
