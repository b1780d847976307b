# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The clock that stops karts, which counts the seconds since boot, including suspend. Linux only.

The wall clock can be set, and the monotonic clock stops while a machine is suspended. With those,
a frame from before a clock change or a closed lid would seem fresh.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
import time
from typing import Any, TypeVar

T = TypeVar('T')


def now() -> float:
    """Return the time since boot, including suspend, in seconds."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def duration(seconds: float, digits: int = 1) -> str:
    """
    Return a duration as ``59.9 s``, ``1:05.0 min`` or ``2:03:04.5 h``.

    :param digits: number of decimals of the seconds.
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
    An event loop whose time is `now`, so its deadlines and timeouts include suspend.

    The kernel wakes the loop by the monotonic clock. After a suspend, the loop therefore handles
    an expired deadline only when it next wakes, at the latest after the rest of its wait. A loop
    that must act soon after a suspend needs something that wakes it often.
    """

    def time(self) -> float:
        return now()


def run(main: Coroutine[Any, Any, T]) -> T:
    """
    Run a coroutine on its own `BoottimeEventLoop`, but handle no signals.

    Before Python 3.12, ``asyncio.run`` accepts no other loop.
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
    """Cancel the tasks, wait for them, and report what they raised."""
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
