# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The record: every event of race control, and what a race must find again after a crash (§3.E).

It is written in a process of its own (``record_process``). Each batch of events is one
transaction of SQLite, together with what the race must remember, so that after a crash of the
process or of the machine both are there up to the same event, or neither is.

The same transaction has what went into the rules up to these events (``inputs``), so that a run
can be replayed up to its last event. Inputs without events are written every `INPUTS_EVERY`
seconds. When the disk does not take it, everything waits here and is tried again.

What the next run finds is `left_behind`: what this record knows of the last run, or nothing. How
that ended, no record can say: the mark of the machine does (``run_mark``). What a GREEN_GREEN
leaves behind is on the disk before it goes out; and, unless somebody reads the record just then,
in the file itself and not only in SQLite's ``-wal`` beside it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import contextlib
import dataclasses
import enum
import fcntl
import hashlib
import math
import pathlib
import sqlite3
import time
from typing import Any, IO

from evgp_protocol import clock, states
from evgp_rcs import catalogue, laps, race
from evgp_rcs.encoding import DAMAGED, read, reader, written
from evgp_rcs.folder import rcs_folder
from evgp_rcs.inputs import Block, joined, Setup
from evgp_rcs.race import Event, EventKind, RaceMemory, StampedEvent
from evgp_rcs.run_mark import claim

SCHEMA_VERSION = 8

INPUTS_EVERY = 1.0
"""Maximum time that inputs without events wait for others, in seconds. A disk that must confirm
every write has little to do then."""

RETRY = 1.0
"""Time after a failure until the next try, in seconds."""

_SCHEMA = """
CREATE TABLE session ( -- one run of race control
    id INTEGER PRIMARY KEY,
    began_ns INTEGER NOT NULL, -- wall time, ns since the epoch
    rules TEXT, -- their version: rules_version(); null: not recorded
    setup TEXT, -- with what the rules began: inputs.Setup, as encoding writes it
    memory TEXT -- what the next run must know: RaceMemory, likewise; null: nothing
);
CREATE TABLE event (
    session INTEGER NOT NULL REFERENCES session,
    sequence INTEGER NOT NULL, -- counts the events of a run from 1, without a gap
    wall_ns INTEGER NOT NULL, -- wall time, ns since the epoch
    monotonic REAL NOT NULL, -- the clock of the rules, s
    kind TEXT NOT NULL, -- a name of EventKind
    kart INTEGER NOT NULL, -- the number of the kart; 0: none
    command TEXT, -- the command, or that which caused it: a CommandKind
    success INTEGER NOT NULL, -- of a command, whether it was accepted
    state TEXT, -- a name of RaceState
    text TEXT NOT NULL, -- one sentence for the official
    official TEXT NOT NULL, -- who gave the command, by their own word; empty: unnamed
    alert TEXT, -- of an alert, a name of AlertKind
    hold TEXT, -- how the kart is held, of kart 0 every kart: a RaceState; null: not
    race INTEGER NOT NULL, -- the number of the race in the run; 0: none is under way
    heat TEXT NOT NULL, -- the heat in the race; empty: none
    after REAL NOT NULL, -- of DELIVERED, time from the order to the answer of the kart's kernel,
        -- of LAP, its time, s
    grade TEXT, -- of LINK_GRADE, a name of Grade
    lap INTEGER NOT NULL, -- of LAP, the number of the lap; else 0
    PRIMARY KEY (session, sequence)
) WITHOUT ROWID;
CREATE TABLE input (
    session INTEGER NOT NULL REFERENCES session,
    block INTEGER NOT NULL, -- counts the blocks of a run from 1, without a gap
    data BLOB NOT NULL, -- what went into the rules, in order: inputs.Block
    PRIMARY KEY (session, block)
);
"""


class RecordError(RuntimeError):
    """The record is in use by another race control, or cannot be relied on; no start with it."""


class _NoRecordError(RuntimeError):
    """The file is no record, or is damaged; the text says why and what would be right."""


@dataclasses.dataclass(frozen=True)
class Session:
    """
    One run of race control.

    :param ended_ns: the wall time of the event that says that it ended in good order; None: there
        is none.
    """

    number: int
    began_ns: int
    ended_ns: int | None
    events: int


def rules_version() -> str:
    """
    Return which rules these are: with equal ones, a replay comes out equal.

    16 hexadecimal digits of their sources; empty if these are not there.
    """
    try:
        texts = [
            pathlib.Path(str(each.__file__)).read_bytes()
            for each in (race, laps, catalogue, states)
        ]
    except OSError:
        return ''
    return hashlib.sha256(b'\0'.join(texts)).hexdigest()[:16]


