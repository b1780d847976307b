# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Tells a team's stack what to do now, and acknowledges what the kart has done.

A subscription alone is not enough, for two reasons. First, a bridge that has died or hung cannot
say so, and its last message may have been GREEN_GREEN. Second, a stack may have just carried out
the previous command when it reads the newest one. It could then report a standstill at full speed.
"""

from __future__ import annotations

from collections.abc import Callable
import threading
import time
from typing import Any

from evgp_kart_bridge.orders import Order, Orders, Said, valid_lease
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
"""The bridge's default `liveliness_lease`, in seconds."""

UNHEARD = 2.0
"""Time after the start at which the node logs that it has not heard a bridge, in seconds."""

LOG_AGAIN = 10.0
"""Minimum time before a node logs the same reason again, in seconds."""

LOG_REASONS = 20
"""Maximum number of reasons that a node logs within `LOG_AGAIN`."""

BACKLOG = 100
"""Maximum number of messages that wait for a busy stack. During the longest doubt that the rules
tolerate (`orders.FORGIVEN`), the bridge publishes fewer."""


def race_state_qos(lease: float) -> QoSProfile:
    """
    Return the QoS of ``~/race_state`` and ``~/stop``, for the bridge and for plain subscribers.

    The topics are latched, and the bridge is alive only if it publishes at least once in each
    lease. The bridge keeps only the newest message, because a late subscriber must not receive
    outdated states. With volatile durability, the subscriber could wait for seconds until Fast DDS
    has skipped them.

    :param lease: the lease, in seconds. A subscriber's lease must not be shorter than the
        bridge's.
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

    Messages wait for a busy stack, so that the stack receives every state. The watch does not
    receive messages from before its subscription, whatever the publisher keeps.

    :param lease: the lease, in seconds. It must not be shorter than the bridge's.
    """
    qos = race_state_qos(lease)
    qos.depth = BACKLOG
    qos.durability = DurabilityPolicy.VOLATILE
    return qos


class NewReasons:
    """
    Decides which reasons are logged.

    None is logged twice in a row, nor again within `LOG_AGAIN`. A reason that was left out is
    logged later if it still applies, so that the last line of the log is true.
    """

    def __init__(self) -> None:
        self._logged: dict[str, float] = {}  # when each was logged
        self._last = ''

    def has(self, reason: str, now: float) -> bool:
        """Return whether to log the present reason now; it may be empty."""
        self._logged = {each: at for each, at in self._logged.items() if now - at < LOG_AGAIN}
        if not reason:
            self._last = ''
        if reason in ('', self._last, *self._logged) or len(self._logged) >= LOG_REASONS:
            return False
        self._logged[reason], self._last = now, reason
        return True


