# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The results that the timekeeper wrote into its book, for the report and the tables."""

from __future__ import annotations

from collections.abc import Mapping
import contextlib
import pathlib
import sqlite3
from typing import TypeAlias

from evgp_node.results import Standings
from evgp_node.stream import Gap, Stream
from evgp_rcs.record.store import open_read_only

BOOK = 'timing.sqlite3'
"""The name of the timekeeper's book, beside the record."""

Timing: TypeAlias = Mapping[tuple[str, int], Standings]
"""The last results of each race, by the id of the run and the number of the race in it."""

_STREAM: Stream[Standings] = Stream([Standings])


def timing_of(record: pathlib.Path) -> Timing:
    """Return what the book beside a record has; nothing, if there is none or it is damaged."""
    found: dict[tuple[str, int], Standings] = {}
    with (
        contextlib.suppress(FileNotFoundError, sqlite3.Error),
        contextlib.closing(open_read_only(record.with_name(BOOK))) as database,
    ):
        for (run,) in database.execute('SELECT DISTINCT run FROM block ORDER BY run').fetchall():
            query = 'SELECT number, data FROM block WHERE run = ? ORDER BY number'
            blocks = database.execute(query, (run,)).fetchall()
            for entry in _STREAM.entries_of(blocks, only=Standings):
                if not isinstance(entry, Gap):
                    found[entry.run, entry.race] = entry
    return found
