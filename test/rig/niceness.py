# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What share of the processor a worker of the tests gets, and what a program may take."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import os
import threading

from evgp_rcs.karts.priority import come_first


@contextlib.contextmanager
def at_niceness(niceness: int) -> Iterator[None]:
    """
    Have this thread, and what it starts, get more of the processor (below 0) or less (above).

    Nothing happens for a user who may not set it, or not take it back.

    :param niceness: from -20 to 19.
    """
    before = os.getpriority(os.PRIO_PROCESS, 0)
    try:
        os.setpriority(os.PRIO_PROCESS, 0, before - 1)
        os.setpriority(os.PRIO_PROCESS, 0, niceness)
    except PermissionError:
        os.setpriority(os.PRIO_PROCESS, 0, before)
        yield
        return
    try:
        yield
    finally:
        os.setpriority(os.PRIO_PROCESS, 0, before)


def may_come_first() -> bool:
    """Return whether a program may take a real-time priority here; a thread of ours tries it."""

    def take_it() -> None:
        come_first()
        took.append(os.sched_getscheduler(0) & os.SCHED_RR == os.SCHED_RR)

    took: list[bool] = []
    thread = threading.Thread(target=take_it)
    thread.start()
    thread.join()
    return took == [True]
