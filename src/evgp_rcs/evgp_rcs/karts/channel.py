# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What the processes of race control say to each other, over local socket pairs.

The *kart server* (``karts.process``) has one pair with the *ROS half* (``ros.node``) and one with
the *record* (``karts.record_process``). Each message is one of the classes below, a ``Snapshot``
or ``Batch``, pickled, behind its length. All are this package and nobody else can reach a pair, so
pickle is safe here.

No ROS, no thread, no clock.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
import contextlib
from dataclasses import dataclass
import pathlib
import pickle
import socket
import struct
from typing import Any, NamedTuple

from evgp_protocol.frames import DEFAULT_PORT
from evgp_protocol.link import BEAT_RATE
from evgp_rcs.rules.race import (
    Answer,
    Attendance,
    Command,
    LastRun,
    RaceMemory,
    RaceTimes,
    Roster,
    StampedEvent,
)

ANSWER_TIMEOUT = 4.0
"""Maximum time an official's call waits for its answer, in seconds; after it, no command but a
stop takes effect. A kart server that works needs no more than `RaceTimes.journal_timeout`; one
that hangs is killed before."""

PAIR_BYTES = 65536
"""Maximum read from a pair at a time, in bytes."""

_LENGTH = struct.Struct('!I')


# ----- from the ROS half to the kart server ---------------------------------------------------


@dataclass(frozen=True)
class ServerSettings:
    """
    How the kart server listens and sends.

    :param host: the IPv4 address to listen at; 0.0.0.0 is every address of the machine.
    :param port: the TCP port; 0 lets the system choose one (for tests).
    :param beat_rate: frames per second to each kart; §4.C wants at least 10 Hz.
    :param send_timeout: how long a kart may leave bytes unanswered before it counts as lost, s.
    :param snapshot_interval: the least time between two snapshots of the race, s.
    :param snapshot_at_least: the most time between two snapshots, even if nothing changed, s.
    """

    host: str = '0.0.0.0'
    port: int = DEFAULT_PORT
    beat_rate: float = BEAT_RATE
    send_timeout: float = 1.0
    snapshot_interval: float = 0.05
    snapshot_at_least: float = 0.5


@dataclass(frozen=True)
class Begin:
    """
    The first message: with what to start, and where the record is.

    :param cannot_know: why another race control at the same address cannot be ruled out, in a
        phrase; empty: it can. Where it cannot, no proof of a good end is believed.
    :param run: the id of this run; empty: the record draws one.
    """

    roster: Roster
    times: RaceTimes
    settings: ServerSettings
    record: pathlib.Path
    cannot_know: str = ''
    run: str = ''


class Request(NamedTuple):
    """
    An official's command.

    :param number: counts the requests, so that the answer finds its way back.
    :param came: when the command came, on the clock of the rules (s).
    """

    number: int
    command: Command
    came: float


class Alive(NamedTuple):
    """
    The ROS half goes on and hears officials.

    Also: whether it hears another race control, and who is there.

    :param cut_off: why karts cannot reach race control now, as a phrase: the cable or the address
        of an interface that they use is gone; empty: they can.
    """

    rival: bool
    there: Attendance = Attendance()
    cut_off: str = ''


@dataclass(frozen=True)
class End:
    """
    Send RED_RED to every kart and end.

    :param in_order: the next run need not take up a race that was not under way.
    """

    in_order: bool


# ----- from the kart server to the ROS half; and its snapshots --------------------------------


@dataclass(frozen=True)
class Listening:
    """Karts can connect, at this address and port."""

    address: tuple[str, int]


@dataclass(frozen=True)
class Refused:
    """The kart server, or the record, cannot start; the text says why and what would be right."""

    text: str


class Answered(NamedTuple):
    """The answer to a request."""

    number: int
    answer: Answer


class Happened(NamedTuple):
    """What happened, in order."""

    events: list[StampedEvent]


@dataclass(frozen=True)
class Failed:
    """The last message of a kart server that could not go on: every kart was sent RED_RED."""

    text: str


# ----- from the kart server to the record; also inputs.Batch ----------------------------------


class Remember(NamedTuple):
    """
    What the next run is to find.

    :param confirm: a number that comes back when it is on the disk or failed; 0: none does.
    """

    memory: RaceMemory
    confirm: int = 0


