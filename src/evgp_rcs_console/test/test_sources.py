# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Two race controls are told apart by the numbers of their snapshots."""

from __future__ import annotations

from collections.abc import Iterable

from evgp_rcs_console.client import Sources, spoken, WITHIN
import pytest


def are_two(numbers: Iterable[int]) -> bool:
    """Return whether there are two, once snapshots with these numbers have come, 4 a second."""
    sources, two = Sources(), False
    for count, number in enumerate(numbers):
        two = sources.are_two(number, count / 4)
    return two


@pytest.mark.parametrize(
    ('numbers', 'two'),
    [
        ([500, 1, 501, 2, 502, 3], True),
        ([7, 7, 8, 8, 9, 9], True),
        ([7, 500, 8, 501, 9, 502], True),
        ([500, 1, 501, 2, 502, 3, *range(503, 504 + int(4 * WITHIN))], False),  # one has ended
        ([1, 2, 3, 4], False),
        ([1, 2, 7, 8], False),
        ([500, 501, 1, 2, 3], False),  # it starts again
        ([18446744073709551615], False),
    ],
)
def test_two_race_controls_are_noticed_and_one_is_not_two(numbers: list[int], two: bool) -> None:
    assert are_two(numbers) is two


def test_a_state_has_one_name_wherever_it_is_read() -> None:
    told = 'GREEN_GREEN refused: the race is in IN_GARAGE; kart 7 (A_B) says RED_RED; RECORD_MSR'

    assert spoken(told) == (
        'GREEN GREEN refused: the race is in IN GARAGE; kart 7 (A_B) says RED RED; MSR WAS USED'
    )
