# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Priority of race control's processes over other programs.

The system must allow it (root, or a limit for the user). Otherwise race control runs like any
other program; docs/dev/performance.md says what that costs.
"""

from __future__ import annotations

import contextlib
import os
import pathlib

NICENESS = -10
"""Niceness of all of race control, which must accept a stop however busy the computer is."""

LOOP = 3
"""Real-time priority (SCHED_RR) of the kart server's loop, which sends the karts' frames."""


def come_before_others() -> None:
    """Give this thread, and everything that it starts, more of the processor."""
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
    # Linux shares the processor between sessions first. `make run` and systemd give race control
    # a session of its own. In another session, such as a terminal's, this niceness would remain
    # after race control has ended.
    if os.getsid(0) == os.getpid():
        with contextlib.suppress(OSError):
            pathlib.Path('/proc/self/autogroup').write_text(str(NICENESS), encoding='ascii')


def come_first() -> None:
    """Give this thread, but none that it starts, priority over all ordinary programs."""
    with contextlib.suppress(PermissionError):
        policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy, os.sched_param(LOOP))
