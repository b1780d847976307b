# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Whether a key or a click is new."""

from __future__ import annotations

from evgp_rcs_console.freshness import AIM, Aim, Beat, InputClock, SETTLE, STALE
import pytest

WRAP = 1 << 32


def test_an_input_that_has_waited_is_as_old_as_it_waited() -> None:
    clock = InputClock()
    clock.age(1_000_000, 50.4)  # this one had waited already
    assert clock.age(1_001_000, 51.0) == 0.0  # the fastest so far is the measure

    assert clock.age(1_002_000, 52.4) == pytest.approx(0.4, abs=0.01)
    assert clock.age(1_003_000, 68.0) == pytest.approx(15.0, abs=0.01)
    assert clock.age(1_018_000, 68.0) == pytest.approx(0.0, abs=0.01)
    assert clock.age(0, 99.0) == 0.0  # without a stamp, it is left to the beat


@pytest.mark.parametrize('start', [WRAP - 500, 0x7FFFFFFF])
def test_a_stamp_of_32_bits_may_begin_again(start: int) -> None:
    clock = InputClock()
    clock.age(start, 50.0)

    assert clock.age((start + 1000) % WRAP, 51.0) == pytest.approx(0.0, abs=0.01)
    assert clock.age((start + 2000) % WRAP, 67.0) == pytest.approx(15.0, abs=0.01)


def test_a_server_whose_clock_is_a_little_slow_stays_usable_all_day() -> None:
    clock = InputClock()
    slow = 1 - 5e-5

    ages = [clock.age(1_000_000 + int(1000 * slow * n), float(n)) for n in range(0, 36_000, 10)]

    assert max(ages) < STALE


def test_inputs_with_another_epoch_do_not_make_those_of_the_server_old() -> None:
    clock = InputClock()
    server, toolkit = 1_000_000_000, 5_000

    ages = [
        clock.age(epoch + 1000 * second, 50.0 + second)
        for second in range(5)
        for epoch in (toolkit, server)
    ]

    assert ages == [0.0] * 10
    assert clock.age(server + 5000, 70.0) == pytest.approx(15.0, abs=0.01)


def beats(beat: Beat, start: float, count: int) -> float:
    """Let a beat come in time, some times; return when the last one came."""
    for n in range(count):
        beat.beat(start + 0.1 * n)
    return start + 0.1 * (count - 1)


@pytest.mark.parametrize('asked_before', [True, False])
def test_what_is_taken_before_a_late_beat_or_just_after_it_has_waited_too(
    asked_before: bool,
) -> None:
    beat = Beat(0.1, 0.0)
    last = beats(beat, 0.1, 50)
    assert beat.held_up(last + 0.1) == 0.0
    late = last + 15.0
    if asked_before:
        assert beat.held_up(late) == pytest.approx(14.9)
    for after in (0.0, 0.1):
        beat.beat(late + after)
        assert beat.held_up(late + after + 0.05) == pytest.approx(14.9)


def test_a_queue_that_takes_long_is_waited_for_and_then_inputs_are_taken_again() -> None:
    beat = Beat(0.1, 0.0)
    late = beats(beat, 0.1, 10) + 15.0
    beat.beat(late)
    beat.beat(late + 1.0)  # held up once more, by what was in the queue
    assert beat.held_up(late + 1.1) > STALE

    last = beats(beat, late + 1.1, round(SETTLE / 0.1) + 2)

    assert beat.held_up(last + 0.05) == 0.0


def test_a_press_is_meant_for_what_stood_there_when_the_official_aimed() -> None:
    aim: Aim[str] = Aim()
    aim.change('kart 7', at=10.0)
    aim.change('kart 8', at=10.2)

    assert aim.seen(9.0) == 'kart 7'
    assert aim.seen(10.0 + AIM - 0.01) == 'kart 7'
    assert aim.seen(10.0 + AIM) == 'kart 8'
    assert aim.seen(10.2 + AIM) is None
