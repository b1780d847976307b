# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The kinds of timing devices. A new kind needs a row here and a decoder."""

from __future__ import annotations

from collections.abc import Callable

from evgp_timing import ilap, laprf, lines, p3
from evgp_timing.framing import MarkedDecoder

CONTACT = 'contact'
"""The only kind without a decoder: a control line of a serial port."""

DECODERS: dict[str, Callable[[], MarkedDecoder]] = {
    'ilap': ilap.decoder,
    'laprf': laprf.decoder,
    'lines': lines.decoder,
    'p3': p3.decoder,
}
"""For each kind of device, the function that makes a decoder for one connection."""
