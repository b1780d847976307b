# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Defines what each key of the window does, wherever the focus is.

Keys are named as in Qt ('F2', 'Ctrl+R', 'Shift+A'), but this module does not use Qt, so that tests
need no screen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import string

from evgp_rcs.words import Cell, Tone
from evgp_rcs_console.catalogue import CATALOGUE, Kind, OF_RACE_CONTROL
from evgp_rcs_console.view import FINISH_KEYS

_KILL_NAMES = frozenset({'Space', 'F12'})
_KILL_CODES = frozenset({65, 96})
"""The keys of ALL KILL: their names in Qt, and the codes of their positions on the keyboard."""

FORGOTTEN = 5.0
"""Time after the last digit before a typed kart number is cleared, in seconds."""

MOST_DIGITS = 6
"""Maximum number of typed digits shown; a kart's number has at most four."""


def _positions(rows: Mapping[int, str]) -> dict[int, str]:
    """Return the key at each position, from the position of the first key in each row."""
    return {code + place: key for code, row in rows.items() for place, key in enumerate(row)}


_LETTER_AT = _positions({24: 'QWERTYUIOP', 38: 'ASDFGHJKL', 52: 'ZXCVBNM'})
_DIGIT_AT = _positions({79: '789', 83: '456', 87: '1230'})
"""The digits of the keypad. Without Num Lock, Qt calls them Home, Up, and so on."""


def key_name(name: str, text: str, code: int) -> str:
    """
    Return the name that a key has in this program, whatever the layout of the keyboard.

    :param name: the key's name in Qt.
    :param text: the text that the key types; empty with Ctrl, Alt or Meta.
    :param code: the display server's code for the key's position on the keyboard.
    """
    if len(text) == 1 and text in string.digits:
        return text  # some layouts need Shift for digits
    if code in _DIGIT_AT:
        return _DIGIT_AT[code]
    modifiers, plus, last = name.rpartition('+')
    if len(last) == 1 and not last.isascii():
        return f'{modifiers}{plus}{_LETTER_AT.get(code, last)}'
    return name


def is_kill(name: str, code: int) -> bool:
    """
    Return whether a key means ALL KILL, on any layout and with any modifiers.

    On some layouts, the space bar and a modifier type a no-break space, a digit or another sign.

    :param name: the key's name in Qt, without modifiers.
    :param code: the display server's code for the key's position on the keyboard.
    """
    return name in _KILL_NAMES or name.isspace() or code in _KILL_CODES


WINDOW_KEYS = frozenset(
    {'F1', 'F8', 'F10', 'F11', 'Up', 'Down', 'Return', 'Ctrl+L', 'Backspace', 'Esc'}
)
"""The keys that do something in the window other than to send a command or type a number."""

KEYS = {
    key: tuple(kind for kind, entry in OF_RACE_CONTROL.items() if entry.key == key)
    for key in sorted({entry.key for entry in OF_RACE_CONTROL.values() if entry.key}, key=len)
}
"""
The commands of each key, except the keys of ALL KILL.

If a key has several commands, the screen always has a button for one of them.
"""


@dataclass(frozen=True)
class Stroke:
    """
    The meaning of a key.

    :param commands: the commands of the key. The key sends the first that has a button.
    :param to_chosen: whether the command goes to the chosen kart.
    :param finish: for a letter, the roster position of the kart that has crossed the line. That
        kart's row determines what the letter does. None for any other key.
    :param digit: the digit, if the key types a part of a kart's number; otherwise empty.
    :param window: the key, if it is one of ``WINDOW_KEYS``; otherwise empty.
    """

    commands: tuple[Kind, ...] = ()
    to_chosen: bool = False
    finish: int | None = None
    digit: str = ''
    window: str = ''

    @property
    def stop(self) -> bool:
        return bool(self.commands) and all(CATALOGUE[command].stop for command in self.commands)

    @property
    def asks(self) -> bool:
        return any(CATALOGUE[command].asks for command in self.commands)


def meaning(key: str) -> Stroke | None:
    """Return the meaning of the key with this name; None if the key has no meaning."""
    commands = KEYS.get(key.replace('Shift+', ''))  # Shift may be held by accident
    if commands is not None:
        return Stroke(commands, to_chosen=CATALOGUE[commands[0]].to_one_kart)
    if key in FINISH_KEYS:
        return Stroke(finish=FINISH_KEYS.index(key))
    key = 'Return' if key == 'Enter' else key
    if key in WINDOW_KEYS:
        return Stroke(window=key)
    if len(key) == 1 and key.isdecimal():
        return Stroke(digit=key)
    return None


