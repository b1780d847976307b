# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What one race control leaves behind for the next on its machine, whatever record that has."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import os
import pathlib
import signal
import subprocess

from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.domains import Domain
from evgp_testing.official import Official
from evgp_testing.race_control import address_of, RaceControl
from evgp_testing.wire_kart import Acknowledges, WireKart
import pytest

IN_GARAGE = RaceState.IN_GARAGE
GREEN_GREEN = RaceState.GREEN_GREEN
RED_RED = RaceState.RED_RED
KARTS = (1, 2)


class Machine:
    """One machine: race controls that run on it one after the other, at one port."""

    def __init__(self, parts: contextlib.ExitStack, folder: pathlib.Path) -> None:
        """Take a port and a domain."""
        self.folder = folder
        self.parts = parts
        self.domain = parts.enter_context(Domain()).number
        self.port: dict[str, object] = {}

    def start(
        self, folder: str, under: tuple[str, ...] = (), **parameters: object
    ) -> RaceControl:
        """Start race control with roster and record in a folder."""
        own = self.folder / folder
        own.mkdir(exist_ok=True)
        own.chmod(0o777)
        more = {'under': under} if under else {}
        given = {'auto_race_over': False, **self.port, **parameters}
        control = self.parts.enter_context(
            RaceControl(own, self.domain, KARTS, parameters=given, **more)
        )
        self.port = {'port': control.port}
        return control

    @contextlib.contextmanager
    def meeting(self, control: RaceControl):
        """Have all karts and an official with a race control."""
        with contextlib.ExitStack() as stack:
            self.karts = [
                stack.enter_context(
                    WireKart(address_of(number), control.port, Acknowledges.EACH_CHANGE)
                )
                for number in KARTS
            ]
            official = stack.enter_context(Official(self.domain))
            official.wait_for_connected(*KARTS)
            yield official

    def end_well(self, folder: str = 'a', **more: object) -> None:
        """Have a run begin and end with nothing under way."""
        control = self.start(folder, **more)
        with self.meeting(control) as official:
            official.bring_to(IN_GARAGE)
        assert control.close() == 0

    def die_in_green(self, folder: str = 'b', **more: object) -> None:
        """Have a run lose its power while karts race."""
        control = self.start(folder, **more)
        with self.meeting(control) as official:
            official.bring_to(GREEN_GREEN, *KARTS)
            control.lose_power()

    def first_words(self, folder: str = 'a', **more: object) -> tuple[set[RaceState], msg.Race]:
        """Start race control, and return what karts are sent and officials are shown."""
        control = self.start(folder, **more)
        with self.meeting(control) as official:
            for kart in self.karts:
                kart.wait_for_frames(3)
            race = official.wait_for_race(lambda race: True, 'the race')
            sent = {state for kart in self.karts for _, state in kart.changes}
        control.close()
        return sent, race


@pytest.fixture
def machine(parts: contextlib.ExitStack, tmp_path: pathlib.Path) -> Machine:
    return Machine(parts, tmp_path)


def assert_no_proof(found: tuple[set[RaceState], msg.Race]) -> None:
    sent, race = found
    assert sent == {RED_RED}
    assert state_of(race.state) is RED_RED
    assert {state_of(kart.hold) for kart in race.karts} == {RED_RED}
    assert race.track.open
    assert not race.track.allowed


def test_after_a_crash_a_start_with_another_record_that_ended_well_proves_nothing(
    machine: Machine,
) -> None:
    machine.end_well('a')
    machine.die_in_green('b')
    assert_no_proof(machine.first_words('a'))
