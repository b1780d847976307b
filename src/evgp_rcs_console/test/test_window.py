# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The window without race control and without a screen, at a simulated time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import importlib
import itertools
import os
import pathlib
import sys
import time
from typing import Any

from evgp_node.codec import message_of, value_of
from evgp_node.official import UNNAMED
from evgp_node.results import Act, KartResult, RaceOfEvent, Standings, Status
from evgp_protocol import clock
from evgp_protocol.link import Grade, GRADES
from evgp_protocol.states import RaceState
from evgp_rcs.rules import inputs
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind

try:
    from evgp_node.qt import QtCore, QtGui, QtWidgets
except ImportError as error:
    from rig.needs import cannot_run

    cannot_run(f'Qt cannot be loaded: {error}', whole_file=True)
from evgp_rcs.rules.inputs import Entrant, Setup
from evgp_rcs.rules.link_quality import NOT_MEASURED
from evgp_rcs.rules.race import (
    Alert,
    AlertKind,
    Answer,
    Attendance,
    Availability,
    Event,
    EventKind,
    Heat,
    RaceTimes,
    StampedEvent,
    TrackAccess,
)
from evgp_rcs.rules.snapshot import Snapshot, snapshot_of
from evgp_rcs_console import style, texts
from evgp_rcs_console.alerts import Alarm, AlertsArea
from evgp_rcs_console.client import spoken
from evgp_rcs_console.commands import Given, LATE, Standing
from evgp_rcs_console.display import Inbox, READ, SETTLED
from evgp_rcs_console.freshness import AGAIN, AIM, InputClock, SETTLE, STALE
from evgp_rcs_console.gui import low_battery
from evgp_rcs_console.input import FORWARD, UNDO_AFTER
from evgp_rcs_console.karts import chooses
from evgp_rcs_console.keys import FORGOTTEN
from evgp_rcs_console.settings import Signature
from evgp_rcs_console.sheets import Sheet
from evgp_rcs_console.style import BLACK, DAY, FILLS, NIGHT, WHITE, YELLOW
from evgp_rcs_console.view import BARS
from evgp_rcs_console.widgets import CommandButton, Panel, Push, Text
from evgp_rcs_console.window import ConsoleWindow, LOOK
from evgp_rcs_msgs import msg
from example_race import EVERYTHING, KART, offers, RACE, replace
import pytest
from recorded_races import PaperRace

QtTest = importlib.import_module(QtCore.__name__.replace('QtCore', 'QtTest'))

SIZES = [(1366, 768), (1280, 720), (3840, 2160), (911, 512)]
"""
Sizes of the window, the first of which it is designed for.

The last is the first on a desktop that enlarges all by 150 %.
"""
HANG = 2.0
"""How long a window hangs here, in seconds."""

NAME = 'Hochschule für Technik und Wirtschaft 40'
WHY = 'waiting for kart 17 (Technische Hochschule Ostwestfalen-Lippe): no GRID ACTIVE yet; '
ASKING = [kind for kind in CommandKind if CATALOGUE[kind].asks]
LINKS = [
    NOT_MEASURED._replace(grade=grade, worst_answer=0.9994, round_trip=0.1996) for grade in Grade
]
MAY_END = (
    *('status', 'rest', 'humans_reason'),
    *('danger_detail', 'state_since', 'number_detail'),
)
"""Texts of any length: if they do not fit, they end with dots, and the bottom line shows all."""
WHOLE = 'tally', 'reminder', 'msr', 'able', 'banner', 'danger_advice'
"""Texts that are never cut off, however long they are."""


@pytest.fixture(scope='module')
def application() -> Any:
    """Return Qt's application, without a screen."""
    words = ['rcs_gui', '-platform', 'offscreen']
    return QtWidgets.QApplication.instance() or QtWidgets.QApplication(words)


def alerts_in(area: AlertsArea) -> str:
    """Return the text of the alerts that an area shows."""
    document = QtGui.QTextDocument()
    document.setHtml(area.findChild(QtWidgets.QLabel, 'alert_texts').text())
    return str(document.toPlainText())


class Console:
    """
    A window, and what it sent.

    :cvar now: the time of the window, in seconds; it passes only in ``settle``.
    """

    now = 1000.0

    def __init__(
        self, application: Any, width: int = 1366, height: int = 768, name: str = 'Anna'
    ) -> None:
        self.application = application
        self.sent: list[Given] = []
        self._race = RACE
        self.inbox = Inbox()
        self.window = ConsoleWindow(self.inbox, self.sent.append, Signature(name, 1), 'here')
        self.handle = self.window.windowHandle()
        self.window.resize(width, height)
        self.window.show()
        self.window.activateWindow()
        while not self.window.isActiveWindow():
            self.settle()
        self.settle(FORWARD)

    def settle(self, seconds: float = 0.0) -> None:
        """Let time pass and Qt handle its events, in steps too short for a hang."""
        ends = self.now + seconds * 1.000001  # a sum of such numbers may be a little too small
        while True:
            self.application.processEvents()
            self.window.look()
            for _ in range(2):
                self.application.processEvents()
            if self.now >= ends:
                return
            Console.now = min(ends, self.now + STALE)

    def tell(self, race: Snapshot, results: Standings | None = None) -> None:
        """Send the window a snapshot, after the timekeeper's results."""
        self._race = race
        if results is not None:
            self.inbox.on_results(results)
        self.inbox.on_race(race, self.now, False)
        self.settle()

    def look(self) -> None:
        """Send the last snapshot again, and wait until an official has seen what it shows."""
        self.tell(self._race)
        self.settle(AIM)

    def find(self, name: str) -> Any:
        found = self.window.findChild(QtWidgets.QWidget, name)
        assert found is not None, name
        return found

    def text(self, name: str) -> str:
        """Return the text of a widget, or the texts in it."""
        widget = self.find(name)
        if isinstance(widget, AlertsArea):
            return alerts_in(widget)
        own = [widget] if isinstance(widget, (Text, Push)) else []
        parts = (each.text() for each in (*own, *widget.findChildren(Text)))
        return '\n'.join(filter(None, parts))

    def row(self, number: int) -> QtCore.QRect:
        """Return the visible part of a kart's row, in the window; empty if it is out of sight."""
        karts = self.window.karts
        table = karts.table
        rect = table.visualRect(table.model().index(karts.numbers.index(number), 0))
        corner = table.viewport().mapTo(self.window, QtCore.QPoint(0, 0))
        seen = rect.intersected(table.viewport().rect())
        return seen.translated(corner) if not seen.isEmpty() else seen

    def says(self, number: int) -> str:
        """Return the texts of a kart's row."""
        model, place = self.window.karts.table.model(), self.window.karts.numbers.index(number)
        return '\n'.join(model.index(place, column).data() or '' for column in range(6))

    def press(self, *acts: str) -> None:
        """Look at the window, then press keys and click widgets, by their names."""
        self.look()
        for act in acts:
            self.strike(act)

    def strike(self, act: str) -> None:
        """Press a key or click a widget without looking first."""
        if act.islower():
            self.click_at(self.place(act))
        else:
            key = QtGui.QKeySequence(act)[0]
            QtTest.QTest.keyClick(self.handle, key.key(), key.keyboardModifiers())
            self.settle()

    def told(self, act: Callable[..., object], *arguments: object) -> str:
        """Return what the bottom line says once something was done."""
        self.window.bottom.say('')
        act(*arguments)
        self.settle()
        return self.text('status')

    def hang(self) -> None:
        """Let time pass in which the window does nothing: whatever comes next has waited."""
        Console.now += HANG
        self.inbox.on_race(self._race, self.now, False)

    def repeat(self, key: QtCore.Qt.Key) -> None:
        """Let a key that is held repeat."""
        none = QtCore.Qt.KeyboardModifier.NoModifier
        kind = QtCore.QEvent.Type.KeyPress
        event = QtGui.QKeyEvent(kind, key.value, none, ' ', True)
        self.application.sendEvent(self.handle, event)
        self.settle()

    def place(self, name: str) -> QtCore.QPoint:
        """Return the centre of a widget, in the window."""
        widget = self.find(name)
        return widget.mapTo(self.window, widget.rect().center())

    def click_at(self, point: QtCore.QPoint, act: str = 'mouseClick') -> None:
        """Click at a point of the window, or do something else with the mouse, without looking."""
        left, none = QtCore.Qt.MouseButton.LeftButton, QtCore.Qt.KeyboardModifier.NoModifier
        getattr(QtTest.QTest, act)(self.handle, left, none, point)
        self.settle()

    @property
    def commands(self) -> list[tuple[CommandKind, int]]:
        """Return what was sent since the last call, and to which karts."""
        found = [(given.command, given.kart) for given in self.sent]
        self.sent.clear()
        return found

    def close(self) -> None:
        self.window.close()
        self.window.deleteLater()
        self.application.focusChanged.disconnect(self.window.bottom.move)
        self.settle()


