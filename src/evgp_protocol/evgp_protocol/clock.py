# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The clock that stops karts, which counts the seconds since boot, including suspend. Linux only.

The wall clock can be set, and the monotonic clock stops while a machine is suspended. With those,
a frame from before a clock change or a closed lid would seem fresh.
"""

from __future__ import annotations

import time


def now() -> float:
    """Return the time since boot, including suspend, in seconds."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def duration(seconds: float, digits: int = 1) -> str:
    """
    Return a duration as ``59.9 s``, ``1:05.0 min`` or ``2:03:04.5 h``.

    :param digits: number of decimals of the seconds.
    """
    whole, rest = divmod(round(max(seconds, 0.0) * 10**digits), 10**digits)
    point = f'.{rest:0{digits}}' if digits else ''
    minutes, second = divmod(whole, 60)
    hours, minute = divmod(minutes, 60)
    if hours:
        return f'{hours}:{minute:02}:{second:02}{point} h'
    return f'{minute}:{second:02}{point} min' if minute else f'{second}{point} s'
