# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The record: the stream of each run (``inputs``), and the memory that a race needs after a crash.

A separate process writes the record (``record_process``), in blocks. Each write is one SQLite
transaction of the stream and the race's memory (§3.E), so that both end at the same event after a
crash of the process or the machine. Entries without an event are written every `INPUTS_EVERY`
seconds. If the disk fails, everything waits here until a later attempt succeeds.

The next run finds the last memory that was saved in `left_behind`, if there is one. The record
cannot know how that run ended; the machine's mark does (``run_mark``). Unless another program is
reading the record just then, the memory is in the file itself, and not only in SQLite's ``-wal``
beside it.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import dataclasses
import fcntl
import hashlib
import itertools
import math
import os
import pathlib
import sqlite3
import time
from typing import IO

from evgp_node.encoding import read, written
from evgp_node.folder import rcs_folder
from evgp_node.stream import Began, Block, joined
from evgp_node.stream_file import (
    blocks_of,
    connection,
    open_for_writing,
    runs_of,
    WRITE_BLOCK,
)
from evgp_protocol import clock, link, states
from evgp_rcs.record.run_mark import claim, in_words
from evgp_rcs.rules import catalogue, inputs, link_quality, race
from evgp_rcs.rules.inputs import Batch, encode, entries_of, Rules
from evgp_rcs.rules.race import EventKind, RaceMemory, StampedEvent

INPUTS_EVERY = 1.0
"""Maximum time for which entries without an event are collected, in seconds. This spares the disk,
which must confirm every write."""

LAST_WORDS = 10.0
"""Maximum time from the event that ends a run to the run's last event, in seconds."""

RETRY = 1.0
"""Time after a failure until the next attempt, in seconds."""

_MEMORY = """
CREATE TABLE memory ( -- what the next run must know; the last one only
    run INTEGER PRIMARY KEY,
    data TEXT NOT NULL -- RaceMemory, as encoding writes it
)
"""


class RecordError(RuntimeError):
    """Race control cannot start: another one is using the record, or the record is unreliable."""


@dataclasses.dataclass(frozen=True)
class Session:
    """
    One run of race control.

    :param ended_ns: wall time of its normal end; None if the record has no such event.
    :param events: number of its last event.
    :param last_ns: wall time of its last event.
    :param id: id of the run (``Began``); empty if it cannot be read.
    """

    number: int
    began_ns: int
    ended_ns: int | None
    events: int
    last_ns: int
    id: str  # noqa: A003 - the field's name
    goes_on: bool = False


_RULES = race, catalogue, inputs, link_quality, link, states


def rules_version() -> str:
    """
    Return the version of the rules: 16 hexadecimal digits of a hash of all sources that they use.

    The same version replays a run to the same result. It is empty if the sources are missing.
    """
    try:
        texts = [pathlib.Path(str(each.__file__)).read_bytes() for each in _RULES]
    except OSError:
        return ''
    return hashlib.sha256(b'\0'.join(texts)).hexdigest()[:16]


def default_path() -> pathlib.Path:
    """Return the default path of the record, below ROS_HOME."""
    return rcs_folder() / 'record.sqlite3'


