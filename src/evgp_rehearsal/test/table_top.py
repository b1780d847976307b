# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A rehearsal on the table: the rules, the field and an official in one thread, as fast as it goes.

Pure: time is the field's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.race import (
    Command,
    Kart,
    LastRun,
    Outcome,
    Race,
    RaceTimes,
    StampedEvent,
    StartPhase,
)
from evgp_rehearsal.field import Connected, Failure, Field, TICK_LENGTH
from evgp_rehearsal.incidents import AFTER, ALERTS, can_begin, choose_kart, INCIDENTS
from evgp_rehearsal.line import TimingLine
from evgp_rehearsal.officials import Act, AnOfficial, look, LOOKS, Steward, View
from evgp_rehearsal.plan import Plan
from evgp_rehearsal.score import Line, Occurrence, score, STEWARD, Truth

RESTART = 40
"""Ticks from the death of race control to its return."""


@dataclass
class TableTop:
    """
    Rules and field.

    ``events`` are those of the record; race control is not there until the tick ``back_at``.
    """

    plan: Plan

    def __post_init__(self) -> None:
        """Have every kart in the race, in the garage."""
        self.field = Field(self.plan)
        self.race = self._race()
        self.events: list[StampedEvent] = []
        self.back_at = 0
        self.line = TimingLine('today')
        self._links = dict.fromkeys(self.plan.numbers, Connected.NOBODY)

    @property
    def now(self) -> float:
        """Return the time, in seconds."""
        return self.field.tick * TICK_LENGTH

    def step(self) -> None:
        """Go on by a tick: karts, connections, then race control."""
        said = self.field.step()
        while self.field.failures:
            if self.field.failures.pop() in (Failure.CRASH, Failure.DIE):
                self._crash()
        if self.field.tick < self.back_at:
            return
        if self.field.tick == self.back_at:
            self._come_back()
        for number, kart in self.field.karts.items():
            self._connect(number, kart.link(self.field.tick))
        for number, state in said:
            if self._links[number] is Connected.KART:
                serial = self.race.karts[number].serial
                self._take(self.race.heard(number, serial, state, self.now))
        self._take(self.race.passed(self.line.read(self.field), 0, self.now))
        self._take(self.race.tick(self.now))
        for number, link in self._links.items():
            if link is Connected.KART:
                self.field.hear(number, self.race.karts[number].sent)

    def give(self, act: Act, official: str) -> None:
        """Give a command, or use the MSR."""
        if act.kind is None:
            self.field.use_msr()
            return
        if self.field.tick < self.back_at:
            return
        entry = CATALOGUE[act.kind]
        offered = self.race.availability(act.kind, act.kart, self.now)
        hold = self.race.karts[act.kart].hold if entry.names_hold and act.kart else None
        command = Command(
            act.kind,
            act.kart,
            bool(entry.statement) or entry.call_is_statement,
            frozenset(offered.karts),
            hold,
            official=official,
        )
        if act.kind is CommandKind.STRIKE_PASSING:
            source, session, passing, *_ = self.line.made_up[act.kart]
            command = command._replace(
                kart=0, source=source, session=session, number=passing, reason='nobody crossed'
            )
        outcome = self.race.command(command, self.now)
        self._take(outcome)
        if outcome.start is not None:
            written = StartPhase.WRITTEN, outcome.start.number, self.now
            self._take(self.race.start_becomes(*written))

    def view(self, began: int = 0) -> View:
        """Return what an official sees who has listened since a tick."""
        race, now = self.race, self.now
        offered = [
            (kind, number)
            for kind, entry in CATALOGUE.items()
            if not (entry.names_heat or entry.of_laps)
            for number in (race.karts if entry.to_one_kart else [0])
            if race.availability(kind, number, now).available
        ]
        radio, moving, crossed = look(self.field, began)
        return View(
            race.state,
            race.karts,
            frozenset((alert.kind.name, alert.kart) for alert in race.alerts(now)),
            frozenset(offered),
            radio,
            moving,
            crossed,
            bool([at for at in self.field.msr_at if at >= began]),
            race.track_open,
        )

    def _race(self) -> Race:
        karts = [Kart(number, f'REHEARSAL {number}', True) for number in self.plan.numbers]
        return Race(karts, RaceTimes(**ALERTS))

    def _connect(self, number: int, link: Connected) -> None:
        was, self._links[number] = self._links[number], link
        if link is was:
            return
        if was is Connected.KART:
            self.field.drop(number)
        if link is Connected.NOBODY:
            self._take(self.race.disconnected(number, 'the connection was lost', self.now))
        else:
            self._take(self.race.connected(number, self.now))

    def _crash(self) -> None:
        self._left = self.race.memory()
        self.back_at = self.field.tick + RESTART
        for number, link in self._links.items():
            if link is Connected.KART:
                self.field.drop(number)
            self._links[number] = Connected.NOBODY

    def _come_back(self) -> None:
        self.race = self._race()
        self._take(self.race.recover(self._left, LastRun.UNKNOWN, self.now))

    def _take(self, outcome: Outcome) -> None:
        for event in outcome.events:
            self.events.append(StampedEvent(len(self.events) + 1, 0, self.now, event))


def play(plan: Plan, name: str, official: AnOfficial, kart: int = 0) -> Line:
    """
    Return how an official deals with an incident in a race of its own.

    :param kart: to which kart it happens; 0: the seed decides.
    :raises RuntimeError: if the race does not get to where the incident can begin.
    """
    row = INCIDENTS[name]
    table = TableTop(plan)
    _until(
        table, Steward(row.state), STEWARD, lambda: can_begin(row, table.field, table.race.state)
    )
    began = table.field.tick
    number = choose_kart(table.field, row, kart)
    row.begin(table.field, number)
    ends = began + row.ticks + AFTER
    _until(table, official, 'trainee', lambda: table.field.tick >= ends, began)
    took = Occurrence(name, number, began, ends)
    return score([took], table.events, Truth.of(table.field))[0]


MOST_TICKS = 30_000
"""Maximum number of ticks until an incident can begin."""


def _until(
    table: TableTop,
    official: AnOfficial,
    name: str,
    over: Callable[[], bool],
    began: int = 0,
) -> None:
    for _ in range(MOST_TICKS):
        if over():
            return
        if table.field.tick % LOOKS == 0:
            act = official.act(table.view(began))
            if act is not None and (act.kind is not CommandKind.SET_HEAT):
                table.give(act, name)
        table.step()
    raise RuntimeError('the race did not get there')