@pytest.fixture
def opened(
    application: Any,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: pathlib.Path,
    capfd: pytest.CaptureFixture[str],
) -> Iterator[Any]:
    """Return a function that opens a window of a size; a traceback on stderr fails the test."""
    monkeypatch.setenv('ROS_HOME', str(tmp_path))
    # QTest stamps each click half a second after the last one, but keys with the real time. By
    # these stamps, keys would seem old. test_freshness.py and test_console.py test the stamps.
    monkeypatch.setattr(InputClock, 'age', lambda self, stamp, now: 0.0)
    monkeypatch.setattr(time, 'clock_gettime', lambda _: Console.now)
    windows: list[Console] = []

    def open_(*given: Any) -> Console:
        windows.append(Console(application, *given))
        return windows[-1]

    yield open_
    for window in windows:
        window.close()
    assert 'Traceback' not in capfd.readouterr().err


@pytest.fixture
def console(opened: Any) -> Console:
    return opened()  # type: ignore[no-any-return]


def race_of(
    count: int, state: RaceState = RaceState.GREEN_GREEN, reason: str = '', **changes: Any
) -> Snapshot:
    """Return a race of some karts; a reason makes every command impossible."""
    statement = '' if reason else 'the track is clear of humans'
    commands = tuple(
        each._replace(
            available=not reason,
            reason=reason,
            statement=statement if CATALOGUE[each.command].statement else '',
            karts=(1, 2) if each.command is CommandKind.GRID_ACTIVE else (),
        )
        for each in EVERYTHING
    )
    karts = tuple(
        replace(
            KART,
            number=1000 + number if count > 20 else number,
            team=NAME,
            sent=state,
            sent_since=RACE.stamp - 3599.0,
            acknowledged=number % 3 > 0,
            reported=RaceState.GRID_ACTIVE,
            place=number if state is RaceState.RED_FLAG else 0,
            hold=RaceState.RED_RED if reason else None,
            hold_reason='ALL KILL by Anna' if reason else '',
            connected=not reason or number % 2 > 0,
            may_be_moving=bool(reason),
            commands=commands,
            link=LINKS[number % 4],
            poor_lately=LINKS[number % 4].grade is Grade.POOR,
        )
        for number in range(1, count + 1)
    )
    race = replace(
        RACE,
        state=state,
        karts=karts,
        commands=commands,
        track=TrackAccess(False, False, reason or 'the race is under way', False),
        heats=(Heat('Heat A', (1,)), Heat('Final', (1, 2))),
        state_cause='GREEN GREEN by Anna-Katharina (race-pc 4711)',
    )
    return replace(race, **changes)


def alert(kart: int, text: str = '') -> Alert:
    """Return an alert that needs the MSR, about a kart or (0) about the track."""
    lost = f'Kart {kart} ({NAME}) lost its connection while it may have been moving'
    kind = AlertKind.LOST_IN_MOTION if kart else AlertKind.TRACK_UNSAFE
    return Alert(kind, kart, 0.0, text or lost, True)


def every(**fields: Any) -> tuple[Availability, ...]:
    """Return the offer of every command, with some fields changed."""
    return tuple(each._replace(**fields) for each in EVERYTHING)


def event(
    sequence: int, text: str, official: str = '', kind: EventKind = EventKind.COMMAND
) -> StampedEvent:
    return StampedEvent(sequence, 0, 0.0, Event(kind, text, official=official))


def timing(karts: int, laps: int = 3) -> Standings:
    """Return the standings of a race of six laps, in which each kart has completed some laps."""
    times = (61.2345,) * laps
    results = (
        KartResult(kart, kart, Status.RUNNING, laps, 4321.5 + 16 * kart, times, ())
        for kart in range(1, karts + 1)
    )
    return Standings(RACE.stamp, laps=6, karts=tuple(results))


UNSAFE = (
    'Clear the track: race control does not know what happened before it began: '
    'look at every kart, then send IN GARAGE'
)
STATES = {
    'green': race_of(8),
    'one': race_of(1, RaceState.GRID_ACTIVE),
    'sixteen': race_of(16, RaceState.RED_FLAG),
    'killed': race_of(
        16, RaceState.RED_RED, WHY, alerts=tuple(map(alert, range(1, 17))), able_to_stop=12
    ),
    'nobody': race_of(14, able_to_stop=0),
    'reminder': race_of(30, stamp=RACE.state_since + 35.0),
    'unsafe': race_of(1, alerts=(alert(0, UNSAFE),), banner='REHEARSAL'),
    'thirty': race_of(30, RaceState.RED_RED, WHY, alerts=(alert(1001),), banner='REHEARSAL'),
    'msr used': race_of(
        8,
        RaceState.RED_RED,
        alerts=tuple(
            replace(alert(kart, f'Kart {kart} (Purdue) was lost'), use_msr=False)
            for kart in (1, 2, 3)
        ),
    ),
    'garage': race_of(
        9, RaceState.IN_GARAGE, track=TrackAccess(True, True, 'all are in IN GARAGE', False)
    ),
}

SHEETS = 'F2', 'F3', 'F6', 'F7', 'F9', 'Ctrl+H take_roster', 'Ctrl+H', 'official', 'F1'
"""The keys and the clicks that open each sheet."""


def sheets(console: Console) -> list[Any]:
    """Return the sheets that are open."""
    return [each for each in console.window.findChildren(Sheet) if each.isVisible()]


