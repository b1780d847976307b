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

"""What the client's threads hear, handed over to the Qt thread by queued signals."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from evgp_rcs_console.commands import Order
from evgp_rcs_console.qt import QtCore, Signal
from evgp_rcs_console.snapshot import Answer, Event, Race
from evgp_rcs_console.standing import Standing


class Heard(NamedTuple):
    """A snapshot; the fields are the parameters of ``Listener.on_race``."""

    race: Race
    at: float
    two: bool


class Inbox(QtCore.QObject):
    """
    A ``Listener`` of the client whose news arrive in the Qt thread.

    A window that was held up must not show one old snapshot after the other, each of which says
    that race control has been silent for long. So snapshots wait together, for one look at all.

    :ivar waiting: the snapshots that came and were not taken yet, the newest last.
    """

    came = Signal()
    """A snapshot; it may have been taken already, together with an earlier one."""
    event = Signal(object)
    answer = Signal(object, object)
    pressing = Signal(object)

    def __init__(self) -> None:
        """Have heard nothing."""
        super().__init__()
        self.waiting: deque[Heard] = deque()

    def on_race(self, race: Race, at: float, two: bool) -> None:
        """Hand over a snapshot."""
        self.waiting.append(Heard(race, at, two))
        self.came.emit()

    def on_event(self, event: Event) -> None:
        """Hand over an event."""
        self.event.emit(event)

    def on_answer(self, order: Order, answer: Answer) -> None:
        """Hand over an answer."""
        self.answer.emit(order, answer)

    def on_pressing(self, stops: tuple[Standing, ...]) -> None:
        """Hand over the stops that race control has not accepted yet."""
        self.pressing.emit(stops)
