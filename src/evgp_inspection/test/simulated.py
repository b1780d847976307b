# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A clock that is simulated: an event loop that never waits.

Sockets are real, on loopback, where a byte that was sent is there to be read when `send` returns.
So whenever nothing is ready, nothing can become ready but a timer, and the clock jumps to it. An
inspection of eight minutes takes seconds, and no other program of this computer holds it up.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
import selectors
from typing import Any, TypeVar

T = TypeVar('T')


class _Selector(selectors.EpollSelector):
    """Waits by moving the clock."""

    now = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return what is ready; if nothing is, let that time pass."""
        ready = super().select(0)
        if not ready and timeout is None:
            return super().select(None)  # no timer is left: something outside ends this
        if not ready and timeout is not None and timeout > 0:
            self.now += timeout
        return ready


class SimulatedLoop(asyncio.SelectorEventLoop):
    """An event loop whose clock moves only while nothing is left to do."""

    def __init__(self) -> None:
        self._clock = _Selector()
        super().__init__(self._clock)

    def time(self) -> float:
        return self._clock.now


def run(what: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine on a clock of its own."""
    loop = SimulatedLoop()
    try:
        return loop.run_until_complete(what)
    finally:
        loop.run_until_complete(loop.shutdown_asyncgens())
        loop.close()
