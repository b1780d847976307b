# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Laps of random passings, against the rule of docs/rules.md."""

from __future__ import annotations

import dataclasses
import itertools

from evgp_node.results import BY_HAND, KartResult, lap_time, Mark, Passing, Penalty, Status
from evgp_node.roster import Format, Heat
from evgp_timing.laps import Laps, LapSettings, MOST_A_RACE, MOST_SOURCES, ranked
from evgp_timing.passings import MAX_RATE
from hypothesis import given
from hypothesis import strategies as st
import pytest
from test_desk import Event, events

GREEN = 100.0
KARTS = (1, 2, 3)
PLACED = (Status.RUNNING, Status.CLASSIFIED)


def driven(event: Event) -> Laps:
    """Return the laps of the race that was started last."""
    return [each.laps for each in event.desk.races if each.started][-1]


def race() -> Laps:
    return Laps(LapSettings(), Heat(''), GREEN, KARTS)


@given(events())
def test_every_passing_is_kept_and_judged_by_the_rules_in_any_race(event: Event) -> None:
    for each in event.desk.races:
        laps, seen = each.laps, [crossing.passing for crossing in each.laps.crossings]
        of_sources = [passing for passing in seen if passing.source != BY_HAND]
        assert of_sources == event.seen.get(each.number, [])
        judge(laps)


def judge(laps: Laps) -> None:
    """Compare what became of each passing with the rules."""
    came: dict[int, list[float]] = {kart: [] for kart in laps.karts}  # those that count
    for at, passing, mark in ((each.came, each.passing, each.mark) for each in laps.crossings):
        claimed = laps._claimed.get(passing.identity, 0)
        kart = passing.kart or laps.transponders.get(passing.transponder, claimed)
        if passing.identity in laps.struck:
            assert mark is Mark.STRUCK
        elif kart not in laps.karts:
            late = at > laps.ended
            assert mark is (Mark.NOT_COUNTED if kart or late else Mark.UNKNOWN)
        elif mark is Mark.COUNTED:
            ends = [laps.ended, laps.left.get(kart, at)]
            if not (laps.wanted and passing.source == BY_HAND):  # those were missed or struck out
                ends.append(laps.finished.get(kart, at) + 0.5)
            assert at <= min(ends)
            came[kart].append(at)
        elif mark is Mark.DOUBTFUL:
            # Each of the two crossed at most a tolerance from when it came.
            assert at - max(came[kart], default=0.0) < 5.0 + 2 * 0.5
        else:
            assert mark is Mark.NOT_COUNTED
    from_green = laps.settings.first_crossing == 'ends'
    for kart, times in laps.counted.items():
        crossed = times[from_green:]
        assert all(b - a >= 5.0 for a, b in itertools.pairwise(times))
        assert len(times) <= laps.wanted + 1 or not laps.wanted
        # No clock makes a lap that the times of arrival do not.
        apart = (abs(a - b) for a, b in zip(came[kart], crossed, strict=True))
        assert all(each <= 0.5 + 1e-6 for each in apart)


@given(events(), st.data(), st.sampled_from(KARTS))
def test_what_is_struck_out_does_not_count_and_all_that_is_undone_is_as_before(
    event: Event, data: st.DataObject, kart: int
) -> None:
    laps = driven(event)
    before = laps.undo_finish(kart)
    undone = before.finish(kart, event.now).undo_finish(kart)
    assert (undone.crossings, undone.counted) == (before.crossings, before.counted)
    if not laps.crossings:
        return
    number = data.draw(st.integers(0, len(laps.crossings) - 1))
    identity = laps.crossings[number].passing.identity
    struck = laps.strike(identity, 'nobody crossed')

    assert struck.crossings[number].mark is Mark.STRUCK
    assert [each[:3] for each in struck.crossings] == [each[:3] for each in laps.crossings]
    again, whole = struck.restore(identity), laps.restore(identity)
    assert (again.crossings, again.counted) == (whole.crossings, whole.counted)


@pytest.mark.parametrize(
    ('transponders', 'kart'),
    [
        ({'42': 1}, 1),
        ({'FL 1': 1}, 1),
        ({'42': 1, 'FL 1': 1}, 1),
        ({'42': 1, 'FL 1': 2}, 0),
        ({'42': 1, 'FL 1': 2, '42 FL 1': 3}, 3),
        ({'FL': 1, '4': 1, '': 1}, 0),
    ],
)
def test_a_transponder_with_a_label_is_known_by_either_unless_they_are_of_two_karts(
    transponders: dict[str, int], kart: int
) -> None:
    laps = dataclasses.replace(race(), transponders=transponders)
    assert laps.kart_of(Passing('line', 'today', 1, transponder='42 FL 1')) == kart


