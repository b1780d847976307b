# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The kinds of timing devices. A new kind needs a row here and a decoder."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from evgp_timing import laprf, lines, p3
from evgp_timing.framing import MarkedDecoder

CONTACT = 'contact'
"""The only kind without a decoder: the line CTS of a serial port."""

DECODERS: dict[str, Callable[[], MarkedDecoder]] = {
    'ilap': partial(MarkedDecoder, 0x01, 0x0A, lines.read_ilap),
    'laprf': partial(laprf.LAPRF.decoder, laprf.read),
    'lines': partial(MarkedDecoder, ord('$'), ord('\n'), lines.read_ours),
    'p3': partial(p3.P3.decoder, p3.read),
}
"""For each kind of device, the function that makes a decoder for one connection."""
