# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Every state that a small race can reach, under every input, against the oracle.

Two karts in the race and one outside is the least in which karts wait for each other while one
stands by. They do not finish there, nor are they flagged alone, or the search would take an hour.
Two karts, which smaller searches have, are the least in which karts finish one after the other.
No rule knows a number or counts karts otherwise. The smaller searches look at more: at tracks that
officials open, at other times, at what may be wrong around race control, at what it knows when it
begins, and at more of the states that the search takes for one.
"""

from __future__ import annotations

from evgp_rcs.rules import race
import pytest
import race_oracle as oracle

pytestmark = [pytest.mark.usefixtures('others_first'), pytest.mark.timeout(900)]

LONGEST = [pytest.mark.long, pytest.mark.longest]

CLOSED = ('OPEN_TRACK',)
UNMARKED = ('KART_FINISH', 'KART_RED_FLAG')


def search(most: int, **options: object) -> oracle.Report:
    """Search to the end and print the figures."""
    report = oracle.Search(race, **options).run(most)  # type: ignore[arg-type]
    print(f'\n{options}: {report}')
    assert report.finished
    assert set(report.by_state) == set(oracle.RANK)
    assert min(report.by_state.values()) >= report.states // 40
    assert report.refusals > report.states
    return report


# It is to end by itself; the limits only keep a broken rule from searching for ever.
@pytest.mark.long
@pytest.mark.longest
@pytest.mark.timeout(1800)
def test_two_karts_in_the_race_and_one_outside() -> None:
    report = search(200_000, racing=2, outside=1, without=CLOSED + UNMARKED)
    assert report.states > 30_000
    assert report.pairs_compared > 200


@pytest.mark.long
@pytest.mark.longest
@pytest.mark.timeout(1800)
def test_two_karts_with_a_track_that_officials_open() -> None:
    report = search(60_000, racing=1, outside=1, compare=150)
    assert report.states > 20_000
    assert report.pairs_compared > 300


@pytest.mark.parametrize(
    ('begin', 'without'),
    [
        pytest.param('garage', CLOSED, marks=pytest.mark.early),
        pytest.param('garage', (), marks=LONGEST),
        pytest.param('unknown', CLOSED, marks=LONGEST),
        pytest.param('crash', (), marks=LONGEST),
        pytest.param('first', (), marks=LONGEST),
    ],
    ids=lambda value: 'closed' if value == CLOSED else value or 'open',
)
def test_two_karts_that_do_not_finish(begin: str, without: tuple[str, ...]) -> None:
    world = {'racing': 1, 'outside': 1, 'begin': begin, 'without': without + UNMARKED}
    search(60_000, compare=400, **world)


@pytest.mark.long
@pytest.mark.longest
@pytest.mark.timeout(1800)
def test_two_karts_whose_links_stop_answering() -> None:
    without = CLOSED + UNMARKED
    search(60_000, compare=400, racing=1, outside=1, silence=True, without=without)


def test_one_kart_while_race_control_is_cut_off_and_two_programs_connect_as_it() -> None:
    without = CLOSED + UNMARKED
    search(60_000, compare=100, racing=1, outside=0, network=True, without=without)


# The rival and the record are apart from all else, so one kart is enough.
@pytest.mark.parametrize(
    'begin',
    [
        pytest.param('garage', marks=pytest.mark.early),
        pytest.param('crash', marks=LONGEST),
        pytest.param('lost on the grid', marks=LONGEST),
        pytest.param('unknown', marks=LONGEST),
    ],
)
def test_one_kart_while_another_race_control_comes_and_goes_and_the_record_fails(
    begin: str,
) -> None:
    search(60_000, racing=1, outside=0, around=True, begin=begin, compare=200)


# Pauses and what is on the disk are read by officials' commands alone, so one kart is enough to
# look at every state; with two karts that come and go, a search looks at the nearest states.
@pytest.mark.long
@pytest.mark.longest
@pytest.mark.timeout(900)
@pytest.mark.parametrize('begin', ['garage', 'unknown'])
def test_one_kart_with_pauses_and_a_slow_disk(begin: str) -> None:
    search(
        40_000,
        racing=1,
        outside=0,
        around=True,
        waits=True,
        begin=begin,
        compare=400,
        without=UNMARKED,
    )


def test_the_nearest_states_of_two_karts_with_pauses_and_a_slow_disk() -> None:
    search = oracle.Search(race, racing=1, outside=1, begin='grid', waits=True, compare=160)
    assert search.run(1_500).pairs_compared > 50


# Who is there is apart from all else too, but for starts.
@pytest.mark.parametrize(
    'times',
    [
        pytest.param({}, marks=pytest.mark.early),
        pytest.param({'nobody_there': 0.0}, marks=LONGEST),
    ],
    ids=['stopped', 'told-only'],
)
def test_one_kart_while_those_who_can_stop_it_come_and_go(times: dict[str, object]) -> None:
    search(60_000, compare=200, racing=1, outside=0, people=True, without=CLOSED, times=times)


def test_the_nearest_states_of_a_slow_disk_while_people_come_and_go() -> None:
    world = {'racing': 1, 'outside': 0, 'begin': 'grid', 'people': True, 'waits': True}
    search = oracle.Search(race, **world, compare=160, without=UNMARKED)  # type: ignore[arg-type]
    assert search.run(500).pairs_compared > 20


def test_the_nearest_states_of_heats_and_of_finishes_that_name_their_race() -> None:
    search = oracle.Search(race, racing=1, outside=1, begin='green', heats=True)
    assert search.run(300).states == 300


# Karts join and leave, so it must not matter who is in the race to begin with.
@pytest.mark.long
@pytest.mark.longest
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ('racing', 'times'),
    [
        (2, {'auto_race_over': False}),
        (0, {'finish_delays': (1.0, 0.0), 'finish_stop': 0.0, 'settle_time': 0.0}),
    ],
    ids=['all-in-and-the-official-ends-the-race', 'all-outside-and-no-time-to-stop'],
)
def test_two_karts_with_other_beginnings_and_times(racing: int, times: dict[str, object]) -> None:
    search(60_000, racing=racing, outside=2 - racing, without=CLOSED, times=times)


class Forgetful(oracle.Search):  # type: ignore[misc, name-defined]
    """A search that takes states for one whether or not a finish is due."""

    def _kart_key(self, kart: oracle.KartView, *others: object) -> int:
        return super()._kart_key(kart._replace(flag_at=None), *others)


def test_a_search_that_takes_too_many_states_for_one_is_found_out() -> None:
    search = Forgetful(race, racing=2, outside=0, begin='green', compare=20)
    with pytest.raises(oracle.RuleBrokenError, match='abstraction'):
        search.run(20_000)


def test_a_search_lets_time_pass_that_changes_nothing_yet() -> None:
    """A finish that is due in two steps of time is due in one after the first."""
    search = oracle.Search(race, racing=1, outside=0, begin='green')
    search.run(100)

    left = {
        kart.flag_at - now
        for saved, _, now in search._seen.values()
        for kart in (race.Kart(*saved[1][0]),)
        if kart.flag_at is not None and kart.hold is None
    }
    assert left >= {1.0, 2.0}
