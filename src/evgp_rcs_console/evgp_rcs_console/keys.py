"""
What each key does, wherever the focus is.

Keys have names here, as Qt writes them ('F2', 'Ctrl+R', 'Shift+A'); nothing of Qt is needed.
"""

from __future__ import annotations

from dataclasses import dataclass
import enum

from evgp_rcs_console.commands import FORMS
from evgp_rcs_console.snapshot import Command
from evgp_rcs_console.view import CHOSEN_KART_KEYS, FINISH_KEYS, KEYS

KILL_KEYS = frozenset({'Space', 'F12'})
"""ALL KILL; with any modifier held, too."""


class Act(enum.Enum):
    """What a key does besides giving a command."""

    HELP = enum.auto()
    SEEN = enum.auto()
    SOUND = enum.auto()
    UP = enum.auto()
    DOWN = enum.auto()
    LOG = enum.auto()
    PRESS = enum.auto()
    CANCEL = enum.auto()


_ACTS = {
    'F1': Act.HELP,
    'F10': Act.SEEN,
    'F11': Act.SOUND,
    'Up': Act.UP,
    'Down': Act.DOWN,
    'Ctrl+L': Act.LOG,
    'Return': Act.PRESS,
    'Enter': Act.PRESS,
    'Esc': Act.CANCEL,
}

_COMMANDS = {key: command for command, key in KEYS.items()}
_CHOSEN = {f'Ctrl+{letter}': commands for letter, commands in CHOSEN_KART_KEYS.items()}


@dataclass(frozen=True)
class Stroke:
    """
    What a key means.

    :param commands: the first of them that the screen has a button for is given.
    :param finish: the place in the roster of the kart that has finished; None if none has.
    :param digit: it is part of a kart's number.
    """

    commands: tuple[Command, ...] = ()
    to_chosen: bool = False
    finish: int | None = None
    digit: str = ''
    act: Act | None = None

    @property
    def stop(self) -> bool:
        """Return whether it gives a stop."""
        return bool(self.commands) and all(FORMS[command].stop for command in self.commands)

    @property
    def asks(self) -> bool:
        """Return whether it asks for a confirmation first."""
        return any(FORMS[command].confirmed for command in self.commands)


def meaning(key: str) -> Stroke | None:
    """Return what a key means, None if it means nothing here."""
    if key in _COMMANDS:
        return Stroke((_COMMANDS[key],))
    if key in _CHOSEN:
        return Stroke(_CHOSEN[key], to_chosen=True)
    if key in FINISH_KEYS:
        return Stroke((Command.KART_FINISH,), finish=FINISH_KEYS.index(key))
    if key in _ACTS:
        return Stroke(act=_ACTS[key])
    if len(key) == 1 and key.isdecimal():
        return Stroke(digit=key)
    return None


class Typed:
    """
    The number of a kart, typed digit by digit.

    :param pause: after so long without a digit a new number begins, seconds.
    """

    def __init__(self, pause: float = 1.5) -> None:
        """Begin with nothing typed."""
        self._pause = pause
        self._digits = ''
        self._last = 0.0

    def add(self, digit: str, now: float) -> int:
        """Take a digit and return the number so far."""
        if now - self._last > self._pause:
            self._digits = ''
        self._digits = (self._digits + digit)[-3:]
        self._last = now
        return int(self._digits)
