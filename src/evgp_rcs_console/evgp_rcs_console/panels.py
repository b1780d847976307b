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

"""The areas of the window around the karts: the race now, the commands to it, the events."""

from __future__ import annotations

from evgp_rcs.catalogue import CATALOGUE, CommandKind
from evgp_rcs_console import words
from evgp_rcs_console.notices import concerns, EventLog
from evgp_rcs_console.qt import QtCore, QtGui, QtWidgets, Signal
from evgp_rcs_console.snapshot import Event
from evgp_rcs_console.view import Cell, Row, Screen
from evgp_rcs_console.widgets import (
    column,
    CommandButton,
    Fitted,
    Label,
    NumberField,
    Pressed,
    RaceButton,
    set_property,
    set_text,
)

TOP_HEIGHT = 128
"""Height of the uppermost area on a 1366 by 768 screen, in pixels."""

REASON_LINES = (2, 4, 0, 2, 4)
"""Number of lines for the reason below each command to the race; a stop needs none."""


class NowPanel(QtWidgets.QWidget):
    """The state of the race, and whether humans may be on the track."""

    def __init__(self, pressed: Pressed) -> None:
        """Wait to be told."""
        super().__init__()
        self._state = Fitted('state', (46, 40, 34, 30, 26))
        self._since = Fitted('state_since', (17, 15, 14, 13, 12, 11))
        for label in (self._state, self._since):
            label.setAlignment(QtCore.Qt.AlignmentFlag.AlignCenter)
        self._humans = Label('humans', fill='true')
        self._humans_reason = Fitted('humans_reason', (15, 14, 13, 12, 11))
        self._track = Label('track', fill='true')
        self._track_button = CommandButton(pressed)
        left = QtWidgets.QVBoxLayout()
        left.setSpacing(2)
        left.addWidget(self._state, 1)
        left.addWidget(self._since)
        track = QtWidgets.QHBoxLayout()
        track.addWidget(self._track, 1)
        track.addWidget(self._track_button)
        right = QtWidgets.QVBoxLayout()
        right.setSpacing(2)
        right.addWidget(self._humans)
        right.addWidget(self._humans_reason, 1)
        right.addLayout(track)
        layout = QtWidgets.QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addLayout(left, 1)
        layout.addLayout(right, 1)

    def fit(self, by: float) -> None:
        """Take the size of a scale."""
        self.setFixedHeight(round(TOP_HEIGHT * by))
        self._track_button.setFixedSize(round(170 * by), round(36 * by))
        self._since.setFixedHeight(round(44 * by))
        for text in (self._state, self._since, self._humans_reason):
            text.fit(by)

    def show_screen(self, screen: Screen, stale: bool) -> None:
        """Show the race as it is now."""
        self._state.show_cell(screen.state, stale)
        self._since.show_text('\n'.join(filter(None, (screen.since, screen.tally))))
        self._humans.show_cell(screen.humans, stale)
        self._humans_reason.show_text(screen.humans_reason)
        self._track.show_cell(screen.track, stale)
        if screen.track_button is not None:
            self._track_button.show_button(screen.track_button)


class KillBox(QtWidgets.QWidget):
    """ALL KILL, and below it its keys, or for how long it has had no answer."""

    def __init__(self) -> None:
        """Be ready."""
        super().__init__()
        self.button = QtWidgets.QPushButton(CATALOGUE[CommandKind.ALL_KILL].label)
        self.button.setObjectName('all_kill')
        self.button.setSizePolicy(
            QtWidgets.QSizePolicy.Policy.Preferred, QtWidgets.QSizePolicy.Policy.Expanding
        )
        self._hint = Label('kill_hint', fill='true')
        self._hint.setAlignment(QtCore.Qt.AlignmentFlag.AlignCenter)
        frame = QtWidgets.QFrame()
        frame.setObjectName('kill_frame')
        column(frame, self.button).setContentsMargins(3, 3, 3, 3)
        column(self, frame, self._hint).setSpacing(2)

    def fit(self, by: float) -> None:
        """Take the size of a scale."""
        self.setFixedSize(round(340 * by), round(TOP_HEIGHT * by))

    def show_hint(self, hint: Cell, pressing: bool) -> None:
        """Show a text below ALL KILL, and whether ALL KILL has no answer yet."""
        set_property(self.button, 'pressing', 'true' if pressing else 'false')
        self._hint.show_cell(hint)


