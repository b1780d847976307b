# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Presses of a stop button: none is lost, and none is invented."""

from __future__ import annotations

from evgp_rcs_console.presses import changes, EVENT, HELD, PressCounter
from hypothesis import given
from hypothesis import strategies as st

SYN, KEY, ABS = 0, 1, 3


@given(st.lists(st.tuples(st.integers(1, 3), st.booleans()), max_size=60))
def test_each_key_that_goes_down_is_one_press(steps: list[tuple[int, bool]]) -> None:
    presses, counted = PressCounter(), 0
    presses.look(frozenset(), 0.0)
    down: set[int] = set()
    for key, goes_down in steps:
        pressed = presses.take(key, goes_down, 1.0)
        counted += pressed
        assert pressed is (goes_down and key not in down)
        (down.add if goes_down else down.discard)(key)
    assert presses.count == counted


@given(st.binary(max_size=300))
def test_no_bytes_of_a_device_do_any_harm(data: bytes) -> None:
    list(changes(data))


@given(st.lists(st.tuples(st.integers(0, 767), st.sampled_from([0, 1, 2])), max_size=20))
def test_keys_are_read_as_the_kernel_writes_them(keys: list[tuple[int, int]]) -> None:
    written = b''.join(
        EVENT.pack(1, 2, KEY, code, value)
        + EVENT.pack(1, 2, ABS, 0, 7)
        + EVENT.pack(1, 2, SYN, 0, 0)
        for code, value in keys
    )
    assert list(changes(written)) == [(code, value > 0) for code, value in keys]
    assert list(changes(EVENT.pack(1, 2, SYN, 3, 0))) == [None]


def test_a_key_that_lies_down_at_the_start_is_told_and_is_no_press() -> None:
    presses = PressCounter()
    assert not presses.look({30}, 5.0)
    assert presses.is_held(5.0)
    assert presses.take(31, True, 6.0)  # the other keys work
    assert not presses.take(30, True, 6.0)
    presses.take(30, False, 7.0)
    presses.take(31, False, 7.0)
    assert not presses.is_held(7.0)
    assert presses.take(30, True, 8.0)
    assert presses.count == 2


def test_a_key_that_went_down_while_the_device_was_gone_is_a_press() -> None:
    presses = PressCounter()
    presses.look(frozenset(), 0.0)
    assert presses.look({30}, 2.0)
    assert not presses.look({30}, 3.0)
    assert not presses.look(frozenset(), 4.0)
    assert presses.look({30}, 5.0)


def test_a_key_that_is_held_is_told_until_it_is_up() -> None:
    presses = PressCounter()
    presses.look(frozenset(), 0.0)
    presses.take(30, True, 1.0)
    assert not presses.is_held(1.0)
    assert presses.is_held(1.0 + HELD)
    presses.take(30, False, 9.0)
    assert not presses.is_held(9.0)


def test_only_the_key_that_was_named_counts() -> None:
    presses = PressCounter(key=28)
    assert not presses.look({30}, 0.0)
    assert not presses.is_held(9.0)
    assert not presses.take(30, True, 9.0)
    assert presses.take(28, True, 9.0)


def test_dropped_events_are_a_press() -> None:
    presses = PressCounter()
    presses.look(frozenset(), 0.0)
    presses.miss(frozenset(), 1.0)
    presses.miss({30}, 2.0)
    assert not presses.take(30, True, 3.0)
    assert presses.count == 2
