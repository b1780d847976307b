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

"""What the window shows: what is heard, what time makes of it, and which kart is chosen."""

from __future__ import annotations

from collections import deque
import time
from typing import NamedTuple

from evgp_protocol import clock
from evgp_rcs_console import texts
from evgp_rcs_console.alerts import Alarm
from evgp_rcs_console.areas import Areas, SeenCommands
from evgp_rcs_console.commands import Order, Outcome
from evgp_rcs_console.karts import KartList
from evgp_rcs_console.keys import KartField
from evgp_rcs_console.panels import NumberField
from evgp_rcs_console.qt import QtCore, Signal
from evgp_rcs_console.snapshot import Answer, Event, Race
from evgp_rcs_console.unanswered import Standing, Unanswered
from evgp_rcs_console.view import (
    Cell,
    Danger,
    danger,
    KILL_NOTES,
    NOTHING,
    RaceTimes,
    ReasonTimes,
    Row,
    Screen,
    show,
    silence,
    Tone,
)
from evgp_rcs_console.widgets import CommandButton, Painted, Text


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


class ChosenKart:
    """
    Keeps the field and the list showing the same kart.

    :param field: the field below ALL KILL.
    :param karts: the list.
    """

    def __init__(self, field: NumberField, karts: KartList) -> None:
        """Choose none."""
        self._field = KartField()
        self._shown_in = field
        self._karts = karts
        self._rows: tuple[Row, ...] = ()
        self._stale = False
        self._marked = 0

    @property
    def kart(self) -> int:
        """Return the kart that a command acts on now; 0: none."""
        return self._field.kart

    @property
    def digits(self) -> str:
        """Return what is typed."""
        return self._field.digits

    def show(self, rows: tuple[Row, ...], stale: bool) -> None:
        """Show the karts that there are, and mark the chosen one."""
        self._rows, self._stale = rows, stale
        self._field.show_roster({row.number: row.team for row in rows})
        self._shown_in.show_cells(*self._field.cells())
        self._mark()

    def choose(self, number: int) -> None:
        """Choose a kart, and scroll to it."""
        self._field.choose(number)
        self._follow()

    def choose_in_sight(self, number: int) -> None:
        """Choose a kart whose row was clicked: nothing moves under the official's hand."""
        self._field.choose(number)
        self._follow(scroll=False)

    def choose_next(self, step: int) -> None:
        """Choose the kart some rows below (negative: above) the chosen one, or the first."""
        numbers = self._karts.numbers
        if numbers:
            place = numbers.index(self.kart) + step if self.kart else 0
            self.choose(numbers[max(0, min(place, len(numbers) - 1))])

    def type_digit(self, digit: str, at: float) -> None:
        """Take a digit that was typed at a time (s)."""
        self._field.add(digit, at)
        self._follow()

    def erase(self, at: float) -> None:
        """Delete the last digit."""
        self._field.erase(at)
        self._follow()

    def clear(self) -> None:
        """Clear what is typed; a kart that was chosen in the list stays."""
        self._field.clear()
        self._follow()

    def expire(self, now: float) -> None:
        """Clear what is too old at a time (s)."""
        self._field.expire(now)
        self._follow()

    def take(self, command: str, at: float) -> tuple[int, str]:
        """Return the kart for a command by key at a time (s), or 0 and why there is none."""
        taken = self._field.take(command, at)
        self._follow()
        return taken

    def _follow(self, scroll: bool = True) -> None:
        self._shown_in.show_cells(*self._field.cells())
        if self.kart != self._marked:
            self._mark()
            if scroll:
                self._karts.bring_into_view(self._marked)

    def _mark(self) -> None:
        self._marked = self.kart
        self._karts.show_rows(self._rows, self._marked, self._stale)


