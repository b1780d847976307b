# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
A kart's base with inertia: obeys velocity commands, says its speed, brakes when left alone.

``setup/in-workspace python -m evgp_testing.base`` is one on this shell's ROS domain, until Ctrl-C.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
import contextlib
import os
import signal
import threading
import time

from evgp_testing.ros_side import RosSide
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType

COMMAND_TIMEOUT = 0.5
"""Time without a command after which the base brakes by itself, s."""

ODOMETRY_RATE = 50.0
"""How often the base says its speed by default, Hz."""


class SimulatedBase(RosSide):
    """
    A base that obeys ``/cmd_vel`` and publishes ``/odom`` on a kart's domain.

    :param acceleration: how fast it gets faster, m/s².
    :param braking: how fast it gets slower, m/s².
    :param dead_time: time from a command to the moment at which the base begins to obey it, s.
    :param odometry_rate: how often it says its speed, Hz.
    """

    def __init__(
        self,
        domain: int,
        acceleration: float = 3.0,
        braking: float = 8.0,
        dead_time: float = 0.0,
        odometry_rate: float = ODOMETRY_RATE,
    ) -> None:
        """Join the kart's domain and stand."""
        super().__init__(f'base_{domain}', domain)
        self._acceleration, self._braking = acceleration, braking
        self._dead_time = dead_time
        self._moving = threading.Lock()
        self._coming: deque[tuple[float, float]] = deque()  # commands in their dead time
        self._speed = self._wanted = self._distance = 0.0
        self._at = self._commanded_at = time.monotonic()
        self.node.create_subscription(Twist, '/cmd_vel', self._obey, 1)
        self._odometry = self.node.create_publisher(Odometry, '/odom', 10)
        self.node.create_timer(
            1 / odometry_rate, self._say, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self.spin()

    @property
    def speed(self) -> float:
        """Its true speed at this moment, m/s, whatever odometry has said so far."""
        with self._moving:
            return self._move(time.monotonic())

    @property
    def distance(self) -> float:
        """Its way so far, m."""
        with self._moving:
            self._move(time.monotonic())
            return self._distance

    @property
    def speed_to_come(self) -> float:
        """Return the highest speed that it has, or is going to try by the commands it has, m/s."""
        with self._moving:
            speed = self._move(time.monotonic())
            return max([speed, self._wanted, *(wanted for _, wanted in self._coming)])

    def wait_for_speed(self, found: Callable[[float], bool]) -> None:
        """
        Return once its speed, m/s, is one for which `found` is true.

        :raises AssertionError: if it does not get there in time.
        """
        self.wait_until(lambda: found(self.speed), lambda: f'such a speed; it is {self.speed}')

    def _move(self, now: float) -> float:
        """Bring the speed up to date, command by command."""
        while self._coming and self._coming[0][0] <= now:
            at, wanted = self._coming.popleft()
            self._advance(at)
            self._wanted, self._commanded_at = wanted, at
        return self._advance(now)

    def _advance(self, now: float) -> float:
        """Bring the speed up to date, by the command until it timed out, then braking."""
        silent_at = max(self._at, self._commanded_at + COMMAND_TIMEOUT)
        for until, wanted in ((min(now, silent_at), self._wanted), (now, 0.0)):
            speed, change = self._speed, wanted - self._speed
            passed = max(until - self._at, 0.0)
            most = passed * (self._acceleration if change > 0 else self._braking)
            self._speed += max(-most, min(most, change))
            self._distance += passed * (speed + self._speed) / 2
            self._at = max(until, self._at)
        return self._speed

    def _obey(self, command: Twist) -> None:
        with self._moving:
            due = time.monotonic() + self._dead_time
            self._coming.append((due, max(command.linear.x, 0.0)))

    def _say(self) -> None:
        odometry = Odometry()
        odometry.twist.twist.linear.x = self.speed
        self._odometry.publish(odometry)
        with self.news:
            self.news.notify_all()


def main() -> None:
    """Be a base on this shell's ROS domain until Ctrl-C."""
    with SimulatedBase(int(os.environ.get('ROS_DOMAIN_ID', '0'))):
        print('A base: it obeys /cmd_vel and publishes /odom. Ctrl-C ends it.', flush=True)
        with contextlib.suppress(KeyboardInterrupt):
            signal.pause()


if __name__ == '__main__':
    main()
