# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The results of a race: who finished when, and who did not and why, as the report has them."""

from __future__ import annotations

import contextlib
import pathlib
import re
import sqlite3

from evgp_node.stream import Began
from evgp_rcs.record.report.model import Result, Why
from evgp_rcs.record.report.results import COLUMNS
from evgp_rcs.record.runs import Runs
from evgp_rcs.record.store import Session
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.inputs import Entry
from evgp_rcs.rules.race import EventKind, Heat, StampedEvent
import pytest
from recorded_races import edit, named, PaperRace, report, rows_of, tables, TEAMS, three_karts

HEATS = (Heat('Heat A', (7, 8)), Heat('Heat B', (8, 9)), Heat('Heat B again', (8, 9)))


@pytest.fixture
def paper() -> PaperRace:
    return three_karts(*HEATS)


def found(paper: PaperRace) -> dict[int, Result]:
    """Return what became of each starter of the newest race."""
    account = paper.account()
    return {result.kart: result for result in account.results(account.races[-1])}


def why(paper: PaperRace) -> dict[int, Why]:
    return {kart: each.out.why for kart, each in found(paper).items() if each.out is not None}


def race_over(paper: PaperRace) -> None:
    paper.command(CommandKind.RACE_OVER)
    paper.go_home()


def release(paper: PaperRace) -> None:
    """Release every kart that is still held."""
    for number in TEAMS:
        if paper.race.karts[number].hold is not None:
            paper.command(CommandKind.KART_IN_GARAGE, number)


def test_a_finish_that_was_undone_is_none_and_later_places_move_up(paper: PaperRace) -> None:
    paper.drive()
    paper.wait(3.0)
    paper.command(CommandKind.KART_FINISH, 9)
    paper.command(CommandKind.KART_FINISH, 8)
    paper.command(CommandKind.KART_UNDO_FINISH, 9)
    assert found(paper)[8].place == 1
    paper.wait(10.0)
    paper.command(CommandKind.KART_FINISH, 7)
    paper.command(CommandKind.KART_UNDO_FINISH, 8)
    race_over(paper)
    assert found(paper)[7].place == 1
    # The one was stopped before its finish was undone; the other drove on.
    assert why(paper) == {8: Why.FINISH_UNDONE, 9: Why.RACE_STOPPED}
    (race,) = paper.account().races
    assert [(each.event.kart, named(each)) for each in race.incidents] == [(8, 'KART_UNDO_FINISH')]


def test_only_the_first_reason_counts_and_nothing_after_a_finish_takes_its_place_away() -> None:
    paper = PaperRace(dict.fromkeys(range(1, 7), ''))
    paper.connect(*paper.race.karts)
    paper.drive()
    paper.wait(1.0)
    paper.command(CommandKind.KART_FINISH, 1)
    paper.command(CommandKind.KART_FINISH, 2)
    paper.lose(1)
    paper.command(CommandKind.KART_RED_RED, 2)
    paper.lose(3)
    paper.command(CommandKind.KART_RED_FLAG, 4)
    paper.wait(1.0)
    paper.command(CommandKind.KART_RED_RED, 3)
    paper.lose(4)
    paper.command(CommandKind.RED_FLAG)
    paper.lose(5)
    paper.command(CommandKind.KART_RED_RED, 6)
    race_over(paper)
    became = found(paper)
    assert [kart for kart, each in became.items() if each.place] == [1, 2]
    out = {
        kart: (each.out.why, named(each.out.event)) for kart, each in became.items() if each.out
    }
    assert out == {
        3: (Why.LOST, 'DISCONNECTED'),
        4: (Why.STOPPED_ALONE, 'KART_RED_FLAG'),
        5: (Why.RACE_STOPPED, 'RED_FLAG'),
        6: (Why.RACE_STOPPED, 'RED_FLAG'),
    }
    (race,) = paper.account().races
    assert list(map(named, race.incidents)) == [
        *('DISCONNECTED', 'KART_RED_RED', 'DISCONNECTED', 'KART_RED_FLAG'),
        *('KART_RED_RED', 'DISCONNECTED', 'RED_FLAG', 'DISCONNECTED', 'KART_RED_RED'),
    ]


