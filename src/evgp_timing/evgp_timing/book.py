# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The timekeeper's book: a file with all that changed what it knows, in the form of the record.

Each start of the timekeeper writes a stream of its own: `Began`, then every input of the desk
(``desk.Input``) in the order in which it came, and the results of a race when they change
(``Standings``). Whoever reads the streams of an event one after the other knows what the timekeeper
knew.
"""

from __future__ import annotations

from collections.abc import Iterator
import fcntl
import pathlib
import secrets
import sqlite3
import time
from typing import get_args, IO

from evgp_node.results import Standings
from evgp_node.stream import Began, Block, Gap, Stream
from evgp_timing import desk

PROGRAM = 'timekeeper'
"""Who writes these streams."""

SCHEMA_VERSION = 9
"""As in the record of race control."""

EVENT_LASTS_NS = 3 * 86_400 * 10**9
"""Time after which a race belongs to another event, whose heats may have the same names, in
nanoseconds."""

Entry = Began | desk.Input | Standings

STREAM: Stream[Entry] = Stream(get_args(Entry))

_SCHEMA = """
CREATE TABLE IF NOT EXISTS block ( -- the streams, one for each start of the timekeeper
    run INTEGER NOT NULL, -- counts them from 1
    number INTEGER NOT NULL, -- counts the blocks of a stream from 1, without a gap
    data BLOB NOT NULL, -- stream.Block
    PRIMARY KEY (run, number)
)
"""


class BookError(RuntimeError):
    """The file cannot be used; the text says why, and what would be right."""


class Book:
    """
    The file, and the stream that this program writes into it.

    :param path: made, with its folder, if there is none.
    :raises BookError: if it cannot be written, or another timekeeper has it.
    """

    def __init__(self, path: pathlib.Path) -> None:
        self._path = path
        self._entries = self._blocks = 0
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._claimed: IO[bytes] = path.open('ab')
            fcntl.flock(self._claimed, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise BookError(
                f'{path} is the file of another timekeeper that is running: end that one, or '
                'choose another file with the parameter book'
            ) from error
        except OSError as error:
            raise BookError(f'{path} cannot be written: {error.strerror}') from error
        try:
            self._database = self._open()
        except sqlite3.Error as error:
            raise BookError(
                f'{path} is no file of a timekeeper ({error}): move it away, or choose another '
                'one with the parameter book'
            ) from error

    def _open(self) -> sqlite3.Connection:
        database = sqlite3.connect(self._path, timeout=1.0, isolation_level=None)
        (version,) = database.execute('PRAGMA user_version').fetchone()
        if version not in (0, SCHEMA_VERSION):
            raise sqlite3.DatabaseError(f'its version is {version}, not {SCHEMA_VERSION}')
        database.execute('PRAGMA journal_mode = WAL')
        database.execute('PRAGMA synchronous = FULL')
        database.execute(_SCHEMA)
        database.execute(f'PRAGMA user_version = {SCHEMA_VERSION}')
        (last,) = database.execute('SELECT max(run) FROM block').fetchone()
        self._run = (last or 0) + 1
        return database

    def known(self) -> Iterator[desk.Input | Gap]:
        """Yield what the streams of this event have, the oldest first."""
        now = time.time_ns()
        for (run,) in self._database.execute('SELECT DISTINCT run FROM block').fetchall():
            query = 'SELECT number, data FROM block WHERE run = ? ORDER BY number'
            entries = STREAM.entries_of(self._database.execute(query, (run,)).fetchall())
            for number, entry in enumerate(entries):
                if isinstance(entry, Began):
                    if number == 0 and now - entry.wall_ns > EVENT_LASTS_NS:
                        break
                elif not isinstance(entry, Standings):
                    yield entry

    def write(self, *entries: Entry) -> None:
        """
        Write entries, in one transaction.

        :raises OSError: if the disk does not take it; nothing of it is written then.
        """
        new: list[Entry] = list(entries)
        if not self._entries:
            new.insert(0, Began(secrets.token_hex(8), PROGRAM, time.time_ns()))
        block = Block(self._entries, b''.join(map(STREAM.encode, new))).compressed()
        try:
            row = self._run, self._blocks + 1, block
            self._database.execute('INSERT INTO block VALUES (?, ?, ?)', row)
        except sqlite3.Error as error:
            raise OSError(f'{self._path} does not take it: {error}') from error
        self._entries += len(new)
        self._blocks += 1

    def close(self) -> None:
        """Let the file go."""
        self._database.close()
        self._claimed.close()
