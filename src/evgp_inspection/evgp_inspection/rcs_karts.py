# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The karts' end of the wire, for the inspection of a race control.

Each kart connects from an address of its own. What it says is what the inspection lets it say: it
says the state it is being sent if that is one of its `answers`, with every frame.
"""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import struct

from evgp_inspection.recording import Link, Recording
from evgp_inspection.traces import Kind, STRANGER
from evgp_protocol.frames import encode, FrameDecoder, StateFrame
from evgp_protocol.states import RaceState

ATTACH_FILTER, DETACH_FILTER = 26, 27
"""Options of Linux that Python does not name."""

LATE_LOOK = 0.15
"""Maximum delay of this computer that is no excuse, in seconds: two of them, one after the other,
are no gap that a race control must not leave."""


class KartLink(Link):
    """
    One connection of a kart.

    :ivar sent: what it is sent.
    """

    def __init__(self, kart: PlayedKart) -> None:
        super().__init__(kart.field.recording, kart.field.opened)
        self.sent: RaceState | None = None
        self.kart = kart
        self._decoder = FrameDecoder()

    def take(self, data: bytes) -> None:
        """Take what race control sends."""
        for frame in self._decoder.feed(data):
            if isinstance(frame, StateFrame):
                self.sent = frame.state
        super().take(data)
        if self.sent in self.kart.answers:
            self.write(encode(self.sent))

    def vanish(self) -> None:
        """Answer nothing any more, not even in TCP, as a kart that has left the network."""
        program = ctypes.create_string_buffer(struct.pack('HBBI', 6, 0, 0, 0))  # take nothing
        self._program = program  # lives as long as the call
        self.option(ATTACH_FILTER, struct.pack('HxxxxxxP', 1, ctypes.addressof(program)))
        self.recording.note(Kind.SILENT, self.number, text='the kart vanishes')

    def appear(self) -> None:
        """Answer again; if race control has given this connection up, that is seen now."""
        self.option(DETACH_FILTER, struct.pack('i', 0))
        self.write(encode(RaceState.RED_RED))


class PlayedKart:
    """
    A kart, or (number 0) somebody whose address is no kart's.

    :ivar answers: the states that it acknowledges.
    :ivar link: its newest connection.
    """

    def __init__(self, field: PlayedKarts, number: int, address: str) -> None:
        self.field = field
        self.number = number
        self.name = f'kart {number}' if number else STRANGER
        self.address = address
        self.answers: frozenset[RaceState] = frozenset()
        self.link: KartLink | None = None
        self.links: list[KartLink] = []

    @property
    def sent(self) -> RaceState | None:
        """Return what it is being sent; None: nothing, or it is not connected."""
        return self.link.sent if self.link is not None and self.link.open else None

    async def connect(self) -> bool:
        """Connect; return whether race control took the connection."""
        loop = asyncio.get_running_loop()
        try:
            _, link = await asyncio.wait_for(
                loop.create_connection(
                    lambda: KartLink(self),
                    self.field.host,
                    self.field.port,
                    local_addr=(self.address, 0),
                ),
                5.0,
            )
        except (OSError, TimeoutError, asyncio.TimeoutError):
            return False
        self.link = link
        self.links.append(link)
        return True

    def write(self, data: bytes) -> None:
        """Write bytes on its newest connection."""
        if self.link is not None:
            self.link.write(data)

    def end(self, reset: bool = False) -> None:
        """End its newest connection."""
        if self.link is not None:
            self.link.end(reset)


class PlayedKarts:
    """
    All karts that the inspection plays.

    :param addresses: the IPv4 address of each kart, by its number.
    :param stranger: an address that is no kart's.
    """

    def __init__(
        self,
        recording: Recording,
        host: str,
        port: int,
        addresses: dict[int, str],
        stranger: str,
    ) -> None:
        self.recording = recording
        self.host = host
        self.port = port
        self.karts = [PlayedKart(self, *each) for each in addresses.items()]
        self.stranger = PlayedKart(self, 0, stranger)
        self.count = 0
        self._watching = asyncio.get_running_loop().create_task(self._watch())

    def opened(self, link: Link) -> None:
        """Take note of a new connection."""
        assert isinstance(link, KartLink)
        self.count += 1
        link.number = self.count
        self.recording.note(Kind.OPENED, self.count, text=link.kart.name)

    async def close(self) -> None:
        """End every connection."""
        self._watching.cancel()
        for kart in (*self.karts, self.stranger):
            for link in kart.links:
                link.end()
        with contextlib.suppress(asyncio.CancelledError):
            await self._watching

    async def _watch(self) -> None:
        """Take note when this computer itself is held up."""
        loop = asyncio.get_running_loop()
        while True:
            before = loop.time()
            await asyncio.sleep(0.05)
            late = loop.time() - before - 0.05
            if late > LATE_LOOK:
                self.recording.note(Kind.HELD_UP, value=late)
