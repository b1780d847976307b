# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What the timekeeper's window says of results on paper."""

from __future__ import annotations

from collections.abc import Iterator
import time

from evgp_node.results import (
    KartResult,
    lap_time,
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
    lap = Penalty(5, 0, 1, False, 'overtook under yellow', 'Ben')
    results = race(
        result(7, 1, 40.0, 41.25, 39.5, status=Status.CLASSIFIED),
        result(3, 2, 41.0, 42.5, 40.0),
        result(5, 3, 42.0, 41.0, penalties=(lap,)),
        result(9, 0, 41.0, status=Status.DNF),
    )
    rows = view.rows(results, TEAMS)
    assert [' | '.join(row.cells) for row in rows] == [
        '1 | 7 | Purdue | 3 | 2:00.750 |  | 0:39.500 | 0:39.500 | classified',
        '2 | 3 | Georgia Tech | 3 | 2:03.500 | +2.750 | 0:40.000 | 0:40.000 | lap 4',
        '3 | 5 |  | 1 | 1:23.000 | +2 laps | 0:41.000 | 0:41.000 | '
        'lap 3; -1 lap: overtook under yellow',
        ' | 9 |  | 1 | 0:41.000 |  | 0:41.000 | 0:41.000 | did not finish',
    ]
    assert [row.kart for row in rows if row.penalised] == [5]
    practice = race(result(5, 1, 39.0), result(7, 2, 41.0, 40.0), format=Format.PRACTICE)
    assert practice.behind(7) == '+1.000'  # between best laps


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
