# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A stop is sent again until race control accepts it, and a command waits for its answer."""

from __future__ import annotations

import math

from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs_console.commands import (
    CERTAIN,
    Given,
    OUTLIVES,
    PRESS_AGAIN,
    RaceBegan,
    request,
    Standing,
    StandingStops,
    Unanswered,
)
import pytest

STOPS = [kind for kind, entry in CATALOGUE.items() if entry.stop]


def found(_: Given) -> bool:
    return True


def kart_of(command: CommandKind) -> int:
    """Return kart 7 for a command to one kart, 0 for any other."""
    return 7 if CATALOGUE[command].to_one_kart else 0


@pytest.mark.parametrize('command', STOPS)
def test_every_stop_is_pressed_again_until_it_is_accepted(command: CommandKind) -> None:
    stops = StandingStops()
    given = Given(command, kart_of(command), at=0.0)
    other = Given(CommandKind.KART_RED_RED, 8, at=0.0)
    stops.add(given, 0.0)
    stops.add(other, 0.0)
    assert stops.press(0.0, found) == [given, other]
    assert stops.accepted(other)

    for n in range(1, 4):
        assert stops.press(PRESS_AGAIN * n, found) == [given]
        assert stops.press(PRESS_AGAIN * (n + 1) - 0.01, found) == []
    assert stops.next_press(PRESS_AGAIN * 3 + 0.1) == pytest.approx(PRESS_AGAIN - 0.1)
    (stop,) = stops.pressed
    assert (stop.presses, stop.since) == (4, 0.0)
    assert stops.accepted(given)
    assert stops.press(99.0, found) == []
    assert stops.next_press(99.0) == PRESS_AGAIN
    assert [request(given, at)['age'] for at in (-1.0, 0.0, 65.0)] == [0.0, 0.0, 65.0]


def test_an_official_who_presses_again_waits_for_the_answer_to_that() -> None:
    stops = StandingStops()
    first, second = Given(CommandKind.ALL_KILL, at=0.0), Given(CommandKind.ALL_KILL, at=5.0)
    stops.add(first, 0.0)
    stops.press(0.0, found)
    stops.add(second, 5.0)

    assert stops.press(5.0, found) == [second]
    assert not stops.accepted(first)
    (stop,) = stops.pressed
    assert (stop.presses, stop.since) == (2, 0.0)
    assert stops.accepted(second)


def test_a_stop_that_failed_is_pressed_on_and_says_why_until_it_is_refused_for_good() -> None:
    stops = StandingStops()
    given = Given(CommandKind.KART_RED_RED, 99, at=0.0)
    stops.add(given, 0.0)

    stops.refused(given, 'race control ends', final=False)

    (stop,) = stops.pressed
    assert stop.said == 'race control ends'
    assert stops.press(PRESS_AGAIN, found) == [given]
    stops.refused(given, 'there is no kart 99 in the roster', final=True)
    assert stops.pressed == ()


@pytest.mark.parametrize(
    ('later', 'kart', 'ended'),
    [
        (CommandKind.GRID_ACTIVE, 0, {*STOPS} - {CommandKind.ALL_KILL, CommandKind.RECORD_MSR}),
        (CommandKind.GREEN_GREEN, 0, {*STOPS} - {CommandKind.ALL_KILL, CommandKind.RECORD_MSR}),
        (CommandKind.IN_GARAGE, 0, {*STOPS} - {CommandKind.ALL_KILL, CommandKind.RECORD_MSR}),
        (CommandKind.KART_IN_GARAGE, 7, {CommandKind.KART_RED_RED, CommandKind.KART_RED_FLAG}),
        (CommandKind.KART_IN_GARAGE, 8, set()),
    ],
)
def test_what_an_official_loosens_later_ends_the_stops_given_before_that_it_undoes(
    later: CommandKind, kart: int, ended: set[CommandKind]
) -> None:
    stops = StandingStops()
    for command in STOPS:
        stops.add(Given(command, kart_of(command), at=0.0), 0.0)

    stops.accepted(Given(later, kart, at=0.0))
    assert len(stops.pressed) == len(STOPS)  # none of them was given before
    assert stops.accepted(Given(later, kart, at=1.0)) is bool(ended)

    assert {*STOPS} - {stop.given.command for stop in stops.pressed} == ended