class RaceStateWatch:
    """
    Watches the bridge, and decides what the kart must do now.

    Use it in a node of your stack, in a timer of the steady clock, about 20 times a second::

        order = self.watch.order
        if self.drive(order.state):  # True once the kart has reached that state
            self.watch.acknowledge(order)

    The watch obeys GREEN_GREEN only after it has heard GRID_ACTIVE from the same bridge. A stack
    that restarts during a race, or whose bridge was gone, therefore does not drive off.

    :ivar message: the bridge's last message; None if there was none.
    :param node: the node of your stack.
    :param on_change: called by the node's executor with each new state, first with RED_RED.
    :param topic: the bridge's topic. The service ``acknowledge`` is in the same namespace.
    :param lease: the bridge's `liveliness_lease`, or longer, but at most 2, in seconds.
    :raises ValueError: if the lease is out of range.
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
        # The subscription and the alarm share a group, so that they wait for the same things.
        # `_hear` says why.
        group = MutuallyExclusiveCallbackGroup()
        # The last two times at which the executor called `_pass`.
        self._passed = self._passed_before = clock.now()
        self._reported: RaceState | None = None  # to `on_change`
        # The order may be read and acknowledged in any thread.
        self._ordering = threading.RLock()
        self._orders = Orders(valid_lease(lease))
        self._asking: Future | None = None
        self._log = node.get_logger()
        self._began = clock.now()
        self._graph = f'ROS domain {node.context.get_domain_id()}'
        self._new_reasons = NewReasons()
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
        # The middleware reports when the bridge is gone. In case it does not, the alarm lets the
        # watch check the clock. A timer would not work, because simulated time may stop, and some
        # middlewares wait for timers by the wall clock, which may be set back.
        self._alarm = node.create_guard_condition(self._pass, callback_group=group)
        threading.Thread(
            target=_ring, args=(self._alarm, lease / 5), name='race state watch', daemon=True
        ).start()

    @property
    def state(self) -> RaceState:
        """
        Return the state that the kart must obey now.

        The state is RED_RED if the bridge publishes RED_RED, has not been heard yet, has been
        silent for the lease, is gone, or publishes an unknown state. It is also RED_RED if two
        bridges run, or if the watch has not heard GRID_ACTIVE before GREEN_GREEN. This property
        checks the clock, so it is right even while the executor is busy.
        """
        return self.order.state

    @property
    def reason(self) -> str:
        """Return why `state` differs from what race control commands, or an empty string."""
        with self._ordering:
            return self._orders.judge(clock.now())[1]

    @property
    def order(self) -> Order:
        """
        Return what to do now.

        Obey the order's `state`. Once the kart has reached it, acknowledge this order. The order
        remains the same object until the kart has to do something different. A new command is a
        new order, even if it commands the same state. A doubt or a team stop also ends an order.
        """
        with self._ordering:
            return self._orders.order(clock.now())

    def acknowledge(self, order: Order) -> None:
        """
        Report to race control that the kart has reached the state of this order.

        The watch sends `Order.reached`. For a kart that stands still in RED_RED because of a team
        stop, this is RED_FLAG. For a kart that stopped itself in GREEN_GREEN, it is RED_RED.

        Call this in every step in which the kart has reached the state. If the answer is lost, or
        the bridge refuses, the watch tries again after 0.2 s; after a refusal, the node logs why.
        This method never waits. It does nothing if the order is over, is already acknowledged or
        has no number.

        :param order: the order that the kart has carried out, as the same object from `order`.
        """
        with self._ordering:
            if not self._orders.asks(order, clock.now()):
                return
            unanswered, self._asking = self._asking, None
        # Release the lock first, because readers of the state would wait for it.
        if unanswered is not None:
            self._bridge.remove_pending_request(unanswered)  # the bridge may have died
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
        # Take all messages that are waiting, because a stop must not wait behind earlier messages.
        heard = [message]
        if self._subscription is not None:
            heard += take_waiting(self._subscription, BACKLOG)
        # A stack that was busy may find an old GREEN_GREEN here. The messages are newer than the
        # second-to-last call of `_pass`, because otherwise the watch would have taken them then.
        # The last call proves nothing, because it may belong to the same turn of the executor. The
        # stamp would help only if the clocks of bridge and stack agreed.
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
        state = self.order.state
        if state is not self._reported:
            self._reported = state
            self._on_change(state)
        self._log_reason(now)  # last, because the log may wait

    def _log_reason(self, now: float) -> None:
        """Log each new reason, or that the node does not hear a bridge."""
        reason = self.reason
        if self.message is None:
            if now < self._began + UNHEARD or self._subscription is None:
                return
            apart = kept_apart_by()
            shell = f'this shell sets {apart}, which may be why: unset it. Otherwise: '
            reason = (
                f'no bridge is heard on {self._subscription.topic_name} in {self._graph}: '
                f'{shell if apart else ""}is it running, with the same ROS_DOMAIN_ID? On two '
                'computers, both need EVGP_GRAPH_INTERFACE'
            )
        if self._new_reasons.has(reason, now):
            text = f'The kart obeys {self.state.value}: {reason}'
            if self._orders.doubt(now):
                self._log.warning(text)
            else:  # the bridge has logged its own reason as a warning
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
    """Wake a node's executor at each interval, until the node is destroyed."""
    while True:
        time.sleep(interval)  # uses the monotonic clock; a wait with a timeout may not
        try:
            alarm.trigger()
        except InvalidHandle:
            return
