# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What pages show: the order, the words, and what nobody is to see."""

from __future__ import annotations

import json
import math
from typing import Any

from evgp_board import view
from evgp_board.view import Heard
from evgp_node.codec import value_of
from evgp_node.results import KartResult, Penalty, Standings, Status
from evgp_node.roster import Format
from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState as S
from evgp_rcs.rules.link_quality import NOT_MEASURED
from evgp_rcs.rules.race import Alert, AlertKind, Heat, Kart, Race, TrackAccess
from evgp_rcs.rules.snapshot import (
    KartSnapshot,
    NOTHING,
    Snapshot,
    snapshot_of,
)
from evgp_rcs_msgs import msg
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

NAN = math.nan


def kart(number: int, sent: S = S.GREEN_GREEN, **fields: Any) -> KartSnapshot:
    (seen,) = snapshot_of(Race([Kart(number, f'Team {number}', True)]), 0.0).karts
    given = {'connected': True, 'acknowledged': True, 'address': '10.0.0.1', **fields}
    return seen._replace(sent=sent, **given)


def race(*karts: KartSnapshot, is_in: S = S.GREEN_GREEN, **fields: Any) -> Snapshot:
    return NOTHING._replace(state=is_in, karts=karts, stamp=1000.0, **fields)


def result(
    number: int, place: int, laps: int = 0, total: float | None = None, **fields: Any
) -> KartResult:
    plain = KartResult(number, place, Status.RUNNING, laps, total, (), ())
    return plain._replace(**fields)


def results(*karts: KartResult, kind: Format = Format.RACE, heat: str = '') -> Standings:
    return Standings(karts=karts, format=kind, heat=heat)


def shown(heard: Heard) -> list[tuple[Any, ...]]:
    """Return place, kart and time of each row."""
    return [(row['place'], row['kart'], row['cells'][1]) for row in view.board(heard)['rows']]


def test_the_order_is_that_of_the_results_with_the_distance_to_the_leader() -> None:
    heard = Heard(
        race(kart(3), kart(7), kart(9)),
        results(result(7, 1, 6, 245.312), result(9, 2, 6, 248.712), result(3, 3, 5, 240.0)),
    )
    assert shown(heard) == [(1, 7, '4:05.312'), (2, 9, '+3.400'), (3, 3, '+1 lap')]


def test_karts_without_a_result_are_last_in_the_order_of_the_roster() -> None:
    numbers = (64, 5, 33, 7, 16)
    found = results(result(7, 1, 6, 245.0), result(33, 2, 6, 246.0))
    rows = shown(Heard(race(*map(kart, numbers)), found))
    assert [number for _, number, _ in rows] == [7, 33, 64, 5, 16]


def test_where_nobody_counts_laps_the_order_is_that_of_the_finish() -> None:
    heard = Heard(race(kart(3), kart(7, place=1)), results(result(3, 0), result(7, 0)))
    assert shown(heard) == [(1, 7, ''), ('', 3, '')]
    assert 'order of FINISH' in view.board(heard)['sub']
    assert ['Place', '1'] in view.kart(heard, 7)['cells']


def test_where_laps_are_counted_a_kart_without_a_place_gets_none_from_its_finish() -> None:
    out = result(7, 0, 6, 245.0, status=Status.DISQUALIFIED)
    heard = Heard(race(kart(7, place=1)), results(out))
    assert view.board(heard)['rows'][0]['place'] == ''
    assert ['Place', '-'] in view.kart(heard, 7)['cells']
    assert 'order of FINISH' not in view.board(heard)['sub']


def test_without_timing_the_order_is_that_of_the_finish_and_the_results_remain() -> None:
    counted = results(result(3, 1, 6, 245.0), result(7, 2, 6, 246.0))
    karts = kart(3, place=2), kart(7, place=1)
    timed, heard = (Heard(race(*karts), counted, no_timing=gone) for gone in (False, True))
    assert shown(timed) == [(1, 3, '4:05.000'), (2, 7, '+1.000')]
    assert 'order of FINISH' not in view.board(timed)['sub']
    assert shown(heard) == [(1, 7, ''), (2, 3, '')]
    assert 'order of FINISH' in view.board(heard)['sub']
    assert [row['kart'] for row in view.results(heard)['rows']] == [3, 7]
    assert 'out of date' in view.results(heard)['sub']
    assert 'out of date' not in view.results(timed)['sub']


