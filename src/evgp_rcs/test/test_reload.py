# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The roster is read again while race control runs: every kart, roster and history of a few steps.

The oracle of the race (``race_oracle``) compares each kart before and after an input. Here karts
come and go, so the rule has a check of its own: what is bound stays as it is, and nobody is sent
anything.
"""

from __future__ import annotations

from collections.abc import Callable
import itertools
from types import ModuleType
from typing import Any

from evgp_protocol.states import RaceState
from evgp_rcs.rules import race
from evgp_rcs.rules.catalogue import CommandKind
import pytest
import race_oracle as oracle
from recorded_races import as_seen
from rig.faults import faults_in, module_with

TEAM, LATE = 1, 9
"""A kart that is in the roster, and one that is not yet."""


class Meeting:
    """A race of two karts in IN_GARAGE, and what the officials do with its roster."""

    def __init__(self, rules: ModuleType) -> None:
        self.rules = rules
        self.now = 10.0
        heats = [rules.Heat('Heat 1', (1, 2))]
        karts = [rules.Kart(each, 'A', True, address=f'10.0.0.{each}') for each in (1, 2)]
        self.race = rules.Race(karts, now=self.now, heats=heats)
        self.read: Any = None

    def do(self, kind: str, kart: int = 0, **more: Any) -> Any:
        """Give a command after every pause, as an official does who sees the race as it is."""
        self.now = max(self.now + 1.0, self.race.paused_until)
        command = as_seen(self.race, CommandKind[kind], kart, self.now, **more)
        return self.race.command(command, self.now)

    def offered(self, kind: str) -> Any:
        return self.race.availability(CommandKind[kind], 0, self.now)

    def roster(self, *karts: tuple[int, str, str]) -> Any:
        """Return a roster of these karts: number, team and address of each."""
        heats = (self.rules.Heat('Heat 1', tuple(number for number, _, _ in karts)),)
        entrants = (self.rules.Entrant(number, team, True, '', at) for number, team, at in karts)
        return self.rules.Roster(tuple(entrants), heats)


def _lost_in_motion(meeting: Meeting) -> None:
    race, now = meeting.race, meeting.now
    race.connected(TEAM, now)
    race.heard(TEAM, race.karts[TEAM].serial, RaceState.GREEN_GREEN, now)
    race.disconnected(TEAM, 'gone', now)


def _lost_on_the_grid(meeting: Meeting) -> None:
    race = meeting.race
    race.connected(TEAM, meeting.now)
    meeting.do('LEAVE_RACE', 2)
    meeting.do('GRID_ACTIVE')
    race.disconnected(TEAM, 'gone', meeting.now)
    meeting.do('LEAVE_RACE', TEAM)
    meeting.do('IN_GARAGE')


def _held(meeting: Meeting) -> None:
    meeting.do('KART_RED_RED', TEAM)


def _contested(meeting: Meeting) -> None:
    meeting.race.contested(TEAM, True, meeting.now)


BOUND: dict[str, Callable[[Meeting], object]] = {
    'connected': lambda meeting: meeting.race.connected(TEAM, meeting.now),
    'held': _held,
    'lost in motion': _lost_in_motion,
    'lost on the grid': _lost_on_the_grid,
    'as which two programs connect': _contested,
}
"""Why the roster must keep a kart, and its address."""

FREE: dict[str, Callable[[Meeting], object]] = {
    'never there': lambda meeting: None,
    'gone': lambda meeting: (
        meeting.race.connected(TEAM, meeting.now),
        meeting.race.disconnected(TEAM, 'gone', meeting.now),
    ),
    'released after all were stopped': lambda meeting: (
        meeting.do('ALL_KILL'),
        meeting.do('IN_GARAGE'),
    ),
}

SAME, OTHER = (2, 'A', '10.0.0.2'), (2, 'B', '10.0.0.2')
ROSTERS = {
    'the same': ((1, 'A', '10.0.0.1'), SAME),
    'a late team': ((1, 'A', '10.0.0.1'), SAME, (LATE, 'C', '10.0.0.9')),
    'another team': ((1, 'B', '10.0.0.1'), OTHER),
    'without it': (SAME,),
    'another one at its address': (SAME, (LATE, 'C', '10.0.0.1')),
    'another address': ((1, 'A', '10.0.0.7'), SAME),
    'addresses changed about': ((1, 'A', '10.0.0.2'), (2, 'A', '10.0.0.1')),
}

BETWEEN: dict[str, Callable[[Meeting], object]] = {
    'nothing': lambda meeting: None,
    'it connects': BOUND['connected'],
    'it is held': _held,
    'all are stopped': lambda meeting: meeting.do('ALL_KILL'),
    'another race control comes': lambda meeting: meeting.race.rival(True, meeting.now),
    'the network is lost': lambda meeting: meeting.race.cut_off('no cable', meeting.now),
    'a race is over': lambda meeting: (
        [meeting.race.connected(each, meeting.now) for each in meeting.race.karts],
        meeting.do('GRID_ACTIVE'),
        meeting.do('IN_GARAGE'),
    ),
    'it is read again': lambda meeting: meeting.do('READ_ROSTER', roster=meeting.read),
}
"""What happens after the roster was read, and before it is taken."""


def _keeps(before: oracle.View, roster: Any) -> bool:
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
        first[1](meeting)
        roster = meeting.roster(*karts[1])
        before = oracle.look(seen)
        assert not meeting.offered('TAKE_ROSTER').available, case
        outcome = meeting.do('READ_ROSTER', roster=roster)
        assert outcome.answer.success is _keeps(before, roster), (case, outcome.answer)
        assert oracle.look(seen) == before, case
        assert not outcome.orders, case
        if not outcome.answer.success:
            assert not seen.reading, case
            continue
        number, meeting.read, races = seen.reading, roster, seen.grids
        between[1](meeting)
        before = oracle.look(seen)
        again = between[0] == 'it is read again' and seen.reading != number
        waits = before.state is RaceState.IN_GARAGE and seen.grids == races
        barred = before.has_rival or before.cut_off_by or again
        wanted = waits and _keeps(before, roster) and not barred
        for other in (meeting.roster(), meeting.roster(*karts[1], (8, 'D', '10.0.0.8'))):
            answer = meeting.do('TAKE_ROSTER', reading=number, roster=other).answer
            assert not answer.success, case  # the file is another by now
        outcome = meeting.do('TAKE_ROSTER', reading=number, roster=roster)
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
        again = meeting.do('TAKE_ROSTER', reading=number, roster=roster)
        assert not again.answer.success, case


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
    memory = race.RaceMemory(
        RaceState.GREEN_GREEN, {5: race.KartMemory(True, False, 0, race.Doubt.MOVING, False)}
    )
    meeting = Meeting(race)
    meeting.race.recover(memory, race.LastRun.UNKNOWN, meeting.now)
    meeting.do('IN_GARAGE')

    with_it = meeting.roster((1, 'A', '10.0.0.1'), SAME, (5, 'E', '10.0.0.5'))
    answer = meeting.do('READ_ROSTER', roster=with_it).answer
    assert not answer.success
    assert 'kart 5 (no longer in the roster) is held' in answer.message
    assert 'put no kart back that is no longer in it' in answer.message
    read = meeting.roster(SAME)
    assert meeting.do('READ_ROSTER', roster=read).answer.success
    assert meeting.do('TAKE_ROSTER', roster=read).answer.success
    assert meeting.race.karts[5].hold is RaceState.RED_RED


def test_an_alert_of_a_kart_ends_even_if_the_kart_has_left_the_roster_by_then() -> None:
    meeting = Meeting(race)
    rules = meeting.race
    meeting.do('KART_RED_RED', TEAM)
    rules.connected(TEAM, meeting.now)
    meeting.now += rules.times.red_alert + 1.0
    raised = rules.tick(meeting.now).events
    assert (race.EventKind.ALERT_RAISED, TEAM) in [(each.kind, each.kart) for each in raised]
    rules.disconnected(TEAM, 'gone', meeting.now)
    meeting.do('KART_IN_GARAGE', TEAM)
    read = meeting.roster(SAME)
    assert meeting.do('READ_ROSTER', roster=read).answer.success
    assert meeting.do('TAKE_ROSTER', roster=read).answer.success
    assert TEAM not in rules.karts

    ended = rules.tick(meeting.now).events
    assert (race.EventKind.ALERT_CLEARED, TEAM) in [(each.kind, each.kart) for each in ended]