# ----- bounds -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('seconds', 'in_each', 'over', 'source'),
    [
        pytest.param(1, 1000, 1000 - MAX_RATE, 'line', id='in a second'),
        pytest.param(MOST_A_RACE // MAX_RATE + 1, MAX_RATE, MAX_RATE, 'beam', id='in a race'),
    ],
)
def test_what_is_too_many_is_counted_told_and_not_kept_and_what_is_not_is_heard(
    seconds: int, in_each: int, over: int, source: str
) -> None:
    laps, numbers = race(), itertools.count(1)
    for second in range(seconds):
        flood = [Passing('line', 's', next(numbers), 9) for _ in range(in_each)]
        laps = laps.take(flood, GREEN + second + 1.0)
    assert len(laps.crossings) == seconds * in_each - over
    assert laps.over == {'line': over}
    assert str(over) in laps.trouble(GREEN)
    laps = laps.take([Passing(source, 's', next(numbers), 1)], GREEN + 2000.0)

    assert laps.crossings[-1].passing.source == source
    assert laps.crossings[-1].mark is Mark.COUNTED


def test_further_sources_than_a_race_can_have_are_told_and_officials_still_count() -> None:
    many = [Passing(f'source {number}', 's', 1, 1) for number in range(MOST_SOURCES + 3)]
    press = Passing(BY_HAND, '1', 1, 2)
    laps = race().take(many, GREEN + 1.0)

    assert len(laps.crossings) == MOST_SOURCES
    assert sum(laps.over.values()) == 3
    assert laps.trouble(GREEN + 20.0)
    assert laps.take([press], GREEN + 10.0).mark_of(press.identity) is Mark.COUNTED
    assert race().take([press, *many], GREEN + 1.0).over == laps.over


# ----- results ------------------------------------------------------------------------------


PENALTIES = st.builds(
    Penalty,
    st.just(1),
    st.integers(0, 60),
    st.integers(0, 3),
    st.booleans(),
    st.just('short cut'),
    st.just('Anna'),
)
RESULTS = st.lists(
    st.builds(
        KartResult,
        st.integers(1, 99),
        st.just(0),
        st.sampled_from(Status),
        st.integers(0, 3),
        st.sampled_from((30.0, 30.0001, 31.0)),
        st.lists(st.sampled_from((9.0, 9.5, 10.0)), max_size=3).map(tuple),
        st.just(()),
    ).map(lambda each: each if each.lap_times else each._replace(laps=0, total=None)),
    max_size=8,
)


@given(RESULTS, st.sampled_from(Format))
def test_places_begin_with_1_and_whoever_is_better_is_before(
    results: list[KartResult], format_: Format
) -> None:
    found = ranked(format_, results)

    assert sorted(each.kart for each in found) == sorted(each.kart for each in results)
    placed = [each for each in found if each.place]
    for each in found:
        assert bool(each.place) == (each.status in PLACED and bool(each.lap_times))
        better = sum(_is_better(other, each, format_) for other in placed)
        assert each.place in (0, better + 1)
    assert [each for each in found if each.status in PLACED] == [*found][
        : sum(each.status in PLACED for each in found)
    ]


def _is_better(one: KartResult, other: KartResult, format_: Format) -> bool:
    """Return whether one is before another, by the rule."""

    def ms(seconds: float | None) -> int:
        return 10**9 if seconds is None else round(seconds * 1000)

    if format_ is Format.PRACTICE:
        return ms(one.best) < ms(other.best)
    if one.laps != other.laps:
        return one.laps > other.laps
    if ms(one.total) != ms(other.total):
        return ms(one.total) < ms(other.total)
    return format_ is Format.TIME_TRIAL and ms(one.best) < ms(other.best)


@given(events(), PENALTIES)
def test_the_end_says_who_did_not_finish_and_a_penalty_makes_no_result_better_and_goes_whole(
    event: Event, penalty: Penalty
) -> None:
    before = driven(event)
    laps = before.end(event.now)
    for each in laps.results:
        done = laps.is_done(each.kart) or each.kart in laps.finished
        if not each.lap_times:
            assert each.status is Status.NOT_CLASSIFIED
        else:
            assert each.status is (Status.CLASSIFIED if done else Status.DNF)
    practice = dataclasses.replace(laps, heat=Heat('', format=Format.PRACTICE))
    assert all(each.status is not Status.DNF for each in practice.results)

    was = {each.kart: each for each in before.results}
    punished = before.penalise(penalty)
    after = {each.kart: each for each in punished.results}

    assert after[1].laps == max(0, was[1].laps - penalty.laps)
    if was[1].total is not None:
        assert after[1].total == was[1].total + penalty.seconds
    assert (after[1].status is Status.DISQUALIFIED) == penalty.disqualified
    assert not after[1].place or after[1].place >= was[1].place
    other = penalty._replace(kart=2)
    assert punished.penalise(other).undo_penalty(1).results == before.penalise(other).results


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
