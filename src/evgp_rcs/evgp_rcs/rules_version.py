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

"""Which rules a race control has: what must be equal for a replay to come out equal."""

from __future__ import annotations

import hashlib
import pathlib

from evgp_protocol import states
from evgp_rcs import catalogue, race

RULES = (race, catalogue, states)
"""The modules that hold the rules."""


def rules_version() -> str:
    """Return 16 hexadecimal digits of the sources of the rules; empty if these are not there."""
    try:
        texts = [pathlib.Path(str(module.__file__)).read_bytes() for module in RULES]
    except OSError:
        return ''
    return hashlib.sha256(b'\0'.join(texts)).hexdigest()[:16]
