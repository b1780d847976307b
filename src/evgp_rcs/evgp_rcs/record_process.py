# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
The record's process: it alone waits for the disk.

The kart server forks it before it does anything else, and hands everything over by a socket pair.
What the disk has not taken is bounded by `MOST_UNWRITTEN_BYTES`; beyond that it is lost, and
`RecordProcess.trouble` says so. When the kart server ends, however it does, this process writes
what has reached it and ends too. When this process ends, hangs or is frozen, the record fails:
karts go on, and no race starts.
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

from evgp_rcs.channel import (
    Batch,
    End,
    LocalEnd,
    Opened,
    pack,
    PAIR_BYTES,
    Refused,
    Remember,
    Rules,
    Unpacker,
    Written,
)
from evgp_rcs.inputs import Block, Setup
from evgp_rcs.race import RaceMemory
from evgp_rcs.record import Record, RecordError

MOST_UNWRITTEN_BYTES = 80 * 2**20
"""Maximum backlog of events and inputs that are not on the disk, in bytes; what comes after them
is lost. An hour of racing with 20 karts."""

SLOW = 2.0
"""Time an event may wait before `RecordProcess.trouble` speaks of it, in seconds."""

_PR_SET_PDEATHSIG = 1  # of linux/prctl.h


class RecordProcess:
    """
    The record, as the kart server sees it; nothing here waits, but for the beginning and ``end``.

    :param path: the file of the record.
    :raises RecordError: if it cannot be used at all.
    """

    def __init__(self, path: pathlib.Path) -> None:
        """Start the process, and wait until it knows what the last run left."""
        self._path = path
        end, other = socket.socketpair()
        self.pid = os.fork()
        if not self.pid:
            _live(path, other)
        other.close()
        self._end = LocalEnd(end)
        self._socket = end
        self._unwritten: deque[tuple[int, int]] = deque()  # of each batch: events, bytes
        self._batches = 0  # that were written
        self._events = 0  # that were not written
        self._bytes = 0
        self._lost = 0
        self._full = False
        self._caught_up_at = time.monotonic()
        self._confirm: dict[int, Callable[[bool], None]] = {}
        self._confirms = 0
        self._remembered: RaceMemory | None = None
        try:
            opened = self._end.first()
        except EOFError:
            opened = Refused(f'{path} cannot be used: its process has failed')
        if isinstance(opened, Refused):
            end.close()
            os.waitpid(self.pid, 0)
            raise RecordError(opened.text)
        self._error: str = opened.error
        self.left_behind: RaceMemory | None = opened.left_behind
        """What is known of the last run; None: nothing."""

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Take what comes in this loop."""
        self._end.attach(loop, self.look)

    def begin(self, rules: str, setup: Setup) -> None:
        """Have written with what the rules begin, and their version."""
        self._end.send(pack(Rules(rules, setup)))

    def put(self, events: int, happened: bytes, inputs: Block) -> None:
        """
        Have events written, and what went into the rules up to them.

        :param events: how many there are.
        :param happened: a packed ``Happened``; empty: none.
        """
        size = len(happened) + len(inputs.data)
        if self._end.gone or self._bytes + size > MOST_UNWRITTEN_BYTES:
            self._lost += events
            self._full = True
            return
        if not self._events:
            self._caught_up_at = time.monotonic()
        self._unwritten.append((events, size))
        self._events += events
        self._bytes += size
        self._end.send(pack(Batch(happened, inputs)))

    def remember(self, memory: RaceMemory, at: float) -> None:
        """Save this for the next run; see ``Record.remember``."""
        if memory != self._remembered:
            self._remembered = memory
            self._end.send(pack(Remember(memory, at)))

    def make_sure(self, memory: RaceMemory, at: float, done: Callable[[bool], None]) -> None:
        """
        Save this for the next run, in the file itself.

        :param done: is called in the loop with whether it is there; never, if that is not known.
        """
        self._confirms += 1
        self._confirm[self._confirms] = done
        self._remembered = memory
        self._end.send(pack(Remember(memory, at, self._confirms)))

    def look(self) -> None:
        """Take in what has come."""
        for batches, error, confirmed in self._end.receive():
            while self._batches < batches:
                self._batches += 1
                events, size = self._unwritten.popleft()
                self._events -= events
                self._bytes -= size
            self._error = error
            self._full &= bool(self._unwritten)
            for number in confirmed:
                self._confirm.pop(number)(not error)

    def trouble(self) -> str:
        """Return why the record fails, as a sentence for an official; empty: it does not."""
        # Not the clock of the rules: a disk is not slow because the machine was suspended.
        now = time.monotonic()
        if not self._events:
            self._caught_up_at = now
        reason = self._error
        if self._end.gone:
            reason = 'its process has ended. Restart race control when no kart is out'
        elif not reason and now - self._caught_up_at > SLOW:
            reason = f'nothing could be written for {now - self._caught_up_at:.0f} s'
        elif not reason and self._full:
            reason = 'more comes than the disk takes'
        if not reason:
            return ''
        lost = f', {self._lost} are lost' if self._lost else ''
        wait = 'event waits' if self._events == 1 else 'events wait'
        return f'The record {self._path} fails: {reason}; {self._events} {wait}{lost}'

    def end(self, timeout: float, in_order: bool) -> None:
        """
        Have what is left written, and that this run has ended.

        :param timeout: wait no longer than this, s.
        :param in_order: the next run need not take up a race that was not under way.
        """
        until = time.monotonic() + timeout
        self._end.send_the_rest(End(in_order), timeout=timeout)
        self._socket.settimeout(max(until - time.monotonic(), 0.01))
        with contextlib.suppress(TimeoutError, ChildProcessError):
            try:
                while self._socket.recv(PAIR_BYTES) and time.monotonic() < until:
                    pass
            except ConnectionError:
                pass  # it has ended without a look at the last messages
            if time.monotonic() < until:
                os.waitpid(self.pid, 0)  # nothing of it is left when the kart server ends
        self._socket.close()


# ----- the process itself ---------------------------------------------------------------------


def _live(path: pathlib.Path, end: socket.socket) -> None:
    """Be the record's process, and end."""
    code = 1
    try:
        # Nothing of the kart server may stay open when that ends: not the ROS half's pair.
        os.closerange(3, end.fileno())
        os.closerange(end.fileno() + 1, os.sysconf('SC_OPEN_MAX'))
        # It ends with the kart server; a frozen one goes on then.
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT):
            signal.signal(number, signal.SIG_IGN)
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGCONT)
        _write(path, end)
        code = 0
    except BaseException:  # noqa: BLE001 - there is nobody to raise it to
        traceback.print_exc()
    finally:
        os._exit(code)


