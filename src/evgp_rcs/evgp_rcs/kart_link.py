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
import ctypes
import socket
import termios
from typing import Protocol

from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState
from evgp_rcs.hearing import FLOOD_BYTES, Heard, Hearing
from evgp_rcs.inputs import CLOSED_BY_KART

UNSENT_BYTES = 4096
"""Maximum backlog to a kart that does not read, in bytes; beyond it, the kart is dropped."""

TCP_THIN_LINEAR_TIMEOUTS = 16
"""An option of Linux (since 2.6.34) that Python does not name."""

FRAMES = {state: encode(state) for state in RaceState}

# Python gives the interpreter's lock away with every call of the system, and gets it back when the
# record's thread lets go: with a thousand karts, a thousand times for one stop. These two never
# wait in the kernel, so they keep it.
_LIBC = ctypes.PyDLL(None)
_SEND = _LIBC.send
_SEND.argtypes = (ctypes.c_int, ctypes.c_char_p, ctypes.c_size_t, ctypes.c_int)
_SEND.restype = ctypes.c_ssize_t
_IOCTL = _LIBC.ioctl
_IOCTL.argtypes = (ctypes.c_int, ctypes.c_ulong, ctypes.POINTER(ctypes.c_int))
_NOW = socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL


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

    def link_lost(self, link: KartLink) -> None:
        """Take note that a connection has ended; `KartLink.reason` says why."""


class KartLink(asyncio.BufferedProtocol):
    """
    One connection of one kart.

    :param owner: the kart server.
    :param beat_rate: how often ``beat`` is called, Hz.
    :param send_timeout: time for which a kart may leave bytes unanswered before it is lost, s.
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
        # How many bytes were written; how many of them were answered, and when that last grew.
        self._written = 0
        self._answered = 0
        self._answered_at = 0.0
        self._ask_at = 0.0
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
        """Make the socket prompt: no Nagle, little in flight, and a vanished kart noticed."""
        assert self._socket is not None
        self._answered_at = self._owner.now()
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
        # Only for the case that `_is_unanswered` is not asked: the kernel counts from when it
        # first had to send anything again, even if that has been answered since.
        option(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, int(3 * self._send_timeout * 1000))
        option(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        option(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 1)
        option(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 1)
        # A kart that reads late must not find seconds of old states before the stop.
        option(socket.SOL_SOCKET, socket.SO_SNDBUF, 2048)

    def order(self, state: RaceState, serial: int) -> None:
        """Send a new state at once; what has arrived by now is no answer to it."""
        self._hearing.order(serial, self._in_kernel(termios.FIONREAD))
        self._frame = FRAMES[state]
        self._write()

    def beat(self) -> None:
        """Send the state again, unless the kart has not taken the last one yet."""
        now = self._owner.now()
        was_full = self._hearing.is_full
        floods = self._hearing.beat(now)
        if self._transport is None:
            return
        if self._is_unanswered(now):
            self.drop('its network link stopped answering')
            return
        if floods:
            self.drop('the kart floods race control')
            return
        if was_full:
            self._transport.resume_reading()
        if not self._transport.get_write_buffer_size():
            self._write()

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

    def _write(self) -> None:
        if self._transport is None or self._socket is None:
            return
        frame = self._frame
        self._written += len(frame)
        if not self._transport.get_write_buffer_size():
            # What the kernel takes now goes out without giving the interpreter to the record.
            sent = _SEND(self._socket.fileno(), frame, len(frame), _NOW)
            if sent == len(frame):
                return
            taken = max(sent, 0)
            frame = frame[taken:]  # the rest; or all of it, and asyncio meets the error
        self._transport.write(frame)
        if self._transport.get_write_buffer_size() > UNSENT_BYTES:
            self.drop('the kart does not read what it is sent')

    def _is_unanswered(self, now: float) -> bool:
        """Return whether the kart has answered nothing of what it was sent for too long (§4.D)."""
        if self._transport is None or now < self._ask_at:
            return False
        self._ask_at = now + self._send_timeout / 8  # to ask the kernel at every beat is too dear
        unanswered = self._transport.get_write_buffer_size() + self._in_kernel(termios.TIOCOUTQ)
        answered = self._written - unanswered
        if not unanswered or answered > self._answered:
            self._answered = answered
            self._answered_at = now
        return now - self._answered_at >= self._send_timeout

    def _in_kernel(self, which: int) -> int:
        """Return how many bytes lie in the kernel: FIONREAD unread, TIOCOUTQ unanswered."""
        if self._socket is None or self._transport is None:
            return 0
        count = ctypes.c_int(0)
        _IOCTL(self._socket.fileno(), which, ctypes.byref(count))
        return count.value


def in_words(error: BaseException) -> str:
    """Return what an error says to an official, without the number of the system's."""
    if isinstance(error, TimeoutError):
        return 'its network link stopped answering'
    if isinstance(error, OSError) and error.strerror:
        return error.strerror.lower()
    return str(error) or type(error).__name__
