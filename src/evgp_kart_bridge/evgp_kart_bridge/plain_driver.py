# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
An example node to copy, which obeys the topic `~/state` without any of our messages or packages.

It does not acknowledge anything, so another node of the kart must do that.
"""

import math
import time

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import String

LEASE = 0.5  # s; after a longer silence, the bridge may have died


def boot_time() -> float:
    """Return the time since boot in seconds, including suspend. This clock cannot be set."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class Driver(Node):
    """Drives straight ahead in GREEN_GREEN, if it heard GRID_ACTIVE before."""

    def __init__(self) -> None:
        super().__init__('driver')
        self.state = 'RED_RED'
        self.heard_at = -math.inf  # s
        self.armed = False
        self.speed = 0.0  # m/s; the kart brakes hard in RED_FLAG if there is no odometry
        self.wanted = 0.0  # m/s
        self.logged = ''
        self.motors = self.create_publisher(Twist, 'cmd_vel', 1)
        self.create_subscription(String, 'kart_bridge/state', self.hear, 1)  # only the newest
        self.create_subscription(Odometry, 'odom', self.hear_odometry, 1)
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # ROS time may stop
        self.create_timer(0.05, self.step, clock=steady)

    def hear(self, message: String) -> None:
        """Process a state. GRID_ACTIVE arms the driver, and only GREEN_GREEN keeps it armed."""
        now = boot_time()
        unbroken = now - self.heard_at <= LEASE
        self.armed = message.data == 'GRID_ACTIVE' or (
            self.armed and unbroken and message.data == 'GREEN_GREEN'
        )
        self.state, self.heard_at = message.data, now

    def hear_odometry(self, odometry: Odometry) -> None:
        """Update the speed."""
        self.speed = abs(odometry.twist.twist.linear.x)

    def step(self) -> None:
        """Drive or brake. Put your code here."""
        silent = boot_time() - self.heard_at > LEASE
        self.armed = self.armed and not silent
        text = self.state
        if silent:
            self.wanted, text = 0.0, f'nothing on kart_bridge/state for {LEASE} s: stopping'
        elif self.state == 'GREEN_GREEN' and self.armed:
            self.wanted = 6.0
        elif self.state == 'RED_FLAG':  # gently: 10 s from 6 m/s
            self.wanted = max(0.0, min(self.speed, self.wanted) - 0.03)
        else:
            self.wanted = 0.0
            if self.state == 'GREEN_GREEN':
                text = 'GREEN_GREEN: waiting for the next GRID_ACTIVE'
        command = Twist()
        command.linear.x = self.wanted
        self.motors.publish(command)
        if text != self.logged:
            self.logged = text
            self.get_logger().info(text)


def main() -> None:
    """Run the driver. The motors must brake when commands stop coming."""
    rclpy.init()
    try:
        rclpy.spin(Driver())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == '__main__':
    main()
