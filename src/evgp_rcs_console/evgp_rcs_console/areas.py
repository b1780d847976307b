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

"""What stands where in the window, and how large it is."""

from __future__ import annotations

from evgp_rcs_console import style, words
from evgp_rcs_console.alerts import AlertsArea
from evgp_rcs_console.karts import KartList, Scrolling
from evgp_rcs_console.panels import EventPanel, KillBox, NowPanel, SidePanel, TOP_HEIGHT
from evgp_rcs_console.qt import QtCore, QtWidgets, Signal
from evgp_rcs_console.sheets import Heats, Help, Question, Sheet, YourName
from evgp_rcs_console.widgets import CommandButton, DangerPanel, Fitted


class Areas(QtCore.QObject):
    """
    Every area of the window.

    :param window: the areas fill it.
    :param scrolling: is entered around every scrolling that the official's hand does not do.
    """

    pressed = Signal(object, object)
    """A button was pressed: its command when it went down, and when it was let go."""

    def __init__(self, window: QtWidgets.QWidget, scrolling: Scrolling) -> None:
        """Put the areas in their places."""
        super().__init__(window)
        self.window = window
        self._by = 0.0
        press = self.pressed.emit
        self.danger = DangerPanel()
        self.now = NowPanel(press)
        self.kill = KillBox()
        self.alerts = AlertsArea()
        self.karts = KartList(press, scrolling)
        self.side = SidePanel(press)
        self.events = EventPanel()
        self.status = Fitted('status', (15, 13, 12, 11))
        self._layout = QtWidgets.QVBoxLayout(window)
        # The window never grows beyond the screen to make room for a text.
        self._layout.setSizeConstraint(QtWidgets.QLayout.SizeConstraint.SetNoConstraint)
        top = QtWidgets.QHBoxLayout()
        top.addWidget(self.danger, 1)
        top.addWidget(self.now, 1)
        top.addWidget(self.kill)
        left = QtWidgets.QVBoxLayout()
        left.addWidget(self.alerts)
        left.addWidget(self.karts, 1)
        middle = QtWidgets.QHBoxLayout()
        middle.addLayout(left, 1)
        middle.addWidget(self.side)
        self._banner = QtWidgets.QLabel()
        self._banner.setObjectName('top_line')
        self._banner.setTextFormat(QtCore.Qt.TextFormat.PlainText)
        self._banner.setAlignment(QtCore.Qt.AlignmentFlag.AlignCenter)
        self._banner.hide()
        self._layout.addWidget(self._banner)
        self._layout.addLayout(top)
        self._layout.addLayout(middle, 1)
        self._layout.addWidget(self.events)
        self._layout.addWidget(self.status)
        self.question = Question(window)
        self.help = Help(window)
        self.heats = Heats(window, press)
        self.your_name = YourName(window)
        self._sheets: tuple[Sheet, ...] = (self.question, self.help, self.heats, self.your_name)

    def fit(self) -> None:
        """Take the size of the window."""
        width, height = self.window.width(), self.window.height()
        by = style.scale(width, height)
        if abs(by - self._by) >= 0.02:
            self._by = by
            self.window.setStyleSheet(style.sheet(by))
            self._layout.setContentsMargins(*[round(6 * by)] * 4)
            self._layout.setSpacing(round(4 * by))
            self.danger.setFixedHeight(round(TOP_HEIGHT * by))
            self.status.setFixedHeight(round(32 * by))
            self.events.fit(by, height)
            areas = (self.danger, self.now, self.kill, self.alerts, self.karts)
            for area in (*areas, self.side, self.status, self.question):
                area.fit(by)
        self.place_sheets()

    def show_banner(self, banner: str) -> None:
        """Say something in a line at the top and in the window's title; empty: nothing."""
        if banner != self._banner.text():
            self._banner.setText(banner)
            self._banner.setVisible(bool(banner))
            self.window.setWindowTitle(f'{banner}: {words.TITLE}' if banner else words.TITLE)

    def close_sheets(self) -> None:
        """Hide every sheet but the question, which only an answer ends."""
        for sheet in self._sheets:
            if sheet is not self.question:
                sheet.close_sheet()

    def place_sheets(self) -> None:
        """Put the sheets that are open over the karts."""
        for sheet in self._sheets:
            if sheet.isVisible():
                # Clear of ALL KILL above and of the stops at the side.
                karts = self.karts.scroll
                room = karts.width()
                sheet.fit_height(min(room, round(900 * self._by)))
                corner = karts.mapTo(self.window, QtCore.QPoint(0, 0))
                lowest = max(0, self.window.height() - sheet.height() - 8)
                sheet.move(corner.x() + (room - sheet.width()) // 2, min(corner.y() + 8, lowest))
                sheet.raise_()

    def on_sheet(self, widget: QtWidgets.QWidget | None) -> bool:
        """Return whether a widget is part of a sheet, which lies over what was there before."""
        return widget is not None and any(sheet.isAncestorOf(widget) for sheet in self._sheets)

    def is_stop(self, widget: QtWidgets.QWidget | None) -> bool:
        """Return whether a widget is the button of a stop."""
        if isinstance(widget, CommandButton) and widget.button is not None:
            return widget.button.is_stop
        return widget is self.kill.button
