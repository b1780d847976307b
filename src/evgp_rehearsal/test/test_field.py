# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulated karts: what they do with what they are sent, and what they say."""

from __future__ import annotations

import itertools
import math

from evgp_protocol.states import RaceState
from evgp_rehearsal.field import Connected, CREEP, Fault, Field, TICK_LENGTH
from evgp_rehearsal.incidents import can_begin, choose_kart, INCIDENTS, LASTS, script_of
from evgp_rehearsal.plan import Plan, Track
import pytest

TOP = math.inf
"""A kart's own top speed."""

SQUARE = Track(((0.0, 0.0), (30.0, 0.0), (30.0, 30.0), (0.0, 30.0)))


def the_field(karts: int = 2, seed: int = 1) -> Field:
    """Return a field on a square track."""
    return Field(Plan(SQUARE, karts=karts, laps=1, seed=seed))


def run(field: Field, seconds: float) -> list[tuple[int, RaceState]]:
    """Let time pass, and return what karts say."""
    return [said for _ in range(round(seconds / TICK_LENGTH)) for said in field.step()]


def send(field: Field, state: RaceState) -> None:
    for number in field.karts:
        field.hear(number, state)


def test_a_point_of_the_track_is_on_its_line() -> None:
    assert SQUARE.length == 120.0
    assert SQUARE.point(45.0) == (30.0, 15.0)
    assert SQUARE.point(-30.0) == (0.0, 30.0)
    assert SQUARE.point(240.0) == (0.0, 0.0)


def test_a_kart_acknowledges_what_it_has_reached_and_each_once() -> None:
    field = the_field(1)
    for state in (RaceState.GRID_ACTIVE, RaceState.GREEN_GREEN):
        send(field, state)
        assert run(field, 5.0) == [(1, state)]
    kart = field.karts[1]
    for state in (RaceState.RED_FLAG, RaceState.RED_RED):
        send(field, RaceState.GREEN_GREEN)
        run(field, 5.0)
        assert kart.moves
        send(field, state)
        said = []
        while not said:
            said = field.step()
            assert bool(said) is not kart.moves
        assert said == [(1, state)]


def test_red_red_stops_within_a_shorter_way_than_red_flag() -> None:
    ways = []
    for state in (RaceState.RED_FLAG, RaceState.RED_RED):
        field = the_field(1)
        send(field, RaceState.GREEN_GREEN)
        run(field, 5.0)
        before = field.karts[1].distance
        send(field, state)
        run(field, 20.0)
        ways.append(field.karts[1].distance - before)
    assert ways[1] < ways[0] / 2


def test_a_kart_that_loses_its_connection_stops_by_itself() -> None:
    field = the_field(1)
    send(field, RaceState.GREEN_GREEN)
    run(field, 5.0)
    field.karts[1].drop()
    assert run(field, 10.0) == []
    assert not field.karts[1].moves


@pytest.mark.parametrize('fault', [Fault.IGNORES_RED, Fault.MUTE])
def test_a_kart_that_does_not_answer_a_red_says_nothing_and_the_msr_stops_it(fault: Fault) -> None:
    field = the_field(1)
    send(field, RaceState.GREEN_GREEN)
    run(field, 5.0)
    field.karts[1].faults |= {fault, Fault.MUTE}
    send(field, RaceState.RED_RED)
    assert run(field, 10.0) == []
    assert field.karts[1].moves is (fault is Fault.IGNORES_RED)
    field.use_msr()
    run(field, 10.0)
    assert not field.karts[1].moves


@pytest.mark.parametrize(
    ('fault', 'state', 'speed', 'connected'),
    [
        (Fault.CREEPS, RaceState.GRID_ACTIVE, CREEP, Connected.KART),
        (Fault.SLOW, RaceState.GREEN_GREEN, CREEP, Connected.KART),
        (Fault.STUCK, RaceState.GREEN_GREEN, 0.0, Connected.KART),
        (Fault.SPUN, RaceState.GREEN_GREEN, 0.0, Connected.KART),
        (Fault.IGNORES_FLAG, RaceState.RED_FLAG, TOP, Connected.KART),
        (Fault.IGNORES_FLAG, RaceState.RED_RED, 0.0, Connected.KART),
        (Fault.OFFLINE, RaceState.RED_RED, 0.0, Connected.NOBODY),
        (Fault.REPLACED, RaceState.RED_RED, 0.0, Connected.STRANGER),
    ],
)
def test_a_fault_shows_in_how_a_kart_moves_or_in_who_is_connected(
    fault: Fault, state: RaceState, speed: float, connected: Connected
) -> None:
    field = the_field(1)
    kart = field.karts[1]
    send(field, RaceState.GREEN_GREEN)
    run(field, 5.0)
    kart.faults.add(fault)
    send(field, state)
    run(field, 10.0)
    wanted = kart.ability.top if speed is TOP else speed
    assert (kart.speed, kart.link(field.tick)) == (wanted, connected)


