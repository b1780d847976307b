# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Race control's end of the wire, for the inspection of one kart.

The inspection chooses what is sent, in which pieces and at which rate. It is sent on every
connection of the kart, so that a stop reaches the kart on whichever connection it reads.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
import itertools
import socket
from typing import TypeAlias

from evgp_inspection.recording import Link, Recording
from evgp_inspection.traces import Kind
from evgp_protocol.frames import encode
from evgp_protocol.link import BEAT_RATE
from evgp_protocol.states import RaceState

LATE_BEAT = 0.25
"""Delay of a beat above which the inspecting computer counts as having hung, in seconds."""

MALFORMED = (
    b'$GREEN;',
    b'$green_green;',
    b'GREEN_GREEN;',
    b'$GREEN_GREEN\r\n',
    b'$ GREEN_GREEN;',
    b'$GREEN_GREEN\x00;',
    b'$GREEN\xffGREEN;',
    b'$XGREEN_GREEN;',
    b'$GREEN_GREENX;',
    b'$GREEN_GREEN:',
    b'\x00\xff\x80 noise \x1b[2J',
    b'$' + 24 * b'A' + b'GREEN_GREEN;',
    b'$;',
    b'$$$;;;',
    b'\r\n\t ',
)
"""Bytes that no kart may take for GREEN_GREEN, and that must not crash a kart. Each of them stays
malformed, whatever follows it."""

TRIES = 6
"""Number of times that `between` sends each of `MALFORMED` alone, and with a whole frame."""

Beat: TypeAlias = list[tuple[float, bytes]]
"""Pieces to send, each after a pause in seconds."""

Beats: TypeAlias = Iterator[Beat]
"""An endless sequence of beats to send."""


def whole(state: RaceState) -> Beats:
    return itertools.repeat([(0.0, encode(state))])


def single_bytes(state: RaceState) -> Beats:
    return itertools.repeat([(0.002, bytes([byte])) for byte in encode(state)])


def many_in_a_piece(state: RaceState) -> Beats:
    """Send pieces of five frames, cut inside a frame."""
    frame = encode(state)
    half = len(frame) // 2
    begin, end = frame[:half], frame[half:]
    more = itertools.repeat([(0.0, end + frame * 4 + begin)])
    return itertools.chain([[(0.0, frame * 5 + begin)]], more)


def late_halves(state: RaceState) -> Beats:
    """Send the second half of each frame 0.07 s after the first."""
    frame = encode(state)
    at = len(frame) // 2
    return itertools.repeat([(0.0, frame[:at]), (0.07, frame[at:])])


def after(first: bytes, state: RaceState) -> Beats:
    """Send these bytes and a frame in one piece, then whole frames."""
    return itertools.chain([[(0.0, first + encode(state))]], whole(state))


def between(state: RaceState) -> Beats:
    """
    Send each of `MALFORMED` in turn, now alone and now in one piece with a whole frame.

    A kart obeys the last frame of what has arrived, so only the first shows what it takes for one.
    """
    frames = (b'', encode(state)) * TRIES
    return itertools.cycle([[(0.0, each + frame)] for each in MALFORMED for frame in frames])


def nothing_but_malformed() -> Beats:
    return itertools.cycle([[(0.0, each)] for each in MALFORMED])


NOTHING: Beats = itertools.repeat([])
"""Beats that send nothing."""


