# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Clocks that jump under a driving kart: what stops it goes by none of them.

The bridge and the example stack run on machines whose clocks the tests step; race control and the
one who watches the speed run on another, whose clocks go right.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import itertools
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


class Kart(Team):
    """
    An onlooker of a bridge and a stack, which have a steppable clock each, and race control.

    ``speeds`` is what the stack publishes, each with the monotonic time (s) it came.

    :param parameters: of bridge and stack.
    """

    def __init__(
        self, parts: contextlib.ExitStack, folders: pytest.TempPathFactory, **parameters: object
    ) -> None:
        self.speeds: list[tuple[float, float]] = []
        # How far the wall clock of each is ahead of the right time, s.
        self._bridge_ahead = self._stack_ahead = 0.0
        self.bridge_clock, self.stack_clock = (
            parts.enter_context(SteppableClock(folders.mktemp('clock'))) for _ in range(2)
        )
        self.control = parts.enter_context(BareRaceControl())
        self._domain = parts.enter_context(Domain()).number
        self._parts, self._parameters = parts, parameters
        super().__init__(self._domain, 'onlooker')
        parts.callback(self.close)
        self.start_bridge()
        with self.stack_clock.on_it():
            stack = Process('evgp_kart_bridge', 'example_stack', self._domain, parameters)
        self.stack = parts.enter_context(stack)

    def start_bridge(self) -> None:
        """Start the bridge, for the first time or again."""
        with self.bridge_clock.on_it():
            bridge = Bridge(self._domain, self.control.port, address_of(1), self._parameters)
        self.bridge = self._parts.enter_context(bridge)

    def set_wall(self, offset: float) -> None:
        """Set both wall clocks to this many seconds ahead of the right time."""
        self.bridge_clock.set_wall(offset)
        self.stack_clock.set_wall(offset)

    def drive(self) -> None:
        """
        Come to race from wherever it stands.

        Again and again: on a busy computer it may meet a silence of a second on its way, after
        which it obeys no GREEN_GREEN.
        """
        for _ in range(ATTEMPTS):
            self.control.say(RaceState.IN_GARAGE)
            self.wait_for_state(RaceState.IN_GARAGE)
            self.control.exchange(GRID_ACTIVE)
            self.control.say(GREEN_GREEN)
            with self.news:
                if self.news.wait_for(lambda: (self.speed or 0.0) >= 0.5, 5.0):
                    return
        raise AssertionError(f'no way to GREEN_GREEN in {ATTEMPTS} attempts')

    def wait_for_braking(self, since: float) -> None:
        """Return once the kart has begun to slow down since then (monotonic, s), and stands."""

        def stands() -> bool:
            pairs = itertools.pairwise(self.speeds)
            return self.speeds[-1][1] == 0.0 and any(
                at >= since and speed < before for (_, before), (at, speed) in pairs
            )

        self.wait_until(stands, lambda: f'braking; the last was {self.speeds[-1:]}')

    def wait_for_wall_clocks(self, offset: float) -> None:
        """Return once the stamps of bridge and stack show how far their clocks are ahead."""

        def ahead() -> tuple[float, float]:
            return self._bridge_ahead, self._stack_ahead

        self.wait_until(
            lambda: all(abs(each - offset) < 5.0 for each in ahead()),
            lambda: f'{offset:g} s; bridge and stack: {ahead()}',
        )

    def _hear_state(self, state: KartRaceState) -> None:
        self._bridge_ahead = state.stamp.sec - time.time()
        super()._hear_state(state)

    def _hear_speed(self, odometry: Odometry) -> None:
        with self.news:
            self.speeds.append((time.monotonic(), odometry.twist.twist.linear.x))
            self._stack_ahead = odometry.header.stamp.sec - time.time()
        super()._hear_speed(odometry)


@pytest.fixture(scope='module')
def the_kart(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Kart]:
    """Return a kart; a test may end its bridge, but not its stack."""
    with contextlib.ExitStack() as parts:
        kart = Kart(parts, tmp_path_factory)
        yield kart
        assert kart.stack.close() == 0


