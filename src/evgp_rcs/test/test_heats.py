# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Standings over heats, and the order of start that follows from results."""

from __future__ import annotations

import dataclasses
import json
import pathlib
import re

from evgp_node.encoding import read, written
from evgp_rcs.rcs_record import main
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.laps import (
    Format,
    Heats,
    KartResult,
    Laps,
    LapSettings,
    LapsMemory,
    MOST_HEATS,
    MOST_OF_HEATS,
    overall,
)
from evgp_rcs.rules.race import Answer, Command, Heat, Kart, LastRun, Race, RaceMemory
from evgp_rcs.rules.snapshot import snapshot_of, standings_of
from hypothesis import given
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


def test_a_time_trial_is_driven_in_the_order_of_practice(paper: PaperRace) -> None:
    assert grids(paper.race)['Final'] == ()  # nobody has driven its time trial
    turns = []
    for _ in range(3):
        turns.append(snapshot_of(paper.race, 0.0).next_heat)
        drives(paper, turns[-1], {int(turns[-1][-1]): 10.0 + len(turns)})

    assert turns == ['TT 3', 'TT 1', 'TT 2']
    assert snapshot_of(paper.race, 0.0).next_heat == ''
    assert standing(paper.race) == [(1, 3), (2, 1), (3, 2)]


def test_the_heat_in_the_race_is_not_next_and_one_without_a_lap_is_next_again(
    paper: PaperRace,
) -> None:
    begins(paper, 'TT 3')
    assert snapshot_of(paper.race, 0.0).next_heat == 'TT 1'

    paper.command(CommandKind.ALL_KILL)
    paper.go_home()
    begins(paper, 'TT 1')

    assert snapshot_of(paper.race, 0.0).next_heat == 'TT 3'


def test_the_grid_is_the_order_of_the_results_and_behind_it_who_has_none(paper: PaperRace) -> None:
    drives(paper, 'TT 3', {3: 12.0})
    drives(paper, 'TT 2', {2: 11.0})

    assert grids(paper.race)['Final'] == (2, 3, 1)
    begins(paper, 'Final')
    assert paper.race.laps.grid == (2, 3, 1)
    assert standings_of(paper.race, 0.0).grid == (2, 3, 1)


def test_no_kart_is_sent_anything_because_of_an_order_of_start() -> None:
    """The same event, with and without it."""
    sent = []
    for heats in (HEATS, tuple(dataclasses.replace(heat, grid_from='') for heat in HEATS)):
        paper = PaperRace({1: 'Ohm', 2: 'Volta', 3: 'Tesla'}, heats)
        paper.connect(1, 2, 3)
        drives(paper, 'Practice', {1: 11.0, 2: 12.0, 3: 10.0})
        begins(paper, 'TT 3')
        sent.append([(each.event.kart, each.event.state) for each in paper.stamped])
    assert sent[0] == sent[1]


def test_a_correction_of_the_race_under_way_is_in_the_standing_at_once(paper: PaperRace) -> None:
    drives(paper, 'TT 3', {3: 12.0})
    drives(paper, 'TT 1', {1: 11.0})
    assert standing(paper.race) == [(1, 1), (2, 3)]

    assert answer(paper, CommandKind.PENALISE, 1, seconds=5, reason='a cone').success
    assert standing(paper.race) == [(1, 3), (2, 1)]
    assert answer(paper, CommandKind.UNDO_PENALTY, 1).success
    assert standing(paper.race) == [(1, 1), (2, 3)]


