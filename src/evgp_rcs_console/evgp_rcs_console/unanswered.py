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
What this official has sent and race control has not accepted or answered yet.

Each stop is sent again until race control accepts it: that can do no harm, since it only ever
makes things stricter. But a stop must not outlive what an official decides later, so a command of
this console that loosens, once race control has accepted it, ends the stops given before it. ALL
KILL and the record of the MSR stand until race control has accepted them.

Pure: times go in, what is to be sent comes out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from evgp_rcs.catalogue import CATALOGUE, CommandKind
from evgp_rcs_console.commands import Order

PRESS_AGAIN = 0.5
"""Time between two presses of a stop that is not answered, in seconds."""

LOOSENS_RACE = frozenset(
    kind for kind, entry in CATALOGUE.items() if entry.loosens and entry.names_karts
)
"""Commands that end the stops given before them: those to the race and to its karts."""

ENDED_BY_RELEASE = frozenset(
    kind for kind, entry in CATALOGUE.items() if entry.stop and entry.to_one_kart
)
"""The stops of a kart that end with its accepted release."""

ENDED_BY_RACE = ENDED_BY_RELEASE | {CommandKind.RED_FLAG}
"""The stops that end with an accepted command of ``LOOSENS_RACE``."""


@dataclass(frozen=True)
class Standing:
    """
    A stop that is being pressed.

    :param order: the newest press of it by the official.
    :param since: when it was asked for first and not accepted, in seconds.
    :param presses: how often it was sent.
    :param due: when it is sent next.
    :param said: why race control did not accept it, if it said so.
    """

    order: Order
    since: float
    presses: int = 0
    due: float = 0.0
    said: str = ''


class StandingStops:
    """The stops that are being pressed, by command and kart."""

    def __init__(self) -> None:
        """Begin with none."""
        self._stops: dict[tuple[CommandKind, int], Standing] = {}

    @property
    def pressed(self) -> tuple[Standing, ...]:
        """Return what is being pressed, the oldest first."""
        return tuple(self._stops.values())

    def add(self, order: Order, now: float) -> None:
        """Take a stop that an official gave; it is due at once."""
        known = self._stops.get(_key(order))
        if known is None:
            known = Standing(order, since=now)
        self._stops[_key(order)] = replace(known, order=order, due=now)

    def press(self, now: float) -> list[Order]:
        """Return what is to be sent now, and count it as sent."""
        pressed = []
        for key, stop in self._stops.items():
            if stop.due <= now:
                self._stops[key] = replace(stop, presses=stop.presses + 1, due=now + PRESS_AGAIN)
                pressed.append(stop.order)
        return pressed

    def next_press(self, now: float) -> float | None:
        """Return the time until something is to be sent, in seconds; None: nothing is."""
        if not self._stops:
            return None
        return max(0.0, min(stop.due for stop in self._stops.values()) - now)

    def stands(self, order: Order) -> bool:
        """Return whether this very press of a stop still waits to be accepted."""
        stop = self._stops.get(_key(order))
        return stop is not None and stop.order is order

    def accepted(self, order: Order) -> bool:
        """
        Take that race control has accepted a command; return whether something stops standing.

        A stop that was pressed again by the official after this press stands on.
        """
        before = len(self._stops)
        if self.stands(order):
            del self._stops[_key(order)]
        for key, stop in list(self._stops.items()):
            if stop.order.at < order.at and _ends(order, stop.order):
                del self._stops[key]
        return len(self._stops) < before

    def refused(self, order: Order, said: str, final: bool) -> None:
        """
        Take that race control has not accepted a stop, and why.

        :param final: it never will: the stop is given up.
        """
        if not self.stands(order):
            return
        if final:
            del self._stops[_key(order)]
        else:
            stop = self._stops[_key(order)]
            self._stops[_key(order)] = replace(stop, said=said)


def _key(order: Order) -> tuple[CommandKind, int]:
    return order.command, order.kart


def _ends(later: Order, stop: Order) -> bool:
    if later.command in LOOSENS_RACE:
        return stop.command in ENDED_BY_RACE
    if later.command is CommandKind.KART_IN_GARAGE:
        return stop.command in ENDED_BY_RELEASE and stop.kart == later.kart
    return False


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
