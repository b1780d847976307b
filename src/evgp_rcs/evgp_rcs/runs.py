# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The runs in a record: which one is asked for, what of it can be read, and why not the rest."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator
import contextlib
from dataclasses import dataclass
import datetime
import functools
import os
import pathlib
import sqlite3
import sys
from typing import TypeVar

from evgp_rcs.plain import plain
from evgp_rcs.race import EventKind
from evgp_rcs.record import (
    default_path,
    events,
    inputs_of,
    is_being_written,
    open_read_only,
    RecordedEvent,
    SCHEMA_VERSION,
    Session,
    sessions,
)

DONE = 0
"""Exit code: done."""

FAILED = 1
"""Exit code: what was asked for cannot be written; or a replay has found a difference."""

UNREADABLE = 2
"""Exit code: the record or the run cannot be read, or the usage is wrong."""

PARTLY = 3
"""Exit code: done, with what can be read of a damaged record."""

ENDED = EventKind.ENDED.name
"""Kind of the event that says that a run ends; in good order, if it is a success."""

_Row = TypeVar('_Row')


class UnreadableError(RuntimeError):
    """The record, or the run in it, cannot be read; the text says why and what would be right."""


CALLED = os.environ.get('EVGP_CALLED', 'rcs_record')
"""How this program was called: the package for officials has another name for it."""


def say(text: str) -> None:
    """Say something about the work, apart from what it prints."""
    print(f'{CALLED}: {plain(text)}', file=sys.stderr)


def watched(items: Iterable[_Row], total: int, what: str) -> Iterable[_Row]:
    """Return the items; a terminal shows meanwhile how many of about so many are done."""
    if not sys.stderr.isatty():
        return items
    from rich.console import Console  # loads in 0.1 s, and most never need it
    from rich.progress import track

    return track(items, what, total, console=Console(stderr=True), transient=True)


@dataclass
class Runs:
    """
    A record that is open to be read.

    :param listed: every run, oldest first.
    :param present: the run that race control is writing now.
    :param damage: why not all can be read that was asked for; empty: nothing is missing so far.
    """

    file: pathlib.Path
    database: sqlite3.Connection
    listed: list[Session]
    present: Session | None
    damage: str = ''

    @property
    def code(self) -> int:
        """Return the exit code of work that was done with what could be read."""
        return PARTLY if self.damage else DONE

    def choose(self, number: int | None) -> Session:
        """
        Return the run of this number, or the newest.

        :raises UnreadableError: if there is none.
        """
        for run in reversed(self.listed):
            if number in (None, run.number):
                return run
        known = ', '.join(str(each.number) for each in self.listed)
        what = f'no run {number}; it has {known}' if self.listed else 'no run yet'
        raise UnreadableError(f'{self.file} has {what}')

    def day_of(self, run: Session) -> list[Session]:
        """Return the runs that began on the same day, oldest first, this one too."""
        return [each for each in self.listed if _day(each) == _day(run)]

    def events(self, run: Session) -> list[RecordedEvent]:
        """Return the events of a run that can be read, in order."""

        def read(after: int, backwards: bool) -> Iterable[RecordedEvent]:
            rows = events(self.database, run.number, after, backwards)
            return watched(rows, run.events, 'Reading the events')

        return self._readable(read, lambda event: event.sequence)

    def inputs(self, run: Session) -> list[tuple[int, bytes]]:
        """Return what went into the rules, as far as it can be read."""
        read = functools.partial(inputs_of, self.database, run.number)
        return self._readable(read, lambda block: block[0])

    def setup(self, run: Session) -> tuple[str, str]:
        """Return the version of the rules of a run, and with what they began; empty: not there."""
        try:
            found = self.database.execute(
                'SELECT rules, setup FROM session WHERE id = ?', (run.number,)
            )
            rules, setup = found.fetchone() or ('', '')
        except sqlite3.DatabaseError as error:
            self._note(error)
            return '', ''
        return str(rules or ''), str(setup or '')

    def _readable(
        self, read: Callable[[int, bool], Iterable[_Row]], number: Callable[[_Row], int]
    ) -> list[_Row]:
        """Return rows up to where the record is damaged, and those behind it."""
        found: list[_Row] = []
        try:
            found.extend(read(0, False))
        except sqlite3.DatabaseError as error:
            self._note(error)
            behind: list[_Row] = []
            with contextlib.suppress(sqlite3.DatabaseError):
                behind.extend(read(number(found[-1]) if found else 0, True))
            found += reversed(behind)
        return found

    def _note(self, error: sqlite3.DatabaseError) -> None:
        """
        Take note of damage.

        :raises sqlite3.DatabaseError: if the error is none.
        """
        if not _is_damage(error):
            raise error
        self.damage = self.damage or str(error)

    def _list(self) -> None:
        """
        Find the runs.

        :raises sqlite3.DatabaseError: if none can be found.
        """
        try:
            self.listed = sessions(self.database)
        except sqlite3.DatabaseError as error:
            self._note(error)
            self.listed = list(self._list_damaged())
            if not self.listed:
                raise

    def _list_damaged(self) -> Iterator[Session]:
        """Yield the runs, each with the events that can be read; or those that events name."""
        known: dict[int, int] = {}
        with contextlib.suppress(sqlite3.DatabaseError):
            for number, began_ns in self.database.execute('SELECT id, began_ns FROM session'):
                known[number] = began_ns if isinstance(began_ns, int) else 0
        with contextlib.suppress(sqlite3.DatabaseError):
            number = 0
            while number is not None:
                (number,) = self.database.execute(
                    'SELECT min(session) FROM event WHERE session > ?', (number,)
                ).fetchone()
                if number is not None:
                    known.setdefault(number, 0)
        for number, began_ns in sorted(known.items()):
            found = self.events(Session(number, began_ns, None, 0))
            began_ns = began_ns or (found[0].wall_ns if found else 0)
            ends = (each.wall_ns for each in found if each.kind == ENDED and each.success)
            yield Session(number, began_ns, next(ends, None), len(found))


