# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The P3 protocol of MYLAPS, as its decoders send it over TCP.

The decoder is the server, and our side only reads. The format comes from public descriptions and
captures, not from MYLAPS (see README.md).
"""

from __future__ import annotations

import binascii
import enum

from evgp_timing.framing import Framing, Record
from evgp_timing.passings import Event, of_device, Refused, Unchecked


class Field(enum.IntEnum):
    """The fields of a passing that this module uses."""

    NUMBER = 0x01
    TRANSPONDER = 0x03
    RTC_TIME = 0x04
    LABEL = 0x0A


def checksum(record: bytes) -> int:
    """
    Return the 16-bit CRC of a record.

    Its polynomial is 0x1021, and its initial value is 0xFFFF. Each byte enters at the low end. In
    the usual CCITT variant, bytes enter at the high end, so that variant is two bytes ahead.
    """
    return binascii.crc_hqx(b'\xff\xff' + record[:-2], 0) ^ int.from_bytes(record[-2:], 'big')


P3 = Framing(
    begin=0x8E,
    end=0x8F,
    escape=0x8D,
    shift=0x20,
    head=b'\x02\0\0\0\0\0\0',  # version, length, checksum, flags
    length_at=2,
    checksum=checksum,
    passing=0x0001,
    may_lack_checksum=True,
)


def read(record: Record) -> Event:
    """Return the passing in a record. Its time counts from 1970, by the decoder's clock."""
    number, transponder = record.number(Field.NUMBER, 4), record.number(Field.TRANSPONDER, 4)
    time_us = record.number(Field.RTC_TIME, 8)
    if number is None or transponder is None or time_us is None:
        return Refused('a passing lacks its number, transponder or time')
    named = _named(str(transponder), record.fields.get(Field.LABEL, b''))
    passing = of_device(time_us, number, named)
    return passing if record.checked else Unchecked(*passing)


def _named(number: str, label: bytes) -> str:
    """Return a transponder's number, followed by the label printed on it, if any."""
    printed = label.decode('latin-1').strip('\0 ')
    says_more = printed.isascii() and printed.isprintable() and printed not in ('', number)
    return f'{number} {printed}' if says_more else number