class BottomLine:
    """
    Decides what the bottom line says.

    :param label: shows it.
    :param unanswered: what waits for race control.
    """

    def __init__(self, label: Text, unanswered: Unanswered) -> None:
        """Say that the window is ready."""
        self._label = label
        self._unanswered = unanswered
        self._message = Cell(texts.BEGIN)
        self._outcome: Outcome | None = None
        self._changed: tuple[Order, str] | None = None
        self._pointed: CommandButton | Painted | None = None

    def say(self, text: str, tone: Tone = Tone.PLAIN) -> None:
        """Say something that has just happened, in place of what was said before."""
        self._message = Cell(text, tone)
        self._outcome = None
        self._changed = None
        self._pointed = None
        self.show()

    def say_sent(self, order: Order) -> None:
        """Say that a command was sent."""
        self.say(texts.GIVEN.format(clock=_clock(), command=texts.order_name(order)))

    def say_answer(self, order: Order, answer: Answer) -> None:
        """Say what race control answered, until that is no longer true."""
        mark = texts.DONE if answer.success else texts.REFUSED
        tone = Tone.GOOD if answer.success else Tone.BAD
        self.say(texts.ANSWERED.format(clock=_clock(), mark=mark, answer=answer.message), tone)
        if answer.success:
            self._outcome = Outcome(order, clock.now())

    def take_race(self, race: Race, at: float) -> None:
        """Take a snapshot and when it came (s): what the last answer said may have changed."""
        if self._outcome is not None and not self._outcome.stands(race, at):
            self._say_changed(self._outcome.order, texts.now_so(self._outcome.order, race))
        elif self._changed is not None:
            order, said = self._changed
            what = texts.now_so(order, race)
            if what != said:
                self._say_changed(order, what)

    def point_at(self, widget: CommandButton | Painted) -> None:
        """Explain what the pointer or the focus is on."""
        self._pointed = widget
        self.show()

    def leave(self, widget: CommandButton | Painted) -> None:
        """Take that the pointer or the focus has left something."""
        if self._pointed is widget:
            self._pointed = None
            self.show()

    def show(self) -> None:
        """Show the most urgent."""
        self._label.show_cell(self._cell(clock.now()))

    def _say_changed(self, order: Order, what: str) -> None:
        self.say(texts.CHANGED.format(clock=_clock(), what=what))
        self._changed = order, what

    def _cell(self, now: float) -> Cell:
        stops = self._unanswered.other_stops(now)
        if stops:
            said = (
                texts.STOP_UNANSWERED.format(
                    command=texts.order_name(stop.order),
                    count=stop.presses,
                    age=clock.duration(now - stop.since),
                    why=stop.said or texts.NO_ANSWER,
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
            name = texts.order_name(order)
            return Cell(texts.PENDING.format(command=name, age=age), Tone.WAIT)
        return self._message


def _explanation(pointed: CommandButton | Painted | None) -> str:
    """Return why a command is not possible, or the whole of a text that is cut."""
    if isinstance(pointed, Painted):
        return pointed.whole.replace('\n', ', ') if pointed.cut else ''
    return pointed.button.explanation if pointed is not None and pointed.button else ''


def _clock() -> str:
    """Return the wall time, as an official reads it."""
    return time.strftime('%H:%M:%S')


AGES = 1.0
"""Time after which the ages on the screen are brought up to date, in seconds."""


class Display(QtCore.QObject):
    """
    Has every area show the newest snapshot of the race.

    :param looking: where race control is looked for, as a sentence says it.
    """

    def __init__(
        self,
        areas: Areas,
        seen: SeenCommands,
        chosen: ChosenKart,
        alarm: Alarm,
        bottom: BottomLine,
        unanswered: Unanswered,
        looking: str,
    ) -> None:
        """Begin with no race heard."""
        super().__init__(areas.window)  # of the Qt thread: what is heard is queued for it
        self._areas = areas
        self._seen = seen
        self._chosen = chosen
        self._alarm = alarm
        self._bottom = bottom
        self._unanswered = unanswered
        self._looking = looking
        self._began = clock.now()
        self._race: Race | None = None
        self._two = False
        self._heard_at = 0.0
        self._shown_at = 0.0
        self._danger_title = ''
        self._reasons = ReasonTimes()
        self._times = RaceTimes()

    # ----- what is heard ------------------------------------------------------------------

    def take_races(self, waiting: deque[Heard]) -> None:
        """Take the snapshots that wait, none of their alerts left out, and show the newest."""
        if not waiting:
            return
        while waiting:
            self._race, self._heard_at, self._two = waiting.popleft()
            self._alarm.take_race(self._race, self._two)
            self._bottom.take_race(self._race, self._heard_at)
        self.refresh()

    def take_event(self, event: Event) -> None:
        """Show an event."""
        self._times.take(event)
        self._areas.events.add(event)

    def take_answer(self, order: Order, answer: Answer) -> None:
        """Show the answer to a command."""
        self._unanswered.answered(order)
        self._bottom.say_answer(order, answer)
        self.refresh()

    def take_pressing(self, stops: tuple[Standing, ...]) -> None:
        """Show the stops that race control has not accepted yet."""
        self._unanswered.stops = stops
        self._show_kill()
        self._bottom.show()

    # ----- what is shown ------------------------------------------------------------------

    def look(self, now: float) -> None:
        """Show what has changed because time (s) has passed, and sound if there is a reason."""
        danger_now = self._danger(now)
        title = danger_now.title if danger_now else ''
        old = now - self._shown_at >= AGES
        if title or title != self._danger_title or self._unanswered or old:
            self.refresh()
        self._areas.clock.look()
        self._show_kill()
        if self._unanswered.stops:
            self._bottom.show()
        self._alarm.look(now, alarming=danger_now is not None and self._race is not None)

    def refresh(self) -> None:
        """Show the newest snapshot as it is now."""
        now = clock.now()
        self._shown_at = now
        danger_now = self._danger(now)
        title = danger_now.title if danger_now else ''
        if title != self._danger_title:
            self._danger_title = title
            self._alarm.sound_soon()
        race = self._race or NOTHING
        reasons = self._reasons.update(race.commands, now)
        ages = self._unanswered.ages(now)
        entered = self._times.entered
        screen = show(race, now - self._heard_at, ages, danger_now, reasons, entered)
        self._see(screen, now)
        self._areas.show_banner(screen.banner)
        areas, stale = self._areas, danger_now is not None and danger_now.stale
        areas.danger.setVisible(danger_now is not None)
        for area in (areas.state, areas.track):
            area.setVisible(danger_now is None)
        if danger_now is not None:
            areas.danger.show_danger(danger_now)
        areas.state.show_screen(screen, stale)
        areas.track.show_screen(screen, stale)
        areas.clock.show_screen(screen, stale)
        areas.steps.show_screen(screen)
        areas.strip.show_screen(screen, areas.events.log.officials, stale)
        self._areas.heats.show_heats(screen.heats)
        self._chosen.show(screen.rows, stale)
        self._areas.events.show_karts(screen.rows)
        self._alarm.show(known=not stale)
        asked = self._areas.question.button
        if self._areas.question.isVisible() and asked is not None:
            self._areas.question.update_button(screen.button(asked.command, asked.kart))
        self._show_kill()
        self._bottom.show()

    def _see(self, screen: Screen, now: float) -> None:
        """Keep what the official saw until now; close the choice of heats if they have changed."""
        before = self._seen.screen
        heats_changed = (
            self._areas.heats.isVisible()
            and before is not None
            and _heats(before) != _heats(screen)
        )
        # A click on its way to the sheet must not hit what is below it.
        self._seen.change_to(screen, now, moving=heats_changed)
        if heats_changed:
            self._areas.heats.close_sheet()
            self._bottom.say(texts.HEATS_CHANGED, Tone.BAD)

    def _danger(self, now: float) -> Danger | None:
        race = self._race or NOTHING
        silent_for = now - self._heard_at if self._race is not None else None
        looking_for = now - self._began
        said = silence(silent_for, looking_for, self._looking, race.state, KILL_NOTES)
        return said or danger(race, self._two)

    def _show_kill(self) -> None:
        now = clock.now()
        stop = self._unanswered.all_kill(now)
        if stop is not None:
            age = clock.duration(now - stop.since)
            hint = Cell(texts.KILL_UNANSWERED.format(count=stop.presses, age=age), Tone.BAD)
        elif self._areas.window.isActiveWindow():
            hint = Cell(texts.KILL_HINT)
        else:
            hint = Cell(texts.KEYS_OFF, Tone.BAD)
        self._areas.number_field.show_keys(self._areas.window.isActiveWindow())
        self._areas.kill.show_hint(hint, pressing=stop is not None)


def _heats(screen: Screen) -> list[tuple[str, tuple[int, ...]]]:
    """Return the heats that a screen offers."""
    return [(button.heat, button.karts) for button in screen.heats]
