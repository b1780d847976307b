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
The kart server's process: rules, karts' sockets, beat and record, without ROS.

The ROS half (``node``) starts it, and the two are joined by one local socket pair (``channel``).
Neither outlives the other. When the ROS half ends, or is silent for `ROS_HALF_SILENCE`, no
official could stop a kart any more: every kart is sent RED_RED, and this process ends.

Two threads: the main one runs the kart server's loop, the other writes the record to the disk.
When the ROS half is slow, events for it wait here; copies of the race are left out.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
import contextlib
import ctypes
import gc
import os
import signal
import socket
import sys
from typing import Any

from evgp_protocol import clock
from evgp_rcs import priority
from evgp_rcs.channel import (
    Alive,
    Answered,
    Begin,
    Copy,
    End,
    Failed,
    Happened,
    Listening,
    pack,
    Published,
    Refused,
    Request,
    Unpacker,
    Withdraw,
)
from evgp_rcs.inputs import Block, Entrant, Recovered, Setup
from evgp_rcs.kart_server import (
    KartServer,
    KartServerError,
    RosHalfGoneError,
    Waiting,
)
from evgp_rcs.race import Answer, Event, EventKind, Race, RaceMemory, StampedEvent
from evgp_rcs.record import Record, RecordError
from evgp_rcs.rules_version import rules_version

LOOP_SWITCH_INTERVAL = 0.00001
"""Time after which the record's thread hands the interpreter to the loop's, in seconds. With
Python's usual 5 ms, a stop waits as long while the record prepares what it writes."""

FIRST_SIGN = 2.0
"""Additional time for the first sign of life of the ROS half, in seconds: it still starts."""

LAST_WORDS_TIMEOUT = 2.0
"""Maximum time at the end for the record to be finished, and for the ROS half to take the last
messages, each, in seconds."""

TO_ROS_HALF_BYTES = 64 * 2**20
"""Maximum backlog to the ROS half, in bytes; beyond it, the ROS half counts as gone."""

FROM_ROS_HALF_BYTES = 65536
"""Maximum read from the ROS half at a time, in bytes."""

_PR_SET_PDEATHSIG = 1  # of linux/prctl.h


