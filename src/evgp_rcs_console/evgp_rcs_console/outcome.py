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

"""
Whether the answer to a command is still true.

An answer is true when it comes: "GREEN_GREEN is sent to karts 1, 2". A moment later another
official may send RED FLAG. So the effect of the command is compared with each new snapshot, and
once the effect has changed, the answer must no longer be shown.

Pure: snapshots and times go in.
"""

from __future__ import annotations

from evgp_protocol.states import RaceState
from evgp_rcs.catalogue import CATALOGUE, Result
from evgp_rcs_console.commands import Order
from evgp_rcs_console.snapshot import Kart, Race, State

SETTLED = 1.0
"""Time after an answer when every snapshot that comes is newer than it, in seconds. Race control
publishes one every 0.5 s at least."""


class Outcome:
    """
    The effect of an accepted command.

    :param at: time of its answer, in seconds.
    """

    def __init__(self, order: Order, at: float) -> None:
        """Wait for a snapshot that shows the effect."""
        self.order = order
        self._at = at
        self._seen: object = None

    def stands(self, race: Race, at: float) -> bool:
        """
        Return whether a snapshot, like every one before it, agrees with the answer.

        :param at: time when the snapshot came, in seconds.
        """
        shown = self._shown(race)
        if self._seen is None and self._is_done(race):
            self._seen = shown
        if self._seen is None:
            return at - self._at < SETTLED  # it may be older than the answer
        return shown == self._seen

    def _shown(self, race: Race) -> object:
        """Return the part of a snapshot that the command can change."""
        entry = CATALOGUE[self.order.command]
        if entry.result.track_open is not None:
            return race.track.is_open
        if entry.names_heat:
            return race.state, _racing(race)
        kart = race.kart(self.order.kart)
        if kart is None:
            return (race.state,)
        return kart.sent, kart.hold, kart.in_race, kart.place

    def _is_done(self, race: Race) -> bool:
        order = self.order
        entry = CATALOGUE[order.command]
        if entry.names_heat:
            return any(
                heat.name == order.heat and heat.karts == _racing(race) for heat in race.heats
            )
        return is_so(entry.result, race, race.kart(order.kart))


def is_so(result: Result, race: Race, kart: Kart | None) -> bool:
    """
    Return whether a snapshot shows what a command brings about.

    :param kart: the kart that the command is for, if it is for one.
    """
    shown = []
    if result.race:
        shown.append(race.state in map(_state, result.race))
    if result.track_open is not None:
        shown.append(race.track.is_open is result.track_open)
    if kart is not None and result.hold:
        shown.append(kart.hold in map(_state, result.hold))
    if kart is not None and result.in_race is not None:
        shown.append(kart.in_race is result.in_race)
    if kart is not None and result.placed is not None:
        shown.append((kart.place > 0) is result.placed)
    return bool(shown) and all(shown)


def _state(each: RaceState | None) -> State:
    return State.UNKNOWN if each is None else State[each.name]


def _racing(race: Race) -> tuple[int, ...]:
    return tuple(kart.number for kart in race.karts if kart.in_race)
