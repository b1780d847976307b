# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Shows the race in the areas of the window, and the official's commands on the bottom line.

The areas change with the newest snapshot, with time, and with the official's choice of a kart.
The window also remembers what it showed a moment ago, because an official who presses a button
may have aimed at the button that was there before.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
import contextlib
from dataclasses import dataclass
import time

from evgp_node.results import Standings
from evgp_protocol import clock
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.link_quality import NOT_MEASURED
from evgp_rcs.rules.race import Answer, StampedEvent
from evgp_rcs.rules.snapshot import Snapshot
from evgp_rcs.words import Cell, time_of_day, Tone
from evgp_rcs_console import settings, style, texts
from evgp_rcs_console.alerts import AlertsArea
from evgp_rcs_console.catalogue import Kind
from evgp_rcs_console.commands import Given, LATE, shows, Standing, Unanswered
from evgp_rcs_console.freshness import Aim
from evgp_rcs_console.karts import KartList
from evgp_rcs_console.keys import KartField
from evgp_rcs_console.notices import OfficialNames
from evgp_rcs_console.panels import (
    ClockPanel,
    DangerPanel,
    EventPanel,
    Foot,
    KillBox,
    NumberField,
    StatePanel,
    Steps,
    Strip,
    TrackPanel,
)
from evgp_rcs_console.qt import QtCore, QtGui, QtWidgets, Signal
from evgp_rcs_console.sheets import Heats, Help, Officials, Question, Sheet
from evgp_rcs_console.style import DAY, GAP, look, NIGHT
from evgp_rcs_console.view import Button, Latest, Screen
from evgp_rcs_console.widgets import CENTER, CommandButton, fixed, font, lay, mark, rescale, Text


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

    :ivar screen: the current screen; None before the first screen.
    """

    def __init__(self, window: QtWidgets.QWidget) -> None:
        super().__init__()
        self._window = window
        self.screen: Screen | None = None

    def change_to(self, screen: Screen, now: float) -> None:
        """Replace the current screen. Call this before any widget shows the new screen."""
        # A snapshot without sense fails here, so that keys still send the last screen's stops.
        before, commands = self.screen, _commands(screen)
        self.screen = screen
        if before is not None and before.rows and _commands(before) != commands:
            self.change(self._saw(before), now)

    @contextlib.contextmanager
    def scrolling(self, bar: QtWidgets.QScrollBar) -> Iterator[None]:
        """Return a context in which the window itself scrolls; it records what was seen before."""
        before = self._saw(self.screen) if self.screen is not None else None
        value = bar.value()
        yield
        if before is not None and bar.value() != value:
            self.change(before, clock.now())

    def _saw(self, screen: Screen) -> Shown:
        # No sheet ever covers a button of another area, so sheets need no attention here.
        buttons = [
            (each, each.visibleRegion().translated(each.mapToGlobal(QtCore.QPoint(0, 0))), button)
            for each in self._window.findChildren(CommandButton)
            if (button := each.button) is not None and each.isVisible()
        ]
        return Shown(screen, tuple(buttons))


def _commands(screen: Screen) -> list[object]:
    """Return the commands of all buttons, in an order that follows their places."""
    gives = [button.gives for button in (*screen.buttons, *screen.heats)]
    return [(each.command, each.kart, each.heat, each.karts * bool(each.heat)) for each in gives]


class Areas(QtWidgets.QWidget):
    """Lays out the areas of the window and the sheets that open over them."""

    def __init__(self, names: OfficialNames) -> None:
        super().__init__()
        self.setObjectName('window')
        self.setAttribute(QtCore.Qt.WidgetAttribute.WA_StyledBackground)
        self.seen = SeenCommands(self)
        self._banner = fixed(Text('top_line', 'bold', CENTER, fills=True), height=24)
        self._banner.hide()
        self.state = fixed(StatePanel(), 316)
        self.track = TrackPanel()
        self.danger = DangerPanel()
        self.clock = fixed(ClockPanel(), 138)
        self.kill = fixed(KillBox(), 272)
        self.steps = fixed(Steps(), height=60)
        self.strip = fixed(Strip(names), height=28)
        self.karts = KartList()
        how = '\n\n'.join(texts.HOW_TO_BEGIN)
        self.how_to_begin = Text('how_to_begin', 'large', wrap=True, text=how)
        self.number_field = fixed(NumberField(), height=48)
        self.alerts = fixed(AlertsArea(), height=198)
        self.events = EventPanel(names)
        self.foot = fixed(Foot(), height=32)
        self._arrange()
        self.question = Question(self)
        self.help = Help(self)
        self.heats = Heats(self)
        self.officials = Officials(self)
        self._style: object = None

    def _arrange(self) -> None:
        top, side = fixed(QtWidgets.QWidget(), height=78), QtWidgets.QWidget()
        # If two parts share a place, the last one added is visible and sets the gap.
        grid = lay(top, (self.danger, self.danger, self.clock), gap=GAP, columns=(0, 1, 0))
        grid.addWidget(self.state, 0, 0)
        grid.addWidget(self.track, 0, 1)
        lay(side, [self.number_field], [self.alerts], [self.events], gap=GAP, heights=(0, 0, 1))
        rows = (
            (self._banner, self._banner),
            (top, self.kill),
            (self.steps, self.kill),
            (self.strip, side),
            (self.how_to_begin, side),
            (self.foot, self.foot),
        )
        margins, heights = (10, 10, 10, 6), (0, 0, 0, 0, 1)
        grid = lay(self, *rows, gap=GAP, margins=margins, columns=(1, 0), heights=heights)
        grid.addWidget(self.karts, 4, 0)
        self.how_to_begin.raise_()

    def fit(self) -> None:
        """Adapt all areas and sheets to the size of the window and to the palette."""
        look.by = style.scale(self.width(), self.height())
        if self._style != (look.by, look.palette):
            self._style = look.by, look.palette
            QtWidgets.QApplication.setFont(font(look.px(style.TEXT)))
            self.setStyleSheet(style.sheet())
            rescale(self)
            self.events.restyle()
        self.layout().activate()
        self.karts.fit()
        self.place_sheets()

    def toggle_night(self) -> None:
        look.palette = DAY if look.palette is NIGHT else NIGHT
        settings.keep_soon(settings.NIGHT, 'on' if look.palette is NIGHT else '')
        self.fit()

    def resizeEvent(self, event: QtGui.QResizeEvent) -> None:  # noqa: N802 - Qt's name
        self.fit()

    def show_screen(self, screen: Screen) -> None:
        self._show_banner(screen.snapshot.banner)
        self.how_to_begin.setVisible(not screen.rows)
        for part in (self.state, self.track, self.danger, self.clock, self.steps, self.strip):
            part.show_screen(screen)
        for part in (self.heats, self.officials, self.karts, self.events, self.alerts):
            part.show_screen(screen)
        self.question.show_screen(screen)

    def _show_banner(self, banner: str) -> None:
        if banner != self._banner.text():
            self._banner.show_cell(Cell(banner, Tone.BANNER))
            self._banner.setVisible(bool(banner))
            self.setWindowTitle(f'{banner}: {texts.TITLE}' if banner else texts.TITLE)
            self.fit()

    def open_sheet(self, sheet: Sheet, focus: QtWidgets.QWidget) -> None:
        """Show a sheet with the focus on one of its parts and close the other sheets."""
        self.close_sheets()
        sheet.show()
        self.place_sheets()
        focus.setFocus()

    def close_sheets(self) -> None:
        """Close every sheet except the question, which only an answer can close."""
        for sheet in self.findChildren(Sheet):
            if sheet is not self.question:
                sheet.close_sheet()

    def place_sheets(self) -> None:
        """Place the open sheets so that they cover neither a kart's number nor its stops."""
        for sheet in self.findChildren(Sheet):
            if not sheet.isHidden():
                room = self.karts.room_of_sheets
                sheet.lay_out(room.translated(self.karts.mapTo(self, QtCore.QPoint(0, 0))))

    def is_stop(self, widget: QtWidgets.QWidget | None) -> bool:
        if isinstance(widget, CommandButton) and widget.button is not None:
            return widget.button.is_stop
        return widget is self.kill.button


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
    """Emitted for each snapshot. The window may have processed that snapshot already, together
    with an earlier one."""
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

    def __init__(self, areas: Areas) -> None:
        super().__init__()
        self._areas = areas

    def choose_in_sight(self, number: int) -> None:
        """Choose a kart whose row was clicked, without scrolling under the pointer."""
        self._areas.karts.mark(number)
        self.choose(number)

    def choose_next(self, step: int) -> None:
        """Choose the kart ``step`` rows below the chosen kart; if no kart is chosen, the first."""
        numbers = self._areas.karts.numbers
        if numbers:
            place = numbers.index(self.kart) + step if self.kart else 0
            self.choose(numbers[max(0, min(place, len(numbers) - 1))])

    def changed(self) -> None:
        karts = self._areas.karts
        self._areas.number_field.show_cells(*self.cells(), self._areas.isActiveWindow())
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


