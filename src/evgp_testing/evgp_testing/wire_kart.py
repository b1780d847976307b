# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A kart without ROS, which is a TCP client like those of today's teams, well-behaved or not.

It finds whole frames itself, and counts anything else as malformed. It does not use the decoder of
race control and the bridge, so a mistake in that decoder cannot hide one on the wire.
"""

from __future__ import annotations

import contextlib
import math
import re
import socket
import struct
import threading
import time

from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState
from evgp_testing.part import Part, PATIENCE
from evgp_testing.witness import Witness

FRAMES = {encode(state): state for state in RaceState}
"""Every frame that race control may send."""

# The frames that race control accepts; `$READY;` means GRID_ACTIVE (§3.A).
_SAID = re.compile(rb'\$(GREEN_GREEN|GRID_ACTIVE|IN_GARAGE|RED_FLAG|RED_RED|READY);')


def kart_socket(
    address: str, to: tuple[str, int], receive_buffer: int = 0, timeout: float = PATIENCE
) -> socket.socket:
    """
    Connect to race control from a kart's address.

    :param receive_buffer: size in bytes; 0 for the usual size.
    :param timeout: timeout of this and all later operations of the socket, in seconds.
    :raises OSError: if race control cannot be reached.
    """
    kart = socket.socket()
    try:
        kart.settimeout(timeout)
        if receive_buffer:
            kart.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        kart.bind((address, 0))
        kart.connect(to)
        kart.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    except BaseException:
        kart.close()
        raise
    return kart


def read_until(kart: socket.socket, state: RaceState) -> bytes:
    """Return everything up to and including the first frame of this state."""
    wanted, heard = encode(state), b''
    while wanted not in heard:
        data = kart.recv(4096)
        assert data, f'the connection ended; heard {heard!r}'
        heard += data
    before, *_ = heard.partition(wanted)
    return before + wanted


def read_to_end(kart: socket.socket) -> bytes:
    """Return everything that arrives until the connection ends in any way."""
    heard = b''
    with contextlib.suppress(ConnectionError):
        while data := kart.recv(4096):
            heard += data
    return heard


class KartLink:
    """
    One connection of a plain kart, whose owner reads it with ``take``.

    ``changes`` are the states that the kart was sent, each with the monotonic time (s) of its
    first frame. ``times`` are the times of all frames, and ``malformed`` contains the bytes that
    are not frames. The kart opened the connection after ``opened``, and had closed it at
    ``closed_at``, which is infinite until then.

    :param address: the kart's own address, by which race control knows it.
    :param to: race control's address and port.
    :param witness: learns of this connection, with `kart` as the kart's number.
    :raises OSError: if race control cannot be reached.
    """

    def __init__(
        self,
        address: str,
        to: tuple[str, int],
        witness: Witness | None = None,
        kart: int = 0,
        receive_buffer: int = 0,
        timeout: float = PATIENCE,
    ) -> None:
        self.opened = time.monotonic()
        self.closed_at = math.inf
        self.socket = kart_socket(address, to, receive_buffer, timeout)
        self.address = address
        self.kart = kart
        self.changes: list[tuple[float, RaceState]] = []
        self.times: list[float] = []
        self.malformed: list[bytes] = []
        self._unread = b''
        # Each piece, and times before and after it was sent.
        self._sent: list[tuple[bytes, float, float]] = []
        self._sending = threading.Lock()
        if witness is not None:
            witness.links.append(self)

    @property
    def state(self) -> RaceState | None:
        """Return the last state that the kart was sent; None before the first frame."""
        return self.changes[-1][1] if self.changes else None

    @property
    def frames(self) -> int:
        """Return the number of frames that the kart was sent."""
        return len(self.times)

    @property
    def said(self) -> list[tuple[RaceState, float, float]]:
        """Return the frames that the kart sent, each with times (s) before and after that."""
        pieces = iter(self._sent)
        end, before, after, found = 0, 0.0, 0.0, []
        for match in _SAID.finditer(b''.join(data for data, _, _ in self._sent)):
            while end < match.end():
                data, before, after = next(pieces)
                end += len(data)
            state = RaceState(match[1].decode().replace('READY', 'GRID_ACTIVE'))
            found.append((state, before, after))
        return found

    def take(self) -> list[tuple[RaceState, bool]] | None:
        """Read the available data; return each state, and whether it is new. None at the end."""
        data = self.receive()
        return None if data == b'' else self.note(data or b'')

    def receive(self) -> bytes | None:
        """Return the available bytes, which are empty at the end; None if there are none yet."""
        try:
            return self.socket.recv(1 << 16)
        except BlockingIOError:
            return None
        except OSError:
            return b''

    def note(self, data: bytes) -> list[tuple[RaceState, bool]]:
        """Process the bytes that were read. For the rest, see ``take``."""
        now = time.monotonic()
        *frames, self._unread = (self._unread + data).split(b';')
        heard = []
        for frame in frames:
            state = FRAMES.get(frame + b';')
            if state is None:
                self.malformed.append(frame + b';')
                continue
            change = state is not self.state
            if change:
                self.changes.append((now, state))
            self.times.append(now)
            heard.append((state, change))
        return heard

    def say(self, *states: RaceState) -> None:
        """Send frames, whether they are due or not."""
        self.send(b''.join(map(encode, states)))

    def send(self, data: bytes) -> None:
        """
        Send bytes, whatever they are.

        :raises OSError: if not all of them could be sent, for example on a full non-blocking
            socket.
        """
        with self._sending:  # otherwise two threads might note their pieces in another order
            while data:
                before = time.monotonic()
                sent = self.socket.send(data)
                self._sent.append((data[:sent], before, time.monotonic()))
                data = data[sent:]

    def half_close(self) -> None:
        """Close the sending half of the connection, and continue to listen."""
        with contextlib.suppress(OSError):  # it is gone; the reader notices next
            self.socket.shutdown(socket.SHUT_WR)
            self.closed_at = min(self.closed_at, time.monotonic())

    def end(self, reset: bool = False) -> None:
        """
        Close the connection.

        :param reset: reset the connection, like a machine that no longer knows it.
        """
        if reset:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', 1, 0))
        self.socket.close()
        self.closed_at = min(self.closed_at, time.monotonic())


class WireKart(KartLink, Part):
    """
    A plain TCP kart that reads all the time. For most of its attributes, see ``KartLink``.

    ``ended`` is true once the connection is gone. A method that waits raises AssertionError if
    what it waits for does not come within ``PATIENCE``.

    :param acknowledges: whether it acknowledges each new state. You can change this any time.
    :param host: race control's address.
    :param timeout: maximum time to connect, in seconds.
    """

    def __init__(
        self,
        address: str,
        port: int,
        acknowledges: bool = False,
        host: str = '127.0.0.1',
        witness: Witness | None = None,
        kart: int = 0,
        timeout: float = PATIENCE,
    ) -> None:
        super().__init__(address, (host, port), witness, kart, timeout=timeout)
        self.acknowledges = acknowledges
        self.ended = False
        self._news = threading.Condition()
        self.socket.settimeout(None)
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def answer(self, state: RaceState, change: bool) -> None:
        """
        Answer a frame, in the thread that reads. Subclasses may answer differently.

        :param change: whether the state differs from the one before.
        """
        if change and self.acknowledges:
            with contextlib.suppress(OSError):  # it is gone; the reader notices next
                self.say(state)

    def wait_for_state(self, state: RaceState) -> float:
        """Wait for a state; return the monotonic time (s) of its present run's first frame."""
        with self._news:
            self._news.wait_for(lambda: self.state is state, PATIENCE)
            assert self.changes, f'{self.address} was sent nothing'
            at, last = self.changes[-1]
            assert last is state, f'{self.address} is sent {last.value}, not {state.value}'
            return at

    def wait_for_frames(self, count: int) -> None:
        """Wait until this many more frames have come."""
        with self._news:
            wanted = self.frames + count
            self._news.wait_for(lambda: self.frames >= wanted or self.ended, PATIENCE)
            assert self.frames >= wanted, (
                f'{self.address} was sent too few frames, in the end {self.state}, and its'
                f' connection {"ended" if self.ended else "is still open"}'
            )

    def wait_for_end(self) -> None:
        """Wait until the connection is gone."""
        with self._news:
            assert self._news.wait_for(lambda: self.ended, PATIENCE), 'it is still connected'

    def close(self) -> None:
        with contextlib.suppress(OSError):  # the other end was quicker
            self.socket.shutdown(socket.SHUT_RDWR)
            self.closed_at = time.monotonic()
        self._thread.join(PATIENCE)
        self.socket.close()

    def _read(self) -> None:
        while data := self.receive():
            with self._news:
                heard = self.note(data)
                self._news.notify_all()
            for state, change in heard:
                self.answer(state, change)
        with self._news:
            self.ended = True
            self._news.notify_all()
