# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""How a simulated kart moves."""

from __future__ import annotations

import math

from evgp_testing.base import COMMAND_TIMEOUT, Motion
import pytest

STEP = 0.02


def drive(motion: Motion, speed: float, turn: float, way: float) -> float:
    """Drive until the kart has come so far; return when that is."""
    now = 0.0
    while motion.distance < way:
        motion.command(now, speed, turn)
        now += STEP
        motion.advance(now)
    return now


def test_a_kart_that_turns_drives_a_circle_also_while_it_gets_faster() -> None:
    motion, radius = Motion(0.0, place=(3.0, 1.0)), 4.0
    drive(motion, 2.0, 2.0 / radius, math.pi * radius)
    assert math.dist((motion.x, motion.y), (3.0, 1.0 + 2 * radius)) < 0.1
    assert motion.heading == pytest.approx(math.pi, abs=0.02)


def test_a_kart_that_is_told_to_stop_rolls_on_in_its_curve_and_does_not_turn_where_it_stands() -> (
    None
):
    motion = Motion(0.0)
    now = drive(motion, 6.0, 1.0, 12.0)
    before = motion.heading
    motion.command(now, 0.0, 9.0)
    motion.advance(now + 1.0)
    assert 0.0 < motion.heading - before < 0.5
    before = motion.heading
    motion.command(now + 2.0, 0.0, 9.0)
    motion.advance(now + 4.0)
    assert (motion.heading, motion.speed) == (before, 0.0)


def test_a_kart_without_commands_brakes() -> None:
    motion = Motion(0.0, braking=8.0)
    now = drive(motion, 4.0, 0.0, 10.0)
    motion.advance(now + COMMAND_TIMEOUT - STEP)
    assert motion.speed == 4.0
    motion.advance(now + COMMAND_TIMEOUT + 0.5)
    assert motion.speed == pytest.approx(0.0, abs=0.2)


def test_a_kart_that_is_commanded_nan_brakes() -> None:
    motion = Motion(0.0)
    now = drive(motion, 4.0, 0.0, 10.0)
    motion.command(now, math.nan)
    motion.advance(now + COMMAND_TIMEOUT)
    assert motion.speed == 0.0
