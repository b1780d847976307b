# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Measure what becomes of stops on slow, narrow and lossy links; ``--help`` says how.

    setup/in-workspace python bench/slow_links.py

Real race control, and karts on machines with networks of their own. Each kart says back every
frame, stops itself after 1 s without one, and connects again. A stop is covered if the kart has
read it within 1 s, or had stopped itself by then, or race control had given the link up by then
(with at most a beat more), be it before the stop was given: officials see it as lost.
"""

from __future__ import annotations

import argparse
import contextlib
from dataclasses import dataclass, field
import itertools
import math
import pathlib
import random
import socket
import statistics
import sys
import tempfile
import threading
import time

from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.domains import Domain
from evgp_testing.official import Official
from evgp_testing.race_control import RaceControl

sys.path.append(str(pathlib.Path(__file__).parents[1] / 'test'))
from rig.networks import kart_address, Machine, NetworkError, RACE_CONTROL, Track  # noqa: E402

LIMIT = 1.0
"""Time in which a stop must reach the kart, in seconds."""

GRACE = 0.1
"""Time by which race control may notice later that it does not: a beat, and a busy machine, s."""

RED_RED = encode(RaceState.RED_RED)[:-1]


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
class Kart:
    """A kart, and what befell it; `drive` writes it in a thread, `press` in another."""

    number: int
    air: Air
    machine: Machine
    state: bytes = b''  # of the newest frame of this connection
    begins: list[float] = field(default_factory=list)
    ends: list[float] = field(default_factory=list)  # when it stopped itself, or was told
    stops: list[float] = field(default_factory=list)  # when each was given
    reads: list[float] = field(default_factory=list)  # when each RED_RED began
    due: float = 0.0
    released: float = 0.0  # infinite: it is held

    def drive(self, port: int, ending: threading.Event) -> None:
        """Obey the last frame, say each back, stop after 1 s without one, come back."""
        while not ending.is_set():
            with contextlib.suppress(OSError), self.machine.inside():
                link = socket.socket()
            with link, contextlib.suppress(OSError):
                link.settimeout(8.0)
                link.connect((RACE_CONTROL, port))
                link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self.state = b''
                self._obey(link, ending)
            if len(self.ends) < len(self.begins):
                self.ends.append(time.monotonic())
            ending.wait(0.5)

    def _obey(self, link: socket.socket, ending: threading.Event) -> None:
        data, heard_at = b'', time.monotonic()
        while not ending.is_set():
            link.settimeout(max(heard_at + 1.0 - time.monotonic(), 0.001))
            chunk = link.recv(4096)
            now = time.monotonic()
            if not chunk or now - heard_at >= 1.0:
                return
            heard_at = now
            if not self.state:
                self.begins.append(now)  # until here it stands
            *frames, data = (data + chunk).split(b';')
            for frame in frames:
                if frame == RED_RED != self.state:
                    self.reads.append(now)
                self.state = frame
                link.sendall(frame + b';')

    def press(self, official: Official) -> None:
        """Give the next stop, or end the last one once race control lets it."""
        if self.released < time.monotonic():
            if self.state != RED_RED:
                self.stops.append(time.monotonic())
                self.released = float('inf')
                assert official.call('kart/red_red', kart=self.number).success
                self.due = time.monotonic() + 1.6
        elif official.call('kart/in_garage', kart=self.number, made_safe_by_hand=True).success:
            self.released = time.monotonic()
            # No RED_RED from before is under way any more.
            self.due = self.released + self.air.toward + random.uniform(1.2, 4.0)  # noqa: S311

    def had_stopped(self, at: float) -> bool:
        """Return whether it had no connection then: it has stopped by itself."""
        return sum(each <= at for each in self.ends) >= sum(each <= at for each in self.begins)

    def report(self, connected: list[tuple[float, bool]]) -> int:
        """
        Print its line; return how many of its stops nothing covered.

        `connected` holds when race control took and lost its links.
        """
        took: list[float] = []
        itself, dropped, uncovered = 0, 0, 0
        for stop in self.stops:
            read = next((at for at in self.reads if stop <= at <= stop + LIMIT), None)
            if read is not None:
                took.append(read - stop)
            elif self.had_stopped(stop + LIMIT):
                itself += 1
            elif any(
                not holds and at <= stop + LIMIT + GRACE and until >= stop
                for (at, holds), (until, _) in itertools.pairwise([*connected, (math.inf, True)])
            ):
                dropped += 1
            else:
                uncovered += 1
        typical = f'{statistics.median(took):.2f} / {max(took):.2f}' if took else '-'
        print(
            f'| {self.air} | {len(self.stops)} | {len(took)} | {typical} | {itself} | {dropped} '
            f'| {uncovered} | {len(self.begins)} |',
            flush=True,
        )
        return uncovered


def measure(airs: tuple[Air, ...], stops: int, seconds: float, seed: int) -> int:
    """Measure in these airs at the same time; return how many stops nothing covered."""
    ending = threading.Event()
    numbers = range(1, len(airs) + 1)
    with contextlib.ExitStack() as stack:
        track = stack.enter_context(Track(seed))
        domain = stack.enter_context(Domain()).number
        folder = pathlib.Path(stack.enter_context(tempfile.TemporaryDirectory()))
        with track.machine('rcs', RACE_CONTROL).inside():
            control = stack.enter_context(
                RaceControl(
                    folder,
                    domain,
                    numbers,
                    parameters={'address': RACE_CONTROL},
                    addresses=kart_address,
                )
            )
            official = stack.enter_context(Official(domain))
        karts = []
        for number, air in zip(numbers, airs, strict=True):
            machine = track.machine(f'kart{number}', kart_address(number))
            machine.air(air.loss, air.toward, delay_back=air.back, rate=air.rate)
            karts.append(Kart(number, air, machine, due=time.monotonic() + 3.0))  # connected
        for kart in karts:
            drive = threading.Thread(target=kart.drive, args=(control.port, ending))
            drive.start()
            stack.callback(drive.join)
        stack.callback(ending.set)
        until = time.monotonic() + seconds
        while time.monotonic() < until and any(len(kart.stops) < stops for kart in karts):
            for kart in karts:
                if time.monotonic() >= kart.due and len(kart.stops) < stops:
                    kart.press(official)
            time.sleep(0.005)
        time.sleep(LIMIT + GRACE)
        connected: dict[int, list[tuple[float, bool]]] = {}
        for event in official.events:
            if event.kind in (msg.RaceEvent.CONNECTED, msg.RaceEvent.DISCONNECTED):
                at = event.monotonic.sec + event.monotonic.nanosec * 1e-9
                holds = event.kind == msg.RaceEvent.CONNECTED
                connected.setdefault(event.kart, []).append((at, holds))
        return sum(kart.report(connected.get(kart.number, [])) for kart in karts)


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
        '| kart had stopped | given up | uncovered | connections |'
    )
    print('|---|---|---|---|---|---|---|---|---|---|---|')
    uncovered = 0
    try:
        with Track() as track, track.middle.inside(), Domain() as domain:
            Official(domain.number).close()  # Fast DDS looks for the networks once
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
