# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Decides which of the official's keys and clicks act, and carries them out.

The window passes every key and click to this module before any widget gets them. A key or click
may be too old, or may have been meant for a button that has moved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import math
import time
from typing import TYPE_CHECKING

from evgp_node.qt import QtCore, QtGui, QtWidgets
from evgp_protocol import clock
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.words import time_of_day, Tone
from evgp_rcs_console import keys, texts
from evgp_rcs_console.catalogue import CATALOGUE
from evgp_rcs_console.commands import Given
from evgp_rcs_console.freshness import AGAIN, Beat, InputClock, STALE
from evgp_rcs_console.karts import chooses
from evgp_rcs_console.keys import Stroke
from evgp_rcs_console.settings import Signature
from evgp_rcs_console.view import ANSWER_KEYS, Button, FINISH_KEYS, Screen
from evgp_rcs_console.widgets import CommandButton, Push

if TYPE_CHECKING:
    from evgp_rcs_console.window import ConsoleWindow

UNDO_AFTER = 2.0
"""
Time after a command to a kart before a click can undo it, in seconds.

A click before that may be the second one of a slow double click.
"""

Give = Callable[[Given], None]
"""Sends a command and returns at once."""


class CommandInput(QtCore.QObject):
    """Carries out what the official has pressed."""

    def __init__(
        self, give: Give, signature: Signature, window: ConsoleWindow, late: LateInput
    ) -> None:
        super().__init__(window)
        self.window, self.late = window, late
        self._bottom, self._chosen = window.bottom, window.chosen
        self._give, self._signature = give, signature
        self._all_kill_was_dropped = False
        self._last_sent: Given | None = None

    def kill(self, repeated: bool = False) -> None:
        """Send ALL KILL; if a key that is held down repeats it, only if it was dropped."""
        if repeated and not self._all_kill_was_dropped:
            return
        self._all_kill_was_dropped = False
        claim = self._signature.claim
        self._give(Given(CommandKind.ALL_KILL, official=claim, waited=self.late.waited))
        self._chosen.clear()

    def take_dropped(self, given: Given, why: str) -> None:
        """
        Handle a stop that the client no longer sends, because a later race has begun.

        If that stop is ALL KILL and its button is still held down, send ALL KILL again.
        """
        self.window.alerts.take_own(why)
        self.window.refresh()
        if given.command is CommandKind.ALL_KILL:
            self._all_kill_was_dropped = True
            if self.window.kill.isDown():
                self.kill()

    def let_go(self, down: Button, button: Button) -> None:
        """
        Handle the release of a button that does not act when it goes down.

        :param down: the button's command when it went down.
        :param button: its command now. A different command is not sent.
        """
        sent, undoes = self._last_sent, (CATALOGUE[down.command].undoes, down.kart)
        if not down.is_same_command(button):
            self.refuse_changed(down)
        elif down.kart and sent and sent.key == undoes and clock.now() - sent.at < UNDO_AFTER:
            why = f'{texts.full_name(sent)} was sent just before it. Click again.'
            self._bottom.say_unsent(down.name, why)
        else:
            self.press(button)

    def press(self, button: Button) -> None:
        """Send a button's command, ask for confirmation first, or show why it is not possible."""
        window = self.window
        if not button.enabled:
            self._bottom.say_barred(button)
        elif button.command is CommandKind.SET_HEAT and not button.gives.heat:
            window.open_sheet(window.heats, window.heats.first)
        elif button.asks:
            window.question.ask(button)
            window.open_sheet(window.question, window.question.no)
        else:
            self._send(button)
        self._chosen.clear()

    def answer(self, yes: bool, also: bool = False) -> None:
        """Close the question; if YES, send its command, and the further ones if ``also``."""
        asked = self.window.question.button
        # Hidden first, so that a second press of the same key finds no question.
        self.window.question.close_sheet()
        self.window.setFocus()
        self._chosen.clear()
        if yes and asked is not None:
            self._send(asked, also)
        elif asked is not None and asked.kart and not self._chosen.kart:
            self._chosen.choose_in_sight(asked.kart)  # so that its next command needs no number

    def missed(self, target: QtWidgets.QWidget | None, aimed: Button | None) -> bool:
        """
        Handle a press that landed on a different command from the one the official aimed at.

        A stop goes to the kart that the official aimed at. Any other command is not sent, and the
        bottom line says so.

        :param target: the widget that is there now.
        :param aimed: the button that was there when the official aimed; None if there was none.
        :return: whether the press was handled here.
        """
        there = target.button if isinstance(target, CommandButton) else None
        if aimed is None and (there is None or there.is_stop):
            return False  # the press can only be meant for what is there now
        if aimed is not None and there is not None and aimed.is_same_command(there):
            return False
        if aimed is not None and aimed.is_instant:
            self.press(aimed)
            return True
        missed = there or aimed
        if missed is None or missed.is_instant:
            return False
        self.refuse_changed(missed)
        return True

    def refuse_changed(self, button: Button) -> None:
        """Show that a command was not sent, because the buttons had just changed."""
        why = 'the list of karts just changed. Check it, then press again.'
        self._bottom.say_unsent(button.name, why)
        self._chosen.clear()

    def toggle_help(self) -> None:
        self.window.help.setVisible(not self.window.help.isVisible())
        self.window.place_sheets()

    def sign(self, name: str) -> None:
        self._signature.sign(name)
        self.window.officials.close_sheet()
        self.window.setFocus()
        self.window.show_name(self._signature.name)
        self._bottom.say(f'Your commands are now sent as: {self._signature.claim}')

    def toggle_events(self) -> None:
        """Switch between the events of the chosen kart and the events of all karts."""
        if not self.window.events.toggle(self._chosen.kart):
            how = "To see only one kart's events, first type its number or click its row."
            self._bottom.say(how, Tone.WAIT)

    def _send(self, button: Button, also: bool = False) -> None:
        given = replace(
            button.gives,
            official=self._signature.claim,
            then=button.also if also else (),
            at=clock.now(),
            waited=self.late.waited,
        )
        self._give(given)
        self._last_sent = given
        if not CATALOGUE[given.command].stop:  # the client keeps track of stops itself
            self.window.unanswered.add(given)
        self._bottom.say(f'{texts.full_name(given)} sent')
        self.window.refresh()


