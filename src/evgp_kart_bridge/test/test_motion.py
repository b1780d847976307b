# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Odometry whose pose and twist contradict each other."""

from __future__ import annotations

import math

from evgp_kart_bridge.motion import Motion, WINDOW
from evgp_kart_bridge.node import Lasting
from hypothesis import given
from hypothesis import strategies as st

SPEEDS = st.lists(st.floats(0.0, 20.0), min_size=1, max_size=200)


@given(SPEEDS, st.floats(0.02, 0.2), st.floats(0.0, 0.04))
def test_an_honest_twist_is_believed_as_it_is(
    speeds: list[float], step: float, noise: float
) -> None:
    motion, x = Motion(), 0.0
    for turn, speed in enumerate(speeds):
        x += speed * step if turn else 0.0
        assert motion.speed(speed, x + noise * (turn % 2), 0.0, turn * step) == speed
        assert not motion.contradiction


@given(st.floats(0.2, 20.0), st.floats(0.02, 0.1), st.sampled_from([0.0, 0.4]))
def test_a_pose_that_moves_is_a_speed_whatever_the_twist_says(
    speed: float, step: float, share: float
) -> None:
    motion, twist = Motion(), share * speed if speed > 0.6 else 0.0
    turns = math.ceil((WINDOW + step) / step) + 1
    for turn in range(-turns, 0):  # at first, its twist is right
        motion.speed(speed, 0.0, speed * turn * step, turn * step)
    found = [motion.speed(twist, 0.0, speed * turn * step, turn * step) for turn in range(turns)]
    assert found[-1] > max(0.05, twist)
    assert motion.contradiction
    # It stands, and has stood for long enough.
    after = [
        motion.speed(0.0, 0.0, speed * (turns - 1) * step, (turns + turn) * step)
        for turn in range(turns)
    ]
    assert after[-1] == 0.0


def test_a_pose_that_is_no_number_any_more_contradicts_nothing() -> None:
    motion = Motion()
    for x in (0.0, 1.0):
        motion.speed(0.0, x, 0.0, x)
    assert motion.contradiction
    assert motion.speed(0.0, math.nan, 0.0, 1.1) == 0.0
    assert not motion.contradiction


@given(SPEEDS, st.sampled_from([0.0, 7.0, math.nan]))
def test_a_pose_that_is_not_filled_in_says_nothing(speeds: list[float], x: float) -> None:
    motion = Motion()
    for turn, speed in enumerate(speeds):
        assert motion.speed(speed, x, x, turn * 0.02) == speed


def test_a_twist_that_is_no_number_is_no_standstill() -> None:
    motion = Motion()
    assert all(math.isnan(motion.speed(math.nan, turn, 0.0, turn * 0.1)) for turn in range(30))
    motion.speed(0.0, 29.0, 0.0, 4.0)
    assert not motion.contradiction


def test_what_lasts_is_noticed_once_each_time_it_begins_or_changes() -> None:
    lasting = Lasting(5.0)
    for what in (True, 7, 8):
        noticed = [lasting.is_due(what, at / 10) for at in range(100)]
        assert noticed.count(True) == 1
        assert noticed.index(True) == 50
    assert not lasting.is_due(False, 10.0)
    assert not lasting.is_due(8, 20.0)