def _day(run: Session) -> datetime.date:
    return datetime.datetime.fromtimestamp(run.began_ns / 1e9).date()


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    """Let a parser take `file` and `--run`."""
    parser.add_argument(
        'file',
        nargs='?',
        type=pathlib.Path,
        default=default_path(),
        help='the record, if it is not %(default)s',
    )
    parser.add_argument(
        '--run',
        type=int,
        metavar='NUMBER',
        help="this run, by its number in '--list'; otherwise the newest",
    )


@contextlib.contextmanager
def open_runs(file: pathlib.Path) -> Iterator[Runs]:
    """
    Open a record to read it, also while race control writes it.

    What is damaged is read as far as it can be, and said at the end.

    :raises UnreadableError: if it cannot be read, also later.
    """
    try:
        _check_file(file)
        with contextlib.closing(open_read_only(file)) as database:
            # Without this, SQLite reads nothing of a file that was cut off.
            database.execute('PRAGMA writable_schema = ON')
            _check_schema(file, database)
            runs = Runs(file, database, [], None, _cut_off(file, database))
            runs._list()
            # Race control writes the newest run only.
            if runs.listed and is_being_written(file):
                runs.present = runs.listed[-1]
            yield runs
    except sqlite3.Error as error:
        raise UnreadableError(f'{file} {_why_unreadable(error)}') from error
    except OSError as error:
        raise UnreadableError(f'{file} cannot be read: {error.strerror or error}') from error
    if runs.damage:
        say(f'{file} is damaged ({runs.damage}): this is what can be read of it')


def _check_file(file: pathlib.Path) -> None:
    """Refuse what SQLite would wait for, or has no plain words for."""
    if not file.exists():
        raise UnreadableError(
            f'there is no {file}. Name the file that the parameter "record" of race control names'
        )
    if not file.is_file():
        raise UnreadableError(f'{file} is no record: it is not a file')
    if not file.stat().st_size:
        raise UnreadableError(f'{file} is empty: race control has not written anything into it')


def _check_schema(file: pathlib.Path, database: sqlite3.Connection) -> None:
    (version,) = database.execute('PRAGMA user_version').fetchone()
    tables = {name for (name,) in database.execute('SELECT name FROM sqlite_master')}
    if not version or not {'session', 'event'} <= tables:
        raise UnreadableError(f'{file} is no record of race control, but another database')
    if version != SCHEMA_VERSION:
        raise UnreadableError(
            f'{file} is no record that this version can read (its version is {version}, not '
            f'{SCHEMA_VERSION}). Another version of race control has written it'
        )


def _cut_off(file: pathlib.Path, database: sqlite3.Connection) -> str:
    """Return that the file ends within a page, the rest of which SQLite takes for zeros."""
    (page,) = database.execute('PRAGMA page_size').fetchone()
    return 'it was cut off' if file.stat().st_size % page else ''


_NO_DATABASE = 'file is not a database'
_WHY_UNREADABLE = {
    _NO_DATABASE: 'is no record: it is not a database, or its beginning is damaged',
    'database is locked': 'cannot be read now: another program has locked it. Try again when that '
    'is done',
    'unable to open database file': 'cannot be opened. If its folder cannot be written, copy the '
    'file into one that can, with those beside it whose names begin alike',
}
"""By sentences of SQLite's, which before Python 3.11 are all that tells its errors apart."""


def _is_damage(error: sqlite3.Error) -> bool:
    # What SQLite calls an operational error concerns the query or the moment, not the file.
    if isinstance(error, sqlite3.OperationalError):
        return str(error) == 'disk I/O error'
    return str(error) != _NO_DATABASE


def _why_unreadable(error: sqlite3.Error) -> str:
    otherwise = 'is no record of this race control'
    if _is_damage(error):
        otherwise = 'is damaged, and nothing of it can be read'
    return _WHY_UNREADABLE.get(str(error), f'{otherwise}: {error}')
