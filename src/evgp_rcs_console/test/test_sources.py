# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Two race controls are told apart by the numbers of their snapshots."""

from __future__ import annotations

from collections.abc import Iterable

from evgp_rcs_console.client import Sources, spoken, WITHIN
import pytest


def heard(numbers: Iterable[int], every: float = 0.25) -> tuple[Sources, float]:
    """Return the sources after snapshots with these numbers, and when the last one arrived."""
    sources = Sources()
    now = 0.0
    for number in numbers:
        now += every
        sources.hear(number, now)
    return sources, now


@pytest.mark.parametrize(
    'numbers',
    [
        [500, 1, 501, 2, 502, 3],
        [7, 7, 8, 8, 9, 9],
        [7, 500, 8, 501, 9, 502],
    ],
)
def test_two_race_controls_are_noticed(numbers: list[int]) -> None:
    sources, now = heard(numbers)

    assert sources.are_two(now)


@pytest.mark.parametrize(
    'numbers', [[1, 2, 3, 4], [1, 2, 7, 8], [500, 501, 1, 2, 3], [18446744073709551615]]
)
def test_one_race_control_is_not_two_nor_when_it_starts_again(numbers: list[int]) -> None:
    sources, now = heard(numbers)

    assert not sources.are_two(now)


def test_it_is_over_when_one_of_them_has_ended() -> None:
    sources, now = heard([500, 1, 501, 2, 502, 3])

    for n in range(20):
        now += 0.25
        sources.hear(503 + n, now)

    assert now > WITHIN
    assert not sources.are_two(now)


def test_a_state_has_one_name_wherever_it_is_read() -> None:
    told = 'GREEN_GREEN refused: the race is in IN_GARAGE; kart 7 (A_B) says RED_RED; RECORD_MSR'

    assert spoken(told) == (
        'GREEN GREEN refused: the race is in IN GARAGE; kart 7 (A_B) says RED RED; MSR WAS USED'
    )
