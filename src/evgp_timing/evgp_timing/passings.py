# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What a timing device says: passings, signs of life, and what cannot be read."""

from __future__ import annotations

import dataclasses
from typing import Protocol, TypeAlias


@dataclasses.dataclass(frozen=True)
class Passing:
    """
    A transponder, or whoever broke the beam, crossed the line.

    :ivar time_us: when, by the clock that the device has, in microseconds.
    :ivar number: how the device counts it, up to 2**32 - 1; 0: it does not count.
    :ivar transponder: its number or name, as the device has it, or its number, a space, and the
        label that is printed on it; empty: nobody knows who it was.
    :ivar hits: how often the device saw it, up to 65535; 0: it does not say.
    :ivar strength: of the signal, in the device's own measure; None: it does not say.
    :ivar checked: False: the device sends no checksum, so it may have been changed on the way.
    """

    time_us: int
    number: int = 0
    transponder: str = ''
    hits: int = 0
    strength: float | None = None
    checked: bool = True


@dataclasses.dataclass(frozen=True)
class Refused:
    """Something that cannot be read, and why not."""

    reason: str


@dataclasses.dataclass(frozen=True)
class Sign:
    """Something whole that is no passing: the device is there."""


Event: TypeAlias = Passing | Refused | Sign


class Decoder(Protocol):
    """Takes the bytes of one connection, however they are cut, and never raises."""

    def feed(self, data: bytes) -> list[Event]:
        """Return what these bytes complete."""
