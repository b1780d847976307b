# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
An example stack to copy. It obeys the race state, drives at a simulated speed, and acknowledges.

With the parameter ``command``, the stack commands real motors. Because it only simulates its speed
and does not measure it, it then publishes no speed and acknowledges nothing but GRID_ACTIVE.

The stack stops when the bridge dies, because ``RaceStateWatch`` then returns RED_RED. It brakes to
a stop before it ends, even after a failure. A killed process cannot brake, so the motors must stop
when they receive no commands.

The stack's timer uses the steady clock. With ROS time, a wall clock that is set back, or simulated
time that no node publishes, would keep the stack from braking.
"""

from __future__ import annotations

import importlib
import sys
import threading
import time
from typing import Any

from builtin_interfaces.msg import Time
from evgp_kart_bridge.orders import Order
from evgp_kart_bridge.watch import RaceStateWatch
from evgp_node.parameters import ParameterError, StrictNode
from evgp_node.process import OnFailure, run_node, wait_until_heard
from evgp_node.rclpy_private import RCLError
from evgp_node.stamps import stamp
from evgp_protocol.states import RaceState
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.publisher import Publisher
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

STEP = 0.02  # s

COMMAND_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.RELIABLE
)
"""QoS of the motors' topic. With it, the motors receive only the newest command."""

# The target speed (m/s) and the acceleration (m/s²) in each state.
DRIVING = {
    RaceState.IN_GARAGE: (0.0, 8.0),
    RaceState.GRID_ACTIVE: (0.0, 8.0),
    RaceState.GREEN_GREEN: (6.0, 3.0),
    RaceState.RED_FLAG: (0.0, 0.6),  # gently, in 10 s (§3.A: 10-15 s): others may be close behind
    RaceState.RED_RED: (0.0, 8.0),
}

COMMANDS = {
    'twist': ('geometry_msgs', 'Twist', 'cmd_vel'),
    'twist_stamped': ('geometry_msgs', 'TwistStamped', 'cmd_vel'),
    'ackermann': ('ackermann_msgs', 'AckermannDriveStamped', 'drive'),
}
"""Package, message and topic of each type of motor command, by the value of ``command``."""


def speed_command(kind: type, stamp: Time, speed: float) -> Any:
    """
    Return a command to drive straight ahead.

    :param kind: the type of the message.
    :param stamp: the time for its header, if it has one.
    :param speed: the speed, in m/s.
    """
    command: Any = kind()
    if hasattr(command, 'header'):
        command.header.stamp, command.header.frame_id = stamp, 'base_link'
    if hasattr(command, 'drive'):
        command.drive.speed = speed  # and command.drive.steering_angle, rad
    else:
        getattr(command, 'twist', command).linear.x = speed  # and .angular.z, rad/s
    return command


class ExampleStack(StrictNode):
    """Drives when the race state allows it."""

    def __init__(self, on_failure: OnFailure, **node_options: Any) -> None:
        super().__init__('example_stack', **node_options)
        command = self.declare(
            'command', '', f'Type of motor commands: {", ".join(COMMANDS)}. Empty sends none.'
        )
        self.refuse_unknown()
        self._simulates = not command
        # This publishes commands to the motors or, without motors, simulated odometry.
        self._publisher = (
            self.create_publisher(Odometry, 'kart_bridge/odom', 10)
            if self._simulates
            else self._motors_by(command)
        )
        self._driving = threading.Lock()  # held by the timer or `close` while it drives
        self._ended = False
        self._speed = 0.0
        self._published = True
        self._obeyed = ''
        self._watch = RaceStateWatch(self)
        self.create_timer(STEP, self._drive, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _motors_by(self, command: str) -> Publisher:
        if command not in COMMANDS:
            raise ParameterError(f'parameter command must be one of {", ".join(COMMANDS)}')
        package, kind, topic = COMMANDS[command]
        try:
            messages = importlib.import_module(f'{package}.msg')
        except ModuleNotFoundError as error:
            raise ParameterError(
                f'parameter command: {command} needs {package}, which is not sourced'
            ) from error
        return self.create_publisher(getattr(messages, kind), topic, COMMAND_QOS)

    def close(self) -> None:
        """Brake to a stop without the executor, which may no longer be running."""
        with self._driving:
            self._ended = True
            while self._speed > 0.0:
                self._move(RaceState.RED_RED)
                time.sleep(STEP)
            if self._published:
                wait_until_heard(self._publisher)  # the speed of 0

    def _drive(self) -> None:
        with self._driving:
            if self._ended:
                return
            order = self._watch.order
            self._move(order.state)
        obeyed = f'{order.state.value} {self._watch.reason}'
        if obeyed != self._obeyed:
            self._obeyed = obeyed
            self.get_logger().info(obeyed)
        self._acknowledge(order)

    def _move(self, state: RaceState) -> None:
        """Drive one step, and then publish. The kart brakes even if publishing fails."""
        target, rate = DRIVING[state]
        change = max(-rate * STEP, min(rate * STEP, target - self._speed))
        self._speed += change
        published = True
        try:
            self._publisher.publish(self._message())
        except RCLError as error:
            published = False
            if self._published:
                self.get_logger().error(f'The stack cannot publish the speed: {error}')
        self._published = published

    def _message(self) -> Any:
        now = stamp(self.get_clock())
        if not self._simulates:
            return speed_command(self._publisher.msg_type, now, self._speed)
        odometry = Odometry()
        odometry.header.stamp = now
        odometry.header.frame_id, odometry.child_frame_id = 'odom', 'base_link'
        odometry.twist.twist.linear.x = self._speed
        return odometry

    def _acknowledge(self, order: Order) -> None:
        """Acknowledge GREEN_GREEN once the kart drives, GRID_ACTIVE and reds at a standstill."""
        if not self._simulates and order.state is not RaceState.GRID_ACTIVE:
            return  # the stack does not measure the real kart's speed
        moves = self._speed > 0.0
        if order.state is not RaceState.IN_GARAGE and moves is (
            order.state is RaceState.GREEN_GREEN
        ):
            self._watch.acknowledge(order)


def main(args: list[str] | None = None) -> int:
    """Run the stack until SIGINT or SIGTERM."""
    return run_node('example_stack', ExampleStack, args)


if __name__ == '__main__':
    sys.exit(main())
