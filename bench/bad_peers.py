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
Measure what good karts notice of bad peers: their frames, and how soon ALL_KILL is there.

    setup/in-workspace python bench/bad_peers.py
"""

from __future__ import annotations

import argparse
import contextlib
import os
import pathlib
import statistics
import sys
import tempfile
import time

from evgp_protocol.states import RaceState
from evgp_testing.bad_peers import attacked_race, attacking, ATTACKS, end_race
from evgp_testing.usage import resident
from evgp_testing.wire_race import WireRace


def measure(race: WireRace, name: str, repetitions: int) -> None:
    """Print a line: the frames of the good karts and the time of ALL_KILL under an attack."""
    kills: list[float] = []
    gap = 0.0
    frames, seconds = 0, 0.0
    memory = resident(race.control.pid)
    lines = len(race.control.lines)
    attack = attacking(name, race.control.port) if name else contextlib.nullcontext()
    with attack:
        began_all = time.monotonic()
        for _ in range(repetitions):
            race.bring_to(RaceState.GREEN_GREEN)
            began = time.monotonic()
            before = race.karts[0].frames
            race.karts[0].wait_for_frames(20)
            seconds += time.monotonic() - began
            frames += race.karts[0].frames - before
            gap = max(gap, *(kart.worst_gap(began) for kart in race.karts))
            called = time.monotonic()
            race.official.command('all_kill')
            kills.append(
                max(kart.wait_for_state(RaceState.RED_RED) for kart in race.karts) - called
            )
            end_race(race)
        took = time.monotonic() - began_all
    columns = (
        name or 'none',
        f'{frames / seconds:.1f}',
        f'{gap * 1000:.0f}',
        f'{statistics.median(kills) * 1000:.1f} / {max(kills) * 1000:.1f}',
        f'{resident(race.control.pid) - memory:+d}',
        f'{(len(race.control.lines) - lines) / took:.1f}',
    )
    print(f'| {" | ".join(columns)} |', flush=True)


def main() -> int:
    """Measure every attack, and before and after them none."""
    parser = argparse.ArgumentParser(description='Measure what good karts notice of bad peers.')
    parser.add_argument('--repetitions', type=int, default=20, help='of each ALL_KILL (20)')
    parser.add_argument('--only', default='', help='only attacks whose name has this in it')
    options = parser.parse_args()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    print(
        '| bad peer | frames per second | worst gap, ms | ALL_KILL: call to last frame, ms, '
        f'median / worst of {options.repetitions} | memory, KiB | log lines per second |'
    )
    print('|---|---|---|---|---|---|')
    with (
        tempfile.TemporaryDirectory() as folder,
        attacked_race(pathlib.Path(folder)) as race,
    ):
        for name in ['', *(each for each in ATTACKS if options.only in each), '']:
            measure(race, name, options.repetitions)
    return 0


if __name__ == '__main__':
    sys.exit(main())
