# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The ``kart_bridge`` node publishes, as ROS topics, the state that a kart must obey.

The node has two threads. The link's thread (``link``) owns the arbiter, which decides what the
kart must obey. This thread publishes these decisions, and it alone keeps the kart's topics alive.
The executor's thread receives the messages and calls of the team's nodes, and passes them to the
link.
"""

from __future__ import annotations

from collections.abc import Sequence
import concurrent.futures
import dataclasses
import math
import random
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from evgp_kart_bridge.lamp import lamp
from evgp_kart_bridge.link import Input, LinkClosedError, RaceControlLink, REPEAT
from evgp_kart_bridge.motion import Motion
from evgp_kart_bridge.orders import LONGEST_LEASE
from evgp_kart_bridge.watch import LEASE, NewReasons, race_state_qos
from evgp_node.graph import KEEPS_APART
from evgp_node.parameters import check_address, ParameterError, StrictNode
from evgp_node.process import OnFailure, run_node, wait_until_heard
from evgp_node.qos import DIAGNOSTICS_QOS, latched, volatile
from evgp_node.rclpy_private import RCLError
from evgp_node.stamps import stamp
from evgp_node.states import state_message, state_of
from evgp_protocol import clock
from evgp_protocol.arbiter import Arbiter, Reaction, Settings, StopSource, Verdict
from evgp_protocol.connection import LinkSettings
from evgp_protocol.frames import DEFAULT_PORT
from evgp_protocol.states import RaceState
from evgp_rcs_msgs.msg import KartRaceState
from evgp_rcs_msgs.srv import Acknowledge
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_msgs.msg import Bool, ColorRGBA, String
from std_srvs.srv import SetBool

try:
    from rclpy.event_handler import SubscriptionEventCallbacks
except ImportError:  # ROS 2 Humble has it there
    from rclpy.qos_event import SubscriptionEventCallbacks

LINK_ANSWER_TIMEOUT = 1.0
"""Maximum time that a service call from the team waits for the link, in seconds."""

REMOTES = {StopSource.TSR: '~/tsr', StopSource.MSR: '~/msr'}
"""The topics of the team's safety remote (§2.C) and of the MSR's contact (§2.B). True means
stop."""

REMOTE_TYPE = 'std_msgs/msg/Bool'
"""Type of `REMOTES`, as the ROS graph names it. A message of another type never arrives."""

REMOTE_QOS = volatile(10)
"""QoS of `REMOTES`. It ensures that no stop is lost. If a publisher's QoS does not ensure this,
the bridge treats that publisher as a stop."""

LATCHED_REMOTE_QOS = latched(1)
"""QoS of a second subscription to each remote, which also receives what a latched remote published
earlier."""

LOOK_AROUND = 0.3
"""Time between two checks for a second node where only one is allowed, in seconds."""

WARN_AFTER = 5.0
"""Time after which the bridge warns that no node reads the race state, that an acknowledgement is
missing, or that odometry reads 0.00 m/s in GREEN_GREEN, in seconds."""

ODOMETRY_DUE = 2.0
"""Time after which the bridge warns that the expected odometry is missing, in seconds."""

TEAM_TIMEOUT = 1.0
"""Time after which a bridge whose executor is stuck counts as deaf to its team, in seconds."""

ODOMETRY_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
"""QoS of ``~/odom``. With it, the bridge receives the newest odometry, whether the publisher is
reliable or not."""

MOST_FIRST_ORDER = 2**52
"""Maximum number of a bridge's first order. JSON and JavaScript represent integers exactly only
below 2**53, so this leaves room for later orders."""

_ENDED = dataclasses.replace(
    Arbiter(Settings(), first_order=1).verdict, reason='the bridge has ended'
)

ONE_PUBLISHER = ('~/race_state', '~/stop', '~/state', *REMOTES.values(), '~/odom')
"""The topics that may have only one publisher."""

ONE_SERVER = ('~/acknowledge', '~/team_stop')
"""The services that may have only one server: another one may accept without doing anything."""

_NUMBERS = ', '.join(f'{state_message(each).state} {each.value}' for each in RaceState)


def _to_paste(verdict: Verdict) -> str:
    """Return a sentence with the command that acknowledges the state, ready for a terminal."""
    if verdict.reached is None:
        return f'there is nothing to acknowledge: {verdict.reason}'
    done = f'order: {verdict.order}, reached: {{state: {state_message(verdict.reached).state}}}'
    return f'once the kart has reached that state, send {{{done}}}'


def _names_of(publishers: Sequence[TopicEndpointInfo]) -> str:
    """Return the full names of the nodes of these publishers, separated by commas."""
    return ', '.join(
        sorted(
            'a node whose name is not known yet'
            if each.node_name.startswith('_NODE')  # rmw: _NODE_NAME_UNKNOWN_
            else f'{each.node_namespace.rstrip("/")}/{each.node_name}'
            for each in publishers
        )
    )


class Lasting:
    """
    Notices that something has lasted for some time.

    :param seconds: this time, in seconds.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._what: object = None
        self._due = math.inf  # infinite once it was noticed

    def is_due(self, what: object, now: float) -> bool:
        """Return True once, if `what` is true and has not changed for that time."""
        if what != self._what:
            self._what, self._due = what, now + self._seconds
        if not what or now < self._due:
            return False
        self._due = math.inf
        return True


