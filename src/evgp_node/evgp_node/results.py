# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Results of races as plain data: `Results.msg` and its parts are the image of these types.

The timekeeper computes them; board, windows and reports only show them.

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
"""Time without results after which screens say that there is no timing, in seconds. Results come
once a second."""

BY_HAND = 'official'
"""The source of passings that officials enter (COUNT_PASSING)."""


class Identity(NamedTuple):
    """Identifies a passing; a repeated passing has the same identity."""

    source: str
    session: str
    number: int

    def __str__(self) -> str:
        """Return the identity as officials name it."""
        return f'{self.source} {self.number}'


class Passing(NamedTuple):
    """
    A passing as the source sent it; its fields mean the same as in ``evgp_rcs_msgs/Passing``.

    :param stamp_ns: time of the crossing, in ns since the epoch of the source's clock.
    :param strength: signal strength; None if unknown.
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
        """Return the identity of the passing."""
        return Identity(*self[:3])


class Mark(enum.Enum):
    """
    The timekeeper's judgement of a passing.

    ``DOUBTFUL``: too soon after the last passing that counted. ``UNKNOWN``: no kart has its
    transponder. ``NOT_COUNTED``: the kart was not racing then, or already had all its laps.
    """

    COUNTED = 'counted'
    DOUBTFUL = 'doubtful'
    STRUCK = 'struck out'
    UNKNOWN = 'unknown'
    NOT_COUNTED = 'not counted'


class Penalty(NamedTuple):
    """A penalty on a kart's result, with its reason and the official who gave it."""

    kart: int
    seconds: int
    laps: int
    disqualified: bool
    reason: str
    official: str

    def __str__(self) -> str:
        """Return the penalty and its reason as text."""
        costs = [f'+{self.seconds} s'] * bool(self.seconds) + [f'-{self.laps} laps'] * bool(
            self.laps
        )
        costs += ['disqualified'] * self.disqualified
        return f'{", ".join(costs)}: {self.reason}'


class Status(enum.Enum):
    """The status of a kart in the results; from ``DNF`` on, it has no place."""

    RUNNING = 'RUNNING'
    CLASSIFIED = 'CLASSIFIED'
    DNF = 'DNF'
    NOT_CLASSIFIED = 'NOT_CLASSIFIED'
    DISQUALIFIED = 'DISQUALIFIED'


class KartResult(NamedTuple):
    """
    The result of one kart.

    :param place: place from 1, which equal karts share; 0 for none.
    :param laps: number of laps that count, after penalties.
    :param total: in a race, time from GREEN_GREEN to the last crossing; otherwise the sum of the
        laps; plus the seconds of penalties; in seconds. None if there is no lap.
    :param lap_times: time of every lap, in seconds.
    :param penalties: penalties in the order in which officials gave them.
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
        """Return its best lap time, in seconds; None if there is no lap."""
        return min(self.lap_times, default=None)


class Judged(NamedTuple):
    """A passing with its judgement; ``struck``: why it was struck out."""

    passing: Passing
    kart: int
    mark: Mark
    at: float
    struck: str


class Act(enum.Enum):
    """A kind of correction by an official."""

    COUNT = 'count a passing'
    STRIKE = 'strike a passing out'
    RESTORE = 'restore a passing'
    GIVE = 'give a transponder to a kart'
    PENALISE = 'penalise a kart'
    UNDO_PENALTY = 'undo the last penalty of a kart'
    CHOOSE = 'make this race count for its heat'
    PUBLISH = 'publish the results of a race'


class Correction(NamedTuple):
    """
    A correction by an official.

    :param race: number of the race in the event, from 1; 0 for the newest.
    :param passing: for STRIKE and RESTORE: the passing.
    :param seconds: for PENALISE: time to add, in seconds.
    :param laps: for PENALISE: number of laps to deduct.
    :param disqualified: for PENALISE: whether to disqualify the kart.
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
        """Return the correction and its reason as text."""
        what = [self.act.value, f'kart {self.kart}' * bool(self.kart)]
        what.append(f'passing {self.passing}' * bool(self.passing.source))
        what.append(f'transponder {self.transponder}' * bool(self.transponder))
        what += [f'+{self.seconds} s' * bool(self.seconds), f'-{self.laps} laps' * bool(self.laps)]
        what.append('disqualified' * self.disqualified)
        return f'{", ".join(filter(None, what))}{f": {self.reason}" if self.reason else ""}'


class Corrected(NamedTuple):
    """
    An accepted correction, and when it came.

    :param run: id of the run of race control of the corrected race; empty if no race was known.
    :param race: number of the corrected race in that run.
    """

    at: float
    correction: Correction
    run: str = ''
    race: int = 0


class HeatGrid(NamedTuple):
    """The starting order of a heat; empty if there is none yet."""

    name: str
    karts: tuple[int, ...]


class RaceOfEvent(NamedTuple):
    """
    A race of this event, as the timekeeper recorded it.

    :param number: number of the race, from 1.
    :param stamp: time of its GRID_ACTIVE, in seconds.
    :param counts: whether its results count for its heat.
    """

    number: int
    heat: str
    stamp: float
    classified: int
    counts: bool


class Standings(NamedTuple):
    """The results of the newest race; its fields mean the same as in `Results.msg`."""

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
    grids: tuple[HeatGrid, ...] = ()
    next_heat: str = ''
    races: tuple[RaceOfEvent, ...] = ()
    questions: tuple[str, ...] = ()
    published: bool = False

    def kart(self, number: int) -> KartResult | None:
        """Return the result of a kart; None if it did not start."""
        return next((each for each in self.karts if each.kart == number), None)

    def behind(self, number: int) -> str:
        """Return how far a kart is behind the first one, as text; empty if it is not."""
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
        """Return how many laps a kart still has to drive; 0 if no number is set."""
        kart = self.kart(number)
        return 0 if kart is None else max(0, self.laps - len(kart.lap_times))
