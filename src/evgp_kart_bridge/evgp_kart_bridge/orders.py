# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The rules of `RaceStateWatch`: what a stack must do, by what the bridge says and when.

Pure: no ROS, clock or thread. ``orders.hpp`` of evgp_race_watch_cpp has them a second time, in
C++; ``test_orders.py`` holds one against the other.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
import math

from evgp_protocol.states import RaceState, stricter

FORGIVEN = 1.0
"""Maximum time, s, without knowing the state after which a stack still starts without a new
GRID_ACTIVE."""

NEVER_HEARD = 'no GRID_ACTIVE was heard before GREEN_GREEN'
"""Why a kart stands under GREEN_GREEN if its stack was started too late."""

TOO_LATE = (
    f'this node was too busy, or the bridge silent, for more than {FORGIVEN:g} s since '
    'GRID_ACTIVE; the kart waits for the next one'
)
"""Why, if its stack had heard GRID_ACTIVE."""

ASK_AGAIN = 0.2
"""Time after which an acknowledgement is sent again while the bridge has not taken it, s."""


@dataclasses.dataclass(frozen=True)
class Said:
    """What counts of a message of the bridge; None: what is no race state."""

    bridge: int
    state: RaceState | None
    reached: RaceState | None
    order: int
    acknowledged: bool
    reason: str


@dataclasses.dataclass(frozen=True, eq=False)
class Order:
    """
    What the kart must do, from one moment on. Two orders are never equal, only the same one is.

    :ivar state: the state to obey.
    :ivar number: the number of race control's command, as in `KartRaceState.order`. 0: the order
        cannot be acknowledged, because there is no command, or because a kart that has reached
        `state` has nothing to say.
    :ivar reached: what an acknowledgement says. It differs from `state` when the kart must obey
        RED_RED under a commanded RED_FLAG, as in a team stop: a kart that stands has carried out
        both. It differs from the command, and is RED_RED, when the kart has stopped itself in
        GRID_ACTIVE or GREEN_GREEN. None if `number` is 0.
    """

    state: RaceState
    number: int
    reached: RaceState | None


class Orders:
    """
    The orders of one stack. Every time is in seconds, by one clock that never goes back.

    :ivar said: the bridge's last message; None: there was none.
    :param lease: time of silence after which the kart obeys RED_RED, seconds.
    :param forgiven: as `FORGIVEN`.
    """

    def __init__(self, lease: float, forgiven: float = FORGIVEN) -> None:
        self.said: Said | None = None
        self._lease = lease
        self._forgiven = forgiven
        self._heard_at = -math.inf
        self._bridges_alive: int | None = None  # None: the middleware has not said yet
        self._armed_by: int | None = None  # the bridge whose GRID_ACTIVE was heard
        self._grid_by: int | None = None  # the same, whether it still arms or not
        self._sure_at = -math.inf  # when there was no doubt last
        self._order = Order(RaceState.RED_RED, 0, None)
        self._asked: Order | None = None
        self._ask_again_at = -math.inf

    def order(self, now: float) -> Order:
        """Return what to do; the same object until something else is to be done."""
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
        """Return the state to obey, and why that is not what is commanded; empty: it is."""
        doubt = self.doubt(now)
        if doubt or self.said is None:
            return RaceState.RED_RED, doubt
        state = self.said.state
        if state is None:
            return RaceState.RED_RED, 'the bridge says what is no race state'
        if state is RaceState.GREEN_GREEN and not self._is_armed(now):
            heard = self._grid_by == self.said.bridge
            return RaceState.RED_RED, TOO_LATE if heard else NEVER_HEARD
        return state, self.said.reason

    def doubt(self, now: float) -> str:
        """Return why what was heard last may not be true any more; empty: it is."""
        if self.said is None:
            return 'the bridge was not heard yet'
        if now - self._heard_at > self._lease:
            return 'the bridge is silent, or this node was too busy to hear it'
        if self._bridges_alive not in (None, 1):
            return f'{self._bridges_alive} bridges speak; there must be one'
        return ''

    def hear(self, heard: Sequence[Said], since: float, now: float) -> None:
        """
        Take what the bridge has said, oldest first; the last of it counts.

        :param since: none of it was said before that.
        """
        # A doubt, and what came in between, end the order before, even if it comes back.
        self.order(now)
        self._heard_at = since
        for said in heard:
            self.said = said
            self._follow(said, now)
            self.order(now)

    def count_bridges(self, alive: int) -> None:
        """Take how many bridges the middleware knows to be alive."""
        self._bridges_alive = alive
        if alive > 1:
            self._armed_by = None
            self._grid_by = None

    def look(self, now: float) -> None:
        """Notice that time has passed; called about five times in each lease."""
        if not self.doubt(now):
            if not self._is_armed(now):
                self._armed_by = None
            self._sure_at = now

    def asks(self, order: Order, now: float) -> bool:
        """
        Return whether to ask the bridge now to acknowledge this order, which the kart has done.

        Not if it is over, cannot be acknowledged, is acknowledged, or was asked just now.
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
        return now - self._sure_at <= self._forgiven

    def _follow(self, said: Said, now: float) -> None:
        """
        Arm or disarm by one message, however late it is taken.

        A GRID_ACTIVE that waited for a busy stack counts as long as the doubt is forgiven. One
        of two bridges does not: the other may say GREEN_GREEN. The middleware may tell of a second
        bridge after what that said, or, of one that came and went, never: so a GRID_ACTIVE counts
        for the bridge that said it alone.
        """
        if said.state is not RaceState.GREEN_GREEN:
            self._grid_by = said.bridge if said.state is RaceState.GRID_ACTIVE else None
        doubt = self.doubt(now)
        forgiven = now - self._sure_at <= self._forgiven and self._bridges_alive in (None, 1)
        if said.state is RaceState.GRID_ACTIVE:
            self._armed_by = said.bridge if forgiven or not doubt else None
        elif said.state is not RaceState.GREEN_GREEN or not self._is_armed(now):
            self._armed_by = None
        if not doubt:
            self._sure_at = now


def _includes(state: RaceState, reached: RaceState) -> bool:
    """Return whether a kart that has reached `state` may say that it has `reached` the other."""
    both_red = state.is_red and reached.is_red
    return state is reached or (both_red and stricter(state, reached) is state)
