# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What becomes of passings: each has one identity, and what a device does wrong is told."""

from __future__ import annotations

from evgp_node.results import Passing
from evgp_timing.account import Account, RECENT, REMEMBERED, Trouble
from evgp_timing.passings import (
    CLOCK_TOLERANCE,
    MAX_RATE,
    of_device,
    Refused,
    Sign,
    Unchecked,
)
from hypothesis import given
from hypothesis import strategies as st
import pytest
from recorded_bytes import P3_LIVE

EVENTS = st.one_of(
    st.builds(
        of_device,
        time_us=st.integers(0, 2**64 - 1) | st.integers(0, 10_000_000),
        number=st.integers(0, 2**32 - 1) | st.integers(0, 5),
        transponder=st.sampled_from(['1', '2']),
    ),
    st.just(Sign()),
    st.just(Refused('it is broken')),
)


def passing(at: float, number: int = 0, transponder: str = '7') -> Passing:
    """Return a passing at this time of the device, in seconds."""
    return of_device(round(at * 1_000_000), number, transponder)


@given(st.lists(st.tuples(st.floats(0.0, 2.0), EVENTS), max_size=100))
def test_no_two_passings_have_one_identity_and_no_number_leaves_its_range(
    events: list[tuple[float, Passing | Sign | Refused]],
) -> None:
    made, now = Account(0.0), 0.0
    given_out: dict[tuple[str, int], Passing] = {}
    for after, event in events:
        now += after
        taken = made.take(event, now)
        if taken is None:
            continue
        assert 0 < taken.number < 2**32
        assert taken.session == made.session
        assert given_out.setdefault((taken.session, taken.number), event) is event
    assert made.taken == len(given_out)


JUMP = CLOCK_TOLERANCE + 0.1

SAID: dict[str, tuple[list[tuple[float, Passing]], list[int | None], dict[Trouble, int]]] = {
    name: ([(now, passing(*said)) for now, *said in events], numbers, counts)
    for name, events, numbers, counts in (
        ('again', [(1, 1, 41), (2, 2, 42), (3, 1, 41)], [41, 42, None], {Trouble.REPEATED: 1}),
        ('count anew', [(1, 1, 41), (2, 2, 1), (3, 3, 2)], [41, 1, 2], {Trouble.RESTARTED: 1}),
        ('all anew', [(1, 500, 41), (2, 0.5, 1), (3, 1.5, 2)], [41, 1, 2], {Trouble.RESTARTED: 1}),
        (
            'clock anew, without a count',  # nothing but its clock shows that it has restarted
            [(1, 500), (2, 0.5), (3, 1.5)],
            [1, 1, 2],
            {Trouble.RESTARTED: 1, Trouble.CLOCK: 1},
        ),
        ('a selection of a count', [(1, 1, 41), (2, 2, 45)], [41, 45], {}),
        (
            'not received, where it counts by one',
            [(1, 1, 41), (2, 2, 45), (3, 3, 46), (4, 4, 48)],
            [41, 45, 46, 48],
            {Trouble.MISSED: 4},
        ),
        (
            'a gate, by its number or its label',
            [(1, 1, 1), (2, 2, 2, '9992'), (3, 3, 3, '12 G-1'), (4, 4, 4)],
            [1, None, None, 4],
            {},
        ),
        *(
            (
                f'clock {jump:+g} s',
                [(1, 10, 1), (2, 11 + jump, 2), (3, 12 + jump, 3)],
                [1, 2, 3],
                {Trouble.CLOCK: 1},
            )
            for jump in (JUMP, -JUMP, 1e9)
        ),
        (
            'too many',
            [*((0.5, n / 1000, n) for n in range(1, MAX_RATE + 51)), (1.5, 1.5, MAX_RATE + 51)],
            [*range(1, MAX_RATE + 1), *[None] * 50, MAX_RATE + 51],
            {Trouble.TOO_MANY: 50},
        ),
    )
}
"""Passings, each with the time at which it is heard; the numbers of those that are taken, and what
is told."""

LIVE = [(event.stamp_ns / 1e9, event) for _, event in P3_LIVE if isinstance(event, Passing)]
SAID['a selection of a count, live'] = (LIVE, [8841, None, 8857, 8859, 8861], {})


@pytest.mark.parametrize(('said', 'numbers', 'counts'), SAID.values(), ids=SAID)
def test_what_a_device_does_wrong_is_counted_and_told_and_the_rest_is_taken(
    said: list[tuple[float, Passing]], numbers: list[int | None], counts: dict[Trouble, int]
) -> None:
    made = Account(0.0, frozenset(('9992', 'G-1')))
    sessions = {made.session}
    found = []
    for now, event in said:
        taken = made.take(event, now)
        found.append(taken and taken.number)
        sessions.add(made.session)
    assert found == numbers
    assert {each: count for each, count in made.counts.items() if count} == counts
    assert len(sessions) == 1 + counts.get(Trouble.RESTARTED, 0)
    assert made.trouble(now) is next((each for each in Trouble if each in counts), None)
    assert made.trouble(now + RECENT) is None


def test_a_decoder_without_checksums_is_told_of_once() -> None:
    made = Account(0.0)
    for at in (1.0, 1.0 + RECENT):
        assert made.take(Unchecked(*passing(at, round(at))), at)
        assert made.trouble(at) is (Trouble.UNCHECKED if at == 1.0 else None)
    assert made.counts[Trouble.UNCHECKED] == 2


def test_what_is_remembered_is_bounded() -> None:
    made = Account(0.0)
    for each in range(2 * REMEMBERED):
        made.take(passing(each, each + 1), float(each))
    assert len(made._recent) == REMEMBERED
    assert made.take(passing(each, each + 1), float(each)) is None  # the newest are remembered


def test_what_cannot_be_read_is_no_sign_of_life() -> None:
    made = Account(1.0)
    assert made.take(Refused('a checksum is wrong'), 5.0) is None
    assert made.heard_at == 1.0
    assert made.last_refusal == 'a checksum is wrong'
    assert made.trouble(5.0) is Trouble.REFUSED
    made.take(Sign(), 6.0)
    assert made.heard_at == 6.0
