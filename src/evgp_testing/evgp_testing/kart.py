# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A kart with ROS: the real bridge as a process, and the team's side of its domain."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import math
import time
from typing import Any

from evgp_node.qos import latched
from evgp_node.states import state_message, state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg, srv
from evgp_testing.official import Answer
from evgp_testing.process import Process
from evgp_testing.ros_side import RosSide
from nav_msgs.msg import Odometry
from rclpy.publisher import Publisher
from std_msgs.msg import Bool
from std_srvs.srv import SetBool


class Bridge(Process):
    """
    A real ``kart_bridge_node`` on a domain.

    :param local_address: the kart's own address.
    :param parameters: more ROS parameters of the node.
    :param program: an executable of the package, or the path of another program.
    :param arguments: more ROS arguments of the node, such as ``('-r', '~/odom:=/odom')``.
    """

    def __init__(
        self,
        domain: int,
        port: int,
        local_address: str,
        parameters: Mapping[str, object] | None = None,
        program: str = 'kart_bridge_node',
        arguments: tuple[str, ...] = (),
    ) -> None:
        """Start the bridge, even if it does not find race control."""
        self.domain = domain
        super().__init__(
            'evgp_kart_bridge',
            program,
            domain,
            {
                'host': '127.0.0.1',
                'port': port,
                'local_address': local_address,
                **(parameters or {}),
            },
            arguments,
        )


class Team(RosSide):
    """
    A team's node beside its bridge.

    ``state`` is the bridge's newest race state, and ``stop`` its lock. ``changes`` are the race
    states received, without repetitions, each with the monotonic time (s) of its first message.
    ``states`` are the same without times. ``speed`` is odometry's newest speed, in m/s.
    """

    def __init__(self, domain: int, name: str = 'team') -> None:
        super().__init__(name, domain)
        self.state: msg.KartRaceState | None = None
        self.changes: list[tuple[float, RaceState | None]] = []
        self.stop: bool | None = None
        self.speed: float | None = None
        self._driven = 0.0
        self._rolls = self._place = 0.0
        self._acknowledge = self.node.create_client(srv.Acknowledge, '/kart_bridge/acknowledge')
        self._team_stop = self.node.create_client(SetBool, '/kart_bridge/team_stop')
        self.node.create_subscription(
            msg.KartRaceState, '/kart_bridge/race_state', self._hear_state, latched(1)
        )
        self.node.create_subscription(
            Bool, '/kart_bridge/stop', lambda stop: self.learn(stop=stop.data), latched(1)
        )
        self.node.create_subscription(Odometry, '/kart_bridge/odom', self._hear_speed, 10)
        self._odometry: Publisher | None = None  # two would stop the kart
        self.spin()

    @property
    def states(self) -> list[RaceState | None]:
        with self.news:
            return [state for _, state in self.changes]

    def acknowledge(self, state: RaceState | None, order: int | None = None) -> Answer:
        """
        Report to the bridge the state that the kart has reached, and return the bridge's answer.

        :param order: the number of the command that was carried out; None for the one in the
            newest race state.
        """
        if order is None:
            order = self.wait_for(lambda heard: True, 'a race state').order
        request = srv.Acknowledge.Request(order=order, reached=state_message(state))
        response: Any = self.request(self._acknowledge, request)
        return Answer(response.success, response.message)

    def drive_at(self, speed: float) -> None:
        """Publish this speed, in m/s, as odometry from now on, at 20 Hz."""
        self._driven = speed
        if self._odometry is None:
            odometry = self.node.create_publisher(Odometry, '/kart_bridge/odom', 10)
            self._odometry = odometry
            self.node.create_timer(0.05, self._publish_speed)
            # The bridge subscribes, and so does this node.
            self.wait_until_polled(lambda: odometry.get_subscription_count() > 1, 'a bridge')
        self.wait_for_speed(lambda heard: heard == speed or math.isnan(speed))

    def roll_at(self, speed: float) -> None:
        """From now on, publish a pose that moves at this speed, in m/s, and a twist of 0."""
        self._rolls = speed
        self.drive_at(0.0)

    def team_stop(self, engaged: bool) -> Answer:
        """Engage or release the team's own stop."""
        response: Any = self.request(self._team_stop, SetBool.Request(data=engaged))
        return Answer(response.success, response.message)

    def wait_for(
        self, found: Callable[[msg.KartRaceState], object], what: str
    ) -> msg.KartRaceState:
        """Return the first race state for which `found` is true."""
        self.wait_until(
            lambda: self.state is not None and found(self.state),
            lambda: f'{what}; the bridge says: {self.state}',
        )
        assert self.state is not None
        return self.state

    def wait_for_state(self, state: RaceState) -> msg.KartRaceState:
        """Wait until this is the state to obey."""
        return self.wait_for(lambda heard: state_of(heard.state) is state, f'obeys {state.value}')

    def wait_for_stop(self, stop: bool) -> None:
        """Wait until the lock has this value."""
        self.wait_until(lambda: self.stop is stop, lambda: f'~/stop {stop}; it is {self.stop}')

    def wait_for_speed(self, found: Callable[[float], bool]) -> None:
        """Wait until `found` is true for odometry's speed, in m/s."""
        self.wait_until(
            lambda: self.speed is not None and found(self.speed),
            lambda: f'such a speed; it is {self.speed}',
        )

    def _publish_speed(self) -> None:
        odometry = Odometry()
        odometry.twist.twist.linear.x = self._driven
        self._place += self._rolls * 0.05
        odometry.pose.pose.position.x = self._place
        assert self._odometry is not None  # otherwise there is no timer
        self._odometry.publish(odometry)

    def _hear_state(self, state: msg.KartRaceState) -> None:
        with self.news:
            self.state = state
            heard = state_of(state.state)
            if not self.changes or self.changes[-1][1] is not heard:
                self.changes.append((time.monotonic(), heard))
            self.news.notify_all()

    def _hear_speed(self, odometry: Odometry) -> None:
        self.learn(speed=odometry.twist.twist.linear.x)
