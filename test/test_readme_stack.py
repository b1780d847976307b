# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The stacks of README and docs/teams.md, on a kart that takes its time to stop."""

from __future__ import annotations

from collections.abc import Callable
import concurrent.futures
import contextlib
import os
import pathlib
import random
import sys
import time

from evgp_protocol.states import RaceState
from evgp_testing.base import SimulatedBase
from evgp_testing.domains import Domain
from evgp_testing.kart import Bridge
from evgp_testing.process import executable, Process, Program
from evgp_testing.race_control import address_of
import pytest
from rig.bare_race_control import BareRaceControl
from rig.needs import CPP, need_package
from test_team_workspace import blocks

STOPS = int(os.environ.get('EVGP_STOPS', '12'))
"""How many stops are tried, over all karts."""

KARTS = [(0.0, 50.0), (0.25, 50.0), (0.25, 200.0)]
"""The dead time (s) and the rate of odometry (Hz) of each kart."""

HASTY = """
from evgp_kart_bridge import shortest_stack

class Stack(shortest_stack.Stack):
    def drive(self, state):
        super().drive(state)
        return True

shortest_stack.Stack = Stack
shortest_stack.main()
"""
"""A stack that acknowledges what it has yet to do."""


class Kart:
    """
    A bridge, a base and a stack; race control is a socket.

    ``rolling`` is, for each stop that was acknowledged while the kart moved, or had been told to,
    the highest speed that it had then or was going to try, m/s; ``moved`` says how many of the
    stops were commanded at such a moment.
    """

    def __init__(
        self,
        parts: contextlib.ExitStack,
        number: int,
        chance: random.Random,
        stack: list[str],
        base: tuple[float, float] = (0.0, 50.0),
    ) -> None:
        domain = parts.enter_context(Domain()).number
        # Accelerated: it gets to its full speed, and from there to a standstill, in 0.3 s.
        self.base = parts.enter_context(SimulatedBase(domain, 20.0, 20.0, *base))
        self.rolling: list[tuple[RaceState, float]] = []
        self.moved = 0
        self.stops = 0
        self._dice = random.Random(chance.random())  # karts may have a thread each
        self._race = parts.enter_context(BareRaceControl(self._hear))
        parts.enter_context(Bridge(domain, self._race.port, address_of(number)))
        parts.enter_context(Program('stack', stack, domain))

    def stop_once(self) -> None:
        """Start the kart, and stop it at some moment: standing still, as it starts, or racing."""
        self._race.exchange(RaceState.GRID_ACTIVE)
        self._race.say(RaceState.GREEN_GREEN)
        # The moment is what is tried; half of them fall into a dead time or soon after it.
        longest = self._dice.choice([0.4, 0.8])
        time.sleep(self._dice.uniform(0.05, longest))
        stop = self._dice.choice([RaceState.RED_RED, RaceState.RED_FLAG])
        self.moved += self.base.speed_to_come > 0.0
        self._race.exchange(stop)
        self.stops += 1

    def _hear(self, state: RaceState) -> None:
        speed = self.base.speed_to_come
        if state.is_red and speed > 0.0:
            self.rolling.append((state, speed))


@pytest.mark.early
@pytest.mark.timeout(120 + 2 * STOPS)
@pytest.mark.parametrize('package', ['evgp_kart_bridge', CPP])
def test_the_stack_of_readme_acknowledges_no_stop_while_the_kart_rolls(
    parts: contextlib.ExitStack,
    package: str,
    chance: random.Random,
    record_property: Callable[..., None],
) -> None:
    need_package(package)
    stack = [executable(package, 'shortest_stack')]
    karts = [Kart(parts, at, chance, stack, base) for at, base in enumerate(KARTS, start=1)]

    def stop_often(kart: Kart) -> None:
        while kart.stops * len(karts) < STOPS:
            kart.stop_once()

    with concurrent.futures.ThreadPoolExecutor(len(karts)) as pool:
        [*pool.map(stop_often, karts)]
    for kart, base in zip(karts, KARTS, strict=True):
        print(f'{base}: {kart.stops} stops, {kart.moved} while it moved, rolling {kart.rolling}')
    moved = sum(kart.moved for kart in karts)
    record_property('moved', moved)
    assert moved > STOPS / 4
    assert [kart.rolling for kart in karts] == [[] for _ in KARTS]
    hasty = Kart(parts, 4, chance, [sys.executable, '-c', HASTY])
    while not hasty.rolling:  # it is seen
        hasty.stop_once()


def test_the_stack_on_the_first_page_acknowledges_all_that_a_kart_at_rest_has_done(
    parts: contextlib.ExitStack, domain: int, tmp_path: pathlib.Path
) -> None:
    (shown,) = blocks('README.md', 'python')
    program = tmp_path / 'my_stack.py'
    program.write_text(shown, encoding='utf-8')
    heard: list[RaceState] = []
    race = parts.enter_context(BareRaceControl(heard.append))
    parts.enter_context(Bridge(domain, race.port, address_of(1), None, 'kart_bridge_node'))
    parts.enter_context(Program('my_stack', [sys.executable, str(program)], domain))
    for state in (RaceState.GRID_ACTIVE, RaceState.RED_FLAG, RaceState.GRID_ACTIVE):
        race.exchange(state)
    race.say(RaceState.GREEN_GREEN)
    race.exchange(RaceState.RED_RED)
    assert RaceState.GREEN_GREEN not in heard


def test_two_karts_race_in_one_domain_each_in_a_namespace_of_its_own(
    parts: contextlib.ExitStack, domain: int
) -> None:
    def start(name: str, *arguments: str) -> Process:
        process = Process('evgp_kart_bridge', name, domain, arguments=arguments)
        return parts.enter_context(process)

    races = []
    for number in (1, 2):
        here = ('-r', f'__ns:=/kart{number}')
        race = parts.enter_context(BareRaceControl())
        odometry = ('-r', '~/odom:=odom')
        bridge = Bridge(domain, race.port, address_of(number), arguments=(*here, *odometry))
        parts.enter_context(bridge)
        races.append(race)
    base = [sys.executable, '-m', 'evgp_testing.base', '--ros-args', '-r', '__ns:=/kart1']
    parts.enter_context(Program('base', base, domain))
    # Two nodes: one drives, and the other, which no motor listens to, acknowledges.
    driver = start('plain_driver', '-r', '__ns:=/kart1')
    start('shortest_stack', '-r', '__ns:=/kart1', '-r', 'cmd_vel:=unused')
    parts.enter_context(SimulatedBase(domain, arguments=('--ros-args', *here)))
    start('shortest_stack', *here)

    driver.wait_for_line('IN_GARAGE')
    for state in (RaceState.GRID_ACTIVE, RaceState.GREEN_GREEN, RaceState.RED_RED):
        for race in races:
            race.exchange(state)
        driver.wait_for_line(state.value)