class SidePanel(QtWidgets.QWidget):
    """The kart that a command by key acts on, and the commands to the race and to all karts."""

    def __init__(self, pressed: Pressed) -> None:
        """Wait to be told what is possible."""
        super().__init__()
        self.number_field = NumberField()
        self._race = [RaceButton(pressed, lines) for lines in REASON_LINES]
        self._all_karts = RaceButton(pressed, 0)
        in_race, all_karts = Label(section='true'), Label(section='true')
        for section, text in ((in_race, words.IN_RACE), (all_karts, words.ALL_KARTS)):
            section.setText(text)
        self._heat_button = CommandButton(pressed)
        self._heat_button.hide()
        heading = QtWidgets.QHBoxLayout()
        heading.addWidget(in_race, 1)
        heading.addWidget(self._heat_button)
        layout = column(self, self.number_field)
        layout.addLayout(heading)
        for part in (*self._race, all_karts, self._all_karts):
            layout.addWidget(part)
        layout.setSpacing(2)
        layout.addStretch(1)

    def fit(self, by: float) -> None:
        """Take the size of a scale."""
        self.setFixedWidth(round(250 * by))
        self.number_field.fit(by)
        for part in (*self._race, self._all_karts):
            part.fit(by)
        self._heat_button.setFixedHeight(round(26 * by))

    def show_screen(self, screen: Screen) -> None:
        """Show which commands are possible, and why the others are not."""
        for widget, button in zip(self._race, screen.race, strict=True):
            widget.show_button(button)
        self._all_karts.show_button(screen.all_karts[0])
        # There are heats or there are none, as long as the roster is the same.
        self._heat_button.setVisible(screen.heat_button is not None)
        if screen.heat_button is not None:
            self._heat_button.show_button(screen.heat_button)


class EventPanel(QtWidgets.QWidget):
    """What happened, of all karts or of one; and in whose name this window sends commands."""

    toggled = Signal()
    """The official wants the events of one kart only, or of all again."""

    name_wanted = Signal()
    """The official wants to say who they are."""

    def __init__(self) -> None:
        """Begin with nothing."""
        super().__init__()
        self._events = EventLog()
        self._kart = 0
        self._teams: dict[int, str] = {}
        self._view = QtWidgets.QPlainTextEdit()
        self._view.setObjectName('log')
        self._view.setReadOnly(True)
        # No text can be selected, and so none dragged: a drag takes every key and click.
        self._view.setTextInteractionFlags(QtCore.Qt.TextInteractionFlag.NoTextInteraction)
        self._view.setFocusPolicy(QtCore.Qt.FocusPolicy.StrongFocus)
        self._view.setTabChangesFocus(True)
        # Lines are wrapped, as they are by default: a bar below them would hide the newest one.
        self._view.setMaximumBlockCount(2000)
        # No list that opens: while one is open, it takes every key and click, also those of stops.
        self._filter = QtWidgets.QPushButton()
        self._filter.setObjectName('filter')
        self._filter.clicked.connect(self.toggled)
        self._name = ''
        self._official = QtWidgets.QPushButton()
        self._official.setObjectName('official')
        self._official.clicked.connect(self.name_wanted)
        title = Label(section='true')
        title.setText(words.LOG)
        left = QtWidgets.QVBoxLayout()
        left.setSpacing(2)
        left.addWidget(title)
        left.addWidget(self._filter)
        left.addWidget(self._official)
        left.addStretch(1)
        layout = QtWidgets.QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addLayout(left)
        layout.addWidget(self._view, 1)
        self._show_one(0)

    def fit(self, by: float, height: int) -> None:
        """Take the size of a scale, in a window of a height (pixels)."""
        for button in (self._filter, self._official):
            button.setFixedWidth(round(190 * by))
        self.show_name(self._name)
        self._view.setFixedHeight(round(max(76 * by, 0.12 * height - 20)))

    def add(self, event: Event) -> None:
        """Take an event."""
        for line in self._events.add(event):
            if concerns(line, self._kart):
                self._view.appendPlainText(str(line))

    def show_name(self, name: str) -> None:
        """Show the official's name; empty: it is not known."""
        self._name = name
        text = words.NAME_IS.format(name=name) if name else words.NAME_UNKNOWN
        set_property(self._official, 'tone', 'plain' if name else 'wait')
        self._official.ensurePolished()
        room = self._official.contentsRect().width() - 16
        shown = self._official.fontMetrics().elidedText(
            text, QtCore.Qt.TextElideMode.ElideRight, room
        )
        # No letter of a name is a shortcut.
        set_text(self._official, shown.replace('&', '&&'))

    def show_karts(self, rows: tuple[Row, ...]) -> None:
        """Take the karts of the roster; if the kart that is shown is gone, all are shown."""
        teams = {row.number: row.team for row in rows}
        if teams != self._teams:
            self._teams = teams
            self._show_one(self._kart)

    def toggle(self, kart: int) -> bool:
        """Show the events of one kart only, or of all again; return False without such a kart."""
        if not self._kart and kart not in self._teams:
            return False
        self._show_one(0 if self._kart else kart)
        return True

    def _show_one(self, kart: int) -> None:
        self._kart = kart if kart in self._teams else 0
        shown = words.EVERY_KART
        if self._kart:
            shown = words.ONE_KART.format(number=self._kart, team=self._teams[self._kart])
        set_text(self._filter, shown)
        self._view.setPlainText('\n'.join(str(line) for line in self._events.lines(self._kart)))
        self._view.moveCursor(QtGui.QTextCursor.MoveOperation.End)
