# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
    """Return the race state of a message; None: UNKNOWN, or a number that is no race state."""
    return _STATE.get(message.state)
