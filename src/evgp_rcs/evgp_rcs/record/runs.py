# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads the runs in a record and their streams, also what is left of a damaged one."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import dataclasses
import os
import pathlib
import sqlite3
import sys

from evgp_node.stream import Block, DamagedError, Gap
from evgp_node.stream_file import blocks_of, check_version, open_for_reading, OtherFileError
from evgp_rcs.record.plain import plain
from evgp_rcs.record.store import is_being_written, Session, sessions
from evgp_rcs.rules.inputs import entries_of, Entry
from evgp_rcs.rules.race import StampedEvent

DONE, FAILED, UNREADABLE, PARTLY = range(4)
"""Exit codes, which the help of ``rcs_record`` explains."""

NIGHT_NS = 6 * 3600 * 10**9
"""Minimum time without race control that separates two days of an event, in nanoseconds. (Dates
would depend on the reader's time zone.)"""

LEAST_OF_BLOCK = 32
"""Minimum size of a block in the file, in bytes."""


class UnreadableError(RuntimeError):
    """The record, the run or the part of it cannot be read. The text says why, and what to do."""


CALLED = os.environ.get('EVGP_CALLED', 'rcs_record')
"""Name of this program, which differs in the package for officials."""


def say(text: str) -> None:
    """Print a message to stderr."""
    print(f'{CALLED}: {plain(text)}', file=sys.stderr)


def put(text: str, output: pathlib.Path | None, what: str) -> int:
    """
    Print a text, or write it into a file and print a summary.

    :return: `DONE` or `FAILED`.
    """
    if output is None:
        print(text, end='')
        return DONE
    try:
        if output.is_file() and _is_database(output):
            say(f'{output} is a database, such as a record. Give another name after -o')
            return FAILED
        with output.open('w', encoding='utf-8', errors='replace', newline='') as stream:
            stream.write(text)
    except OSError as error:
        say(f'{output} cannot be written: {error.strerror}')
        return FAILED
    print(f'{plain(str(output))}: {what}')
    return DONE


def _is_database(file: pathlib.Path) -> bool:
    with file.open('rb') as stream:
        return stream.read(15) == b'SQLite format 3'


@dataclasses.dataclass(frozen=True)
class Kept:
    """The stream of a run, as read from the record."""

    run: Session
    blocks: list[tuple[int, bytes]]

    def entries(self) -> Iterator[Entry | Gap]:
        return entries_of(self.blocks)

    def lines(self) -> Iterator[bytes]:
        """Yield the raw text of each block, with one line for each entry."""
        for _, data in self.blocks:
            with contextlib.suppress(DamagedError):
                yield Block.of(data).data

    def events(self) -> Iterator[StampedEvent | Gap]:
        for entry in entries_of(self.blocks, only=(StampedEvent,)):
            assert isinstance(entry, StampedEvent | Gap)
            yield entry


@dataclasses.dataclass
class Runs:
    """
    A record that is open for reading, with its runs, oldest first.

    :param damage: what is wrong with the file; empty if nothing is.
    """

    file: pathlib.Path
    database: sqlite3.Connection
    listed: list[Session]
    damage: str = ''

    @property
    def code(self) -> int:
        """Return the exit code: `PARTLY` if the record is damaged, otherwise `DONE`."""
        return PARTLY if self.damage else DONE

    def choose(self, number: int | None) -> Session:
        """
        Return the run with this number, or the newest.

        :raises UnreadableError: if there is no such run.
        """
        for run in reversed(self.listed):
            if number in (None, run.number):
                return run
        known = ', '.join(str(each.number) for each in self.listed)
        what = f'no run {number}; it has {known}' if self.listed else 'no run yet'
        raise UnreadableError(f'{self.file} has {what}')

    def day_of(self, run: Session) -> list[Session]:
        """Return the runs of the same day as this one, oldest first (`NIGHT_NS`)."""
        day: list[Session] = []
        for each in self.listed:
            if day and each.began_ns - max(day[-1].began_ns, day[-1].last_ns) > NIGHT_NS:
                if run in day:
                    break
                day = []
            day.append(each)
        return day

    def read(self, run: Session) -> Kept:
        return Kept(run, list(blocks_of(self.database, run.number)))


