# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""For how long the answer to a command is still true."""

from __future__ import annotations

from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.race import Heat
from evgp_rcs.rules.snapshot import Snapshot
from evgp_rcs_console.commands import Given, Outcome, SETTLED
from example_race import KART, RACE, replace
import pytest

GRID = replace(
    RACE,
    karts=(replace(KART, number=3, in_race=False), KART),
    heats=(Heat('A', (7,)), Heat('B', (3, 7))),
)
GREEN = replace(GRID, state=RaceState.GREEN_GREEN)
FLAG = replace(GRID, state=RaceState.RED_FLAG)


def with_kart(**changes: object) -> Snapshot:
    """Return a race in which some fields of kart 7 differ."""
    return replace(GRID, karts=(GRID.karts[0], replace(KART, **changes)))


def test_it_stands_while_the_race_is_in_the_state_that_it_brought_about() -> None:
    green = Outcome(Given(CommandKind.GREEN_GREEN), at=10.0)

    assert [green.agrees_with(GREEN, at) for at in (10.1, 20.0, 500.0)] == [True, True, True]


def test_it_does_not_stand_any_more_once_somebody_else_has_changed_the_race() -> None:
    green = Outcome(Given(CommandKind.GREEN_GREEN), at=10.0)
    green.agrees_with(GREEN, 10.1)

    assert not green.agrees_with(FLAG, 10.2)


def test_a_snapshot_from_before_the_answer_does_not_end_it() -> None:
    green = Outcome(Given(CommandKind.GREEN_GREEN), at=10.0)

    assert green.agrees_with(GRID, 10.05)
    assert green.agrees_with(GREEN, 10.1)


def test_what_it_brought_about_may_be_gone_before_any_snapshot_shows_it() -> None:
    green = Outcome(Given(CommandKind.GREEN_GREEN), at=10.0)

    assert green.agrees_with(FLAG, 10.05)  # it could be older
    assert not green.agrees_with(FLAG, 10.0 + SETTLED)


def test_a_stop_that_found_the_race_stricter_ends_when_it_becomes_stricter_still() -> None:
    flag = Outcome(Given(CommandKind.RED_FLAG), at=10.0)
    flag.agrees_with(FLAG, 10.1)

    assert not flag.agrees_with(replace(GRID, state=RaceState.RED_RED), 10.2)


@pytest.mark.parametrize(
    ('command', 'done', 'undone'),
    [
        (CommandKind.KART_RED_RED, {'hold': RaceState.RED_RED, 'sent': RaceState.RED_RED}, {}),
        (CommandKind.KART_RED_FLAG, {'hold': RaceState.RED_FLAG, 'sent': RaceState.RED_FLAG}, {}),
        (CommandKind.KART_IN_GARAGE, {'sent': RaceState.IN_GARAGE}, {'hold': RaceState.RED_RED}),
        (CommandKind.KART_FINISH, {'place': 1}, {'place': 1, 'sent': RaceState.RED_FLAG}),
        (CommandKind.JOIN_RACE, {'in_race': True}, {'in_race': False}),
        (CommandKind.LEAVE_RACE, {'in_race': False}, {'in_race': True}),
    ],
)
def test_an_answer_about_a_kart_stands_until_that_kart_is_told_otherwise(
    command: CommandKind, done: dict[str, object], undone: dict[str, object]
) -> None:
    outcome = Outcome(Given(command, 7), at=10.0)

    assert outcome.agrees_with(with_kart(**done), 10.1)
    assert outcome.agrees_with(replace(with_kart(**done), state=RaceState.GREEN_GREEN), 10.2)
    assert not outcome.agrees_with(with_kart(**undone), 10.3)


def test_an_answer_about_the_track_stands_until_the_track_is_otherwise() -> None:
    opened = Outcome(Given(CommandKind.OPEN_TRACK), at=10.0)
    track = replace(GRID.track, open=True)

    assert opened.agrees_with(replace(GRID, track=track), 10.1)
    assert not opened.agrees_with(GRID, 10.2)


def test_an_answer_about_a_heat_stands_until_other_karts_are_in_the_race() -> None:
    heat = Outcome(Given(CommandKind.SET_HEAT, heat='A'), at=10.0)

    assert heat.agrees_with(GRID, 10.1)
    assert not heat.agrees_with(with_kart(in_race=False), 10.2)


@pytest.mark.parametrize('command', CommandKind)
def test_no_answer_stands_for_ever_in_a_race_that_shows_nothing_of_it(
    command: CommandKind,
) -> None:
    """No command is mistaken for another one."""
    result = CATALOGUE[command].result
    other = replace(
        with_kart(
            hold=None if result.hold and None not in result.hold else RaceState.RED_FLAG,
            in_race=result.in_race is False,
            place=1 if result.placed is False else 0,
        ),
        state=None,
        track=replace(GRID.track, open=result.track_open is False),
    )
    to_one_kart = CATALOGUE[command].to_one_kart
    outcome = Outcome(Given(command, 7 if to_one_kart else 0, heat='B'), at=10.0)

    assert outcome.agrees_with(other, 10.1)
    assert not outcome.agrees_with(other, 10.0 + SETTLED)
