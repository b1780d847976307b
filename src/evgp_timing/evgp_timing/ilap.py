# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The text format of I-Lap and AMBrc, with one line for each passing.

    SOH @ decoder (count) transponder seconds.milliseconds (hits strength ...) CR LF

A TAB precedes each item except SOH, @ and CR. Some devices do not send the items in brackets. The
format comes from public descriptions (see README.md). They disagree on the meaning of the count
and on what the checksum at the end covers, so this decoder uses neither.
"""

from __future__ import annotations

import re

from evgp_timing.passings import Event, Passing, Refused, Sign

_PASSING = re.compile(
    rb'@\t\d+\t(?:\d+\t)?(?P<transponder>\d{1,10})\t(?P<seconds>\d{1,10})\.(?P<fraction>\d{1,6})'
    rb'(?:\t(?P<hits>\d{1,5})\t(?P<strength>\d{1,5}))?(?:\t[ -~\t]*)?\r?'
)


def read(line: bytes) -> Event:
    """Return the event in a line. Its time counts from the start of the device."""
    if not line.startswith(b'@'):
        return Sign()
    match = _PASSING.fullmatch(line)
    if match is None:
        return Refused('a line is not as expected')
    return Passing(
        time_us=int(match['seconds']) * 1_000_000 + int(match['fraction'].ljust(6, b'0')),
        transponder=match['transponder'].decode(),
        hits=min(int(match['hits'] or 0), 65535),
        strength=None if match['strength'] is None else float(match['strength']),
    )