def misfits(console: Console) -> Iterator[str]:
    """Yield every text that is cut off, except a sentence outside the sheets."""
    for widget in console.window.findChildren(QtWidgets.QWidget):
        if not isinstance(widget, (Text, Push, AlertsArea)) or widget.visibleRegion().isEmpty():
            continue
        name, cut = widget.objectName(), getattr(widget, 'cut', False)
        if isinstance(widget, Push):
            wide = widget.fontMetrics().horizontalAdvance(widget.text())
            cut = wide > widget.width() - style.look.px(6)
        said = alerts_in(widget) if isinstance(widget, AlertsArea) else widget.text()
        ends = name in MAY_END or (' ' in said[24:] and name not in WHOLE)
        if cut and (not ends or any(each.isAncestorOf(widget) for each in sheets(console))):
            yield f'{name}: {said!r} is cut'
    karts = console.window.karts
    for place, number in enumerate(karts.numbers):
        # A long name or note may end with dots, because the bottom line shows all of it.
        whole = console.row(number).height() == karts.table.rowHeight(place)
        if whole and (cut := {*karts.cut(place)} - {1}):
            yield f'kart {number}: columns {cut} are cut'


def overlaps(console: Console) -> Iterator[str]:
    """Yield every two parts of an area that overlap, except sheets and what takes no click."""
    no_click = QtCore.Qt.WidgetAttribute.WA_TransparentForMouseEvents
    kinds = Text, Panel, Push
    for parent in (console.window, *console.window.findChildren(QtWidgets.QWidget)):
        parts = [
            (each, each.geometry())
            for each in parent.children()
            if isinstance(each, QtWidgets.QWidget if isinstance(parent, Sheet) else kinds)
            if not isinstance(each, Sheet)
            and each.isVisible()
            and not each.testAttribute(no_click)
        ]
        for (one, place), (other, its_place) in itertools.combinations(parts, 2):
            if place.intersects(its_place):
                yield f'{one.objectName()} and {other.objectName()} overlap'


def covered(console: Console) -> Iterator[str]:
    """Yield whatever of the strip, the karts and the stops something lies over or moved off."""
    child, table = console.window.childAt, console.window.karts.table
    view = table.viewport()
    strip, shown = console.find('strip'), child(console.place('strip'))
    if shown is not strip and shown.parentWidget() is not strip:
        yield 'the strip is covered'
    kill, pushes = console.find('all_kill'), console.window.findChildren(Push)
    largest = max(pushes, key=lambda each: each.isVisible() * each.width() * each.height())
    if kill.visibleRegion().boundingRect() != kill.rect() or largest is not kill:
        yield 'ALL KILL is not wholly in sight, or not the largest button'
    for place, number in enumerate(console.window.karts.numbers):
        row = console.row(number)
        if not row.isEmpty() and not chooses(child(row.center())):
            yield f'kart {number} is covered'
        for name in (f'kart_red_red_{number}', f'kart_red_flag_{number}'):
            stop = console.find(name)
            if table.rowAt(stop.geometry().center().y()) not in (place, -1):
                yield f'{name} is beside another kart'
            for point in (QtCore.QPoint(2, 2), stop.rect().center()):
                in_sight = view.rect().contains(stop.mapTo(view, point))
                if in_sight and child(stop.mapTo(console.window, point)) is not stop:
                    yield f'{name} is covered'


def controls(console: Console) -> dict[Any, QtCore.QRect]:
    """Return the place of each area and button."""
    window, corner = console.window, QtCore.QPoint(0, 0)
    kinds = Push, Panel, QtWidgets.QAbstractItemView
    found = (each for each in window.findChildren(QtWidgets.QWidget) if isinstance(each, kinds))
    return {
        each: QtCore.QRect(each.mapTo(window, corner), each.size())
        for each in found
        if each.isVisible()
    }


def moved(console: Console, first: dict[Any, QtCore.QRect]) -> Iterator[str]:
    """Yield every control that has moved or gone, except those whose place a danger takes."""
    now, of_race = controls(console), console.find('state_panel').parentWidget()
    for each, place in first.items():
        if now.get(each) != place and (each in now or not of_race.isAncestorOf(each)):
            yield f'{each.objectName()} moved from {place} to {now.get(each)}'


@pytest.mark.parametrize(('size', 'count'), [*zip(SIZES, (30, 16, 30, 16), strict=True)], ids=str)
def test_nothing_is_cut_overlaps_moves_or_covers_a_stop_or_the_number_of_any_kart(
    opened: Any, size: tuple[int, int], count: int
) -> None:
    console = opened(*size)
    found: list[str] = []
    first: dict[Any, QtCore.QRect] = {}  # the controls of a screen; none of them ever moves

    def look(what: str) -> None:
        console.settle(0.05)
        wrong = misfits(console), overlaps(console), covered(console), moved(console, first)
        found.extend(f'{what}: {each}' for each in itertools.chain(*wrong))

    how = console.window.how_to_begin
    assert console.window.childAt(how.geometry().center()) is how
    assert how.text().split('\n\n') == list(texts.HOW_TO_BEGIN)
    assert not how.cut
    found += misfits(console)
    for number, name in enumerate(('Anna-Katharina', 'Bartholomäus', 'Maximiliane'), 1):
        console.inbox.on_event(event(number, 'so it is', f'{name} (pc 1)'))
    for name, race in STATES.items():
        console.tell(race)
        look(name)
        able = console.find('able')
        assert able.isVisible()
        assert able.parentWidget().contentsRect().contains(able.geometry())
        many = len(race.karts) > 16
        assert console.find('overview').isVisible() is many
        assert console.row(race.karts[-1].number).isEmpty() is many
        if name == 'killed':
            named = ', '.join(map(str, range(1, 17)))
            assert console.text('msr') == f'USE THE MSR: karts {named}'
            for text, edge in (('standing', 'top'), ('humans_reason', 'bottom')):
                lines = console.find(text).grab().toImage()
                y = 0 if edge == 'top' else lines.height() - 1
                inks = {lines.pixel(x, y) for x in range(lines.width())}
                assert len(inks) == 1, f'the {edge} of {text} is cut off'
        elif name == 'nobody':
            assert console.text('able') == 'No official can stop the race'
        elif name == 'msr used':  # the three alerts are seen at once
            assert console.text('banner').count('ALERT') == 3
            assert 'not shown' not in console.text('standing')
    assert not how.isVisible()

    console.tell(STATES['green'], timing(8))
    look('timing')
    assert console.find('karts').columnWidth(1) > 2 * console.find('karts').columnWidth(0)
    assert {'P8 3/6', '+1:52.000'} <= {*console.says(8).splitlines()}
    plain = race_of(count, banner='REHEARSAL', stamp=RACE.state_since + 20.0)
    console.press('F1')
    for race in (replace(plain, banner=''), plain):
        console.tell(race)  # the sheet and the buttons move with the rows
        look(f'help {race.banner}')
    console.press('Esc')
    first = controls(console)
    for number, race in enumerate(
        (
            replace(plain, alerts=(alert(1),)),
            replace(plain, alerts=tuple(map(alert, range(1, 13)))),
            plain,  # the alerts have ended
            race_of(count, RaceState.RED_RED, WHY, banner='REHEARSAL'),
            race_of(count, RaceState.IN_GARAGE, banner='REHEARSAL'),
            plain,
        )
    ):
        console.tell(race)
        look(f'race {number}')
    asked = set()
    for acts in (*SHEETS, 'F11', 'F4', '5 8 7', 'F10', 'F8', 'F8'):
        console.press(*acts.split())
        look(acts)
        assert bool(sheets(console)) is (acts in SHEETS)
        asked.add(console.find('question').button.command)
        console.press('N', 'Esc')
    assert asked | {CommandKind.KART_IN_GARAGE, CommandKind.KART_UNDO_FINISH} == set(ASKING)
    console.inbox.on_race(plain, clock.now(), True)
    look('two')
    assert console.text('danger_advice') == texts.TWO_ADVICE
    assert not console.window.unheard
    console.settle(1.2)
    look('gone')
    assert console.window.unheard == texts.GONE_REASON  # so it announces that it cannot stop

    assert not sorted(found)


