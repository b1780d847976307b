# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The areas of the window around the list of karts. Each area shows one part of a screen."""

from __future__ import annotations

import time

from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import StampedEvent
from evgp_rcs.words import Cell, tally, Tone
from evgp_rcs_console import texts
from evgp_rcs_console.catalogue import CATALOGUE
from evgp_rcs_console.notices import EventLog, OfficialNames
from evgp_rcs_console.qt import QtCore, QtGui, QtWidgets
from evgp_rcs_console.style import look, SMALL
from evgp_rcs_console.view import RACE_COMMANDS, Screen
from evgp_rcs_console.widgets import (
    BOTTOM,
    CENTER,
    CommandButton,
    fixed,
    font,
    lay,
    mark,
    Panel,
    Policy,
    Push,
    RIGHT,
    Text,
    TOP,
)

EVENTS = 100
"""Maximum number of events shown in the window."""


class StatePanel(Panel):
    """Shows the race's state in the colour of that state, when it began, and who caused it."""

    def __init__(self) -> None:
        super().__init__('state_panel', '')
        self._title = fixed(Text('state', 'huge bold'), height=42)
        self._since = Text('state_since', wrap=True)
        lay(self, [self._title], [self._since], margins=(10, 2, 2, 4), heights=(0, 1))

    def show_screen(self, screen: Screen) -> None:
        self.setVisible(screen.danger is None)
        self._title.show_cell(screen.state, screen.stale)
        self._since.show_text(screen.since)
        mark(self, ground=(Tone.FAINT if screen.stale else screen.state.tone).value)


class TrackPanel(Panel):
    """Shows whether humans may be on the track, and the button that opens or closes the track."""

    def __init__(self) -> None:
        super().__init__('track_panel')
        self._edge = fixed(Panel('', ''), 8)
        self._humans = fixed(Text('humans', 'large bold', BOTTOM), height=30)
        self._reason = Text('humans_reason', '', TOP, wrap=True)
        self.button = fixed(CommandButton(tall=True), 138)
        rows = [(self._edge, each, self.button) for each in (self._humans, self._reason)]
        lay(self, *rows, gap=6, margins=(0, 5, 8, 5), columns=(0, 1, 0), heights=(0, 1))

    def show_screen(self, screen: Screen) -> None:
        self.setVisible(screen.danger is None)
        self._humans.show_cell(screen.humans, screen.stale)
        self._reason.show_text(screen.humans_reason[:1].upper() + screen.humans_reason[1:])
        self.button.show_button(screen.track_button)
        tone = Tone.FAINT if screen.stale else screen.humans.tone
        mark(self._edge, ground=(Tone.GREEN if tone is Tone.GOOD else tone).value)


class ClockPanel(Panel):
    """Shows the time of day, the time since GREEN GREEN, and the heat in the race."""

    def __init__(self) -> None:
        super().__init__('clock', '')
        self._now = Text('', 'large bold', RIGHT)
        self._race, self._heat = Text('', 'bold', RIGHT), Text('', 'faint', RIGHT)
        rows = [self._now], [self._race], [self._heat]
        lay(self, *rows, margins=(0, 4, 4, 3), heights=(34, 20, 18))

    def show_screen(self, screen: Screen) -> None:
        self._race.show_text(f'GREEN for {screen.clock}' if screen.clock else '')
        self._heat.show_text(texts.heat_in_race(screen.snapshot))

    def look(self) -> None:
        self._now.show_text(time.strftime('%H:%M:%S'))


