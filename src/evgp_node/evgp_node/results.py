# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The results of races, as plain data.

The timekeeper computes the results. The board, the windows and the reports only show them. The
types contain the fields of `Results.msg` and its parts, where the fields are explained. Unknown
numbers, which are NaN there, are None here.

This module is pure.
"""

from __future__ import annotations

import enum
import math
from typing import NamedTuple

from evgp_node.roster import Format


def lap_time(seconds: float | None, digits: int = 3) -> str:
    """
    Return a time as minutes and seconds, such as ``1:02.345``.

    :param seconds: the time, in seconds. If it is None or not finite, the text is empty.
    :param digits: number of digits after the point.
    """
    if seconds is None or not math.isfinite(1000 * seconds):
        return ''
    unit = 10**digits
    minutes, rest = divmod(round(abs(seconds) * unit), 60 * unit)
    point = f'.{rest % unit:0{digits}}' if digits else ''
    return f'{"-" if seconds < 0 else ""}{minutes}:{rest // unit:02}{point}'


def _laps(number: int) -> str:
    return f'{number} lap{"s" * (number > 1)}'


TIMING_GONE = 3.0
"""Time without results after which screens say that there is no timing, in seconds. The timekeeper
publishes results at least once a second."""

MOST_PASSINGS = 200
"""Maximum number of passings in a message with results: the newest of the race."""

BY_HAND = 'official'
"""The source of passings that officials enter (COUNT_PASSING)."""


class Identity(NamedTuple):
    """The identity of a passing, which its repeats share."""

    source: str
    session: str
    number: int

    def __str__(self) -> str:
        return f'{self.source} {self.number}'


class Passing(NamedTuple):
    """A passing as its source sent it. ``stamp_ns`` is its `stamp` in nanoseconds."""

    source: str
    session: str
    number: int
    kart: int = 0
    transponder: str = ''
    stamp_ns: int = 0

    @property
    def identity(self) -> Identity:
        return Identity(*self[:3])


class Mark(enum.Enum):
    """The timekeeper's judgement of a passing, as in `JudgedPassing.msg`."""

    COUNTED = 'counted'
    DOUBTFUL = 'doubtful'
    STRUCK = 'struck out'
    UNKNOWN = 'unknown'
    NOT_COUNTED = 'not counted'


class Penalty(NamedTuple):
    kart: int
    seconds: int
    laps: int
    disqualified: bool
    reason: str
    official: str

    @property
    def costs(self) -> list[str]:
        """Return what the penalty takes from the kart's result, as texts."""
        costs = [f'+{self.seconds} s'] * bool(self.seconds)
        costs += [f'-{_laps(self.laps)}'] * bool(self.laps)
        return costs + ['disqualified'] * self.disqualified

    def __str__(self) -> str:
        return f'{", ".join(self.costs)}: {self.reason}'


class Status(enum.Enum):
    """
    The status of a kart in the results. With ``DNF`` and those after it, it has no place.

    Screens and reports show the values.
    """

    RUNNING = ''
    CLASSIFIED = 'classified'
    DNF = 'did not finish'
    NOT_CLASSIFIED = 'no lap'
    DISQUALIFIED = 'disqualified'


class KartResult(NamedTuple):
    kart: int
    place: int
    status: Status
    laps: int
    total: float | None
    lap_times: tuple[float, ...]
    penalties: tuple[Penalty, ...]

    @property
    def best(self) -> float | None:
        return min(self.lap_times, default=None)

    @property
    def remarks(self) -> list[str]:
        """Return the kart's status and its penalties with their reasons, as texts."""
        # The penalty says that a kart is disqualified, and why.
        status = '' if self.status is Status.DISQUALIFIED else self.status.value
        return [*filter(None, (status, *map(str, self.penalties)))]

    @property
    def last(self) -> float | None:
        return next(reversed(self.lap_times), None)


class Judged(NamedTuple):
    """A passing and how the timekeeper judged it, as in `JudgedPassing.msg`."""

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

    :param kart: number of the kart; 0 if the correction is not about a kart.
    :param race: number of the race in the event, from 1; 0 for the newest race.
    :param passing: the passing, for STRIKE and RESTORE.
    :param transponder: the transponder, for GIVE.
    :param seconds: time to add, in seconds, for PENALISE.
    :param laps: number of laps to deduct, for PENALISE.
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
        what = [self.act.value, f'kart {self.kart}' * bool(self.kart)]
        what.append(f'passing {self.passing}' * bool(self.passing.source))
        what.append(f'transponder {self.transponder}' * bool(self.transponder))
        what += Penalty(0, self.seconds, self.laps, self.disqualified, '', '').costs
        return f'{", ".join(filter(None, what))}{f": {self.reason}" if self.reason else ""}'


class Corrected(NamedTuple):
    """
    A correction that the timekeeper has accepted.

    :param at: when the correction arrived, in seconds.
    :param run: id of the run of race control with the corrected race; empty if there was no race.
    :param race: number of the corrected race in that run.
    """

    at: float
    correction: Correction
    run: str = ''
    race: int = 0


class HeatGrid(NamedTuple):
    """The starting order of a heat."""

    name: str
    karts: tuple[int, ...]


class RaceOfEvent(NamedTuple):
    """A race of this event, in the timekeeper's list."""

    number: int
    heat: str
    stamp: float
    classified: int
    counts: bool


class Standings(NamedTuple):
    """The results of a race: the newest one, except in the timekeeper's book."""

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
    from_green: bool = False

    @property
    def about(self) -> str:
        """Return the format and the number of laps, if any, such as ``time trial to 2 laps``."""
        return f'{self.format} to {_laps(self.laps)}' if self.laps else str(self.format)

    def kart(self, number: int) -> KartResult | None:
        """Return the result of the kart with this number; None if it did not start."""
        return next((each for each in self.karts if each.kart == number), None)

    def behind(self, number: int) -> str:
        """Return a kart's distance behind the first, such as ``+1 lap``; empty if it has none."""
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
            return f'+{_laps(laps)}'
        gap = mine - leading
        return f'+{gap:.3f}' if gap < 60.0 else f'+{lap_time(gap)}'

    def laps_left(self, number: int) -> int:
        """Return the number of laps left for a kart; 0 if the race has no set number of laps."""
        kart = self.kart(number)
        return 0 if kart is None else max(0, self.laps - len(kart.lap_times))
