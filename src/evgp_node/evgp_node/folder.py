# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The default folder for the files of our programs."""

from __future__ import annotations

import os
import pathlib


def rcs_folder() -> pathlib.Path:
    """
    Return the folder of race control and its officials, below ROS_HOME. It may not exist yet.

    :raises RuntimeError: if neither ROS_HOME nor a home folder is known.
    """
    ros_home = os.environ.get('ROS_HOME') or pathlib.Path.home() / '.ros'
    return pathlib.Path(ros_home, 'evgp_rcs')
