"""A kart without ROS: a TCP client, as teams have them today."""

from __future__ import annotations

import enum
import socket
import threading
import time

from evgp_protocol.frames import encode, FrameDecoder, MalformedFrame, StateFrame
from evgp_protocol.states import RaceState
from evgp_testing.process import PATIENCE


class Acknowledges(enum.Enum):
    """When a plain kart says back what it is sent."""

    NEVER = enum.auto()
    EACH_CHANGE = enum.auto()
    EACH_FRAME = enum.auto()


class WireKart:
    """
    A plain TCP kart, bound to an address of its own.

    ``changes`` are the states it was sent, each with the monotonic time (s) of its first frame;
    ``frames`` counts all frames; ``ended`` is true once the connection is gone.

    :param address: its own address, by which race control knows it.
    :raises OSError: if race control cannot be reached.
    """

    def __init__(
        self,
        address: str,
        port: int,
        acknowledges: Acknowledges = Acknowledges.NEVER,
        host: str = '127.0.0.1',
    ) -> None:
        """Connect."""
        self.address = address
        self.changes: list[tuple[float, RaceState]] = []
        self.frames = 0
        self.malformed: list[MalformedFrame] = []
        self.ended = False
        self._acknowledges = acknowledges
        self._news = threading.Condition()
        self.socket = socket.create_connection(
            (host, port), timeout=PATIENCE, source_address=(address, 0)
        )
        self.socket.settimeout(None)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    @property
    def state(self) -> RaceState | None:
        """Return the state it was sent last; None before the first frame."""
        with self._news:
            return self.changes[-1][1] if self.changes else None

    def say(self, *states: RaceState) -> None:
        """Send frames, asked or unasked."""
        self.send(b''.join(encode(state) for state in states))

    def send(self, data: bytes) -> None:
        """Send bytes, whatever they are."""
        self.socket.sendall(data)

    def wait_for_state(self, state: RaceState) -> float:
        """
        Return the time (monotonic, s) of the first frame of the present run of this state.

        :raises AssertionError: if it is not sent in time.
        """
        with self._news:
            self._news.wait_for(
                lambda: bool(self.changes) and self.changes[-1][1] is state, PATIENCE
            )
            assert self.changes, f'{self.address} was sent nothing'
            at, last = self.changes[-1]
            assert last is state, f'{self.address} is sent {last.value}, not {state.value}'
            return at

    def wait_for_frames(self, count: int) -> None:
        """
        Return once so many further frames have come.

        :raises AssertionError: if they do not come in time.
        """
        with self._news:
            wanted = self.frames + count
            self._news.wait_for(lambda: self.frames >= wanted or self.ended, PATIENCE)
            assert self.frames >= wanted, f'{self.address} was sent too few frames'

    def wait_for_end(self) -> None:
        """
        Return once the connection is gone.

        :raises AssertionError: if it does not go in time.
        """
        with self._news:
            assert self._news.wait_for(lambda: self.ended, PATIENCE), 'it is still connected'

    def close(self) -> None:
        """Disconnect."""
        try:
            self.socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass  # the other end was quicker
        self._thread.join(PATIENCE)
        self.socket.close()

    def _read(self) -> None:
        decoder = FrameDecoder()
        data = b' '
        while data:
            try:
                data = self.socket.recv(4096)
            except OSError:
                data = b''
            for heard in decoder.feed(data):
                self._hear(heard)
        with self._news:
            self.ended = True
            self._news.notify_all()

    def _hear(self, heard: StateFrame | MalformedFrame) -> None:
        with self._news:
            if isinstance(heard, MalformedFrame):
                self.malformed.append(heard)
                return
            change = not self.changes or self.changes[-1][1] is not heard.state
            if change:
                self.changes.append((time.monotonic(), heard.state))
            self.frames += 1
            self._news.notify_all()
        if self._acknowledges is Acknowledges.EACH_FRAME or (
            change and self._acknowledges is Acknowledges.EACH_CHANGE
        ):
            try:
                self.say(heard.state)
            except OSError:
                pass  # the connection is gone: the reader is told next

    def __enter__(self) -> WireKart:
        """Return this kart."""
        return self

    def __exit__(self, *exc: object) -> None:
        """Disconnect."""
        self.close()
