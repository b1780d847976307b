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
