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

"""
What of race control has the processor before other programs.

Where it is allowed (root, or a limit for the user); else as any other program, and
docs/performance.md says what that costs.
"""

from __future__ import annotations

import contextlib
import os
import pathlib

NICENESS = -10
"""Of all of race control: a stop must be taken however busy the computer is."""

LOOP = 3
"""The real-time priority of the kart server's loop (SCHED_RR), for the karts' frames."""


def come_before_others() -> None:
    """Have this thread and all that it starts get more of the processor."""
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
    # Linux shares the processor between sessions first. `make run` and systemd give race control
    # one of its own; in somebody else's, such as a terminal's, this would stay when it has ended.
    if os.getsid(0) == os.getpid():
        with contextlib.suppress(OSError):
            pathlib.Path('/proc/self/autogroup').write_text(str(NICENESS), encoding='ascii')


def come_first() -> None:
    """Have this thread, and none that it starts, come before all ordinary programs."""
    with contextlib.suppress(PermissionError):
        policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy, os.sched_param(LOOP))
