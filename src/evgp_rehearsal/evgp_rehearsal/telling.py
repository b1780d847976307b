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

"""The events that an official hears, told as they come."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import itertools
import threading

from evgp_rcs_msgs import msg
from evgp_testing.official import Official


class Telling:
    """
    Tells each event once, in order.

    :param tell: takes an event, in a thread of its own.
    """

    def __init__(self, official: Official, tell: Callable[[msg.RaceEvent], None]) -> None:
        """Have told nothing yet."""
        self._official, self._tell = official, tell
        self._told = 0

    @contextlib.contextmanager
    def live(self) -> Iterator[None]:
        """Tell what was heard and not told, and what is heard meanwhile."""
        over = threading.Event()
        teller = threading.Thread(target=self._tell_until, args=[over], daemon=True)
        teller.start()
        try:
            yield
        finally:
            over.set()
            with self._official.news:
                self._official.news.notify_all()
            teller.join()

    def _tell_until(self, over: threading.Event) -> None:
        official = self._official
        while not over.is_set() or self._told < len(official.events):
            with official.news:
                official.news.wait_for(lambda: over.is_set() or self._told < len(official.events))
                events = list(itertools.islice(official.events, self._told, None))
            self._told += len(events)
            for event in events:
                self._tell(event)
