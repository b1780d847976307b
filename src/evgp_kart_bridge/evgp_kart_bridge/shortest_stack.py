# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The shortest stack that obeys race control."""

import math
import time

from evgp_kart_bridge.watch import RaceStateWatch
from evgp_protocol.states import RaceState
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

STANDSTILL_TIME = 0.5  # s; must be longer than your kart's dead time plus 0.1 s
ODOMETRY_GAP = 0.2  # s; older odometry does not count


class Stack(Node):
    """Drives straight ahead when the race state allows it."""

    def __init__(self) -> None:
        """Subscribe to the race state and odometry and start the timer."""
        super().__init__('stack')
        self.watch = RaceStateWatch(self)
        self.speed = math.nan  # m/s
        self.wanted = 0.0  # m/s
        self.driving = False
        self.heard_at = -math.inf  # s, the last odometry
        self.still_since = math.inf  # s; infinite: the kart moves
        self.motors = self.create_publisher(Twist, 'cmd_vel', 1)
        self.create_subscription(Odometry, 'odom', self.hear_odometry, 10)
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # ROS time may stop
        self.create_timer(0.05, self.step, clock=steady)

    def step(self) -> None:
        """Carry out the order; once that is done, acknowledge the same order."""
        order = self.watch.order  # RED_RED also when the bridge dies
        if self.drive(order.state):
            self.watch.acknowledge(order)

    def drive(self, state: RaceState) -> bool:
        """Drive or brake; return whether the kart has reached the state. Put your code here."""
        fresh = time.monotonic() - self.heard_at < ODOMETRY_GAP
        self.driving = fresh and state is RaceState.GREEN_GREEN  # not without odometry
        if self.driving:
            self.wanted = 6.0
        elif fresh and state is RaceState.RED_FLAG:  # gently: 10 s from 6 m/s
            self.wanted = max(0.0, min(self.speed, self.wanted) - 0.03)
        else:
            self.wanted = 0.0
        self.move(self.wanted)
        if self.driving:
            self.still_since = math.inf  # a standstill counts from the first command to stop
            return self.speed > 0.1
        still = fresh and self.heard_at - self.still_since >= STANDSTILL_TIME
        return still and state is not RaceState.GREEN_GREEN

    def move(self, speed: float) -> None:
        """Send the motors a speed, in m/s."""
        command = Twist()
        command.linear.x = speed
        self.motors.publish(command)

    def hear_odometry(self, odometry: Odometry) -> None:
        """Update the speed, and the time since which the kart has certainly stood still."""
        now = time.monotonic()
        self.speed = abs(odometry.twist.twist.linear.x)
        if self.driving or not self.speed < 0.05:  # also NaN
            self.still_since = math.inf
        elif now - self.heard_at > ODOMETRY_GAP:
            self.still_since = now
        else:
            self.still_since = min(self.still_since, now)
        self.heard_at = now


def main() -> None:
    """Run the stack. The base must brake when commands stop coming."""
    rclpy.init()
    try:
        rclpy.spin(Stack())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == '__main__':
    main()
