# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What becomes of passings: each has one identity, and what a device does wrong is told."""

from __future__ import annotations

from collections.abc import Iterable

from evgp_node.results import Passing
from evgp_timing.account import Account, RECENT, REMEMBERED, Trouble
from evgp_timing.passings import (
    CLOCK_TOLERANCE,
    Event,
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


def account(*events: tuple[float, Passing]) -> Account:
    """Return an account with passings taken, each at its time."""
    made = Account(0.0)
    for now, event in events:
        made.take(event, now)
    return made


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


def test_a_passing_said_again_is_left_out_and_told() -> None:
    made = account((1.0, passing(1.0, 41)), (2.0, passing(2.0, 42)))
    session = made.session
    assert made.take(passing(1.0, 41), 3.0) is None
    assert made.session == session
    assert made.trouble(3.0) is Trouble.REPEATED
    assert made.trouble(3.0 + RECENT) is None


@pytest.mark.parametrize(
    'said',
    [
        pytest.param([(1.0, 41), (2.0, 1), (3.0, 2)], id='a count'),
        pytest.param([(500.0, 41), (0.5, 1), (1.5, 2)], id='a count and its clock'),
        pytest.param([(500.0, 0), (0.5, 0), (1.5, 0)], id='the clock of a device without a count'),
    ],
)
def test_what_begins_anew_is_another_session_and_one_restart(
    said: list[tuple[float, int]],
) -> None:
    before, first, second = (passing(*each) for each in said)
    made = account((1.0, before))
    session = made.session
    assert number(made, first, 2.0) == 1
    assert made.session != session
    assert made.trouble(2.0) is Trouble.RESTARTED
    assert number(made, second, 3.0) == 2
    assert made.counts[Trouble.RESTARTED] == 1
    # Nothing but its clock shows that a device without a count has restarted.
    assert made.counts[Trouble.CLOCK] == (0 if first.number else 1)


def test_passings_that_were_not_received_are_counted_once_the_device_has_counted_by_one() -> None:
    made = account((1.0, passing(1.0, 41)), (2.0, passing(2.0, 45)))
    assert made.counts[Trouble.MISSED] == 0
    made.take(passing(3.0, 46), 3.0)
    assert made.counts[Trouble.MISSED] == 3
    assert made.trouble(3.0) is Trouble.MISSED
    made.take(passing(4.0, 48), 4.0)
    assert made.counts[Trouble.MISSED] == 4


def taken(made: Account, events: Iterable[Event]) -> list[Passing]:
    """Return what is taken of these, each at the time that it says."""
    found, now = [], 0.0
    for event in events:
        now = event.stamp_ns / 1e9 if isinstance(event, Passing) else now
        found.append(made.take(event, now))
    return [each for each in found if each is not None]


def number(made: Account, event: Event, now: float) -> int | None:
    """Return the number with which an event is taken, or None."""
    found = made.take(event, now)
    return found and found.number


def test_a_selection_of_a_count_is_not_missed() -> None:
    made = Account(0.0)
    assert len(taken(made, (event for _, event in P3_LIVE))) == 5
    assert set(made.counts.values()) == {0}


def test_a_decoder_without_checksums_is_told_of_once() -> None:
    made, first = Account(0.0), Unchecked(*passing(1.0, 1))
    assert number(made, first, 1.0) == 1
    assert made.trouble(1.0) is Trouble.UNCHECKED
    made.take(Unchecked(*passing(1.0 + RECENT, 2)), 1.0 + RECENT)
    assert made.trouble(1.0 + RECENT) is None
    assert made.counts[Trouble.UNCHECKED] == 2


def test_a_gate_is_left_out_by_its_number_or_its_label_and_its_count_is_not_missed() -> None:
    made = Account(0.0, frozenset(('9992', 'G-1')))
    events = [passing(1.0, 1), passing(2.0, 2, '9992'), passing(3.0, 3, '12 G-1'), passing(4.0, 4)]
    assert [each.number for each in taken(made, events)] == [1, 4]
    assert made.trouble(4.0) is None


@pytest.mark.parametrize('jump', [CLOCK_TOLERANCE + 0.1, -CLOCK_TOLERANCE - 0.1, 1e9])
def test_a_clock_that_jumps_is_told_once_and_the_passing_is_taken(jump: float) -> None:
    made = account((1.0, passing(10.0, 1)))
    assert number(made, passing(11.0 + jump, 2), 2.0) == 2
    assert number(made, passing(12.0 + jump, 3), 3.0) == 3
    assert made.counts[Trouble.CLOCK] == 1


def test_passings_beyond_the_rate_are_left_out_and_counted() -> None:
    made = Account(0.0)
    taken = [number(made, passing(0.001 * each, each), 0.5) for each in range(1, MAX_RATE + 51)]
    assert taken == [*range(1, MAX_RATE + 1), *[None] * 50]
    assert made.counts[Trouble.TOO_MANY] == 50
    assert made.counts[Trouble.MISSED] == 0
    assert number(made, passing(1.5, MAX_RATE + 51), 1.5) == MAX_RATE + 51


def test_what_is_remembered_is_bounded() -> None:
    made = Account(0.0)
    for each in range(2 * REMEMBERED):
        made.take(passing(each, each + 1), float(each))
    assert len(made._recent) == REMEMBERED


def test_what_cannot_be_read_is_no_sign_of_life() -> None:
    made = Account(1.0)
    assert made.take(Refused('a checksum is wrong'), 5.0) is None
    assert made.heard_at == 1.0
    assert made.last_refusal == 'a checksum is wrong'
    assert made.trouble(5.0) is Trouble.REFUSED
    made.take(Sign(), 6.0)
    assert made.heard_at == 6.0