def test_a_kart_is_penalised_in_an_earlier_heat_by_its_name_and_the_record_has_it(
    paper: PaperRace, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drives(paper, 'TT 3', {3: 11.0})
    drives(paper, 'TT 1', {1: 12.0})
    late = {'heat': 'TT 3', 'seconds': 5, 'reason': 'a cone'}

    assert not answer(paper, CommandKind.PENALISE, 1, **late).success  # it was not in that heat
    assert not answer(paper, CommandKind.PENALISE, 3, **late | {'heat': 'TT 9'}).success
    assert not answer(paper, CommandKind.PENALISE, 3, **late | {'heat': ''}).success
    for kind in (CommandKind.PENALISE, CommandKind.UNDO_PENALTY, CommandKind.PENALISE):
        assert answer(paper, kind, 3, **late).success
    assert standing(paper.race) == [(1, 1), (2, 3)]

    file = str(paper.write(tmp_path / 'record.sqlite3'))
    assert main(['replay', file]) == 0
    capsys.readouterr()
    assert main(['laps', file, '--json']) == 0
    rows = {row['heat']: row for row in json.loads(capsys.readouterr().out)}
    assert rows['TT 3']['penalties'] == ['+5 s: a cone (Anna)']
    assert (rows['TT 3']['overall'], rows['TT 1']['overall']) == (2, 1)


def test_the_last_race_of_a_heat_counts_unless_nobody_had_a_lap(
    paper: PaperRace, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drives(paper, 'TT 3', {3: 11.0})
    drives(paper, 'TT 3', {3: 12.0})
    begins(paper, 'TT 3')
    paper.command(CommandKind.ALL_KILL)
    paper.go_home()

    (result,) = standings_of(paper.race, 0.0).overall
    assert result.total == pytest.approx(24.0)
    begins(paper, 'TT 1')
    assert standings_of(paper.race, 0.0).overall == (result,)
    assert main(['laps', str(paper.write(tmp_path / 'record.sqlite3')), '--json']) == 0
    rows = [row for row in json.loads(capsys.readouterr().out) if row['heat'] == 'TT 3']
    assert [(row['total'], row['overall']) for row in rows] == [(22.0, 0), (24.0, 1), (None, 0)]


@pytest.mark.parametrize('under_way', [False, True])
def test_after_a_restart_the_standing_and_the_order_of_start_are_as_before(
    paper: PaperRace, under_way: bool
) -> None:
    drives(paper, 'TT 3', {3: 12.0})
    drives(paper, 'TT 1', {1: 11.0})
    if under_way:
        begins(paper, 'Final')
    before = paper.race
    again = PaperRace({1: 'Ohm', 2: 'Volta', 3: 'Tesla'}, HEATS).race

    again.recover(read(RaceMemory, written(before.memory())), LastRun.UNKNOWN, 5000.0)

    assert grids(again) == grids(before)
    assert again.laps.grid == before.laps.grid
    assert again.laps.standings(Format.TIME_TRIAL) == before.laps.standings(Format.TIME_TRIAL)
    assert again.memory().heats == before.memory().heats


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


def test_what_a_green_writes_has_the_results_too(paper: PaperRace) -> None:
    """Race control may die before anything else is written."""
    paper.command(CommandKind.SET_HEAT, heat='TT 3')
    paper.command(CommandKind.GRID_ACTIVE)
    paper.acknowledge()
    kept = paper.race.memory().heats
    seen = paper.race.availability(CommandKind.GREEN_GREEN, 0, paper.now).karts

    outcome = paper.race.command(
        Command(CommandKind.GREEN_GREEN, karts=frozenset(seen)), paper.now
    )

    assert outcome.start is not None
    assert outcome.start.memory.heats == kept != ()


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


@given(RACES, st.sampled_from(Format))
def test_a_standing_has_the_last_race_with_a_lap_of_each_heat(
    races: list[Laps], format_: Format
) -> None:
    heats = Heats()
    for each in races[:-1]:
        heats, forgotten = heats.keep(each)
        assert not forgotten
    last = dataclasses.replace(races[-1], heats=heats)

    found = last.standings(format_)

    counts: dict[str, Laps] = {}
    for each in races:
        if each.heat and any(result.lap_times for result in each.results):
            counts[each.heat] = each
    results = [
        result for each in counts.values() if each.format is format_ for result in each.results
    ]
    # Karts' results that are equal to the millisecond may be of either heat.
    assert {_shown(each) for each in found} == {_shown(each) for each in overall(format_, results)}
    assert sorted({each.kart for each in results}) == sorted(each.kart for each in found)


@given(st.integers(0, 400), st.integers(0, MOST_OF_HEATS))
def test_what_is_kept_is_bounded_and_the_oldest_is_forgotten_and_told(
    count: int, crossings: int
) -> None:
    one = raced('', Format.RACE, {1: max(1, crossings - 1)}).memory()
    kept = Heats(tuple(one._replace(heat=f'old {number}') for number in range(count)))

    heats, forgotten = kept.keep(raced('new', Format.RACE, {1: 1}))

    names = [each.heat for each in heats.kept]
    assert names + forgotten == ['new', *(f'old {number}' for number in range(count))]
    assert len(names) <= MOST_HEATS
    assert sum(len(each.crossed[1]) for each in heats.kept) <= MOST_OF_HEATS


def test_a_heat_that_is_larger_than_all_that_is_kept_is_kept_alone() -> None:
    large = raced('large', Format.RACE, {1: MOST_OF_HEATS + 1})
    heats, forgotten = Heats().keep(raced('small', Format.RACE, {1: 1}))[0].keep(large)
    assert ([each.heat for each in heats.kept], forgotten) == (['large'], ['small'])


def test_what_is_forgotten_is_said_when_the_next_race_begins(paper: PaperRace) -> None:
    kept = tuple(
        raced(f'old {number}', Format.RACE, {1: 1}).memory() for number in range(MOST_HEATS)
    )
    paper.race.laps = dataclasses.replace(paper.race.laps, heats=Heats(kept))

    begun = paper.command(CommandKind.GRID_ACTIVE).answer

    assert begun is not None
    assert re.search(rf'old {MOST_HEATS - 1}\b', begun.message)
