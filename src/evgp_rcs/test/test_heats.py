# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Which heat is in the race."""

from __future__ import annotations

from evgp_node.encoding import read, written
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import Heat, Kart, LastRun, Race, RaceMemory
import pytest
from recorded_races import PaperRace

FIELD = {1: 'Ohm', 2: 'Volta', 3: 'Tesla', 4: 'Watt'}
PAIRS = (Heat('Heat 1', (1, 2)), Heat('Heat 2', (3, 4)))


@pytest.mark.parametrize(
    ('heats', 'in_race', 'heat'),
    [
        (PAIRS, (1, 2), 'Heat 1'),
        (PAIRS, (1,), ''),
        (PAIRS, (1, 3), ''),
        ((*PAIRS, Heat('Final', (1, 2))), (1, 2), ''),  # nobody knows which
    ],
)
def test_the_race_begins_with_the_heat_that_alone_has_its_karts(
    heats: tuple[Heat, ...], in_race: tuple[int, ...], heat: str
) -> None:
    karts = [Kart(number, in_race=number in in_race) for number in FIELD]
    assert Race(karts, heats=heats).heat == heat


def test_the_heat_in_the_race_outlives_a_crash_before_grid_active() -> None:
    paper = PaperRace(FIELD, PAIRS)
    paper.command(CommandKind.SET_HEAT, heat='Heat 2')
    again = PaperRace(FIELD, PAIRS).race

    again.recover(read(RaceMemory, written(paper.race.memory())), LastRun.UNKNOWN, 5000.0)

    assert again.heat == 'Heat 2'
