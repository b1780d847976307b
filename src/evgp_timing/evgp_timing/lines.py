# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A format of plain text lines for home-made timers, such as a microcontroller or a script.

    $transponder,seconds LF

The transponder consists of up to 32 printable ASCII characters, without ``$``, comma or space. It
is empty if the timer does not know who crossed. The seconds are read from the timer's own clock,
with up to six decimal places. A line that contains only ``$`` is a sign of life.
"""

from __future__ import annotations

import re

from evgp_timing.passings import Event, Passing, Refused, Sign

_PASSING = re.compile(
    rb'(?P<transponder>[!-+\--~]{0,32}),(?P<seconds>\d{1,10})(?:\.(?P<fraction>\d{1,6}))?\r?'
)


def read(line: bytes) -> Event:
    """Return the event in a line. Its time is by the timer's clock."""
    if line in (b'', b'\r'):
        return Sign()
    match = _PASSING.fullmatch(line)
    if match is None:
        return Refused('a line is not as expected')
    fraction = (match['fraction'] or b'').ljust(6, b'0')
    return Passing(
        time_us=int(match['seconds']) * 1_000_000 + int(fraction),
        transponder=match['transponder'].decode(),
    )
