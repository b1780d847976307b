# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Clocks that jump under a driving kart: what stops it goes by none of them.

The bridge and the example stack run on a machine whose clocks the test steps; race control and
the one who watches the speed run on another, whose clocks go right.
"""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import itertools
import pathlib
import re
import time

from evgp_kart_bridge.orders import TOO_LATE
from evgp_protocol.states import RaceState
from evgp_rcs_msgs.msg import KartRaceState
from evgp_testing.domains import Domain
from evgp_testing.kart import Bridge, Team
from evgp_testing.process import Process
from evgp_testing.race_control import address_of
from nav_msgs.msg import Odometry
import pytest
from rig.bare_race_control import BareRaceControl
from rig.steppable_clock import SteppableClock

GRID_ACTIVE = RaceState.GRID_ACTIVE
GREEN_GREEN = RaceState.GREEN_GREEN
RED_RED = RaceState.RED_RED

ATTEMPTS = 5
"""Maximum number of ways to GREEN_GREEN."""

YEAR = 365.25 * 86400.0

STEPS = (-60.0, -YEAR, 10 * YEAR)
"""In seconds, those back first. All are more than any test waits: what went by such a clock would
come too late."""


class Onlooker(Team):
    """Keeps what the bridge and the stack publish, each with the monotonic time (s) it came."""

    def __init__(self, domain: int) -> None:
        self.speeds: list[tuple[float, float]] = []
        # How far the wall clock of each is ahead of the right time, s.
        self.bridge_ahead = self.stack_ahead = 0.0
        super().__init__(domain, 'onlooker')

    def wait_for_braking(self, since: float) -> None:
        """Return once the kart has begun to slow down since then (monotonic, s), and stands."""

        def stands() -> bool:
            pairs = itertools.pairwise(self.speeds)
            return self.speeds[-1][1] == 0.0 and any(
                at >= since and speed < before for (_, before), (at, speed) in pairs
            )

        self.wait_until(stands, lambda: f'braking; the last was {self.speeds[-1:]}')

    def wait_for_wall_clocks(self, offset: float) -> None:
        """Return once the stamps of bridge and stack show how far their clock is ahead."""
        self.wait_until(
            lambda: abs(self.bridge_ahead - offset) < 5.0 and abs(self.stack_ahead - offset) < 5.0,
            lambda: f'{offset:g} s; bridge {self.bridge_ahead:g}, stack {self.stack_ahead:g}',
        )

    def _hear_state(self, state: KartRaceState) -> None:
        self.bridge_ahead = state.stamp.sec - time.time()
        super()._hear_state(state)

    def _hear_speed(self, odometry: Odometry) -> None:
        with self.news:
            self.speeds.append((time.monotonic(), odometry.twist.twist.linear.x))
            self.stack_ahead = odometry.header.stamp.sec - time.time()
        super()._hear_speed(odometry)


class Kart:
    """A bridge and a stack on a machine with steppable clocks, race control, and an onlooker."""

    def __init__(
        self,
        parts: contextlib.ExitStack,
        clock: SteppableClock,
        parameters: dict[str, object],
        bridge_on_it: bool,
    ) -> None:
        self.clock = clock
        self.control = parts.enter_context(BareRaceControl())
        self.domain = parts.enter_context(Domain()).number
        self.onlooker = parts.enter_context(Onlooker(self.domain))
        self._parts = parts
        self._parameters = parameters
        self.start_bridge(bridge_on_it)
        with clock.on_it():
            stack = Process('evgp_kart_bridge', 'example_stack', self.domain, parameters)
            self.stack = parts.enter_context(stack)

    def start_bridge(self, on_it: bool = True) -> None:
        """Start the bridge, for the first time or again; on a right clock if not `on_it`."""
        with self.clock.on_it() if on_it else contextlib.nullcontext():
            bridge = Bridge(self.domain, self.control.port, address_of(1), self._parameters)
        self.bridge = self._parts.enter_context(bridge)

    def drive(self) -> None:
        """
        Come to race from wherever it stands.

        Again and again: on a busy computer it may meet a silence of a second on its way, after
        which it obeys no GREEN_GREEN.
        """
        for _ in range(ATTEMPTS):
            self.control.say(RaceState.IN_GARAGE)
            self.onlooker.wait_for_state(RaceState.IN_GARAGE)
            self.control.exchange(GRID_ACTIVE)
            self.control.say(GREEN_GREEN)
            with self.onlooker.news:
                if self.onlooker.news.wait_for(lambda: (self.onlooker.speed or 0.0) >= 2.0, 5.0):
                    return
        raise AssertionError(f'no way to GREEN_GREEN in {ATTEMPTS} attempts')


StartKart = Callable[..., Kart]


@pytest.fixture
def start_kart(parts: contextlib.ExitStack, tmp_path: pathlib.Path) -> StartKart:
    """Return a function that starts a kart; it takes parameters of both nodes."""

    def start(bridge_on_it: bool = True, **parameters: object) -> Kart:
        clock = parts.enter_context(SteppableClock(tmp_path))
        return Kart(parts, clock, parameters, bridge_on_it)

    return start


def test_a_wall_clock_that_is_set_delays_no_stop_also_as_the_bridge_dies(
    start_kart: StartKart,
) -> None:
    kart = start_kart()
    kart.onlooker.wait_for_wall_clocks(0.0)
    for step in STEPS:
        kart.drive()
        # At the very moment of the stop, and well before it.
        kart.clock.set_wall(step)
        kart.onlooker.wait_for_braking(kart.control.say(RED_RED))
        kart.onlooker.wait_for_wall_clocks(step)
        kart.control.wait_until_it_says(RED_RED)
        kart.drive()
        kart.onlooker.wait_for_braking(kart.control.fall_silent())
        kart.drive()
        kart.clock.set_wall(0.0)
        kart.onlooker.wait_for_braking(kart.control.say(RED_RED))
        kart.onlooker.wait_for_wall_clocks(0.0)
    assert kart.bridge.close() == 0
    for step in STEPS[:2]:
        kart.start_bridge()
        kart.drive()
        at = time.monotonic()
        kart.bridge.kill()  # nothing is said to the stack any more that could wake it
        kart.clock.set_wall(step)
        kart.onlooker.wait_for_braking(at)
        kart.clock.set_wall(0.0)
    assert kart.stack.close() == 0


def test_simulated_time_that_nobody_publishes_delays_no_stop(start_kart: StartKart) -> None:
    kart = start_kart(use_sim_time=True)
    kart.drive()
    kart.onlooker.wait_for_braking(kart.control.say(RED_RED))
    kart.control.wait_until_it_says(RED_RED)
    kart.drive()
    kart.onlooker.wait_for_braking(kart.control.fall_silent())


def test_a_wall_clock_past_2038_stops_the_kart_which_races_again_once_it_is_right(
    start_kart: StartKart,
) -> None:
    kart = start_kart()
    kart.drive()
    at = time.monotonic()
    kart.clock.set_wall(20 * YEAR)
    # Fast DDS publishes nothing with such a time. So the bridge ends, which race control sees, and
    # the stack hears silence.
    kart.stack.wait_for_line('RED_RED the bridge is silent')
    silent = time.monotonic()
    assert kart.bridge.wait() == 1, kart.bridge.output
    assert 'the race state cannot be published' in kart.bridge.output
    assert 'Check the clock' in kart.bridge.output
    kart.clock.set_wall(0.0)
    kart.onlooker.wait_until(
        lambda: kart.onlooker.speeds[-1][0] > silent,
        lambda: f'odometry again; the stack printed {kart.stack.output}',
    )
    kart.onlooker.wait_for_braking(at)
    kart.start_bridge()
    kart.drive()
    assert kart.stack.close() == 0
    assert kart.bridge.close() == 0


def test_a_suspended_kart_wakes_in_red_red_and_stays_there(start_kart: StartKart) -> None:
    kart = start_kart()
    kart.drive()
    # Race control goes on saying GREEN_GREEN: those are the frames that wait for the kart.
    at = time.monotonic()
    kart.clock.suspend(60.0)
    states = kart.onlooker.changes
    said = kart.onlooker.wait_until(
        lambda: next((when for when, said in states if when >= at and said is RED_RED), 0.0),
        lambda: f'RED_RED; the last was {states[-1:]}',
    )
    kart.onlooker.wait_for_braking(at)
    kart.onlooker.wait_for_wall_clocks(60.0)
    heard = [state for when, state in states if when >= said]
    assert GREEN_GREEN not in heard


def test_a_suspended_stack_wakes_in_red_red_and_stays_there(start_kart: StartKart) -> None:
    kart = start_kart(bridge_on_it=False)
    kart.drive()
    at = time.monotonic()
    kart.clock.suspend(60.0)  # and its bridge goes on saying GREEN_GREEN
    kart.onlooker.wait_for_braking(at)
    kart.stack.wait_for_line(f'RED_RED {re.escape(TOO_LATE)}')
    assert kart.onlooker.changes[-1][1] is GREEN_GREEN