class Record:
    """
    Writes the record of one run of race control.

    Entries wait in memory until ``write`` writes all of them. Only ``write`` and ``end`` wait for
    the disk.

    :param path: path of the file, which is created with its folder if necessary. If it cannot be
        written, or is not a record, `error` says why, and ``write`` tries again.
    :raises RecordError: if another running race control is using the record.
    """

    def __init__(self, path: pathlib.Path, run: str = '') -> None:
        """Claim the file and find what the last run left behind."""
        self._path = path
        self._waiting = [Block(0, encode(Began(run, time.time_ns())))]
        self._due = math.inf  # when to write
        self._numbers = itertools.count(1)  # of the blocks
        self._blocks: list[tuple[int, bytes]] = []  # compressed once, however often the disk fails
        self._memory: RaceMemory | None = None  # to be written
        self._database: sqlite3.Connection | None = None
        self._run = 0
        self._claimed: IO[bytes] | None = None
        self.error = ''
        """A phrase that says why the last attempt to write failed; empty if it succeeded."""
        with contextlib.suppress(*_UNWRITABLE):  # `write` reports these
            self._claim()
        self.left_behind = left_behind(path)
        """The last memory that was saved; None if there is none."""
        self.write()

    # ----- what to write; these methods do not wait ---------------------------------------

    def put(self, batch: Batch) -> None:
        """Append a batch to the stream."""
        # `Began` precedes all of them.
        self._waiting.append(Block(1 + batch.first, b''.join(map(encode, batch.entries))))
        urgent = any(isinstance(entry, StampedEvent | Rules) for entry in batch.entries)
        self._write_within(0.0 if urgent else INPUTS_EVERY)

    def remember(self, memory: RaceMemory) -> None:
        """Save a memory for the next run."""
        self._memory = memory
        self._write_within(0.0)

    def _write_within(self, seconds: float) -> None:
        if not self.error:  # otherwise, the next attempt writes it too
            self._due = min(self._due, clock.now() + seconds)

    def due_in(self) -> float:
        """Return the time until a write is due, in seconds; infinite if nothing waits."""
        return max(0.0, self._due - clock.now())

    # ----- writing ------------------------------------------------------------------------

    def write(self) -> bool:
        """Write everything that is waiting and return whether it is on the disk now."""
        try:
            self._claim()  # it may have been deleted or replaced since
            if self._database is None:
                self._open()
            self._write()
        except (*_UNWRITABLE, RecordError) as error:
            # SQLite's view of the file may be wrong now, so the next attempt opens it again. If no
            # run has begun in the file, somebody may also move it away.
            if self._database is not None:
                self._database.close()
                self._database = None
            if self._claimed is not None and not self._run:
                self._claimed.close()
                self._claimed = None
            self.error = in_words(error)
            if getattr(error, 'sqlite_errorname', '') == 'SQLITE_IOERR_SHMSIZE':
                self.error += '; the disk may be full'  # no room for SQLite's ``-shm``
            self._due = clock.now() + RETRY
            return False
        self.error = ''
        self._due = math.inf
        return True

    def end(self) -> None:
        """Write the rest and release the file."""
        self.write()
        self._release()

    def _release(self) -> None:
        if self._database is not None:
            self._database.close()
        if self._claimed is not None:
            self._claimed.close()

    def _claim(self) -> None:
        if self._claimed is not None:
            own = os.fstat(self._claimed.fileno())
            if not (self._path.exists() and os.path.samestat(self._path.stat(), own)):
                raise OSError(
                    'somebody has moved, deleted or replaced the file. Put it back, or restart '
                    'race control when no kart is on the track'
                )
            return
        self._path.parent.mkdir(parents=True, exist_ok=True)
        if self._path.exists() and not self._path.is_file():
            raise OSError(
                f'{self._path} is not a file: move it away, or choose another file with the '
                'parameter record'
            )
        claimed = self._path.open('ab')
        if not claim(claimed.fileno()):
            claimed.close()
            raise RecordError(
                f'{self._path} is the record of another race control that is running: '
                'end that race control, or choose another file with the parameter record'
            )
        self._claimed = claimed

    def _open(self) -> None:
        try:
            self._database, run = open_for_writing(self._path, _MEMORY)
        except sqlite3.OperationalError:
            raise  # this concerns the disk
        except sqlite3.DatabaseError as error:
            raise OSError(
                f'{self._path} is not a record of this race control ({error}): move it away, or '
                'choose another file with the parameter record'
            ) from error
        if not self._run:
            self._run = run
            _checkpoint(self._database)  # what a crash has left beside the file

    def _write(self) -> None:
        assert self._database is not None
        self._blocks += [
            (next(self._numbers), each.compressed()) for each in joined(self._waiting)
        ]
        self._waiting.clear()
        with self._database:
            self._database.execute('BEGIN IMMEDIATE')
            self._database.executemany(WRITE_BLOCK, [(self._run, *each) for each in self._blocks])
            if self._memory is not None:
                row = self._run, written(self._memory)
                self._database.execute('INSERT OR REPLACE INTO memory VALUES (?, ?)', row)
        self._blocks.clear()
        if self._memory is not None:
            _checkpoint(self._database)
            self._memory = None


_UNWRITABLE = (OSError, sqlite3.Error)
"""The exceptions raised if the file cannot be written, is damaged, or is not a record."""


def _checkpoint(database: sqlite3.Connection) -> None:
    """
    Move everything from the ``-wal``, which somebody may delete, into the file itself.

    While another program reads the record, part of it may stay in the ``-wal``, because this does
    not wait.
    """
    database.execute('PRAGMA wal_checkpoint(PASSIVE)')


def left_behind(path: pathlib.Path) -> RaceMemory | None:
    """
    Return the last memory that was saved in a record; None if there is none.

    The disk need not be writable. A run that was cut off before it saved anything does not count.
    """
    query = 'SELECT data FROM memory ORDER BY run DESC LIMIT 1'
    for how in ('mode=ro', 'immutable=1'):  # the second one creates no file beside it
        with contextlib.suppress(*_UNWRITABLE, ValueError):  # ValueError: damaged
            if path.is_file():  # a pipe would block
                with contextlib.closing(connection(path, how)) as database:
                    found = database.execute(query).fetchone()
                return None if found is None else read(RaceMemory, found[0])
    return None


# ----- to read a record -----------------------------------------------------------------------


def is_being_written(path: pathlib.Path) -> bool:
    """
    Return whether a running race control is writing this record.

    :raises OSError: if it cannot be read.
    """
    with path.open('rb') as file:
        try:
            # The lock is released at once, and a starting race control tries for longer than that.
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def sessions(database: sqlite3.Connection) -> Iterator[Session]:
    """
    Yield the runs of race control in a record, oldest first.

    :raises sqlite3.DatabaseError: if the record is damaged.
    """
    for number in runs_of(database):
        yield _session(database, number)


def _session(database: sqlite3.Connection, number: int) -> Session:
    first = next(entries_of(itertools.islice(blocks_of(database, number), 1)), None)
    began = first if isinstance(first, Began) else Began('', 0)
    happened: list[StampedEvent] = []  # the newest ones
    for block in blocks_of(database, number, backwards=True):
        own = entries_of([block], (StampedEvent,))  # whatever the blocks before it contain
        happened[:0] = [each for each in own if isinstance(each, StampedEvent)]
        if happened and happened[-1].monotonic - happened[0].monotonic > LAST_WORDS:
            break
    ends = (each for each in happened if each.event.kind is EventKind.ENDED)
    ended_ns = next((each.wall_ns for each in ends if each.event.success), None)
    events, last_ns = (happened[-1].sequence, happened[-1].wall_ns) if happened else (0, 0)
    return Session(number, began.wall_ns or last_ns, ended_ns, events, last_ns, began.run)
