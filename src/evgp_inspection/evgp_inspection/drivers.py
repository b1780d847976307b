# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Who gives race control its commands: a person at its screen, or a program."""

from __future__ import annotations

from collections.abc import Callable
import enum
from typing import Protocol, TypeAlias

from evgp_inspection.inspector import Inspector


class Press(enum.Enum):
    """A command of §4.B, by its name in `evgp_rcs`'s catalogue; the value is for people."""

    ALL_KILL = 'Press ALL KILL (RED_RED to every kart)'
    RED_FLAG = 'Press RED FLAG for the race'
    GRID_ACTIVE = 'Press GRID ACTIVE'
    GREEN_GREEN = 'Press GREEN GREEN'
    RACE_OVER = 'Press RACE OVER'
    IN_GARAGE = 'Press IN GARAGE for the race'
    KART_RED_RED = 'Press RED RED for kart {kart} alone'
    KART_IN_GARAGE = 'Give kart {kart} alone back to its team (GARAGE in its row)'
    KART_FINISH = 'Press FINISH for kart {kart}'

    @property
    def to_one_kart(self) -> bool:
        """Return whether it is for one kart."""
        return self.name.startswith('KART_')


Reply: TypeAlias = tuple[bool, str]
"""Whether race control says that it carries out a command; and what else it says."""


class Driver(Protocol):
    """Gives commands. ``exact``: it says to the moment when it gives them."""

    exact: bool

    async def prepare(self, in_race: tuple[int, ...], outside: tuple[int, ...]) -> str:
        """Have these karts in the race, in IN_GARAGE; return why that is not so, or nothing."""

    async def give(self, act: Press, kart: int, given: Callable[[], None]) -> Reply:
        """
        Give a command.

        :param kart: its kart; 0: it is for the race or for all.
        :param given: is called in the moment in which the command is given.
        """

    async def start_again(self) -> bool:
        """Start a race control again that cannot be brought to IN_GARAGE; return whether it is."""

    def close(self) -> None:
        """End it."""


START_RACE_CONTROL_AGAIN = (
    'Not every kart is connected and in IN_GARAGE. End race control and start it again. Done?'
)
"""What a person is asked when a race control cannot be brought to IN_GARAGE."""


class Human:
    """
    A person at race control's screen, who presses what a sentence says.

    :param seconds: maximum time to wait for a key, s.
    """

    exact = False

    def __init__(self, inspector: Inspector, seconds: float) -> None:
        self._inspector = inspector
        self._seconds = seconds
        self._prepared = False

    async def prepare(self, in_race: tuple[int, ...], outside: tuple[int, ...]) -> str:
        """Ask, the first time."""
        if self._prepared:
            return ''
        racing = ' and '.join(map(str, in_race))
        others = ' and '.join(map(str, outside))
        done = await self._inspector.ask(
            f'Put karts {racing} into the race, and no other; kart {others} is in the list, but '
            'not in the race. The race is in IN_GARAGE, the track is closed. Done?',
            self._seconds,
        )
        self._prepared = bool(done)
        return '' if done else 'The race was not prepared.'

    async def give(self, act: Press, kart: int, given: Callable[[], None]) -> Reply:
        """Ask for it; the key says that it was done, or that race control does not let it."""
        given()
        done = await self._inspector.ask(
            act.value.format(kart=kart) + '. y: pressed, n: refused or not offered.',
            self._seconds,
        )
        return bool(done), '' if done else 'not possible, says the person at the screen'

    async def start_again(self) -> bool:
        """Ask for it; whatever was in the race has to be put there again."""
        self._prepared = False
        return bool(await self._inspector.ask(START_RACE_CONTROL_AGAIN, self._seconds))

    def close(self) -> None:
        """Do nothing."""
