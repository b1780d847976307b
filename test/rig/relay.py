# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The air between the machines of a track: a switch that loses and delays what it is told to.

It runs as a process of its own, in the network namespace that has one end of every machine's
cable, and needs nothing but the standard library. Ethernet frames (IPv4 and ARP) go from cable
to cable by their destination, broadcasts and multicasts to each; for each machine and direction
there is a share that is lost, a delay, and perhaps a rate, with a queue before it. Orders come as
one line of JSON each on standard input, and each is answered by the time at which it was carried
out (monotonic, s) on standard output; when the input ends, so does the relay.
"""

from __future__ import annotations

import contextlib
import dataclasses
import heapq
import itertools
import json
import os
import selectors
import socket
import sys
import time

_SOL_PACKET = 263
_PACKET_IGNORE_OUTGOING = 23
_EVERY_PROTOCOL = 0x0003
_IPV4, _ARP = b'\x08\x00', b'\x08\x06'
_TO_MANY = 0x01  # in the first byte of the destination: a broadcast, or a multicast


@dataclasses.dataclass
class Air:
    """
    What happens to frames in one direction.

    :ivar loss: the share that is lost, from 0 to 1, evenly spaced, as chance could lose one frame
        again and again.
    :ivar delay: how late they come, s.
    :ivar rate: how fast they go, bit/s; 0: at once.
    """

    loss: float = 0.0
    delay: float = 0.0
    rate: float = 0.0
    free_at: float = 0.0
    owed: float = 0.0

    def loses(self) -> bool:
        """Return whether the next frame is lost."""
        self.owed = self.owed % 1 + self.loss
        return self.owed >= 1

    def due(self, now: float, size: int) -> float:
        """Return when a frame of so many bytes that comes now has passed."""
        if self.rate:
            now = max(now, self.free_at)
            self.free_at = now = now + size * 8 / self.rate
        return now + self.delay


class Cable:
    """The relay's end of one machine's cable."""

    def __init__(self, name: str) -> None:
        self.hardware = b''  # of the machine, once it has sent something
        self.toward = Air()
        self.back = Air()
        self.socket = socket.socket(
            socket.AF_PACKET, socket.SOCK_RAW, socket.htons(_EVERY_PROTOCOL)
        )
        self.socket.setsockopt(_SOL_PACKET, _PACKET_IGNORE_OUTGOING, 1)
        self.socket.bind((name, 0))
        self.socket.setblocking(False)


class Relay:
    """Every cable, and the frames that are on their way."""

    def __init__(self) -> None:
        self._cables: dict[str, Cable] = {}
        self._late: list[tuple[float, int, Cable, bytes]] = []
        self._order = itertools.count()
        self._selector = selectors.DefaultSelector()

    def run(self) -> None:
        """Relay frames and obey orders until there are none any more."""
        self._selector.register(sys.stdin, selectors.EVENT_READ)
        while True:
            wait = max(self._late[0][0] - time.monotonic(), 0) if self._late else None
            for ready, _ in self._selector.select(wait):
                if ready.data is not None:
                    self._read(ready.data)
                elif line := sys.stdin.readline():
                    order = json.loads(line)
                    getattr(self, f'order_{order.pop("do")}')(**order)
                    print(time.monotonic(), flush=True)
                else:
                    return
            while self._late and self._late[0][0] <= time.monotonic():
                _, _, target, frame = heapq.heappop(self._late)
                self._deliver(target, frame)

    # ----- orders -------------------------------------------------------------------------

    def order_plug(self, name: str) -> None:
        """Take a cable that is there."""
        cable = self._cables[name] = Cable(name)
        self._selector.register(cable.socket, selectors.EVENT_READ, cable)

    def order_air(self, name: str, toward: list[float], back: list[float]) -> None:
        """Set loss, delay and rate toward a machine and back from it."""
        cable = self._cables[name]
        for air, (loss, delay, rate) in ((cable.toward, toward), (cable.back, back)):
            air.loss, air.delay, air.rate = loss, delay, rate

    # ----- frames -------------------------------------------------------------------------

    def _read(self, source: Cable) -> None:
        try:
            frame = source.socket.recv(65535)
        except OSError:
            return  # the link is down
        if len(frame) < 34 or frame[12:14] not in (_IPV4, _ARP):
            return
        source.hardware = frame[6:12]
        for target in self._cables.values():
            if target is source or not (frame[0] & _TO_MANY or frame[:6] == target.hardware):
                continue
            if source.back.loses() or target.toward.loses():
                continue
            now = time.monotonic()
            due = target.toward.due(source.back.due(now, len(frame)), len(frame))
            if due > now:
                heapq.heappush(self._late, (due, next(self._order), target, frame))
            else:
                self._deliver(target, frame)

    def _deliver(self, target: Cable, frame: bytes) -> None:
        with contextlib.suppress(OSError):  # the link is down
            target.socket.send(frame)


if __name__ == '__main__':
    # A network waits for no program; without the right, this one may on a busy computer.
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    Relay().run()
