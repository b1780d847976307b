# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The record: the stream of each run (``inputs``), and what a race must find again after a crash.

It is written in a process of its own (``record_process``), in blocks. Each batch is one
transaction of SQLite, together with what the race must remember (§3.E), so that after a crash of
the process or of the machine both are there up to the same event, or neither is. Entries without
an event are written every `INPUTS_EVERY` seconds. When the disk does not take it, everything waits
here and is tried again.

What the next run finds is `left_behind`: what this record knows of the last run, or nothing. How
that ended, no record can say: the mark of the machine does (``run_mark``). What a GREEN_GREEN
leaves behind is on the disk before it goes out; and, unless somebody reads the record just then,
in the file itself and not only in SQLite's ``-wal`` beside it.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import dataclasses
import fcntl
import hashlib
import itertools
import pathlib
import secrets
import sqlite3
import time
from typing import IO

from evgp_node.encoding import read, written
from evgp_node.folder import rcs_folder
from evgp_node.stream import Began, Block, Gap, joined, SCHEMA_VERSION
from evgp_protocol import clock, states
from evgp_rcs.record.run_mark import claim, in_words
from evgp_rcs.rules import catalogue, race
from evgp_rcs.rules.inputs import Batch, encode, entries_of, Entry, Rules
from evgp_rcs.rules.race import EventKind, RaceMemory, StampedEvent

PROGRAM = 'race control'
"""Who writes these streams; another program may write its own beside them (``Began``)."""

INPUTS_EVERY = 1.0
"""Maximum time that entries without an event wait for others, in seconds. A disk that must confirm
every write has little to do then."""

LAST_WORDS = 10.0
"""Maximum time from the event that says that a run ends to the last event, in seconds."""

RETRY = 1.0
"""Time after a failure until the next try, in seconds."""

_SCHEMA = """
CREATE TABLE block ( -- the streams of all runs
    run INTEGER NOT NULL, -- counts the streams of this file from 1
    number INTEGER NOT NULL, -- counts the blocks of a stream from 1, without a gap
    data BLOB NOT NULL, -- Block
    PRIMARY KEY (run, number)
);
CREATE TABLE memory ( -- what the next run must know; the last one only
    run INTEGER PRIMARY KEY,
    data TEXT NOT NULL -- RaceMemory, as encoding writes it
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
    :param events: the number of its last event.
    :param last_ns: the wall time of that.
    :param id: the run's id, see ``Began``; empty: that cannot be read.
    """

    number: int
    began_ns: int
    ended_ns: int | None
    events: int
    last_ns: int
    id: str  # noqa: A003 - the field's name


