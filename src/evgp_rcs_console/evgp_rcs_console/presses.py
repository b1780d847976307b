# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Counts the presses of a stop button from the key events of its device.

A key counts when it goes down. It counts again only after it has been up.

Pure: bytes and times go in.
"""

from __future__ import annotations

from collections.abc import Iterator, Set
import math
import struct

EVENT = struct.Struct('@llHHi')
"""Layout of an input event (linux/input.h): its time in two parts, type, code, value."""

HELD = 2.0
"""Time after which a key that stays down is reported, in seconds. Something may be lying on it."""

_SYN, _DROPPED = 0, 3
_KEY = 1


def changes(data: bytes) -> Iterator[tuple[int, bool] | None]:
    """Yield each key with whether it is down, and None where the kernel has dropped events."""
    whole = len(data) - len(data) % EVENT.size
    for _, _, kind, code, value in EVENT.iter_unpack(data[:whole]):
        if kind == _KEY:
            yield code, value != 0
        elif (kind, code) == (_SYN, _DROPPED):
            yield None


class PressCounter:
    """
    Counts the presses of one button.

    Times are in seconds and must not decrease.

    :param key: the code of the only key that counts; 0: every key counts.
    :ivar count: number of presses.
    """

    def __init__(self, key: int = 0) -> None:
        self.count = 0
        self._key = key
        self._known = False
        self._down: dict[int, float] = {}

    def look(self, down: Set[int], now: float) -> bool:
        """
        Process the keys that are down when the device is opened; return whether one is a press.

        The first time, a key that is down is not a press, because something may be lying on it.
        Later it is one, because somebody may have pressed it while the device was gone.
        """
        known, self._known = self._known, True
        if not known:
            self._down = {key: -math.inf for key in down if self._key in (0, key)}
            return False
        for key in self._down.keys() - down:
            self.take(key, False, now)
        return any([self.take(key, True, now) for key in down])  # noqa: C419 - each is taken

    def take(self, key: int, down: bool, now: float) -> bool:
        """Process a key that is down or up; return whether that is a press."""
        if self._key not in (0, key):
            return False
        if not down:
            self._down.pop(key, None)
            return False
        if key in self._down:
            return False  # the key is held and repeats
        self._down[key] = now
        self.count += 1
        return True

    def miss(self, down: Set[int], now: float) -> None:
        """Count a press after events were dropped, because one of them may have been a press."""
        if not self.look(down, now):
            self.count += 1

    @property
    def is_down(self) -> bool:
        """Return whether a key is down that went down since the first look."""
        return any(since > -math.inf for since in self._down.values())

    def is_held(self, now: float) -> bool:
        """Return whether a key has been down for too long, or since the first look."""
        return any(now - since >= HELD for since in self._down.values())
