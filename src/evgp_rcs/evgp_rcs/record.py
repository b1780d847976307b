"""
The record: every event of race control, and what a race must find again after a crash (§3.E).

One thread writes; nothing that stops a kart waits for it. Each batch of events is one
transaction of SQLite, together with what the race must remember, so that after a crash of the
process or of the machine both are there up to the same event, or neither is.

When the disk does not take it, the events wait here, `trouble` says so, and the writer tries
again. Nothing is lost until `MOST_WAITING` events wait.

The schema (``PRAGMA user_version`` 1):

======== =================== ======================================================================
table    column              meaning
======== =================== ======================================================================
session  id                  one run of race control
..       began_ns, ended_ns  wall time, ns since the epoch; `ended_ns` is null after a crash
event    session, sequence   the run, and the number of the event in it: from 1, without a gap
..       wall_ns             wall time, ns since the epoch
..       monotonic           the clock of the rules, s
..       kind                a name of ``EventKind``
..       kart                the kart's number; 0: none
..       command             a name of ``CommandKind``; null: no command
..       success             for a command, whether it was accepted
..       state               a name of ``RaceState``; null: none
..       text                one sentence for the official
memory   session             the run
..       sequence            the last event that this comes after
..       state               the race's state
..       karts               JSON: of each kart's number, the fields of ``KartMemory``
======== =================== ======================================================================
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
import contextlib
import dataclasses
import fcntl
import json
import math
import os
import pathlib
import sqlite3
import threading
import time
from typing import IO

from evgp_protocol.states import RaceState
from evgp_rcs.race import KartMemory, RaceMemory, StampedEvent

SCHEMA_VERSION = 1

MOST_WAITING = 100_000
"""So many events wait for a disk that takes none; what comes after them is lost."""

RETRY = 1.0
"""How long after a failure the writer tries again, seconds."""

SLOW = 2.0
"""So long may an event wait before `trouble` speaks of it, seconds."""

_SCHEMA = """
CREATE TABLE session (
    id INTEGER PRIMARY KEY,
    began_ns INTEGER NOT NULL,
    ended_ns INTEGER
);
CREATE TABLE event (
    session INTEGER NOT NULL REFERENCES session,
    sequence INTEGER NOT NULL,
    wall_ns INTEGER NOT NULL,
    monotonic REAL NOT NULL,
    kind TEXT NOT NULL,
    kart INTEGER NOT NULL,
    command TEXT,
    success INTEGER NOT NULL,
    state TEXT,
    text TEXT NOT NULL,
    PRIMARY KEY (session, sequence)
) WITHOUT ROWID;
CREATE TABLE memory (
    session INTEGER PRIMARY KEY REFERENCES session,
    sequence INTEGER NOT NULL,
    state TEXT NOT NULL,
    karts TEXT NOT NULL
);
"""


class RecordError(RuntimeError):
    """The file cannot be the record; the text says why and what would be right."""


@dataclasses.dataclass(frozen=True)
class Session:
    """One run of race control; `ended_ns` is None after a crash, and while it lasts."""

    number: int
    began_ns: int
    ended_ns: int | None
    events: int


def default_path() -> pathlib.Path:
    """Return where race control keeps its record if it is not told: below ROS_HOME."""
    home = os.environ.get('ROS_HOME') or pathlib.Path.home() / '.ros'
    return pathlib.Path(home, 'evgp_rcs', 'record.sqlite3')


class Record:
    """
    Writes the record of one run of race control.

    :param path: the file; made, with its folder, if there is none.
    :raises RecordError: if it is something else than a record, or another race control's.
    """

    def __init__(self, path: pathlib.Path) -> None:
        """Claim the file; if the disk does not let it, `trouble` says so."""
        self._path = path
        self._lock = threading.Condition()
        self._waiting: deque[tuple[float, StampedEvent]] = deque()
        self._memory: RaceMemory | None = None
        self._memory_at = -math.inf
        self._memory_waits = False
        self._lost = 0
        self._error = ''
        self._ending = False
        self._ended_in_order = False
        self._database: sqlite3.Connection | None = None
        self._session = 0
        self._claimed: IO[bytes] | None = None
        self._written = 0  # the sequence number of the last event
        self.courtesy: Callable[[], Callable[[], object]] = lambda: lambda: None
        """Called for each batch; what it returns is called before each event and each kart that is
        put into the batch, and waits while frames are on their way to the karts."""
        self.left_behind: RaceMemory | None = None
        """What the last run left, unless it ended in good order with nothing under way."""
        try:
            self.left_behind = self._open()
        except RecordError:
            self._release()
            raise
        except (OSError, sqlite3.OperationalError) as error:
            self._error = _in_words(error)
            self.left_behind = _left_behind_read_only(path)
        self._thread = threading.Thread(target=self._run, name='record', daemon=True)
        self._thread.start()

    # ----- for other threads --------------------------------------------------------------

    def put(self, events: Iterable[StampedEvent]) -> None:
        """Have events written; returns at once."""
        now = time.monotonic()
        with self._lock:
            for event in events:
                if len(self._waiting) < MOST_WAITING:
                    self._waiting.append((now, event))
                else:
                    self._lost += 1
            self._lock.notify_all()

    def remember(self, memory: RaceMemory, at: float) -> None:
        """
        Have this be what the next run finds.

        :param at: the time of it, on any clock (s): what is older than what is known is ignored.
        """
        with self._lock:
            if at < self._memory_at:
                return
            self._memory_at = at
            if memory != self._memory:
                self._memory = memory
                self._memory_waits = True
                self._lock.notify_all()

    def trouble(self) -> str:
        """Return why the record fails, as a sentence for an official; empty: it does not."""
        with self._lock:
            waiting = len(self._waiting)
            waits = time.monotonic() - self._waiting[0][0] if waiting else 0.0
            reason = self._error
            if not reason and waits > SLOW:
                reason = f'the disk has taken nothing for {waits:.0f} s'
            if not reason:
                return ''
            lost = f', {self._lost} are lost' if self._lost else ''
            return f'The record {self._path} fails: {reason}; {waiting} events wait{lost}'

    def flush(self, timeout: float) -> bool:
        """Wait until all that was given is written, s; return whether it is."""
        with self._lock:
            return self._lock.wait_for(lambda: not (self._waiting or self._memory_waits), timeout)

    def end(self, timeout: float, in_order: bool = True) -> None:
        """
        Write what is left and that this run has ended.

        :param timeout: wait no longer than this, s.
        :param in_order: the next run need not take up a race that was not under way.
        """
        with self._lock:
            self._ended_in_order = in_order
            self._ending = True
            self._lock.notify_all()
        self._thread.join(timeout)

    # ----- the writer ---------------------------------------------------------------------

    def _run(self) -> None:
        try:
            self._write_until_the_end()
        finally:
            self._release()

    def _write_until_the_end(self) -> None:
        while True:
            with self._lock:
                self._lock.wait_for(
                    lambda: self._waiting or self._memory_waits or self._ending or self._error,
                )
                batch = [event for _, event in self._waiting]
                memory = self._memory if self._memory_waits else None
                ending = self._ending
            try:
                if self._database is None:
                    self._open()
                self._write(batch, memory, ending)
            except (OSError, sqlite3.Error, RecordError) as error:
                # What SQLite knows of the file may be wrong by now: the next try opens it anew.
                if self._database is not None:
                    self._database.close()
                    self._database = None
                with self._lock:
                    self._error = _in_words(error)
                    if ending:
                        return
                    self._lock.wait_for(lambda: self._ending, RETRY)
                continue
            with self._lock:
                self._error = ''
                for _ in batch:
                    self._waiting.popleft()
                if memory is not None and memory == self._memory:
                    self._memory_waits = False
                self._lock.notify_all()
            if ending:
                return

    def _open(self) -> RaceMemory | None:
        """Open the file, begin a run of its own, and return what the last run left."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        if self._claimed is None:
            claimed = self._path.open('ab')
            try:
                fcntl.flock(claimed, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                claimed.close()
                raise RecordError(
                    f'{self._path} is the record of another race control that is running: '
                    'choose another file with the parameter record'
                ) from error
            self._claimed = claimed
        database = sqlite3.connect(
            self._path, timeout=1.0, isolation_level=None, check_same_thread=False
        )
        try:
            left_behind = self._prepare(database)
        except BaseException:
            database.close()
            raise
        self._database = database
        return left_behind

    def _prepare(self, database: sqlite3.Connection) -> RaceMemory | None:
        try:
            (version,) = database.execute('PRAGMA user_version').fetchone()
            tables = database.execute('SELECT count(*) FROM sqlite_master').fetchone()[0]
        except sqlite3.DatabaseError as error:
            if isinstance(error, sqlite3.OperationalError):
                raise
            raise RecordError(
                f'{self._path} is no record of race control ({error}): move it away, or choose '
                'another file with the parameter record'
            ) from error
        if version != SCHEMA_VERSION and (version or tables):
            raise RecordError(
                f'{self._path} is no record of this race control (its version is {version}, '
                f'not {SCHEMA_VERSION}): move it away, or choose another file with the parameter '
                'record'
            )
        database.execute('PRAGMA journal_mode = WAL')
        # A race control that loses its power has lost nothing that it wrote.
        database.execute('PRAGMA synchronous = FULL')
        with _transaction(database):
            if not version:
                for statement in _SCHEMA.split(';'):
                    database.execute(statement)
                database.execute(f'PRAGMA user_version = {SCHEMA_VERSION}')
            left_behind = _left_behind(database)
            if not self._session:
                cursor = database.execute(
                    'INSERT INTO session (began_ns) VALUES (?)', (time.time_ns(),)
                )
                assert cursor.lastrowid is not None
                session = cursor.lastrowid
            else:
                session = self._session
        self._session = session
        return left_behind

    def _write(
        self, batch: Sequence[StampedEvent], memory: RaceMemory | None, ending: bool
    ) -> None:
        assert self._database is not None
        give_way = self.courtesy()
        rows = []
        for stamped in batch:
            give_way()
            rows.append(_row(self._session, stamped))
        karts = {}
        if memory is not None:
            for number, kart in memory.karts.items():
                give_way()
                karts[number] = dataclasses.asdict(kart)
        with _transaction(self._database):
            self._database.executemany(
                'INSERT INTO event VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)', rows
            )
            if memory is not None:
                self._database.execute(
                    'INSERT OR REPLACE INTO memory VALUES (?, ?, ?, ?)',
                    (
                        self._session,
                        batch[-1].sequence if batch else self._written,
                        memory.state.value,
                        json.dumps(karts),
                    ),
                )
            if ending and self._ended_in_order:
                self._database.execute(
                    'UPDATE session SET ended_ns = ? WHERE id = ?', (time.time_ns(), self._session)
                )
        if batch:
            self._written = batch[-1].sequence

    def _release(self) -> None:
        if self._database is not None:
            self._database.close()
        if self._claimed is not None:
            self._claimed.close()


def _in_words(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror.lower()
    return str(error)


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


def _row(session: int, stamped: StampedEvent) -> tuple[object, ...]:
    event = stamped.event
    return (
        session,
        stamped.sequence,
        stamped.wall_ns,
        stamped.monotonic,
        event.kind.name,
        event.kart,
        event.command.name if event.command is not None else None,
        event.success,
        event.state.name if event.state is not None else None,
        event.text,
    )


NOTHING_KNOWN = RaceMemory(RaceState.IN_GARAGE, {})


def _left_behind(database: sqlite3.Connection) -> RaceMemory | None:
    """Return what the last run left, if the next one must take it up."""
    last = database.execute('SELECT ended_ns FROM session ORDER BY id DESC LIMIT 1').fetchone()
    if last is None:
        return None
    row = database.execute(
        'SELECT state, karts FROM memory ORDER BY session DESC LIMIT 1'
    ).fetchone()
    memory = NOTHING_KNOWN
    if row is not None:
        state, karts = row
        memory = RaceMemory(
            RaceState[state],
            {int(number): KartMemory(**kart) for number, kart in json.loads(karts).items()},
        )
    ended_in_order = last[0] is not None
    return None if ended_in_order and memory.home else memory


def _left_behind_read_only(path: pathlib.Path) -> RaceMemory | None:
    """Return the same from a file that cannot be written; one that cannot be read is doubt."""
    try:
        with contextlib.closing(open_read_only(path)) as database:
            return _left_behind(database)
    except FileNotFoundError:
        return None
    except (OSError, sqlite3.Error):
        return NOTHING_KNOWN


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


def open_read_only(path: pathlib.Path) -> sqlite3.Connection:
    """
    Open a record to read it, also while race control writes it.

    :raises FileNotFoundError: if there is no such file.
    :raises sqlite3.Error: if it cannot be read.
    """
    if not path.exists():
        raise FileNotFoundError(f'there is no {path}')
    return sqlite3.connect(f'{path.absolute().as_uri()}?mode=ro', uri=True, timeout=1.0)


def sessions(database: sqlite3.Connection) -> list[Session]:
    """Return the runs of race control in a record, oldest first."""
    rows = database.execute(
        'SELECT id, began_ns, ended_ns, count(event.sequence) FROM session '
        'LEFT JOIN event ON event.session = session.id GROUP BY id ORDER BY id'
    )
    return [Session(*row) for row in rows]


def events(database: sqlite3.Connection, session: int) -> Iterator[RecordedEvent]:
    """Yield the events of one run, in order."""
    rows = database.execute(
        'SELECT sequence, wall_ns, monotonic, kind, kart, command, success, state, text '
        'FROM event WHERE session = ? ORDER BY sequence',
        (session,),
    )
    for row in rows:
        event = RecordedEvent(*row)
        yield dataclasses.replace(event, success=bool(event.success))
