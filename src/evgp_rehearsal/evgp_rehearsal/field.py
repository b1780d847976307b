# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The field: simulated karts on a closed line, and their faults.

``hear`` passes on what race control sends. ``step`` advances time by one tick, and returns the
karts' acknowledgements. Karts do not collide, because they steer around each other.
This module is pure and deterministic: it has no clock, socket or thread, and all chance comes from
the seed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, field
import enum
import math
import random
from typing import NamedTuple

from evgp_protocol.states import RaceState
from evgp_rehearsal.plan import Ability, Plan

TICK_LENGTH = 0.05
"""Length of a tick, in seconds."""

LINE = 'line'
"""Name of the timing line. It numbers the crossings that it reports from 1."""

CREEP = 2.0
"""Speed of a kart that creeps, in m/s."""

DRIVES = 0.5
"""Minimum speed at which a kart reports that it is driving, in m/s."""


SPREAD = 0.15
"""Maximum deviation of each figure of a kart's ability from the mean, as a fraction."""


class Fault(enum.Enum):
    """The faults that a kart can have."""

    OFFLINE = enum.auto()  # it has no network
    STORMY = enum.auto()  # its network comes and goes
    REPLACED = enum.auto()  # another machine has its address
    STUCK = enum.auto()  # it does not move, whatever it is sent
    SPUN = enum.auto()  # it is stopped across the track
    SLOW = enum.auto()  # it crawls
    MUTE = enum.auto()  # it does not acknowledge red states
    IGNORES_FLAG = enum.auto()  # it drives on in RED_FLAG
    IGNORES_RED = enum.auto()  # it drives on, whatever it is sent; only the MSR stops it
    CREEPS = enum.auto()  # it moves on the grid
    NEVER_READY = enum.auto()  # it does not acknowledge GRID_ACTIVE, or withdraws its answer
    UNSEEN = enum.auto()  # the timing line misses its next crossing
    SEEN_ELSEWHERE = enum.auto()  # the timing line reports a crossing that did not happen


class Connected(enum.Enum):
    """The programs that can be connected from a kart's address."""

    NOBODY = enum.auto()
    KART = enum.auto()
    STRANGER = enum.auto()


class Failure(enum.Enum):
    """The failures of race control itself."""

    CRASH = enum.auto()
    DIE = enum.auto()
    CLOSE_CONSOLE = enum.auto()


class Crossing(NamedTuple):
    """
    A crossing that the timing line reports.

    :param at: time since the field began, in seconds.
    :param real: whether the crossing really happens.
    """

    at: float
    kart: int
    real: bool


@dataclass
class Truth:
    """
    What really happened in the field, in order. All times but those of crossings are ticks.

    :param moving: each start and stop of a kart: the tick, the kart, and whether it moves.
    :param people: each time a person enters or leaves the track: the tick, and whether the person
        is on the track.
    :param msr: each use of the MSR.
    :param messages: each radio message: the tick, and the text.
    :param crossed: the karts that have driven all laps: the tick, and the kart.
    :param crossings: every crossing that the timing line reports.
    """

    moving: list[tuple[int, int, bool]] = field(default_factory=list)
    people: list[tuple[int, bool]] = field(default_factory=list)
    msr: list[int] = field(default_factory=list)
    messages: list[tuple[int, str]] = field(default_factory=list)
    crossed: list[tuple[int, int]] = field(default_factory=list)
    crossings: list[Crossing] = field(default_factory=list)

    def moved(self, kart: int, start: float, end: float) -> tuple[float, bool]:
        """Return for how long (s) a kart moved between two times, and whether it still moved."""
        moved, since = 0.0, None
        for tick, number, moves in self.moving:
            at = min(max(tick * TICK_LENGTH, start), end)
            if number != kart or tick * TICK_LENGTH > end:
                continue
            if since is not None:
                moved += at - since
            since = at if moves else None
        return moved if since is None else moved + end - since, since is not None

    def has_person(self, at: float) -> bool:
        """Return whether a person is on the track at a time (s) or at any time in its tick."""
        tick = round(at / TICK_LENGTH)
        before = [there for when, there in self.people if when < tick]
        return (tick, True) in self.people or before[-1:] == [True]

    def movers(self, at: float) -> list[int]:
        """Return the karts that are moving at a time (s)."""
        karts = sorted({kart for _, kart, _ in self.moving})
        return [kart for kart in karts if self.moved(kart, at, at)[1]]