def test_a_link_is_told_by_the_number_of_its_bars(console: Console) -> None:
    race = race_of(len(Grade))
    console.tell(race)
    table = console.find('karts')
    picture = table.viewport().grab().toImage()
    seen = []
    for place in range(len(Grade)):
        room = table.visualRect(table.model().index(place, 4))
        line = room.center().y() + style.look.px(8)  # every bar begins below it
        shades = [picture.pixelColor(room.left() + x, line).name().upper() for x in range(40)]
        seen.append(sum(a != b == DAY.ink for a, b in itertools.pairwise(['', *shades])))

    assert seen == [BARS[kart.link.grade] for kart in race.karts] == [4, 2, 1, 0]


def contrast(one: str, other: str) -> float:
    """Return the contrast of two colours, from 1 to 21, as WCAG 2 defines it."""

    def luminance(colour: str) -> float:
        parts = [part / 255 for part in bytes.fromhex(colour[1:])]
        linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize('palette', [DAY, NIGHT], ids=['day', 'night'])
def test_every_text_and_shape_stands_out_from_its_ground(palette: style.Palette) -> None:
    grounds = palette.card, palette.ground
    letters = (
        *itertools.product((palette.good, palette.bad), grounds),
        *itertools.product((palette.ink, palette.faint), (*grounds, palette.raised)),
        *FILLS.values(),
        (YELLOW, BLACK),
        (WHITE, FILLS[style.Tone.RED][1]),
    )
    assert not [each for each in letters if contrast(*each) < 4.5]
    assert not [each for each in grounds if contrast(palette.chosen, each) < 3]


def test_a_window_that_is_not_active_says_so_and_takes_the_first_click_for_no_command(
    console: Console, application: Any
) -> None:
    other = QtWidgets.QWidget()
    console.tell(race_of(2))
    other.setGeometry(2000, 0, 50, 50)
    other.show()
    other.activateWindow()
    console.settle(0.1)
    assert not console.window.isActiveWindow()
    field = console.find('number')
    assert field.text() == texts.KEYS_OFF_LARGE
    assert field.font().pixelSize() * 2 > console.find('all_kill').font().pixelSize()

    for _ in range(2):  # it does so each time
        assert 'Click again' in console.told(console.press, 'kart_finish_1')
        assert not console.sent
        other.activateWindow()
        console.settle(0.1)
    console.press('kart_red_red_1', 'all_kill')

    assert console.commands == [(CommandKind.KART_RED_RED, 1), KILL]
    other.close()
    console.window.activateWindow()
    console.settle(0.3)
    assert field.text() == ''


def test_a_heat_is_chosen_by_its_number_and_enter_and_no_other_key_puts_one_into_the_race(
    console: Console,
) -> None:
    console.tell(race_of(2, RaceState.IN_GARAGE))
    for acts, heats in (
        ('set_heat heat_1', ['Heat A']),
        ('Ctrl+H Return', ['Heat A']),
        ('Ctrl+H 2 Return Return', ['Final']),  # then no button has the focus
        ('Ctrl+H 2 3 Backspace Return', ['Final']),
        ('Ctrl+H 3 Return', []),
        ('Ctrl+H 2 2 Return', []),
        ('Ctrl+H 2 Backspace Return', []),
        ('Ctrl+H Esc Return', []),
    ):
        console.press(*acts.split())
        assert [given.heat for given in console.sent] == heats, acts
        assert not console.find('heats').isVisible()
        for given in console.sent:
            console.inbox.on_answer(given, Answer(True, 'so it is'))
        console.sent.clear()
        console.window.chosen.clear()
    console.press('Ctrl+H', '2', 'Ctrl+R')  # a digit is also the number of a kart to stop
    assert console.commands == [(CommandKind.KART_RED_RED, 2)]
    console.press('F2', 'set_heat')
    console.find('no').setFocus()
    console.press('2')
    assert console.find('no').hasFocus()  # what is asked keeps the focus
    console.press('N')
    more = tuple(Heat(f'Heat {n}', (n,)) for n in range(1, 6))
    console.press('Ctrl+H')
    console.tell(race_of(2, RaceState.IN_GARAGE, heats=more))
    names = [*(f'heat_{n}' for n in range(1, 6)), 'read_roster', 'take_roster']
    buttons = [console.find(name) for name in names]
    assert all(each.visibleRegion().boundingRect() == each.rect() for each in buttons)
    assert len({each.height() for each in buttons}) == 1
    console.press('5', 'Return')
    assert [given.heat for given in console.sent] == ['Heat 5']
    console.inbox.on_answer(console.sent.pop(), Answer(True, 'so it is'))
    ran = tuple(RaceOfEvent(1, f'Heat {n}', 0.0, 1, True) for n in (1, 2))
    done = race_of(2, RaceState.IN_GARAGE, heats=more, heat='Heat 2')
    done = done._replace(karts=tuple(each._replace(place=1) for each in done.karts))
    console.tell(done, timing(2)._replace(races=ran))
    heat = console.find('set_heat').grab().toImage()
    assert {heat.pixelColor(x, 9).name().upper() for x in (8, 12)} == {DAY.ink}  # it is filled
    room = itertools.product(range(9, heat.width() - 9), range(5, heat.height() - 5))
    assert max(heat.pixelColor(*each).lightness() for each in room) > 200  # its text stands out
    console.press('Ctrl+H', 'Return')
    assert [given.heat for given in console.sent] == ['Heat 3']
    console.inbox.on_answer(console.sent.pop(), Answer(True, 'so it is'))
    ran = tuple(RaceOfEvent(1, each.name, 0.0, 1, True) for each in more)
    console.tell(done._replace(heat='Heat 5'), timing(2)._replace(races=ran))
    console.press('Ctrl+H', 'Return')  # a kart that came late, not the first heat once more
    assert [given.heat for given in console.sent] == ['Heat 5']
    console.sent.clear()
    console.tell(race_of(1, RaceState.IN_GARAGE, heats=()))
    console.press('Ctrl+H', 'read_roster')
    assert console.commands == [(CommandKind.READ_ROSTER, 0)]
    console.press('take_roster')
    assert console.find('question').button.command is CommandKind.TAKE_ROSTER


def test_the_locked_qt_loses_no_reference_to_none(console: Console) -> None:
    """Else Python ends the window after some thousand calls, in the middle of a race."""
    label = Text()
    before = sys.getrefcount(None)
    for _ in range(1000):
        label.setText('text')
        label.setFixedWidth(10)
        label.property('none')
    assert before - sys.getrefcount(None) < 100


def test_a_low_battery_is_told_while_it_is_in_use(tmp_path: pathlib.Path) -> None:
    (tmp_path / 'AC').mkdir()
    battery = tmp_path / 'BAT0'
    battery.mkdir()
    (battery / 'type').write_text('Battery\n')
    for status, capacity, low in (
        ('Discharging', '12', 12),
        ('Discharging', '80', None),
        ('Charging', '12', None),
    ):
        (battery / 'status').write_text(f'{status}\n')
        (battery / 'capacity').write_text(f'{capacity}\n')
        assert low_battery(tmp_path) == low


