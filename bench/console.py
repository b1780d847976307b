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
How fast ALL KILL of the officials' window is, and what an idle window costs.

    setup/in-workspace --console python bench/console.py

A real window on an X server (Xvfb), a real race control, real kart sockets, all on this machine.
Each round begins with a race in IN_GARAGE and every kart there, and ends when the last kart has
the first byte of its RED_RED. The three ways are taken in turn:

- click: the mouse button goes down (XTEST) on ALL KILL;
- key: the space bar goes down;
- call: a ROS client that has been there all along calls the service, without any window.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import contextlib
import pathlib
import statistics
import tempfile
import time

from evgp_protocol.states import RaceState
from evgp_testing.console import Console
from evgp_testing.screen import Screen
from evgp_testing.usage import cpu_seconds
from evgp_testing.wire_race import WireRace


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description='ALL KILL of the window, from click to wire.')
    parser.add_argument('--rounds', type=int, default=200, help='of each way (%(default)s)')
    parser.add_argument('--karts', type=int, default=5, help='in the rounds (%(default)s)')
    parser.add_argument('--idle-karts', type=int, default=20, help='while idle (%(default)s)')
    parser.add_argument('--idle', type=float, default=30.0, help='seconds (%(default)s)')
    wanted = parser.parse_args()
    measure_stops(wanted.rounds, wanted.karts)
    measure_idle(wanted.idle_karts, wanted.idle)


def measure_stops(rounds: int, count: int) -> None:
    """Print the time from a press to the last kart's socket, for each way of pressing."""
    with contextlib.ExitStack() as parts:
        race, console, screen = prepare(parts, count)
        spot = console.place('all_kill')
        screen.move(*spot)
        times: dict[str, list[float]] = {'click': [], 'key': [], 'call': []}

        def call() -> None:
            race.official.call('all_kill')

        def click() -> None:
            screen.press_button()
            screen.release_button()

        presses: dict[str, Callable[[], None]] = {
            'click': click,
            'key': lambda: screen.key('space'),
            'call': call,
        }
        for _ in range(rounds):
            for way, press in presses.items():
                began = time.monotonic()
                press()
                last = max(kart.wait_for_state(RaceState.RED_RED) for kart in race.karts)
                times[way].append((last - began) * 1000)
                bring_home(race, console)
        print(f'ALL KILL, {rounds} rounds of each, {count} karts; from the press to the last kart')
        print(f'{"":8} {"median":>10} {"p99":>10} {"worst":>10}')
        for way, all_ in times.items():
            all_.sort()
            p99 = all_[min(len(all_) - 1, round(0.99 * len(all_)))]
            print(f'{way:8} {statistics.median(all_):7.2f} ms {p99:7.2f} ms {all_[-1]:7.2f} ms')
        print(f'the window and the call: {statistics.median(times["click"]):.2f} ms', end=' ')
        print(f'beside {statistics.median(times["call"]):.2f} ms (median)')


def bring_home(race: WireRace, console: Console) -> None:
    """Have every kart in IN_GARAGE again, and the window idle."""
    race.official.wait_for_acks(RaceState.RED_RED, *race.racing)
    race.bring_to(RaceState.IN_GARAGE)
    for kart in race.karts:
        kart.wait_for_state(RaceState.IN_GARAGE)
    console.wait_for('state', text='IN GARAGE')
    console.wait_for('all_kill', pressing='false')


def measure_idle(count: int, seconds: float) -> None:
    """Print how much of one core a window takes with which nobody does anything."""
    with contextlib.ExitStack() as parts:
        _, console, _ = prepare(parts, count)
        for state in ('IN GARAGE', 'GREEN GREEN'):
            if state == 'GREEN GREEN':
                console.start_race()
            console.wait_for('state', text=state)
            before = cpu_seconds(console.pid)
            time.sleep(seconds)
            used = (cpu_seconds(console.pid) - before) / seconds
            print(f'idle window, {count} karts, {state}: {100 * used:.1f} % of one core')


def prepare(parts: contextlib.ExitStack, count: int) -> tuple[WireRace, Console, Screen]:
    """Start a race control, its karts, an official and a window."""
    folder = pathlib.Path(parts.enter_context(tempfile.TemporaryDirectory()))
    race = parts.enter_context(WireRace(folder, range(1, count + 1), parameters={'pause': 0.5}))
    screen = parts.enter_context(Screen())
    console = parts.enter_context(Console(folder, race.domain, screen))
    console.wait_for(f'kart_{count}', text='linked')
    return race, console, screen


if __name__ == '__main__':
    main()