class RosHalf:
    """
    The other end of the socket pair, as the kart server sees it; its loop's thread only.

    :param end: the kart server's end of the pair.
    """

    def __init__(self, end: socket.socket) -> None:
        """Say nothing yet."""
        self._end = end
        self._unpacker = Unpacker()
        self._unsent = bytearray()
        self._gone = ''
        self._heard_at: float | None = None
        self._waiting: dict[int, Waiting] = {}
        self._server: KartServer | None = None
        self._loop: Any = None

    def wait_for_begin(self) -> Begin:
        """
        Return the first message.

        :raises EOFError: if the ROS half ends before.
        """
        while True:
            data = self._end.recv(FROM_ROS_HALF_BYTES)
            if not data:
                raise EOFError('the ROS half ended before it began')
            for message in self._unpacker.feed(data):
                assert isinstance(message, Begin)
                return message

    def attach(self, server: KartServer, loop: Any) -> None:
        """Hand everything that comes to this server from now on."""
        self._server = server
        self._loop = loop
        self._end.setblocking(False)
        loop.add_reader(self._end, server.take_commands)

    def look(self) -> None:
        """Take in what has come, without waiting."""
        while not self._gone:
            try:
                data = self._end.recv(FROM_ROS_HALF_BYTES)
            except BlockingIOError:
                return
            except OSError as error:
                self._lose(str(error))
                return
            if not data:
                self._lose('it has ended')
                return
            for message in self._unpacker.feed(data):
                self._take(message)
            if len(data) < FROM_ROS_HALF_BYTES:
                return

    def expect(self, allowance: float) -> None:
        """Expect a sign of life from now on; the first one may take this much longer (s)."""
        self._heard_at = clock.now() + allowance

    def silent_since(self) -> float | None:
        """Return when it was heard last (s); None while nothing is expected of it."""
        return self._heard_at

    def send(self, message: object) -> None:
        """Send a message; what the other end does not take now waits here."""
        if self._gone:
            return
        self._unsent += pack(message)
        self._flush()
        if len(self._unsent) > TO_ROS_HALF_BYTES:
            self._lose('it takes nothing any more')

    def show(self, race: Race, at: float, number: int) -> None:
        """Send a copy of the race, unless something still waits to be sent."""
        if not self._unsent:
            self.send(Copy(race, at, number))

    def send_the_rest(self, *messages: object, timeout: float) -> None:
        """Send all that waits and the last messages, as long as the other end takes it."""
        if self._gone:
            return  # half a message may be out: what follows could not be read
        self._unsent += b''.join(map(pack, messages))
        with contextlib.suppress(OSError):  # it is gone, or does not take it: the end either way
            self._end.settimeout(timeout)
            self._end.sendall(self._unsent)

    def _take(self, message: Any) -> None:
        assert self._server is not None
        server = self._server
        if isinstance(message, Published):
            # Whoever publishes takes no stops: this must not count as a sign of life.
            server.published(message.number, message.digest)
            return
        self._heard_at = clock.now()
        if isinstance(message, Request):
            number = message.number

            def answered(answer: Answer) -> None:
                self._waiting.pop(number, None)
                self.send(Answered(number, answer))

            self._waiting[number] = server.submit(message.command, answered, message.came)
        elif isinstance(message, Withdraw):
            waiting = self._waiting.pop(message.number, None)
            if waiting is not None:
                waiting.withdrawn = True
        elif isinstance(message, Alive):
            server.rival(message.rival)
        elif isinstance(message, End):
            server.end(None if message.in_order else RosHalfGoneError('the ROS half failed'))
        else:
            raise TypeError(f'the ROS half sent {message!r}')

    def _flush(self) -> None:
        try:
            while self._unsent:
                sent = self._end.send(self._unsent)
                del self._unsent[:sent]
        except BlockingIOError:
            self._loop.add_writer(self._end, self._flush)
            return
        except OSError as error:
            self._lose(str(error))
        self._loop.remove_writer(self._end)

    def _lose(self, why: str) -> None:
        assert self._server is not None
        self._gone = why
        self._unsent.clear()
        self._loop.remove_reader(self._end)
        self._loop.remove_writer(self._end)
        self._server.end(RosHalfGoneError(f'the ROS half is gone: {why}'))


class World:
    """The kart server's ``Outside``: the ROS half, and the record."""

    def __init__(self, ros_half: RosHalf, record: Record) -> None:
        """Join the two."""
        self._ros_half = ros_half
        self._record = record
        self._loop: Any = None
        self.look = ros_half.look
        self.silent_since = ros_half.silent_since
        self.show = ros_half.show
        self.remember = record.remember
        self.trouble = record.trouble

    def attach(self, loop: Any) -> None:
        """Call back in this loop."""
        self._loop = loop

    def tell(self, events: list[StampedEvent], log: Block) -> None:
        """Send the events on, and have them recorded."""
        self._record.put(events, log)
        if events:
            self._ros_half.send(Happened(events))

    def make_sure(self, memory: RaceMemory, at: float, done: Callable[[bool], None]) -> None:
        """Have this on the disk, then call ``done`` in the loop."""
        self._record.make_sure(memory, at, lambda there: _call(self._loop, done, there))


def _call(loop: Any, work: Callable[..., None], *arguments: object) -> None:
    """Call something in the loop, from another thread; one that has ended needs it no more."""
    with contextlib.suppress(RuntimeError):
        loop.call_soon_threadsafe(work, *arguments)


