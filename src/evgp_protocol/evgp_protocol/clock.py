# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The clock that stops karts: seconds since the machine was started, suspended or not.

The wall clock can be set, and the monotonic clock stands still while a machine is suspended. By
either of them, what was heard before a change of the clock, or before the lid was closed, would
seem fresh. Linux only.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
import time
from typing import Any, TypeVar

T = TypeVar('T')


def now() -> float:
    """Return the time since the machine was started, time in suspend included, in seconds."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def duration(seconds: float, digits: int = 1) -> str:
    """
    Return how long something took, as ``59.9 s``, ``1:05.0 min`` or ``2:03:04.5 h``.

    :param digits: of the seconds, behind the point.
    """
    whole, rest = divmod(round(max(seconds, 0.0) * 10**digits), 10**digits)
    point = f'.{rest:0{digits}}' if digits else ''
    minutes, second = divmod(whole, 60)
    hours, minute = divmod(minutes, 60)
    if hours:
        return f'{hours}:{minute:02}:{second:02}{point} h'
    return f'{minute}:{second:02}{point} min' if minute else f'{second}{point} s'


class BoottimeEventLoop(asyncio.SelectorEventLoop):
    """
    An event loop whose time is `now`, so its deadlines and timeouts count a suspend.

    The kernel wakes the loop by the monotonic clock. After a suspend, a deadline that has passed
    meanwhile is met as soon as the loop wakes for anything, or after what was left of its wait: a
    loop that must act soon after a suspend needs something that wakes it often.
    """

    def time(self) -> float:
        """Return `now`."""
        return now()


def run(main: Coroutine[Any, Any, T]) -> T:
    """
    Run a coroutine on a `BoottimeEventLoop` of its own, as ``asyncio.run`` does on its loop.

    ``asyncio.run`` takes another loop from Python 3.12 only. Unlike it, this handles no signals.
    """
    loop = BoottimeEventLoop()
    try:
        return loop.run_until_complete(main)
    finally:
        try:
            loop.run_until_complete(_cancel_all(asyncio.all_tasks(loop)))
            loop.run_until_complete(loop.shutdown_asyncgens())
            loop.run_until_complete(loop.shutdown_default_executor())
        finally:
            loop.close()


async def _cancel_all(tasks: set[asyncio.Task[Any]]) -> None:
    """Cancel what still runs, wait for it, and report what it raised."""
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    for task in tasks:
        if not task.cancelled() and task.exception() is not None:
            asyncio.get_running_loop().call_exception_handler(
                {
                    'message': 'unhandled exception during shutdown',
                    'exception': task.exception(),
                    'task': task,
                }
            )
