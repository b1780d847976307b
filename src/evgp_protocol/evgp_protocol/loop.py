# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""An event loop on the clock that stops karts. Programs without one need not load asyncio."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

from evgp_protocol.clock import now

T = TypeVar('T')


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
