# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The protocol of ImmersionRC LapRF, over USB or TCP.

LapRF tells karts apart by the frequencies of their video transmitters.

The format comes from public descriptions and captures, not from ImmersionRC (see README.md).
"""

from __future__ import annotations

import enum

from evgp_timing.framing import Framing, Record
from evgp_timing.passings import Event, of_device, Refused


class Field(enum.IntEnum):
    """The fields of a passing that this module uses."""

    SLOT = 0x01
    RTC_TIME = 0x02
    NUMBER = 0x21


def checksum(record: bytes) -> int:
    """Return the 16-bit CRC known as ARC (polynomial 0x8005, reflected, initial value 0)."""
    crc = 0
    for byte in record:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


LAPRF = Framing(
    begin=0x5A,
    end=0x5B,
    escape=0x5C,
    shift=0x40,
    head=b'\0\0\0\0',  # length, checksum
    length_at=1,
    checksum=checksum,
    passing=0xDA09,
)


def read(record: Record) -> Event:
    """Return the passing in a record. Its time counts from the start of the device."""
    number, slot = record.number(Field.NUMBER, 4), record.number(Field.SLOT, 1)
    time_us = record.number(Field.RTC_TIME, 8)
    if number is None or slot is None or time_us is None:
        return Refused('a passing lacks its number, slot or time')
    return of_device(time_us, number, str(slot))