class KillBox(Panel):
    """Shows the ALL KILL button, with its keys or the time that ALL KILL has had no answer."""

    def __init__(self) -> None:
        super().__init__('kill_box', '')
        self.button = Push('all_kill', CATALOGUE[CommandKind.ALL_KILL].label)
        self._hint = fixed(Text('kill_hint', 'bold', CENTER, True), height=40)
        # The hint lies over the button, which still gets every click.
        self._hint.setAttribute(QtCore.Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        grid = lay(self, [self.button], [self.button], margins=(3, 3, 3, 3), heights=(1, 0))
        grid.addWidget(self._hint, 1, 0)

    def show_hint(self, hint: Cell, pressing: bool) -> None:
        mark(self.button, pressing='true' if pressing else 'false')
        self._hint.show_cell(hint)


class Steps(QtWidgets.QWidget):
    """Shows the commands to the race from left to right, in the order that a race needs them."""

    def __init__(self) -> None:
        super().__init__()
        self._steps = [CommandButton(tall=True) for _ in range(len(RACE_COMMANDS) + 1)]
        lay(self, self._steps, gap=8, columns=[1] * len(self._steps))

    def show_screen(self, screen: Screen) -> None:
        for step, button in zip(self._steps, (*screen.race, screen.msr_button), strict=True):
            step.show_button(button)


class Strip(Panel):
    """Shows the race in one line: what the karts do, which are missing, and who commands."""

    def __init__(self, names: OfficialNames) -> None:
        super().__init__('strip')
        self._names = names
        self._tally, self._rest = Text('tally', 'bold', flows=True), Text('rest')
        self._reminder = Text('reminder', 'bold', fills=True, flows=True)
        self._msr = Text('msr', 'bold', fills=True, flows=True)
        for part in (self._msr, self._reminder):  # as wide as its text, which is never cut off
            part.setMinimumWidth(0)
            part.setSizePolicy(Policy.Fixed, Policy.Ignored)
        self._officials = Text('officials', 'faint', RIGHT, flows=True)
        self.heat = fixed(CommandButton(kind='quiet'), 128)
        parts = self._tally, self._msr, self._reminder, self._rest, self._officials, self.heat
        lay(self, parts, gap=10, margins=(10, 1, 6, 1), columns=(0, 0, 0, 1, 0, 0))

    def show_screen(self, screen: Screen) -> None:
        race, officials = screen.snapshot, ', '.join(self._names.names)
        by = texts.can_stop(race).partition(':')[0], officials and f'commands by {officials}'
        self._officials.show_text(' · '.join(filter(None, by)))
        rest = texts.missing(race), screen.timing, screen.order, screen.places
        self._rest.show_cell(Cell(' · '.join(filter(None, rest))), screen.stale)
        self._tally.show_cell(Cell(tally(race) or 'no kart is in the race'), screen.stale)
        for part, cell in (
            (self._msr, screen.msr),
            (self._reminder, Cell(screen.reminder, Tone.WAIT)),
        ):
            part.show_cell(cell)
            part.setVisible(bool(cell.text))
        self.heat.show_button(screen.heat_button)


class DangerPanel(Panel):
    """Shows, in the largest type, a warning that race control is gone or unreliable."""

    def __init__(self) -> None:
        super().__init__('danger', '')
        self._title = fixed(Text('danger_title', 'large bold'), height=28)
        self._detail = Text('danger_detail', 'small', wrap=True)
        self._advice = Text('danger_advice', 'huge bold', CENTER, True)
        rows = (self._title, self._advice), (self._detail, self._advice)
        lay(self, *rows, gap=2, margins=(10, 3, 10, 3), columns=(3, 2), heights=(0, 1))

    def show_screen(self, screen: Screen) -> None:
        danger = screen.danger
        self.setVisible(danger is not None)
        if danger is None:
            return
        self._title.show_text(danger.title)
        self._advice.show_text(danger.advice)
        needs_two_lines = len(danger.advice) > 14
        mark(self._advice, kind='large bold' if needs_two_lines else 'huge bold')
        self._detail.show_text(danger.detail)


class NumberField(Panel):
    """Shows the kart that a command by key acts on, or a note that the keys do not work."""

    def __init__(self) -> None:
        super().__init__('number_field')
        self._title = Text('number', 'large bold', flows=True)
        self._detail = Text('number_detail', wrap=True)
        lay(self, (self._title, self._detail), gap=8, margins=(10, 3, 8, 3), columns=(0, 1))

    def show_cells(self, title: Cell, detail: Cell, keys_work: bool) -> None:
        ground = title.tone.value if title.tone is Tone.BAD else 'chosen' if title.text else ''
        if not keys_work:
            detail = Cell('ALL KILL works only with the mouse. Click this window.')
            title, ground = Cell(texts.KEYS_OFF_LARGE), 'off'
        mark(self, ground=ground)
        # On a coloured background, the style sheet sets the colour of the text.
        self._title.show_text(title.text)
        self._title.setVisible(bool(title.text))
        self._detail.show_cell(detail._replace(tone=Tone.PLAIN) if ground else detail)


class EventPanel(Panel):
    """Shows the events of all karts or of one kart, newest first, with commands in bold."""

    def __init__(self, names: OfficialNames) -> None:
        super().__init__('events')
        self.log = EventLog(names)
        self._kart = 0
        self._teams: dict[int, str] = {}
        self._list = QtWidgets.QListWidget()
        self._list.setObjectName('log')
        self._list.setWordWrap(True)
        # If items could be selected, they could be dragged, and a drag takes every key and click.
        self._list.setSelectionMode(QtWidgets.QAbstractItemView.SelectionMode.NoSelection)
        self._list.setHorizontalScrollBarPolicy(QtCore.Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self._list.setVerticalScrollMode(QtWidgets.QAbstractItemView.ScrollMode.ScrollPerPixel)
        # A button, because an open drop-down list takes every key and click, even those of stops.
        self.filter = fixed(Push('filter', kind='quiet small'), 150, 24)
        rows = (Text('', 'small bold faint', text='Events'), self.filter), (self._list,) * 2
        lay(self, *rows, margins=(10, 3, 3, 6), columns=(1, 0))
        # The timer updates the list once for all events that have arrived together.
        self._later = QtCore.QTimer(self, singleShot=True)
        self._later.timeout.connect(self.restyle)
        self.restyle()

    def add(self, event: StampedEvent) -> None:
        self.log.add(event)
        self._later.start()

    def show_screen(self, screen: Screen) -> None:
        if screen.teams != self._teams:
            self._teams = screen.teams
            self.restyle()

    def toggle(self, kart: int) -> bool:
        """Switch between one kart's events and all events; return False if no kart is chosen."""
        if not self._kart and kart not in self._teams:
            return False
        self._kart = 0 if self._kart else kart
        self.restyle()
        return True

    def restyle(self) -> None:
        """Show the events again after a change of the events, roster, size or palette."""
        if self._kart not in self._teams:
            self._kart = 0
        team = self._teams.get(self._kart)
        self.filter.show_words(f'kart {self._kart} {team}' if self._kart else 'all karts')
        lines = self.log.lines(self._kart)[-EVENTS:][::-1]
        while self._list.count() > len(lines):
            self._list.takeItem(len(lines))
        for place, line in enumerate(lines):
            if place == self._list.count():
                self._list.addItem('')
            item = self._list.item(place)
            item.setText(f'{line.clock} {texts.without_teams(line.text, self._teams)}')
            item.setFont(font(look.px(SMALL - 1), line.is_command))
            ink = look.palette.ink if line.success else look.palette.bad
            item.setForeground(QtGui.QColor(ink))


class Foot(QtWidgets.QWidget):
    """Shows the bottom line, a warning of a low battery, and the name of the official here."""

    def __init__(self) -> None:
        super().__init__()
        self.status = Text('status', 'bold', wrap=True, fills=True)
        self._battery = fixed(Text('battery', 'bold', CENTER, fills=True), 250)
        self._battery.hide()
        self.official = fixed(Push('official', kind='quiet'), 272)
        lay(self, (self.status, self._battery, self.official), gap=8, columns=(1, 0, 0))

    def show_battery(self, percent: int | None) -> None:
        """Show the charge of a low battery, in percent; None means that the charge is not low."""
        if percent is not None:
            self._battery.show_cell(Cell(f'BATTERY {percent} %: plug it in', Tone.BAD))
        self._battery.setVisible(percent is not None)

    def show_name(self, name: str) -> None:
        self.official.show_words(texts.NAME_IS.format(name=name) if name else 'Your name?')
