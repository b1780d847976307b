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

"""The kinds of timing devices: a new one is a row here, and its decoder."""

from __future__ import annotations

from collections.abc import Callable

from evgp_timing import ilap, laprf, lines, p3
from evgp_timing.passings import Decoder

CONTACT = 'contact'
"""The one kind that has no decoder: a control line of a serial port."""

DECODERS: dict[str, Callable[[], Decoder]] = {
    'ilap': ilap.decoder,
    'laprf': laprf.decoder,
    'lines': lines.decoder,
    'p3': p3.decoder,
}
"""What makes a decoder for one connection, by the kind of the device."""
