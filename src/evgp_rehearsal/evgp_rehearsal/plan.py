# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The plan of a rehearsal: track, karts, seed and script, from a YAML file.

This module turns text into a ``Plan`` or one ``PlanError``, and is pure.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import dataclasses
from dataclasses import dataclass
import itertools
import math
from typing import Any, TypeAlias

import yaml

MOST_KARTS = 60
"""Maximum number of karts in a rehearsal."""


Point: TypeAlias = tuple[float, float]
"""x and y, in metres."""


class PlanError(ValueError):
    """A plan cannot be used. The text says why."""


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


@dataclass(frozen=True)
class Ability:
    """
    A kart's abilities.

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
    :param kart: the kart concerned; with 0, the seed decides.
    """

    incident: str
    at: float
    kart: int = 0


@dataclass(frozen=True)
class Plan:
    """
    A rehearsal.

    :param karts: number of karts, which are numbered from 1.
    :param spread: maximum deviation of each figure of a kart's ability, as a fraction, 0 to 0.5.
    """

    track: Track
    ability: Ability = Ability()
    karts: int = 6
    laps: int = 6
    spread: float = 0.15
    seed: int = 1
    script: tuple[Cue, ...] = ()

    @property
    def numbers(self) -> tuple[int, ...]:
        """Return the numbers of the karts."""
        return tuple(range(1, self.karts + 1))


def read_plan(text: str, karts: int | None = None) -> Plan:
    """
    Return the plan in a YAML text.

    :param karts: number of karts, in place of that in the text.
    :raises PlanError: if the plan is wrong.
    """
    try:
        given = yaml.safe_load(text)
        if not isinstance(given, dict):
            raise PlanError('the plan must be a YAML mapping, like config/rehearsal.yaml')
        plan = _plan(given if karts is None else {**given, 'karts': karts})
    except PlanError:
        raise
    except (yaml.YAMLError, ValueError, TypeError, KeyError) as error:
        raise PlanError(f'the plan cannot be read: {error}') from error
    _check(plan)
    return plan


def _plan(given: Mapping[str, Any]) -> Plan:
    unknown = set(given) - {'seed', 'karts', 'laps', 'track', 'kart', 'script'}
    if unknown:
        # In particular, a plan has no roster, because its karts must not exist anywhere else.
        raise PlanError(f'a plan has no {", ".join(sorted(map(str, unknown)))}')
    kart = dict(given.get('kart', {}))
    spread = float(kart.pop('spread', Plan.spread))
    ability = Ability(**{name: float(value) for name, value in kart.items()})
    corners = tuple((float(x), float(y)) for x, y in given['track'])
    cues = (Cue(**line) for line in given.get('script') or ())
    return Plan(
        Track(corners),
        ability,
        int(given.get('karts', Plan.karts)),
        int(given.get('laps', Plan.laps)),
        spread,
        int(given.get('seed', Plan.seed)),
        tuple(Cue(each.incident, float(each.at), int(each.kart)) for each in cues),
    )


def _check(plan: Plan) -> None:
    corners, ability = plan.track.corners, dataclasses.astuple(plan.ability)
    figures = (*ability, *itertools.chain(*corners))
    for wrong, why in (
        (len(corners) < 3 or len(set(corners)) < len(corners), 'give 3 different corners'),
        (not 1 <= plan.karts <= MOST_KARTS, f'karts: 1 to {MOST_KARTS}'),
        (plan.laps < 1, 'laps: 1 or more'),
        (
            any(cue.kart not in (0, *plan.numbers) for cue in plan.script),
            f'script: kart must be from 1 to {plan.karts}',
        ),
        (not 0.0 <= plan.spread <= 0.5, 'spread: 0 to 0.5'),
        (not all(map(math.isfinite, figures)), 'every figure must be finite'),
        (min(ability) <= 0, 'every figure of a kart must be above 0'),
    ):
        if wrong:
            raise PlanError(f'the plan is not possible: {why}')
