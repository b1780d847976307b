# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A kart in Python without ROS: kit/python/example.py with another ``drive``.

Its base, which steers by itself, is a datagram socket at the port BASE: the kart sends the speed
that it wants, and receives its true speed, in m/s.
"""

from __future__ import annotations

import os
import pathlib
import socket
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / 'kit/python'))

from evgp_protocol.states import RaceState  # noqa: E402
import example  # noqa: E402

TOP = 5.5
"""Maximum speed, in m/s."""

STANDSTILL = 0.5
"""Minimum time without motion or a command to drive that counts as a standstill, in seconds: more
than the dead time."""

FRESH = 0.2
"""Maximum age of the base's last message, in seconds."""


class Kart:
    """Drives when the race state allows it."""

    def __init__(self) -> None:
        """Start at standstill."""
        self._base = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._base.connect(('127.0.0.1', int(os.environ['BASE'])))
        self._base.setblocking(False)
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
        self._base.send(str(self._wanted).encode())
        if not fresh or commanded or self._speed > 0.0:
            self._moved_at = now
        if state is RaceState.GREEN_GREEN:
            return fresh and self._wanted > 0.0 and self._speed > 0.5
        return now - self._moved_at >= STANDSTILL

    def _listen(self) -> None:
        while True:
            try:
                self._speed = float(self._base.recv(100))
            except BlockingIOError:
                return
            self._heard_at = time.monotonic()


if __name__ == '__main__':
    example.main(Kart().drive)
