# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Standings over heats, and the order of start that follows from results."""

from __future__ import annotations

from evgp_node.encoding import read, written
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.laps import (
    Format,
    KartResult,
    Laps,
    LapSettings,
    LapsMemory,
)
from evgp_rcs.rules.race import Answer, Heat, Kart, LastRun, Race, RaceMemory
from evgp_rcs.rules.snapshot import snapshot_of, standings_of
from hypothesis import strategies as st
import pytest
from recorded_races import PaperRace

HEATS = (
    Heat('Practice', (1, 2, 3), Format.PRACTICE),
    *(Heat(f'TT {kart}', (kart,), Format.TIME_TRIAL, 2, 'Practice') for kart in (1, 2, 3)),
    Heat('Final', (1, 2, 3), Format.RACE, 3, 'time_trial'),
)


def drives(paper: PaperRace, heat: str, laps: dict[int, float], count: int = 2) -> None:
    """Have each kart drive laps of its own time, from the garage to RED_RED."""
    begins(paper, heat)
    at = sorted((lap * number, kart) for kart, lap in laps.items() for number in range(count + 1))
    begun = paper.now
    for after, kart in at:
        paper.wait(max(0.0, begun + 3.0 + after - paper.now))
        paper.cross(kart)
    paper.command(CommandKind.ALL_KILL)
    paper.go_home()


def begins(paper: PaperRace, heat: str) -> None:
    paper.command(CommandKind.SET_HEAT, heat=heat)
    paper.drive()


def standing(race: Race) -> list[tuple[int, int]]:
    """Return place and kart of each result over all heats of the present format."""
    return [(each.place, each.kart) for each in standings_of(race, 0.0).overall]


def grids(race: Race) -> dict[str, tuple[int, ...]]:
    found = [heat.grid for heat in snapshot_of(race, 0.0).heats]
    return {heat.name: grid for heat, grid in zip(race.heats, found, strict=True)}


def answer(paper: PaperRace, kind: CommandKind, kart: int, **fields: object) -> Answer:
    found = paper.command(kind, kart, 'Anna', **fields).answer
    assert found is not None
    return found


@pytest.fixture
def paper() -> PaperRace:
    """Return an event in which 3 was best in practice, then 1, then 2."""
    paper = PaperRace({1: 'Ohm', 2: 'Volta', 3: 'Tesla'}, HEATS)
    paper.connect(1, 2, 3)
    drives(paper, 'Practice', {1: 11.0, 2: 12.0, 3: 10.0})
    return paper


FIELD = {1: 'Ohm', 2: 'Volta', 3: 'Tesla', 4: 'Watt'}
PAIRS = (Heat('Heat 1', (1, 2), laps=3), Heat('Heat 2', (3, 4), laps=3))


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


def test_a_heat_is_in_the_race_until_a_kart_of_another_one_is_or_none_at_all() -> None:
    paper = PaperRace(FIELD, PAIRS)

    def after(*given: tuple[CommandKind, int]) -> str:
        for kind, kart in given:
            paper.command(kind, kart)
        assert snapshot_of(paper.race, paper.now).heat == paper.race.heat
        return paper.race.heat

    join, leave = CommandKind.JOIN_RACE, CommandKind.LEAVE_RACE
    paper.command(CommandKind.SET_HEAT, heat='Heat 1')
    assert after((leave, 2)) == 'Heat 1'  # it broke down
    assert after((join, 3)) == ''
    assert after((leave, 3)) == 'Heat 1'
    assert after((leave, 1)) == ''
    assert after((join, 3), (join, 4)) == ''
    paper.command(CommandKind.GRID_ACTIVE)
    assert paper.race.laps.heat == ''


def test_the_heat_in_the_race_outlives_a_crash_before_grid_active() -> None:
    paper = PaperRace(FIELD, PAIRS)
    paper.command(CommandKind.SET_HEAT, heat='Heat 2')
    again = PaperRace(FIELD, PAIRS).race

    again.recover(read(RaceMemory, written(paper.race.memory())), LastRun.UNKNOWN, 5000.0)

    assert again.heat == 'Heat 2'


# ----- the pure part --------------------------------------------------------------------------


def raced(heat: str, format_: Format, laps: dict[int, int], start: float = 0.0) -> Laps:
    """Return the laps of a race that has ended: so many of each kart, each a bit slower."""
    crossed = {
        kart: tuple(start + number * (10.0 + kart) for number in range(count + 1))
        for kart, count in laps.items()
    }
    return Laps.recall(LapsMemory(format_, 0, crossed, tuple(laps), (), heat), LapSettings(), 0.0)


RACES = st.lists(
    st.builds(
        raced,
        st.sampled_from(('', 'A', 'B', 'C')),
        st.sampled_from(Format),
        st.dictionaries(st.integers(1, 4), st.integers(0, 2), max_size=3),
        st.floats(0.0, 9.0),
    ),
    min_size=1,
    max_size=6,
)


def _shown(result: KartResult) -> tuple[object, ...]:
    total, best = (each and round(each, 3) for each in (result.total, result.best))
    return result.kart, result.place, result.status, result.laps, total, best
