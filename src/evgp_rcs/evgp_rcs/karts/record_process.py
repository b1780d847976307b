# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The process that writes the record and the run's mark, so no other process waits for the disk.

The kart server forks this process before it does anything else, and sends it everything over a
socket pair. At most `MOST_UNWRITTEN_BYTES` wait for the disk. Anything beyond that is lost, and
`RecordProcess.trouble` reports the loss. When the kart server ends, for whatever reason, this
process writes what has reached it and ends as well.

If this process ends, hangs, is frozen, or cannot write the mark (``run_mark``), the record fails.
The race then continues, but no new one can start. Only `RecordProcess.trouble` decides whether the
record fails.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
import contextlib
import ctypes
import os
import pathlib
import select
import signal
import socket
import time
import traceback

from evgp_rcs.karts.channel import (
    Ended,
    Failed,
    LocalEnd,
    Opened,
    pack,
    PAIR_BYTES,
    Unpacker,
    Written,
)
from evgp_rcs.record.run_mark import InUseError, RunMark
from evgp_rcs.record.store import INPUTS_EVERY, Record, RecordError
from evgp_rcs.rules.inputs import Batch
from evgp_rcs.rules.race import LastRun, RaceMemory, StampedEvent

MOST_UNWRITTEN_BYTES = 80 * 2**20
"""Maximum backlog of the stream that is not on the disk yet, in bytes. Anything beyond it is lost.
The backlog has room for an hour of racing with 20 karts."""

SLOW = 2.0
"""Maximum time that the disk may take for a batch before `RecordProcess.trouble` reports it, in
seconds. A batch without events may wait for `INPUTS_EVERY` before that."""

_PR_SET_PDEATHSIG = 1  # of linux/prctl.h


class RecordProcess:
    """
    The record's process, as the kart server sees it. Only ``__init__`` and ``end`` block.

    :param mark: the file of the mark (see ``run_mark.place``).
    :ivar opened: what the process has found at its start.
    :ivar on_saved: called in the loop with `RaceMemory.gridded` of the last memory that is on the
        disk, when this number changes.
    :raises RecordError: if the record cannot be used, for example because another race control
        that is running uses one of the files.
    """

    def __init__(self, path: pathlib.Path, mark: pathlib.Path, run: str = '') -> None:
        """Start the process and wait until it has read what the last run left behind."""
        self._path = path
        end, other = socket.socketpair()
        self.pid = os.fork()
        if not self.pid:
            _live(path, mark, run, other)
        other.close()
        self._end = LocalEnd(end)
        self._socket = end
        # The time in seconds at which writing each batch is due; its events and its bytes.
        self._unwritten: deque[tuple[float, int, int]] = deque()
        self._events = 0  # not yet written
        self._bytes = 0
        self._lost = 0
        self._full = False
        self._saved = 0
        self.on_saved: Callable[[int], None] = lambda gridded: None
        self._remembered: RaceMemory | None = None
        try:
            opened = self._end.first()
        except EOFError:
            opened = Failed(f'{path} cannot be used: its process has failed')
        if isinstance(opened, Failed):
            end.close()
            os.waitpid(self.pid, 0)
            raise RecordError(opened.text)
        self.opened: Opened = opened
        self._error = self.opened.error

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Read the process's messages in this loop."""
        self._end.attach(loop, self.look)

    def put(self, batch: Batch) -> None:
        """Append a batch to the record's stream."""
        data = pack(batch)
        size = len(data)
        events = sum(isinstance(entry, StampedEvent) for entry in batch.entries)
        if self._end.gone or self._bytes + size > MOST_UNWRITTEN_BYTES:
            self._lost += events
            self._full = True
            return
        due = time.monotonic() + (0.0 if events else INPUTS_EVERY)
        self._unwritten.append((due, events, size))
        self._events += events
        self._bytes += size
        self._end.send(data)

    def remember(self, memory: RaceMemory) -> None:
        """Save this memory for the next run (see ``Record.remember``)."""
        # If the process hangs, the memory waits until the process continues.
        if memory != self._remembered and self._end.unsent <= MOST_UNWRITTEN_BYTES:
            self._remembered = memory
            self._end.send(pack(memory))

    def look(self) -> None:
        """Read the messages that the process has sent."""
        for batches, error, gridded in self._end.receive():
            for _ in range(batches):
                _, events, size = self._unwritten.popleft()
                self._events -= events
                self._bytes -= size
            self._error = error
            self._full &= self._bytes > MOST_UNWRITTEN_BYTES / 2
            if gridded != self._saved:
                self._saved = gridded
                self.on_saved(gridded)

    def trouble(self) -> str:
        """Return why the record is failing, as a sentence for officials. Empty if it works."""
        # Unlike the rules' clock, this one skips suspends, because those do not slow the disk.
        now = time.monotonic()
        waits = now - self._unwritten[0][0] if self._unwritten else 0.0
        reason = self._error
        if self._end.gone:
            reason = 'its process has ended. Restart race control when no kart is on the track'
        elif not reason and waits > SLOW:
            reason = f'writing takes more than {waits:.0f} s'
        elif not reason and self._full:
            reason = 'events come faster than the disk can write them'
        if not reason:
            return ''
        lost = f', {self._lost} are lost' if self._lost else ''
        wait = 'event waits' if self._events == 1 else 'events wait'
        return f'The record {self._path} fails: {reason}; {self._events} {wait}{lost}'

    def end(self, timeout: float, ends_as: LastRun) -> None:
        """Write what is left and how the run ended, and end the process, within this time (s)."""
        until = time.monotonic() + timeout
        self._end.send_the_rest(Ended(ends_as), timeout=timeout)
        self._socket.settimeout(max(until - time.monotonic(), 0.01))
        with contextlib.suppress(TimeoutError, ChildProcessError):
            try:
                while self._socket.recv(PAIR_BYTES) and time.monotonic() < until:
                    pass
            except ConnectionError:
                pass  # the process has ended without reading the last messages
            if time.monotonic() < until:
                os.waitpid(self.pid, 0)  # the process must not outlive the kart server
        self._socket.close()


