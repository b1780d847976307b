# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
One connection from one kart: it reads the kart's bytes and sends it frames (§4.C, §4.D).

The link also watches whether the kart still answers. Everything here runs in the loop of the kart
server, which owns the links. ``hearing`` decides which reports from a kart count.
"""

from __future__ import annotations

import asyncio
import socket
from typing import TYPE_CHECKING

from evgp_protocol.frames import encode
from evgp_protocol.hearing import FLOOD_BYTES, Hearing
from evgp_protocol.link import (
    Answers,
    Grade,
    GRADES,
    make_prompt,
    read,
    unanswered,
    unread,
    unsent,
)
from evgp_protocol.states import RaceState
from evgp_rcs.record.run_mark import in_words
from evgp_rcs.rules.inputs import Delivered, Measured
from evgp_rcs.rules.link_quality import LinkMeter

if TYPE_CHECKING:
    from evgp_rcs.karts.server import KartServer

TICK = 0.01
"""Maximum tick of a kernel's clock, in seconds. The kernel's times may be one tick late."""

FRAMES = {state: encode(state) for state in RaceState}


class KartLink(asyncio.BufferedProtocol):
    """
    One connection from one kart.

    :param owner: the kart server.
    :param beat_rate: rate at which the owner calls ``beat``, in Hz.
    :param send_timeout: time after which the link drops a kart that leaves a byte unanswered, in
        seconds.
    :ivar number: the kart's number, which the owner sets. 0 before that.
    :ivar reason: why the connection has ended or will end, as a phrase.
    :ivar silent: whether the connection ended because the kart stopped answering.
    """

    def __init__(self, owner: KartServer, beat_rate: float, send_timeout: float) -> None:
        self._owner = owner
        self._send_timeout = send_timeout
        self._buffer = bytearray(FLOOD_BYTES)
        self._hearing = Hearing(beat_rate)
        self._transport: asyncio.Transport
        self._socket: socket.socket
        self._frame = b''
        self._answers = Answers()
        self._meter = LinkMeter(owner.now())
        self._ordered = 0  # serial of the last order
        self._delivered: tuple[int, float] | None = None  # still to be reported to the owner
        self.number = 0
        self.reason = 'the connection ended'
        self.silent = False

    # ----- asyncio's side -----------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Pass the connection to the owner."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._socket = transport.get_extra_info('socket')
        self._owner.link_made(self, transport.get_extra_info('peername')[0])

    def get_buffer(self, sizehint: int) -> bytearray:
        """Return the buffer for the next bytes."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Handle the bytes that were read. If they are a flood, read again at the next beat."""
        self._hearing.read(nbytes)
        if self._hearing.waits:
            self._look(self._owner.now())
        self._owner.take_commands()
        decoded = self._hearing.decode(memoryview(self._buffer)[:nbytes])
        counts_in = self._hearing.counts_in()
        for heard, serial in decoded:
            self._owner.link_heard(self, heard, serial, counts_in)
        if self._hearing.is_full:
            self._transport.pause_reading()

    def eof_received(self) -> bool:
        """Drop the kart at once, because waiting bytes could no longer reach its program."""
        self.drop('the kart closed the connection')
        return False

    def connection_lost(self, exc: Exception | None) -> None:
        """Report the end of the connection to the owner."""
        if exc is not None:
            no_answer = isinstance(exc, TimeoutError)
            self.reason = 'its network link stopped answering' if no_answer else in_words(exc)
            # A ConnectionError is an answer from the kart's system, even if its program is gone.
            self.silent = not isinstance(exc, ConnectionError)
        self._owner.link_lost(self)

    # ----- the owner's side ---------------------------------------------------------------

    def set_up(self) -> None:
        """Make the socket send without delay."""
        make_prompt(self._socket)

    def order(self, state: RaceState, serial: int) -> None:
        """
        Send a new state at once. Frames that have arrived by now cannot answer it.

        :param serial: serial of the order, which `KartServer.link_heard` gets with each report.
        """
        self._frame = FRAMES[state]
        self._ordered = serial
        end = self._answers.written + len(self._frame)
        self._hearing.order(serial, state, end, unread(self._socket))
        self._write(self._owner.now())

    def beat(self) -> None:
        """
        Send the state again, unless an earlier frame has not left yet.

        A stop therefore never waits behind more than one earlier frame in any buffer. If
        the kart's answers are late, the link sends fewer frames (``Answers.may_beat``).
        """
        now = self._owner.now()
        was_full = self._hearing.is_full
        floods = self._hearing.beat(now)
        for heard, serial in self._hearing.settled():
            self._owner.link_heard(self, heard, serial, 0.0)
        self._look(now)
        age = self._answers.age(now)
        if age >= self._send_timeout:
            self.silent = True
            self.drop('its network link stopped answering')
            return
        if floods:
            self.drop('the kart floods race control')
            return
        if was_full:
            self._transport.resume_reading()
        if self._answers.may_beat(now) and not self._unsent():
            self._write(now)
            self._hearing.sent_again()
        if self._delivered is not None:
            delivered, self._delivered = self._delivered, None
            self._owner.link_noticed(self, Delivered(self._owner.now(), self.number, *delivered))
        if self._meter.is_due(age, now):
            measured = self._meter.measure(age, read(self._socket), now, self._hearing.behind)
            self._owner.link_noticed(self, Measured(self._owner.now(), self.number, measured))

    def answers(self, now: float) -> bool:
        """Return whether the kart's TCP answers as promptly as on a good link."""
        return self._answers.age(now) < GRADES[Grade.FAIR]

    def drop(self, reason: str) -> None:
        """Close the connection now, for this reason, and discard what is waiting to be written."""
        self.reason = reason
        self._transport.abort()

    def farewell(self) -> None:
        """Send RED_RED and close the connection, because race control is shutting down."""
        self.reason = 'race control ended'
        self._transport.write(FRAMES[RaceState.RED_RED])
        self._transport.close()

    def _write(self, now: float) -> None:
        self._answers.wrote(len(self._frame), now)
        self._transport.write(self._frame)

    def _look(self, now: float) -> None:
        """Record what the kart's TCP has answered."""
        waits = self._hearing.waits
        # Count the bytes before asking what is answered. Bytes that arrived while an order was
        # unanswered cannot answer it.
        arrived = unread(self._socket) if waits else 0
        rest = self._transport.get_write_buffer_size() + unanswered(self._socket)
        if waits or self._answers.age(now) >= GRADES[Grade.FAIR]:
            # The answer arrived before this look, and long before it if race control has stalled.
            info = read(self._socket)
            now -= 0.0 if info is None else max(0.0, info.since_answer - TICK)
        for took in self._answers.look(rest, now):
            self._meter.answered(max(0.0, took), now)
        if waits:
            self._hearing.look(self._answers.answered, arrived)
            if not self._hearing.waits:
                self._delivered = self._ordered, now

    def _unsent(self) -> int:
        """Return the number of bytes that may not have left yet."""
        if self._answers.answered == self._answers.written:
            return 0
        return self._transport.get_write_buffer_size() + unsent(self._socket)
