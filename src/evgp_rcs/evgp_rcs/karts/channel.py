# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The messages between the processes of race control, over local socket pairs.

The *kart server* (``karts.process``) shares one pair with the *ROS half* (``ros.node``) and one
with the *record* (``karts.record_process``). Each message begins with its length, followed by the
pickle of one of the classes below, a ``Snapshot`` or a ``Batch``. Pickle is safe here, because
only this package can reach the two ends of a pair.

This module does not use ROS, threads or a clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
from dataclasses import dataclass
import pathlib
import pickle
import socket
import struct
from typing import Any, NamedTuple, TYPE_CHECKING

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

if TYPE_CHECKING:
    import asyncio  # which the ROS half does not need

ANSWER_TIMEOUT = 4.0
"""Maximum time that an official's call waits for its answer, in seconds. After that, only stops
still take effect. A kart server that hangs is killed before this time has passed."""

PAIR_BYTES = 65536
"""Maximum number of bytes read from a pair at a time."""

_LENGTH = struct.Struct('!I')


class KartServerError(RuntimeError):
    """The kart server cannot start or continue. The message says why, and what to do."""


# ----- from the ROS half to the kart server ---------------------------------------------------


@dataclass(frozen=True)
class ServerSettings:
    """Settings for the kart server (``ros.settings``). In tests, the port is 0, that is, any."""

    host: str = '0.0.0.0'
    port: int = DEFAULT_PORT
    beat_rate: float = BEAT_RATE
    send_timeout: float = 1.0


@dataclass(frozen=True)
class Begin:
    """
    The first message. It contains the roster and the settings to start with.

    :param cannot_know: why the ROS half cannot rule out another race control at the same address,
        as a phrase; empty if it can. Otherwise, race control rejects any proof that the last
        run ended normally.
    """

    roster: Roster
    times: RaceTimes
    settings: ServerSettings
    record: pathlib.Path
    cannot_know: str = ''
    run: str = ''


class Request(NamedTuple):
    """
    An official's command, with a number that its answer repeats.

    :param came: when the command arrived, in seconds by the rules' clock.
    """

    number: int
    command: Command
    came: float


class Alive(NamedTuple):
    """
    A heartbeat, which shows that the ROS half can still hear officials.

    :param rival: whether the ROS half is hearing another race control.
    :param cut_off: why karts cannot reach race control now, as a phrase, such as a lost cable or
        address of an interface that they use. Empty if they can.
    """

    rival: bool
    there: Attendance = Attendance()
    cut_off: str = ''


@dataclass(frozen=True)
class End:
    """
    The order to send RED_RED to every kart, and to end.

    :param in_order: whether the end is orderly. After an orderly end without a race under way, the
        next run may begin from the roster.
    """

    in_order: bool


# ----- from the kart server to the ROS half, besides its snapshots ----------------------------


@dataclass(frozen=True)
class Listening:
    """Says that karts can now connect at this address and port."""

    address: tuple[str, int]


class Answered(NamedTuple):
    """The answer to the request with this number."""

    number: int
    answer: Answer


class Happened(NamedTuple):
    """Events, in the order in which they happened."""

    events: list[StampedEvent]


@dataclass(frozen=True)
class Failed:
    """
    The last message of a kart server that failed, or of one or a record that could not start.

    Before it, a kart server has sent RED_RED to every kart. The text says why and, if it could not
    start, what to do.
    """

    text: str


# ----- from the kart server to the record, besides inputs.Batch and RaceMemory ----------------


@dataclass(frozen=True)
class Ended:
    """The last message, when the run has ended. ``ends_as`` is for the next run."""

    ends_as: LastRun


# ----- from the record to the kart server -----------------------------------------------------


@dataclass(frozen=True)
class Opened:
    """
    The first message, with what is known about the last run.

    :param left_behind: what the record contains about the last run. None if it contains nothing.
    :param last_run: how the last run ended, according to the mark.
    :param why: why it is unknown how the last run ended, as a phrase. Empty if it is known.
    :param error: why the record is failing, as a phrase. Empty if it works.
    """

    left_behind: RaceMemory | None
    last_run: LastRun
    why: str
    error: str


class Written(NamedTuple):
    """
    What the record has written.

    :param batches: number of batches that have reached the disk since the last such message.
    :param error: why the record is failing, as a phrase. Empty if it works.
    :param gridded: `RaceMemory.gridded` of the last memory that is on the disk; 0 if none is.
    """

    batches: int
    error: str
    gridded: int


# ----- bytes ----------------------------------------------------------------------------------


def pack(message: object) -> bytes:
    """Return a message as bytes."""
    data = pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
    return _LENGTH.pack(len(data)) + data


class Unpacker:
    """A buffer that splits the bytes of one direction into messages."""

    def __init__(self) -> None:
        self._data = bytearray()

    def feed(self, data: bytes) -> Iterator[Any]:
        """Yield the messages that are now complete."""
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
    The kart server's end of a pair. Only `first` and `send_the_rest` block.

    :ivar gone: why the other end is gone. Empty while it is there.
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

        :raises EOFError: if the other end closes without a message.
        """
        while data := self._end.recv(PAIR_BYTES):
            for message in self._unpacker.feed(data):
                return message
        raise EOFError('the other end ended before it began')

    def attach(self, loop: asyncio.AbstractEventLoop, on_news: Callable[[], None]) -> None:
        """Call `on_news` in this loop when a message can be received or the other end is gone."""
        self._loop = loop
        self._on_news = on_news
        self._end.setblocking(False)
        loop.add_reader(self._end, on_news)

    @property
    def unsent(self) -> int:
        """Return the number of bytes that the other end has not accepted yet."""
        return len(self._unsent)

    def receive(self) -> Iterator[Any]:
        """Yield the messages that have arrived."""
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
        """Send a packed message. Bytes that the other end has not accepted yet wait here."""
        if not self.gone:
            self._unsent += data
            self._flush()

    def send_the_rest(self, *messages: object, timeout: float) -> None:
        """
        Send everything that is waiting, and then the last messages, if the other end accepts them.

        :param timeout: maximum time to wait, in seconds.
        """
        if self.gone:
            return  # part of a message may have been sent, so the rest would be unreadable
        self._unsent += b''.join(map(pack, messages))
        with contextlib.suppress(OSError):  # the other end is gone or stuck
            self._end.settimeout(timeout)
            self._end.sendall(self._unsent)

    def lose(self, why: str) -> None:
        """Abandon the other end, for this reason, and discard what is waiting to be sent to it."""
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
