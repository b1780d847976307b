# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The race states and their strictness (§3.A).

The rest of the project compares states only with ``stricter``.
"""

from __future__ import annotations

import enum


class RaceState(enum.Enum):
    """
    A race state of the proposal (§3.A); the value is its name on the wire.

    The members are in order of strictness, loosest first.
    """

    GREEN_GREEN = 'GREEN_GREEN'
    GRID_ACTIVE = 'GRID_ACTIVE'
    IN_GARAGE = 'IN_GARAGE'
    RED_FLAG = 'RED_FLAG'
    RED_RED = 'RED_RED'

    # Each member exists only once. The default hash is slow: Python computes it from the name.
    __hash__ = object.__hash__

    def __init__(self, name: str) -> None:
        self.strictness = len(type(self).__members__)
        """The rank of this state, from 0 (GREEN_GREEN) to 4 (RED_RED)."""

    @property
    def is_red(self) -> bool:
        """Return whether this state makes a kart stop: RED_FLAG or RED_RED."""
        return self is RaceState.RED_FLAG or self is RaceState.RED_RED


def stricter(one: RaceState, other: RaceState) -> RaceState:
    """Return the stricter of two states (§2.C)."""
    return one if one.strictness >= other.strictness else other
