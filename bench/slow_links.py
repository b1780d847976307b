# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Measure what becomes of stops on slow, narrow and lossy links; ``--help`` says how.

    setup/in-workspace python bench/slow_links.py

Real sockets and race control's own links (``evgp_rcs.kart_link``), each to a kart on a machine
with a network of its own. Each kart says back every frame, stops itself after 1 s without one, and
connects again. A stop is covered if the kart has read it within 1 s, or had stopped itself by
then, or race control had given the link up by then (with at most a beat more).
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
from dataclasses import dataclass, field
import pathlib
import random
import socket
import statistics
import sys
import threading
import time

from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState
from evgp_rcs.hearing import Heard
from evgp_rcs.kart_link import KartLink

sys.path.append(str(pathlib.Path(__file__).parents[1] / 'test'))
from rig.networks import kart_address, Machine, NetworkError, RACE_CONTROL, Track  # noqa: E402

BEAT_RATE = 20.0
SEND_TIMEOUT = 1.0
LIMIT = 1.0
"""Time in which a stop must reach the kart, s."""

GRACE = 0.1
"""Time by which race control may notice later that it does not: a beat, and a busy machine, s."""

RED_RED, GREEN_GREEN = RaceState.RED_RED, RaceState.GREEN_GREEN


@dataclass(frozen=True)
class Air:
    """Delay toward the kart and back (s), share lost each way, and rate (bit/s; 0: no limit)."""

    toward: float = 0.01
    back: float = 0.01
    loss: float = 0.0
    rate: float = 0.0

    def __str__(self) -> str:
        """Return the columns of a table."""
        rate = f'{self.rate / 1000:.0f} kbit/s' if self.rate else '-'
        return f'{self.toward:.2f} | {self.back:.2f} | {self.loss:.0%} | {rate}'


AIRS = (
    *(Air(toward, 0.0) for toward in (0.0, 0.3, 0.6, 0.9, 1.1, 2.0, 3.0)),
    *(Air(0.0, back) for back in (0.3, 0.6, 0.9, 1.1, 3.0)),
    *(Air(both, both) for both in (0.05, 0.1, 0.2, 0.4, 0.5, 0.6, 1.5, 3.0)),
    *(Air(0.01, 0.01, loss) for loss in (0.05, 0.1, 0.2, 0.4)),
    *(Air(both, both, loss) for both in (0.1, 0.2, 0.4) for loss in (0.05, 0.2)),
    *(Air(0.01, 0.01, 0.0, rate) for rate in (8000, 16000, 32000, 64000)),
    *(Air(0.2, 0.2, 0.0, rate) for rate in (8000, 16000)),
    *(Air(0.05, 0.05, loss, rate) for loss in (0.05, 0.2) for rate in (8000, 64000)),
)


@dataclass
class Stop:
    """A stop: when it was given, and when the kart read it or race control gave the link up."""

    given: float
    read: float | None = None
    dropped: float | None = None


@dataclass
class Field:
    """A kart, and what befell it; written by two threads, each its own parts."""

    air: Air
    machine: Machine
    link: KartLink | None = None
    stop: Stop | None = None
    stops: list[Stop] = field(default_factory=list)
    ends: list[float] = field(default_factory=list)  # when the kart stopped itself, or was told
    begins: list[float] = field(default_factory=list)
    gaps: list[float] = field(default_factory=list)
    slow: int = 0


class Owner:
    """What owns the links here: it gives GREEN_GREEN, and a stop after a while."""

    def __init__(self, fields: dict[str, Field], stops: int) -> None:
        self._fields = fields
        self.wanted = stops
        self.has_all = asyncio.Event()
        self._of: dict[KartLink, Field] = {}
        self._serial = 0

    def now(self) -> float:
        return time.monotonic()

    def take_commands(self) -> None:
        pass

    def link_heard(self, link: KartLink, heard: Heard, serial: int) -> None:
        pass

    def link_slow(self, link: KartLink, age: float) -> None:
        self._of[link].slow += 1

    def link_made(self, link: KartLink, address: str) -> None:
        kart = self._fields[address]
        if kart.link is not None:
            kart.link.drop('replaced')
            self._note_dropped(kart)
        kart.link = link
        self._of[link] = kart
        link.set_up()
        self._order(link, GREEN_GREEN)
        self._stop_later(link)

    def link_lost(self, link: KartLink) -> None:
        kart = self._of[link]
        if kart.link is link:
            kart.link = None
            self._note_dropped(kart)

    def _note_dropped(self, kart: Field) -> None:
        if kart.stop is not None:
            kart.stop.dropped = time.monotonic()
            kart.stop = None

    def beat(self) -> None:
        loop = asyncio.get_running_loop()
        loop.call_later(1 / BEAT_RATE, self.beat)
        for kart in self._fields.values():
            if kart.link is not None:
                kart.link.beat()

    def _order(self, link: KartLink, state: RaceState) -> None:
        self._serial += 1
        link.order(state, self._serial)

    def _stop_later(self, link: KartLink) -> None:
        wait = random.uniform(0.2, 3.0)  # noqa: S311 - no secret
        asyncio.get_running_loop().call_later(wait, self._give_stop, link)

    def _give_stop(self, link: KartLink) -> None:
        kart = self._of[link]
        if kart.link is not link or len(kart.stops) >= self.wanted:
            return
        kart.stop = Stop(time.monotonic())
        kart.stops.append(kart.stop)
        if all(len(each.stops) >= self.wanted for each in self._fields.values()):
            self.has_all.set()
        self._order(link, RED_RED)
        asyncio.get_running_loop().call_later(1.6, self._green_again, link)

    def _green_again(self, link: KartLink) -> None:
        kart = self._of[link]
        if kart.link is link:
            kart.stop = None
            self._order(link, GREEN_GREEN)
            self._stop_later(link)