@dataclass
class SimulatedKart:
    """
    One kart.

    :param distance: distance driven since the line, in metres; negative before the line.
    :param told: the last state that race control sent on this connection, or None.
    :param obeys: the state that it carries out, which is ``told`` after its reaction time.
    :param cut: whether the MSR has cut the power of its motor.
    :param told_at: the tick at which ``told`` was sent.
    :param stormy_since: the tick at which its reconnect storm began.
    :param said: whether it has acknowledged ``told``.
    """

    number: int
    ability: Ability
    distance: float = 0.0
    speed: float = 0.0
    told: RaceState | None = None
    obeys: RaceState | None = None
    cut: bool = False
    faults: set[Fault] = field(default_factory=set)
    told_at: int = 0
    stormy_since: int = 0
    said: bool = False

    @property
    def moves(self) -> bool:
        """Return whether the kart is moving."""
        return self.speed > 0.0

    def link(self, tick: int) -> Connected:
        """Return which program should be connected from the kart's address."""
        if Fault.REPLACED in self.faults:
            return Connected.STRANGER
        if Fault.STORMY in self.faults:
            away, there, times = 10, 30, 4  # ticks without a connection, ticks with one, how often
            passed = tick - self.stormy_since
            if passed < times * (away + there) and passed % (away + there) < away:
                return Connected.NOBODY
        return Connected.NOBODY if Fault.OFFLINE in self.faults else Connected.KART

    def hear(self, state: RaceState, tick: int) -> None:
        """Receive a state. A repeated state changes nothing."""
        if state is not self.told:
            self.told, self.told_at, self.said = state, tick, False

    def drop(self) -> None:
        """Lose the connection, so that the kart stops (§3.E)."""
        self.told, self.obeys, self.said = None, RaceState.RED_RED, False

    def step(self, tick: int) -> RaceState | None:
        """Advance one tick, and return the state that the kart now acknowledges, if any."""
        waited = (tick - self.told_at) * TICK_LENGTH
        if self.told is not None and waited >= self.ability.reaction:
            self.obeys = self.told
        aim, rate = self._aim()
        if self.speed < aim:
            self.speed = min(aim, self.speed + self.ability.acceleration * TICK_LENGTH)
        else:
            self.speed = max(aim, self.speed - rate * TICK_LENGTH)
        self.distance += self.speed * TICK_LENGTH
        if self.said and self.told is RaceState.GRID_ACTIVE and Fault.NEVER_READY in self.faults:
            self.said = False  # it was ready, but then its team stopped it
            return RaceState.RED_RED
        if self.said or self.told is not self.obeys or not self._reached(waited):
            return None
        self.said = True
        return self.told

    def _aim(self) -> tuple[float, float]:
        """Return the target speed (m/s) and the deceleration towards it (m/s²)."""
        can, faults, obeys = self.ability, self.faults, self.obeys
        if self.cut or faults & {Fault.STUCK, Fault.SPUN}:
            return 0.0, can.red_braking
        if Fault.IGNORES_RED in faults:
            return can.top, can.red_braking
        if obeys is RaceState.RED_FLAG and Fault.IGNORES_FLAG in faults:
            return can.top, can.flag_braking
        if obeys is RaceState.GREEN_GREEN:
            return CREEP if Fault.SLOW in faults else can.top, can.flag_braking
        if obeys is RaceState.GRID_ACTIVE and Fault.CREEPS in faults:
            return CREEP, can.red_braking
        return 0.0, can.flag_braking if obeys is RaceState.RED_FLAG else can.red_braking

    def _reached(self, waited: float) -> bool:
        """Return whether the kart has reached its state and acknowledges it."""
        if self.told is None or self.told is RaceState.IN_GARAGE:
            return False
        if self.told is RaceState.GREEN_GREEN:
            return self.speed >= DRIVES or Fault.STUCK in self.faults
        if self.told is RaceState.GRID_ACTIVE:
            return waited >= self.ability.ready and Fault.NEVER_READY not in self.faults
        return not self.moves and Fault.MUTE not in self.faults


