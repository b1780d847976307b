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

"""What a click does before any widget has it: it may be too old, or meant for another button."""

from __future__ import annotations

from evgp_protocol import clock
from evgp_rcs_console import words
from evgp_rcs_console.areas import Areas
from evgp_rcs_console.freshness import STALE
from evgp_rcs_console.karts import chooses
from evgp_rcs_console.late_input import LateInput
from evgp_rcs_console.presses import Presses
from evgp_rcs_console.qt import QtCore, QtGui, QtWidgets
from evgp_rcs_console.sight import Sight
from evgp_rcs_console.widgets import CommandButton


class Mouse:
    """Takes the mouse."""

    def __init__(self, areas: Areas, sight: Sight, presses: Presses, late: LateInput) -> None:
        """Wait for a click."""
        self._areas = areas
        self._sight = sight
        self._presses = presses
        self._late = late

    def take(self, event: QtGui.QMouseEvent) -> bool:
        """Return whether a movement or a click is used up: no widget gets it then."""
        age = self._late.age(event)
        kind = event.type()
        if kind == QtCore.QEvent.Type.MouseButtonRelease:
            if age >= STALE:
                self._let_go(age)
            return False
        double = kind == QtCore.QEvent.Type.MouseButtonDblClick
        if not double and kind != QtCore.QEvent.Type.MouseButtonPress:
            return False
        point = event.globalPosition().toPoint()
        target = QtWidgets.QApplication.widgetAt(point)
        shown = self._sight.seen(clock.now() - age)
        if (
            shown is not None
            and not self._areas.on_sheet(target)
            and self._presses.missed(target, shown.at(point))
        ):
            return True
        if self._areas.is_stop(target) or chooses(target):
            return False
        if age >= STALE:
            return self._late.drop(_name(target), age)
        self._late.in_time()
        question = self._areas.question
        if target is question.yes and not question.settled:
            return True
        # The second press of a double click is not meant for what is there by now.
        return double and isinstance(target, QtWidgets.QAbstractButton)

    def _let_go(self, age: float) -> None:
        """Have a button that was pressed in time, and released too late, do nothing."""
        for button in self._areas.window.findChildren(QtWidgets.QAbstractButton):
            if button.isDown() and not self._areas.is_stop(button):
                button.setDown(False)
                self._late.drop(_name(button), age)


def _name(widget: QtWidgets.QWidget | None) -> str:
    """Return what a click on a widget is called when it is talked about."""
    if isinstance(widget, CommandButton) and widget.button is not None:
        return words.command_name(widget.button.command, widget.button.kart)
    if isinstance(widget, QtWidgets.QAbstractButton):
        return widget.text()
    return words.CLICK
