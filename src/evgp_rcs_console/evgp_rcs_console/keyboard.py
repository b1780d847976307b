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

"""What a key does, wherever the focus is: ``keys`` says what it means, this does it."""

from __future__ import annotations

from evgp_protocol import clock
from evgp_rcs.catalogue import CATALOGUE, CommandKind
from evgp_rcs_console import keys, words
from evgp_rcs_console.alarm import Alarm
from evgp_rcs_console.areas import Areas
from evgp_rcs_console.bottom_line import BottomLine
from evgp_rcs_console.chosen import ChosenKart
from evgp_rcs_console.freshness import Repeats, STALE
from evgp_rcs_console.keys import Act, Stroke
from evgp_rcs_console.late_input import LateInput
from evgp_rcs_console.presses import Presses
from evgp_rcs_console.qt import QtCore, QtGui, QtWidgets
from evgp_rcs_console.sight import Sight
from evgp_rcs_console.view import ANSWER_KEYS, Button, Screen, Tone
from evgp_rcs_console.widgets import CommandButton


class Keyboard:
    """Takes the keyboard."""

    def __init__(
        self,
        areas: Areas,
        sight: Sight,
        presses: Presses,
        late: LateInput,
        chosen: ChosenKart,
        alarm: Alarm,
        bottom: BottomLine,
    ) -> None:
        """Wait for a key."""
        self._areas = areas
        self._sight = sight
        self._presses = presses
        self._late = late
        self._chosen = chosen
        self._alarm = alarm
        self._bottom = bottom
        self._repeats = Repeats()

    def take(self, event: QtGui.QKeyEvent) -> bool:
        """Return whether a key is used up: no widget gets it then."""
        age = self._late.age(event)
        repeated = event.isAutoRepeat()
        if keys.is_kill(_alone(event), event.nativeScanCode()):
            if not repeated:
                self._presses.kill()
            return True
        name = _name(event)
        stroke = keys.meaning(name)
        asking = self._areas.question.isVisible()
        if age >= STALE and not self._acts_late(stroke):
            # What means nothing here, as Shift alone, is not worth a word.
            named = stroke is not None or asking
            return self._late.drop(name, age) if named and not repeated else True
        self._late.in_time()
        at = clock.now() - age
        if self._areas.your_name.is_typed_into and not asking and self._spell(event, stroke):
            return True
        means = stroke is not None or name in ANSWER_KEYS
        twice = means and not repeated and self._repeats.same_press(name, at)
        if asking:
            return repeated or self._answer(name, stroke, at)
        if stroke is None:
            return name in ANSWER_KEYS
        if repeated and stroke.act not in (Act.UP, Act.DOWN):
            return True
        if stroke.act is not None:
            self._do(stroke.act, at)
        elif stroke.digit:
            self._chosen.type_digit(stroke.digit, at)
        elif stroke.to_chosen and twice and not self._chosen.kart and not self._chosen.digits:
            pass  # the same press once more: the first one has taken the kart
        elif stroke.stop or not twice:
            self._press(stroke, at)
        return True

    def _spell(self, event: QtGui.QKeyEvent, stroke: Stroke | None) -> bool:
        """Take a key for the name that is being typed; return whether it is one for that."""
        sheet = self._areas.your_name
        act = stroke.act if stroke is not None else None
        letter = keys.letter_of_name(_typed(event))
        if act is Act.ERASE and not self._chosen.digits:
            sheet.erase()
        elif act is not Act.PRESS and not letter:
            return False
        elif event.isAutoRepeat():
            pass  # held down a little too long
        elif letter:
            sheet.type_letter(letter)
        else:
            sheet.save()
        return True

    def _acts_late(self, stroke: Stroke | None) -> bool:
        """Return whether a key acts however old it is: a stop, and choosing a kart for one."""
        if stroke is None:
            return False
        if stroke.act is Act.PRESS:
            return self._areas.is_stop(QtWidgets.QApplication.focusWidget())
        chooses_kart = stroke.act in (Act.UP, Act.DOWN, Act.ERASE, Act.CANCEL)
        return stroke.stop or bool(stroke.digit) or chooses_kart

    def _answer(self, name: str, stroke: Stroke | None, at: float) -> bool:
        """Take a key while a question is open; return that it is used up."""
        question = self._areas.question
        yes_by_enter = stroke is not None and stroke.act is Act.PRESS and question.yes.hasFocus()
        if name in ('N', 'Esc'):
            self._presses.answer(False)
        elif name == 'Y' or yes_by_enter:
            if at < question.shown_at:
                self._bottom.say(words.TOO_EARLY.format(name=name), Tone.BAD)
            elif question.yes.isEnabled():
                self._presses.answer(True)
        elif name in ('Tab', 'Up', 'Down', 'Left', 'Right', 'Shift+Backtab'):
            other = question.yes if question.no.hasFocus() else question.no
            (other if other.isEnabled() else question.no).setFocus()
        elif stroke is not None and stroke.act in (Act.PRESS, Act.ERASE):
            self._do(stroke.act, at)
        elif stroke is not None and stroke.digit:
            self._chosen.type_digit(stroke.digit, at)
        elif stroke is not None and stroke.stop and not stroke.asks:
            self._press(stroke, at)  # a stop never waits for an answer
        elif stroke is not None:
            self._chosen.clear()
            self._bottom.say(words.ANSWER_FIRST, Tone.WAIT)
        return True

    def _press(self, stroke: Stroke, at: float) -> None:
        """Press the button that a key is for."""
        screen = self._sight.screen
        assert screen is not None
        kart = 0
        if stroke.finish is not None:
            kart = _kart_at(screen, stroke.finish)
            if not kart:
                self._chosen.clear()
                return
        elif stroke.to_chosen:
            kart, why = self._chosen.take(CATALOGUE[stroke.commands[0]].label, at)
            if not kart:
                self._bottom.say(why, Tone.BAD)
                if stroke.stop:
                    self._alarm.sound_now()
                return
        button = _meant(screen, stroke, kart)
        shown = self._sight.seen(at)
        if button is not None and shown is not None and not button.is_instant:
            stood = kart if stroke.finish is None else _kart_at(shown.screen, stroke.finish)
            seen = _meant(shown.screen, stroke, stood)
            if seen is None or not seen.is_same_command(button):
                self._presses.refuse_changed(button)
                return
        if button is not None:
            self._presses.press(button)
        elif stroke.commands and stroke.commands[0] is CommandKind.OPEN_TRACK:
            self._bottom.say(words.TRACK_OPEN)
        elif stroke.commands and stroke.commands[0] is CommandKind.CLOSE_TRACK:
            self._bottom.say(words.TRACK_CLOSED)

    def _do(self, act: Act, at: float) -> None:
        if act is Act.HELP:
            self._presses.toggle_help()
        elif act is Act.SEEN:
            self._areas.alerts.press_first()
        elif act is Act.SOUND:
            self._alarm.toggle_sound()
        elif act is Act.UP:
            self._chosen.choose_next(-1)
        elif act is Act.DOWN:
            self._chosen.choose_next(1)
        elif act is Act.LOG:
            self._presses.toggle_events()
        elif act is Act.ERASE:
            self._chosen.erase(at)
        elif act is Act.PRESS:
            self._press_focused(at)
        elif act is Act.CANCEL:
            if self._chosen.digits:
                self._chosen.clear()
                return
            self._areas.close_sheets()
            self._areas.window.setFocus()

    def _press_focused(self, at: float) -> None:
        """Press the button that has the focus, if it is still the one that the official saw."""
        focused = QtWidgets.QApplication.focusWidget()
        if not isinstance(focused, QtWidgets.QAbstractButton):
            return
        shown = self._sight.seen(at)
        if (
            shown is None
            or not isinstance(focused, CommandButton)
            or self._areas.on_sheet(focused)
            or not self._presses.missed(focused, shown.of(focused))
        ):
            focused.click()


