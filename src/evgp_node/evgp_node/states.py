# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Race states in ROS messages (§3.A)."""

from __future__ import annotations

from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg

_NUMBER: dict[RaceState | None, int] = {
    None: msg.RaceState.UNKNOWN,
    **{state: getattr(msg.RaceState, state.name) for state in RaceState},
}
_STATE = {number: state for state, number in _NUMBER.items()}


def state_message(state: RaceState | None) -> msg.RaceState:
    """Return a race state as a message; None is UNKNOWN."""
    return msg.RaceState(state=_NUMBER[state])


def state_of(message: msg.RaceState) -> RaceState | None:
    """Return the race state of a message; None for UNKNOWN or an invalid number."""
    return _STATE.get(message.state)