@contextlib.contextmanager
def open_runs(file: pathlib.Path) -> Iterator[Runs]:
    """
    Open a record for reading, even while race control is writing it.

    If SQLite cannot read the whole file, the runs consist of the blocks that it can read, and a
    message says so at the end.

    Close it before anything slow. Until then, part of what race control writes may have to stay in
    SQLite's ``-wal`` beside the record.

    :raises UnreadableError: if the record cannot be read, now or later.
    """
    damage = ''
    try:
        _check_file(file)
        with contextlib.ExitStack() as stack:
            database = stack.enter_context(contextlib.closing(open_for_reading(file)))
            damage = _damage(file, database)
            if damage:
                database.execute('PRAGMA writable_schema = ON')  # reads a file that was cut off
            _check_schema(file, database)
            if damage:
                database = stack.enter_context(contextlib.closing(_what_is_left(file, database)))
            listed = [*sessions(database)]
            if damage and not listed:
                raise UnreadableError(f'{file} is damaged ({damage}), and {_NOTHING_LEFT}')
            if listed and is_being_written(file):  # only the newest run
                listed[-1] = dataclasses.replace(listed[-1], goes_on=True)
            yield Runs(file, database, listed, damage)
    except sqlite3.Error as error:
        raise UnreadableError(f'{file} {_why_unreadable(error)}') from error
    except OSError as error:
        raise UnreadableError(f'{file} cannot be read: {error.strerror or error}') from error
    if damage:
        say(f'{file} is damaged ({damage}); this is what can still be read')


def _damage(file: pathlib.Path, database: sqlite3.Connection) -> str:
    """
    Return why SQLite cannot read the whole file; empty if it can.

    :raises sqlite3.Error: if the reason is not damage.
    """
    try:
        (page,) = database.execute('PRAGMA page_size').fetchone()
        if file.stat().st_size % page:
            return 'it was cut off'
        (found,) = database.execute('PRAGMA quick_check(1)').fetchone()
    except sqlite3.DatabaseError as error:
        if not _is_damage(error):
            raise
        return str(error)
    return '' if found == 'ok' else str(found).replace('\n', ' ')


def _what_is_left(file: pathlib.Path, damaged: sqlite3.Connection) -> sqlite3.Connection:
    """Return the blocks of a damaged record that can be read."""
    left = sqlite3.connect(':memory:')
    left.execute('CREATE TABLE block (run, number, data, PRIMARY KEY (run, number))')
    query = 'SELECT run, number, data FROM block NOT INDEXED WHERE rowid = ?'
    # One by one: damage in one page ends every search that goes on from row to row.
    for row in range(1, file.stat().st_size // LEAST_OF_BLOCK):
        with contextlib.suppress(sqlite3.DatabaseError):
            found = damaged.execute(query, (row,))
            left.executemany('INSERT OR IGNORE INTO block VALUES (?, ?, ?)', found)
    return left


def _check_file(file: pathlib.Path) -> None:
    """Refuse files on which SQLite would block, or about which its errors would be unclear."""
    if not file.exists():
        raise UnreadableError(
            f'there is no {file}. Give the file that is set as race control\'s parameter "record"'
        )
    if not file.is_file():
        raise UnreadableError(f'{file} is not a record, because it is not a file')
    if not file.stat().st_size:
        raise UnreadableError(f'{file} is empty: race control has not written anything into it')


def _check_schema(file: pathlib.Path, database: sqlite3.Connection) -> None:
    tables = {name for (name,) in database.execute('SELECT name FROM sqlite_master')}
    if 'memory' not in tables:
        raise UnreadableError(f'{file} is not a record of race control, but another database')
    try:
        check_version(database)
    except OtherFileError as error:
        raise UnreadableError(
            f'{file} is not a record that this version can read ({error}). Another version of '
            'race control wrote it'
        ) from error


_NOTHING_LEFT = 'nothing in it can be read'
_NO_DATABASE = 'file is not a database'
_READ_ONLY = (
    'cannot be opened. If you may not write in its folder, copy the file into a folder of yours, '
    'together with the files whose names begin the same'
)
_WHY_UNREADABLE = {
    _NO_DATABASE: 'is not a record: it is not a database, or its beginning is damaged',
    'database is locked': 'cannot be read now, because another program has locked it. Try again '
    'later',
    'unable to open database file': _READ_ONLY,
    'attempt to write a readonly database': _READ_ONLY,
}
"""What to say for each of SQLite's messages, which are the only way to tell its errors apart
before Python 3.11."""


def _is_damage(error: sqlite3.Error) -> bool:
    # SQLite's operational errors concern the query or the moment, not the file.
    if isinstance(error, sqlite3.OperationalError):
        return str(error) == 'disk I/O error'
    return str(error) != _NO_DATABASE


def _why_unreadable(error: sqlite3.Error) -> str:
    otherwise = 'is not a record of this race control'
    if _is_damage(error):
        otherwise = f'is damaged, and {_NOTHING_LEFT}'
    return _WHY_UNREADABLE.get(str(error), f'{otherwise}: {error}')
