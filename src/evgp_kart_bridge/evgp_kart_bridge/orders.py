# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The rules by which `RaceStateWatch` decides what a stack must do.

Their inputs are the bridge's messages and the times of these messages. A *doubt* is a time during
which the last message may no longer be true, for example because the bridge is silent. The kart
must then obey RED_RED. This module is pure: it uses no ROS, clock or thread.

``orders.hpp`` of evgp_race_watch_cpp contains the same rules in C++, and ``test_orders.py``
compares the two.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
import math

from evgp_protocol.states import RaceState, stricter

FORGIVEN = 1.0
"""Maximum duration of a doubt after which a stack still obeys GREEN_GREEN without a new
GRID_ACTIVE, in seconds."""

LONGEST_LEASE = 2.0
"""Maximum lease of a watch, and of a bridge, in seconds."""

NEVER_HEARD = 'no GRID_ACTIVE was heard before GREEN_GREEN'
"""Reason for not obeying GREEN_GREEN if the stack was started too late."""

TOO_LATE = (
    f'this node was too busy, or the bridge silent, for more than {FORGIVEN:g} s since '
    'GRID_ACTIVE; the kart waits for the next one'
)
"""Reason for not obeying GREEN_GREEN although the stack heard GRID_ACTIVE before it."""

ASK_AGAIN = 0.2
"""Time before the stack repeats an acknowledgement that the bridge did not accept, in seconds."""


@dataclasses.dataclass(frozen=True)
class Said:
    """The fields of a bridge's message that the rules use. None means an unknown race state."""

    bridge: int
    state: RaceState | None
    reached: RaceState | None
    order: int
    acknowledged: bool
    reason: str


@dataclasses.dataclass(frozen=True, eq=False)
class Order:
    """
    What the kart must do from a certain moment on. An order equals only itself.

    :ivar state: the state to obey.
    :ivar number: the number of race control's command, as in `KartRaceState.order`. With 0, the
        order cannot be acknowledged, because there is no command or nothing to report.
    :ivar reached: the state to acknowledge, as in `KartRaceState.reached`, or None if `number` is
        0. It differs from `state` if race control commands RED_FLAG and the kart must obey
        RED_RED, for example because of a team stop. A kart at a standstill has carried out both.
    """

    state: RaceState
    number: int
    reached: RaceState | None


def valid_lease(lease: float) -> float:
    """
    Return the lease of a watch.

    :raises ValueError: if a kart would drive on for too long after its bridge has died.
    """
    if not 0.0 < lease <= LONGEST_LEASE:
        raise ValueError(f'lease must be above 0 s and at most {LONGEST_LEASE:g} s, not {lease!r}')
    return lease