def test_every_stop_looks_like_one_and_only_the_next_step_is_filled_until_race_control_has_ended(
    console: Console,
) -> None:
    def looks(which: Callable[[Any], bool]) -> dict[str, str]:
        buttons = filter(which, console.window.findChildren(CommandButton))
        return {each.objectName(): each.property('look') for each in buttons}

    console.tell(race_of(1, reason=WHY))
    assert looks(lambda each: each.isEnabled() and each.property('barred') != 'true') == {
        'red_flag': 'flag',
        'record_msr': '',
        'kart_red_red_1': 'stop',
        'kart_red_flag_1': 'flag',
    }
    for state, step in (
        (RaceState.IN_GARAGE, {'grid_active': 'next'}),
        (RaceState.GRID_ACTIVE, {'green_green': 'go'}),
        (RaceState.GREEN_GREEN, {}),
    ):
        console.tell(race_of(4, state))
        assert looks(lambda each: each.property('look') in ('next', 'go')) == step
    assert 'all 4 karts' in console.text('kill_hint')
    assert '2 karts in the race' in console.text('grid_active')
    fine = TrackAccess(False, True, 'all are in IN GARAGE', False)
    console.tell(race_of(2, RaceState.IN_GARAGE, track=fine))
    console.inbox.on_event(event(1, 'it ends', kind=EventKind.ENDED))
    console.settle(1.1)
    assert console.text('danger_title') == texts.ENDED


# ----- a press is for what the official saw --------------------------------------------------


def without(race: Snapshot, number: int) -> Snapshot:
    """Return a race without one of its karts and with a new one at the end: the rows move up."""
    rest = [kart for kart in race.karts if kart.number != number]
    return replace(race, karts=(*rest, replace(rest[-1], number=rest[-1].number + 1)))


EIGHT, GARAGE = race_of(8), race_of(2, RaceState.IN_GARAGE)
MOVED, GONE = without(EIGHT, 3), replace(EIGHT, karts=EIGHT.karts[:1])
OUTSIDE = replace(GARAGE, karts=tuple(replace(kart, in_race=False) for kart in GARAGE.karts))
HEATS = [
    replace(GARAGE, heats=tuple(Heat(f'Heat {n}', (n,)) for n in range(3, end))) for end in (4, 5)
]


@pytest.mark.parametrize(
    ('before', 'first', 'after', 'then', 'unsent'),
    [
        (EIGHT, '', MOVED, 'kart_red_red_8', None),
        (EIGHT, '', GONE, 'kart_red_red_8', None),
        (EIGHT, 'kart_red_red_8', MOVED, 'kart_red_red_8', None),
        (EIGHT, '', MOVED, 'kart_finish_8', 'FINISH kart 9'),
        (EIGHT, '', GONE, 'kart_finish_8', 'FINISH kart 8'),
        (EIGHT, 'kart_finish_8', MOVED, 'kart_finish_8', 'FINISH kart 8'),
        (EIGHT, 'kart_finish_8', EIGHT, 'kart_finish_7', 'FINISH kart 8'),
        (GARAGE, 'leave_race_1', without(GARAGE, 1), 'kart_red_red_2', 'LEAVE kart 1'),
        (OUTSIDE, '1', GARAGE, 'Ctrl+J', 'LEAVE kart 1'),  # another official was faster
        (GARAGE, 'Ctrl+H', HEATS[0], 'Return', ''),  # no button has the focus any more
        (GARAGE, 'Ctrl+H', HEATS[1], 'Return', 'HEAT'),
        *(
            (GARAGE, 'Ctrl+H', heats, heat, 'HEAT')
            for heats, heat in itertools.product(HEATS, ('heat_1', 'heat_2'))
        ),
    ],
)
def test_a_press_is_for_what_the_official_saw_and_else_sends_nothing_but_a_stop(
    console: Console, before: Snapshot, first: str, after: Snapshot, then: str, unsent: str | None
) -> None:
    """The mouse goes down on ``first``, or it is keys; ``then`` comes once the screen changed."""
    console.tell(before)
    said, held = console.says(before.karts[-1].number), first.islower()
    console.press(*first.split() * (not held))
    point = console.place(then) if then.islower() else None
    if held:
        console.click_at(console.place(first), 'mousePress')
    console.tell(after)
    if point is None:
        console.strike(then)
    else:
        console.click_at(point, 'mouseRelease' if held else 'mouseClick')

    assert console.commands == [(CommandKind.KART_RED_RED, 8)] * (unsent is None)
    assert not unsent or f'{unsent} WAS NOT SENT' in console.text('status')
    console.tell(before)
    assert console.says(before.karts[-1].number) == said


def test_a_click_in_a_row_scrolls_nothing_and_a_stop_is_for_the_kart_that_was_aimed_at(
    console: Console,
) -> None:
    console.tell(race_of(30))
    first = console.row(1001)
    cut = next(
        number for number in range(1002, 1031) if console.row(number).height() < first.height()
    )
    console.click_at(console.row(cut).topLeft() + QtCore.QPoint(20, 2))
    assert console.text('number') == f'KART {cut}'
    assert console.row(1001) == first
    point = console.place('kart_red_red_1005')

    console.press(*'1025')
    console.click_at(point)

    assert console.commands == [(CommandKind.KART_RED_RED, 1005)]
    assert not console.row(1025).isEmpty()
    console.settle(AIM)
    console.press('kart_red_red_1025')
    assert console.commands == [(CommandKind.KART_RED_RED, 1025)]


def test_a_letter_that_just_got_another_command_or_is_of_no_kart_sends_nothing(
    console: Console,
) -> None:
    for laps in (3, 5):
        console.settle(AIM)
        console.tell(race_of(2, heat='Final'), timing(2, laps))
    for letter, name in (('A', 'FINISH kart 1'), ('C', 'C')):  # A was to count a crossing
        assert f'{name} WAS NOT SENT' in console.told(console.strike, letter)
    assert not console.sent


def test_a_number_that_is_not_in_the_roster_is_said_so_and_stops_no_kart(console: Console) -> None:
    console.tell(race_of(8))
    console.press('7', '2')
    assert console.text('number') == 'NO KART 72'
    console.press('Ctrl+R')

    assert not console.sent
    assert 'RED RED WAS NOT SENT' in console.text('status')
    console.press('7', '2', 'Backspace')
    assert console.text('number') == 'KART 7'
    console.settle(FORGOTTEN + 0.2)  # nobody uses it: it is cleared in sight
    assert console.text('number') == ''


def test_what_is_too_long_for_the_bottom_line_or_for_the_alerts_can_still_be_read(
    console: Console,
) -> None:
    console.tell(race_of(2, alerts=(alert(0, 9 * WHY),)))
    status = console.find('status')
    sizes = []
    for why in (WHY, 4 * WHY, WHY):
        console.inbox.on_answer(Given(CommandKind.IN_GARAGE), Answer(False, why))
        console.settle()
        sizes.append(status.font().pixelSize())
        assert not status.cut
    assert sizes[0] == sizes[2] > sizes[1]  # the longer one is in smaller type

    assert not console.window.alerts.cut
    assert '…' in console.find('alert_texts').text()
    for name in ('number_field', 'alert_texts'):
        QtTest.QTest.mouseMove(console.handle, console.place(name))
        console.settle()
    assert 4 * WHY in console.text('status')


