# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The priority of race control's processes over other programs.

The system must allow this priority, either to root or by a limit for the user. Otherwise, race
control runs like any other program. For what that costs, see docs/dev/performance.md.
"""

from __future__ import annotations

import contextlib
import os
import pathlib

NICENESS = -10
"""Niceness of all race control's processes. They must accept a stop even on a busy computer."""

LOOP = 3
"""Real-time priority (SCHED_RR) of the kart server's loop. It sends the karts' frames."""


def come_before_others() -> None:
    """Give this thread, and everything that it starts, more of the processor if allowed."""
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
    # Linux first shares the processor between sessions. `make run` and systemd give race control a
    # session of its own. In any other session, such as a terminal's, the niceness would remain
    # after race control has ended, so race control does not set it there.
    if os.getsid(0) == os.getpid():
        with contextlib.suppress(OSError):
            pathlib.Path('/proc/self/autogroup').write_text(str(NICENESS), encoding='ascii')


def come_first() -> None:
    """Give this thread, but nothing that it starts, priority over ordinary programs if allowed."""
    with contextlib.suppress(PermissionError):
        policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy, os.sched_param(LOOP))