class KartWire:
    """
    Listens for the kart and talks to it.

    :param recording: records every connection, and everything that is sent and received.
    :param tell: called with sentences for the inspector.
    :param kart_address: the only IPv4 address that counts as the kart; if empty, that of the first
        connection.
    :ivar newest: the number of the newest connection; 0 if there was none.
    """

    def __init__(
        self, recording: Recording, tell: Callable[[str], None], kart_address: str = ''
    ) -> None:
        self.kart_address = kart_address
        self.port = 0
        self._recording = recording
        self._tell = tell
        self._host = ''
        self._server: asyncio.Server | None = None
        self._links: list[Link] = []
        self.newest = 0
        self._beats = NOTHING
        self._greeting = b''
        self._period = 1 / BEAT_RATE
        self._changed = asyncio.Event()
        self._beating: asyncio.Task[None] | None = None
        self._refused: set[str] = set()

    async def listen(self, host: str, port: int) -> None:
        """
        Start to listen and to send beats.

        :raises OSError: if this computer cannot listen there.
        """
        self._host = host
        await self._open(port)
        self.keep_beating()

    def keep_beating(self) -> None:
        """Start to send beats, or restart after a failed beat."""
        if self._beating is None or self._beating.done():
            self._beating = asyncio.get_running_loop().create_task(self._beat())

    @property
    def connected(self) -> bool:
        """Return whether something can be sent to the kart."""
        return any(link.open and not link.mute for link in self._links)

    def order(
        self,
        state: RaceState,
        beats: Callable[[RaceState], Beats] = whole,
        rate: float = BEAT_RATE,
    ) -> None:
        """Send a state from now on."""
        self.send(beats(state), rate, encode(state))

    def send(self, beats: Beats, rate: float = BEAT_RATE, greeting: bytes = b'') -> None:
        """
        Send these beats from now on.

        :param greeting: bytes to send at once on a new connection.
        """
        self._beats, self._period, self._greeting = beats, 1 / rate, greeting
        self._changed.set()

    def send_now(self, data: bytes) -> None:
        """Send bytes immediately, independently of the beat."""
        for link in self._links:
            link.write(data)

    def end(self, how: str) -> None:
        """End every connection; see `Link.end`."""
        for link in self._links:
            link.end(how)

    def go_away(self) -> None:
        """End every connection and refuse new ones, like a race control that has ended."""
        if self._server is not None:
            self._server.close()
            self._server = None
        self.end('away')

    async def come_back(self) -> None:
        """Accept connections again, at the same port."""
        if self._server is None:
            await self._open(self.port)
            self._recording.note(Kind.BACK)

    async def shut_down(self) -> None:
        if self._beating is not None:
            self._beating.cancel()
            await asyncio.gather(self._beating, return_exceptions=True)
        self.go_away()
        await asyncio.sleep(0)  # the transports close in the next turn

    async def _open(self, port: int) -> None:
        self._server = await asyncio.get_running_loop().create_server(
            lambda: Link(self._recording, self._opened),
            self._host,
            port,
            family=socket.AF_INET,
            reuse_address=True,
        )
        self.port = self._server.sockets[0].getsockname()[1]

    async def _beat(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            self._changed.clear()
            self._notice_delay(loop.time() - due)
            for link in self._links:
                link.look()
            links = list(self._links)
            piece_due = loop.time()
            for pause, data in next(self._beats):
                if pause:
                    piece_due += pause
                    await asyncio.sleep(pause)
                for link in links:
                    link.write(data)
            self._notice_delay(loop.time() - piece_due)
            # A late beat is not made up for. A new order does not wait for the next beat.
            due = max(due + self._period, loop.time())
            # No asyncio.wait_for: before Python 3.12 it may swallow this task's cancellation.
            timer = loop.call_at(due, self._changed.set)
            await self._changed.wait()
            timer.cancel()
            due = min(due, loop.time())

    def _notice_delay(self, late: float) -> None:
        if late > LATE_BEAT:
            self._recording.note(Kind.HELD_UP, value=late)

    def _opened(self, link: Link) -> None:
        """Accept a new connection, or refuse it if it is not the kart's."""
        address = link.transport.get_extra_info('peername', ('?',))[0]
        if self._server is not None and not self.kart_address:
            self.kart_address = address
        # It may also have arrived while race control was going away.
        if self._server is None or address != self.kart_address:
            if self._server is not None and address not in self._refused:
                self._refused.add(address)
                self._tell(f'Refused a connection from {address}, which is not the kart.')
            link.open = False
            link.transport.abort()
            return
        self.newest += 1
        link.number = self.newest
        self._links = [*(each for each in self._links if each.open), link]
        self._recording.note(Kind.OPENED, link.number, text=address)
        if self._greeting:
            link.write(self._greeting)
