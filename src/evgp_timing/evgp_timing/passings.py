# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The messages of a timing device: passings, signs of life, and unreadable data."""

from __future__ import annotations

import dataclasses
from typing import Protocol, TypeAlias


@dataclasses.dataclass(frozen=True)
class Passing:
    """
    A crossing of the line, by a transponder or by something that broke the beam.

    :ivar time_us: when, by the device's clock, in microseconds.
    :ivar number: the device's count of it, up to 2**32 - 1; 0: the device does not count.
    :ivar transponder: the transponder's number or name on the device, or its number, a space and
        the label printed on it; empty if unknown.
    :ivar hits: number of times the device saw it, up to 65535; 0 if not given.
    :ivar strength: strength of the signal, in the device's own unit; None if not given.
    :ivar checked: False: the device sends no checksum, so transmission errors are possible.
    """

    time_us: int
    number: int = 0
    transponder: str = ''
    hits: int = 0
    strength: float | None = None
    checked: bool = True


@dataclasses.dataclass(frozen=True)
class Refused:
    """Data that cannot be read, and the reason."""

    reason: str


@dataclasses.dataclass(frozen=True)
class Sign:
    """A complete message that is no passing; it shows that the device is alive."""


Event: TypeAlias = Passing | Refused | Sign


class Decoder(Protocol):
    """Decodes the bytes of one connection, however they are split, and never raises."""

    def feed(self, data: bytes) -> list[Event]:
        """Return the events that these bytes complete."""
