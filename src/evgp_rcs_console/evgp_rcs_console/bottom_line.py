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
The line at the bottom of the window: the answer to the official's last command, or what is urgent.

The most urgent comes first: stops that race control does not accept, what is pointed at, a command
without an answer, then the last answer.
"""

from __future__ import annotations

import time

from evgp_protocol import clock
from evgp_rcs_console import words
from evgp_rcs_console.commands import Order
from evgp_rcs_console.outcome import Outcome
from evgp_rcs_console.snapshot import Answer, Race
from evgp_rcs_console.unanswered import Unanswered
from evgp_rcs_console.view import Cell, Tone
from evgp_rcs_console.widgets import CommandButton, Fitted


class BottomLine:
    """
    Decides what the bottom line says.

    :param label: shows it.
    :param unanswered: what waits for race control.
    """

    def __init__(self, label: Fitted, unanswered: Unanswered) -> None:
        """Say that the window is ready."""
        self._label = label
        self._unanswered = unanswered
        self._message = Cell(words.READY)
        self._outcome: Outcome | None = None
        self._changed: tuple[Order, str] | None = None
        self._pointed: CommandButton | Fitted | None = None

    def say(self, text: str, tone: Tone = Tone.PLAIN) -> None:
        """Say something that has just happened, in place of what was said before."""
        self._message = Cell(text, tone)
        self._outcome = None
        self._changed = None
        self._pointed = None
        self.show()

    def say_sent(self, order: Order) -> None:
        """Say that a command was sent."""
        self.say(words.GIVEN.format(clock=_clock(), command=words.order_name(order)))

    def say_answer(self, order: Order, answer: Answer) -> None:
        """Say what race control answered, until that is no longer true."""
        mark = words.DONE if answer.success else words.REFUSED
        tone = Tone.GOOD if answer.success else Tone.BAD
        self.say(words.ANSWERED.format(clock=_clock(), mark=mark, answer=answer.message), tone)
        if answer.success:
            self._outcome = Outcome(order, clock.now())

    def take_race(self, race: Race, at: float) -> None:
        """Take a snapshot and when it came (s): what the last answer said may have changed."""
        if self._outcome is not None and not self._outcome.stands(race, at):
            self._say_changed(self._outcome.order, words.now_so(self._outcome.order, race))
        elif self._changed is not None:
            order, said = self._changed
            what = words.now_so(order, race)
            if what != said:
                self._say_changed(order, what)

    def point_at(self, widget: CommandButton | Fitted) -> None:
        """Explain what the pointer or the focus is on."""
        self._pointed = widget
        self.show()

    def leave(self, widget: CommandButton | Fitted) -> None:
        """Take that the pointer or the focus has left something."""
        if self._pointed is widget:
            self._pointed = None
            self.show()

    def show(self) -> None:
        """Show the most urgent."""
        self._label.show_cell(self._cell(clock.now()))

    def _say_changed(self, order: Order, what: str) -> None:
        self.say(words.CHANGED.format(clock=_clock(), what=what))
        self._changed = order, what

    def _cell(self, now: float) -> Cell:
        stops = self._unanswered.other_stops(now)
        if stops:
            said = (
                words.STOP_UNANSWERED.format(
                    command=words.order_name(stop.order),
                    count=stop.presses,
                    age=clock.duration(now - stop.since),
                    why=stop.said or words.NO_ANSWER,
                )
                for stop in stops
            )
            return Cell('  '.join(said), Tone.BAD)
        explanation = _explanation(self._pointed)
        if explanation:
            return Cell(explanation, Tone.WAIT)
        order = self._unanswered.oldest(now)
        if order is not None:
            age = clock.duration(now - order.at)
            name = words.order_name(order)
            return Cell(words.PENDING.format(command=name, age=age), Tone.WAIT)
        return self._message


def _explanation(pointed: CommandButton | Fitted | None) -> str:
    """Return why a command is not possible, or the whole of a text that is cut."""
    if isinstance(pointed, Fitted):
        return pointed.whole if pointed.cut else ''
    return pointed.button.explanation if pointed is not None and pointed.button else ''


def _clock() -> str:
    """Return the wall time, as an official reads it."""
    return time.strftime('%H:%M:%S')
