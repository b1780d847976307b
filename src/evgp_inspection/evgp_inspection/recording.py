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

"""The trace while it is written: it has the clock, and wakes whoever waits for an event."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from evgp_inspection.traces import Event, Kind, Trace


class Recording:
    """Writes a `Trace` in one event loop; times are seconds since it was made."""

    def __init__(self) -> None:
        """Begin now."""
        self.trace = Trace()
        self._loop = asyncio.get_running_loop()
        self._began = self._loop.time()
        self._waiting: list[asyncio.Future[None]] = []

    @property
    def now(self) -> float:
        """Return the time, s."""
        return self._loop.time() - self._began

    def note(
        self, kind: Kind, link: int = 0, data: bytes = b'', text: str = '', value: float = 0.0
    ) -> None:
        """Write an event of this moment."""
        self.trace.add(Event(self.now, kind, link, data, text, value))
        waiting, self._waiting = self._waiting, []
        for future in waiting:
            _wake(future)

    async def until(self, found: Callable[[], object], seconds: float) -> bool:
        """Return True once `found` is true, or False after so many seconds."""
        deadline = self._loop.time() + seconds
        while not found():
            left = deadline - self._loop.time()
            if left <= 0:
                return False
            # No asyncio.wait: a few turns later, what follows belongs to another phase.
            future = self._loop.create_future()
            self._waiting.append(future)
            timer = self._loop.call_later(left, _wake, future)
            try:
                await future
            finally:
                timer.cancel()
        return True


def _wake(future: asyncio.Future[None]) -> None:
    if not future.done():
        future.set_result(None)


class EndedError(Exception):
    """The steps cannot go on; the text says why, for the report."""


async def first(task: asyncio.Future[Any], event: asyncio.Event) -> None:
    """Return once the task is done or the event is set."""
    waiting = asyncio.get_running_loop().create_task(event.wait())
    try:
        await asyncio.wait([task, waiting], return_when=asyncio.FIRST_COMPLETED)
    finally:
        waiting.cancel()
