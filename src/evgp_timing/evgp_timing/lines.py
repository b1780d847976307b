# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Formats with one line of text for each passing.

I-Lap and AMBrc send this line, with a TAB before each item except SOH, @ and CR:

    SOH @ decoder (count) transponder seconds.milliseconds (...) CR LF

Some devices do not send the items in brackets. The format comes from public descriptions (see
README.md). They disagree on the meaning of the count and on what the checksum at the end covers,
so this decoder uses neither. The time counts from the start of the device.

Home-made timers, such as a microcontroller or a script, send this line:

    $transponder,seconds LF

The transponder consists of up to 32 printable ASCII characters, without ``$``, comma or space. It
is empty if the timer does not know who crossed. The seconds are read from the timer's own clock,
with up to six decimal places. A line that contains only ``$`` is a sign of life.
"""

from __future__ import annotations

from collections.abc import Callable
import re

from evgp_timing.passings import Event, of_device, Refused, Sign


def _reader(passing: bytes, sign: bytes) -> Callable[[bytes], Event]:
    """Return a function that returns the event in a line, by the patterns of both kinds."""

    def read(line: bytes) -> Event:
        if re.fullmatch(sign, line, re.DOTALL):
            return Sign()
        match = re.fullmatch(passing, line)
        if match is None:
            return Refused('a line is not as expected')
        seconds, fraction = int(match['seconds']), (match['fraction'] or b'').ljust(6, b'0')
        return of_device(
            time_us=seconds * 1_000_000 + int(fraction), transponder=match['transponder'].decode()
        )

    return read


read_ilap = _reader(
    rb'@\t\d+\t(?:\d+\t)?(?P<transponder>\d{1,10})\t(?P<seconds>\d{1,10})\.(?P<fraction>\d{1,6})'
    rb'(?:\t[ -~\t]*)?\r?',
    sign=rb'(?!@).*',
)

read_ours = _reader(
    rb'(?P<transponder>[!-+\--~]{0,32}),(?P<seconds>\d{1,10})(?:\.(?P<fraction>\d{1,6}))?\r?',
    sign=rb'\r?',
)
