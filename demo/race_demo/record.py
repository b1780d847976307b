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
What was heard of one race, from both sides: race control's topics, and the karts.

Pure: nothing is awaited or judged here. All times are seconds of the machine's monotonic clock,
which race control, in its own process, stamps its events with too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.official import Answer

CLOCK_SLACK = 0.05
"""
How much too late an event may be stamped, s.

Race control stamps what it did after it did it: a kart's answer can be quicker.
"""


@dataclass(frozen=True)
class Entrant:
    """
    A kart of the roster.

    :param kind: what it is, for the reader.
    """

    number: int
    team: str
    kind: str
    in_race: bool = True

    def __str__(self) -> str:
        """Return how officials call this kart."""
        return f'kart {self.number} ({self.team})'


@dataclass
class Order:
    """
    A state that race control began to send to a kart, and what became of it.

    :param seen: when the kart had it: a plain kart its first frame, a kart with ROS the first
        message of its bridge that says to obey it. None: never.
    :param acknowledged: when race control heard the kart acknowledge it. None: never.
    """

    at: float
    kart: int
    state: RaceState
    seen: float | None = None
    acknowledged: float | None = None


@dataclass
class RaceRecord:
    """
    All that was heard of one race.

    :param began: when the record begins.
    :param first_event: the sequence number of its first event.
    :param finish_delays: race control's parameter.
    :param events: what ``/rcs/events`` said since the record began.
    :param final: what ``/rcs/race`` said at its end.
    :param seen: for each kart, the states it saw since the record began.
    :param over: ``/rcs/race`` said that the race is over.
    :param refused: what GREEN_GREEN was answered where it had to be refused.
    :param all_kill_called: when the official called ALL_KILL.
    :param failure: what was awaited in vain, so that the race went no further.
    """

    title: str
    began: float
    first_event: int
    entrants: Sequence[Entrant]
    finish_delays: Sequence[float]
    events: list[msg.RaceEvent] = field(default_factory=list)
    final: msg.Race | None = None
    seen: dict[int, list[tuple[float, RaceState | None]]] = field(default_factory=dict)
    over: bool = False
    refused: list[Answer] = field(default_factory=list)
    all_kill_called: float | None = None
    failure: str = ''

    def orders(self) -> list[Order]:
        """Return what each kart was told, in order, with what became of it."""
        orders: list[Order] = []
        newest: dict[int, Order] = {}
        for event in self.events:
            state = state_of(event.state)
            if event.kind == msg.RaceEvent.KART_STATE and state is not None:
                order = Order(time_of(event), event.kart, state)
                order.seen = self._seen_at(order)
                newest[event.kart] = order
                orders.append(order)
            elif event.kind == msg.RaceEvent.ACKNOWLEDGED and event.kart in newest:
                order = newest[event.kart]
                if order.state is state:
                    order.acknowledged = time_of(event)
        return orders

    def orders_to(self, number: int) -> list[Order]:
        """Return what one kart was told."""
        return [order for order in self.orders() if order.kart == number]

    def _seen_at(self, order: Order) -> float | None:
        return next(
            (
                at
                for at, state in self.seen.get(order.kart, [])
                if state is order.state and at >= order.at - CLOCK_SLACK
            ),
            None,
        )


def time_of(event: msg.RaceEvent) -> float:
    """Return when an event happened, monotonic, in seconds."""
    return float(event.monotonic.sec + event.monotonic.nanosec * 1e-9)
