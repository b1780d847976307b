# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
``make sim``: three karts, each built differently, drive a whole race in a simulator.

The real race control runs it; README.md in this folder shows how to use your own stack.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
import contextlib
import copy
import math
import os
import pathlib
import secrets
import shlex
import socket
import subprocess
import sys
import tempfile
import threading
import time

from centreline import Centreline
from drawing import draw, Look
from evgp_node.qos import latched
from evgp_node.stamps import stamp_of
from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.base import Motion, SimulatedBase
from evgp_testing.domains import Domain
from evgp_testing.kart import Bridge
from evgp_testing.official import Official
from evgp_testing.part import Part
from evgp_testing.process import Program
from evgp_testing.race_control import address_of, RaceControl, Timekeeper

HERE = pathlib.Path(__file__).resolve().parent
TRACK = HERE / 'track.csv'
TEAMS = {1: 'Python, ROS 2', 2: 'C kit', 3: 'Python, no ROS'}
GRID = {1: (-3.0, 0.0), 2: (-6.0, 1.2), 3: (-9.0, -1.2)}
"""Start positions of the karts, x and y, in metres."""

HEAT = 'sim'
PRINTED = {
    msg.RaceEvent.RACE_STATE,
    msg.RaceEvent.ACKNOWLEDGED,
    msg.RaceEvent.ORDER_OF_FINISH,
}
"""The kinds of events to print."""

TURN = 0.02
"""Time between two looks at the karts, in seconds."""

LOOKS = 10
"""Number of looks for one frame of the picture."""

LONGEST = 90.0
"""Maximum time of a lap, in seconds: far more than it takes."""


class DatagramBase(Part):
    """
    A base for a kart without ROS, used by kart.py and kart.h through a loopback port.

    It steers along the lane in which it starts; the kart commands its speed, and receives the true
    one. Both are in m/s.
    """

    def __init__(self, place: tuple[float, float], track: Centreline) -> None:
        """Start at standstill."""
        self._track, self._lane = track, place[1]
        self._moving = threading.Lock()
        self._motion = Motion(time.monotonic(), place=place)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(('127.0.0.1', 0))
        self.port = self._socket.getsockname()[1]
        self._ended = False
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    @property
    def motion(self) -> Motion:
        """Return its present motion."""
        with self._moving:
            self._motion.advance(time.monotonic())
            return copy.copy(self._motion)

    def _serve(self) -> None:
        while True:
            said, sender = self._socket.recvfrom(100)
            if self._ended:
                return
            speed, now = float(said), self.motion
            turn = speed * self._track.steer(now.x, now.y, now.heading, self._lane)
            with self._moving:
                self._motion.command(time.monotonic(), speed, turn)
            self._socket.sendto(str(now.speed).encode(), sender)

    def close(self) -> None:
        """End it."""
        self._ended = True
        self._socket.sendto(b'', self._socket.getsockname())
        self._thread.join()
        self._socket.close()


Base = SimulatedBase | DatagramBase


class Line(Part):
    """
    The timing line and the observer of the karts.

    ``looks`` are for the picture; ``off`` is each kart's largest distance from the middle, in m.
    """

    def __init__(self, official: Official, bases: Mapping[int, Base], track: Centreline) -> None:
        """Start observing."""
        self.looks: list[Look] = []
        self.off = dict.fromkeys(bases, 0.0)
        self._official, self._bases, self.track = official, bases, track
        self._session, self._said = secrets.token_hex(4), 0
        self._passings = official.node.create_publisher(msg.Passing, '/rcs/passings', latched(200))
        self._before: dict[int, Motion] = {}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        turns = 0
        while not self._ended.wait(TURN):
            now = {number: base.motion for number, base in self._bases.items()}
            for number, motion in now.items():
                before = self._before.get(number, motion)
                if before.x < 0.0 <= motion.x and abs(motion.y) < self.track.width / 2:
                    # Interpolated since the last look, because the kart may stand still now.
                    self._pass(number, motion.x / (motion.x - before.x) * TURN)
                off = abs(self.track.off(motion.x, motion.y))
                self.off[number] = max(self.off[number], off)
            self._before = now
            if turns % LOOKS == 0:
                self._look(now)
            turns += 1

    def _pass(self, number: int, ago: float) -> None:
        self._said += 1
        crossed_at = time.time_ns() - round(ago * 1e9)
        self._passings.publish(
            msg.Passing(
                source='line',
                session=self._session,
                number=self._said,
                kart=number,
                stamp=stamp_of(crossed_at),
            )
        )

    def _look(self, now: dict[int, Motion]) -> None:
        race = self._official.race
        assert race is not None
        sent = {kart.number: state_of(kart.sent) or RaceState.RED_RED for kart in race.karts}
        results = self._official.results
        laps = {each.kart: each.laps for each in results.karts} if results else {}
        state = state_of(race.state) or RaceState.RED_RED
        poses = {
            number: (motion.x, motion.y, motion.heading, sent[number], laps.get(number, 0))
            for number, motion in now.items()
        }
        self.looks.append(Look(state, poses))

    def close(self) -> None:
        """Stop observing."""
        self._ended.set()
        self._thread.join()