class Orders:
    """
    The orders of one stack. All times are in seconds, by one clock that never goes back.

    :ivar said: the bridge's last message; None if there was none.
    :param lease: silence of the bridge after which the kart must obey RED_RED, in seconds.
    """

    def __init__(self, lease: float) -> None:
        self.said: Said | None = None
        self._lease = lease
        self._heard_at = -math.inf
        self._bridges_alive: int | None = None  # None: not reported yet
        self._armed_by: int | None = None  # the bridge whose GRID_ACTIVE was heard
        self._grid_by: int | None = None  # the same, even if it no longer arms
        self._sure_at = -math.inf  # the last time without a doubt
        self._order = Order(RaceState.RED_RED, 0, None)
        self._asked: Order | None = None
        self._ask_again_at = -math.inf

    def order(self, now: float) -> Order:
        """Return the current order, as the same object until the kart has to do something else."""
        state, _ = self.judge(now)
        number, reached = 0, None
        if self.said is not None and not self.doubt(now) and self.said.order:
            reached = self.said.reached
            if reached is not None and _includes(state, reached):
                number = self.said.order
        order = Order(state, number, reached if number else None)
        if dataclasses.astuple(order) != dataclasses.astuple(self._order):
            self._order = order
        return self._order

    def judge(self, now: float) -> tuple[RaceState, str]:
        """Return the state to obey, and the reason if it differs from the command."""
        doubt = self.doubt(now)
        if doubt or self.said is None:
            return RaceState.RED_RED, doubt
        state = self.said.state
        if state is None:
            return RaceState.RED_RED, 'the bridge publishes an unknown race state'
        if state is RaceState.GREEN_GREEN and not self._is_armed(now):
            heard = self._grid_by == self.said.bridge
            return RaceState.RED_RED, TOO_LATE if heard else NEVER_HEARD
        return state, self.said.reason

    def doubt(self, now: float) -> str:
        """Return why the last message may no longer be true, or an empty string."""
        if self.said is None:
            return 'the bridge has not been heard yet'
        if now - self._heard_at > self._lease:
            return 'the bridge is silent, or this node was too busy to hear it'
        if self._bridges_alive not in (None, 1):
            return f'{self._bridges_alive} bridges are running; there must be one'
        return ''

    def hear(self, heard: Sequence[Said], since: float, now: float) -> None:
        """
        Process the bridge's messages.

        :param heard: the messages, oldest first.
        :param since: a time before which none of them was sent.
        :param now: the current time.
        """
        # A doubt or another state ends the previous order, even if the same state follows it.
        self.order(now)
        self._heard_at = since
        for said in heard:
            self.said = said
            self._follow(said, now)
            self.order(now)

    def count_bridges(self, alive: int) -> None:
        """Process the number of bridges that the middleware reports as alive."""
        self._bridges_alive = alive
        if alive > 1:
            self._armed_by = None
            self._grid_by = None

    def look(self, now: float) -> None:
        """Let time pass. Call this about five times in each lease."""
        if not self.doubt(now):
            if not self._is_armed(now):
                self._armed_by = None
            self._sure_at = now

    def asks(self, order: Order, now: float) -> bool:
        """
        Return whether to send the acknowledgement of this order to the bridge now.

        The answer is False if the order is over, is already acknowledged or has nothing to
        acknowledge, or if the stack sent the acknowledgement less than `ASK_AGAIN` ago. If the
        answer is True, the caller must send the acknowledgement.
        """
        if order is not self.order(now) or order.reached is None:
            return False
        if self.said is None or self.said.acknowledged:
            return False
        if order is self._asked and now < self._ask_again_at:
            return False
        self._asked, self._ask_again_at = order, now + ASK_AGAIN
        return True

    def _is_armed(self, now: float) -> bool:
        if self.said is None or self._armed_by != self.said.bridge:
            return False
        return now - self._sure_at <= FORGIVEN

    def _follow(self, said: Said, now: float) -> None:
        """
        Arm or disarm the stack because of one message, however late it is processed.

        A GRID_ACTIVE that waited for a busy stack arms it if the doubt is short enough. If there
        are two bridges, GRID_ACTIVE from one of them does not arm the stack, because the other may
        publish GREEN_GREEN. The middleware may report a second bridge only after its messages, or
        never if that bridge came and went. For this reason, GRID_ACTIVE arms the stack only for
        the bridge that published it.
        """
        if said.state is not RaceState.GREEN_GREEN:
            self._grid_by = said.bridge if said.state is RaceState.GRID_ACTIVE else None
        doubt = self.doubt(now)
        forgiven = now - self._sure_at <= FORGIVEN and self._bridges_alive in (None, 1)
        if said.state is RaceState.GRID_ACTIVE:
            self._armed_by = said.bridge if forgiven or not doubt else None
        elif said.state is not RaceState.GREEN_GREEN or not self._is_armed(now):
            self._armed_by = None
        if not doubt:
            self._sure_at = now


def _includes(state: RaceState, reached: RaceState) -> bool:
    """Return whether a kart that has reached `state` may acknowledge `reached`."""
    both_red = state.is_red and reached.is_red
    return state is reached or (both_red and stricter(state, reached) is state)
