# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The lamp on a kart shows people nearby what to expect from the kart.

Its colours are those of Formula Student. This module is pure: the caller passes in the time.
"""

from __future__ import annotations

from evgp_protocol.states import RaceState

PHASE = 0.2
"""Time for which a flashing lamp is lit, and then dark, in seconds: 2.5 flashes a second."""

Colour = tuple[float, float, float]
YELLOW: Colour = (1.0, 1.0, 0.0)
BLUE: Colour = (0.0, 0.0, 1.0)
DARK: Colour = (0.0, 0.0, 0.0)

FLASHES = True
_FINISHED = (BLUE, not FLASHES)
_LAMP = {
    RaceState.IN_GARAGE: (DARK, not FLASHES),  # off
    RaceState.GRID_ACTIVE: (YELLOW, not FLASHES),  # ready
    RaceState.GREEN_GREEN: (YELLOW, FLASHES),  # driving
    RaceState.RED_FLAG: (YELLOW, FLASHES),  # still driving
    RaceState.RED_RED: (BLUE, FLASHES),  # emergency, or any doubt
}


def lamp(state: RaceState, acknowledged: bool, now: float) -> Colour:
    """
    Return the lamp's colour, as red, green and blue from 0 to 1.

    :param state: the state that the kart obeys.
    :param acknowledged: whether the kart has acknowledged the state. An acknowledged RED_FLAG
        means *finished*. An acknowledged RED_RED may be the end of a race or ALL KILL, so it stays
        an emergency.
    :param now: the time, in seconds. A flashing lamp is lit at time 0.
    """
    finished = state is RaceState.RED_FLAG and acknowledged
    colour, flashes = _FINISHED if finished else _LAMP[state]
    return DARK if flashes and now % (2 * PHASE) >= PHASE else colour
