# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A kart's base with inertia, which obeys velocity commands, brakes without them, and has odometry.

``setup/in-workspace python -m evgp_testing.base`` runs one on this shell's domain until Ctrl-C.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
import contextlib
import copy
import math
import os
import signal
import sys
import threading
import time

from evgp_testing.ros_side import RosSide
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType

COMMAND_TIMEOUT = 0.5
"""Time without a command after which the base brakes automatically, in seconds."""

ODOMETRY_RATE = 50.0
"""Default rate at which the base publishes its speed, in Hz."""


class Motion:
    """
    The motion of a kart under its commands. After ``COMMAND_TIMEOUT`` without one, it brakes.

    This class is pure: times are by a monotonic clock, in seconds. ``speed`` is in m/s, and
    ``distance`` is the distance driven, in m. ``x`` and ``y`` (m) and ``heading`` (rad) are the
    kart's pose by REP-103.

    :param now: the time at which the kart starts, at rest.
    :param acceleration: maximum acceleration, in m/s².
    :param braking: maximum deceleration, in m/s².
    :param place: initial x and y, in m. The kart faces along x.
    """

    def __init__(
        self,
        now: float,
        acceleration: float = 3.0,
        braking: float = 8.0,
        place: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.speed = self.distance = self.heading = 0.0
        self.x, self.y = place
        self._acceleration, self._braking = acceleration, braking
        self._wanted = self._curvature = 0.0
        self._at = self._commanded_at = now

    def command(self, now: float, speed: float, turn: float = 0.0) -> None:
        """
        Apply a command, with a speed in m/s and the turn rate at that speed in rad/s.

        The steering angle follows from both, so the kart turns more slowly at a lower speed. A
        speed that is NaN brakes.
        """
        self.advance(now)
        self._wanted, self._commanded_at = max(0.0, speed), now
        self._curvature = turn / speed if speed > 0.0 else self._curvature

    def advance(self, now: float) -> None:
        """Advance to a time, by the command until it is too old, and then by braking."""
        silent_at = max(self._at, self._commanded_at + COMMAND_TIMEOUT)
        for until, wanted in ((min(now, silent_at), self._wanted), (now, 0.0)):
            speed, change = self.speed, wanted - self.speed
            passed = max(until - self._at, 0.0)
            most = passed * (self._acceleration if change > 0 else self._braking)
            self.speed += max(-most, min(most, change))
            way = passed * (speed + self.speed) / 2
            heading = self.heading + way * self._curvature / 2
            self.x, self.y = self.x + way * math.cos(heading), self.y + way * math.sin(heading)
            self.heading += way * self._curvature
            self.distance += way
            self._at = max(until, self._at)

    @property
    def speed_to_come(self) -> float:
        """Return the higher of the present and the commanded speed, in m/s."""
        return max(self.speed, self._wanted)


class SimulatedBase(RosSide):
    """
    A base that obeys ``/cmd_vel`` and publishes ``/odom`` on a kart's domain.

    For ``acceleration``, ``braking`` and ``place``, see ``Motion``.

    :param dead_time: time from a command until the base begins to obey it, in seconds.
    :param odometry_rate: rate of odometry, in Hz.
    :param arguments: ROS arguments, such as ``('--ros-args', '-r', '__ns:=/kart7')``.
    """

    def __init__(
        self,
        domain: int,
        acceleration: float = 3.0,
        braking: float = 8.0,
        dead_time: float = 0.0,
        odometry_rate: float = ODOMETRY_RATE,
        place: tuple[float, float] = (0.0, 0.0),
        arguments: Sequence[str] = (),
    ) -> None:
        """Join the kart's domain, at rest."""
        super().__init__(f'base_{domain}', domain, arguments)
        self._dead_time = dead_time
        self._moving = threading.Lock()
        self._coming: deque[tuple[float, float, float]] = deque()  # commands in their dead time
        self._motion = Motion(time.monotonic(), acceleration, braking, place)
        self.node.create_subscription(Twist, 'cmd_vel', self._obey, 1)
        self._odometry = self.node.create_publisher(Odometry, 'odom', 10)
        self.node.create_timer(
            1 / odometry_rate, self._say, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self.spin()

    @property
    def motion(self) -> Motion:
        """Return the base's present motion, whatever odometry has published so far."""
        with self._moving:
            return copy.copy(self._move())

    @property
    def speed(self) -> float:
        """Return the true present speed, in m/s."""
        return self.motion.speed

    @property
    def distance(self) -> float:
        """Return the distance driven so far, in m."""
        return self.motion.distance

    @property
    def speed_to_come(self) -> float:
        """Return the highest of the present speed and all commanded speeds to come, in m/s."""
        with self._moving:
            return max([self._move().speed_to_come, *(speed for _, speed, _ in self._coming)])

    def wait_for_speed(self, found: Callable[[float], bool]) -> None:
        """Wait until `found` is true for the speed, in m/s."""
        self.wait_until(lambda: found(self.speed), lambda: f'such a speed; it is {self.speed}')

    def _move(self) -> Motion:
        """Advance the motion to the present. The caller holds the lock."""
        now = time.monotonic()
        while self._coming and self._coming[0][0] <= now:
            self._motion.command(*self._coming.popleft())
        self._motion.advance(now)
        return self._motion

    def _obey(self, command: Twist) -> None:
        with self._moving:
            due = time.monotonic() + self._dead_time
            self._coming.append((due, command.linear.x, command.angular.z))

    def _say(self) -> None:
        motion, odometry = self.motion, Odometry()
        odometry.header.frame_id, odometry.child_frame_id = 'odom', 'base_link'
        odometry.pose.pose.position.x, odometry.pose.pose.position.y = motion.x, motion.y
        odometry.pose.pose.orientation.z = math.sin(motion.heading / 2)
        odometry.pose.pose.orientation.w = math.cos(motion.heading / 2)
        odometry.twist.twist.linear.x = motion.speed
        self._odometry.publish(odometry)
        with self.news:
            self.news.notify_all()


def main() -> None:
    """Run a base on this shell's ROS domain until Ctrl-C."""
    domain = int(os.environ.get('ROS_DOMAIN_ID', '0'))
    with SimulatedBase(domain, arguments=sys.argv[1:]) as base:
        motors, odometry = map(base.node.resolve_topic_name, ('cmd_vel', 'odom'))
        print(f'The base obeys {motors} and publishes {odometry}. Ctrl-C ends it.', flush=True)
        with contextlib.suppress(KeyboardInterrupt):
            signal.pause()


if __name__ == '__main__':
    main()
