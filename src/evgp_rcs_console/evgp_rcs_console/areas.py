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

"""What stands where in the window, how large it is, and what stood there a moment ago."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
from dataclasses import dataclass

from evgp_protocol import clock
from evgp_rcs.catalogue import CommandKind
from evgp_rcs_console import style, texts
from evgp_rcs_console.alerts import AlertsArea, EACH, HEAD, PLACES
from evgp_rcs_console.freshness import Aim
from evgp_rcs_console.karts import KartList, Scrolling
from evgp_rcs_console.panels import (
    ClockPanel,
    DangerPanel,
    EventPanel,
    Foot,
    KillBox,
    NumberField,
    StatePanel,
    STEPS,
    Steps,
    Strip,
    TOP,
    TrackPanel,
)
from evgp_rcs_console.qt import QtCore, QtGui, QtWidgets, Signal
from evgp_rcs_console.sheets import Heats, Help, Question, Sheet, YourName
from evgp_rcs_console.style import GAP, look
from evgp_rcs_console.view import Button, Screen
from evgp_rcs_console.widgets import Card, CENTER, CommandButton, place, Text

MARGIN = 10
SIDE = 272
"""Width of the column with ALL KILL, alerts and events."""
STATE, CLOCK = 316, 150
"""Widths of the state of the race, and of the clock."""
BANNER, STRIP, NUMBER, FOOT = 24, 28, 48, 32
"""Heights of the line at the top, the strip, the field below ALL KILL, and the bottom line."""


@dataclass(frozen=True)
class Shown:
    """What an official had in front of them: the screen, and where each command's button was."""

    screen: Screen
    buttons: tuple[tuple[CommandButton, QtGui.QRegion, Button], ...]

    def at(self, point: QtCore.QPoint) -> Button | None:
        """Return the command at a point of the screen."""
        return next((each for _, place, each in self.buttons if place.contains(point)), None)

    def of(self, widget: QtWidgets.QWidget) -> Button | None:
        """Return the command that a button had."""
        return next((each for button, _, each in self.buttons if button is widget), None)


class SeenCommands:
    """
    Keeps what the official has in front of them.

    :param window: everything that the official sees is in it.
    :ivar screen: what is shown now; None before anything is.
    """

    def __init__(self, window: QtWidgets.QWidget) -> None:
        """Begin with nothing shown."""
        self._window = window
        self.screen: Screen | None = None
        self._aim: Aim[Shown] = Aim()

    def seen(self, at: float) -> Shown | None:
        """Return what an official who pressed at a time (s) had seen; None: what is there now."""
        return self._aim.seen(at)

    def change_to(self, screen: Screen, now: float, moving: bool = False) -> None:
        """
        Take what is shown from now on; call it before any widget shows it.

        :param moving: buttons are about to move, even if they are those of the same commands.
        """
        before, self.screen = self.screen, screen
        if before is None:
            return
        if moving or (before.rows and _commands(before) != _commands(screen)):
            self._aim.change(self._shown(before), now)

    @contextlib.contextmanager
    def scrolling(self, bar: QtWidgets.QScrollBar) -> Iterator[None]:
        """Take that the window itself scrolls: other buttons come under the official's hand."""
        before = self._shown(self.screen) if self.screen is not None else None
        value = bar.value()
        yield
        if before is not None and bar.value() != value:
            self._aim.change(before, clock.now())

    def _shown(self, screen: Screen) -> Shown:
        sheets = [each for each in self._window.findChildren(Sheet) if each.isVisible()]
        buttons = []
        for button in self._window.findChildren(CommandButton):
            if button.button is not None and button.isVisible():
                corner = button.mapToGlobal(QtCore.QPoint(0, 0))
                seen = button.visibleRegion().translated(corner)
                for sheet in sheets:
                    if not sheet.isAncestorOf(button):
                        above = sheet.rect().translated(sheet.mapToGlobal(QtCore.QPoint(0, 0)))
                        seen = seen.subtracted(QtGui.QRegion(above))
                buttons.append((button, seen, button.button))
        return Shown(screen, tuple(buttons))


