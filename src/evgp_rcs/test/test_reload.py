# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The roster is read again while race control runs: every kart, roster and history of a few steps.

The oracle of the race (``race_oracle``) compares each kart before and after an input. Here karts
come and go, so the rule has a check of its own: what is bound stays as it is, and nobody is sent
anything.
"""

from __future__ import annotations

import itertools
from types import ModuleType
from typing import Any

from evgp_protocol.states import RaceState
from evgp_rcs.rules import race
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.inputs import Setup
from evgp_rcs.rules.race import Entrant, Heat, Outcome, Roster
import pytest
import race_oracle as oracle
from recorded_races import NO_PAUSE, PaperRace
from rig.faults import faults_in, module_with

TEAM, LATE = 1, 9
"""A kart that is in the roster, and one that is not yet."""


def roster_of(*karts: tuple[int, str, str]) -> Roster:
    """Return a roster of these karts: number, team and address of each."""
    entrants = [Entrant(number, team, True, '', address) for number, team, address in karts]
    return Roster(tuple(entrants), (Heat('Heat 1', tuple(each.number for each in entrants)),))


SAME = (2, 'A', '10.0.0.2')


class Meeting(PaperRace):
    """A race of two karts in IN_GARAGE, and what the officials do with its roster."""

    def __init__(self, rules: ModuleType) -> None:
        karts, heats = roster_of((TEAM, 'A', '10.0.0.1'), SAME)
        super().__init__({}, setup=Setup(karts, NO_PAUSE, heats, 10.0))
        self.race = rules.Race([rules.Kart(*each) for each in karts], NO_PAUSE, 10.0, heats)
        self.roster = Roster(())

    def read(self) -> Outcome:
        return self.command(CommandKind.READ_ROSTER, roster=self.roster)

    def take(self, **fields: Any) -> Outcome:
        fields = {'roster': self.roster, **fields}
        return self.command(CommandKind.TAKE_ROSTER, **fields)


BOUND = {
    'connected': 'connect 1',
    'held': 'KART_RED_RED 1',
    'lost in motion': 'connect 1, say 1 GREEN_GREEN, lose 1',
    'lost on the grid': 'connect 1, LEAVE_RACE 2, GRID_ACTIVE, lose 1, LEAVE_RACE 1, IN_GARAGE',
    'as which two programs connect': 'two programs',
}
"""Why the roster must keep a kart, and its address."""

FREE = {
    'never there': '',
    'gone': 'connect 1, lose 1',
    'released after all were stopped': 'ALL_KILL, IN_GARAGE',
}

ROSTERS = {
    'the same': ((1, 'A', '10.0.0.1'), SAME),
    'a late team': ((1, 'A', '10.0.0.1'), SAME, (LATE, 'C', '10.0.0.9')),
    'another team': ((1, 'B', '10.0.0.1'), (2, 'B', '10.0.0.2')),
    'without it': (SAME,),
    'another one at its address': (SAME, (LATE, 'C', '10.0.0.1')),
    'another address': ((1, 'A', '10.0.0.7'), SAME),
    'addresses changed about': ((1, 'A', '10.0.0.2'), (2, 'A', '10.0.0.1')),
}

BETWEEN = {
    'nothing': '',
    'it connects': 'connect 1',
    'it is held': 'KART_RED_RED 1',
    'all are stopped': 'ALL_KILL',
    'another race control comes': 'rival',
    'the network is lost': 'no cable',
    'a race is over': 'connect 1 2, GRID_ACTIVE, IN_GARAGE',
    'it is read again': 'read',
}
"""What happens after the roster was read, and before it is taken."""


def _keeps(before: oracle.View, roster: Roster) -> bool:
    """Return whether a roster has every kart that it must have, with its address."""
    at = {each.number: each.address for each in roster.karts}
    return all(
        at.get(kart.number) == f'10.0.0.{kart.number}'
        for kart in before.karts
        if kart.connected or kart.hold or kart.doubt or kart.held_alone or kart.contested
    )


def check(rules: ModuleType) -> None:
    """Judge every reading and every taking of all these."""
    for first, karts, between in itertools.product(
        {**BOUND, **FREE}.items(), ROSTERS.items(), BETWEEN.items()
    ):
        case = f'{first[0]}, {karts[0]}, {between[0]}'
        meeting = Meeting(rules)
        seen = meeting.race
        meeting.go(first[1])
        meeting.roster = roster = roster_of(*karts[1])
        before = oracle.look(seen)
        assert not seen.availability(CommandKind.TAKE_ROSTER, 0, meeting.now).available, case
        outcome = meeting.read()
        assert outcome.answer.success is _keeps(before, roster), (case, outcome.answer)
        assert oracle.look(seen) == before, case
        assert not outcome.orders, case
        if not outcome.answer.success:
            assert not seen.reading, case
            continue
        number, races = seen.reading, seen.grids
        meeting.go(between[1])
        before = oracle.look(seen)
        again = between[0] == 'it is read again' and seen.reading != number
        waits = before.state is RaceState.IN_GARAGE and seen.grids == races
        barred = before.has_rival or before.cut_off_by or again
        wanted = waits and _keeps(before, roster) and not barred
        for other in (roster_of(), roster_of(*karts[1], (8, 'D', '10.0.0.8'))):
            answer = meeting.take(reading=number, roster=other).answer
            assert not answer.success, case  # the file is another by now
        outcome = meeting.take(reading=number)
        assert outcome.answer.success is wanted, (case, outcome.answer)
        assert not outcome.orders, case
        after = oracle.look(seen)
        if not wanted:
            assert after == before, case
            continue
        assert after._replace(karts=(), heats=()) == before._replace(karts=(), heats=()), case
        assert after.heats == roster.heats, case
        assert list(seen.karts) == [each.number for each in roster.karts], case
        known = {kart.number: kart for kart in before.karts}
        for kart in after.karts:
            new = rules.Race([rules.Kart(kart.number, in_race=True)], now=meeting.now)
            assert kart == known.get(kart.number, oracle.look(new).karts[0]), case
        for kart, each in zip(seen.karts.values(), roster.karts, strict=True):
            assert (kart.team, kart.address) == (each.team, each.address), case
        assert not meeting.take(reading=number).answer.success, case


FAULTS = faults_in(
    """
