# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Results of races as plain data: `Results.msg` and its parts are the image of these types.

The timekeeper makes them; board, windows and reports show them and work out nothing.

Pure.
"""

from __future__ import annotations

import enum
import math
from typing import NamedTuple

from evgp_node.roster import Format


def lap_time(seconds: float | None, digits: int = 3) -> str:
    """Return a time as minutes:seconds, as ``1:02.345``; empty if there is none."""
    if seconds is None or not math.isfinite(1000 * seconds):
        return ''
    unit = 10**digits
    minutes, rest = divmod(round(abs(seconds) * unit), 60 * unit)
    point = f'.{rest % unit:0{digits}}' if digits else ''
    return f'{"-" if seconds < 0 else ""}{minutes}:{rest // unit:02}{point}'


TIMING_GONE = 3.0
"""Time without results after which screens say that there is no timing, in seconds: they come once
a second."""

BY_HAND = 'official'
"""The source of passings that officials count (COUNT_PASSING)."""


class Identity(NamedTuple):
    """Which passing it is: the same one, however often it is said."""

    source: str
    session: str
    number: int

    def __str__(self) -> str:
        """Return it as officials name it."""
        return f'{self.source} {self.number}'


class Passing(NamedTuple):
    """
    A passing as it came; the meanings are those of ``evgp_rcs_msgs/Passing``.

    :param stamp_ns: when it crossed, in ns since the epoch of the source's clock.
    :param strength: None: the source does not say.
    """

    source: str
    session: str
    number: int
    kart: int = 0
    transponder: str = ''
    stamp_ns: int = 0
    clock: int = 0
    hits: int = 0
    strength: float | None = None

    @property
    def identity(self) -> Identity:
        """Return which one it is."""
        return Identity(*self[:3])


class Mark(enum.Enum):
    """
    What became of a passing.

    ``DOUBTFUL``: too near to the last one that counted. ``UNKNOWN``: nobody has its transponder.
    ``NOT_COUNTED``: not of a kart that races at that time, or it has all its laps.
    """

    COUNTED = 'counted'
    DOUBTFUL = 'doubtful'
    STRUCK = 'struck out'
    UNKNOWN = 'unknown'
    NOT_COUNTED = 'not counted'


class Penalty(NamedTuple):
    """What an official took from a kart's result, why, and who."""

    kart: int
    seconds: int
    laps: int
    disqualified: bool
    reason: str
    official: str

    def __str__(self) -> str:
        """Return what it costs, and why."""
        costs = [f'+{self.seconds} s'] * bool(self.seconds) + [f'-{self.laps} laps'] * bool(
            self.laps
        )
        costs += ['disqualified'] * self.disqualified
        return f'{", ".join(costs)}: {self.reason}'


class Status(enum.Enum):
    """How a kart stands in the results; from ``DNF`` on it has no place."""

    RUNNING = 'RUNNING'
    CLASSIFIED = 'CLASSIFIED'
    DNF = 'DNF'
    NOT_CLASSIFIED = 'NOT_CLASSIFIED'
    DISQUALIFIED = 'DISQUALIFIED'


class KartResult(NamedTuple):
    """
    The result of one kart.

    :param place: from 1; karts that are equal share one; 0: none.
    :param laps: those that count, after penalties.
    :param total: in a race from GREEN_GREEN to the last crossing, else the sum of the laps; with
        the seconds of penalties, in s. None: no lap.
    :param lap_times: of every lap, in s.
    :param penalties: in the order in which they were given.
    """

    kart: int
    place: int
    status: Status
    laps: int
    total: float | None
    lap_times: tuple[float, ...]
    penalties: tuple[Penalty, ...]

    @property
    def best(self) -> float | None:
        """Return its best lap, in s; None: no lap."""
        return min(self.lap_times, default=None)


class Judged(NamedTuple):
    """A passing with what became of it; ``struck``: why it was struck out."""

    passing: Passing
    kart: int
    mark: Mark
    at: float
    struck: str


