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
Whether what is heard of the race comes from two race controls.

Each race control numbers its snapshots upwards. One that is started again begins again, once. Of
two that speak in turn the numbers go down again and again. Pure.
"""

from __future__ import annotations

from collections import deque

WITHIN = 4.0
"""Time within which the numbers must go down twice, in seconds; each is heard twice a second."""


class Sources:
    """Hears the numbers of snapshots."""

    def __init__(self) -> None:
        """Begin with nothing heard."""
        self._last: int | None = None
        self._falls: deque[float] = deque(maxlen=2)

    def hear(self, number: int, now: float) -> None:
        """Take the number of a snapshot and when it came, in seconds."""
        if self._last is not None and number <= self._last:
            self._falls.append(now)
        self._last = number

    def are_two(self, now: float) -> bool:
        """Return whether two race controls are heard."""
        return len(self._falls) == 2 and now - self._falls[0] < WITHIN
