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
For a team's stack: what to do now, and how to say that it is done.

A subscription alone is not enough. A bridge that died or hangs cannot say so, and the last thing
it said may have been GREEN_GREEN. And a stack that compares what it reached with what is commanded
by now may say "I stand" at full speed: what it reached was the command before.
"""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
import math
import threading
import time
from typing import Any

from evgp_node.states import state_message, state_of
from evgp_protocol import clock
from evgp_protocol.states import RaceState, stricter
from evgp_rcs_msgs.msg import KartRaceState
from evgp_rcs_msgs.srv import Acknowledge
from rclpy._rclpy_pybind11 import InvalidHandle
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.guard_condition import GuardCondition
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.subscription import Subscription
from rclpy.task import Future

try:
    from rclpy.event_handler import SubscriptionEventCallbacks
except ImportError:  # ROS 2 Humble has it there
    from rclpy.qos_event import SubscriptionEventCallbacks

LEASE = 0.5
"""The bridge's default `liveliness_lease`, seconds."""

FORGIVEN = 1.0
"""Maximum time, s, without knowing the state after which a stack still starts without a new
GRID_ACTIVE."""

UNHEARD = 2.0
"""Time after the start without a bridge after which the node's log says so, seconds."""

LOG_AGAIN = 10.0
"""Time before a reason that comes back is logged again, seconds."""

ASK_AGAIN = 0.2
"""Time after which an acknowledgement is sent again while the bridge has not taken it, s."""

BACKLOG = 100
"""Maximum number of messages kept for a busy stack: more than the bridge says in `FORGIVEN`."""


def race_state_qos(lease: float) -> QoSProfile:
    """
    Return the QoS of ``~/race_state`` and ``~/stop``: the bridge's, and a plain subscriber's.

    Latched, and the bridge must say every `lease` that it lives, by publishing. Only the newest
    message is kept: a late subscriber must not hear states that do not hold any more, and one
    that asks for none of them may wait for seconds until Fast DDS has skipped them.

    :param lease: in seconds; a subscriber's must not be shorter than the bridge's.
    """
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
        liveliness_lease_duration=Duration(seconds=lease),
    )


def watch_qos(lease: float) -> QoSProfile:
    """
    Return the QoS of the watch's subscription to ``~/race_state``.

    Every message waits for a stack that is busy, so that it hears every state. What was said
    before it began to listen it does not hear, however much the publisher keeps.

    :param lease: in seconds; not shorter than the bridge's.
    """
    qos = race_state_qos(lease)
    qos.depth = BACKLOG
    qos.durability = DurabilityPolicy.VOLATILE
    return qos


@dataclasses.dataclass(frozen=True, eq=False)
class Order:
    """
    What the kart must do, from one moment on. Two orders are never equal, only the same one is.

    :ivar state: the state to obey.
    :ivar number: the number of race control's command, as in `KartRaceState.order`. 0: the order
        cannot be acknowledged, because there is no command, or because reaching `state` does not
        mean that the command is carried out.
    :ivar commanded: what race control commands, and what an acknowledgement says. It differs from
        `state` when the kart must obey RED_RED under a commanded RED_FLAG, as in a team stop: a
        kart that stands has carried out both. None if `number` is 0.
    """

    state: RaceState
    number: int
    commanded: RaceState | None