def test_results_are_official_only_once_the_timekeeper_has_published_them() -> None:
    counted = results(result(3, 1, 6, 245.0))
    for published, word, other in (
        (False, 'provisional', 'official'),
        (True, 'official results', 'provisional'),
    ):
        heard = Heard(race(kart(3), over=True), counted._replace(published=published))
        for page in (view.board(heard), view.results(heard)):
            assert word in page['sub'].lower()
            assert other not in page['sub'].lower()
    assert not view.results(Heard(race(kart(3)), results()))['sub']  # there are none yet


def test_a_penalty_is_noted_by_what_it_takes_unless_the_status_says_so() -> None:
    penalty = Penalty(7, 5, 0, disqualified=True, reason='RED_RED', official='Ada')
    found = results(result(7, 0, status=Status.DISQUALIFIED, penalties=(penalty,)))
    (row,) = view.results(Heard(race(kart(7)), found))['rows']
    assert row['note'] == 'disqualified; +5 s'


def test_in_a_practice_the_time_is_that_of_the_last_lap() -> None:
    found = results(result(7, 1, 2, 100.0, lap_times=(49.0, 51.0)), kind=Format.PRACTICE)
    assert shown(Heard(race(kart(7)), found)) == [(1, 7, '0:51.000')]


def test_the_results_of_the_heat_before_are_not_those_of_this_one() -> None:
    heats = (
        Heat('Heat 1', (3, 7)),
        Heat('Heat 2', (9,)),
    )
    before = results(result(7, 1, 6, 245.0), heat='Heat 1')
    karts = kart(3), kart(7), kart(9, in_race=False)
    first = Heard(race(*karts, heats=heats, heat='Heat 1'), before)
    karts = kart(3, in_race=False), kart(7, in_race=False), kart(9)
    second = Heard(race(*karts, heats=heats, heat='Heat 2'), before)
    assert shown(first) == [(1, 7, '4:05.000'), ('', 3, '')]
    assert 'Heat 2' in view.board(first)['sub']
    assert shown(second) == [('', 9, '')]
    assert view.board(second)['title'].startswith('Heat 2')
    assert [row['kart'] for row in view.results(second)['rows']] == [7]


@pytest.mark.parametrize(
    ('sent', 'fields', 'note'),
    [
        (S.GREEN_GREEN, {}, 'last lap'),
        (S.IN_GARAGE, {}, 'in the garage'),
        (S.RED_RED, {'stands': True}, 'stopped'),
        (S.RED_RED, {}, 'not stopped'),
        (S.RED_RED, {'stands': True, 'connected': False}, 'no link'),
    ],
)
def test_a_row_notes_a_stop_only_of_a_kart_that_stands_and_a_last_lap_only_on_the_track(
    sent: S, fields: dict[str, bool], note: str
) -> None:
    counted = results(result(7, 1, 1, 40.0, lap_times=(40.0,)))._replace(laps=2)
    is_in = sent if sent.is_red else S.GREEN_GREEN
    (row,) = view.board(Heard(race(kart(7, sent, **fields), is_in=is_in), counted))['rows']
    assert row['note'] == note