def test_what_a_press_has_waited_in_a_window_is_told_and_ends_no_stop() -> None:
    given = Given(CommandKind.ALL_KILL, at=100.0, waited=60.0)
    stops = StandingStops()
    stops.add(Given(CommandKind.ALL_KILL, at=0.0), 0.0)
    stops.add(given, 100.0)  # an old stop that is pressed again is a new one

    assert request(given, 101.0)['age'] == 61.0
    assert stops.superseded(99.0, 120.0) == []
    assert stops.waits(given)


@pytest.mark.parametrize('command', STOPS)
def test_an_old_stop_ends_where_a_later_race_has_certainly_begun(command: CommandKind) -> None:
    given = Given(command, kart_of(command), at=100.0)
    stops = StandingStops()
    stops.add(given, 100.0)

    for begun, at in (
        (-math.inf, 200.0),  # no race has begun in this run of race control
        (90.0, 200.0),  # it is the race of the press
        (100.0 + CERTAIN, 200.0),  # it may be: the snapshot may have been under way for as long
        (109.0, 100.0 + OUTLIVES),  # it is later, but the press is not old
    ):
        assert stops.superseded(begun, at) == []
    assert stops.waits(given)

    assert stops.superseded(106.0, 111.0) == [given]
    assert stops.pressed == ()


@pytest.mark.parametrize('comes', [True, False], ids=['it comes', 'none comes'])
def test_only_an_old_stop_waits_for_a_snapshot_once_race_control_is_found_again(
    comes: bool,
) -> None:
    given = Given(CommandKind.ALL_KILL, at=0.0)
    stops = StandingStops()
    stops.add(given, 0.0)
    for n in range(int(OUTLIVES / PRESS_AGAIN) + 1):
        assert stops.press(n * PRESS_AGAIN, lambda _, n=n: n % 2 == 0) == [given]
    sent = []
    for at in (20.0, 20.5, 21.0, 21.5, 22.0, 22.5, 23.0):
        if comes and at == 21.5:
            stops.superseded(-math.inf, at)
        sent.append(bool(stops.press(at, lambda _, at=at: at > 20.0)))

    assert sent == [False, False, False, comes, comes, True, True]


def test_when_a_race_began_is_known_by_the_snapshot_that_came_fastest() -> None:
    began = RaceBegan()
    # Their clock is 1000 s ahead of ours.
    assert began.hear(1100.0, None, 100.2) == -math.inf
    assert began.hear(1150.0, 1140.0, 150.1) == pytest.approx(140.1)
    # A snapshot that waited for a minute, as during a suspend, makes no race seem later.
    assert began.hear(1160.0, 1140.0, 220.0) == pytest.approx(140.1)


@pytest.mark.parametrize('step', [-7200.0, 7200.0], ids=['back', 'forward'])
def test_a_clock_of_race_control_that_is_set_makes_no_race_seem_later(step: float) -> None:
    began = RaceBegan()
    began.hear(1100.0, 1090.0, 100.0)

    assert began.hear(1110.0 + step, 1090.0 + step, 110.0) <= 90.0


def test_what_one_answer_confirms_is_sent_one_after_another_as_one_press() -> None:
    then = tuple(Given(CommandKind.KART_IN_GARAGE, kart, at=0.0) for kart in (1, 2))
    sent = [Given(CommandKind.IN_GARAGE, official='Anna', then=then, at=5.0)]
    while follows := sent[-1].followed_by():
        sent.append(follows)

    assert [(each.kart, each.official, each.at) for each in sent] == [
        (kart, 'Anna', 5.0) for kart in (0, 1, 2)
    ]


def test_the_answer_to_an_older_press_leaves_the_newer_one_waiting() -> None:
    unanswered = Unanswered()
    older, newer = (Given(CommandKind.RACE_OVER, at=at) for at in (1.0, 2.0))
    for given in (older, newer):
        unanswered.add(given)

    unanswered.answered(older)
    assert unanswered.ages(5.0) == {(CommandKind.RACE_OVER, 0): 3.0}
    unanswered.answered(newer)
    assert not unanswered


def test_what_has_waited_longest_is_told_once_it_is_late() -> None:
    unanswered = Unanswered()
    older, newer = Given(CommandKind.RACE_OVER, at=1.0), Given(CommandKind.JOIN_RACE, 7, at=1.1)
    unanswered.add(newer)
    unanswered.add(older)
    kill = Standing(Given(CommandKind.ALL_KILL), since=1.0)
    flag = Standing(Given(CommandKind.RED_FLAG), since=2.0)
    unanswered.stops = (kill, flag)

    for at, command, stops in ((1.2, None, []), (2.2, older, [kill]), (3.2, older, [kill, flag])):
        assert unanswered.oldest(at) is command
        assert unanswered.late_stops(at) == stops