# ----- the process itself ---------------------------------------------------------------------


def wake_when_the_parent_dies() -> None:
    """Make a stopped process continue when its parent dies, so that it notices and ends."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGCONT)


def _live(path: pathlib.Path, mark: pathlib.Path, run: str, end: socket.socket) -> None:
    """Run the record's process until it ends."""
    code = 1
    try:
        # This process must not keep open the kart server's files, such as the pair of the ROS
        # half.
        os.closerange(3, end.fileno())
        os.closerange(end.fileno() + 1, os.sysconf('SC_OPEN_MAX'))
        # This process ends with the kart server. If it is frozen then, SIGCONT wakes it.
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT):
            signal.signal(number, signal.SIG_IGN)
        wake_when_the_parent_dies()
        _write(path, mark, run, end)
        code = 0
    except BaseException:  # noqa: BLE001 - no caller can catch it
        traceback.print_exc()
    finally:
        os._exit(code)


def _write(path: pathlib.Path, mark_path: pathlib.Path, run: str, end: socket.socket) -> None:
    try:
        mark = RunMark(mark_path)
        try:
            record = Record(path, run)
        except RecordError:
            mark.end(mark.last_run)
            raise
    except (RecordError, InUseError) as error:
        end.sendall(pack(Failed(str(error))))
        return
    told = record.error or mark.error
    end.sendall(pack(Opened(record.left_behind, mark.last_run, mark.why, told)))
    unpacker = Unpacker()
    batches = 0  # not written yet
    gridded = saved = 0  # of the last memory, and of the last one on the disk
    while True:
        if select.select([end], [], [], min(mark.due_in(), record.due_in()))[0]:
            try:
                data = end.recv(1 << 20)
            except ConnectionResetError:
                data = b''
            if not data:
                record.end()
                return
            for message in unpacker.feed(data):
                if isinstance(message, Batch):
                    batches += 1
                    record.put(message)
                elif isinstance(message, RaceMemory):
                    record.remember(message)
                    gridded = message.gridded
                else:
                    assert isinstance(message, Ended)
                    record.end()
                    mark.end(message.ends_as)
                    return
        tried = record.due_in() <= 0
        written = 0
        if tried and record.write():
            written, batches, saved = batches, 0, gridded
        if mark.due_in() <= 0:
            mark.keep()
        fails = record.error or mark.error
        if tried or fails != told:
            told = fails
            with contextlib.suppress(ConnectionError):  # the kart server has ended
                end.sendall(pack(Written(written, fails, saved)))