@pytest.fixture
def kart(the_kart: Kart) -> Kart:
    """Return that kart in GREEN_GREEN, with right wall clocks."""
    the_kart.set_wall(0.0)
    the_kart.stack.lines.clear()
    if the_kart.bridge.process.poll() is not None:
        the_kart.start_bridge()
    the_kart.drive()
    the_kart.wait_for_wall_clocks(0.0)
    return the_kart


def test_a_wall_clock_that_is_set_delays_no_stop_also_as_the_bridge_dies(kart: Kart) -> None:
    for step in STEPS:
        # At the very moment of the stop, and well before it.
        kart.set_wall(step)
        kart.wait_for_braking(kart.control.say(RED_RED))
        kart.wait_for_wall_clocks(step)
        kart.control.wait_until_it_says(RED_RED)
        kart.drive()
        kart.wait_for_braking(kart.control.fall_silent())
        kart.drive()
        kart.set_wall(0.0)
        kart.wait_for_braking(kart.control.say(RED_RED))
        kart.wait_for_wall_clocks(0.0)
        kart.drive()
    assert kart.bridge.close() == 0
    for step in STEPS[:2]:
        kart.start_bridge()
        kart.drive()
        at = time.monotonic()
        kart.bridge.kill()  # nothing is said to the stack any more that could wake it
        kart.set_wall(step)
        kart.wait_for_braking(at)
        kart.set_wall(0.0)


def test_simulated_time_that_nobody_publishes_delays_no_stop(
    parts: contextlib.ExitStack, tmp_path_factory: pytest.TempPathFactory
) -> None:
    kart = Kart(parts, tmp_path_factory, use_sim_time=True)
    kart.drive()
    kart.wait_for_braking(kart.control.say(RED_RED))
    kart.control.wait_until_it_says(RED_RED)
    kart.drive()
    kart.wait_for_braking(kart.control.fall_silent())


def test_a_wall_clock_past_2038_stops_the_kart_which_races_again_once_it_is_right(
    kart: Kart,
) -> None:
    at = time.monotonic()
    kart.set_wall(20 * YEAR)
    # Fast DDS publishes nothing with such a time. So the bridge ends, which race control sees, and
    # the stack hears silence.
    kart.stack.wait_for_line('RED_RED the bridge is silent')
    silent = time.monotonic()
    assert kart.bridge.wait() == 1, kart.bridge.output
    assert 'the race state cannot be published' in kart.bridge.output
    assert 'Check the clock' in kart.bridge.output
    kart.set_wall(0.0)
    kart.wait_until(
        lambda: kart.speeds[-1][0] > silent,
        lambda: f'odometry again; the stack printed {kart.stack.output}',
    )
    kart.wait_for_braking(at)
    kart.start_bridge()
    kart.drive()
    assert kart.bridge.close() == 0


def test_a_suspended_kart_wakes_in_red_red_and_stays_there(kart: Kart) -> None:
    # Race control goes on saying GREEN_GREEN: those are the frames that wait for the kart.
    at = time.monotonic()
    for clock in (kart.bridge_clock, kart.stack_clock):
        clock.suspend(60.0)
    said = kart.wait_until(
        lambda: next((when for when, said in kart.changes if when >= at and said is RED_RED), 0.0),
        lambda: f'RED_RED; the last was {kart.changes[-1:]}',
    )
    kart.wait_for_braking(at)
    kart.wait_for_wall_clocks(60.0)
    assert GREEN_GREEN not in [state for when, state in kart.changes if when >= said]


def test_a_suspended_stack_wakes_in_red_red_and_stays_there(kart: Kart) -> None:
    at = time.monotonic()
    kart.stack_clock.suspend(60.0)  # and its bridge goes on saying GREEN_GREEN
    kart.wait_for_braking(at)
    kart.stack.wait_for_line(f'RED_RED {re.escape(TOO_LATE)}')
    assert kart.changes[-1][1] is GREEN_GREEN