class LateInput:
    """
    Measures how long keys and clicks have waited, and reports those that were dropped as too old.

    :param period: normal time between two calls of ``beat``, in seconds.
    :ivar waited: how long the last key or click had waited, in seconds.
    """

    def __init__(self, period: float, window: ConsoleWindow) -> None:
        self._chosen, self._bottom = window.chosen, window.bottom
        self._clock, self._beat = InputClock(), Beat(period, clock.now())
        self._dropped: list[str] = []
        self.waited = 0.0

    def beat(self, now: float) -> None:
        self._beat.beat(now)
        # If the window has hung, digits of the number may still be in the queue. They must be
        # handled before the number expires.
        if not self._beat.held_up(now):
            self._chosen.expire(now)

    def age(self, event: QtGui.QInputEvent) -> float:
        """Return how long a key or click has waited (the longer of two estimates), in seconds."""
        waited = self._clock.age(event.timestamp(), time.monotonic())
        self.waited = max(waited, self._beat.held_up(clock.now()))
        return self.waited

    def drop(self, name: str, age: float) -> bool:
        """Show that a key or click of this age (s) was dropped; True: no widget may get it."""
        # The dropped input would have used up the number, so digits after it begin a new number.
        self._chosen.clear()
        self._dropped = [*self._dropped[-4:], name]
        names = ', '.join(self._dropped)
        pressed = time_of_day(time.time() - age)
        why = f'pressed at {pressed} while the window was not responding. Press again.'
        self._bottom.say_unsent(names, why)
        return True

    def in_time(self) -> None:
        """Record that an input was in time, and forget which inputs were dropped before it."""
        self._dropped.clear()


