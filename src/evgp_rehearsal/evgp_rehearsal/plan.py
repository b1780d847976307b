# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The plan of a rehearsal: track, karts, seed and script. Pure."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
import itertools
import math
from typing import TypeAlias

Point: TypeAlias = tuple[float, float]
"""x and y, in metres."""


@dataclass(frozen=True)
class Track:
    """
    A closed line.

    :param corners: the corners, in the direction of the race. The first one is the start and
        finish line.
    """

    corners: tuple[Point, ...]

    @property
    def length(self) -> float:
        """Return the length of a lap, in metres."""
        return sum(itertools.starmap(math.dist, self._sides()))

    def point(self, distance: float) -> Point:
        """Return the point at a distance from the line, in metres, which may be negative."""
        left = distance % self.length
        for (ax, ay), (bx, by) in self._sides():
            side = math.dist((ax, ay), (bx, by))
            if left <= side:
                return ax + (bx - ax) * left / side, ay + (by - ay) * left / side
            left -= side
        return self.corners[0]

    def _sides(self) -> Iterable[tuple[Point, Point]]:
        return itertools.pairwise((*self.corners, self.corners[0]))


COURSE = Track(
    (
        *((0.0, 0.0), (45.0, 0.0), (58.0, 6.0), (62.0, 18.0), (55.0, 30.0), (38.0, 33.0)),
        *((30.0, 26.0), (20.0, 26.0), (10.0, 36.0), (-8.0, 35.0), (-18.0, 24.0), (-16.0, 8.0)),
    )
)
"""The track of a rehearsal."""


@dataclass(frozen=True)
class Ability:
    """
    A kart's mean abilities, from which each kart's own differ.

    :param top: maximum speed, m/s.
    :param acceleration: maximum acceleration, m/s².
    :param flag_braking: deceleration in RED_FLAG, m/s².
    :param red_braking: deceleration in RED_RED, m/s².
    :param reaction: time from a command to the first change of speed, s.
    :param ready: time from GRID_ACTIVE to its acknowledgement, s.
    """

    top: float = 8.0
    acceleration: float = 2.5
    flag_braking: float = 1.2
    red_braking: float = 5.0
    reaction: float = 0.15
    ready: float = 1.0


@dataclass(frozen=True)
class Cue:
    """
    A line of the script.

    :param at: time since the first GREEN_GREEN or, for an incident on the grid, since the first
        GRID_ACTIVE, s.
    """

    incident: str
    at: float


@dataclass(frozen=True)
class Plan:
    """
    A rehearsal.

    :param karts: number of karts, which are numbered from 1.
    :param seed: decides the karts' abilities, and which kart has which incident.
    """

    track: Track = COURSE
    ability: Ability = Ability()
    karts: int = 6
    laps: int = 6
    seed: int = 1
    script: tuple[Cue, ...] = ()

    @property
    def numbers(self) -> tuple[int, ...]:
        """Return the numbers of the karts."""
        return tuple(range(1, self.karts + 1))