class Act(enum.Enum):
    """What an official corrects."""

    COUNT = 'count a passing'
    STRIKE = 'strike a passing out'
    RESTORE = 'put a passing back'
    GIVE = 'give a transponder to a kart'
    PENALISE = 'penalise a kart'
    UNDO_PENALTY = 'take the last penalty of a kart back'
    CHOOSE = 'have this race of its heat count'
    PUBLISH = 'publish the results of a race'


class Correction(NamedTuple):
    """
    A correction by an official.

    :param race: which race, by its place among all races of the event from 1; 0: the newest.
    :param passing: for STRIKE and RESTORE.
    :param seconds: for PENALISE: seconds to add; ``laps``: laps to take; ``disqualified``.
    """

    act: Act
    official: str = ''
    kart: int = 0
    race: int = 0
    passing: Identity = Identity('', '', 0)
    transponder: str = ''
    seconds: int = 0
    laps: int = 0
    disqualified: bool = False
    reason: str = ''

    def __str__(self) -> str:
        """Return what is corrected, and why."""
        what = [self.act.value, f'kart {self.kart}' * bool(self.kart)]
        what.append(f'passing {self.passing}' * bool(self.passing.source))
        what.append(f'transponder {self.transponder}' * bool(self.transponder))
        what += [f'+{self.seconds} s' * bool(self.seconds), f'-{self.laps} laps' * bool(self.laps)]
        what.append('disqualified' * self.disqualified)
        return f'{", ".join(filter(None, what))}{f": {self.reason}" if self.reason else ""}'


class Corrected(NamedTuple):
    """
    A correction that was accepted, and when it came.

    :param run: with ``race``: the race that it corrects, by the id of the run of race control and
        the number of the race in it; empty: none was known yet.
    """

    at: float
    correction: Correction
    run: str = ''
    race: int = 0


class HeatGrid(NamedTuple):
    """In which order the karts of a heat are to start; empty: nothing says one yet."""

    name: str
    karts: tuple[int, ...]


class RaceOfEvent(NamedTuple):
    """
    A race of this event, as the timekeeper has it.

    :param number: counts them from 1.
    :param stamp: when its grid formed, in seconds.
    :param counts: its results are those of its heat.
    """

    number: int
    heat: str
    stamp: float
    classified: int
    counts: bool


class Standings(NamedTuple):
    """The results of the newest race; the meanings are those of `Results.msg`."""

    stamp: float = 0.0
    run: str = ''
    race: int = 0
    heat: str = ''
    format: Format = Format.RACE  # noqa: A003 - the message's name
    laps: int = 0
    grid: tuple[int, ...] = ()
    karts: tuple[KartResult, ...] = ()
    overall: tuple[KartResult, ...] = ()
    passings: tuple[Judged, ...] = ()
    older: int = 0
    grids: tuple[HeatGrid, ...] = ()
    next_heat: str = ''
    races: tuple[RaceOfEvent, ...] = ()
    questions: tuple[str, ...] = ()
    published: bool = False

    def kart(self, number: int) -> KartResult | None:
        """Return the result of a kart; None: it did not start."""
        return next((each for each in self.karts if each.kart == number), None)

    def behind(self, number: int) -> str:
        """Return how far a kart is behind the first one, in words; empty: it is not."""
        kart, first = self.kart(number), next(iter(self.karts), None)
        if kart is None or first is None or not kart.place:
            return ''
        if self.format is Format.PRACTICE:
            laps, mine, leading = 0, kart.best, first.best
        else:
            laps, mine, leading = first.laps - kart.laps, kart.total, first.total
        if kart is first or mine is None or leading is None or laps < 0:
            return ''
        if laps:
            return f'+{laps} lap{"s" * (laps > 1)}'
        gap = mine - leading
        return f'+{gap:.3f}' if gap < 60.0 else f'+{lap_time(gap)}'

    def laps_left(self, number: int) -> int:
        """Return how many laps a kart still has to drive; 0 also where no number is set."""
        kart = self.kart(number)
        return 0 if kart is None else max(0, self.laps - len(kart.lap_times))
