# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Whether a snapshot shows what an accepted command brought about.

That it does, of every command that the rules accept, is in test_screens.py.
"""

from __future__ import annotations

from evgp_node.results import Act
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.race import Heat
from evgp_rcs.rules.snapshot import Snapshot
from evgp_rcs_console.commands import Given, shows
from example_race import KART, RACE, replace
import pytest

GRID = replace(
    RACE,
    karts=(replace(KART, number=3, in_race=False), KART),
    heats=(Heat('A', (7,)), Heat('B', (3, 7))),
)


def with_kart(**changes: object) -> Snapshot:
    """Return a race in which some fields of kart 7 differ."""
    return replace(GRID, karts=(GRID.karts[0], replace(KART, **changes)))


def test_a_heat_is_shown_and_what_no_snapshot_tells_of_is_not_denied() -> None:
    heat = Given(CommandKind.SET_HEAT, taken={'heat': 'A'})

    assert shows(GRID, heat)
    assert not shows(with_kart(in_race=False), heat)
    assert shows(GRID, Given(Act.COUNT, 7))


@pytest.mark.parametrize('command', [each for each in CommandKind if CATALOGUE[each].is_seen])
def test_a_race_that_shows_nothing_of_a_command_is_not_mistaken_for_its_result(
    command: CommandKind,
) -> None:
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
    kart = 7 if CATALOGUE[command].to_one_kart else 0
    taken = {'heat': 'B'} if command is CommandKind.SET_HEAT else {}

    assert not shows(other, Given(command, kart, taken=taken))
