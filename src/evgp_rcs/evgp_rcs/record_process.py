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

The kart server forks this process before it does anything else, and sends it everything over a
socket pair. At most `MOST_UNWRITTEN_BYTES` wait for the disk; what comes beyond that is lost, and
`RecordProcess.trouble` says so. When the kart server ends, in whatever way, this process writes
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
from evgp_rcs.race import LastRun, RaceMemory
from evgp_rcs.record import Record, RecordError

MOST_UNWRITTEN_BYTES = 80 * 2**20
"""Maximum backlog of events and inputs that are not on the disk; what comes beyond it is lost.
Enough for an hour of racing with 20 karts. In bytes."""

SLOW = 2.0
"""Time for which an event may wait before `RecordProcess.trouble` reports it, in seconds."""

_PR_SET_PDEATHSIG = 1  # of linux/prctl.h


class RecordProcess:
    """
    The record, as the kart server sees it; only ``__init__`` and ``end`` wait.

    :param path: the file of the record.
    :raises RecordError: if the file cannot be used at all.
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
        self._unwritten: deque[tuple[int, int]] = deque()  # events, bytes of each batch
        self._batches = 0  # written
        self._events = 0  # not yet written
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
        """What is known of the last run; None if nothing is."""
        self.last_run: LastRun = opened.last_run

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Read the process's messages in this loop."""
        self._end.attach(loop, self.look)

    def begin(self, rules: str, setup: Setup) -> None:
        """Record the version of the rules, and what they begin with."""
        self._end.send(pack(Rules(rules, setup)))

    def put(self, events: int, happened: bytes, inputs: Block) -> None:
        """
        Record events, and the inputs of the rules up to them.

        :param events: the number of events.
        :param happened: a packed ``Happened``; empty if there are no events.
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
        # Where the process hangs, it is kept for when it goes on.
        if memory != self._remembered and self._end.unsent <= MOST_UNWRITTEN_BYTES:
            self._remembered = memory
            self._end.send(pack(Remember(memory, at)))

    def make_sure(self, memory: RaceMemory, at: float, done: Callable[[bool], None]) -> None:
        """
        Save this for the next run, and report when the file has it.

        :param done: called in the loop with whether the file has it; never called if that is not
            known.
        """
        self._confirms += 1
        self._confirm[self._confirms] = done
        self._remembered = memory
        self._end.send(pack(Remember(memory, at, self._confirms)))

    def look(self) -> None:
        """Read the messages that have come from the process."""
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
        """Return why the record fails, as a sentence for an official; empty if it does not."""
        # Not the clock of the rules, which counts a suspend: that does not make a disk slow.
        now = time.monotonic()
        if not self._events:
            self._caught_up_at = now
        reason = self._error
        if self._end.gone:
            reason = 'its process has ended. Restart race control when no kart is on the track'
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
        Record what is left, and that this run has ended.

        :param timeout: maximum time to wait, in seconds.
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
                pass  # it has ended without reading the last messages
            if time.monotonic() < until:
                os.waitpid(self.pid, 0)  # it must not outlive the kart server
        self._socket.close()


# ----- the process itself ---------------------------------------------------------------------


def wake_when_the_parent_dies() -> None:
    """Have this process, should it be stopped, go on when its parent dies: it finds that out."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGCONT)


def _live(path: pathlib.Path, end: socket.socket) -> None:
    """Run the record's process until it ends."""
    code = 1
    try:
        # The kart server's files, such as the ROS half's pair, must close when it ends.
        os.closerange(3, end.fileno())
        os.closerange(end.fileno() + 1, os.sysconf('SC_OPEN_MAX'))
        # It ends with the kart server. SIGCONT wakes it then, if it is frozen.
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT):
            signal.signal(number, signal.SIG_IGN)
        wake_when_the_parent_dies()
        _write(path, end)
        code = 0
    except BaseException:  # noqa: BLE001 - no caller can catch it
        traceback.print_exc()
    finally:
        os._exit(code)


def _write(path: pathlib.Path, end: socket.socket) -> None:
    try:
        record = Record(path)
    except RecordError as error:
        end.sendall(pack(Refused(str(error))))
        return
    end.sendall(pack(Opened(record.left_behind, record.last_run, record.error)))
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
