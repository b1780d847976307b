# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The timekeeper's book: the file of all its inputs, from which it restores the races.

The timekeeper begins a new stream, in the format of the record, at each start and every half day.
A stream begins with `Began`, which contains the machine's boot id. After that come the inputs
(``desk.Input``) in order of arrival, and the results of a race as they change (``Standings``).
"""

from __future__ import annotations

from collections.abc import Iterator
import fcntl
import pathlib
import sqlite3
import time
from typing import get_args, IO

from evgp_node.results import Standings
from evgp_node.stream import Began, Block, Gap, Stream
from evgp_node.stream_file import blocks_of, open_for_writing, runs_of, WRITE_BLOCK
from evgp_protocol import clock
from evgp_timing import desk

EVENT_LASTS_NS = 3 * 86_400 * 10**9
"""Age from which a stream belongs to an earlier event, in nanoseconds. The timekeeper does not
restore it, because the heats of that event may have the same names."""

STREAM_LASTS_NS = 12 * 3_600 * 10**9
"""Maximum age of a stream, in nanoseconds. Then the timekeeper begins a new one, because a race is
as old as its stream."""

Entry = Began | desk.Input | Standings

STREAM: Stream[Entry] = Stream(get_args(Entry))


class BookError(RuntimeError):
    """The book cannot be used. The text says why, and what to do."""


class Book:
    """
    The file, and the stream that this program writes into it.

    :param path: path of the file. The file and its folder are created if necessary.
    :raises BookError: if the file cannot be written, or another timekeeper is using it.
    """

    def __init__(self, path: pathlib.Path) -> None:
        self._path = path
        self._entries = self._blocks = self._began_ns = 0
        self._boot = pathlib.Path('/proc/sys/kernel/random/boot_id').read_text('ascii').strip()
        # What to add to the times of each start of the machine. The streams of one start share it,
        # so that their times agree to the nanosecond, whatever happened to the wall clock.
        self._moved = {self._boot: 0.0}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._claimed: IO[bytes] = path.open('ab')
        except OSError as error:
            raise BookError(f'{path} cannot be written: {error.strerror}') from error
        try:
            fcntl.flock(self._claimed, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._database, self._run = open_for_writing(path)
        except BlockingIOError as error:
            self._claimed.close()
            raise BookError(
                f'another running timekeeper is using {path}. End that timekeeper, or choose '
                'another file with the parameter book'
            ) from error
        except sqlite3.Error as error:
            self._claimed.close()
            raise self._unusable(error) from error

    def _unusable(self, error: sqlite3.Error) -> BookError:
        return BookError(
            f'{self._path} cannot be used as a timekeeper file ({error}). Move it away, or choose '
            'another file with the parameter book'
        )

    def known(self) -> Iterator[desk.Input | Gap]:
        """
        Yield the inputs and gaps of this event's streams, oldest first.

        The times of the inputs fit the current clock, even if the machine has restarted since.

        :raises BookError: if SQLite finds the file damaged.
        """
        try:
            for run in runs_of(self._database):
                yield from self._of_stream(blocks_of(self._database, run))
        except sqlite3.Error as error:
            raise self._unusable(error) from error

    def _of_stream(self, blocks: Iterator[tuple[int, bytes]]) -> Iterator[desk.Input | Gap]:
        now_ns = time.time_ns()
        began = Began(self._boot, now_ns)  # if the stream lacks its own
        for entry in STREAM.entries_of(blocks):
            if isinstance(entry, Began):
                if now_ns - entry.wall_ns > EVENT_LASTS_NS:
                    return
                began = entry
            elif isinstance(entry, Gap):
                yield entry
            else:
                if began.run not in self._moved:  # the machine's clock has begun again at 0
                    age = (now_ns - began.wall_ns) / 1e9
                    self._moved[began.run] = clock.now() - age - entry[0]
                if not isinstance(entry, Standings):
                    yield entry._replace(at=entry.at + self._moved[began.run])

    def write(self, *entries: Entry) -> None:
        """
        Write entries in one transaction: either all of them, or none.

        :raises OSError: if the entries cannot be written. Readers then find a gap.
        """
        new: list[Entry] = list(entries)
        now_ns = time.time_ns()
        if now_ns - self._began_ns > STREAM_LASTS_NS:
            self._run += self._blocks > 0
            self._entries = self._blocks = 0
        if not self._blocks:
            self._began_ns = now_ns
            new.insert(0, Began(self._boot, now_ns))
        block = Block(self._entries, b''.join(map(STREAM.encode, new))).compressed()
        try:
            row = self._run, self._blocks + 1, block
            self._database.execute(WRITE_BLOCK, row)
        except sqlite3.Error as error:
            self._entries += len(entries)
            raise OSError(f'{self._path} cannot be written: {error}') from error
        self._entries += len(new)
        self._blocks += 1

    def close(self) -> None:
        """Close the file, so that another timekeeper can use it."""
        self._database.close()
        self._claimed.close()