def default_path() -> pathlib.Path:
    """Return where race control keeps its record if it is not told: below ROS_HOME."""
    return rcs_folder() / 'record.sqlite3'


class Record:
    """
    Writes the record of one run of race control.

    What is handed over waits in memory; ``write`` writes all of it. So whoever calls it decides
    when it waits for the disk.

    :param path: the file; made, with its folder, if there is none. If it cannot be written, or is
        no record, `error` says so, ``write`` tries it again, and nothing is known of the time
        before.
    :raises RecordError: if it is the record of another race control that is running.
    """

    def __init__(self, path: pathlib.Path) -> None:
        """Claim the file, and find what the last run left."""
        self._path = path
        self._events: list[StampedEvent] = []
        self._inputs: list[Block] = []
        self._inputs_since = 0.0
        self._blocks: list[bytes] = []  # compressed once, however often the disk fails
        self._blocks_written = 0
        self._rules: tuple[str, Setup] | None = None
        self._memory: RaceMemory | None = None  # to be written
        self._remembered: RaceMemory | None = None
        self._remembered_at = -math.inf
        self._surely = False  # the memory must be in the file itself
        self._failed_at = 0.0
        self._database: sqlite3.Connection | None = None
        self._session = 0
        self._claimed: IO[bytes] | None = None
        self.error = ''
        """Why the last try to write failed, in a phrase; empty: it did not."""
        self.left_behind: RaceMemory | None = None
        """What is known of the last run; None: nothing."""
        try:
            self._claim()
            self.left_behind = self._open()
        except _UNWRITABLE as error:
            self._fail(error)

    # ----- what is to be written; none of these waits -------------------------------------

    def begin(self, rules: str, setup: Setup) -> None:
        """Take with what the rules begin, and their version."""
        self._rules = rules, setup

    def put(self, events: Sequence[StampedEvent], inputs: Block | None = None) -> None:
        """
        Take events.

        :param inputs: what went into the rules up to these events, and was not handed over yet.
        """
        self._events += events
        if inputs is not None and inputs.data:
            if not self._inputs:
                self._inputs_since = clock.now()
            self._inputs.append(inputs)

    def remember(self, memory: RaceMemory, at: float, surely: bool = False) -> None:
        """
        Take what the next run is to find.

        :param at: the time of it, on any clock (s): what is older than what is known is ignored.
        :param surely: have it in the file itself.
        """
        if at >= self._remembered_at:
            self._remembered_at = at
            if surely or memory != (self._memory or self._remembered):
                self._memory = memory
        self._surely |= surely

    def due_in(self) -> float | None:
        """Return after which time it is to be written, in seconds; None: there is nothing."""
        now = clock.now()
        if self.error:
            return max(0.0, self._failed_at + RETRY - now)
        if self._events or self._memory or self._surely or self._rules:
            return 0.0
        return max(0.0, self._inputs_since + INPUTS_EVERY - now) if self._inputs else None

    # ----- writing ------------------------------------------------------------------------

    def write(self) -> bool:
        """Write all that was handed over; return whether it is on the disk now."""
        try:
            if self._database is None:
                self._claim()
                self._open()
            self._write()
        except (*_UNWRITABLE, RecordError) as error:
            # What SQLite knows of the file may be wrong by now: the next try opens it again.
            if self._database is not None:
                self._database.close()
                self._database = None
            self._fail(error)
            return False
        self.error = ''
        return True

    def end(self) -> None:
        """Write what is left, and let the file go."""
        self.write()
        self._release()

    def _fail(self, error: Exception) -> None:
        self.error = _in_words(error)
        self._failed_at = clock.now()

    def _claim(self) -> None:
        """Have the file to oneself."""
        if self._claimed is not None:
            return
        self._path.parent.mkdir(parents=True, exist_ok=True)
        if self._path.exists() and not self._path.is_file():
            raise _NoRecordError(
                f'{self._path} is no file: move it away, or choose another one with the parameter '
                'record'
            )
        claimed = self._path.open('ab')
        if not claim(claimed.fileno()):
            claimed.close()
            raise RecordError(
                f'{self._path} is the record of another race control that is running: '
                'end that one, or choose another file with the parameter record'
            )
        self._claimed = claimed

    def _open(self) -> RaceMemory | None:
        """Open the file, begin a run of its own, and return what the last run left."""
        database = sqlite3.connect(self._path, timeout=1.0, isolation_level=None)
        try:
            left_behind = self._prepare(database)
        except BaseException:
            database.close()
            raise
        self._database = database
        return left_behind

    def _prepare(self, database: sqlite3.Connection) -> RaceMemory | None:
        (version,) = database.execute('PRAGMA user_version').fetchone()
        tables = database.execute('SELECT count(*) FROM sqlite_master').fetchone()[0]
        if tables and version != SCHEMA_VERSION:
            raise _NoRecordError(
                f'{self._path} is no record of this race control (its version is {version}, '
                f'not {SCHEMA_VERSION}): move it away, or choose another file with the '
                'parameter record'
            )
        database.execute('PRAGMA journal_mode = WAL')
        # A race control that loses its power has lost nothing that it wrote.
        database.execute('PRAGMA synchronous = FULL')
        begins = not self._session
        with _transaction(database):
            if not tables:
                for statement in _SCHEMA.split(';\n'):
                    database.execute(statement)
                database.execute(f'PRAGMA user_version = {SCHEMA_VERSION}')
            left_behind = _left_behind(database) if begins else None
            if begins:
                cursor = database.execute(
                    'INSERT INTO session (began_ns) VALUES (?)', (time.time_ns(),)
                )
                assert cursor.lastrowid is not None
                self._session = cursor.lastrowid
        if begins:
            _checkpoint(database)
        return left_behind

    def _write(self) -> None:
        assert self._database is not None
        rows = [(self._session, *_row(stamped)) for stamped in self._events]
        self._blocks += [block.compressed() for block in joined(self._inputs)]
        self._inputs.clear()
        blocks = [
            (self._session, number, block)
            for number, block in enumerate(self._blocks, self._blocks_written + 1)
        ]
        with _transaction(self._database):
            places = ', '.join('?' * (1 + len(_COLUMNS)))
            insert = f'INSERT INTO event VALUES ({places})'  # noqa: S608 - our own names
            self._database.executemany(insert, rows)
            self._database.executemany('INSERT INTO input VALUES (?, ?, ?)', blocks)
            if self._rules is not None:
                rules, setup = self._rules
                self._set('rules', rules)
                self._set('setup', written(setup))
            if self._memory is not None:
                self._set('memory', written(self._memory))
        self._events.clear()
        self._rules = None
        self._blocks_written += len(blocks)
        self._blocks.clear()
        self._remembered, self._memory = self._memory or self._remembered, None
        if self._surely:
            _checkpoint(self._database)
            self._surely = False

    def _set(self, column: str, value: object) -> None:
        assert self._database is not None
        self._database.execute(
            f'UPDATE session SET {column} = ? WHERE id = ?',  # noqa: S608 - our own names
            (value, self._session),
        )

    def _release(self) -> None:
        if self._database is not None:
            self._database.close()
            self._database = None
        if self._claimed is not None:
            self._claimed.close()


