# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What the next run of race control would find in a record."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import pathlib
import time

from evgp_node.encoding import read
from evgp_rcs.record.store import open_read_only
from evgp_rcs.rules.race import RaceMemory


def wait_for_memory(record: pathlib.Path, found: Callable[[RaceMemory], bool]) -> None:
    """Return once a record has such a memory of the race."""
    with contextlib.closing(open_read_only(record)) as database:
        until = time.monotonic() + 20.0
        while True:
            query = 'SELECT data FROM memory ORDER BY run DESC LIMIT 1'
            for (memory,) in database.execute(query):
                if found(read(RaceMemory, memory)):
                    return
            assert time.monotonic() < until
            time.sleep(0.01)  # a disk has no event to await
