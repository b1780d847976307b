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
Keep every processor busy and see whether race control goes on: it ends if its ROS half is starved.

A race in GREEN_GREEN, beside so many busy loops per processor, each in a session of its own or all
in one; a stop ends each race.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

from evgp_protocol.states import RaceState
from evgp_rcs.priority import come_first
from evgp_testing.wire_race import WireRace

LOOPS = {'2 a processor, each a session': (2, True), '50 a processor, one session': (50, False)}


def waited(pid: int) -> dict[str, float]:
    """Return how long each thread of a process has waited for a processor so far, s."""
    tasks = pathlib.Path(f'/proc/{pid}/task').iterdir()
    return {each.name: int((each / 'schedstat').read_text().split()[1]) / 1e9 for each in tasks}


def race(folder: pathlib.Path, seconds: float) -> tuple[bool, float, float]:
    """Return whether race control went on, the longest wait in 0.25 s, and a stop's answer, s."""
    with WireRace(folder, (1, 2), []) as scene:
        scene.bring_to(RaceState.GREEN_GREEN)
        worst, until = 0.0, time.monotonic() + seconds
        before = waited(scene.control.pid)
        while time.monotonic() < until and scene.control.runs:
            time.sleep(0.25)
            with contextlib.suppress(FileNotFoundError):
                now = waited(scene.control.pid)
                worst = max(worst, *(now[each] - before.get(each, 0.0) for each in now))
                before = now
        began = time.monotonic()
        stopped = scene.control.runs and scene.official.call('all_kill').success
        return stopped, worst, time.monotonic() - began


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument('--times', type=int, default=5)
    parser.add_argument('--seconds', type=float, default=10.0)
    arguments = parser.parse_args()
    come_first()  # or it would look too late
    print('| busy loops | races | ended by starving | worst wait in 0.25 s, ms | stop, ms |')
    print('|---|---|---|---|---|')
    for name, (count, apart) in LOOPS.items():
        many = count * (os.cpu_count() or 1)
        loop = [sys.executable, '-c', 'while True: pass']
        if not apart:
            # One session for all, which ends with the first of them.
            loop = [
                'sh',
                '-c',
                f'for i in $(seq {many}); do {sys.executable} -c "$0" & done; wait',
            ]
            loop, many = [*loop, 'while True: pass'], 1
        busy = [subprocess.Popen(loop, start_new_session=True) for _ in range(many)]
        try:
            seen = []
            for _ in range(arguments.times):
                with tempfile.TemporaryDirectory() as folder:
                    seen.append(race(pathlib.Path(folder), arguments.seconds))
        finally:
            for each in busy:
                os.killpg(each.pid, 9)
                each.wait()
        ended = sum(not stopped for stopped, _, _ in seen)
        wait = max(worst for _, worst, _ in seen)
        stops = [took for _, _, took in seen]
        median, most = statistics.median(stops), max(stops)
        print(
            f'| {name} | {len(seen)} | {ended} | {wait * 1e3:.0f} '
            f'| {median * 1e3:.1f} / {most * 1e3:.1f} |',
            flush=True,
        )


if __name__ == '__main__':
    main()
