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

from typing import Any

from evgp_rcs.rules import race
import pytest
import race_oracle as oracle

pytestmark = [pytest.mark.usefixtures('others_first'), pytest.mark.timeout(900)]

EARLY = (pytest.mark.early,)
LONGEST = (pytest.mark.long, pytest.mark.longest, pytest.mark.timeout(1800))

CLOSED = ('OPEN_TRACK',)
UNMARKED = ('KART_FINISH', 'KART_RED_FLAG')
QUIET = CLOSED + UNMARKED

PAIR = {'racing': 1, 'outside': 1, 'compare': 400}
# The rival, the record and who is there are apart from all else, so one kart is enough; so it is
# for pauses and what is on the disk, which officials' commands alone read.
ONE = {'racing': 1, 'outside': 0, 'compare': 200}
AROUND = {**ONE, 'around': True}
SLOW_DISK = {**AROUND, 'waits': True, 'compare': 400, 'without': UNMARKED}
PEOPLE = {**ONE, 'people': True, 'without': CLOSED}
# Karts join and leave, so it must not matter who is in the race to begin with.
AT_ONCE = {'finish_delays': (1.0, 0.0), 'finish_stop': 0.0, 'settle_time': 0.0}

WORLDS: dict[str, tuple[Any, ...]] = {
    'two in the race and one outside': (LONGEST, {'outside': 1, 'without': QUIET}, 30_000, 200),
    'an open track': (LONGEST, {**PAIR, 'compare': 150}, 20_000, 300),
    'no finish': (EARLY, {**PAIR, 'without': QUIET}),
    'no finish and an open track': (LONGEST, {**PAIR, 'without': UNMARKED}),
    'no finish, unknown': (LONGEST, {**PAIR, 'begin': 'unknown', 'without': QUIET}),
    'no finish after a crash': (LONGEST, {**PAIR, 'begin': 'crash', 'without': UNMARKED}),
    'no finish at the first start': (LONGEST, {**PAIR, 'begin': 'first', 'without': UNMARKED}),
    'silent links': (LONGEST, {**PAIR, 'silence': True, 'without': QUIET}),
    'cut off, two programs': ((), {**ONE, 'network': True, 'compare': 100, 'without': QUIET}),
    'a rival and a record that fails': (EARLY, AROUND),
    'a rival after a crash': (LONGEST, {**AROUND, 'begin': 'crash'}),
    'a rival, lost on the grid': (LONGEST, {**AROUND, 'begin': 'lost on the grid'}),
    'a rival, unknown': (LONGEST, {**AROUND, 'begin': 'unknown'}),
    'a slow disk': (LONGEST, SLOW_DISK),
    'a slow disk, unknown': (LONGEST, {**SLOW_DISK, 'begin': 'unknown'}),
    'people come and go': (EARLY, PEOPLE),
    'people, told only': (LONGEST, {**PEOPLE, 'times': {'nobody_there': 0.0}}),
    'the official ends the race': (
        LONGEST,
        {'without': CLOSED, 'times': {'auto_race_over': False}},
    ),
    'all outside, no time to stop': (
        LONGEST,
        {'racing': 0, 'outside': 2, 'without': CLOSED, 'times': AT_ONCE},
    ),
}
"""Each with its marks, options, and how many states and compared pairs it has at least."""


@pytest.mark.parametrize('name', [pytest.param(name, marks=WORLDS[name][0]) for name in WORLDS])
def test_every_state_of_a_small_race_is_as_the_oracle_says(name: str) -> None:
    _, options, *least = WORLDS[name]
    # It is to end by itself; the limit only keeps a broken rule from searching for ever.
    report = oracle.Search(race, **{'outside': 0, **options}).run(200_000)
    print(f'\n{options}: {report}')
    assert report.finished
    assert set(report.by_state) == set(oracle.RANK)
    assert min(report.by_state.values()) >= report.states // 40
    assert report.refusals > report.states
    found = report.states, report.pairs_compared
    assert all(each >= wanted for each, wanted in zip(found, least, strict=False))


# With karts that come and go, a search looks at the nearest states.
@pytest.mark.parametrize(
    ('states', 'pairs', 'options'),
    [
        (1_500, 50, {**PAIR, 'begin': 'grid', 'waits': True, 'compare': 160}),
        (500, 20, {**SLOW_DISK, 'begin': 'grid', 'people': True, 'around': False, 'compare': 160}),
        (300, 0, {**PAIR, 'begin': 'green', 'heats': True}),
    ],
    ids=['a slow disk', 'a slow disk while people come and go', 'heats and finishes'],
)
def test_the_nearest_states_of_larger_races_are_as_the_oracle_says(
    states: int, pairs: int, options: dict[str, Any]
) -> None:
    report = oracle.Search(race, **options).run(states)
    assert report.states == states
    assert report.pairs_compared >= pairs


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
