# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The areas of the window around the list of karts. Each area shows one part of a screen."""

from __future__ import annotations

from evgp_node.qt import QtCore, QtGui, QtWidgets
from evgp_rcs.rules.race import StampedEvent
from evgp_rcs_console import texts
from evgp_rcs_console.notices import EventLog, OfficialNames
from evgp_rcs_console.style import look, SMALL
from evgp_rcs_console.view import Screen
from evgp_rcs_console.widgets import (
    BOTTOM,
    CENTER,
    CommandButton,
    fixed,
    font,
    lay,
    Panel,
    Push,
    RIGHT,
    Text,
    TOP,
)

EVENTS = 100
"""Maximum number of events shown in the window."""


def state_panel() -> Panel:
    """Return the area of the race's state, in the colour of that state."""
    # A text that changes every second has a fixed size, or Qt would lay out the window each time.
    since = fixed(Text('state_since', wrap=True), 304, 30)
    rows = [fixed(Text('state', 'huge bold'), height=42)], [since]
    return lay(Panel('state_panel', ''), *rows, margins=(10, 2, 2, 4), heights=(0, 1))


def track_panel(button: CommandButton) -> Panel:
    """Return the area that says whether humans may be on the track, with its button."""
    edge, why = fixed(Panel('track_edge', ''), 8), Text('humans_reason', '', TOP, wrap=True)
    humans = fixed(Text('humans', 'large bold', BOTTOM), height=30)
    rows = (edge, humans, fixed(button, 138)), (edge, why, button)
    panel, margins = Panel('track_panel'), (0, 3, 8, 2)
    return lay(panel, *rows, gap=6, margins=margins, columns=(0, 1, 0), heights=(0, 1))


def danger_panel() -> Panel:
    """Return the area of a warning that race control is gone or unreliable."""
    title, detail = Text('danger_title', 'large bold'), Text('danger_detail', 'small', wrap=True)
    advice = Text('danger_advice', 'huge bold', CENTER, True, smaller='large bold')
    rows = (fixed(title, height=28), advice), (detail, advice)
    panel, margins = Panel('danger', ''), (10, 3, 10, 3)
    return lay(panel, *rows, gap=2, margins=margins, columns=(3, 2), heights=(0, 1))


def clock_panel() -> Panel:
    """Return the area of the time of day and the heat."""
    now, heat = Text('time_of_day', 'large bold', RIGHT), Text('heat', 'faint', RIGHT)
    rows = [fixed(now, 134, 34)], [heat]
    return lay(Panel('clock', ''), *rows, margins=(0, 10, 4, 12), heights=(32, 20))


def strip(heat: CommandButton) -> Panel:
    """Return the race in one line: what the karts do, which are missing, and who commands."""
    parts = (
        Text('tally', 'bold', flows=True),
        Text('msr', 'bold', fills=True, flows=True),
        Text('reminder', 'bold', fills=True, flows=True),
        Text('rest'),
        Text('able', fills=True, flows=True),
        fixed(heat, 128),
    )
    panel, columns = Panel('strip'), (0, 0, 0, 1, 0, 0)
    return lay(panel, parts, gap=10, margins=(10, 1, 6, 1), columns=columns)


def number_field() -> Panel:
    """Return the area of the kart that a command by key acts on."""
    parts = Text('number', 'large bold', flows=True), Text('number_detail', wrap=True)
    return lay(Panel('number_field'), parts, gap=8, margins=(10, 3, 8, 3), columns=(0, 1))


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
