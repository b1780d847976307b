# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A stack in Python with ROS 2: the shortest stack, with steering along the middle."""

from __future__ import annotations

import contextlib
import math
import os
import pathlib

from centreline import Centreline
from evgp_kart_bridge import shortest_stack
from geometry_msgs.msg import Pose, Twist
from nav_msgs.msg import Odometry
import rclpy
from rclpy.executors import ExternalShutdownException


class Stack(shortest_stack.Stack):
    """Drives along the middle of the track when the race state allows it."""

    def __init__(self) -> None:
        """Read the track, and start the stack."""
        self.pose = Pose()
        self.track = Centreline(pathlib.Path(os.environ['TRACK']))
        super().__init__()

    def hear_odometry(self, odometry: Odometry) -> None:
        """Also take the pose."""
        super().hear_odometry(odometry)
        self.pose = odometry.pose.pose

    def move(self, speed: float) -> None:
        """Send the motors a speed, in m/s, and a turn rate."""
        place, turned = self.pose.position, self.pose.orientation
        heading = 2 * math.atan2(turned.z, turned.w)
        command = Twist()
        command.linear.x = speed
        command.angular.z = speed * self.track.steer(place.x, place.y, heading)
        self.motors.publish(command)


if __name__ == '__main__':
    rclpy.init()
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(Stack())
