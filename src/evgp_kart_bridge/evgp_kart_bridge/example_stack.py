# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
An example stack for a kart without motors: its speed is simulated, and is its odometry.

The stack stops when the bridge dies, because ``RaceStateWatch`` then returns RED_RED. It brakes to
a stop before it ends, even after a failure. A killed process cannot brake, so the motors must stop
when they receive no commands.

The stack's timer uses the steady clock. With ROS time, a wall clock that is set back, or simulated
time that no node publishes, would keep the stack from braking.
"""

from __future__ import annotations

import sys
import threading
import time
from typing import Any

from evgp_kart_bridge.orders import Order
from evgp_kart_bridge.watch import RaceStateWatch
from evgp_node.parameters import StrictNode
from evgp_node.process import OnFailure, run_node, wait_until_heard
from evgp_node.rclpy_private import RCLError
from evgp_node.stamps import stamp
from evgp_protocol.states import RaceState
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType

STEP = 0.02  # s

# The target speed (m/s) and the acceleration (m/s²) in each state.
DRIVING = {
    RaceState.IN_GARAGE: (0.0, 8.0),
    RaceState.GRID_ACTIVE: (0.0, 8.0),
    RaceState.GREEN_GREEN: (6.0, 3.0),
    RaceState.RED_FLAG: (0.0, 0.6),  # gently, in 10 s (§3.A: 10-15 s): others may be close behind
    RaceState.RED_RED: (0.0, 8.0),
}


class ExampleStack(StrictNode):
    """Drives when the race state allows it."""

    def __init__(self, on_failure: OnFailure, **node_options: Any) -> None:
        super().__init__('example_stack', **node_options)
        self.refuse_unknown()
        self._publisher = self.create_publisher(Odometry, 'kart_bridge/odom', 10)
        self._driving = threading.Lock()  # held by the timer or `close` while it drives
        self._ended = False
        self._speed = 0.0
        self._published = True
        self._obeyed = ''
        self._watch = RaceStateWatch(self)
        self.create_timer(STEP, self._drive, clock=Clock(clock_type=ClockType.STEADY_TIME))

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
            self._publisher.publish(self._odometry())
        except RCLError as error:
            published = False
            if self._published:
                self.get_logger().error(f'The stack cannot publish the speed: {error}')
        self._published = published

    def _odometry(self) -> Odometry:
        odometry = Odometry()
        odometry.header.stamp = stamp(self.get_clock())
        odometry.header.frame_id, odometry.child_frame_id = 'odom', 'base_link'
        odometry.twist.twist.linear.x = self._speed
        return odometry

    def _acknowledge(self, order: Order) -> None:
        """Acknowledge GREEN_GREEN once the kart drives, GRID_ACTIVE and reds at a standstill."""
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
