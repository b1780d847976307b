# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
MYLAPS P3, as its decoders speak it over TCP. The decoder is the server; nothing is sent to it.

From public descriptions and captures, not from MYLAPS: see docs/timing.md.
"""

from __future__ import annotations

import math

from evgp_timing.framing import Framing, Record, RecordDecoder
from evgp_timing.passings import Event, Passing, Refused, Sign

PORT = 5403
"""TCP port at which a decoder listens."""

PASSING, STATUS = 0x0001, 0x0002
"""Types of records; there are more."""

NUMBER, TRANSPONDER, RTC_TIME, STRENGTH, HITS = 0x01, 0x03, 0x04, 0x05, 0x06
"""Fields of a passing; there are more."""


def checksum(record: bytes) -> int:
    """
    Return the CRC of 16 bits: polynomial 0x1021, begun with 0xFFFF, each byte added at the end.

    It is not CCITT's usual one, which adds each byte at the beginning.
    """
    crc = 0xFFFF
    for byte in record:
        for _ in range(8):
            crc = crc << 1 ^ (0x11021 if crc & 0x8000 else 0)
        crc ^= byte
    return crc


FRAMING = Framing(
    begin=0x8E,
    end=0x8F,
    escape=0x8D,
    shift=0x20,
    head=b'\x02\0\0\0\0\0\0',  # version, length, checksum, flags
    length_at=2,
    checksum_at=4,
    checksum=checksum,
)


def read(record: Record) -> Event:
    """Return what a record says; the time is in microseconds since 1970, by its own clock."""
    if record.kind != PASSING:
        return Sign()
    number, transponder = record.number(NUMBER, 4), record.number(TRANSPONDER, 4)
    time_us, strength = record.number(RTC_TIME, 8), record.number(STRENGTH, 2)
    if number is None or transponder is None or time_us is None:
        return Refused('a passing lacks its number, transponder or time')
    return Passing(
        time_us=time_us,
        number=number,
        transponder=str(transponder),
        hits=record.number(HITS, 2) or 0,
        strength=math.nan if strength is None else float(strength),
    )


def decoder() -> RecordDecoder:
    """Return a decoder for one connection."""
    return RecordDecoder(FRAMING, read)
