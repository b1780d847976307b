# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
For a team's stack: what to do now, and how to say that it is done.

A subscription alone is not enough. A bridge that died or hangs cannot say so, and the last thing
it said may have been GREEN_GREEN. And a stack that compares what it reached with what is commanded
by now may say "I stand" at full speed: what it reached was the command before.
"""

from __future__ import annotations

from collections.abc import Callable
import threading
import time
from typing import Any

from evgp_kart_bridge.orders import Order, Orders, Said
from evgp_node.graph import kept_apart_by
from evgp_node.rclpy_private import take_waiting
from evgp_node.states import state_message, state_of
from evgp_protocol import clock
from evgp_protocol.states import RaceState
from evgp_rcs_msgs.msg import KartRaceState
from evgp_rcs_msgs.srv import Acknowledge
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle
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

UNHEARD = 2.0
"""Time after the start without a bridge after which the node's log says so, seconds."""

LOG_AGAIN = 10.0
"""Time before a reason that comes back is logged again, seconds."""

LOG_REASONS = 20
"""Maximum number of reasons logged in that time."""

BACKLOG = 100
"""Maximum number of messages kept for a busy stack: more than the bridge says in the time
that is forgiven."""


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
        self.message: KartRaceState | None = None
        self._on_change = on_change
        # Of its own, so that subscription and alarm wait for the same things: see `_hear`.
        group = MutuallyExclusiveCallbackGroup()
        # When the executor last came round to `_pass`, and when before that.
        self._passed = self._passed_before = clock.now()
        self._told: RaceState | None = None
        # Whoever asks for the order, or acknowledges it, may do so in any thread.
        self._ordering = threading.RLock()
        self._orders = Orders(lease)
        self._asking: Future | None = None
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
            return self._orders.judge(clock.now())[1]

    @property
    def order(self) -> Order:
        """
        Return what to do now: obey its `state`; once it is reached, acknowledge this very order.

        It is the same object until something else is to be done. A new command is a new order,
        also when it asks for the same state, and so is what follows a doubt or a team stop.
        """
        with self._ordering:
            return self._orders.order(clock.now())

    def acknowledge(self, order: Order) -> None:
        """
        Tell race control that the kart has reached the state of this order.

        Race control hears `Order.reached`, in the words of the wire: RED_FLAG from a kart that
        stands under RED_RED because of its team stop, and RED_RED from one that stopped itself in
        GREEN_GREEN.

        Call it in every step in which that is true: it asks the bridge again after 0.2 s if
        an answer is lost or refused, and does nothing once the order is acknowledged. It does
        nothing either when the order is not the present one any more, or has no number. It never
        waits. If the bridge refuses, the node's log says why.

        :param order: what the kart has done, as `order` was when the kart began to do it.
        """
        with self._ordering:
            if not self._orders.asks(order, clock.now()):
                return
            unanswered, self._asking = self._asking, None
        # Not under the lock, which would hold up whoever asks for the state.
        if unanswered is not None:
            self._bridge.remove_pending_request(unanswered)  # the bridge may have died over it
        asking = self._bridge.call_async(
            Acknowledge.Request(order=order.number, reached=state_message(order.reached))
        )
        asking.add_done_callback(lambda answered: self._hear_answer(order, answered))
        self._asking = asking

    def _hear_answer(self, order: Order, answered: Future) -> None:
        answer = answered.result()
        reached = order.reached
        refused = answer is not None and not answer.success
        if refused and reached is not None and order is self.order:
            self._log.warning(
                f'{reached.value} cannot be acknowledged: {answer.message}',
                throttle_duration_sec=1.0,
                throttle_time_source_type=_STEADY,
            )

    def _hear(self, message: KartRaceState) -> None:
        # All that waits is taken now: a stop must not wait behind what was said before it.
        heard = [message]
        if self._subscription is not None:
            heard += take_waiting(self._subscription, BACKLOG)
        # A stack that was busy finds what was said meanwhile, an old GREEN_GREEN perhaps. It
        # came after the call of `_pass` before the last, or it would have been taken then. (The
        # last one does not say that: it may belong to the same turn of the executor. And the
        # stamp would say it only if the clocks of bridge and stack agree.)
        with self._ordering:
            said = [_said(each) for each in heard]
            self._orders.hear(said, self._passed_before, clock.now())
            self.message = heard[-1]
        self._look()

    def _pass(self) -> None:
        self._passed_before = self._passed
        self._passed = clock.now()
        self._look()

    def _hear_liveliness(self, liveliness: Any) -> None:
        with self._ordering:
            self._orders.count_bridges(liveliness.alive_count)
        self._look()

    def _look(self) -> None:
        now = clock.now()
        with self._ordering:
            self._orders.look(now)
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
            apart = kept_apart_by()
            shell = f'this shell sets {apart}, which may be why: unset it. Otherwise: '
            reason = (
                f'no bridge is heard on {self._subscription.topic_name} in {self._graph}: '
                f'{shell if apart else ""}is it running, with the same ROS_DOMAIN_ID? On another '
                'machine of the kart, both need EVGP_GRAPH_INTERFACE'
            )
        self._logged = {each: at for each, at in self._logged.items() if now - at < LOG_AGAIN}
        if not reason:
            self._logged_last = ''
        elif (
            reason != self._logged_last
            and reason not in self._logged
            and len(self._logged) < LOG_REASONS
        ):
            self._logged[reason], self._logged_last = now, reason
            text = f'The kart obeys {self.state.value}: {reason}'
            if self._orders.doubt(now):
                self._log.warning(text)
            else:  # the bridge's own reason, of which it has warned
                self._log.info(text)


_STEADY = Clock(clock_type=ClockType.STEADY_TIME)


def _said(message: KartRaceState) -> Said:
    return Said(
        message.bridge,
        state_of(message.state),
        state_of(message.reached),
        message.order,
        message.acknowledged,
        message.reason,
    )


def _ring(alarm: GuardCondition, interval: float) -> None:
    """Wake a node's executor again and again, for as long as there is the node."""
    while True:
        time.sleep(interval)  # by the monotonic clock; a wait with a timeout need not be
        try:
            alarm.trigger()
        except InvalidHandle:
            return