def drive(kart: Field, port: int, ending: threading.Event) -> None:
    """Be a kart: obey the last frame, say each back, stop after 1 s without one, come back."""
    while not ending.is_set():
        with contextlib.suppress(OSError), kart.machine.inside():
            link = socket.socket()
        with link, contextlib.suppress(OSError):
            link.settimeout(8.0)
            link.connect((RACE_CONTROL, port))
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            kart.begins.append(time.monotonic())
            obey(kart, link)
        kart.ends.append(time.monotonic())
        ending.wait(0.5)


def obey(kart: Field, link: socket.socket) -> None:
    """Obey until the connection ends or is silent for 1 s."""
    data, heard_at, state = b'', time.monotonic(), b''
    while True:
        link.settimeout(max(heard_at + 1.0 - time.monotonic(), 0.001))
        chunk = link.recv(4096)
        now = time.monotonic()
        if not chunk or now - heard_at >= 1.0:
            return
        *frames, data = (data + chunk).split(b';')
        for frame in frames:
            stop = kart.stop
            if frame == encode(RED_RED)[:-1] != state and stop is not None and stop.read is None:
                stop.read = now
            state = frame
            kart.gaps.append(now - heard_at)
            heard_at = now
            link.sendall(frame + b';')


def has_stopped(kart: Field, at: float) -> bool:
    """Return whether the kart had no connection then: it has stopped by itself."""
    begun = [each for each in kart.begins if each <= at]
    ended = [each for each in kart.ends if each <= at]
    return len(ended) >= len(begun)


def report(kart: Field) -> int:
    """Print the line of a kart; return how many of its stops nothing covered."""
    in_time = [s.read - s.given for s in kart.stops if s.read and s.read - s.given <= LIMIT]
    rest = [s for s in kart.stops if not (s.read and s.read - s.given <= LIMIT)]
    itself = [s for s in rest if has_stopped(kart, s.given + LIMIT)]
    rest = [s for s in rest if s not in itself]
    dropped = [s for s in rest if s.dropped and s.dropped - s.given <= LIMIT + GRACE]
    uncovered = [s for s in rest if s not in dropped]
    typical = f'{statistics.median(in_time):.2f} / {max(in_time):.2f}' if in_time else '-'
    gaps = sorted(kart.gaps)
    gap = f'{statistics.mean(gaps):.2f}' if gaps else '-'
    print(
        f'| {kart.air} | {len(kart.stops)} | {len(in_time)} | {typical} | {len(itself)} | '
        f'{len(dropped)} | {len(uncovered)} | {len(kart.begins)} | {gap} | {kart.slow} |',
        flush=True,
    )
    for stop in uncovered:
        print(f'  uncovered: {stop}', file=sys.stderr)
    return len(uncovered)


def measure(airs: tuple[Air, ...], stops: int, seconds: float, seed: int) -> int:
    """Measure in these airs at the same time; return how many stops nothing covered."""
    ending = threading.Event()
    with Track(seed) as track:
        control = track.machine('rcs', RACE_CONTROL)
        fields = {}
        for number, air in enumerate(airs, 1):
            machine = track.machine(f'kart{number}', kart_address(number))
            machine.air(air.loss, air.toward, delay_back=air.back, rate=air.rate)
            fields[machine.address] = Field(air, machine)
        with control.inside():
            listening = socket.create_server((RACE_CONTROL, 0))
        port = listening.getsockname()[1]
        threads = [
            threading.Thread(target=drive, args=(kart, port, ending), daemon=True)
            for kart in fields.values()
        ]

        async def serve() -> None:
            owner = Owner(fields, stops)
            server = await asyncio.get_running_loop().create_server(
                lambda: KartLink(owner, BEAT_RATE, SEND_TIMEOUT), sock=listening
            )
            owner.beat()
            for thread in threads:
                thread.start()
            with contextlib.suppress(asyncio.TimeoutError):
                await asyncio.wait_for(owner.has_all.wait(), seconds)
            owner.wanted = 0
            await asyncio.sleep(2.0)
            server.close()

        asyncio.run(serve())
        ending.set()
        return sum(report(kart) for kart in fields.values())


def main() -> int:
    """Measure; return 0, or 1 if a stop was covered by nothing."""
    parser = argparse.ArgumentParser(description='Measure stops on slow, narrow, lossy links.')
    parser.add_argument('--stops', type=int, default=20, help='on each link (20)')
    parser.add_argument('--seconds', type=float, default=100.0, help='at most, for each set (100)')
    parser.add_argument('--links', type=int, default=14, help='at the same time (14)')
    parser.add_argument('--seed', type=int, default=0, help='of what is lost (0)')
    options = parser.parse_args()
    print(
        '| toward, s | back, s | lost | rate | stops | read within 1 s | median / worst, s '
        '| kart had stopped | given up | uncovered | connections | mean gap, s | told slow |'
    )
    print('|---|---|---|---|---|---|---|---|---|---|---|---|---|')
    uncovered = 0
    try:
        for first in range(0, len(AIRS), options.links):
            last = first + options.links
            airs = AIRS[first:last]
            uncovered += measure(airs, options.stops, options.seconds, options.seed)
    except NetworkError as error:
        print(error, file=sys.stderr)
        return 2
    print(f'uncovered: {uncovered}')
    return int(uncovered > 0)


if __name__ == '__main__':
    sys.exit(main())