class Field:
    """
    All karts of a rehearsal.

    :param numbers: the karts that are simulated here; None for all.
    :ivar tick: number of steps so far.
    :ivar finish: distance at the end of the last lap, in metres.
    """

    def __init__(self, plan: Plan, numbers: Sequence[int] | None = None) -> None:
        self.plan = plan
        self.rng = random.Random(plan.seed)  # noqa: S311 - reproducible by the seed
        self.finish = plan.laps * plan.track.length
        self.tick = 0
        self.truth = Truth()
        self.failures: list[Failure] = []
        self.person: tuple[float, float] | None = None
        every = {number: _spread(plan, self.rng) for number in plan.numbers}
        simulated = plan.numbers if numbers is None else numbers
        self.karts = {number: SimulatedKart(number, every[number]) for number in simulated}
        for kart in self.karts.values():
            self._to_grid(kart)

    def hear(self, number: int, state: RaceState) -> None:
        """Deliver a state to a kart."""
        kart = self.karts[number]
        if state is RaceState.GRID_ACTIVE and kart.told is not state and not kart.moves:
            self._to_grid(kart)  # its team puts it there
        kart.hear(state, self.tick)

    def say(self, text: str) -> None:
        """Send a radio message."""
        self.truth.messages.append((self.tick, text))

    def let_in(self, at: tuple[float, float]) -> None:
        """Put a person on the track at x and y, in metres."""
        self.person = at
        self.truth.people.append((self.tick, True))

    def use_msr(self) -> None:
        """Cut the power of every motor, as the Master Safety Remote does."""
        self.truth.msr.append(self.tick)
        for kart in self.karts.values():
            kart.cut = True

    def mend(self) -> None:
        """Repair everything, as marshals and teams would."""
        if self.person is not None:
            self.truth.people.append((self.tick, False))
        self.person = None
        for kart in self.karts.values():
            kart.faults.clear()
            kart.cut = False

    def step(self) -> list[tuple[int, RaceState]]:
        """Advance one tick and return the karts' acknowledgements."""
        self.tick += 1
        said = []
        for number, kart in self.karts.items():
            moved, before = kart.moves, kart.distance
            state = kart.step(self.tick)
            if state is not None:
                said.append((number, state))
            if kart.moves is not moved:
                self.truth.moving.append((self.tick, number, kart.moves))
            if before < self.finish <= kart.distance:
                self.truth.crossed.append((self.tick, number))
            self._look_at_the_line(kart, before)
        return said

    def _look_at_the_line(self, kart: SimulatedKart, before: float) -> None:
        length = self.plan.track.length
        lap = math.floor(kart.distance / length)
        line = lap * length
        if before < line <= kart.distance:
            back = (kart.distance - line) / kart.speed
            if Fault.UNSEEN in kart.faults:
                kart.faults.discard(Fault.UNSEEN)
                text = f'Timekeeper: kart {kart.number} crossed the line but was not counted.'
                self.say(text)
            else:
                at = self.tick * TICK_LENGTH - back
                self.truth.crossings.append(Crossing(at, kart.number, real=True))
        half = line + length / 2
        if before < half <= kart.distance and Fault.SEEN_ELSEWHERE in kart.faults:
            kart.faults.discard(Fault.SEEN_ELSEWHERE)
            at = self.tick * TICK_LENGTH
            self.truth.crossings.append(Crossing(at, kart.number, real=False))
            text = f'Timekeeper: kart {kart.number} was counted but is not at the line.'
            self.say(text)

    def sent(self, state: RaceState) -> list[SimulatedKart]:
        """Return the karts to which race control sends a state. Only they have its incidents."""
        return [kart for kart in self.karts.values() if kart.told is state]

    def leader(self) -> int:
        """Return the leader among the karts that race and have not driven all laps, or 0."""
        sent = self.sent(RaceState.GREEN_GREEN)
        racing = [kart for kart in sent if kart.distance < self.finish]
        return max(racing, key=lambda kart: kart.distance).number if racing else 0

    def _to_grid(self, kart: SimulatedKart) -> None:
        place = 1 + self.plan.numbers.index(kart.number)
        kart.distance = -3.0 * place  # one kart every 3 m behind the line


def _spread(plan: Plan, rng: random.Random) -> Ability:
    least, most = 1 - SPREAD, 1 + SPREAD
    return Ability(*(mean * rng.uniform(least, most) for mean in astuple(plan.ability)))
