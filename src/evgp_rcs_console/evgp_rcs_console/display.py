# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The window's inbox, what it showed last, the kart that was chosen, and the bottom line."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
import contextlib
from dataclasses import dataclass
import time
from typing import TYPE_CHECKING

from evgp_node.qt import QtCore, QtGui, QtWidgets, Signal
from evgp_protocol import clock
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import Answer, StampedEvent
from evgp_rcs.rules.snapshot import Snapshot
from evgp_rcs.words import Cell, time_of_day, Tone
from evgp_rcs_console import texts
from evgp_rcs_console.catalogue import Kind
from evgp_rcs_console.commands import Given, LATE, shows, Unanswered
from evgp_rcs_console.freshness import Aim
from evgp_rcs_console.keys import KartField
from evgp_rcs_console.notices import OfficialNames
from evgp_rcs_console.view import Button, Screen
from evgp_rcs_console.widgets import CommandButton, Text

if TYPE_CHECKING:
    from evgp_rcs_console.window import ConsoleWindow


@dataclass(frozen=True)
class Shown:
    """What an official saw: the screen, and the place and command of each button on it."""

    screen: Screen
    buttons: tuple[tuple[CommandButton, QtGui.QRegion, Button], ...]

    def at(self, point: QtCore.QPoint) -> Button | None:
        return next((each for _, place, each in self.buttons if place.contains(point)), None)

    def of(self, widget: QtWidgets.QWidget) -> Button | None:
        return next((each for button, _, each in self.buttons if button is widget), None)


class SeenCommands(Aim[Shown]):
    """
    Remembers what the official has seen on the screen in the last few moments.

    An official who presses a button may have aimed at the button that was there before.

    :ivar screen: the current screen.
    """

    def __init__(self, window: QtWidgets.QWidget) -> None:
        super().__init__()
        self._window = window
        self.screen = Screen()

    def change_to(self, screen: Screen, now: float) -> None:
        """Replace the current screen. Call this before any widget shows the new screen."""
        # A snapshot without sense fails here, so that keys still send the last screen's stops.
        before, commands = self.screen, screen.commands
        self.screen = screen
        if before.rows and before.commands != commands:
            self.change(self._saw(before), now)

    @contextlib.contextmanager
    def scrolling(self, bar: QtWidgets.QScrollBar) -> Iterator[None]:
        """Return a context in which the window itself scrolls; it records what was seen before."""
        before, value = self._saw(self.screen), bar.value()
        yield
        if bar.value() != value:
            self.change(before, clock.now())

    def _saw(self, screen: Screen) -> Shown:
        # No sheet ever covers a button of another area, so sheets need no attention here.
        buttons = [
            (each, each.visibleRegion().translated(each.mapToGlobal(QtCore.QPoint(0, 0))), button)
            for each in self._window.findChildren(CommandButton)
            if (button := each.button) is not None and each.isVisible()
        ]
        return Shown(screen, tuple(buttons))


class Inbox(QtCore.QObject):
    """
    A ``Listener`` that passes everything the client receives to the Qt thread.

    After a hang, the window must not show one old snapshot after another, because each of them
    would make race control look silent. Snapshots therefore wait here until the window processes
    all of them together.

    :ivar waiting: the parameters of ``on_race`` that have not been processed yet, newest last.
    :ivar names: how this window names the officials.
    """

    came = Signal()
    """Emitted for each snapshot, though the window may have processed it with an earlier one."""
    event = Signal(object)
    results = Signal(object)
    answer = Signal(object, object)
    pressing = Signal(object)
    dropped = Signal(object, str)
    battery = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self.waiting: deque[tuple[Snapshot, float, bool]] = deque()
        self.names = OfficialNames()
        self.on_results, self.on_answer = self.results.emit, self.answer.emit
        self.on_pressing, self.on_dropped = self.pressing.emit, self.dropped.emit

    def on_race(self, race: Snapshot, at: float, two: bool) -> None:
        self.waiting.append((race, at, two))
        self.came.emit()

    def on_event(self, event: StampedEvent) -> None:
        self.names.take(event.event.official)
        self.event.emit(event)


class ChosenKart(KartField):
    """The kart that keyboard commands act on. It is shown below ALL KILL and in the list."""

    def __init__(self, window: ConsoleWindow) -> None:
        super().__init__()
        self._window = window

    def choose_in_sight(self, number: int) -> None:
        """Choose a kart whose row was clicked, without scrolling under the pointer."""
        self._window.karts.mark(number)
        self.choose(number)

    def choose_next(self, step: int) -> None:
        """Choose the kart ``step`` rows below the chosen kart; if no kart is chosen, the first."""
        numbers = self._window.karts.numbers
        if numbers:
            place = numbers.index(self.kart) + step if self.kart else 0
            self.choose(numbers[max(0, min(place, len(numbers) - 1))])

    def changed(self) -> None:
        karts = self._window.karts
        self._window.show_number(*self.cells())
        if self.kart != karts.table.chosen:
            karts.mark(self.kart)
            karts.bring_into_view(self.kart)