MOVE_KEYS = ('Tab', 'Shift+Backtab', 'Up', 'Down', 'Left', 'Right')
"""The keys that move to another button."""

FORWARD = 0.3
"""Time after the window comes to the front before clicks act, in seconds. Stops act at once."""


class Mouse:
    """Passes the official's clicks to the widgets, except those that are probably unintended."""

    def __init__(self, presses: CommandInput) -> None:
        self._presses, self._late = presses, presses.late
        self._window, self._bottom = presses.window, presses.window.bottom
        self._active_since: float | None = None  # long ago, once a click has brought it forward
        self._held: QtWidgets.QAbstractButton | None = None
        self._held_name = ''  # when it went down; it may be another kart's now
        self._under: QtWidgets.QWidget | None = None

    def take_activation(self, active: bool) -> None:
        if not active:
            self._active_since = None
        elif self._active_since is None:
            self._active_since = clock.now()

    def _only_brings_forward(self) -> bool:
        """Return whether a click only brings the window to the front."""
        since, self._active_since = self._active_since, -math.inf
        if since is None:
            self._window.activateWindow()
        return since is None or clock.now() - since < FORWARD

    def take(self, event: QtGui.QMouseEvent) -> bool:
        """Handle a mouse event; return True if no widget may get this event."""
        age = self._late.age(event)
        kind = event.type()
        point = event.globalPosition().toPoint()
        target = self._window.childAt(self._window.mapFromGlobal(point))
        if kind == QtCore.QEvent.Type.MouseMove:
            self._point_at(target)
            return False
        if event.button() != QtCore.Qt.MouseButton.LeftButton:
            return True  # a right click could open a menu, which would take clicks from stops
        held, self._held = self._held, None
        if kind == QtCore.QEvent.Type.MouseButtonRelease:
            buttons = self._window.findChildren(QtWidgets.QAbstractButton) if age >= STALE else ()
            if held is not None and held in buttons:
                held.setDown(False)
                self._late.drop(self._held_name, age)
            elif isinstance(held, CommandButton) and held is not target:
                why = 'the pointer had left the button. Click again.'
                self._bottom.say_unsent(self._held_name, why)
            return False
        shown = self._window.seen.seen(clock.now() - age)
        if shown is not None and self._presses.missed(target, shown.at(point)):
            return True
        if self._window.is_stop(target) or chooses(target):
            return False
        button = target if isinstance(target, QtWidgets.QAbstractButton) else None
        if age >= STALE:
            return button is None or self._late.drop(_called(button), age)
        self._late.in_time()
        if self._only_brings_forward() and button is not None:
            why = 'the click only brought this window forward. Click again.'
            self._bottom.say_unsent(_called(button), why)
            return True
        question = self._window.question
        if target in (question.yes, question.also) and not question.settled(clock.now() - age):
            return True
        if kind == QtCore.QEvent.Type.MouseButtonDblClick:
            # A button may have appeared since the first press of a double click; the second press
            # is not meant for that button.
            return button is not None
        self._held, self._held_name = button, _called(button)
        return False

    def _point_at(self, widget: QtWidgets.QWidget | None) -> None:
        """Have the bottom line explain the widget that the pointer has reached."""
        before, self._under = self._under, widget
        while widget is not None and not hasattr(widget, 'explanation'):
            widget = widget.parentWidget()
        if before is not self._under:
            self._bottom.move(before, widget)


def _called(button: QtWidgets.QAbstractButton | None) -> str:
    if isinstance(button, CommandButton) and button.button is not None:
        return button.button.name
    return button.words if isinstance(button, Push) else ''


