# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Writes a trace with its own clock and records connections in it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
import contextlib
import socket
import struct
from typing import Any

from evgp_inspection.limits import Limits
from evgp_inspection.oracle import Oracle
from evgp_inspection.traces import Event, Kind
from evgp_inspection.verdicts import Finding
from evgp_protocol.link import unanswered, unread

RESET = struct.pack('ii', 1, 0)
"""Value of SO_LINGER that makes a close reset the connection."""


class Recording:
    """
    Writes a trace in one event loop and lets an oracle judge it.

    Times are in seconds since the start.

    :param limits: the limits for the oracle.
    :param tell: see `Oracle`.
    """

    def __init__(self, limits: Limits, tell: Callable[[str, Finding], object]) -> None:
        self.oracle = Oracle(limits, tell)
        self.trace = self.oracle.trace
        self._loop = asyncio.get_running_loop()
        self._began = self._loop.time()
        self._awaited: Callable[[], object] = lambda: None
        self._wakes = asyncio.Event()

    @property
    def now(self) -> float:
        return self._loop.time() - self._began

    def note(
        self,
        kind: Kind,
        link: int = 0,
        data: bytes = b'',
        text: str = '',
        value: float = 0.0,
        unread: int = 0,
    ) -> None:
        """Record an event with the current time."""
        self.oracle.take(Event(self.now, kind, link, data, text, value, unread))
        if self._awaited():
            self._wakes.set()

    async def until(self, found: Callable[[], object], seconds: float) -> bool:
        """Wait, in one task only, until `found` is true, but no longer; return whether it is."""
        deadline = self._loop.time() + seconds
        self._awaited = found
        while not found():
            if self._loop.time() >= deadline:
                return False
            # No asyncio.wait_for: it returns a few turns later, when another phase may run.
            self._wakes.clear()
            timer = self._loop.call_at(deadline, self._wakes.set)
            await self._wakes.wait()
            timer.cancel()
        return True


class Link(asyncio.BufferedProtocol):
    """
    A connection, on which everything is recorded.

    :param made: called with the link once it is connected.
    :ivar number: the connection's number in the trace; 0 if it does not appear there.
    :ivar open: whether the connection is still open at both ends.
    :ivar mute: whether nothing more is sent on it.
    """

    transport: asyncio.Transport

    def __init__(self, recording: Recording, made: Callable[[Link], None]) -> None:
        self.number = 0
        self.open = self.mute = False
        self.recording = recording
        self._made = made
        self._buffer = bytearray(65536)

    def write(self, data: bytes) -> None:
        """Send data, if the connection accepts any."""
        if self.open and not self.mute and not self.transport.is_closing():
            self.recording.note(Kind.SENT, self.number, data, unread=self._of_socket(unread))
            self.transport.write(data)

    def look(self) -> None:
        """If it matters, record how many bytes the other end's TCP has not acknowledged."""
        if self.open and self.recording.trace.waits(self.number):
            # In this order: bytes that arrived before the acknowledgement were sent before it.
            arrived = self._of_socket(unread)
            kept = self.transport.get_write_buffer_size()
            rest = kept + self._of_socket(unanswered)
            self.recording.note(Kind.UNANSWERED, self.number, value=float(rest), unread=arrived)

    def end(self, how: str) -> None:
        """
        End the connection.

        The kernel resets a connection that is closed with unread bytes, so the FIN goes first.

        :param how: closed (FIN), away (FIN, race control then goes away), half-closed (FIN, but
            what the kart sends is still read) or reset (RST).
        """
        if not self.open or (self.mute and how == 'half-closed'):
            return
        self.recording.note(Kind.ENDED, self.number, text=how)
        if how == 'half-closed':
            self.mute = True
            with contextlib.suppress(OSError):  # the kart has just closed it
                self.transport.write_eof()
            return
        self.open = False
        if how == 'reset':
            connection = self.transport.get_extra_info('socket')
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
            self.transport.abort()
            return
        if self.transport.get_write_buffer_size() == 0:
            with contextlib.suppress(OSError):  # the connection has ended meanwhile
                self.transport.get_extra_info('socket').shutdown(socket.SHUT_WR)
        self.transport.close()

    def _of_socket(self, count: Callable[[socket.socket], int]) -> int:
        """Return a byte count of the socket; 0 while it closes."""
        if self.transport.is_closing():
            return 0
        return count(self.transport.get_extra_info('socket'))

    # Called by asyncio.

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        transport.get_extra_info('socket').setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.open = True
        self._made(self)

    def get_buffer(self, sizehint: int) -> bytearray:
        self.look()  # before it reads
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        if self.number:
            self.recording.note(Kind.SAID, self.number, bytes(self._buffer[:nbytes]))

    def eof_received(self) -> None:
        self._lost('closed')

    def connection_lost(self, exc: Exception | None) -> None:
        self._lost('closed' if exc is None else 'reset')

    def _lost(self, how: str) -> None:
        if self.open:
            self.open = False
            self.recording.note(Kind.CLOSED, self.number, text=how)


class EndedError(Exception):
    """The steps cannot continue. The text says why, for the report."""


async def first(task: asyncio.Future[Any], event: asyncio.Event) -> None:
    """Wait until the task is done or the event is set."""
    waiting = asyncio.get_running_loop().create_task(event.wait())
    try:
        await asyncio.wait([task, waiting], return_when=asyncio.FIRST_COMPLETED)
    finally:
        waiting.cancel()
