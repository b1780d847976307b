# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Freeze programs around race control, in traffic, and see whether a kart or a stop notices.

``setup/in-workspace python bench/freezes.py --times 1000``. What is frozen (SIGSTOP) in turn: a
client that calls services without a pause, an official's ``rcs_ctl watch``, and race control's own
ROS half, for less than its limit and for more. Meanwhile another official sends stops.

A gap is measured on the wire, by the kernel (`arrivals`; root only): the process that plays the
karts here shares the processors with all others.
"""

from __future__ import annotations

import argparse
import contextlib
import pathlib
import random
import signal
import statistics
import sys
import tempfile
import time

from arrivals import Arrivals
from evgp_protocol.states import RaceState
from evgp_testing.process import executable, Program
from evgp_testing.wire_race import WireRace

KARTS = range(1, 6)

GAP = 0.1
"""Maximum time between two frames, in seconds."""

STOP = 0.05
"""Maximum time from an official's call of a stop to the answer, in seconds."""

CALLER = """
import sys
from evgp_testing.official import Official
official = Official(int(sys.argv[1]), 'caller')
while True:
    official.call_all('kart/finish', [{'kart': 60000}] * 20)
"""
"""A client of services that never pauses: it asks for a finish of a kart that is not there."""


def typical_and_worst(values: list[float]) -> str:
    """Return median and worst, ms."""
    return f'{statistics.median(values) * 1e3:.1f} / {max(values) * 1e3:.1f}'


class Gaps:
    """Worst gap on the wire of all karts at each freeze, in seconds."""

    def __init__(self) -> None:
        """Begin."""
        self._worst: list[float] = []

    def follow(self, stack: contextlib.ExitStack, parts: WireRace) -> None:
        """Listen to the karts of this race."""
        self._karts = parts.karts
        self._arrivals = stack.enter_context(Arrivals(parts.control.port))
        for kart in self._karts:
            kart.wait_for_frames(2)  # what the first gap begins with
        self._arrivals.worst_gap(len(self._karts))

    def note(self) -> None:
        """Note the worst gap that ended since the last call."""
        # Behind the last frame of a connection that has ended is no gap.
        ended = any(kart.ended for kart in self._karts)
        self._worst.append(self._arrivals.worst_gap(len(self._karts), going_on=not ended))

    def __str__(self) -> str:
        """Return two columns of the table."""
        return f'{typical_and_worst(self._worst)} | {sum(gap > GAP for gap in self._worst)}'


def race(stack: contextlib.ExitStack, folder: pathlib.Path) -> WireRace:
    """Have race control, an official, and every kart connected."""
    return stack.enter_context(WireRace(folder, KARTS, parameters={'pause': 0.5}))


def freeze_others(folder: pathlib.Path, times: int, what: str) -> None:
    """Freeze a program that race control's ROS half talks to."""
    stops, gaps = [], Gaps()
    with contextlib.ExitStack() as stack:
        parts = race(stack, folder)
        domain, official = parts.domain, parts.official
        official.command('all_kill')
        gaps.follow(stack, parts)
        if what == 'watch':
            command = [executable('evgp_rcs_console', 'rcs_ctl'), 'watch']
            program = Program('rcs_ctl', command, domain)
        else:
            program = Program('caller', [sys.executable, '-c', CALLER, str(domain)], domain)
        stack.callback(program.kill)
        time.sleep(3.0)  # DDS meets, and the traffic begins
        for _ in range(times):
            time.sleep(random.uniform(0.0, 0.05))  # noqa: S311 - no secret
            program.signal(signal.SIGSTOP)
            for _ in range(3):
                time.sleep(random.uniform(0.02, 0.08))  # noqa: S311 - no secret
                began = time.monotonic()
                assert official.call('all_kill').success
                stops.append(time.monotonic() - began)
            program.signal(signal.SIGCONT)
            gaps.note()
            assert not any(kart.ended for kart in parts.karts), 'a kart was dropped'
    slow = sum(stop > STOP for stop in stops)
    print(
        f'| {what} | {times} | {gaps} | {typical_and_worst(stops)} | {slow} of {len(stops)} |',
        flush=True,
    )


def freeze_ros_half(folder: pathlib.Path, times: int) -> None:
    """Freeze the ROS half, for less than its limit: no kart may notice."""
    gaps = Gaps()
    with contextlib.ExitStack() as stack:
        parts = race(stack, folder)
        control = parts.control
        gaps.follow(stack, parts)
        for _ in range(times):
            time.sleep(random.uniform(0.0, 0.05))  # noqa: S311 - no secret
            control.signal(signal.SIGSTOP)
            time.sleep(random.uniform(0.05, 0.5))  # noqa: S311 - no secret
            control.signal(signal.SIGCONT)
            time.sleep(0.05)
            gaps.note()
            assert not any(kart.ended for kart in parts.karts), 'a kart was dropped'
    print(f'| ROS half, up to 0.5 s | {times} | {gaps} | - | - |', flush=True)


def freeze_ros_half_for_good(folder: pathlib.Path, times: int) -> None:
    """Freeze the ROS half for more than its limit: every kart gets RED_RED, and when."""
    took, gaps = [], Gaps()
    for number in range(times):
        with contextlib.ExitStack() as stack:
            own = folder / f'run{number}'
            own.mkdir()
            parts = race(stack, own)
            gaps.follow(stack, parts)
            since = time.monotonic()
            parts.control.signal(signal.SIGSTOP)
            for kart in parts.karts:
                kart.wait_for_end()
                assert kart.state is RaceState.RED_RED
                took.append(kart.changes[-1][0] - since)
            gaps.note()
    print(
        f'| ROS half, for good | {times} | {gaps} '
        f'| RED_RED after {min(took):.2f}-{max(took):.2f} s | - |',
        flush=True,
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--times', type=int, default=100)
    times = parser.parse_args().times
    print(
        '| frozen | times | worst gap of a kart, on the wire, ms, median / worst | over 100 ms '
        "| another official's stop, call to answer, ms | over 50 ms |"
    )
    print('|---|---|---|---|---|---|', flush=True)
    for what in ('client', 'watch'):
        with tempfile.TemporaryDirectory() as folder:
            freeze_others(pathlib.Path(folder), times, what)
    with tempfile.TemporaryDirectory() as folder:
        freeze_ros_half(pathlib.Path(folder), times)
    with tempfile.TemporaryDirectory() as folder:
        freeze_ros_half_for_good(pathlib.Path(folder), max(1, times // 50))


if __name__ == '__main__':
    main()
