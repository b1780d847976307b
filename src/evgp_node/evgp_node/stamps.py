# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The times in messages."""

from __future__ import annotations

from builtin_interfaces.msg import Duration, Time
from rclpy.clock import Clock

NS = 1_000_000_000
_LAST = 2**31 * NS - 1


def stamp_of(nanoseconds: int) -> Time:
    """
    Return a wall time, in nanoseconds since 1970, as a message.

    A message's seconds have 32 bits, which end in January 2038. A later time becomes the last one
    that fits, and a time before 1970 becomes 1970, so that a wrong clock never prevents a message.
    """
    seconds, rest = divmod(min(max(nanoseconds, 0), _LAST), NS)
    return Time(sec=seconds, nanosec=rest)


def seconds_of(time: Time | Duration) -> float:
    return float(time.sec) + float(time.nanosec) / NS


def stamp(clock: Clock) -> Time:
    """Return the time of a node's clock as a message."""
    return stamp_of(clock.now().nanoseconds)
