# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A kart in Python without ROS: kit/python/example.py with another ``drive``.

Its base is a datagram socket at the port BASE: the kart sends a speed (m/s) and a turn rate
(rad/s), and receives x, y (m), heading (rad) and speed.
"""

from __future__ import annotations

import os
import pathlib
import socket
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / 'kit/python'))

from centreline import Centreline  # noqa: E402
from evgp_protocol.states import RaceState  # noqa: E402
import example  # noqa: E402

TOP = 5.5
"""Maximum speed, in m/s."""

STANDSTILL = 0.5
"""Minimum time without motion or a command to drive that counts as a standstill, in seconds: more
than the dead time."""

FRESH = 0.2
"""Maximum age of the base's last message, in seconds."""

LANE = -1.2
"""Distance of its lane from the middle, to the left, in metres."""


class Kart:
    """Drives beside the middle of the track when the race state allows it."""

    def __init__(self) -> None:
        """Read the track, and start at standstill."""
        self._track = Centreline(pathlib.Path(os.environ['TRACK']))
        self._base = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._base.connect(('127.0.0.1', int(os.environ['BASE'])))
        self._base.setblocking(False)
        self._pose = (0.0, 0.0, 0.0)
        self._speed = self._wanted = 0.0
        self._heard_at = float('-inf')
        self._moved_at = time.monotonic()  # it moved, was commanded to, or its motion was unknown

    def drive(self, state: RaceState, may_drive: bool) -> bool:
        """Obey the state for one turn; return whether the kart has reached it."""
        self._listen()
        now = time.monotonic()
        fresh = now - self._heard_at < FRESH
        commanded = self._wanted > 0.0  # until now
        if fresh and state is RaceState.GREEN_GREEN and may_drive:
            self._wanted = TOP
        elif fresh and state is RaceState.RED_FLAG and may_drive:
            self._wanted = max(0.0, min(self._wanted, self._speed) - 0.03)
        else:
            self._wanted = 0.0
        turn = self._wanted * self._track.steer(*self._pose, LANE)
        self._base.send(f'{self._wanted} {turn}'.encode())
        if not fresh or commanded or self._speed > 0.0:
            self._moved_at = now
        if state is RaceState.GREEN_GREEN:
            return fresh and self._wanted > 0.0 and self._speed > 0.5
        return now - self._moved_at >= STANDSTILL

    def _listen(self) -> None:
        while True:
            try:
                said = self._base.recv(100)
            except BlockingIOError:
                return
            x, y, heading, self._speed = map(float, said.split())
            self._pose, self._heard_at = (x, y, heading), time.monotonic()


if __name__ == '__main__':
    example.main(Kart().drive)
