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
What this official has sent and race control has not answered yet.

Pure: times go in.
"""

from __future__ import annotations

from evgp_rcs.catalogue import CommandKind
from evgp_rcs_console.commands import Order
from evgp_rcs_console.standing import Standing

LATE = 0.3
"""Time without an answer after which the window says so, in seconds."""


class Unanswered:
    """
    Commands that wait for an answer, and stops that are sent until they are accepted.

    :ivar stops: the stops that the client sends again and again, the oldest first.
    """

    def __init__(self) -> None:
        """Begin with none."""
        self.stops: tuple[Standing, ...] = ()
        self._orders: dict[tuple[CommandKind, int], Order] = {}

    def __bool__(self) -> bool:
        """Return whether a command waits for its answer; stops do not count."""
        return bool(self._orders)

    def add(self, order: Order) -> None:
        """Take a command that was sent and is no stop."""
        self._orders[order.command, order.kart] = order

    def answered(self, order: Order) -> None:
        """Take that a command has its answer; a newer one of the same kind still waits."""
        if self._orders.get((order.command, order.kart)) is order:
            del self._orders[order.command, order.kart]

    def ages(self, now: float) -> dict[tuple[CommandKind, int], float]:
        """Return for how long each command has waited, in seconds."""
        return {key: now - order.at for key, order in self._orders.items()}

    def oldest(self, now: float) -> Order | None:
        """Return the command that has waited longest, if that is longer than ``LATE``."""
        order = min(self._orders.values(), key=lambda order: order.at, default=None)
        return order if order is not None and now - order.at > LATE else None

    def all_kill(self, now: float) -> Standing | None:
        """Return ALL KILL, if race control has not accepted it for longer than ``LATE``."""
        return next((stop for stop in self._late(now) if _is_all_kill(stop)), None)

    def other_stops(self, now: float) -> list[Standing]:
        """Return the other stops that race control has not accepted for longer than ``LATE``."""
        return [stop for stop in self._late(now) if not _is_all_kill(stop)]

    def _late(self, now: float) -> list[Standing]:
        return [stop for stop in self.stops if now - stop.since > LATE]


def _is_all_kill(stop: Standing) -> bool:
    return stop.order.command is CommandKind.ALL_KILL