class Keyboard:
    """Turns keys into commands, choices of a kart, and answers to questions."""

    def __init__(self, presses: CommandInput) -> None:
        self._presses, self._late, self._window = presses, presses.late, presses.window
        self._bottom, self._chosen = presses.window.bottom, presses.window.chosen
        self._last: tuple[str, float] = '', 0.0  # the last key that means something, and when
        self._acts: dict[str, Callable[[float], object]] = {
            'F1': lambda _: presses.toggle_help(),
            'F8': lambda _: self._window.toggle_night(),
            'F10': lambda _: self._window.alerts.press(1),
            'F11': lambda _: self._window.alerts.toggle_sound(),
            'Up': lambda _: self._chosen.choose_next(-1),
            'Down': lambda _: self._chosen.choose_next(1),
            'Return': self._press_focused,
            'Ctrl+L': lambda _: presses.toggle_events(),
            'Backspace': self._type,
            'Esc': lambda _: self._cancel(),
        }

    def take(self, event: QtGui.QKeyEvent) -> bool:
        """Handle a key; return True if no widget may get this key."""
        age = self._late.age(event)
        repeated = event.isAutoRepeat()
        if keys.is_kill(_alone(event), event.nativeScanCode()):
            self._presses.kill(repeated)
            return True
        name = _name(event)
        stroke = keys.meaning(name)
        asking = self._window.question.isVisible()
        if age >= STALE and not self._acts_late(stroke):
            # No message is needed for a key that means nothing here, such as Shift alone.
            named = stroke is not None or asking or name in MOVE_KEYS
            return self._late.drop(name, age) if named and not repeated else True
        self._late.in_time()
        at = clock.now() - age
        twice = False  # whether a double click presses the same key again
        if (stroke is not None or name in ANSWER_KEYS) and not repeated:
            last, pressed_at = self._last
            self._last = name, at
            twice = name == last and at - pressed_at < AGAIN
        # A kart that crosses the line does not wait for an answer.
        if asking and (stroke is None or stroke.finish is None):
            return repeated or self._answer(name, stroke, at)
        if stroke is None:
            return name in ANSWER_KEYS
        if repeated and stroke.window not in ('Up', 'Down'):
            return True
        if stroke.window:
            self._acts[stroke.window](at)
        elif stroke.digit:
            self._type(at, stroke.digit)
        elif stroke.to_chosen and twice and not self._chosen.kart and not self._chosen.digits:
            pass  # the first press has already used the kart number
        elif stroke.stop or not twice:
            self._press(stroke, at)
        return True

    def _type(self, at: float, digit: str = '') -> None:
        """Add a digit to the number of a kart and of a heat, or delete the last one."""
        # Even with the heats open, the digits are a kart's number too, as a stop may follow.
        if digit:
            self._chosen.add(digit, at)
        else:
            self._chosen.erase(at)
        if not self._window.question.isVisible():
            self._window.heats.focus_on(self._chosen.digits)

    def _acts_late(self, stroke: Stroke | None) -> bool:
        """Return whether a key acts however late it is, because it stops or chooses a kart."""
        if stroke is None:
            return False
        if stroke.window == 'Return':
            return self._window.is_stop(QtWidgets.QApplication.focusWidget())
        chooses_kart = stroke.window in ('Up', 'Down', 'Backspace', 'Esc')
        return stroke.stop or bool(stroke.digit) or chooses_kart

    def _answer(self, name: str, stroke: Stroke | None, at: float) -> bool:
        """Handle a key while a question is open; return True, as no widget may get the key."""
        question = self._window.question
        answers = {'N': question.no, 'Y': question.yes}
        if not question.also.isHidden():
            answers[question.also.key] = question.also
        buttons = list(answers.values())
        focused = next((each for each in buttons if each.hasFocus()), None)
        pressed = answers.get(name)
        if stroke is not None and stroke.window in ('Return', 'Esc'):
            pressed = focused if stroke.window == 'Return' else question.no
        if pressed is question.no:
            self._presses.answer(False)
        elif pressed is not None and at < question.shown_at:
            why = 'it was pressed before the question appeared. Read it, then answer.'
            self._bottom.say_unsent(name, why)
        elif pressed is not None and question.yes.isEnabled():
            self._presses.answer(True, pressed is question.also)
        elif pressed is not None:
            self._bottom.say(texts.ANSWER_NO, Tone.WAIT)
        elif name in MOVE_KEYS:
            other = buttons[(buttons.index(focused or question.no) + 1) % len(buttons)]
            (other if other.isEnabled() else question.no).setFocus()
        elif stroke is not None and stroke.window == 'Return':
            self._press_focused(at)  # a click has moved the focus from the answers to a stop
        elif stroke is not None and (stroke.digit or stroke.window == 'Backspace'):
            self._type(at, stroke.digit)
        elif stroke is not None and stroke.commands:
            if stroke.asks or not stroke.stop:
                question.close_sheet()  # a Y that follows is not meant for it
            self._press(stroke, at)
        elif stroke is not None:
            self._bottom.say('Answer the question first: Y or N', Tone.WAIT)
        return True

    def _press(self, stroke: Stroke, at: float) -> None:
        """Press a key's button. A command that has just changed is sent only if it is a stop."""
        screen, kart = self._window.seen.screen, 0
        if stroke.to_chosen:
            kart, why = self._chosen.take(at)
            if not kart:
                self._bottom.say_unsent(CATALOGUE[stroke.commands[0]].label, why)
                if stroke.stop:
                    self._window.alerts.alarm.sound()
                return
        button, shown = _meant(screen, stroke, kart), self._window.seen.seen(at)
        seen = button if shown is None else _meant(shown.screen, stroke, kart)
        if button is None:
            if stroke.finish is not None:
                self._chosen.clear()
                self._bottom.say_unsent(FINISH_KEYS[stroke.finish], 'no kart has this letter.')
        elif button.is_instant or (seen is not None and seen.is_same_command(button)):
            self._presses.press(button)
        else:
            self._presses.refuse_changed(button)

    def _cancel(self) -> None:
        """Delete the typed number; if no number is typed, close the open sheets."""
        if self._chosen.digits:
            self._chosen.clear()
        else:
            self._window.close_sheets()
            self._window.setFocus()

    def _press_focused(self, at: float) -> None:
        """Press the focused button, unless its command has just changed."""
        focused = QtWidgets.QApplication.focusWidget()
        if not isinstance(focused, QtWidgets.QAbstractButton):
            return
        shown = self._window.seen.seen(at)
        if shown is None or not self._presses.missed(focused, shown.of(focused)):
            focused.click()


def _alone(event: QtGui.QKeyEvent) -> str:
    """Return the name of a key without the modifiers that are held down."""
    return QtGui.QKeySequence(event.key()).toString()


def _name(event: QtGui.QKeyEvent) -> str:
    """Return the name, as in ``keys``, of a key with the modifiers that are held down."""
    modifiers = QtCore.Qt.KeyboardModifier
    name = QtGui.QKeySequence(event.keyCombination()).toString()
    if event.modifiers() & modifiers.KeypadModifier:
        name = _alone(event)
    commanding = modifiers.ControlModifier | modifiers.AltModifier | modifiers.MetaModifier
    typed = '' if event.modifiers() & commanding else event.text()
    return keys.key_name(name, typed, event.nativeScanCode())


def _meant(screen: Screen, stroke: Stroke, kart: int) -> Button | None:
    """Return the button that a key presses; ``kart`` is 0 if its command needs no kart."""
    if (place := stroke.finish) is not None:
        return next((row.letter for row in screen.rows[place:]), None)
    found = (screen.button(command, kart) for command in stroke.commands)
    return next((each for each in found if each is not None), None)
