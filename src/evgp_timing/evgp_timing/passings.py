# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The events from a timing device: passings, signs of life, and unreadable data."""

from __future__ import annotations

import dataclasses
from typing import TypeAlias

MAX_RATE = 200
"""Maximum number of passings accepted from one source per second. The source's node drops further
ones, and so does the timekeeper."""

CLOCK_TOLERANCE = 0.5
"""Maximum difference between a device's clock and the times at which its passings arrive, in
seconds. It is the default of the timekeeper's parameter `clock_tolerance`."""


@dataclasses.dataclass(frozen=True)
class Passing:
    """
    A crossing of the line, by a transponder or by something that broke the beam.

    :ivar time_us: time of the crossing by the device's clock, in microseconds.
    :ivar number: number that the device assigned, up to 2**32 - 1; 0 if it does not assign any.
    :ivar transponder: number or name of the transponder as the device reports it, if necessary
        followed by a space and the label printed on it. An unknown transponder is empty.
    :ivar hits: number of times that the device saw the transponder, up to 65535; 0 if unknown.
    :ivar strength: strength of the signal, in the device's own unit; None if unknown.
    :ivar checked: False if the device sends no checksum, so that transmission errors are possible.
    """

    time_us: int
    number: int = 0
    transponder: str = ''
    hits: int = 0
    strength: float | None = None
    checked: bool = True


@dataclasses.dataclass(frozen=True)
class Refused:
    """Data that the decoder cannot read, with the reason as a phrase."""

    reason: str


@dataclasses.dataclass(frozen=True)
class Sign:
    """A complete message other than a passing, which shows that the device is alive."""


Event: TypeAlias = Passing | Refused | Sign
