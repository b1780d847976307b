# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads results and corrections from the timekeeper's book, for the report and the tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
import contextlib
import pathlib
import sqlite3
from typing import NamedTuple

from evgp_node.results import Act, Corrected, Standings
from evgp_node.roster import Format
from evgp_node.stream import Gap, Stream
from evgp_node.stream_file import blocks_of, BOOK, check_version, open_for_reading, runs_of
from evgp_rcs.record.runs import say
from evgp_rcs.record.store import Session

_STREAM: Stream[Standings | Corrected] = Stream([Standings, Corrected])


class Timing(NamedTuple):
    """
    The timekeeper's data, by the id of the run and the number of the race in that run.

    :param results: the last results of each race with karts, the last written last.
    :param corrections: the corrections of each race, in order, except laps counted by hand.
    """

    results: dict[tuple[str, int], Standings]
    corrections: dict[tuple[str, int], list[Corrected]]

    def overall(self, day: Iterable[Session]) -> dict[Format, Standings]:
        """
        Return the results with the newest standings over all heats of each format in some runs.

        They may be a correction of a race in an earlier run.
        """
        ids = {run.id for run in day}
        return {each.format: each for (run, _), each in self.results.items() if run in ids}


def entries(path: pathlib.Path) -> Iterator[tuple[int, Standings | Corrected | Gap]]:
    """
    Yield the results and corrections in a book, each with the number of its stream.

    :raises OSError, sqlite3.Error: if the book cannot be read.
    """
    with contextlib.closing(open_for_reading(path)) as database:
        check_version(database)
        for run in runs_of(database):
            for entry in _STREAM.entries_of(blocks_of(database, run), (Standings, Corrected)):
                yield run, entry


def timing_of(record: pathlib.Path) -> Timing:
    """Return the contents of the book beside a record and report what cannot be read."""
    found = Timing({}, {})
    path = record.with_name(BOOK)
    try:
        for run, entry in entries(path):
            if isinstance(entry, Gap):
                say(f'{path}, stream {run}: {entry}; results may be missing')
            elif isinstance(entry, Standings):
                found.results.pop((entry.run, entry.race), None)
                if entry.karts:
                    found.results[entry.run, entry.race] = entry
            elif entry.correction.act is not Act.COUNT:
                found.corrections.setdefault((entry.run, entry.race), []).append(entry)
    except FileNotFoundError:
        say(f'there is no {path}. Without timing, there is only the order of FINISH')
    except (OSError, sqlite3.Error) as error:
        say(f"{path} cannot be read ({error}), so the timekeeper's results are missing")
    return found