def test_the_banner_of_race_control_is_at_the_top(console: Console) -> None:
    console.tell(race_of(1))
    top = console.find('top_line')
    assert not top.isVisible()
    console.tell(race_of(1, banner='REHEARSAL'))
    ground = top.grab().toImage().pixelColor(12, top.height() // 2).name().upper()
    assert (top.text(), ground) == ('REHEARSAL', FILLS[style.Tone.BANNER][1])
    assert console.place('top_line').y() < console.place('state_panel').y()
    assert 'REHEARSAL' in console.window.windowTitle()


def test_a_window_that_was_held_up_shows_no_snapshot_but_the_newest_and_every_alert(
    console: Console,
) -> None:
    console.tell(race_of(1))
    shown = []
    console.find('danger').showEvent = lambda event: shown.append(event)
    for age in range(30, -1, -1):
        race = race_of(1, alerts=(alert(1),) if age == 15 else ())
        console.inbox.on_race(race, clock.now() - age / 10, False)
    console.settle()

    assert not shown
    assert 'Kart 1' in console.text('banner')


def test_a_long_event_hides_no_other_one_and_the_newest_ones_are_seen_also_after_the_night(
    console: Console,
) -> None:
    console.tell(race_of(1))
    log = console.find('log')

    def place(row: int) -> QtCore.QRect:
        return log.visualItemRect(log.item(row))

    def hear(*events: StampedEvent) -> str:
        """Tell of some events; return how the log shows the last one."""
        for each in events:
            console.inbox.on_event(each)
        console.settle()
        return str(log.item(0).text())

    long = event(1, 'RED RED sent to ' + 'kart 99, ' * 200)
    newest = hear(long, event(2, f'Kart 1 ({NAME}): the newest', 'Anna (pc 1)'))
    assert newest.endswith('Kart 1: the newest · Anna')
    assert log.item(0).font().bold()
    assert log.viewport().rect().contains(place(0))
    assert place(1).height() > 9 * place(0).height()  # it is wrapped, and not cut off
    # Two windows of one name.
    assert hear(event(3, 'more', 'Anna (pc 2)')).endswith('more · Anna (pc 2)')
    short = [event(number, 'kart 12 connected') for number in range(4, 24)]
    hear(*short)
    assert all(log.viewport().rect().contains(place(row)) for row in range(20))
    for number in range(25, 65):
        text = f'event {number} ' + 'is long, ' * 9
        assert hear(event(number, text)).endswith(text)
        if not number % 20:
            console.press('F8')
        assert log.viewport().rect().contains(place(0).topLeft())


# ----- stops, names and questions -----------------------------------------------------------


KILL = (CommandKind.ALL_KILL, 0)
KILLS = ('Space', 'F12', 'Ctrl+Space', 'Shift+Space')


def test_all_kill_by_key_whichever_widget_has_the_focus(console: Console) -> None:
    console.tell(race_of(2, RaceState.IN_GARAGE, officials=('Anna', 'Ben')))
    console.press('official')
    found = set()
    while console.window.focusWidget().objectName() not in found:
        found.add(console.window.focusWidget().objectName())
        for key in KILLS:
            console.press(key)
            assert console.commands == [KILL]
        console.press('Tab')

    assert {'official_1', 'close_officials', 'filter', 'log', 'mute'} <= found
    assert {'kart_finish_1', 'official', 'all_kill'} <= found


def test_alerts_that_ended_go_with_the_next_race_but_not_a_stop_that_is_no_longer_sent(
    console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    sounds: list[Alarm] = []
    monkeypatch.setattr(Alarm, 'sound', lambda each: sounds.append(each))
    console.tell(race_of(2, alerts=(alert(1), alert(2))))
    console.tell(race_of(2))
    assert '2 alerts, the last: Kart 1 lost its' in console.text('banner')
    assert console.text('banner').count('ENDED') == 1
    sounds.clear()

    console.inbox.on_dropped(Given(CommandKind.RED_FLAG), 'RED FLAG is no longer sent')
    console.tell(race_of(2, RaceState.GRID_ACTIVE))

    assert 'RED FLAG is no longer sent' in console.text('banner')
    assert 'ENDED' not in console.text('banner')
    console.settle(2 * LOOK / 1000)
    assert sounds
    assert console.commands == []
    console.press('F10')
    assert 'RED FLAG' not in console.text('banner')

    def drop() -> list[tuple[CommandKind, int]]:
        """Have ALL KILL be no longer sent; return what is sent instead."""
        console.inbox.on_dropped(Given(CommandKind.ALL_KILL), 'ALL KILL is no longer sent')
        console.settle()
        return console.commands

    console.click_at(console.place('all_kill'), 'mousePress')
    assert console.commands == [KILL]
    assert drop() == [KILL]  # it is still held, which is a new press
    console.click_at(console.place('all_kill'), 'mouseRelease')
    assert drop() == []
    console.repeat(QtCore.Qt.Key.Key_Space)  # the keyboard repeats a key that is held
    console.repeat(QtCore.Qt.Key.Key_Space)
    assert console.commands == [KILL]


def test_an_alert_sounds_by_a_player_of_the_machine_and_ends_with_its_cause_once_it_is_seen(
    opened: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path
) -> None:
    heard, player = tmp_path / 'heard', tmp_path / 'pw-play'
    os.mkfifo(heard)
    player.write_text(f'#!/bin/sh\nhead -c 4 "$1" > {heard}\n')
    player.chmod(0o755)
    monkeypatch.setenv('PATH', f'{tmp_path}{os.pathsep}{os.environ["PATH"]}')
    console = opened()
    console.tell(race_of(1, alerts=(alert(1),)))

    assert heard.read_text() == 'RIFF'
    console.press('F11')
    assert 'OFF' in console.text('mute')
    console.press('F10')
    console.tell(race_of(1))
    assert 'No alerts' in console.text('standing')


def test_a_name_goes_with_every_command_and_the_next_window_has_it_and_the_same_palette(
    opened: Any, tmp_path: pathlib.Path
) -> None:
    name = 'A & <b>M'  # Qt takes such letters for something else, unless it is told not to
    console = opened(*SIZES[0], '')
    console.tell(race_of(2, officials=('Anna Meier', name)))
    assert 'Your name' in console.text('official')
    console.press('all_kill', 'official', 'official_2', 'F4')
    assert not console.find('officials').isVisible()
    assert [given.official.partition(' (')[0] for given in console.sent] == [UNNAMED, name]
    console.press('F8')
    kept, ends = [tmp_path / 'evgp_rcs' / each for each in ('official', 'night')], time.monotonic()
    while not all(each.exists() for each in kept) and time.monotonic() < ends + 5:
        console.settle()

    windows = console, opened(*SIZES[0], '')

    for window in windows:
        assert name in window.text('official').replace('&&', '&')
        assert style.look.palette is NIGHT
    windows[1].press('F8')
    assert style.look.palette is DAY


@pytest.mark.parametrize('answer', ['Y', 'Ctrl+G', 'yes', 'yes_and_more'])
def test_what_else_a_question_confirms_is_sent_if_the_official_says_so_and_not_otherwise(
    console: Console, answer: str
) -> None:
    race = race_of(2, track=TrackAccess(True, True, 'the MSR was used', True))
    held = replace(race.karts[0], connected=False, hold=RaceState.RED_RED)
    console.tell(replace(race, karts=(held, *race.karts[1:])))
    console.press('F6')
    assert 'kart 1 made safe by hand' in console.text('yes_and_more')
    console.look()

    console.find(answer).click() if answer.islower() else console.press(answer)

    (given,) = console.sent
    assert given.command is CommandKind.IN_GARAGE
    also = answer in ('Ctrl+G', 'yes_and_more')
    assert [(each.command, each.kart, each.stated) for each in given.then] == (
        [(CommandKind.KART_IN_GARAGE, 1, True)] if also else []
    )


def test_no_click_or_key_answers_yes_before_an_official_can_have_read_the_question(
    console: Console,
) -> None:
    console.tell(race_of(2))
    console.press('F2')
    console.look()
    question = console.window.question
    question.shown_at = console.now  # as if the question had just opened
    console.click_at(console.place('yes'))
    question.shown_at = console.now + 1.0
    console.strike('Y')
    assert 'before the question appeared' in console.text('status')
    assert not console.commands
    question.shown_at = 0.0
    console.click_at(console.place('yes'))
    assert console.commands == [(CommandKind.GRID_ACTIVE, 0)]


def test_a_double_click_is_one_press(console: Console, monkeypatch: pytest.MonkeyPatch) -> None:
    console.tell(race_of(2, heat='Final'), timing(2))
    console.look()
    # As if the answer to the first click were there already.
    monkeypatch.setattr(console.window.unanswered, 'add', lambda given: None)

    console.click_at(console.place('count_1'), 'mouseDClick')

    assert console.commands == [(Act.COUNT, 1)]


def test_a_key_or_a_click_that_was_too_old_is_named_if_it_means_anything(
    console: Console,
) -> None:
    console.tell(GARAGE)
    console.press('F2')
    console.look()
    yes, leave = console.place('yes'), console.place('leave_race_1')
    for acts in (('mousePress', 'mouseRelease'), ('mouseClick',)):  # only let go, or all too late
        for act in acts[:-1]:
            console.click_at(yes, act)
        console.hang()
        assert 'YES WAS NOT SENT' in console.told(console.click_at, yes, acts[-1])
        for _ in range(round(SETTLE * 1000 / LOOK) + 3):  # it gets over the hang
            console.settle(LOOK / 1000)
    console.press('N')
    console.look()
    console.click_at(leave, 'mousePress')
    console.tell(without(GARAGE, 1))  # the row is another kart's meanwhile
    console.hang()
    assert 'LEAVE kart 1 WAS NOT SENT' in console.told(console.click_at, leave, 'mouseRelease')
    for key, is_named in (('F2', True), ('Tab', True), ('Shift', False)):
        assert bool(console.told(console.strike, key)) is is_named
    assert not console.sent


STOP_ACTS = {
    'kart_red_red_1': (CommandKind.KART_RED_RED, 1),
    '2 Ctrl+R': (CommandKind.KART_RED_RED, 2),
    '1 Esc 2 Ctrl+F': (CommandKind.KART_RED_FLAG, 2),  # digits are not joined across another key,
    '1 Ctrl+G 2 Ctrl+R': (CommandKind.KART_RED_RED, 2),  # dropped or not
    'red_flag': (CommandKind.RED_FLAG, 0),
    'F4': (CommandKind.RED_FLAG, 0),
    'all_kill': KILL,
    'Space': KILL,
}


@pytest.mark.parametrize('act', STOP_ACTS)
def test_a_stop_that_was_pressed_while_the_window_hung_acts(console: Console, act: str) -> None:
    command, kart = STOP_ACTS[act]
    console.tell(race_of(2))
    console.look()
    console.hang()
    for name in act.split():
        console.strike(name)
    (given,) = console.sent
    assert (given.command, given.kart) == (command, kart)
    assert given.waited > STALE


def test_a_stop_acts_while_a_question_is_open_and_what_changes_ends_the_question(
    console: Console,
) -> None:
    race = race_of(2)
    stops = [(CommandKind.KART_RED_RED, 2), (CommandKind.RED_FLAG, 0)]
    for question in ('F6', 'F9', '1 Ctrl+G'):
        console.tell(race)
        console.press(*question.split())
        asked = console.find('question').button
        for key in KILLS:
            console.press(key)
            assert console.commands == [KILL]
        # The click moves the focus to the stop that Enter presses.
        console.press('2', 'Ctrl+R', 'F4', 'kart_red_flag_1', 'Return', 'all_kill')
        assert console.commands == [*stops, *[(CommandKind.KART_RED_FLAG, 1)] * 2, KILL]

        console.tell(race_of(2, RaceState.RED_RED, WHY))
        assert console.find('yes').isEnabled() is CATALOGUE[asked.command].stop
        console.tell(race)  # who has looked away is asked again
        assert console.find('yes').isEnabled() is CATALOGUE[asked.command].stop
        console.press('A')  # a crossing waits for no answer
        console.inbox.on_answer(console.sent[0], Answer(True, 'it is so'))
        console.press('N', 'N')
        assert not console.find('question').isVisible()
        assert console.commands == [(CommandKind.KART_FINISH, 1)]
    console.press('Ctrl+R')  # the kart of the last question is still chosen
    assert console.commands == [(CommandKind.KART_RED_RED, 1)]


def test_a_command_by_key_takes_the_place_of_an_open_question_even_if_it_is_not_possible(
    console: Console,
) -> None:
    race = race_of(2)
    grid = CommandKind.GRID_ACTIVE
    commands = (each._replace(available=each.command is not grid) for each in race.commands)
    barred = race._replace(commands=tuple(commands))
    for race_now, keys, sent in (
        (race, '1 Ctrl+G F9 Y', [(CommandKind.RECORD_MSR, 0)]),
        (race, '1 Ctrl+G 2 Ctrl+G Y', [(CommandKind.KART_IN_GARAGE, 2)]),
        (barred, '1 Ctrl+G F2 Y', []),
    ):
        console.tell(race_now)
        console.press(*keys.split())
        assert console.commands == sent, keys
        assert not console.find('question').isVisible()


def test_while_a_snapshot_cannot_be_shown_keys_refer_to_the_last_screen(
    console: Console,
) -> None:
    race = race_of(2)
    console.tell(race)
    shown = console.window.seen.screen
    console.window._latest.take_race(replace(race, state_since=1e30), console.now, False)
    with pytest.raises(OverflowError):
        console.window.refresh()
    assert console.window.seen.screen is shown
    console.tell(race)


def test_what_is_said_of_a_command_leaves_the_bottom_line_once_it_no_longer_holds(
    console: Console,
) -> None:
    barred, possible = race_of(2, RaceState.GRID_ACTIVE, WHY), race_of(2, RaceState.GRID_ACTIVE)
    for how, holds in (('pressed', barred), ('refused', barred), ('accepted', race_of(2))):
        console.tell(holds)
        if how == 'pressed':
            console.press('F3')
        else:
            answer = Answer(how == 'accepted', WHY)
            console.inbox.on_answer(Given(CommandKind.GREEN_GREEN), answer)
        for race in (holds, replace(holds, stamp=holds.stamp + 1), possible):
            console.tell(race)
            assert WHY in console.text('status'), how  # the last race may be an older one
        console.settle(SETTLED)
        console.tell(possible)
        if how == 'refused':  # its reason can be read although it looks possible
            assert WHY in console.text('status')
            console.settle(READ - SETTLED)
            console.tell(possible)

        assert not console.text('status'), how
    console.tell(barred)
    console.inbox.on_answer(Given(CommandKind.GREEN_GREEN), Answer(False, WHY))
    console.settle(READ)
    console.tell(barred)
    assert WHY in console.text('status')  # it still holds
    console.tell(possible)
    console.press('F3', 'Y')
    console.settle(LATE)
    for seconds, refused in ((0.0, True), (READ, False)):
        if refused:
            answer = Answer(False, WHY)
            console.inbox.on_answer(Given(CommandKind.KART_IN_GARAGE, 1), answer)
        console.settle(seconds)
        assert (WHY in console.text('status')) is refused
        assert ('GREEN GREEN: no answer yet' in console.text('status')) is not refused


def test_a_question_shows_what_it_would_do_and_what_speaks_against_it_and_no_more_once_it_changes(
    console: Console,
) -> None:
    track = TrackAccess(False, True, 'every kart stands', False)
    race = race_of(3, RaceState.RED_RED, alerts=(alert(2),), track=track)
    race = replace(race, commands=every(karts=(1, 2)))
    first, *rest = race.karts
    stated = replace(first, commands=every(statement='it was made safe'))
    away = replace(first, connected=False)
    refused = offers(Availability(CommandKind.IN_GARAGE, False, 'not now', karts=(1, 2)))
    warning = console.find('question_warning')
    for keys, other, said in (
        ('F6', replace(race, commands=every(karts=(1, 2, 3))), '3 karts: 1, 2, 3'),
        ('F6', replace(race, commands=refused), 'Not now.'),
        ('F6', replace(race, karts=(away, *rest)), 'Sends IN GARAGE to kart 1 when it connects.'),
        ('F6', replace(race, alerts=(alert(3),)), f'Kart 3 ({NAME})'),
        ('1 Ctrl+G', replace(race, karts=(stated, *rest)), 'I state: it was made safe.'),
    ):
        console.tell(race)
        console.press(*keys.split())
        assert keys != 'F6' or 'to 2 karts: 1, 2' in console.text('question_consequence')
        assert f'Kart 2 ({NAME})' in warning.text()
        assert warning.property('tone') == 'bad'
        answers, high = (console.place('yes'), console.place('no')), warning.parent().height()
        console.tell(other)

        assert said in warning.text()
        assert not warning.cut
        assert warning.parent().height() < high  # what it no longer says covers no kart
        assert answers == (console.place('yes'), console.place('no'))
        assert not console.find('yes').isEnabled()
        for part in ('consequence', 'statement'):
            assert not console.find(f'question_{part}').isVisible()
        assert texts.ANSWER_NO in console.told(console.press, 'Y')
        assert not console.sent
        console.press('N')


def test_the_same_key_at_once_is_one_press_and_a_slow_double_click_does_not_ask_to_undo(
    console: Console,
) -> None:
    race = race_of(1)
    console.tell(race)
    for seconds, presses in ((0.0, 1), (0.0, 1), (AGAIN, 2)):
        console.settle(seconds)
        console.strike('A')
        assert len(console.sent) == presses
        console.inbox.on_answer(console.sent[-1], Answer(True, 'it is so'))
    console.sent.clear()
    console.press('kart_finish_1')
    console.tell(replace(race, karts=(replace(race.karts[0], place=1),)))
    console.settle(AIM)

    console.press('kart_undo_finish_1')

    assert console.commands == [(CommandKind.KART_FINISH, 1)]
    assert not console.find('question').isVisible()
    assert 'WAS NOT SENT' in console.text('status')
    console.settle(UNDO_AFTER)
    console.press('kart_undo_finish_1')
    assert console.find('question').isVisible()


def test_a_command_that_is_not_possible_says_why_when_pointed_at_focused_and_pressed(
    console: Console,
) -> None:
    console.tell(race_of(2, RaceState.GRID_ACTIVE, WHY))
    green = console.find('green_green')
    assert green.property('barred') == 'true'

    for act, *on in (
        (QtTest.QTest.mouseMove, console.handle, console.place('green_green')),
        (green.setFocus,),
        (console.press, 'green_green'),
        (console.press, 'F3'),
    ):
        console.window.setFocus()
        assert f'GREEN GREEN: {WHY}' in console.told(act, *on)
    assert not console.sent


# ----- pictures -----------------------------------------------------------------------------


def test_screenshots_of_a_race_and_of_what_may_go_wrong(
    console: Console, monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path
) -> None:
    """`make screenshots` keeps them."""
    folder = pathlib.Path(os.environ.get('EVGP_SCREENSHOTS', tmp_path))
    teams = 'Georgia Tech', 'Purdue', 'Michigan', 'UC Berkeley', 'Kennesaw State'
    karts = tuple(Entrant(number, team, number < 4) for number, team in enumerate(teams, 1))
    paper = PaperRace({}, setup=Setup(karts, RaceTimes(finish_delays=(0.1,)), (), 100.0))
    paper.wall_offset_ns = time.time_ns() - round(paper.now * 1e9)
    monkeypatch.setattr(time, 'time', lambda: paper.wall_offset_ns / 1e9 + paper.now)
    paper.feed(inputs.Attended(paper.now, Attendance(1, 'Anna')))
    paper.connect(1, 2, 3, 4)

    def drive(seconds: float, *answering: int, **links: float) -> None:
        """Let time pass, and have karts answer; the others' links need so long (s)."""
        for number in (1, 2, 3, 4):
            worst = links.get(f'kart_{number}', 0.01)
            grade = max((each for each in GRADES if worst >= GRADES[each]), key=GRADES.get)
            link = NOT_MEASURED._replace(grade=grade, worst_answer=worst, round_trip=0.004)
            paper.feed(inputs.Measured(paper.now, number, link))
        paper.wait(seconds)
        for number in answering:
            paper.say(number)

    def show(*acts: str, picture: str = '', two: bool = False) -> None:
        """Press something, show the race once it has taken that, and keep a picture of it."""
        console.press(*acts)
        for given in console.sent:
            answer = paper.command(given.command, given.kart, 'Anna').answer
            console.inbox.on_answer(given, Answer(answer.success, spoken(answer.message)))
        console.sent.clear()
        for each in paper.stamped:
            said = each.event._replace(text=spoken(each.event.text))
            console.inbox.on_event(each._replace(event=said))
        paper.stamped.clear()
        now = snapshot_of(paper.race, paper.now)
        message = message_of(now, msg.Race, paper.wall_offset_ns)
        race = value_of(message, Snapshot, spoken)
        console.tell(race, Standings(race.stamp, run=race.run, race=race.number))
        if two:
            console.inbox.on_race(race, console.now, two)
            console.settle()
        if picture:
            keep(picture)

    def keep(picture: str) -> None:
        assert console.window.grab().save(str(folder / f'{picture}.png'), 'PNG', 0)

    show('F2', 'Y')
    drive(1.0, 1, 2)
    QtTest.QTest.mouseMove(console.handle, console.place('green_green'))
    show(picture='grid')
    QtTest.QTest.mouseMove(console.handle, console.place('log'))
    drive(5.0, 3)
    show()
    show('F3', 'Y')
    drive(2.0, 1, 2)
    drive(20.0, 3)
    show('B')
    drive(0.5, 2)
    drive(3.5)
    show(picture='race')
    drive(12.0, kart_2=0.24, kart_3=0.62)
    show(picture='link')
    paper.lose(3)
    show()
    show('3', picture='alert')
    show('Esc', picture='two', two=True)
    assert console.text('danger_title') == texts.TWO
    console.settle(1.2)
    kill = Standing(Given(CommandKind.ALL_KILL), console.now - 1.2, presses=3)
    console.inbox.on_pressing((kill,))
    console.settle()
    assert console.text('danger_title') == texts.GONE
    keep('gone')
