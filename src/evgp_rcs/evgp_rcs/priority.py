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

"""Which part of race control has the processor first; each comes before other programs."""

from __future__ import annotations

import contextlib
import os
import pathlib

ROS_HALF = 1
RECORD = 2
LOOP = 3
"""Real-time priorities (SCHED_RR), where they are allowed (root, or a limit for the user). The
kart server's loop has the highest, for the karts' frames. Its record comes next, so that it can
hand the interpreter back to the loop whatever else there is to do. The ROS half must take a stop
however busy the computer is."""

_THREADS = pathlib.Path('/proc/self/task')


def come_first(priority: int, thread: int = 0) -> None:
    """
    Have a thread, and those that it starts from now on, come before other programs.

    :param thread: its number; 0: this one.
    """
    # Where it is not allowed: as any other program. docs/performance.md says what that costs.
    with contextlib.suppress(OSError):
        os.sched_setscheduler(thread, os.SCHED_RR, os.sched_param(priority))


def all_come_first(priority: int) -> None:
    """Have every thread of this process come before other programs, as `come_first` does."""
    done: set[int] = set()
    with contextlib.suppress(OSError):
        # A thread that was started by one before its turn is found the next time.
        while new := {int(each.name) for each in _THREADS.iterdir()} - done:
            for each in new:
                come_first(priority, each)
            done |= new
