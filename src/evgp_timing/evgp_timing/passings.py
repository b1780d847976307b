# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The events from a timing device: passings, signs of life, and unreadable data."""

from __future__ import annotations

import dataclasses
from typing import TypeAlias

from evgp_node.results import Passing

MAX_RATE = 200
"""Maximum number of passings accepted from one source per second. The source's node drops further
ones, and so does the timekeeper."""

CLOCK_TOLERANCE = 0.5
"""Maximum difference between a device's clock and the times at which its passings arrive, in
seconds. It is the default of the timekeeper's parameter `clock_tolerance`."""


def of_device(time_us: int, number: int = 0, transponder: str = '') -> Passing:
    """
    Return a passing as a device reports it, of which its source is not known yet.

    :param time_us: time of the crossing by the device's clock, in microseconds.
    :param number: number that the device assigned, up to 2**32 - 1; 0 if it does not assign any.
    :param transponder: number or name of the transponder as the device reports it, if necessary
        followed by a space and the label printed on it. An unknown transponder is empty.
    """
    return Passing('', '', number, 0, transponder, time_us * 1000)


class Unchecked(Passing):
    """A passing that came without a checksum, so that transmission errors are possible."""


@dataclasses.dataclass(frozen=True)
class Refused:
    """Data that the decoder cannot read, with the reason as a phrase."""

    reason: str


@dataclasses.dataclass(frozen=True)
class Sign:
    """A complete message other than a passing, which shows that the device is alive."""


Event: TypeAlias = Passing | Refused | Sign
