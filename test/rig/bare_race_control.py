# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Race control's end of the wire for one kart, which does what the test says and no more."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import select
import socket
import threading
import time

from evgp_protocol.frames import encode, FrameDecoder, StateFrame
from evgp_protocol.states import RaceState
from evgp_testing.domains import free_port
from evgp_testing.part import Part, PATIENCE

BEAT = 0.05
"""Between two frames, seconds."""


class BareRaceControl(Part):
    """
    A socket that sends one state again and again to the kart that connected last.

    ``said`` is what the kart said last on its present connection, and ``malformed`` how much that
    it said was no frame.

    :param heard: called in another thread with each state that the kart says, as it comes.
    :param port: where karts connect, at 127.0.0.1; 0: at one that is free.
    """

    def __init__(
        self, heard: Callable[[RaceState], object] = lambda state: None, port: int = 0
    ) -> None:
        """Listen and beat; IN_GARAGE until told otherwise."""
        self.said: RaceState | None = None
        self.malformed = 0
        self.port = port or free_port()
        self._heard = heard
        self._state: RaceState | None = RaceState.IN_GARAGE
        self._kart: socket.socket | None = None
        self._news = threading.Condition()
        self._ending = False
        self._connections = 0
        self._listening = socket.create_server(('127.0.0.1', self.port))
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def say(self, *states: RaceState) -> float:
        """
        Send these states at once, and the last of them from now on.

        :return: the monotonic time of the first frame, s.
        """
        with self._news:
            self._state = states[-1]
            self.said = None
            self._send(*states)
        return time.monotonic()

    def fall_silent(self) -> float:
        """Send nothing any more, and keep the connection; return the monotonic time, s."""
        with self._news:
            self._state = None
        return time.monotonic()

    def send(self, data: bytes) -> None:
        """Send these bytes once."""
        with self._news:
            assert self._kart is not None
            self._kart.sendall(data)

    def hang_up(self) -> None:
        """End the connection; the kart may come back."""
        with self._news, contextlib.suppress(OSError):  # the other end was quicker
            assert self._kart is not None
            self._kart.shutdown(socket.SHUT_RDWR)

    def wait_until_it_says(self, state: RaceState) -> None:
        """
        Return once the kart has said this state since the last `say`.

        :raises AssertionError: if it does not in time.
        """
        with self._news:
            self._news.wait_for(lambda: self.said is state, PATIENCE)
            assert self.said is state, f'the kart said {self.said}'

    def exchange(self, *states: RaceState) -> None:
        """Send these states at once, and return once the kart has said the last of them."""
        self.say(*states)
        self.wait_until_it_says(states[-1])

    def wait_for_connections(self, count: int) -> None:
        """
        Return once so many connections have been made in all.

        :raises AssertionError: if they are not in time.
        """
        with self._news:
            assert self._news.wait_for(lambda: self._connections >= count, PATIENCE)

    def close(self) -> None:
        self._ending = True
        self._thread.join(PATIENCE)
        self._drop()
        self._listening.close()

    def _run(self) -> None:
        decoder, due = FrameDecoder(), 0.0
        while not self._ending:
            wait = max(0.0, due - time.monotonic())
            ends = [self._listening, *filter(None, [self._kart])]
            ready, _, _ = select.select(ends, [], [], wait)
            with self._news:
                if self._listening in ready:
                    self._drop()
                    decoder = FrameDecoder()
                    self._kart, _ = self._listening.accept()
                    self._connections += 1
                    self.said = None
                elif ready:
                    self._read(decoder)
                if time.monotonic() >= due:
                    due = time.monotonic() + BEAT
                    self._send(*filter(None, [self._state]))
                self._news.notify_all()

    def _read(self, decoder: FrameDecoder) -> None:
        data = b''
        if self._kart is not None:
            with contextlib.suppress(OSError):
                data = self._kart.recv(4096)
        if not data:
            self._drop()
        for each in decoder.feed(data):
            if isinstance(each, StateFrame):
                self._heard(each.state)
                self.said = each.state
            else:
                self.malformed += 1

    def _send(self, *states: RaceState) -> None:
        if self._kart is not None:
            with contextlib.suppress(OSError):  # it is gone, which the next look shows
                self._kart.sendall(b''.join(map(encode, states)))

    def _drop(self) -> None:
        if self._kart is not None:
            self._kart.close()
            self._kart = None
