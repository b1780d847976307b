# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Where our programs keep what outlives them, if they are not told."""

from __future__ import annotations

import os
import pathlib


def rcs_folder() -> pathlib.Path:
    """
    Return the folder of race control and its officials, below ROS_HOME; it need not exist.

    :raises RuntimeError: if neither ROS_HOME nor a home folder is known.
    """
    ros_home = os.environ.get('ROS_HOME') or pathlib.Path.home() / '.ros'
    return pathlib.Path(ros_home, 'evgp_rcs')