a kart that is connected loses its address: bound: never connected
a kart that is held loses its address: bound: never hold not
a kart that two programs connect as loses its address: bound: never contested
only a kart that leaves the roster is looked at: _bound: address != => kart.number not in addresses
only a kart with another address is looked at: _bound: get number => addresses.get(kart.number,
    kart.address)
a roster is taken that was not judged again: _refusals: _bound ( => ''
a roster is taken during a race: COMMANDS: TAKE_ROSTER _take_roster => Rule(Race._take_roster,
    statement=lambda race, kart: race._changes())
a roster is taken that was read again since: _misnamed: reading != self => command.reading >
    self.reading
a roster is taken though the file is another by now: _misnamed: never roster _read
a roster is taken twice: _take_roster: 0 => 1
a reading outlives a race: _grid_active: skips reading
to read it changes the heats: _read_roster: first: self.heats = command.roster.heats
a kart that stays is a new one: _take_roster: pop number => None
a new kart is held: _take_roster: Kart sent_since => Kart(*each, hold=RED_RED)
the heats stay as they were: _take_roster: skips heats
"""
)


def test_a_roster_is_taken_only_if_nothing_that_is_bound_changes_and_nobody_is_sent_anything() -> (
    None
):
    check(race)


@pytest.mark.parametrize('name', FAULTS)
def test_the_check_of_the_roster_finds(name: str) -> None:
    fault = FAULTS[name]
    with pytest.raises(AssertionError):
        check(module_with(race, fault))


def test_a_kart_that_is_in_no_roster_any_more_stays_held_and_is_not_let_in_again() -> None:
    held = race.KartMemory(True, False, 0, race.Doubt.MOVING, False)
    memory = race.RaceMemory(RaceState.GREEN_GREEN, {5: held})
    meeting = Meeting(race)
    meeting.race.recover(memory, race.LastRun.UNKNOWN, meeting.now)
    meeting.go('wait 5, IN_GARAGE')

    meeting.roster = roster_of((1, 'A', '10.0.0.1'), SAME, (5, 'E', '10.0.0.5'))
    answer = meeting.read().answer
    assert not answer.success
    assert 'kart 5 (no longer in the roster) is held' in answer.message
    assert 'put no kart back that is no longer in it' in answer.message
    meeting.roster = roster_of(SAME)
    assert meeting.read().answer.success
    assert meeting.take().answer.success
    assert meeting.race.karts[5].hold is RaceState.RED_RED


def test_an_alert_of_a_kart_ends_even_if_the_kart_has_left_the_roster_by_then() -> None:
    meeting = Meeting(race)
    meeting.go('KART_RED_RED 1, connect 1, wait 6, lose 1, KART_IN_GARAGE 1')
    meeting.roster = roster_of(SAME)
    assert meeting.read().answer.success
    assert meeting.take().answer.success
    assert TEAM not in meeting.race.karts
    meeting.wait(1.0)
    told = [each.event.kind for each in meeting.stamped if each.event.kart == TEAM]
    assert race.EventKind.ALERT_RAISED in told
    assert race.EventKind.ALERT_CLEARED in told