def test_a_race_that_race_control_left_was_ended_by_that(paper: PaperRace) -> None:
    paper.drive()
    paper.end()
    assert set(why(paper).values()) == {Why.RACE_CONTROL_ENDED}


# ----- rcs_record results ---------------------------------------------------------------------


def test_the_table_has_every_race_heat_by_heat_and_so_has_the_report(
    paper: PaperRace, path: pathlib.Path
) -> None:
    paper.command(CommandKind.SET_HEAT, heat='Heat A')
    paper.drive()
    paper.wait(20.0)
    paper.command(CommandKind.KART_FINISH, 8)
    race_over(paper)
    paper.command(CommandKind.SET_HEAT, heat='Heat B')
    release(paper)
    paper.drive()
    paper.lose(9)
    record = paper.write(path)
    first, second, third, fourth = rows_of(record)
    assert set(first) == set(COLUMNS)
    told = ('run', 'race', 'heat', 'place', 'kart', 'team', 'seconds', 'result', 'complete')
    assert [first[each] for each in told] == [
        *('1', '1', 'Heat A', '1', '8', 'Michigan', '20.000', 'FINISHED', 'yes')
    ]
    assert [second[each] for each in told] == [
        *('1', '1', 'Heat A', '', '7', 'Purdue', '', 'RACE_STOPPED', 'yes')
    ]
    assert [third['result'], fourth['result']] == ['STILL_RACING', 'LOST']
    assert third['heat'] == 'Heat B'
    assert third['complete'] == 'no'
    assert re.fullmatch(r'2026-05-30T\d\d:\d\d:\d\d\.\d{3}[+-]\d\d:\d\d', first['started'])
    assert first['finished'] > first['started']
    lost = next(each for each in paper.stamped if each.event.kind is EventKind.DISCONNECTED)
    assert fourth['event'] == str(lost.sequence)
    text = report(record)
    assert 'Race 1 (<bdi>Heat A</bdi>)' in text
    assert "Race control's own report: " in text
    order, later = tables(text, 'order')
    assert [row[2] for row in order] == ['20.000 s', f'did not finish: {second["reason"]}']
    assert later[1][2] == f'did not finish: {fourth["reason"]}'


@pytest.mark.parametrize(
    ('arguments', 'runs'),
    [((), ['2', '3']), (('--all',), ['1', '2', '3']), (('--run', '2'), ['2'])],
    ids=['the day', 'all', 'one'],
)
def test_the_table_has_the_races_of_every_run_of_the_day(
    path: pathlib.Path, arguments: tuple[str, ...], runs: list[str]
) -> None:
    for _ in range(3):
        paper = PaperRace({7: 'Purdue'})
        paper.connect(7)
        paper.drive()
        paper.write(path)

    def be_long_ago(entries: list[Entry]) -> None:
        entries[:] = [
            each._replace(wall_ns=1) if isinstance(each, Began | StampedEvent) else each
            for each in entries
        ]

    edit(path, be_long_ago)
    assert [row['run'] for row in rows_of(path, *arguments)] == runs


def test_a_day_ends_with_hours_without_race_control_and_not_at_midnight(
    tmp_path: pathlib.Path,
) -> None:
    began = (0, 20, 23, 25, 40)  # hours; each run takes one
    times = [(at * 3600 * 10**9, (at + 1) * 3600 * 10**9) for at in began]
    listed = [Session(n, at, None, 1, end, str(n)) for n, (at, end) in enumerate(times)]
    with contextlib.closing(sqlite3.connect(':memory:')) as database:
        runs = Runs(tmp_path, database, listed)
        days = [[each.number for each in runs.day_of(run)] for run in listed]
    assert days == [[0], [1, 2, 3], [1, 2, 3], [1, 2, 3], [4]]