def _always(_: Screen) -> bool:
    return True


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
        self._holds: Holds = _always
        self._pointed: object = None

    def say(self, text: str, tone: Tone = Tone.PLAIN, holds: Holds = _always) -> None:
        """
        Replace the last message with a new one, and put the time of day before it.

        :param holds: returns whether a screen agrees with the message. If not, the line clears.
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
        if heard_at - self._said_at >= SETTLED and not self._holds(screen):
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
        """Show the line, in smaller type if it is too long otherwise."""
        cell = self._cell(clock.now())
        if cell.text != self._label.text():
            mark(self._label, kind='bold')
            self._label.show_cell(cell)
            mark(self._label, kind='small' if self._label.cut else 'bold')
        self._label.show_cell(cell)

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


def _without_measurements(race: Snapshot, results: Standings | None) -> object:
    """Return a snapshot and results without times or link figures."""
    results = None if results is None else results._replace(stamp=0.0)
    links = (NOT_MEASURED._replace(grade=kart.link.grade) for kart in race.karts)
    karts = [kart._replace(link=link) for kart, link in zip(race.karts, links, strict=True)]
    return race._replace(stamp=0.0, karts=()), karts, results


AGES = 1.0
"""Maximum time between two updates of the ages on the screen, in seconds."""


class Display(Areas):
    """
    Shows the newest snapshot of the race in every area.

    It belongs to the Qt thread, so Qt queues the client's signals.

    :ivar unanswered: this official's commands that race control has not answered yet, and the
        stops that it has not accepted yet.
    """

    def __init__(self, looking: str, inbox: Inbox) -> None:
        super().__init__(inbox.names)
        self.unanswered = Unanswered()
        self.bottom = BottomLine(self.foot.status, self.unanswered)
        self.chosen = ChosenKart(self)
        self._latest = Latest(clock.now(), looking)
        self._waiting = inbox.waiting
        self._shown_at = 0.0

    # ----- what the client receives -------------------------------------------------------

    def take_races(self) -> None:
        """Process every waiting snapshot, so that no alert is missed, and show the newest."""
        shown, changed = self.seen.screen, False
        while self._waiting:
            race, at, two = self._waiting.popleft()
            self._latest.take_race(race, at, two)
            self.alerts.take_race(race, two)
            if not changed and shown is not None and shown.danger is None:
                before = _without_measurements(shown.snapshot, shown.heard)
                changed = before != _without_measurements(race, self._latest.results)
            else:
                changed = True
        if changed:
            self.refresh()  # if only figures have changed, they can wait for `look`

    def take_event(self, stamped: StampedEvent) -> None:
        self._latest.take_event(stamped.event)
        self.events.add(stamped)

    def take_results(self, results: Standings) -> None:
        self._latest.results = results

    def take_answer(self, given: Given, answer: Answer) -> None:
        self.unanswered.answered(given)
        self.bottom.say_answer(given, answer)
        self.refresh()

    def take_pressing(self, stops: tuple[Standing, ...]) -> None:
        self.unanswered.stops = stops
        self.refresh()

    # ----- what is shown ------------------------------------------------------------------

    def look(self) -> None:
        """Show what has arrived or depends on the time, and sound the alarm if it is due."""
        self.take_races()
        now, shown = clock.now(), self.seen.screen
        danger = self._latest.danger(now)
        is_due = self.unanswered or now - self._shown_at >= AGES
        if danger or is_due or shown is None or shown.danger:
            self.refresh()
        self.clock.look()
        self.alerts.look(now, danger is not None and self._latest.race is not None)

    def refresh(self) -> None:
        """Show the newest snapshot, with all ages up to date."""
        now = clock.now()
        self._shown_at = now
        shown, screen = self.seen.screen, self._latest.screen(now, self.unanswered.ages(now))
        if screen.danger_title != (shown.danger_title if shown is not None else ''):
            self.alerts.alarm.sound_soon()
        self.seen.change_to(screen, now)
        self.show_screen(screen)
        self.chosen.show_roster(screen.teams)
        self._show_kill(screen, now)
        self.bottom.take_screen(screen, self._latest.heard_at)
        self.bottom.show()

    @property
    def unheard(self) -> str:
        """Return why stops may not reach race control; empty if race control is not silent."""
        danger = self._latest.danger(clock.now())
        return danger.barred if danger is not None and danger.stale else ''

    def _show_kill(self, screen: Screen, now: float) -> None:
        late = self.unanswered.late_stops(now)
        stop = next((each for each in late if each.given.command is CommandKind.ALL_KILL), None)
        if stop is not None:
            age = clock.duration(now - stop.since)
            hint = Cell(f'SENT {stop.presses} times in {age}: no answer', Tone.BAD)
        elif self.isActiveWindow():
            karts = texts.count(screen.rows) if screen.rows else 'karts'
            hint = Cell(f'all {karts} · SPACE BAR or F12')
        else:
            hint = Cell('KEYS OFF: click this window', Tone.BAD)
        self.kill.show_hint(hint, pressing=stop is not None)