def _write(path: pathlib.Path, end: socket.socket) -> None:
    try:
        record = Record(path)
    except RecordError as error:
        end.sendall(pack(Refused(str(error))))
        return
    end.sendall(pack(Opened(record.left_behind, record.error)))
    unpacker = Unpacker()
    batches = written = 0
    confirm: list[int] = []
    while True:
        if select.select([end], [], [], record.due_in())[0]:
            try:
                data = end.recv(1 << 20)
            except ConnectionResetError:
                data = b''
            if not data:
                record.end(in_order=False)
                return
            for message in unpacker.feed(data):
                if isinstance(message, Batch):
                    batches += 1
                    happened = list(Unpacker().feed(message.happened))
                    record.put(
                        [event for each in happened for event in each.events], message.inputs
                    )
                elif isinstance(message, Remember):
                    record.remember(message.memory, message.at, bool(message.confirm))
                    confirm += [message.confirm] if message.confirm else []
                elif isinstance(message, Rules):
                    record.begin(message.version, message.setup)
                else:
                    assert isinstance(message, End)
                    record.end(message.in_order)
                    return
        due = record.due_in()
        tried = due is not None and due <= 0
        if tried and record.write():
            written = batches
        if tried or (record.error and confirm):
            with contextlib.suppress(ConnectionError):  # the kart server has ended: see above
                end.sendall(pack(Written(written, record.error, tuple(confirm))))
            confirm.clear()