def _commands(screen: Screen) -> list[tuple[CommandKind, int]]:
    """Return which command each button of a screen gives, place by place."""
    buttons = [button for row in screen.rows for button in row.buttons]
    buttons += [screen.track_button] if screen.track_button else []
    return [(button.command, button.kart) for button in buttons]


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
        press = self.pressed.emit
        self._banner = Text('top_line', style.TEXT, True, CENTER, colour=lambda: style.BANNER[0])
        self.state = StatePanel()
        self.track = TrackPanel(press)
        self.danger = DangerPanel()
        self.clock = ClockPanel()
        self.kill = KillBox()
        self.steps = Steps(press)
        self.strip = Strip(press)
        self._ground = Card()
        self.karts = KartList(press, scrolling)
        self.number_field = NumberField()
        self.alerts = AlertsArea()
        self.events = EventPanel()
        self.foot = Foot()
        for area in (
            *(self.kill, self._banner, self.state, self.track, self.danger, self.clock),
            *(self.steps, self.strip, self._ground, self.karts, self.number_field),
            *(self.alerts, self.events, self.foot),
        ):
            area.setParent(window)
        self._banner.hide()
        self.question = Question(window)
        self.help = Help(window)
        self.heats = Heats(window, press)
        self.your_name = YourName(window)
        self._sheets: tuple[Sheet, ...] = (self.question, self.help, self.heats, self.your_name)
        self._style: object = None

    def fit(self) -> None:
        """Take the size of the window, and the palette."""
        window = self.window
        look.by = style.scale(window.width(), window.height())
        if self._style != (look.by, look.palette):
            self._style = look.by, look.palette
            window.setStyleSheet(style.sheet())
            self.events.restyle()
        width, height = window.width() / look.by, window.height() / look.by
        top = MARGIN
        if not self._banner.isHidden():
            place(self._banner, 0, 0, width, BANNER)
            top += BANNER - MARGIN + GAP
        right = width - MARGIN - SIDE
        left = right - GAP - MARGIN
        place(self.kill, right, top, SIDE, TOP + GAP + STEPS)
        place(self.state, MARGIN, top, STATE, TOP)
        place(self.track, MARGIN + STATE + GAP, top, left - STATE - CLOCK - 2 * GAP, TOP)
        place(self.danger, MARGIN, top, left - CLOCK - GAP, TOP)
        place(self.clock, right - GAP - CLOCK, top, CLOCK, TOP)
        place(self.steps, MARGIN, top + TOP + GAP, left, STEPS)
        top += TOP + STEPS + 2 * GAP
        foot = height - FOOT - 6
        place(self.foot, MARGIN, foot, width - 2 * MARGIN, FOOT)
        foot -= 6
        place(self.strip, MARGIN, top, left, STRIP)
        begin = top + STRIP + GAP
        place(self._ground, MARGIN, begin, left, foot - begin)
        place(self.karts, MARGIN + 1, begin + 1, left - 2, foot - begin - 2)
        place(self.number_field, right, top, SIDE, NUMBER)
        top += NUMBER + GAP
        alerts = HEAD + PLACES * EACH + 2
        place(self.alerts, right, top, SIDE, alerts)
        top += alerts + GAP
        place(self.events, right, top, SIDE, foot - top)
        self.karts.fit()
        for area in window.findChildren(QtWidgets.QWidget):
            area.update()
        self.place_sheets()

    def show_banner(self, banner: str) -> None:
        """Say something in a line at the top and in the window's title; empty: nothing."""
        if banner != self._banner.whole:
            self._banner.show_text(banner)
            self._banner.setVisible(bool(banner))
            self.window.setWindowTitle(f'{banner}: {texts.TITLE}' if banner else texts.TITLE)
            self.fit()

    def close_sheets(self) -> None:
        """Hide every sheet but the question, which only an answer ends."""
        for sheet in self._sheets:
            if sheet is not self.question:
                sheet.close_sheet()

    def place_sheets(self) -> None:
        """Put the sheets that are open over the karts, clear of their stops."""
        for sheet in self._sheets:
            if not sheet.isHidden():
                first, last = self.strip.geometry(), self.karts.geometry()
                end = last.left() + self.karts.stops_begin - look.px(GAP)
                room = QtCore.QRect(first.topLeft(), QtCore.QPoint(end, last.bottom()))
                sheet.lay_out(room)

    def on_sheet(self, widget: QtWidgets.QWidget | None) -> bool:
        """Return whether a widget is part of a sheet, which lies over what was there before."""
        return any(sheet.has(widget) for sheet in self._sheets)

    def is_stop(self, widget: QtWidgets.QWidget | None) -> bool:
        """Return whether a widget is the button of a stop."""
        if isinstance(widget, CommandButton) and widget.button is not None:
            return widget.button.is_stop
        return widget is self.kill.button
