# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The SQLite files that contain streams: race control's record and the timekeeper's book."""

from __future__ import annotations

from collections.abc import Iterator
import os
import pathlib
import sqlite3
from typing import Any

SCHEMA_VERSION = 13
"""The ``user_version`` of these files."""

BOOK = 'timing.sqlite3'
"""File name of the timekeeper's book. It is in the same folder as the record."""

_BLOCKS = """
CREATE TABLE block ( -- the streams
    run INTEGER NOT NULL, -- counts the streams of this file from 1
    number INTEGER NOT NULL, -- counts the blocks of a stream from 1, without a gap
    data BLOB NOT NULL, -- stream.Block
    PRIMARY KEY (run, number)
)
"""


WRITE_BLOCK = 'INSERT OR REPLACE INTO block VALUES (?, ?, ?)'
"""Statement that writes a block. A disk that reports a failure may have written the block anyway:
the next attempt then replaces it."""


class OtherFileError(sqlite3.DatabaseError):
    """The file belongs to another program, or to another version. The text says which one."""


class _Database(sqlite3.Connection):
    """A connection whose every error is SQLite's."""

    def execute(self, *given: Any) -> sqlite3.Cursor:
        try:
            return super().execute(*given)
        except UnicodeDecodeError as error:  # SQLite's message contains the garbled name
            raise sqlite3.DatabaseError('its schema is garbled') from error


def _connect(database: str | pathlib.Path, **more: Any) -> sqlite3.Connection:
    return sqlite3.connect(database, timeout=1.0, factory=_Database, **more)


def check_version(database: sqlite3.Connection) -> None:
    """
    Check that a database has the version of these files.

    :raises OtherFileError: if it has another one, as the files of other programs do.
    """
    (version,) = database.execute('PRAGMA user_version').fetchone()
    if version != SCHEMA_VERSION:
        raise OtherFileError(f'its version is {version}, not {SCHEMA_VERSION}')


def open_for_writing(path: pathlib.Path, *tables: str) -> tuple[sqlite3.Connection, int]:
    """
    Open a file for writing, and return it with the number of the next stream.

    If it is new, its tables are created. A transaction that has ended survives a power failure.

    :param tables: the statements that create further tables.
    :raises OtherFileError: if it is not such a file. It is not changed.
    :raises sqlite3.Error: if it cannot be written.
    """
    # The timekeeper opens its book in one thread, and writes into it in another.
    database = _connect(path, isolation_level=None, check_same_thread=False)
    try:
        (found,) = database.execute('SELECT count(*) FROM sqlite_master').fetchone()
        (version,) = database.execute('PRAGMA user_version').fetchone()
        is_new = not (found or version)
        if not is_new:
            check_version(database)
        database.execute('PRAGMA journal_mode = WAL')
        database.execute('PRAGMA synchronous = FULL')
        if is_new:
            with database:
                database.execute('BEGIN IMMEDIATE')
                for statement in (_BLOCKS, *tables):
                    database.execute(statement)
                database.execute(f'PRAGMA user_version = {SCHEMA_VERSION}')
        (last,) = database.execute('SELECT max(run) FROM block').fetchone()
    except sqlite3.Error:
        database.close()
        raise
    return database, (last or 0) + 1


def connection(path: pathlib.Path, how: str) -> sqlite3.Connection:
    return _connect(f'{path.absolute().as_uri()}?{how}', uri=True)


def open_for_reading(path: pathlib.Path) -> sqlite3.Connection:
    """
    Open a file for reading, even while its program is writing it.

    :raises FileNotFoundError: if there is no such file.
    :raises sqlite3.Error: if it cannot be read.
    """
    if not path.exists():
        raise FileNotFoundError(f'there is no {path}')
    # Beside a file that may change, SQLite needs files of its own, which it may not create here.
    is_final = not (path.with_name(f'{path.name}-wal').exists() or os.access(path.parent, os.W_OK))
    database = connection(path, 'immutable=1' if is_final else 'mode=ro')
    database.text_factory = lambda text: text.decode(errors='replace')
    return database


def runs_of(database: sqlite3.Connection) -> list[int]:
    """
    Return the numbers of the streams, oldest first.

    :raises sqlite3.DatabaseError: if the file is damaged.
    """
    found = database.execute('SELECT DISTINCT run FROM block ORDER BY run')
    return [number for (number,) in found.fetchall()]


def blocks_of(
    database: sqlite3.Connection, run: int, backwards: bool = False
) -> Iterator[tuple[int, bytes]]:
    """
    Yield the blocks of a stream, compressed, each with its number.

    :raises sqlite3.DatabaseError: if the file is damaged.
    """
    order = 'DESC' if backwards else 'ASC'
    query = f'SELECT number, data FROM block WHERE run = ? ORDER BY number {order}'  # noqa: S608
    yield from database.execute(query, (run,))
