# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What the timekeeper's window says of results on paper."""

from __future__ import annotations

from collections.abc import Iterator
import time

from evgp_node.results import (
    Act,
    BY_HAND,
    Judged,
    KartResult,
    lap_time,
    Mark,
    Passing,
    Penalty,
    RaceOfEvent,
    Standings,
    Status,
)
from evgp_node.roster import Format
from evgp_timing import window_view as view
import pytest

TEAMS = {7: 'Purdue', 3: 'Georgia Tech'}
AT_14_31 = 1_780_065_060.0
"""14:31 on 29 May 2026 in UTC."""


@pytest.fixture(autouse=True)
def utc(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Have this process be in a time zone that is known."""
    with monkeypatch.context() as changed:
        changed.setenv('TZ', 'UTC')
        time.tzset()
        yield
    time.tzset()


def result(
    kart: int,
    place: int,
    *laps: float,
    status: Status = Status.RUNNING,
    penalties: tuple[Penalty, ...] = (),
) -> KartResult:
    counted = len(laps) - sum(each.laps for each in penalties)
    return KartResult(kart, place, status, counted, sum(laps) if laps else None, laps, penalties)


def race(*karts: KartResult, **fields: object) -> Standings:
    races = (RaceOfEvent(1, 'Heat 2', AT_14_31, 0, False),)
    seen = Standings(1.0, 'run', 1, 'Heat 2', laps=3, karts=karts, races=races)
    return seen._replace(**fields)  # type: ignore[arg-type]


def cell(results: Standings, kart: int, heading: str) -> str:
    (row,) = (each for each in view.rows(results, TEAMS) if each.kart == kart)
    return row.cells[view.HEADINGS.index(heading)]


def seen(kart: int, number: int, mark: Mark = Mark.COUNTED, **fields: object) -> Judged:
    passing = Passing('line', 'today', number, 0, f'100{kart}' if kart else '')
    judged = Judged(passing, kart, mark, 60.0 * number, '')
    return judged._replace(**fields)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ('seconds', 'digits', 'text'),
    [
        (65.0309, 3, '1:05.031'),
        (59.9996, 3, '1:00.000'),
        (-1.04, 1, '-0:01.0'),
        (252.4, 0, '4:12'),
        (None, 3, ''),
        (float('inf'), 3, ''),
    ],
)
def test_a_time_is_minutes_and_seconds(seconds: float | None, digits: int, text: str) -> None:
    assert lap_time(seconds, digits) == text


def test_a_row_has_what_the_timekeeper_says_of_a_kart() -> None:
    results = race(result(7, 1, 40.0, 41.25, 39.5, status=Status.CLASSIFIED), result(3, 2, 42.0))
    first, second = view.rows(results, TEAMS)
    assert first.cells == (
        *('1', '7', 'Purdue', '3', '2:00.750', ''),
        *('0:39.500', '0:39.500', 'classified'),
    )
    assert second.cells == (
        *('2', '3', 'Georgia Tech', '1', '0:42.000', '+2 laps'),
        *('0:42.000', '0:42.000', 'lap 2'),
    )


def test_a_gap_is_in_laps_or_seconds_in_practice_between_best_laps_and_none_without_a_place() -> (
    None
):
    out = result(9, 0, 41.0, status=Status.DNF)
    results = race(result(7, 1, 40.0, 40.0), result(3, 2, 41.0, 42.5), result(5, 3, 39.0), out)
    assert [cell(results, kart, 'GAP') for kart in (3, 5, 9)] == ['+3.500', '+1 lap', '']
    assert cell(results, 9, 'STATUS') == 'did not finish'
    practice = race(result(5, 1, 39.0), result(7, 2, 41.0, 40.0), format=Format.PRACTICE)
    assert cell(practice, 7, 'GAP') == '+1.000'


def test_a_lap_that_was_taken_away_is_still_the_lap_of_its_crossing() -> None:
    lap = Penalty(7, 0, 1, False, 'overtook under yellow', 'Ben')
    results = race(
        result(7, 1, 40.0, 41.0, penalties=(lap,)),
        result(3, 2, 40.0),
        passings=(seen(7, 1), seen(7, 2), seen(7, 3)),
    )
    assert cell(results, 7, 'LAPS') == '1'
    assert cell(results, 7, 'STATUS') == 'lap 3; -1 lap: overtook under yellow'
    assert [row.penalised for row in view.rows(results, TEAMS)] == [True, False]
    assert next(view.crossings(results)).text == 'lap 2, 0:41.000'


def test_crossings_are_newest_first_each_with_the_lap_that_it_ended() -> None:
    results = race(
        result(7, 1, 40.0, 41.0, 42.0),
        result(3, 2, 43.0),
        passings=(seen(3, 1), *(seen(7, number) for number in (2, 3, 4, 5)), seen(3, 6)),
    )
    found = [*view.crossings(results)]
    assert [(each.at, each.kart, each.text) for each in found] == [
        ('6:00.0', '3', 'lap 1, 0:43.000'),
        ('5:00.0', '7', 'lap 3, 0:42.000: finish'),
        ('4:00.0', '7', 'lap 2, 0:41.000'),
        ('3:00.0', '7', 'lap 1, 0:40.000'),
        ('2:00.0', '7', 'starts lap 1'),
        ('1:00.0', '3', 'starts lap 1'),
    ]
    assert str(found[4]) == 'Kart 7 at 2:00.0: starts lap 1 (line 2)'  # as a dialog names it
    # Also where only the last passings are there, they are of the last laps.
    last = results._replace(passings=results.passings[-3:])
    assert [*view.crossings(last)] == found[:3]


def test_what_does_not_count_ends_no_lap_and_says_why() -> None:
    results = race(
        result(7, 1, 40.0),
        passings=(
            seen(7, 1),
            seen(7, 2, Mark.STRUCK, struck='seen twice (Ben)'),
            seen(7, 3, Mark.DOUBTFUL),
            seen(0, 4, Mark.UNKNOWN, passing=Passing('line', 'today', 4, 0, '4711')),
            seen(0, 5, Mark.UNKNOWN),
            seen(7, 6, Mark.NOT_COUNTED),
            seen(7, 7, passing=Passing(BY_HAND, 'run 1', 1, 7)),
        ),
    )
    assert [(each.kart, each.text, each.act) for each in view.crossings(results)] == [
        ('7', 'by hand, lap 1, 0:40.000', Act.STRIKE),
        ('7', 'not counted', Act.STRIKE),
        ('?', 'kart unknown', Act.STRIKE),
        ('?', 'transponder 4711', Act.GIVE),
        ('7', 'doubtful: too soon after the last crossing', Act.STRIKE),
        ('7', 'struck: seen twice (Ben)', Act.RESTORE),
        ('7', 'starts lap 1', Act.STRIKE),
    ]


def test_the_header_says_which_race_it_is_and_whether_its_results_are_published() -> None:
    results = race(result(7, 1, 40.0))
    assert view.title(results) == 'Heat 2'
    assert view.about(results, 'GREEN GREEN 4:12') == (
        'race to 3 laps · run of 14:31 · GREEN GREEN 4:12'
    )
    published = results._replace(format=Format.TIME_TRIAL, laps=0, published=True)
    assert view.about(published, 'over') == (
        'time trial · run of 14:31 · over · results published'
    )


def test_a_correction_is_of_the_race_that_was_run_not_of_the_grid_that_forms() -> None:
    first, second = (
        RaceOfEvent(1, 'Heat 1', AT_14_31, 4, True),
        RaceOfEvent(2, '', AT_14_31 + 60, 0, False),
    )
    results = race(result(7, 1, 40.0), races=(first, second))
    assert view.races(results) == [
        ('Race, run of 14:32: 0 classified', 2),
        ('Heat 1, run of 14:31: 4 classified, counts', 1),
    ]
    assert view.newest_with_results(results) == 2
    assert view.newest_with_results(results._replace(karts=())) == 1
    assert view.newest_with_results(Standings()) == 0


def test_a_kart_can_be_chosen_also_where_race_control_is_not_heard() -> None:
    results = race(result(9, 1, 40.0))
    assert view.karts(results, TEAMS) == [('3  Georgia Tech', 3), ('7  Purdue', 7), ('9', 9)]
