# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The kart's end of the TCP connection to race control (§4.A, §4.D), for the bridge and the kit.

It passes what happens to a `Kart`, and makes a lost connection again. It never waits, so one
thread can have it, the kart and the brake.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import os
import random
import select
import socket

from evgp_protocol import clock
from evgp_protocol.frames import DEFAULT_PORT
from evgp_protocol.kart import Kart
from evgp_protocol.link import unanswered

CONNECT_TIMEOUT = 2.0
"""Maximum duration of an attempt to connect, in seconds."""

FIRST_WAIT = 0.1
"""Maximum time before the second attempt to connect, in seconds. It doubles with each attempt."""

LAST_WAIT = 2.0
"""Maximum time before any attempt to connect, in seconds."""

BYTES_A_READ = 256
"""Maximum number of bytes of one read."""

MOST_READS = 16
"""Maximum number of reads in one turn: a flood must not delay the brake. Race control takes 15 s
to send as much, but a kart that reads no frame for 1 s loses the connection."""

MOST_UNANSWERED = 4096
"""Maximum number of bytes that race control's TCP has not accepted, before the kart assumes that
race control does not read its replies."""


@dataclasses.dataclass(frozen=True)
class LinkSettings:
    """
    Where to connect to race control.

    :ivar host: race control's IPv4 address.
    :ivar port: race control's TCP port, from 1 to 65535.
    :ivar local_address: the IPv4 address to connect from. If it is empty, the system chooses.
    """

    host: str
    port: int = DEFAULT_PORT
    local_address: str = ''

    @property
    def peer(self) -> str:
        """Return race control's address and port, for messages."""
        return f'{self.host}, port {self.port}'


class Connection:
    """
    Keeps a kart connected to race control.

    :param kart: what learns of the connection, and whose frames are sent with `say`.
    :param settings: where to connect.
    :ivar made: number of connections so far.
    :ivar failures: number of connections and of attempts to connect that have failed so far.
    :ivar ever_heard: whether race control has sent a race state on any connection.
    """

    def __init__(self, kart: Kart, settings: LinkSettings) -> None:
        self.made = self.failures = 0
        self.ever_heard = False
        self._kart = kart
        self._settings = settings
        self._socket: socket.socket | None = None
        self._is_made = self._is_heard = False
        self._wait = FIRST_WAIT
        self._due = 0.0  # the next attempt to connect, or the end of the present one

    def wait(self, bell: int, seconds: float) -> None:
        """Return when `serve` may have something to do, `bell` can be read, or time is up."""
        ends = select.poll()
        ends.register(bell, select.POLLIN)
        if self._socket is not None:
            ends.register(self._socket, select.POLLIN if self._is_made else select.POLLOUT)
        ends.poll(max(0.0, seconds) * 1000)

    def serve(self) -> None:
        """Do what can be done now: connect, read everything that has arrived, or close."""
        try:
            if self._socket is None:
                if clock.now() >= self._due:
                    self._connect()
            elif self._is_made:
                self._receive(self._socket)
            elif clock.now() >= self._due:
                raise TimeoutError  # even if it is made, because what came on it may be old
            elif self._is_answered(self._socket):
                if error := self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
                    raise OSError(error, os.strerror(error))
                self._is_made = True
                self.made += 1
                self._kart.connected(clock.now())
        except OSError as error:
            self._lose(self._why_closed(error) if self._is_made else self._why_not_made(error))

    def say(self, frames: bytes) -> None:
        """Send what the kart says. If race control does not read it, the connection is lost."""
        if not frames or self._socket is None:
            return
        try:
            whole = self._socket.send(frames) == len(frames)
            if not whole or unanswered(self._socket) > MOST_UNANSWERED:
                self._lose("race control does not read the kart's replies")
        except OSError as error:
            self._lose(self._why_closed(error))

    def close(self) -> None:
        """End the connection without telling the kart."""
        if self._socket is not None:
            self._socket.close()
        self._socket, self._is_made = None, False

    def _connect(self) -> None:
        self._is_heard = False
        self._due = clock.now() + CONNECT_TIMEOUT
        self._socket = socket.socket()
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if self._settings.local_address:
            self._socket.bind((self._settings.local_address, 0))
        with contextlib.suppress(BlockingIOError):  # the connection is being made
            self._socket.connect((self._settings.host, self._settings.port))

    def _is_answered(self, link: socket.socket) -> bool:
        """Return whether the attempt to connect is over, made or failed."""
        attempt = select.poll()  # select.select cannot take a file descriptor above 1023
        attempt.register(link, select.POLLOUT)
        return bool(attempt.poll(0))

    def _receive(self, link: socket.socket) -> None:
        for _ in range(MOST_READS):
            if not self._kart.is_open:
                return self._lose('')  # the kart knows why
            try:
                data = link.recv(BYTES_A_READ)
            except BlockingIOError:
                return None
            if not data:
                return self._lose(self._why_closed(None))
            self._kart.received(data, clock.now())
            if self._kart.verdict.connected:
                self._is_heard = self.ever_heard = True
        return self._lose('race control never sends that much')

    def _lose(self, reason: str) -> None:
        if reason:
            self._kart.closed(clock.now(), reason)
        self.failures += 1
        if self._is_heard:
            self._wait = FIRST_WAIT
        # Wait for a random time, so that karts that lost the same race control do not all
        # reconnect at once.
        wait = self._wait * random.uniform(0.5, 1.0)  # noqa: S311 - no secret
        self._due = clock.now() + wait
        self._wait = min(2 * self._wait, LAST_WAIT)
        self.close()

    def _why_closed(self, error: OSError | None) -> str:
        """Return how race control ended the connection, and what to check, for messages."""
        peer = self._settings.peer
        if self._is_heard:
            if error is not None:
                return f'the connection to {peer} broke: {error}'
            return f'{peer} closed the connection'
        assert self._socket is not None
        own = self._socket.getsockname()[0]
        why = f'{peer} closed the connection from {own} at once'
        if self.ever_heard:
            return why
        why += ': is that address in its roster?'
        if not self._settings.local_address:
            why += ' If this computer has several addresses, set local_address'
        return why

    def _why_not_made(self, error: OSError) -> str:
        """Return why an attempt to connect failed, and what to check, for messages."""
        host, peer, own = self._settings.host, self._settings.peer, self._settings.local_address
        if error.errno == errno.EADDRNOTAVAIL and own:
            return f'this machine has no address {own}: check local_address'
        if error.errno == errno.ECONNREFUSED:
            why = 'is race control running, and are address and port right?'
            return f'{peer}, refuses the connection: {why}'
        if error.errno in (errno.ENETUNREACH, errno.EHOSTUNREACH):
            return f"{host} cannot be reached: is the kart on race control's network?"
        if error.errno in (None, errno.ETIMEDOUT):
            return f"{peer}, does not answer: is the kart on race control's network?"
        return f'connecting to {peer} failed: {error}'
