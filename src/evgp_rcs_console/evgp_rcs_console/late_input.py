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

"""Which keys and clicks come too late to act, and what the official is told of them."""

from __future__ import annotations

import time

from evgp_protocol import clock
from evgp_rcs_console import words
from evgp_rcs_console.bottom_line import BottomLine
from evgp_rcs_console.chosen import ChosenKart
from evgp_rcs_console.freshness import Beat, InputClock
from evgp_rcs_console.qt import QtGui
from evgp_rcs_console.view import Tone


class LateInput:
    """
    Measures for how long a key or click has waited, and drops what is too old.

    :param period: how often ``beat`` is called, in seconds.
    """

    def __init__(self, period: float, chosen: ChosenKart, bottom: BottomLine) -> None:
        """Begin in time."""
        self._chosen = chosen
        self._bottom = bottom
        self._clock = InputClock()
        self._beat = Beat(period, clock.now())
        self._dropped: list[str] = []

    def beat(self, now: float) -> None:
        """Take that the window's thread is alive."""
        self._beat.beat(now)
        # What was typed while the window hung is taken before it is too old.
        if not self._beat.held_up(now):
            self._chosen.expire(now)

    def age(self, event: QtGui.QInputEvent) -> float:
        """Return for how long a key or click has waited at least, in seconds."""
        waited = self._clock.age(event.timestamp(), time.monotonic())
        return max(waited, self._beat.held_up(clock.now()))

    def drop(self, name: str, age: float) -> bool:
        """Say that a key or click was too old (s); return that it is used up."""
        # It would have ended the number: what is typed after it is another one.
        self._chosen.clear()
        self._dropped = [*self._dropped[-4:], name]
        names = ', '.join(self._dropped)
        self._bottom.say(words.TOO_OLD.format(name=names, age=clock.duration(age, 0)), Tone.BAD)
        return True

    def in_time(self) -> None:
        """Take that an input was in time: what was dropped before it is not named any more."""
        self._dropped.clear()