def setup_of(begin: Begin, now: float) -> Setup:
    """Return with what the rules begin: every kart of the roster."""
    entries = begin.roster.entries
    return Setup(
        tuple(
            Entrant(entry.number, entry.team, entry.in_race, entry.inspected) for entry in entries
        ),
        begin.times,
        begin.roster.heats,
        now,
    )


async def serve(begin: Begin, ros_half: RosHalf, world: World, record: Record) -> None:
    """
    Run the kart server until it is to end.

    :raises KartServerError: if it cannot start.
    :raises BaseException: what ended it.
    """
    loop = asyncio.get_running_loop()
    setup = setup_of(begin, loop.time())
    record.begin(rules_version(), setup)
    race = setup.race()
    server = KartServer(
        race,
        {entry.address: entry.number for entry in begin.roster.entries},
        begin.settings,
        world,
        Recovered(loop.time(), record.left_behind),
    )
    record.remember(race.memory(), loop.time())

    def record_failed(error: BaseException) -> None:
        _call(loop, _part_failed, server, error)

    record.start(record_failed)
    priority.come_first(priority.LOOP)
    world.attach(loop)
    ros_half.attach(server, loop)
    # Its own signals end it in order too; those of a terminal reach the ROS half only.
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT):
        loop.add_signal_handler(number, server.end)
    signal.signal(signal.SIGTSTP, signal.SIG_IGN)
    # The race and its karts stay: the search for garbage need not go through them every time.
    gc.collect()
    gc.freeze()

    def listening(address: tuple[str, int]) -> None:
        ros_half.expect(FIRST_SIGN)
        ros_half.send(Listening(address))

    await server.serve(listening)


def _part_failed(server: KartServer, error: BaseException) -> None:
    """End in order because a part of race control has: every kart is sent RED_RED."""
    text = f'Use the MSR if a kart still moves: the record has failed ({error}); RED_RED is sent'
    server.report(Event(EventKind.ALERT_RAISED, text, success=False))
    server.end(error)


def main(arguments: list[str] | None = None) -> int:
    """
    Run the kart server for the ROS half at the other end of an inherited socket.

    :param arguments: the number of its file descriptor.
    :return: 0 after an orderly end, 1 after a failure, 2 if it could not start.
    """
    (descriptor,) = sys.argv[1:] if arguments is None else arguments
    # One that was stopped goes on when the ROS half has died: it finds that out, and ends.
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGCONT)
    sys.setswitchinterval(LOOP_SWITCH_INTERVAL)
    priority.come_first(priority.RECORD)
    with socket.socket(fileno=int(descriptor)) as end:
        ros_half = RosHalf(end)
        try:
            begin = ros_half.wait_for_begin()
        except EOFError:
            return 1
        try:
            record = Record(begin.record)
        except RecordError as error:
            ros_half.send_the_rest(Refused(str(error)), timeout=LAST_WORDS_TIMEOUT)
            return 2
        try:
            clock.run(serve(begin, ros_half, World(ros_half, record), record))
        except KartServerError as error:
            # No kart was sent anything: what the last run left is what this one leaves.
            record.end(LAST_WORDS_TIMEOUT, in_order=True)
            ros_half.send_the_rest(Refused(str(error)), timeout=LAST_WORDS_TIMEOUT)
            return 2
        except BaseException as error:
            record.end(LAST_WORDS_TIMEOUT, in_order=False)
            ros_half.send_the_rest(Failed(_in_words(error)), timeout=LAST_WORDS_TIMEOUT)
            if not isinstance(error, RosHalfGoneError):
                raise
            with contextlib.suppress(PermissionError):  # it has died, and this is another
                os.kill(os.getppid(), signal.SIGCONT)  # one that was stopped finds this, and ends
            return 1
        record.end(LAST_WORDS_TIMEOUT, in_order=True)
        ros_half.send_the_rest(timeout=LAST_WORDS_TIMEOUT)
        return 0


def _in_words(error: BaseException) -> str:
    return str(error) or type(error).__name__


if __name__ == '__main__':
    sys.exit(main())