def key_help() -> list[tuple[str, str]]:
    """Return every key, or group of keys, with its effect."""
    said = []
    for key, commands in sorted(KEYS.items(), key=lambda each: ('+' in each[0], each[0])):
        labels = ', '.join(CATALOGUE[command].label for command in commands)
        chosen = CATALOGUE[commands[0]].to_one_kart
        said.append((key, f'{labels}: chosen kart' if chosen else labels))
    return [
        ('Space bar, F12', 'ALL KILL, unless KEYS OFF'),
        *said,
        ('F8', 'day, night'),
        ('F10', 'SEEN: first alert'),
        ('F11', 'sound on, off'),
        ('A letter', 'LAP or FINISH of its kart'),
        ('Click UNDO', 'undo a finish'),
        ('Digits', 'kart for the next command'),
        ('Arrows', 'kart, kept until changed'),
        ('Backspace, Esc', 'delete one digit, all digits'),
        ('Ctrl+L', 'events: one kart, all'),
        ('Tab, Enter', 'next button, press it'),
        ('Y, N', 'answer a question'),
    ]


class KartField:
    """
    The field with the kart that a command by key acts on.

    Typed digits show at once, and replace a kart that was chosen in the list. Every command clears
    the digits, and so does a pause of ``FORGOTTEN``. If the field is empty, no command acts.
    """

    def __init__(self) -> None:
        self._teams: Mapping[int, str] = {}
        self.digits = ''
        self._since = 0.0
        self._chosen = 0
        self._refusal = ''

    def show_roster(self, teams: Mapping[int, str]) -> None:
        self._teams = teams
        self.changed()

    def changed(self) -> None:
        """React to a change of the field; the subclass that shows the field overrides this."""

    @property
    def _number(self) -> int:
        return int(self.digits) if self.digits else self._chosen

    @property
    def kart(self) -> int:
        """Return the kart that a command would act on now; 0 for no kart."""
        return self._number if self._number in self._teams else 0

    def _set(self, digits: str, at: float = 0.0, refusal: str = '') -> None:
        self.digits, self._since, self._refusal = digits, at, refusal
        self.changed()

    def add(self, digit: str, at: float) -> None:
        """Add a digit, typed at a time (s)."""
        self.expire(at)
        self._chosen = 0
        # Surplus digits are ignored; otherwise the field would show only the end of a number.
        self._set((self.digits + digit)[:MOST_DIGITS], at)

    def erase(self, at: float) -> None:
        self.expire(at)
        self._set(self.digits[:-1], at)

    def choose(self, kart: int) -> None:
        self._chosen = kart
        self.clear()

    def clear(self) -> None:
        """Clear the typed digits; a kart that was chosen in the list stays chosen."""
        self._set('')

    def expire(self, now: float) -> None:
        """Clear the digits or the refusal if they are too old at a time (s)."""
        if (self.digits or self._refusal) and now - self._since >= FORGOTTEN:
            self.clear()

    def take(self, at: float) -> tuple[int, str]:
        """
        Return the kart that a command acts on, with an empty text, and clear the digits.

        If there is no such kart, return 0 and the reason.

        :param at: when the key of the command was pressed, in seconds.
        """
        before = self.digits
        self.expire(at)
        kart = self.kart
        if kart:
            self.clear()
            return kart, ''
        if self.digits:
            why = f'there is no kart {self.digits}. Type another number.'
        elif before:
            why = f'{before} was typed too long ago. Type it again.'
        else:
            why = 'no kart is chosen. Type a number first.'
        self._set('', at, refusal=f'NO KART {self.digits or before or "?"}')
        return 0, why

    def cells(self) -> tuple[Cell, Cell]:
        """Return the field's large text and the explanation beside it."""
        if self._refusal:
            return Cell(self._refusal, Tone.BAD), Cell('nothing was sent', Tone.BAD)
        number = self._number
        if number in self._teams:
            return Cell(f'KART {number}'), Cell(self._teams[number])
        if not self.digits and not self._chosen:
            return Cell('', Tone.FAINT), Cell('Type a kart number', Tone.FAINT)
        if number and any(str(each).startswith(str(number)) for each in self._teams):
            more = f'no kart {number}: keep typing'
            return Cell(f'{number} …', Tone.WAIT), Cell(more, Tone.WAIT)
        return Cell(f'NO KART {number}', Tone.BAD), Cell('not in the roster', Tone.BAD)