_UNWRITABLE = (OSError, sqlite3.Error, _NoRecordError)
"""What a file raises that cannot be written, or is damaged, or is something else."""


def _in_words(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror.lower()
    return str(error)


def _checkpoint(database: sqlite3.Connection) -> None:
    """
    Have all that was written in the file itself: the ``-wal`` beside it may be deleted.

    Where another program reads, some may stay in the ``-wal``: nothing waits for a reader.
    """
    database.execute('PRAGMA wal_checkpoint(PASSIVE)')


@contextlib.contextmanager
def _transaction(database: sqlite3.Connection) -> Iterator[None]:
    database.execute('BEGIN IMMEDIATE')
    try:
        yield
        database.execute('COMMIT')
    except BaseException:
        if database.in_transaction:
            database.execute('ROLLBACK')
        raise


def _row(stamped: StampedEvent) -> tuple[Any, ...]:
    """Return the columns of an event, after the session; the fields of a ``RecordedEvent``."""
    event = (getattr(stamped.event, name) for name in _COLUMNS[3:])
    return (*stamped[:3], *map(_column, event))


def _column(value: object) -> object:
    if isinstance(value, str):
        return value.replace('\0', '\ufffd')  # a NUL says that a file was cut off within it
    return value.name if isinstance(value, enum.Enum) else value


RESULTS_LAST_NS = 3 * 86_400 * 10**9
"""Time from the last event of a run after which the next one knows its results no more: they are
of another event, whose heats may have the same names. Nanoseconds."""


def _left_behind(database: sqlite3.Connection) -> RaceMemory | None:
    """Return what is known of the last run; None: nothing."""
    last = (
        'SELECT max(began_ns, coalesce((SELECT max(wall_ns) FROM event), 0)), memory '
        'FROM session ORDER BY id DESC LIMIT 1'
    )
    newest_ns, memory = database.execute(last).fetchone() or (0, None)
    if memory is None:
        return None  # there is no run, or the last one wrote nothing
    try:
        known = read(RaceMemory, memory)
    except ValueError:
        return None  # damaged
    if time.time_ns() - newest_ns > RESULTS_LAST_NS:
        known = dataclasses.replace(known, laps=laps.NO_LAPS, heats=())
    return known


# ----- to read a record -----------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class RecordedEvent:
    """An event as it stands in the record; the names are those of ``Event`` and its enums."""

    sequence: int
    wall_ns: int
    monotonic: float
    kind: str
    kart: int
    command: str | None
    success: bool
    state: str | None
    text: str
    official: str
    alert: str | None = None
    hold: str | None = None
    race: int = 0
    heat: str = ''
    after: float = 0.0
    grade: str | None = None
    lap: int = 0

    @staticmethod
    def of(stamped: StampedEvent) -> RecordedEvent:
        """Return an event as it will be read from a record."""
        return RecordedEvent(*_row(stamped))

    def event(self) -> Event:
        """
        Return it as the rules made it.

        :raises KeyError: if there is no such kind, command, state, alert or hold.
        """
        event: Event = _event([getattr(self, name, False) for name in Event._fields])
        return event


_COLUMNS = tuple(field.name for field in dataclasses.fields(RecordedEvent))
"""The columns of an event, after the session."""

_recorded = reader(RecordedEvent)
_event = reader(Event)


def open_read_only(path: pathlib.Path) -> sqlite3.Connection:
    """
    Open a record to read it, also while race control writes it.

    :raises FileNotFoundError: if there is no such file.
    :raises sqlite3.Error: if it cannot be read.
    """
    if not path.exists():
        raise FileNotFoundError(f'there is no {path}')
    database = sqlite3.connect(f'{path.absolute().as_uri()}?mode=ro', uri=True, timeout=1.0)
    database.text_factory = lambda text: text.decode(errors='replace')
    return database


def is_being_written(path: pathlib.Path) -> bool:
    """
    Return whether a race control that runs now has this record.

    :raises OSError: if it cannot be read.
    """
    with path.open('rb') as file:
        try:
            # Given back at once; a race control that starts just now tries for longer than that.
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def inputs_of(
    database: sqlite3.Connection, session: int, after: int = 0, backwards: bool = False
) -> Iterator[tuple[int, bytes]]:
    """
    Yield what went into the rules in one run, in blocks, each with its number and compressed.

    :param after: only those with a higher number.
    :param backwards: the last one first.
    """
    query = 'SELECT block, data FROM input WHERE session = ? AND block > ? ORDER BY block'
    yield from database.execute(f'{query} DESC' if backwards else query, (session, after))


def sessions(database: sqlite3.Connection) -> list[Session]:
    """
    Return the runs of race control in a record, oldest first.

    :raises sqlite3.DatabaseError: if the record is damaged.
    """
    rows = database.execute(
        'SELECT id, began_ns, max(CASE WHEN kind = ? AND success = 1 THEN wall_ns END), '
        'count(sequence) FROM session LEFT JOIN event ON event.session = session.id '
        'GROUP BY id ORDER BY id',
        (EventKind.ENDED.name,),
    )
    found = [Session(*row) for row in rows]
    for run in found:
        if not (isinstance(run.began_ns, int) and isinstance(run.ended_ns, int | None)):
            raise sqlite3.DatabaseError(f'run {run.number} is damaged')
    return found


def events(
    database: sqlite3.Connection, session: int, after: int = 0, backwards: bool = False
) -> Iterator[RecordedEvent]:
    """
    Yield the events of one run, in order.

    :param after: only those with a higher number.
    :param backwards: the last one first.
    :raises sqlite3.DatabaseError: where the record is damaged.
    """
    query = 'SELECT * FROM event WHERE session = ? AND sequence > ? ORDER BY sequence'
    rows = database.execute(f'{query} DESC' if backwards else query, (session, after))
    for _, *row in rows:
        try:
            event: RecordedEvent = _recorded(row)
            event.event()
            # For what is missing at the end of a file, SQLite has zeros.
            if any('\0' in value for value in row if isinstance(value, str)):
                raise ValueError('a text was cut off')
            if event.kart >= 2**32:
                raise ValueError(f'there is no kart {event.kart}')
        except DAMAGED as error:
            raise sqlite3.DatabaseError(
                f'event {row[0]!r} of run {session} is damaged: {error}'
            ) from error
        yield event