READ = 5.0
"""Minimum time to read a refusal, and any message before an older unanswered command replaces it,
in seconds."""

SETTLED = 1.0
"""Time after an answer from which every snapshot that arrives is newer than the answer, in
seconds. Race control publishes a snapshot at least every 0.5 s."""

Holds = Callable[[Screen], bool]
"""Returns whether a screen agrees with a message."""


def _barred(command: Kind, kart: int, by_letter: bool = False) -> Holds:
    def holds(screen: Screen) -> bool:
        button = screen.letter(kart) if by_letter else screen.button(command, kart)
        return button is None or button.is_stop or not button.enabled

    return holds


class BottomLine:
    """
    The line at the bottom of the window.

    The line shows the first of these that applies: stops that race control has not accepted, an
    explanation of what the pointer or the focus is on, a command without an answer, or the last
    message.
    """

    def __init__(self, label: Text, unanswered: Unanswered) -> None:
        self._label, self._unanswered = label, unanswered
        self._message = Cell('Ready.  F1 shows the keys.')
        self._said_at = 0.0
        self._holds: Holds | None = None
        self._pointed: object = None

    def say(self, text: str, tone: Tone = Tone.PLAIN, holds: Holds | None = None) -> None:
        """
        Replace the last message with a new one, and put the time of day before it.

        :param holds: returns whether a screen agrees with the message. If not, the line clears;
            without this, the message stays.
        """
        at, self._said_at = time_of_day(time.time()), clock.now()
        self._message = Cell(f'{at}  {text}' if text else '', tone)
        self._holds, self._pointed = holds, None
        self.show()

    def say_answer(self, given: Given, answer: Answer) -> None:
        """Show race control's answer while its snapshots agree with the answer."""
        if answer.success:
            text = f'✓ {answer.message}'
            self.say(text, Tone.GOOD, lambda screen: shows(screen.snapshot, given))
        else:
            text = f'{texts.REFUSED}{answer.message}'
            # The command may still look possible, so the official gets time to read the reason.
            ends, barred = clock.now() + READ, _barred(given.command, given.kart)
            self.say(text, Tone.BAD, lambda screen: clock.now() < ends or barred(screen))

    def say_barred(self, button: Button) -> None:
        """Show why a command is not possible, until it is possible."""
        by_letter = bool(button.kart and button.key)
        barred = _barred(button.command, button.kart, by_letter)
        self.say(button.explanation, Tone.WAIT, barred)

    def say_unsent(self, name: str, why: str) -> None:
        self.say(f'{name} WAS NOT SENT: {why}', Tone.BAD)

    def take_screen(self, screen: Screen, heard_at: float) -> None:
        """
        Remove the message if it is contradicted by a screen whose snapshot is certainly newer.

        :param heard_at: when that snapshot arrived, in seconds.
        """
        if self._holds and heard_at - self._said_at >= SETTLED and not self._holds(screen):
            self.say('')

    def point_at(self, widget: object) -> None:
        """Explain a widget, or show a text, that the pointer or the focus has reached."""
        self._pointed = widget
        self.show()

    def move(self, left: object, reached: object) -> None:
        """Explain the widget that the pointer or the focus has reached, if it can be explained."""
        if hasattr(reached, 'explanation'):
            self.point_at(reached)
        elif self._pointed is left:
            self.point_at(None)

    def show(self) -> None:
        self._label.show_cell(self._cell(clock.now()))

    def _cell(self, now: float) -> Cell:
        stops = [
            f'{texts.full_name(stop.given)}: sent {stop.presses} times in '
            f'{clock.duration(now - stop.since)}, {stop.said or "no answer"}. USE THE MSR.'
            for stop in self._unanswered.late_stops(now)
            if stop.given.command is not CommandKind.ALL_KILL  # its button says so
        ]
        if stops:
            return Cell('  '.join(stops), Tone.BAD)
        pointed = getattr(self._pointed, 'explanation', self._pointed)
        if pointed:
            return Cell(str(pointed), Tone.WAIT)
        given = self._unanswered.oldest(now)
        if given is not None and not given.at + LATE < self._said_at > now - READ:
            waited = clock.duration(now - given.at)
            return Cell(f'{texts.full_name(given)}: no answer yet ({waited})', Tone.WAIT)
        return self._message
