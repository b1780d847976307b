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
One connection of one kart: its bytes in, frames out, and whether it still answers (§4.C, §4.D).

Everything here runs in the loop of the kart server, which owns the links. What a link needs of it
is a `LinkOwner`. What counts of that which a kart says is decided in ``hearing``.
"""

from __future__ import annotations

import asyncio
from collections import deque
import fcntl
import socket
import sys
import termios
from typing import Protocol

from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState
from evgp_rcs.hearing import FLOOD_BYTES, Heard, Hearing
from evgp_rcs.inputs import CLOSED_BY_KART

SLOW_ANSWER = 0.3
"""Age of the oldest unanswered byte from which on a link is slow, in seconds."""

SLOW_BEATS = 10
"""Number of beats with a slow link, within `SLOW_WINDOW`, of which officials are told."""

SLOW_WINDOW = 30.0
"""Time in which officials are told of a slow link once at most, in seconds."""

ANSWER_STEP = 0.2
"""Time by which an answer is later than the quickest of a link, in seconds: for each, frames are
0.1 s further apart. So a long way is no reason to send less (§4.C wants 10 states a second), but a
narrow one is, on which a stop would wait behind them."""

TCP_THIN_LINEAR_TIMEOUTS = 16
"""An option of Linux (since 2.6.34) that Python does not name."""

SIOCOUTQNSD = 0x894B
"""Linux's request for the number of bytes not sent yet; TIOCOUTQ's have not been answered."""

FRAMES = {state: encode(state) for state in RaceState}

_COUNT = bytes(4)


class LinkOwner(Protocol):
    """What a link needs of the kart server."""

    def now(self) -> float:
        """Return the time of the rules (s)."""

    def take_commands(self) -> None:
        """Judge what officials have sent: it comes before what karts said."""

    def link_made(self, link: KartLink, address: str) -> None:
        """Take a new connection from this IPv4 address, or drop it."""

    def link_heard(self, link: KartLink, heard: Heard, serial: int) -> None:
        """Take what a kart said, and the serial of the order that it can answer."""

    def link_slow(self, link: KartLink, age: float) -> None:
        """Take note that a kart is slow to answer again and again: up to this time, in seconds."""

    def link_lost(self, link: KartLink) -> None:
        """Take note that a connection has ended; `KartLink.reason` says why."""


class KartLink(asyncio.BufferedProtocol):
    """
    One connection of one kart.

    :param owner: the kart server.
    :param beat_rate: how often ``beat`` is called, Hz.
    :param send_timeout: time for which a kart may leave a byte unanswered before it is lost, s.
    :ivar number: the kart's number, which the owner gives it; 0: none yet.
    :ivar reason: why the connection ended, or will.
    """

    def __init__(self, owner: LinkOwner, beat_rate: float, send_timeout: float) -> None:
        """Wait for the connection."""
        self._owner = owner
        self._send_timeout = send_timeout
        self._buffer = bytearray(FLOOD_BYTES)
        self._hearing = Hearing(beat_rate)
        self._transport: asyncio.Transport | None = None
        self._socket: socket.socket | None = None
        self._frame = b''
        # How many bytes were written, and of each frame that the kart's TCP has not answered yet:
        # up to where it reaches, and when it was written.
        self._written = 0
        self._unanswered: deque[tuple[int, float]] = deque()
        self._wrote_at = 0.0
        self._quickest: float | None = None  # answer, s
        self._slow_beats = 0
        self._slow_until = 0.0
        self._worst_age = 0.0
        self.number = 0
        self.reason = 'the connection ended'

    # ----- asyncio's side -----------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Hand the connection to the owner."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._socket = transport.get_extra_info('socket')
        self._owner.link_made(self, transport.get_extra_info('peername')[0])

    def get_buffer(self, sizehint: int) -> bytearray:
        """Return where the next bytes go."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Take what was read; more than a flood's worth waits for the next beat."""
        self._hearing.read(nbytes)
        if self._hearing.waits:
            self._look(self._owner.now())
        self._owner.take_commands()
        for heard, serial in self._hearing.decode(memoryview(self._buffer)[:nbytes]):
            self._owner.link_heard(self, heard, serial)
        if self._hearing.is_full and self._transport is not None:
            self._transport.pause_reading()

    def eof_received(self) -> bool:
        """Drop the kart at once, whatever waits to be written: it hears nothing any more."""
        self.drop(CLOSED_BY_KART)
        return False

    def connection_lost(self, exc: Exception | None) -> None:
        """Tell the owner."""
        if exc is not None:
            self.reason = in_words(exc)
        self._transport = None
        self._owner.link_lost(self)

    # ----- the owner's side ---------------------------------------------------------------

    def set_up(self) -> None:
        """Make the socket prompt: no Nagle, and what was lost is sent again soon."""
        assert self._socket is not None
        option = self._socket.setsockopt
        option(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            # It does not take lost packets for a sign to send less. With the usual ones, where
            # 5 % are lost a kart hears nothing for a second every twenty minutes.
            option(socket.IPPROTO_TCP, socket.TCP_CONGESTION, b'bbr')
        except OSError:
            pass  # this kernel does not have it, or not for everyone
        # What was lost is sent again at an even pace (where it is not bbr that decides). With
        # ever longer waits, a link that fails for half a second is silent for more than one.
        option(socket.IPPROTO_TCP, TCP_THIN_LINEAR_TIMEOUTS, 1)

    def order(self, state: RaceState, serial: int) -> None:
        """Send a new state at once; what has arrived by now is no answer to it."""
        self._frame = FRAMES[state]
        end = self._written + len(self._frame)
        self._hearing.order(serial, state, end, self._in_kernel(termios.FIONREAD))
        self._write(self._owner.now())

    def beat(self) -> None:
        """
        Send the state again, unless an earlier frame has not left yet.

        So a stop is never behind more than one frame that waits here, in whatever buffer. Where
        answers become late, fewer are sent: see `ANSWER_STEP`.
        """
        now = self._owner.now()
        was_full = self._hearing.is_full
        floods = self._hearing.beat(now)
        if self._transport is None:
            return
        self._look(now)
        age = now - self._unanswered[0][1] if self._unanswered else 0.0
        if age >= self._send_timeout:
            self.drop('its network link stopped answering')
            return
        if floods:
            self.drop('the kart floods race control')
            return
        if was_full:
            self._transport.resume_reading()
        if age >= SLOW_ANSWER:
            self._note_slow(age, now)
        late = age - (self._quickest or 0.0)
        apart = int(late / ANSWER_STEP) * 0.1 - 0.025  # beats are not exact
        if now - self._wrote_at >= apart and not self._unsent():
            self._write(now)

    def drop(self, reason: str) -> None:
        """Give the connection up now; what waits to be written is thrown away."""
        self.reason = reason
        if self._transport is not None:
            self._transport.abort()

    def farewell(self) -> None:
        """Send RED_RED and close: race control is going away."""
        self.reason = 'race control ended'
        if self._transport is not None:
            self._transport.write(FRAMES[RaceState.RED_RED])
            self._transport.close()

    def _write(self, now: float) -> None:
        if self._transport is None:
            return
        self._written += len(self._frame)
        self._unanswered.append((self._written, now))
        self._wrote_at = now
        self._transport.write(self._frame)

    def _look(self, now: float) -> None:
        """Take note of what the kart's TCP has answered."""
        if self._transport is None:
            return
        # In this order: what had arrived while an order was unanswered was sent before it came.
        unread = self._in_kernel(termios.FIONREAD) if self._hearing.waits else 0
        unanswered = self._transport.get_write_buffer_size() + self._in_kernel(termios.TIOCOUTQ)
        answered = self._written - unanswered
        if self._hearing.waits:
            self._hearing.look(answered, unread)
        while self._unanswered and self._unanswered[0][0] <= answered:
            took = now - self._unanswered.popleft()[1]
            self._quickest = took if self._quickest is None else min(took, self._quickest)

    def _unsent(self) -> int:
        """Return how many bytes have not left yet, or may not have."""
        if not self._unanswered or self._transport is None:
            return 0
        return self._transport.get_write_buffer_size() + self._in_kernel(SIOCOUTQNSD)

    def _note_slow(self, age: float, now: float) -> None:
        """Tell of a link that is slow again and again, but not too often."""
        if now >= self._slow_until:
            self._slow_beats, self._worst_age = 0, 0.0
            self._slow_until = now + SLOW_WINDOW
        self._slow_beats += 1
        self._worst_age = max(self._worst_age, age)
        if self._slow_beats == SLOW_BEATS:
            self._owner.link_slow(self, self._worst_age)

    def _in_kernel(self, which: int) -> int:
        """Return how many bytes the kernel has: unread, unanswered or unsent (the constants)."""
        if self._socket is None or self._transport is None:
            return 0
        return int.from_bytes(fcntl.ioctl(self._socket.fileno(), which, _COUNT), sys.byteorder)


def in_words(error: BaseException) -> str:
    """Return what an error says to an official, without the number of the system's."""
    if isinstance(error, TimeoutError):
        return 'its network link stopped answering'
    if isinstance(error, OSError) and error.strerror:
        return error.strerror.lower()
    return str(error) or type(error).__name__