def compile_kart(folder: pathlib.Path) -> str:
    """Compile the kart in C; return the path of the program."""
    kart = str(folder / 'kart')
    kit = HERE.parent / 'c'
    words = ['cc', '-std=c99', '-O2', '-Wall', f'-I{kit}', f'-I{HERE}', '-DEVGP_KART="kart.h"']
    subprocess.run([*words, str(kit / 'examples/posix.c'), '-o', kart], check=True)
    return kart


def begin(
    parts: contextlib.ExitStack, folder: pathlib.Path, laps: int, stack: Sequence[str]
) -> tuple[Official, Line]:
    """Start everything; return the official and the timing line."""
    # For the nodes in this process, too: keep away from everybody else's race.
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ['TRACK'] = str(TRACK)
    kart, track = compile_kart(folder), Centreline(TRACK)
    control = RaceControl(
        folder,
        parts.enter_context(Domain()).number,
        TEAMS,
        parameters={'finish_delays': [3.0, 2.0, 1.0]},
        teams=TEAMS,
        heats={HEAT: {'karts': list(TEAMS), 'laps': laps, 'auto_finish': True}},
    )
    parts.enter_context(control)
    parts.enter_context(Timekeeper(folder, control.domain))
    domain = parts.enter_context(Domain()).number
    hears = 'race', 'events', 'results'
    official = parts.enter_context(Official(control.domain, hears=hears))
    base = parts.enter_context(SimulatedBase(domain, place=GRID[1]))
    bases: dict[int, Base] = {1: base}
    to_the_bridge = ('-r', '~/odom:=/odom')
    parts.enter_context(Bridge(domain, control.port, address_of(1), arguments=to_the_bridge))
    parts.enter_context(Program('stack', stack, domain))
    for number, command in {2: [kart], 3: [sys.executable, str(HERE / 'kart.py')]}.items():
        own = parts.enter_context(DatagramBase(GRID[number], track))
        bases[number] = own
        words = [*command, '127.0.0.1', str(control.port), address_of(number)]
        parts.enter_context(Program(TEAMS[number], words, environment={'BASE': str(own.port)}))
    official.wait_for_race(lambda race: True, 'a first look at the race')
    return official, parts.enter_context(Line(official, bases, track))


def drive(official: Official, laps: int) -> msg.Results:
    """
    Direct one race, from garage to garage; return its results.

    :raises AssertionError: if a kart is too late.
    """
    official.wait_for_connected(*TEAMS)
    official.bring_to(RaceState.IN_GARAGE)
    official.command('set_heat', heat=HEAT)
    official.bring_to(RaceState.GREEN_GREEN)
    official.timeout = laps * LONGEST
    official.wait_for_race(
        lambda race: state_of(race.state) is RaceState.RED_RED, 'the race to be over'
    )
    official.wait_for_acks(RaceState.RED_RED, *TEAMS)
    official.bring_to(RaceState.IN_GARAGE)
    return official.wait_for_results(lambda results: results.karts, 'results')


def print_event(event: msg.RaceEvent) -> None:
    """Print an event if it is one of `PRINTED`."""
    if event.kind in PRINTED:
        at = event.monotonic.sec + event.monotonic.nanosec * 1e-9
        print(f'{at:9.3f}  {event.text}', flush=True)


def missing(results: msg.Results, line: Line, laps: int) -> list[str]:
    """Return the faults of the race."""
    wrong = []
    found = {each.kart: each for each in results.karts}
    for number in TEAMS:
        kart = found.get(number, msg.KartResult())
        if kart.laps != laps or not kart.place:
            wrong.append(f'kart {number} has {kart.laps} laps and place {kart.place}')
    half = line.track.width / 2
    wrong += [f'kart {number} left the track' for number, off in line.off.items() if off > half]
    return wrong


def main() -> int:
    """Drive a race; return 0 if it had no faults."""
    parser = argparse.ArgumentParser(prog='make sim', description=__doc__)
    parser.add_argument('--laps', type=int, default=2, help='number of laps')
    parser.add_argument(
        '--stack',
        default=shlex.join([sys.executable, str(HERE / 'stack.py')]),
        metavar='COMMAND',
        help='your stack for kart 1: it obeys /kart_bridge/race_state and publishes /cmd_vel',
    )
    parser.add_argument(
        '--picture', type=pathlib.Path, default=pathlib.Path('build/sim.svg'), metavar='FILE'
    )
    given = parser.parse_args()
    with contextlib.ExitStack() as parts:
        folder = pathlib.Path(parts.enter_context(tempfile.TemporaryDirectory()))
        official, line = begin(parts, folder, given.laps, shlex.split(given.stack))
        official.tell_each(print_event)
        results = drive(official, given.laps)
    given.picture.parent.mkdir(parents=True, exist_ok=True)
    picture = draw(line.track, line.looks, TEAMS, TURN * LOOKS)
    given.picture.write_text(picture, encoding='utf-8')
    for kart in results.karts:
        best = f'{kart.laps} laps, the best in {min(kart.lap_times, default=math.nan):.3f} s'
        print(f'{kart.place}. kart {kart.kart}, {TEAMS[kart.kart]}: {best}')
    print(f'Animation of the race, for a browser: {given.picture}')
    wrong = missing(results, line, given.laps)
    print('\n'.join(f'FAULT: {each}' for each in wrong) or 'No faults.')
    return bool(wrong)


if __name__ == '__main__':
    sys.exit(main())
