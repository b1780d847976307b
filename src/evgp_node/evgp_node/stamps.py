# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Wall time in messages, whatever the wall clock says."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from rclpy.clock import Clock

_NS = 1_000_000_000
_LAST = 2**31 * _NS - 1


def stamp_of(nanoseconds: int) -> Time:
    """
    Return a wall time, in nanoseconds since 1970, as a message.

    A message's seconds have 32 bits and end in January 2038. A later time is told as the last that
    fits, and one before 1970 as 1970: a clock that is wrong must not keep a message from karts.
    """
    seconds, rest = divmod(min(max(nanoseconds, 0), _LAST), _NS)
    return Time(sec=seconds, nanosec=rest)


def stamp(clock: Clock) -> Time:
    """Return the time of a node's clock as a message."""
    return stamp_of(clock.now().nanoseconds)