def rules_version() -> str:
    """
    Return which rules these are: with equal ones, a replay comes out equal.

    16 hexadecimal digits of their sources; empty if these are not there.
    """
    try:
        texts = [
            pathlib.Path(str(each.__file__)).read_bytes() for each in (race, catalogue, states)
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
    :param run: the id of the run; empty: it is drawn here.
    :raises RecordError: if it is the record of another race control that is running.
    """

    def __init__(self, path: pathlib.Path, run: str = '') -> None:
        """Claim the file, and find what the last run left."""
        self._path = path
        self._id = run or secrets.token_hex(8)
        self._waiting: list[Block] = []
        self._since = 0.0  # when the first of them came
        self._urgent = False  # they have an event
        self._blocks: list[bytes] = []  # compressed once, however often the disk fails
        self._blocks_written = 0
        self._memory: RaceMemory | None = None  # to be written
        self._surely = False  # the memory must be in the file itself
        self._failed_at = 0.0
        self._database: sqlite3.Connection | None = None
        self._run = 0
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

    def put(self, batch: Batch) -> None:
        """Take what follows in the stream."""
        entries = [entry for entry in batch.entries if entry is not None]
        if entries:
            if not self._waiting:
                self._since = clock.now()
            # Before them all is Began.
            self._waiting.append(Block(1 + batch.first, b''.join(map(encode, entries))))
            self._urgent |= any(isinstance(entry, StampedEvent | Rules) for entry in entries)

    def remember(self, memory: RaceMemory, surely: bool = False) -> None:
        """
        Take what the next run is to find.

        :param surely: have it in the file itself.
        """
        self._memory = memory
        self._surely |= surely

    def due_in(self) -> float | None:
        """Return after which time it is to be written, in seconds; None: there is nothing."""
        now = clock.now()
        if self.error:
            return max(0.0, self._failed_at + RETRY - now)
        if self._urgent or self._memory:
            return 0.0
        return max(0.0, self._since + INPUTS_EVERY - now) if self._waiting else None

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
        self.error = in_words(error)
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
        begins = not self._run
        left_behind = None
        with _transaction(database):
            if not tables:
                for statement in _SCHEMA.split(';\n'):
                    database.execute(statement)
                database.execute(f'PRAGMA user_version = {SCHEMA_VERSION}')
            if begins:
                left_behind = _left_behind(database)
                (last,) = database.execute('SELECT max(run) FROM block').fetchone()
                began = Began(self._id, PROGRAM, time.time_ns())
                first = Block(0, encode(began)).compressed()
                run = (last or 0) + 1
                database.execute('INSERT INTO block VALUES (?, 1, ?)', (run, first))
        if begins:
            self._run, self._blocks_written = run, 1
            _checkpoint(database)
        return left_behind

    def _write(self) -> None:
        assert self._database is not None
        self._blocks += [block.compressed() for block in joined(self._waiting)]
        self._waiting.clear()
        blocks = [
            (self._run, number, block)
            for number, block in enumerate(self._blocks, self._blocks_written + 1)
        ]
        with _transaction(self._database):
            self._database.executemany('INSERT INTO block VALUES (?, ?, ?)', blocks)
            if self._memory is not None:
                row = self._run, written(self._memory)
                self._database.execute('INSERT OR REPLACE INTO memory VALUES (?, ?)', row)
        self._urgent = False
        self._blocks_written += len(blocks)
        self._blocks.clear()
        self._memory = None
        if self._surely:
            _checkpoint(self._database)
            self._surely = False

    def _release(self) -> None:
        if self._database is not None:
            self._database.close()
            self._database = None
        if self._claimed is not None:
            self._claimed.close()


_UNWRITABLE = (OSError, sqlite3.Error, _NoRecordError)
"""What a file raises that cannot be written, or is damaged, or is something else."""


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


def _left_behind(database: sqlite3.Connection) -> RaceMemory | None:
    """Return what is known of the last run; None: nothing."""
    last = next(sessions(database), None)
    if last is None:
        return None  # there is no run
    found = database.execute('SELECT data FROM memory WHERE run = ?', (last.number,)).fetchone()
    if found is None:
        return None  # it wrote nothing
    with contextlib.suppress(ValueError):  # damaged
        return read(RaceMemory, found[0])
    return None


# ----- to read a record -----------------------------------------------------------------------


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


def blocks_of(
    database: sqlite3.Connection, run: int, backwards: bool = False
) -> Iterator[tuple[int, bytes]]:
    """
    Yield the stream of a run, in blocks, each with its number and compressed.

    :raises sqlite3.DatabaseError: if the record is damaged.
    """
    order = 'DESC' if backwards else 'ASC'
    query = f'SELECT number, data FROM block WHERE run = ? ORDER BY number {order}'  # noqa: S608
    yield from database.execute(query, (run,))


def sessions(database: sqlite3.Connection) -> Iterator[Session]:
    """
    Yield the runs of race control in a record, newest first.

    :raises sqlite3.DatabaseError: if the record is damaged.
    """
    query = 'SELECT DISTINCT run FROM block ORDER BY run DESC'
    for (number,) in database.execute(query).fetchall():
        run = _session(database, number)
        if run is not None:
            yield run


def _session(database: sqlite3.Connection, number: int) -> Session | None:
    """Return a run; None: another program wrote it."""
    first = next(entries_of(itertools.islice(blocks_of(database, number), 1)), None)
    began = first if isinstance(first, Began) else Began('', PROGRAM, 0)
    if began.program != PROGRAM:
        return None
    happened: list[StampedEvent] = []  # the newest ones
    for block in blocks_of(database, number, backwards=True):
        happened[:0] = [each for each in _alone(block) if isinstance(each, StampedEvent)]
        if happened and happened[-1].monotonic - happened[0].monotonic > LAST_WORDS:
            break
    ends = (each for each in happened if each.event.kind is EventKind.ENDED)
    ended_ns = next((each.wall_ns for each in ends if each.event.success), None)
    events, last_ns = (happened[-1].sequence, happened[-1].wall_ns) if happened else (0, 0)
    return Session(number, began.wall_ns or last_ns, ended_ns, events, last_ns, began.run)


def _alone(block: tuple[int, bytes]) -> Iterator[Entry | Gap]:
    """Yield the events of a block, whatever came before it."""
    return entries_of([block], only=(StampedEvent,))


def events(database: sqlite3.Connection, run: int) -> Iterator[StampedEvent]:
    """
    Yield the events of one run that can be read, in order.

    :raises sqlite3.DatabaseError: if the record is damaged.
    """
    for entry in entries_of(blocks_of(database, run), only=(StampedEvent,)):
        if isinstance(entry, StampedEvent):
            yield entry
