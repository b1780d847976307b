# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Order and laps of random races beside what the simulated karts really did.

The timing line misses 2 % of the crossings and makes as many up; one program is restarted in
mid-race. An official sees each kart finish and gives FINISH, and corrects nothing.
"""

from __future__ import annotations

import itertools
import random

from evgp_node.results import Passing, Standings
from evgp_node.roster import Heat
from evgp_protocol.states import RaceState
from evgp_rehearsal.field import Crossing, Field, TICK_LENGTH
from evgp_rehearsal.plan import Plan, Track
from evgp_timing.desk import Desk, Input, Passed, Roster, Told, What
from evgp_timing.laps import LapSettings
import pytest

RACES = 40

WRONG = 0.02
"""Share of the crossings that the line misses; it makes as many up."""

LAG, REACTION = 0.3, 0.4
"""Maximum time from a crossing to its passing, and from the last one to FINISH, in seconds."""

AWAY = 2.0
"""Time for which the timekeeper is away, in seconds."""

PLAN = Plan(Track(((0.0, 0.0), (30.0, 0.0), (30.0, 10.0), (0.0, 10.0))), karts=6, laps=5)

HEAT = Heat('Heat 1', PLAN.numbers, laps=PLAN.laps)


class Event:
    """
    Simulated karts, race control's word, and the timekeeper's desk with all that it was fed.

    :ivar wrong: the karts of a race of which the line missed a crossing, and those of which it
        made one up.
    """

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        plan = Plan(PLAN.track, karts=PLAN.karts, laps=PLAN.laps, seed=seed)
        self.field = Field(plan)
        self.fed: list[Input] = []
        self.desk = self.new_desk()
        self.run = 0
        self._numbers = itertools.count(1)
        self._coming: list[tuple[float, Input]] = []  # when, and what
        self._away: tuple[float, float] | None = None

    def new_desk(self) -> Desk:
        """Return a timekeeper that begins now."""
        desk = Desk(Roster(PLAN.numbers, {}, (HEAT,)), LapSettings())
        for each in self.fed:
            desk.feed(each)
        return desk

    @property
    def now(self) -> float:
        """Return the time, in seconds."""
        return 1000.0 + self.field.tick * TICK_LENGTH

    def tell(self, what: What, kart: int = 0, after: float = 0.0) -> None:
        at = self.now + after
        self._coming.append((at, Told(at, what, f'run {self.run}', 1, HEAT.name, kart)))

    def see(self, at: float, kart: int) -> None:
        """Have the line see a kart."""
        number, came = next(self._numbers), self.now + self.chance.uniform(0.0, LAG)
        passing = Passing('line', 'x', number, kart, stamp_ns=round(at * 1e9))
        self._coming.append((came, Passed(came, (passing,))))

    def step(self) -> list[Crossing]:
        """Go on by a tick; return the crossings in it."""
        before = len(self.field.truth.crossings)
        self.field.step()
        away = 0.0
        if self._away is not None:
            since, until = self._away
            if self.now < until:
                return self.field.truth.crossings[before:]
            self._away, away = None, until - since
            self.desk = self.new_desk()
            # As the node takes it: what race control said, then the passings, which come late.
            self._coming.sort(key=lambda each: (isinstance(each[1], Passed), each[0]))
        else:
            self._coming.sort(key=lambda each: each[0])
        due = [each for each in self._coming if each[0] <= self.now]
        self._coming = [each for each in self._coming if each[0] > self.now]
        for came, each in due:
            given = each
            if away and isinstance(given, Passed):
                given = given._replace(at=max(came, self.now), away=away)
            self.fed.append(given)
            self.desk.feed(given)
        return self.field.truth.crossings[before:]

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_LENGTH)):
            self.step()

    def race(self, restart: str = '') -> tuple[dict[int, list[float]], set[int], set[int]]:
        """
        Drive a race from the grid; return the true crossings of each kart, and who was wronged.

        :param restart: which program is restarted in mid-race; race control ends the race by that.
        :return: also the karts of which a crossing was missed, and those with one made up.
        """
        missed, made_up = set(), set()
        crossed: dict[int, list[float]] = {number: [] for number in self.field.karts}
        self.run += 1
        self.tell(What.GRID_ACTIVE)
        for number in self.field.karts:
            self.field.hear(number, RaceState.GRID_ACTIVE)
        self.wait(2.0)
        self.tell(What.GREEN_GREEN)
        for number in self.field.karts:
            self.field.hear(number, RaceState.GREEN_GREEN)
            self.tell(What.SENT_GREEN, number)
        new: list[Crossing] = []
        middle = self.now + self.chance.uniform(10.0, 25.0)
        done: set[int] = set()
        while len(done) < len(crossed):
            for each in new:
                crossed[each.kart].append(each.at)
                if self.chance.random() < WRONG:
                    missed.add(each.kart)
                else:
                    self.see(each.at, each.kart)
                if self.chance.random() < WRONG:
                    kart = self.chance.choice([*crossed])
                    made_up.add(kart)
                    self.see(each.at, kart)
                if len(crossed[each.kart]) == PLAN.laps + 1:
                    done.add(each.kart)
                    self.tell(What.FINISH, each.kart, self.chance.uniform(0.0, REACTION))
                    self.field.hear(each.kart, RaceState.RED_RED)
            new = self.step()
            if restart and self.now > middle:
                if restart == 'race control':
                    break
                self._away = self.now, self.now + AWAY
                restart = ''
        for kart in self.field.karts.values():
            kart.drop()
        for _ in range(100):  # who crosses the line while it brakes is seen there, too
            for each in new:
                crossed[each.kart].append(each.at)
                self.see(each.at, each.kart)
            new = self.step()
        return crossed, missed, made_up


def laps_of(crossings: list[float]) -> list[float]:
    """Return the times of the laps that count."""
    return [late - early for early, late in itertools.pairwise(crossings)][: PLAN.laps]


def test_each_difference_from_the_truth_is_of_a_crossing_that_was_missed_or_made_up() -> None:
    karts = wrong = differ = asked = 0
    for seed in range(RACES):
        event = Event(seed)
        if seed % 2:
            _judge(event, *event.race('race control'), stopped=True)
            event.wait(3.0)
            found = event.race()
        else:
            found = event.race('timekeeper')
        results = _judge(event, *found)
        crossed, missed, made_up = found
        karts += len(crossed)
        wrong += len(missed | made_up)
        for kart in results.karts:
            if kart.laps != len(laps_of(crossed[kart.kart])):
                differ += 1
                asked += any(f'Kart {kart.kart} ' in each for each in results.questions)
        # A timekeeper that begins now knows the same.
        assert event.new_desk().standings() == event.desk.standings()
    print(f'{karts} karts, {wrong} with wrong crossings; laps differ: {differ}, asked: {asked}')
    assert wrong > karts / 10
    assert asked


def _judge(
    event: Event,
    crossed: dict[int, list[float]],
    missed: set[int],
    made_up: set[int],
    stopped: bool = False,
) -> Standings:
    """Compare the results of the newest race with the truth; return them."""
    results = event.desk.standings()
    assert (results.run, {each.kart for each in results.karts}) == (
        f'run {event.run}',
        {*crossed},
    )
    fair = [each for each in results.karts if each.kart not in missed | made_up]
    for each in fair:
        assert list(each.lap_times) == pytest.approx(laps_of(crossed[each.kart]), abs=1e-6)
    truth = sorted(
        (each.kart for each in fair),
        key=lambda kart: (
            -len(laps_of(crossed[kart])),
            crossed[kart][: PLAN.laps + 1][-1:],
        ),
    )
    assert [each.kart for each in fair] == truth
    for each in results.karts:
        lacks = each.laps < PLAN.laps and not stopped
        named = f'Kart {each.kart} is marked as finished'
        assert lacks == any(named in question for question in results.questions)
    return results