@dataclass(frozen=True)
class Ended:
    """
    This is all: the run has ended.

    :param ends_as: what the next run may know of it.
    """

    ends_as: LastRun


# ----- from the record to the kart server -----------------------------------------------------


@dataclass(frozen=True)
class Opened:
    """
    The first message: what is known of the last run.

    :param left_behind: what the record has of it; None: nothing.
    :param last_run: how it ended, by the mark.
    :param why: why that cannot be known, as a phrase; empty: it can.
    :param error: what fails; empty: nothing.
    """

    left_behind: RaceMemory | None
    last_run: LastRun
    why: str
    error: str


class Written(NamedTuple):
    """
    How writing went.

    :param batches: number of batches on the disk so far.
    :param error: what fails; empty: nothing.
    :param confirmed: of the memories that are on the disk now, or failed if there is an error.
    """

    batches: int
    error: str
    confirmed: tuple[int, ...]


# ----- bytes ----------------------------------------------------------------------------------


def pack(message: object) -> bytes:
    """Return a message as bytes."""
    data = pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
    return _LENGTH.pack(len(data)) + data


class Unpacker:
    """Cuts the bytes of one direction into messages."""

    def __init__(self) -> None:
        self._data = bytearray()

    def feed(self, data: bytes) -> Iterator[Any]:
        """Yield the messages that are whole by now."""
        self._data += data
        head = _LENGTH.size
        while len(self._data) >= head:
            end = head + _LENGTH.unpack_from(self._data)[0]
            if len(self._data) < end:
                return
            message = pickle.loads(bytes(self._data[head:end]))  # noqa: S301 - see above
            del self._data[:end]
            yield message


class LocalEnd:
    """
    The kart server's end of a pair; nothing here waits, but for `first` and `send_the_rest`.

    :ivar gone: why the other end is gone; empty: it is there.
    """

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._unpacker = Unpacker()
        self._unsent = bytearray()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._on_news: Callable[[], None] = lambda: None
        self.gone = ''

    def first(self) -> Any:
        """
        Wait for the first message.

        :raises EOFError: if the other end ends before.
        """
        while data := self._end.recv(PAIR_BYTES):
            for message in self._unpacker.feed(data):
                return message
        raise EOFError('the other end ended before it began')

    def attach(self, loop: asyncio.AbstractEventLoop, on_news: Callable[[], None]) -> None:
        """Call something in this loop when there is something to receive, or it is gone."""
        self._loop = loop
        self._on_news = on_news
        self._end.setblocking(False)
        loop.add_reader(self._end, on_news)

    @property
    def unsent(self) -> int:
        """Return the number of bytes that the other end has not taken yet."""
        return len(self._unsent)

    def receive(self) -> Iterator[Any]:
        """Yield the messages that have come."""
        while not self.gone:
            try:
                data = self._end.recv(PAIR_BYTES)
            except BlockingIOError:
                return
            except OSError as error:
                self.lose(str(error))
                return
            if not data:
                self.lose('it has ended')
                return
            yield from self._unpacker.feed(data)
            if len(data) < PAIR_BYTES:
                return

    def send(self, data: bytes) -> None:
        """Send a packed message; what the other end does not take now waits here."""
        if not self.gone:
            self._unsent += data
            self._flush()

    def send_the_rest(self, *messages: object, timeout: float) -> None:
        """Send all that waits and the last messages, as long as the other end takes it."""
        if self.gone:
            return  # half a message may be out: what follows could not be read
        self._unsent += b''.join(map(pack, messages))
        with contextlib.suppress(OSError):  # it is gone, or does not take it: the end either way
            self._end.settimeout(timeout)
            self._end.sendall(self._unsent)

    def lose(self, why: str) -> None:
        """Give the other end up."""
        self.gone = why
        self._unsent.clear()
        if self._loop is not None:
            self._loop.remove_reader(self._end)
            self._loop.remove_writer(self._end)
            self._loop.call_soon(self._on_news)

    def _flush(self) -> None:
        try:
            while self._unsent:
                sent = self._end.send(self._unsent)
                del self._unsent[:sent]
        except BlockingIOError:
            if self._loop is not None:
                self._loop.add_writer(self._end, self._flush)
            return
        except OSError as error:
            self.lose(str(error))
        if self._loop is not None:
            self._loop.remove_writer(self._end)