def _alone(event: QtGui.QKeyEvent) -> str:
    """Return the name of a key without its modifiers."""
    return QtGui.QKeySequence(event.key()).toString()


def _name(event: QtGui.QKeyEvent) -> str:
    """Return what a key is called here."""
    modifiers = QtCore.Qt.KeyboardModifier
    name = QtGui.QKeySequence(event.keyCombination()).toString()
    if event.modifiers() & modifiers.KeypadModifier:
        name = _alone(event)
    return keys.key_name(name, _typed(event), event.nativeScanCode())


def _typed(event: QtGui.QKeyEvent) -> str:
    """Return what a key types; nothing with Ctrl, Alt or Meta."""
    modifiers = QtCore.Qt.KeyboardModifier
    commanding = modifiers.ControlModifier | modifiers.AltModifier | modifiers.MetaModifier
    return '' if event.modifiers() & commanding else event.text()


def _kart_at(screen: Screen, place: int) -> int:
    """Return the kart at a place of the roster, 0 if there is none."""
    return screen.rows[place].number if place < len(screen.rows) else 0


def _meant(screen: Screen, stroke: Stroke, kart: int) -> Button | None:
    """Return the command that a key gives to a kart (0: to none), as a screen has it."""
    found = (screen.button(command, kart) for command in stroke.commands)
    return next((each for each in found if each is not None), None)