class RaceStateWatch:
    """
    What the kart must do now, for a node of a team's stack.

    In a timer of the steady clock, about 20 times a second::

        order = self.watch.order
        if self.drive(order.state):  # True once the kart has reached that state
            self.watch.acknowledge(order)

    GREEN_GREEN must be armed here too: by a GRID_ACTIVE that this watch has heard from the same
    bridge. So a stack that
    is started again in mid-race, or one whose bridge was gone, does not drive off by itself.

    :ivar message: the bridge's last message; None: there was none.
    :param on_change: is called by the node's executor with each new state, beginning with
        RED_RED.
    :param topic: the bridge's topic; its service is ``acknowledge`` beside it.
    :param lease: the bridge's `liveliness_lease`, or longer, seconds.
    """

    def __init__(
        self,
        node: Node,
        on_change: Callable[[RaceState], None] = lambda state: None,
        topic: str = 'kart_bridge/race_state',
        lease: float = LEASE,
    ) -> None:
        """Subscribe."""
        self.message: KartRaceState | None = None
        self._on_change = on_change
        self._lease = lease
        self._heard_at = -math.inf
        self._bridges_alive: int | None = None  # None: the middleware has not said yet
        self._armed_by: int | None = None  # the bridge whose GRID_ACTIVE was heard
        self._sure_at = -math.inf  # when there was no doubt last
        # Of its own, so that subscription and alarm wait for the same things: see `_hear`.
        group = MutuallyExclusiveCallbackGroup()
        # When the executor last came round to `_pass`, and when before that.
        self._passed = self._passed_before = clock.now()
        self._told: RaceState | None = None
        # Whoever asks for the order, or acknowledges it, may do so in any thread.
        self._ordering = threading.RLock()
        self._order = Order(RaceState.RED_RED, 0, None)
        self._asked: Order | None = None
        self._asking: Future | None = None
        self._ask_again_at = -math.inf
        self._log = node.get_logger()
        self._began = clock.now()
        self._graph = f'ROS domain {node.context.get_domain_id()}'
        self._logged: dict[str, float] = {}  # reasons, and when each was logged
        self._logged_last = ''
        beside, slash, _ = topic.rpartition('/')
        self._bridge = node.create_client(
            Acknowledge, f'{beside}{slash}acknowledge', callback_group=group
        )
        self._subscription: Subscription | None = None
        self._subscription = node.create_subscription(
            KartRaceState,
            topic,
            self._hear,
            watch_qos(lease),
            callback_group=group,
            event_callbacks=SubscriptionEventCallbacks(liveliness=self._hear_liveliness),
        )
        # The middleware says when the bridge is gone; the clock says it whatever middleware it
        # is. A timer would not do: simulated time may stand still, and some middlewares wait for
        # a timer by the wall clock, for as long as that is set back.
        self._alarm = node.create_guard_condition(self._pass, callback_group=group)
        threading.Thread(
            target=_ring, args=(self._alarm, lease / 5), name='race state watch', daemon=True
        ).start()

    @property
    def state(self) -> RaceState:
        """
        Return the state to obey now.

        RED_RED before the bridge is heard, when it says so, once it has been silent for the
        lease, when it is gone, when two bridges speak, when it says what is no state, and when it
        says GREEN_GREEN that is not armed. It looks at the clock itself, so it holds also while
        the executor is busy.
        """
        return self.order.state

    @property
    def reason(self) -> str:
        """Why that is not what race control commands, for people; empty: it is."""
        with self._ordering:
            return self._judge(clock.now())[1]

    @property
    def order(self) -> Order:
        """
        Return what to do now: obey its `state`; once it is reached, acknowledge this very order.

        It is the same object until something else is to be done. A new command is a new order,
        also when it asks for the same state, and so is what follows a doubt or a team stop.
        """
        with self._ordering:
            now = clock.now()
            state, _ = self._judge(now)
            message = self.message
            number, commanded = 0, None
            if message is not None and not self._doubt(now):
                commanded = state_of(message.commanded)
                if message.order and commanded is not None and _carries_out(state, commanded):
                    number = message.order
            order = Order(state, number, commanded if number else None)
            if dataclasses.astuple(order) != dataclasses.astuple(self._order):
                self._order = order
            return self._order

    def acknowledge(self, order: Order) -> None:
        """
        Tell race control that the kart has reached the state of this order.

        Race control hears the state that it commanded, in the words of the wire: RED_FLAG from a
        kart that stands under RED_RED because of its team stop.

        Call it in every step in which that is true: it asks the bridge again after `ASK_AGAIN` if
        an answer is lost or refused, and does nothing once the order is acknowledged. It does
        nothing either when the order is not the present one any more, or has no number. It never
        waits. If the bridge refuses, the node's log says why.

        :param order: what the kart has done, as `order` was when the kart began to do it.
        """
        with self._ordering:
            now = clock.now()
            commanded = order.commanded
            if order is not self.order or commanded is None:
                return
            if self.message is None or self.message.acknowledged:
                return
            if order is self._asked and now < self._ask_again_at:
                return
            self._asked, self._ask_again_at = order, now + ASK_AGAIN
            unanswered, self._asking = self._asking, None
        # Not under the lock, which would hold up whoever asks for the state.
        if unanswered is not None:
            self._bridge.remove_pending_request(unanswered)  # the bridge may have died over it
        asking = self._bridge.call_async(
            Acknowledge.Request(order=order.number, reached=state_message(commanded))
        )
        asking.add_done_callback(lambda answered: self._hear_answer(order, answered))
        self._asking = asking

    def _hear_answer(self, order: Order, answered: Future) -> None:
        answer = answered.result()
        commanded = order.commanded
        refused = answer is not None and not answer.success
        if refused and commanded is not None and order is self.order:
            self._log.warning(
                f'{commanded.value} cannot be acknowledged: {answer.message}',
                throttle_duration_sec=1.0,
                throttle_time_source_type=_STEADY,
            )

    def _judge(self, now: float) -> tuple[RaceState, str]:
        doubt = self._doubt(now)
        if doubt or self.message is None:
            return RaceState.RED_RED, doubt
        state = state_of(self.message.state)
        if state is None:
            return RaceState.RED_RED, 'the bridge says what is no race state'
        if state is RaceState.GREEN_GREEN and not self._is_armed(now):
            return RaceState.RED_RED, 'no GRID_ACTIVE was heard before GREEN_GREEN'
        return state, str(self.message.reason)

    def _doubt(self, now: float) -> str:
        """Return why what was heard last may not be true any more; empty: it is."""
        if self.message is None:
            return 'the bridge was not heard yet'
        if now - self._heard_at > self._lease:
            return 'the bridge is silent, or this node was too busy to hear it'
        if self._bridges_alive not in (None, 1):
            return f'{self._bridges_alive} bridges speak; there must be one'
        return ''

    def _is_armed(self, now: float) -> bool:
        message = self.message
        if message is None or self._armed_by != message.bridge:
            return False
        return now - self._sure_at <= FORGIVEN

    def _hear(self, message: KartRaceState) -> None:
        # All that waits is taken now: a stop must not wait behind what was said before it.
        heard = [message, *self._take_waiting()]
        # A stack that was busy finds what was said meanwhile, an old GREEN_GREEN perhaps. It
        # came after the call of `_pass` before the last, or it would have been taken then. (The
        # last one does not say that: it may belong to the same turn of the executor. And the
        # stamp would say it only if the clocks of bridge and stack agree.)
        with self._ordering:
            # A doubt, and what came in between, end the order before, even if it comes back.
            self._order = self.order
            self._heard_at = self._passed_before
            now = clock.now()
            for each in heard:
                self.message = each
                self._follow(each, now)
                self._order = self.order
        self._look()

    def _take_waiting(self) -> list[KartRaceState]:
        """Return what waits behind the message that the executor has taken, oldest first."""
        waiting: list[KartRaceState] = []
        subscription = self._subscription
        if subscription is None:
            return waiting
        with subscription.handle:
            while len(waiting) < BACKLOG:
                taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
                if taken is None:
                    break
                waiting.append(taken[0])
        return waiting

    def _pass(self) -> None:
        self._passed_before = self._passed
        self._passed = clock.now()
        self._look()

    def _hear_liveliness(self, liveliness: Any) -> None:
        self._bridges_alive = liveliness.alive_count
        if self._bridges_alive > 1:
            self._armed_by = None
        self._look()

    def _follow(self, message: KartRaceState, now: float) -> None:
        """
        Arm or disarm by one message, however late it is taken.

        A GRID_ACTIVE that waited for a busy stack counts as long as the doubt is forgiven. One
        of two bridges does not: the other may say GREEN_GREEN. The middleware may tell of a second
        bridge after what that said, or, of one that came and went, never: so a GRID_ACTIVE counts
        for the bridge that said it alone.
        """
        said = state_of(message.state)
        doubt = self._doubt(now)
        forgiven = now - self._sure_at <= FORGIVEN and self._bridges_alive in (None, 1)
        if said is RaceState.GRID_ACTIVE:
            self._armed_by = message.bridge if forgiven or not doubt else None
        elif said is not RaceState.GREEN_GREEN or not self._is_armed(now):
            self._armed_by = None
        if not doubt:
            self._sure_at = now

    def _look(self) -> None:
        now = clock.now()
        if not self._doubt(now):
            if not self._is_armed(now):
                self._armed_by = None
            self._sure_at = now
        self._log_reason(now)
        state = self.order.state
        if state is not self._told:
            self._told = state
            self._on_change(state)

    def _log_reason(self, now: float) -> None:
        """Log each new reason, and that no bridge is heard."""
        reason = self.reason
        if self.message is None:
            if now < self._began + UNHEARD or self._subscription is None:
                return
            reason = (
                f'no bridge is heard on {self._subscription.topic_name} in {self._graph}: '
                'is it running, with the same ROS_DOMAIN_ID? On another machine of the kart, both '
                'need EVGP_GRAPH_INTERFACE'
            )
        if not reason:
            self._logged_last = ''
        elif (
            reason != self._logged_last and now - self._logged.get(reason, -LOG_AGAIN) >= LOG_AGAIN
        ):
            self._logged = {each: at for each, at in self._logged.items() if now - at < LOG_AGAIN}
            self._logged[reason], self._logged_last = now, reason
            text = f'The kart obeys {self.state.value}: {reason}'
            if self._doubt(now):
                self._log.warning(text)
            else:  # the bridge's own reason, of which it has warned
                self._log.info(text)


_STEADY = Clock(clock_type=ClockType.STEADY_TIME)


def _carries_out(state: RaceState, commanded: RaceState) -> bool:
    """Return whether a kart that has reached `state` has carried out the command."""
    both_red = state.is_red and commanded.is_red
    return state is commanded or (both_red and stricter(state, commanded) is state)


def _ring(alarm: GuardCondition, interval: float) -> None:
    """Wake a node's executor again and again, for as long as there is the node."""
    while True:
        time.sleep(interval)  # by the monotonic clock; a wait with a timeout need not be
        try:
            alarm.trigger()
        except InvalidHandle:
            return