def test_karts_differ_by_the_seed_and_by_nothing_else() -> None:
    assert the_field(5).karts == the_field(5).karts
    assert the_field(5).karts[2] != the_field(5, seed=2).karts[2]
    # What one kart can do does not depend on which of the others are simulated.
    only = Field(Plan(SQUARE, karts=5), [3])
    assert only.karts[3] == Field(Plan(SQUARE, karts=5)).karts[3]


def test_incidents_of_the_command_line_do_not_cut_each_other_short() -> None:
    first, second = script_of(['spin', 'wifi_gone'])
    assert second.at - first.at == pytest.approx(LASTS * TICK_LENGTH)


def test_the_last_lap_is_the_leaders_among_those_that_still_race() -> None:
    field, slow = the_field(3), INCIDENTS['slow_leader']
    send(field, RaceState.GREEN_GREEN)
    run(field, 5.0)
    for number, distance in ((1, 130.0), (2, 60.0), (3, 50.0)):
        field.karts[number].distance = distance
    assert not can_begin(slow, field, RaceState.GREEN_GREEN)  # kart 1 has all its laps
    field.karts[2].distance = 110.0
    assert can_begin(slow, field, RaceState.GREEN_GREEN)
    assert choose_kart(field, slow) == 2
    for number in (2, 3):
        field.karts[number].distance = 130.0
    assert not can_begin(slow, field, RaceState.GREEN_GREEN)


def test_the_line_sees_each_kart_cross_it_at_its_time() -> None:
    field = the_field(2)
    send(field, RaceState.GREEN_GREEN)
    run(field, 60.0)

    for number, kart in field.karts.items():
        seen = [each for each in field.truth.crossings if each.kart == number]
        assert len(seen) == 1 + int(kart.distance // SQUARE.length)
        assert all(each.real for each in seen)
        top = SQUARE.length / kart.ability.top
        laps = [late.at - early.at for early, late in itertools.pairwise(seen)]
        assert laps[1:] == pytest.approx([top] * len(laps[1:]))


def test_a_passing_that_the_line_misses_or_makes_up_is_told_over_the_radio() -> None:
    field = the_field(2)
    send(field, RaceState.GREEN_GREEN)
    run(field, 5.0)
    field.karts[1].faults.add(Fault.UNSEEN)
    field.karts[2].faults.add(Fault.SEEN_ELSEWHERE)
    run(field, 20.0)

    for number, missed, made_up in ((1, 1, 0), (2, 0, 1)):
        seen = [each.real for each in field.truth.crossings if each.kart == number]
        assert seen.count(False) == made_up
        crossed = 1 + int(field.karts[number].distance // SQUARE.length)
        assert seen.count(True) == crossed - missed
    told = sorted(text for _, text in field.truth.messages)
    assert [text.partition(' was')[0] for text in told] == [
        'Timekeeper: kart 1 crossed the line but',
        'Timekeeper: kart 2',
    ]


def test_an_incident_can_begin_in_a_race_that_a_kart_has_left() -> None:
    field = the_field(4)
    racing = sorted(field.karts)[1:]
    for number in racing:
        field.hear(number, RaceState.GREEN_GREEN)
    run(field, 5.0)
    spin = INCIDENTS['spin']
    assert can_begin(spin, field, RaceState.GREEN_GREEN)
    assert not can_begin(spin, field, RaceState.GREEN_GREEN, kart=1)
    assert {choose_kart(field, spin) for _ in range(100)} == set(racing)


def test_a_kart_that_does_not_get_ready_is_one_on_the_grid_and_takes_its_word_back() -> None:
    field = the_field(3)
    not_ready = INCIDENTS['not_ready']
    assert not can_begin(not_ready, field, RaceState.GRID_ACTIVE)
    for number in (1, 2):  # kart 3 is not in the race
        field.hear(number, RaceState.GRID_ACTIVE)
    assert run(field, 5.0) == [(1, RaceState.GRID_ACTIVE), (2, RaceState.GRID_ACTIVE)]
    assert can_begin(not_ready, field, RaceState.GRID_ACTIVE)
    assert not can_begin(not_ready, field, RaceState.GRID_ACTIVE, kart=3)
    assert {choose_kart(field, not_ready) for _ in range(100)} == {1, 2}

    not_ready.begin(field, 2)
    assert run(field, 20.0) == [(2, RaceState.RED_RED)]
    field.mend()
    assert run(field, 5.0) == [(2, RaceState.GRID_ACTIVE)]
