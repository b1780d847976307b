# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The middle of a track, and steering along it. Pure."""

from __future__ import annotations

import csv
import itertools
import math
import pathlib

AHEAD = 3.0
"""Distance ahead at which a kart aims, in metres (pure pursuit)."""


class Centreline:
    """
    The middle of a closed track, from a file of x, y, and the width to the right and left, in m.

    Its first point is on the finish line, where the track runs along x.
    """

    def __init__(self, path: pathlib.Path) -> None:
        """Read the file."""
        with path.open(encoding='utf-8') as lines:
            rows = [tuple(map(float, row)) for row in csv.reader(lines) if row[0][0] != '#']
        self.points = [(x, y) for x, y, _, _ in rows]
        self.width = min(right + left for _, _, right, left in rows)
        closed = itertools.pairwise([*self.points, self.points[0]])
        self.gap = sum(math.dist(*pair) for pair in closed) / len(rows)

    def nearest(self, x: float, y: float) -> int:
        """Return the index of the nearest point to a place."""
        distances = [math.dist(point, (x, y)) for point in self.points]
        return distances.index(min(distances))

    def off(self, x: float, y: float) -> float:
        """Return a place's distance to the left of the line, in metres; negative: to the right."""
        index = self.nearest(x, y)
        along, (px, py) = self._along(index), self.points[index]
        return (y - py) * math.cos(along) - (x - px) * math.sin(along)

    def steer(self, x: float, y: float, heading: float, lane: float = 0.0) -> float:
        """
        Return the curvature, in 1/m, that leads from a pose to the line; positive: to the left.

        :param lane: distance of the kart's lane to the left of the line, in metres.
        """
        index = (self.nearest(x, y) + round(AHEAD / self.gap)) % len(self.points)
        along = self._along(index)
        aim_x = self.points[index][0] - lane * math.sin(along)
        aim_y = self.points[index][1] + lane * math.cos(along)
        angle = math.atan2(aim_y - y, aim_x - x) - heading
        return 2 * math.sin(angle) / math.dist((aim_x, aim_y), (x, y))

    def _along(self, index: int) -> float:
        """Return the direction of the line at a point, in rad."""
        (ax, ay), (bx, by) = self.points[index - 1], self.points[(index + 1) % len(self.points)]
        return math.atan2(by - ay, bx - ax)
