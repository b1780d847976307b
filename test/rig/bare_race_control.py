# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Race control's end of the wire for one kart, which does what the test says and no more."""

from __future__ import annotations

from collections.abc import Callable
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

    :param listening: where karts connect; None: at a port of 127.0.0.1 that the system chooses.
    :param heard: called in another thread with each state that the kart says, as it comes.
    """

    def __init__(
        self,
        heard: Callable[[RaceState], object] = lambda state: None,
        listening: socket.socket | None = None,
    ) -> None:
        """Listen and beat; IN_GARAGE until told otherwise."""
        self.said: RaceState | None = None
        self.malformed = 0
        self._heard = heard
        self._state = RaceState.IN_GARAGE
        self._beating = True
        self._kart: socket.socket | None = None
        self._news = threading.Condition()
        self._ending = threading.Event()
        self._connections = 0
        self._listening = listening or socket.create_server(('127.0.0.1', free_port()))
        self.port: int = self._listening.getsockname()[1]
        self._threads = [
            threading.Thread(target=target, daemon=True) for target in (self._accept, self._beat)
        ]
        for thread in self._threads:
            thread.start()

    def say(self, *states: RaceState) -> float:
        """
        Send these states at once, and the last of them from now on.

        :return: the monotonic time of the first frame, s.
        """
        with self._news:
            self._state = states[-1]
            self._beating = True
            self.said = None
            self._send(*states)
        return time.monotonic()

    def fall_silent(self) -> float:
        """Send nothing any more, and keep the connection; return the monotonic time, s."""
        with self._news:
            self._beating = False
        return time.monotonic()

    def send(self, data: bytes) -> None:
        """Send these bytes once."""
        with self._news:
            assert self._kart is not None
            self._kart.sendall(data)

    def hang_up(self) -> None:
        """End the connection; the kart may come back."""
        with self._news:
            self._drop()

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
            self._news.wait_for(lambda: self._connections >= count, PATIENCE)
            assert self._connections >= count

    def close(self) -> None:
        self._ending.set()
        self._listening.shutdown(socket.SHUT_RDWR)
        with self._news:
            self._drop()
        for thread in self._threads:
            thread.join(PATIENCE)
        self._listening.close()

    def _accept(self) -> None:
        while not self._ending.is_set():
            try:
                kart, _ = self._listening.accept()
            except OSError:
                return  # closed
            with self._news:
                self._drop()
                self._kart = kart
                self._connections += 1
                self.said = None
                self._news.notify_all()
            threading.Thread(target=self._read, args=(kart,), daemon=True).start()

    def _beat(self) -> None:
        while not self._ending.wait(BEAT):
            with self._news:
                if self._beating:
                    self._send(self._state)

    def _send(self, *states: RaceState) -> None:
        if self._kart is not None:
            try:
                self._kart.sendall(b''.join(map(encode, states)))
            except OSError:
                self._drop()

    def _drop(self) -> None:
        kart, self._kart = self._kart, None
        if kart is not None:
            try:
                kart.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass  # the other end was quicker

    def _read(self, kart: socket.socket) -> None:
        decoder = FrameDecoder()
        with kart:
            while True:
                try:
                    data = kart.recv(4096)
                except OSError:
                    return
                if not data:
                    return
                frames = decoder.feed(data)
                heard = [each for each in frames if isinstance(each, StateFrame)]
                self.malformed += len(frames) - len(heard)
                for each in heard:
                    self._heard(each.state)
                with self._news:
                    if heard and kart is self._kart:
                        self.said = heard[-1].state
                    self._news.notify_all()
