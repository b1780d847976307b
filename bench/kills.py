# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Kill either half of race control in each of the five states, and see what karts get, and when.

``setup/in-workspace python bench/kills.py --times 50``. After each kill race control starts again
on the same record: what every kart hears first is written down too.
"""

from __future__ import annotations

import argparse
from collections import Counter
import contextlib
import os
import pathlib
import signal
import statistics
import tempfile
import time

from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.domains import Domain
from evgp_testing.race_control import address_of, RaceControl
from evgp_testing.wire_kart import WireKart
from evgp_testing.wire_race import WireRace

RACING = (1, 2)
OUTSIDE = 3
STATES = tuple(
    RaceState[name] for name in ('IN_GARAGE', 'GRID_ACTIVE', 'GREEN_GREEN', 'RED_FLAG', 'RED_RED')
)


class Figures:
    """What was seen of one half in one state."""

    def __init__(self) -> None:
        """Begin with nothing seen."""
        self.last: Counter[str] = Counter()
        self.first: Counter[str] = Counter()
        self.ended: list[float] = []
        self.told: list[float] = []


def one(folder: pathlib.Path, state: RaceState, kills_ros_half: bool, figures: Figures) -> None:
    """Kill once, and start again."""
    with contextlib.ExitStack() as stack:
        race = stack.enter_context(WireRace(folder, RACING, [OUTSIDE]))
        control, official, karts = race.control, race.official, race.karts
        race.bring_to(state)
        at = time.monotonic()
        os.kill(control.pid if kills_ros_half else control.kart_server_pid, signal.SIGKILL)
        for kart in karts:
            kart.wait_for_end()
            figures.ended.append(time.monotonic() - at)
            assert kart.state is not None
            figures.last[kart.state.value] += 1
        if not kills_ros_half:
            official.wait_for_race(
                lambda race: any(alert.kind == msg.Alert.PART_FAILED for alert in race.alerts),
                'the alert',
            )
            figures.told.append(time.monotonic() - at)
        control.wait()
    with contextlib.ExitStack() as stack:
        domain = stack.enter_context(Domain()).number
        control = stack.enter_context(RaceControl(folder, domain, RACING, [OUTSIDE]))
        for number in (*RACING, OUTSIDE):
            kart = stack.enter_context(WireKart(address_of(number), control.port))
            kart.wait_for_frames(3)
            figures.first['+'.join(each.value for _, each in kart.changes)] += 1


def listed(counter: Counter[str]) -> str:
    """Return what was counted, the most frequent first."""
    return ', '.join(f'{name} {count}' for name, count in counter.most_common())


def typical_and_worst(values: list[float]) -> str:
    """Return median and worst, ms."""
    return f'{statistics.median(values) * 1e3:.1f} / {max(values) * 1e3:.1f}' if values else '-'


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--times', type=int, default=5, help='of each half in each state')
    times = parser.parse_args().times
    print(
        '| killed | in | times | what karts heard last '
        '| connection gone after, ms, median / worst | officials told after, ms '
        '| what karts hear first of the next race control |'
    )
    print('|---|---|---|---|---|---|---|', flush=True)
    for kills_ros_half in (True, False):
        for state in STATES:
            figures = Figures()
            for _ in range(times):
                with tempfile.TemporaryDirectory() as folder:
                    one(pathlib.Path(folder), state, kills_ros_half, figures)
            print(
                f'| {"ROS half" if kills_ros_half else "kart server"} | {state.value} | {times} '
                f'| {listed(figures.last)} | {typical_and_worst(figures.ended)} '
                f'| {typical_and_worst(figures.told)} | {listed(figures.first)} |',
                flush=True,
            )


if __name__ == '__main__':
    main()