def test_no_page_shows_an_official_an_address_or_that_humans_may_enter() -> None:
    penalty = Penalty(7, 5, 0, False, 'Anna said so', 'Anna')
    heard = Heard(
        race(
            kart(7, S.RED_RED, hold=S.RED_RED, hold_reason='RED_RED by Anna'),
            is_in=S.RED_RED,
            state_cause='ALL_KILL by Anna',
            alerts=(Alert(AlertKind.KART_LOST, 7, 0.0, '10.0.0.1, Anna', False),),
            track=TrackAccess(True, True, 'humans may enter', False),
        ),
        results(result(7, 1, 3, 100.0, penalties=(penalty,))),
        log={7: [view.Line('RED RED sent', '12:00:00.0')]},
    )
    text = json.dumps([view.board(heard), view.results(heard), view.kart(heard, 7)])
    assert '+5 s' in text
    for secret in ('Anna', '10.0.0.1', 'human'):
        assert secret not in text


def test_a_silent_race_control_is_gone_whatever_it_said_last() -> None:
    heard = Heard(race(kart(7)), gone=True)
    for page in (view.board(heard), view.results(heard), view.kart(heard, 7)):
        assert page['stale']
        assert 'GREEN' not in page['head']
        assert page['tone'] == 'faint'
    assert view.board(Heard())['stale']


@pytest.mark.parametrize(('kind', 'head'), view.DANGERS.items())
def test_a_race_control_that_is_unreliable_is_shown_in_place_of_the_state(
    kind: AlertKind, head: str
) -> None:
    heard = Heard(race(kart(7), alerts=(Alert(kind, 0, 0.0, '', False),)))
    for page in (view.board(heard), view.results(heard), view.kart(heard, 7)):
        assert (page['head'], page['tone']) == (head, 'bad')


def test_a_team_sees_how_soon_its_kart_answered() -> None:
    link = NOT_MEASURED._replace(grade=Grade.GOOD, round_trip=0.0181)
    seen = kart(
        7,
        link=link,
        delivered_after=0.006,
        acknowledged_after=0.314,
    )
    laps = 46.0, 43.7, 45.0, 44.8, 44.9
    counted = results(result(7, 1, 5, 224.4, lap_times=laps))._replace(laps=6)
    page = view.kart(Heard(race(seen), counted), 7)
    assert page['head'] == '▶ GREEN GREEN'
    # Counted from the order, which a connection makes anew, though the state lasts since long ago.
    assert page['detail'] == 'arrived after 6 ms · answered after 0.31 s'
    for cell in (['Laps', '5 of 6'], ['Last lap', '0:44.900'], ['Best', '0:43.700']):
        assert cell in page['cells']
    assert ['Link', 'good, 19 ms'] in page['cells']


numbers = st.sampled_from([NAN, math.inf, -math.inf, -1.0, 0.0, 1e300]) | st.floats()
few, many = st.integers(0, 5), st.integers(0, 255)
states = st.builds(msg.RaceState, state=few)
links = st.builds(msg.LinkQuality, grade=few, round_trip=numbers, worst_answer=numbers)
of_kart = dict.fromkeys(('delivered_after', 'acknowledged_after'), numbers)
karts = st.builds(
    msg.KartStatus,
    number=few,
    in_race=st.booleans(),
    connected=st.booleans(),
    place=few,
    sent=states,
    link=links,
    **of_kart,
)
placed = st.builds(
    msg.KartResult,
    kart=few,
    place=few,
    laps=many,
    total=numbers,
    status=few,
    lap_times=st.lists(numbers),
)
text = st.sampled_from(['', 'race', 'practice', '<b>'])


@settings(max_examples=200)
@given(st.lists(karts, max_size=4), states, st.lists(placed, max_size=4), text)
def test_whatever_a_message_says_is_shown_or_no_message_of_race_control(
    there: list[msg.KartStatus], is_in: msg.RaceState, ranked: list[msg.KartResult], name: str
) -> None:
    heats = [msg.Heat(name=name, karts=[1, 2])]
    race = msg.Race(state=is_in, karts=there, heats=heats, heat=name)
    try:
        heard = Heard(
            value_of(race, Snapshot),
            value_of(msg.Results(karts=ranked, format=name, heat=name), Standings),
        )
    except ValueError:
        return
    pages = [view.board(heard), view.results(heard), *(view.kart(heard, each) for each in (0, 1))]
    json.dumps(pages, allow_nan=False)
