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

"""What a press does, by key or by hand: it sends a command, asks first, or says why not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from evgp_rcs.catalogue import CommandKind
from evgp_rcs_console import words
from evgp_rcs_console.areas import Areas
from evgp_rcs_console.bottom_line import BottomLine
from evgp_rcs_console.chosen import ChosenKart
from evgp_rcs_console.commands import Order
from evgp_rcs_console.display import Display
from evgp_rcs_console.qt import QtWidgets
from evgp_rcs_console.signature import Signature
from evgp_rcs_console.unanswered import Unanswered
from evgp_rcs_console.view import Button, Tone
from evgp_rcs_console.widgets import CommandButton

Give = Callable[[Order], None]
"""Sends a command, and returns at once."""


class Presses:
    """
    Does what the official pressed.

    :param give: sends a command.
    :param signature: in whose name.
    """

    def __init__(
        self,
        give: Give,
        signature: Signature,
        areas: Areas,
        chosen: ChosenKart,
        bottom: BottomLine,
        unanswered: Unanswered,
        display: Display,
    ) -> None:
        """Wait for a press."""
        self._give = give
        self._signature = signature
        self._areas = areas
        self._chosen = chosen
        self._bottom = bottom
        self._unanswered = unanswered
        self._display = display

    def kill(self) -> None:
        """Send ALL KILL."""
        self._give(Order(CommandKind.ALL_KILL, official=self._signature.claim))
        self._chosen.clear()

    def let_go(self, down: Button, button: Button) -> None:
        """Take a press of a button, if its command is still the one that it was pressed for."""
        if down.is_same_command(button):
            self.press(button)
        else:
            self.refuse_changed(down)

    def press(self, button: Button) -> None:
        """Send the command of a button, ask for its confirmation, or say why it cannot be sent."""
        areas = self._areas
        if not button.enabled:
            self._bottom.say(button.explanation, Tone.WAIT)
        elif button.command is CommandKind.SET_HEAT and not button.heat:
            areas.close_sheets()
            areas.heats.open_sheet()
            areas.place_sheets()
        elif button.condition:
            areas.close_sheets()
            areas.question.ask(button)
            areas.place_sheets()
        else:
            self._send(button)
        self._chosen.clear()

    def answer(self, yes: bool) -> None:
        """Take the answer to the question that is open."""
        asked = self._areas.question.button
        # Hidden first: a second press of the same key must find nothing to answer.
        self._areas.question.close_sheet()
        self._areas.window.setFocus()
        self._chosen.clear()
        if yes and asked is not None:
            self._send(asked)

    def missed(self, target: QtWidgets.QWidget | None, aimed: Button | None) -> bool:
        """
        Return whether a press is not for the command that is there now, and deal with it.

        A stop goes to the kart whose button was there. Anything else is not sent, and the bottom
        line says so.

        :param target: what is there now.
        :param aimed: the command that was there when the official aimed.
        """
        there = target.button if isinstance(target, CommandButton) else None
        if aimed is None and (there is None or there.is_stop):
            return False  # no kart's button was there that it could have been meant for
        if aimed is not None and there is not None and aimed.is_same_command(there):
            return False
        if aimed is not None and aimed.is_instant:
            self.press(aimed)
        elif there is not None and not there.is_instant:
            self.refuse_changed(there)
        else:
            return False
        return True

    def refuse_changed(self, button: Button) -> None:
        """Say that a command was not sent, since its button was another one's a moment ago."""
        name = words.command_name(button.command, button.kart)
        self._bottom.say(words.ROWS_CHANGED.format(name=name), Tone.BAD)
        self._chosen.clear()

    def toggle_help(self) -> None:
        """Show the keys, or hide them."""
        self._areas.help.setVisible(not self._areas.help.isVisible())
        self._areas.place_sheets()

    def open_name(self) -> None:
        """Ask for the official's name."""
        self._areas.close_sheets()
        self._areas.your_name.open_sheet(self._signature.name)
        self._areas.place_sheets()

    def sign(self, name: str) -> None:
        """Send commands in a name from now on."""
        self._signature.sign(name)
        self._areas.your_name.close_sheet()
        self._areas.window.setFocus()
        self._areas.events.show_name(self._signature.name)
        self._bottom.say(words.SIGNED.format(claim=self._signature.claim))

    def toggle_events(self) -> None:
        """Show the events of the chosen kart only, or of all karts."""
        if not self._areas.events.toggle(self._chosen.kart):
            self._bottom.say(words.WHOSE_EVENTS, Tone.WAIT)

    def _send(self, button: Button) -> None:
        order = replace(button.order(), official=self._signature.claim)
        self._give(order)
        if not button.is_stop:  # the client says which stops are not accepted yet
            self._unanswered.add(order)
        self._bottom.say_sent(order)
        self._display.refresh()