class PublishError(RuntimeError):
    """The middleware did not accept the race state, so the bridge could not publish it."""


class KartBridge(StrictNode):
    """
    The bridge's node.

    :param on_failure: called in another thread, with the error, if the bridge cannot continue.
    :param node_options: further arguments for rclpy's node.
    :raises ParameterError: if a parameter is wrong.
    """

    def __init__(self, on_failure: OnFailure, **node_options: Any) -> None:
        super().__init__('kart_bridge', **node_options)
        link_settings, settings, lease = read_settings(self)
        self._peer = link_settings.peer
        self._graph = f'ROS domain {self.context.get_domain_id()}'
        self._odometry_topic = self.resolve_topic_name('~/odom')
        # If the topic is remapped, odometry is required.
        if self._odometry_topic != f'{self.get_fully_qualified_name()}/odom':
            settings = dataclasses.replace(settings, odometry_required=True)
        qos = race_state_qos(lease)
        self._race_state = self.create_publisher(KartRaceState, '~/race_state', qos)
        self._stop = self.create_publisher(Bool, '~/stop', qos)
        # This topic is volatile, so that a late subscriber does not get an old state. Silence
        # means that the state is unknown.
        self._state = self.create_publisher(String, '~/state', 1)
        self._lamp = self.create_publisher(ColorRGBA, '~/lamp', qos)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', DIAGNOSTICS_QOS)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._published: Verdict | None = None
        self._new_reasons = NewReasons()
        self._motion = Motion()  # in the executor's thread
        self._odometry_at: float | None = None
        self._odometry_was_missed = False
        self._unread, self._never_moved = Lasting(WARN_AFTER), Lasting(WARN_AFTER)
        self._no_odometry, self._unacknowledged = Lasting(ODOMETRY_DUE), Lasting(WARN_AFTER)
        self._turns = 0  # of the link
        # The link's thread triggers this condition. An executor that runs the callback can also
        # receive the team's messages. A timer would not work, because some middlewares wait for
        # timers by the wall clock.
        self._ask_to_look = self.create_guard_condition(self._look_around)
        self._malformed = 0
        self._one_publisher = {name: self.resolve_topic_name(name) for name in ONE_PUBLISHER}
        self._one_server = {name: self.resolve_service_name(name) for name in ONE_SERVER}
        if not hasattr(self, 'count_services'):  # missing in ROS 2 Humble
            self._one_server = {}
        self._unreliable: set[str] = set()  # remotes of which stops could get lost
        self._doubts = {StopSource.GRAPH: '', StopSource.ODOMETRIES: ''}
        # The number is random, so that a number from an earlier bridge does not match an order
        # from this one. The time would not work, because the clock of a computer without a battery
        # reads the same time at each boot.
        first_order = random.SystemRandom().randint(1, MOST_FIRST_ORDER)
        self._identity = first_order  # which no other bridge has
        # The link owns the arbiter. This class only reads it, in the link's thread.
        self._arbiter = arbiter = Arbiter(settings, first_order, self._peer, self._odometry_topic)
        if not (settings.odometry_required or settings.auto_acknowledge_stop):
            self.get_logger().warning(
                f'Until odometry arrives on {self._odometry_topic}, this bridge cannot check '
                "the stack's reports of a standstill. To provide odometry, use make bridge "
                'ODOM=/odom, or odom:=/odom with the launch file'
            )
        self._link = RaceControlLink(arbiter, link_settings, self._on_verdict, on_failure)
        self.create_service(Acknowledge, '~/acknowledge', self._acknowledge)
        self.create_service(SetBool, '~/team_stop', self._team_stop)
        for source, topic in REMOTES.items():
            # The second subscription also receives a stop latched before this bridge started.
            for qos, incompatible in (
                (REMOTE_QOS, lambda _, topic=topic: self._distrust(topic)),
                (LATCHED_REMOTE_QOS, lambda _: None),
            ):
                self.create_subscription(
                    Bool,
                    topic,
                    lambda message, source=source: self._stop_by_topic(source, message.data),
                    qos,
                    event_callbacks=SubscriptionEventCallbacks(incompatible_qos=incompatible),
                )
        self.create_subscription(Odometry, '~/odom', self._odometry, ODOMETRY_QOS)
        self._link.start()

    def close(self) -> None:
        """Disconnect from race control and publish RED_RED as the last state."""
        self._link.stop()
        try:
            self._publish(_ENDED, 0.0)  # the lamp is lit at time 0
        except PublishError as error:  # the bridge's silence then stops the kart
            self.get_logger().error(str(error))
        wait_until_heard(self._race_state, self._stop, self._state, self._lamp)

    # ----- input from the team, in the executor's thread ----------------------------------

    def _acknowledge(
        self, request: Acknowledge.Request, response: Acknowledge.Response
    ) -> Acknowledge.Response:
        state, order = state_of(request.reached), request.order
        if order and state is None:
            response.message = (
                f'{request.reached.state} is not a race state; `reached.state` must be one of '
                f'{_NUMBERS}'
            )
            return response

        def take(arbiter: Arbiter, now: float) -> Reaction:
            return arbiter.acknowledge(state, order, now) if state and order else arbiter.tick(now)

        reaction, response.message = self._ask(take)
        if reaction is None:
            return response
        verdict, refusal = reaction.verdict, reaction.refusal
        if state is None or not order:  # someone called the service by hand, without a number
            response.message = _to_paste(verdict)
            return response
        response.success = not refusal
        response.message = refusal or f'{state.value} is acknowledged'
        if refusal and verdict.commanded not in (None, state):
            response.message += f'. `reached.state` must be one of {_NUMBERS}'
        return response

    def _team_stop(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        engaged = request.data
        reaction, response.message = self._ask(
            lambda arbiter, now: arbiter.team_stop(StopSource.SERVICE, engaged, now)
        )
        if reaction is not None:
            verdict = reaction.verdict
            response.success = verdict.team_stop or not engaged
            response.message = f'The kart obeys {verdict.state.value}' + (
                f': {verdict.reason}' if verdict.reason else ''
            )
        return response

    def _ask(self, take: Input) -> tuple[Reaction | None, str]:
        """Pass an input to the link; return the reaction, or why there is none."""
        try:
            return self._link.give(take).result(LINK_ANSWER_TIMEOUT), ''
        except LinkClosedError as error:
            return None, f'Not accepted: {error}'
        except concurrent.futures.TimeoutError:
            silent = f'The bridge has not answered for {LINK_ANSWER_TIMEOUT:g} s'
            return None, f'{silent}. The kart must stop'

    def _stop_by_topic(self, source: StopSource, engaged: bool) -> None:
        self._link.give(lambda arbiter, now: arbiter.team_stop(source, engaged, now))

    def _distrust(self, remote: str) -> None:
        """Stop the kart from now on, because a publisher of a remote is not RELIABLE."""
        self._unreliable.add(remote)
        self._look_around()

    def _look_around(self) -> None:
        """
        Stop the kart while two nodes have one role, or a remote cannot be heard for certain.

        Also report that the team can be heard.
        """
        doubts: dict[StopSource, list[str]] = {
            StopSource.GRAPH: [
                f'a publisher of {each} is not RELIABLE; correct it and restart the bridge'
                for each in sorted(self._unreliable)
            ],
            StopSource.ODOMETRIES: [],
        }
        for name, topic in self._one_publisher.items():
            found, wrong = self.get_publishers_info_by_topic(topic), ''
            if len(found) > 1 and name == '~/race_state':
                wrong = f'another bridge runs in {self._graph}, stop one of them'
            elif len(found) > 1:
                wrong = f'more than one publisher of {name}'
            elif found and name in REMOTES.values() and found[0].topic_type != REMOTE_TYPE:
                wrong = f'the publisher of {name} does not publish std_msgs/Bool'
            if wrong:
                source = StopSource.ODOMETRIES if name == '~/odom' else StopSource.GRAPH
                doubts[source].append(f'{wrong}: {_names_of(found)}')
        for name, service in self._one_server.items():
            if self.count_services(service) > 1:
                doubts[StopSource.GRAPH].append(f'another node offers {name}')
        for source, texts in doubts.items():
            why = ', '.join(texts)
            if why != self._doubts[source]:
                self._doubts[source] = why
                self._link.give(
                    lambda arbiter, now, source=source, why=why: arbiter.team_stop(
                        source, bool(why), now, why
                    )
                )
        self._look_for_readers()
        self._link.give(Arbiter.team_heard)

    def _look_for_readers(self) -> None:
        """Log once that no stack reads the race state: it may be in another ROS domain."""
        forms = (self._race_state, self._stop, self._state)
        read = any(each.get_subscription_count() for each in forms)
        if self._unread.is_due(not read, clock.now()):
            self.get_logger().warning(
                f'No node has read {self._race_state.topic_name} in {self._graph} for '
                f'{WARN_AFTER:g} s. Check that the stack is running, with the same ROS_DOMAIN_ID, '
                'and without '
                f'{" or ".join(KEEPS_APART)} in its shell. On two computers, both need '
                'EVGP_GRAPH_INTERFACE'
            )

    def _odometry(self, message: Odometry) -> None:
        velocity, place = message.twist.twist.linear, message.pose.pose.position
        twist, now = math.hypot(velocity.x, velocity.y), clock.now()
        speed = self._motion.speed(twist, place.x, place.y, now)
        if self._motion.contradiction:
            self.get_logger().warning(
                f'The kart counts as moving: {self._motion.contradiction}',
                throttle_duration_sec=5.0,
                throttle_time_source_type=self._steady,
            )
        published = self._published
        green = published is not None and published.state is RaceState.GREEN_GREEN
        if self._never_moved.is_due(green and speed < 0.005, now):
            self.get_logger().warning(
                f'Odometry on {self._odometry_topic} has read 0.00 m/s for {WARN_AFTER:g} s in '
                'GREEN_GREEN. If the kart stands still, no stack sends its motors a speed. If it '
                'drives, the twist of its odometry is not filled in. It would then acknowledge '
                'stops while it rolls'
            )

        def take(arbiter: Arbiter, now: float) -> Reaction:
            self._odometry_at = now  # only the link's thread uses this
            return arbiter.speed(speed, now)

        self._link.give(take)

    # ----- output to the team, in the link's thread ---------------------------------------

    def _on_verdict(self, verdict: Verdict) -> None:
        self._publish(verdict, clock.now())
        self._log(verdict)
        self._published = verdict
        self._log_odometry()
        self._log_unacknowledged(verdict)
        kart = self._link.kart
        if kart.malformed != self._malformed:
            self._malformed = kart.malformed
            self.get_logger().warning(
                f'{kart.malformed} malformed frames so far. The last: {kart.last_malformed}',
                throttle_duration_sec=10.0,
                throttle_time_source_type=self._steady,
            )
        if self._turns % round(REPEAT * LOOK_AROUND) == 0:
            self._ask_to_look.trigger()
        if self._turns % round(REPEAT) == 0:
            self._diagnostics.publish(self._diagnostic(verdict))
        self._turns += 1

    def _publish(self, verdict: Verdict, at: float) -> None:
        message = KartRaceState(
            stamp=stamp(self.get_clock()),
            bridge=self._identity,
            state=state_message(verdict.state),
            commanded=state_message(verdict.commanded),
            order=verdict.order,
            connected=verdict.connected,
            team_stop=verdict.team_stop,
            reached=state_message(verdict.reached),
            acknowledged=verdict.acknowledged,
            reason=verdict.reason,
        )
        try:
            self._race_state.publish(message)
            self._stop.publish(Bool(data=not verdict.may_drive))
            self._state.publish(String(data=verdict.state.value))
            red, green, blue = lamp(verdict.state, verdict.acknowledged, at)
            self._lamp.publish(ColorRGBA(r=red, g=green, b=blue, a=1.0))
        except RCLError as error:
            raise PublishError(
                f'the race state cannot be published ({error}). Check the clock: Fast DDS refuses '
                'every message from 19 January 2038 on'
            ) from error

    def _log(self, verdict: Verdict) -> None:
        """Log what is new, without repeating every failure to connect."""
        last, connection = self._published, self._link.connection
        obeyed = f'Obey {verdict.state.value}'
        if verdict.acknowledged and last is not None and not last.acknowledged:
            reached = verdict.reached or verdict.state
            if reached is not RaceState.IN_GARAGE:  # which the link acknowledges, at once
                self.get_logger().info(f'{reached.value} is acknowledged')
        if verdict.reason == '':
            if last is None or last.reason or last.state is not verdict.state:
                self._new_reasons = NewReasons()
                self.get_logger().info(obeyed)
        elif connection.failures == 0 and (not connection.ever_heard or self._arbiter.starting):
            # The bridge is still starting, and nothing is wrong yet.
            if last is None:
                self.get_logger().info(f'Starting: {obeyed} until {self._peer} sends a state')
        elif self._new_reasons.has(text := f'{obeyed}: {verdict.reason}', clock.now()):
            self.get_logger().warning(text)

    def _log_odometry(self) -> None:
        """Log once each time odometry goes missing, and once when it comes back."""
        missing = self._arbiter.missing_odometry
        if self._no_odometry.is_due(bool(missing), clock.now()):
            self._odometry_was_missed = True
            self.get_logger().warning(f'Only IN_GARAGE can be acknowledged: {missing}')
        elif self._odometry_was_missed and not missing:
            self._odometry_was_missed = False
            self.get_logger().info(f'Odometry received on {self._odometry_topic}')

    def _log_unacknowledged(self, verdict: Verdict) -> None:
        """Log what prevents a stop from being acknowledged, or that only the stack has not."""
        state, hindrance = self._arbiter.awaited or (None, '')
        lasts = self._unacknowledged.is_due(
            state is not None and not hindrance and verdict.order, clock.now()
        )
        if state is None:
            return
        if hindrance and state.is_red and not self._arbiter.missing_odometry:
            self.get_logger().warning(
                f'The stop is not acknowledged yet: {hindrance}',
                throttle_duration_sec=5.0,
                throttle_time_source_type=self._steady,
            )
        elif lasts:
            does = 'drives' if state is RaceState.GREEN_GREEN else 'stands still'
            self.get_logger().warning(
                f'{state.value} has not been acknowledged for {WARN_AFTER:g} s, although '
                f'nothing prevents it. Once the kart {does}, its stack must call '
                f'{self.resolve_service_name("~/acknowledge")}'
            )

    def _odometry_heard(self) -> str:
        """Return the age of the last odometry, for diagnostics."""
        if self._odometry_at is None:
            return f'not heard on {self._odometry_topic}'
        return f'{clock.now() - self._odometry_at:.2f} s old on {self._odometry_topic}'

    def _diagnostic(self, verdict: Verdict) -> DiagnosticArray:
        level = DiagnosticStatus.OK
        if not verdict.connected:
            level = DiagnosticStatus.ERROR
        elif verdict.reason or self._arbiter.missing_odometry:
            level = DiagnosticStatus.WARN
        commanded = verdict.commanded.value if verdict.commanded is not None else 'nothing'
        array = DiagnosticArray()
        array.header.stamp = stamp(self.get_clock())
        array.status = [
            DiagnosticStatus(
                level=level,
                name=f'{self.get_fully_qualified_name().lstrip("/")}: race state',
                message=verdict.reason
                or self._arbiter.missing_odometry
                or f'Obey {verdict.state.value}',
                hardware_id=self._peer,
                values=[
                    KeyValue(key=key, value=value)
                    for key, value in (
                        ('state', verdict.state.value),
                        ('commanded', commanded),
                        ('connected', str(verdict.connected).lower()),
                        ('acknowledged', str(verdict.acknowledged).lower()),
                        ('team stop', str(verdict.team_stop).lower()),
                        ('may drive', str(verdict.may_drive).lower()),
                        ('odometry', self._odometry_heard()),
                        ('connections so far', str(self._link.connection.made)),
                        ('malformed frames so far', str(self._link.kart.malformed)),
                    )
                ],
            )
        ]
        return array


OF_THE_RULES: tuple[tuple[Any, ...], ...] = (
    (
        'frame_timeout',
        'Time without frames after which the link is lost and the kart stops, in seconds (§3.E).',
        (0.2, 1.0),
    ),
    (
        'tsr_timeout',
        'Time without ~/tsr after which the kart stops, in seconds. 0: ~/tsr is not required.',
        (0.0, 10.0),
    ),
    (
        'msr_timeout',
        'Time without ~/msr, the contact of the MSR, after which the kart stops, in seconds. '
        '0: no contact is wired.',
        (0.0, 1.0),
    ),
    (
        'odometry_required',
        'Accept acknowledgements only if ~/odom agrees: GRID_ACTIVE, RED_FLAG and RED_RED at a '
        'standstill, GREEN_GREEN in motion.',
    ),
    (
        'auto_acknowledge_stop',
        'Acknowledge RED_FLAG and RED_RED automatically once ~/odom shows a standstill.',
    ),
    ('standstill_speed', 'Maximum speed of a kart at standstill, in m/s.', (0.0, 0.5)),
    (
        'standstill_time',
        'Time at standstill after which a kart counts as stopped, in seconds; more than its dead '
        'time.',
        (0.1, 10.0),
    ),
    (
        'red_flag_drive_time',
        'Time for which ~/stop lets a driving kart slow down in RED_FLAG, in seconds (§3.A).',
        (0.0, 30.0),
    ),
    ('drive_in_garage', 'Let ~/stop allow the team to drive its kart in IN_GARAGE (§3.A).'),
)
"""Name, meaning and range of the arbiter's parameters. `Settings` has the defaults."""


def read_settings(node: StrictNode) -> tuple[LinkSettings, Settings, float]:
    """
    Declare every parameter of the bridge, and return the settings.

    :return: race control's address, the settings of the rules, and the liveliness lease in
        seconds.
    :raises ParameterError: if a parameter is wrong.
    """
    declare = node.declare
    host = declare('host', '', 'The IPv4 address of race control.')
    port = declare('port', DEFAULT_PORT, 'The TCP port of race control.', (1, 65535))
    local = declare(
        'local_address', '', 'The IPv4 address to connect from. Empty: the system chooses.'
    )
    lease = declare(
        'liveliness_lease',
        LEASE,
        'Silence of the bridge after which a subscriber must stop the kart, in seconds.',
        (0.2, LONGEST_LEASE),
    )
    rules: dict[str, Any] = {
        name: declare(name, getattr(Settings, name), *meaning_and_limits)
        for name, *meaning_and_limits in OF_THE_RULES
    }
    node.refuse_unknown()
    if not host:
        raise ParameterError(
            'parameter host is missing. Give the address of race control, '
            'for example: --ros-args -p host:=10.0.0.1'
        )
    for name, address in (('host', host), ('local_address', local)):
        if address:
            check_address(name, address)
    settings = Settings(team_timeout=TEAM_TIMEOUT, **rules)
    return LinkSettings(host, port, local), settings, lease


def main(args: list[str] | None = None) -> int:
    """
    Run the bridge until SIGINT or SIGTERM. The last state that it publishes is RED_RED.

    :param args: command-line arguments; None for those of this process.
    :return: 0 after an orderly end, 1 after a failure (the last state is RED_RED then, too), 2 if
        a setting is wrong.
    """
    return run_node('kart_bridge', KartBridge, args)


if __name__ == '__main__':
    sys.exit(main())
