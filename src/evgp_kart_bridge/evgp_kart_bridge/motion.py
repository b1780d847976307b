# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The kart's motion according to odometry, with its twist checked against its pose.

A twist that is not filled in, or is stuck, reads 0.00 m/s at any speed. The bridge would then
acknowledge a stop while the kart rolls. This module therefore compares the distance
between poses with the distance that the twist explains. It is pure: each input contains its time.
"""

from __future__ import annotations

from collections import deque
import math

WINDOW = 1.0
"""Period over which this module compares pose and twist, in seconds."""

POSE_NOISE = 0.1
"""Maximum distance that the pose of a kart at standstill moves within `WINDOW`, in metres."""


class Motion:
    """
    The kart's speed from odometry.

    :ivar contradiction: how pose and twist contradict each other, as a sentence, if they do.
    """

    def __init__(self) -> None:
        self.contradiction = ''
        self._seen: deque[tuple[float, float, float, float]] = deque()  # time, x, y, distance

    def speed(self, twist: float, x: float, y: float, now: float) -> float:
        """
        Return the speed to rely on, in m/s.

        If the twist does not explain how the pose moved, this is at least the speed of the pose.

        :param twist: the speed of the twist, in m/s.
        :param x: the x of the pose, in m. A pose that is not finite is ignored.
        :param y: the y of the pose, in m.
        :param now: the time, in seconds.
        """
        if not (math.isfinite(x) and math.isfinite(y)):
            self._seen.clear()
            self.contradiction = ''
            return twist
        way = 0.0
        if self._seen:
            then, *_, before = self._seen[-1]
            way = before + (abs(twist) * (now - then) if math.isfinite(twist) else 0.0)
        self._seen.append((now, x, y, way))
        while now - self._seen[0][0] > WINDOW:
            self._seen.popleft()
        went, explained = max(
            (
                (math.hypot(x - then_x, y - then_y), way - before)
                for _, then_x, then_y, before in self._seen
            ),
            key=lambda each: each[0] - 2 * each[1],
        )
        if went <= 2 * explained + POSE_NOISE:  # a twist may read half of the true speed
            self.contradiction = ''
            return twist
        self.contradiction = (
            f'the pose of odometry moved {went:.1f} m within {WINDOW:g} s, but its twist explains '
            f'{explained:.1f} m: is the twist filled in?'
        )
        return math.nan if math.isnan(twist) else max(abs(twist), went / WINDOW)
