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
What the official has in front of them, and had a moment ago: which command was where.

A press is meant for what was there when the official aimed (``freshness.Aim``). So each time that
buttons become those of other commands, or move, what was there before is kept for a while.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
from dataclasses import dataclass

from evgp_protocol import clock
from evgp_rcs.catalogue import CommandKind
from evgp_rcs_console.freshness import Aim
from evgp_rcs_console.qt import QtCore, QtGui, QtWidgets
from evgp_rcs_console.sheets import Sheet
from evgp_rcs_console.view import Button, Screen
from evgp_rcs_console.widgets import CommandButton


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


class Sight:
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
