# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Clocks that jump under race control: its signs of life and its stops go by none of them."""

from __future__ import annotations

import contextlib
import pathlib
import time

from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.race_control import address_of
from evgp_testing.wire_kart import WireKart
from evgp_testing.wire_race import WireRace
import pytest
from rig.steppable_clock import SteppableClock

GREEN_GREEN = RaceState.GREEN_GREEN
GRID_ACTIVE = RaceState.GRID_ACTIVE
RED_RED = RaceState.RED_RED

YEAR = 365.25 * 86400.0


class Scene(WireRace):
    """A race in GREEN_GREEN with one kart, on clocks that the test steps."""

    def __init__(self, parts: contextlib.ExitStack, folder: pathlib.Path) -> None:
        self.clock = parts.enter_context(SteppableClock(folder))
        with self.clock.on_it():
            super().__init__(folder, [1], parameters={'green_alert': 600.0, 'red_alert': 600.0})
        parts.callback(self.close)
        (self.kart,) = self.karts
        self.bring_to(GREEN_GREEN)


@pytest.fixture
def scene(parts: contextlib.ExitStack, tmp_path: pathlib.Path) -> Scene:
    return Scene(parts, tmp_path)


def test_a_wall_clock_that_is_set_ends_no_race_and_delays_no_stop_before_2038(
    scene: Scene,
) -> None:
    for offset in (-60.0, 60.0, -YEAR, 10 * YEAR):
        scene.bring_to(GREEN_GREEN)
        scene.clock.set_wall(offset)
        scene.official.wait_for_race(
            lambda race, offset=offset: abs(race.stamp.sec - time.time() - offset) < 5.0,
            'the step in its stamps',
        )
        scene.kart.wait_for_frames(40)  # 3 s, and its ROS half may be silent for 1 s
        assert scene.kart.state is GREEN_GREEN
        scene.official.command('all_kill')
        scene.kart.wait_for_state(RED_RED)
        scene.official.wait_for_acks(RED_RED, 1)
    scene.bring_to(GREEN_GREEN)
    scene.clock.set_wall(20 * YEAR)  # past 2038, when Fast DDS publishes nothing
    scene.kart.wait_for_end()
    assert scene.kart.state is RED_RED
    assert scene.control.wait() == 1


def test_after_a_suspend_nothing_is_started_that_was_sent_before_and_alerts_count_its_time(
    scene: Scene, parts: contextlib.ExitStack
) -> None:
    scene.bring_to(RED_RED)
    scene.bring_to(GRID_ACTIVE)

    scene.official.wait_for_available('green_green')
    before = len(scene.kart.changes)
    scene.clock.suspend(30.0)
    scene.official.wait_for_race(
        lambda race: (
            not any(
                each.command == msg.CommandAvailability.GREEN_GREEN and each.available
                for each in race.commands
            )
        ),
        'no GREEN_GREEN any more: race control has noticed',
    )
    refused = scene.official.call('green_green')

    assert not refused.success
    scene.kart.acknowledges = False
    scene.official.command('all_kill')
    kart = scene.kart
    if kart.ended:  # what it had not answered yet, it had not answered for 30 s
        assert not kart.changes[before:]
        kart = WireKart(address_of(1), scene.control.port)
        parts.enter_context(kart)
        before = 0
    kart.wait_for_state(RED_RED)
    assert [state for _, state in kart.changes[before:]] == [RED_RED]
    scene.clock.suspend(3600.0)
    # The alert may end at once: a beat that the kart had not answered yet ends the connection.
    scene.official.wait_for_event(
        lambda event: (
            event.kind == msg.RaceEvent.ALERT_RAISED
            and event.alert == msg.Alert.RED_UNACKNOWLEDGED
        ),
        'the alert',
    )
