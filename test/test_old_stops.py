# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A stop that is pressed where the link is lost, and what becomes of it once the link is back."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import os
import pathlib
import re

from evgp_node import graph
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.part import PATIENCE
from evgp_testing.ros_side import environment_kept
from evgp_testing.wire_race import WireRace
import pytest
from rig.console import Console
from rig.needs import need_screen
from rig.networks import Machine, need_networks, RACE_CONTROL, Track
from rig.screen import Screen
from rig.stop_button import StopButton
from test_rcs_ctl import start as start_rcs_ctl

GREEN_GREEN = RaceState.GREEN_GREEN
RED_RED = RaceState.RED_RED

SUPERSEDED = 4

DROPPED = r'ALL KILL, pressed \d+ s ago, is no longer being sent'
OWN = f'{DROPPED}, because race control did not answer'


class Officials:
    """
    A race of one kart, with its officials beside it, and desks with a network of their own.

    For a process that has not used ROS yet: Fast DDS looks for the networks only once.
    """

    def __init__(self, folder: pathlib.Path, parts: contextlib.ExitStack) -> None:
        self._folder, self._parts = folder, parts
        self._track = parts.enter_context(Track())
        self.desks: list[Machine] = []
        with self._at(self._track.machine('own', RACE_CONTROL)):
            self.race = parts.enter_context(WireRace(folder, [1]))
        self.race.bring_to(GREEN_GREEN)
        self.domain = self.race.domain

    @contextlib.contextmanager
    def _at(self, machine: Machine) -> Iterator[None]:
        with machine.inside(), environment_kept():
            os.environ[graph.INTERFACE] = machine.address
            yield

    @contextlib.contextmanager
    def desk(self) -> Iterator[Machine]:
        """Have what is started meanwhile at a desk of its own."""
        number = len(self.desks) + 2
        desk = self._track.machine(f'desk{number}', f'10.77.0.{number}')
        self.desks.append(desk)
        with self._at(desk):
            yield desk

    def window(self) -> tuple[Console, Machine]:
        """Open a window at a desk, and return it once it shows the race."""
        screen = self._parts.enter_context(Screen())
        with self.desk() as desk:
            console = Console(self._folder, self.domain, screen)
        self._parts.callback(console.close)
        console.wait_for('kart_1', linked='true')
        self._wait_until_known('rcs_gui')
        return console, desk

    def button(self, name: str) -> tuple[StopButton, Machine]:
        """Start a button at a desk, and return it once it works."""
        (folder := self._folder / name).mkdir()
        with self.desk() as desk:
            button = self._parts.enter_context(StopButton(folder, self.domain, official=name))
        button.program.wait_for_line('A press sends ALL KILL')
        self._wait_until_known('rcs_button_calls')
        return button, desk

    def _wait_until_known(self, name: str) -> None:
        """Return once DDS knows a program."""
        node = self.race.official.node
        self.race.official.wait_until_polled(lambda: name in node.get_node_names(), name)

    def wait_until_forgotten(self, *names: str) -> None:
        """Return once DDS has forgotten the programs that nothing is heard of."""
        node = self.race.official.node
        self.race.official.wait_until_polled(
            lambda: not {*names} & {*node.get_node_names()}, f'that {names} are forgotten'
        )

    def killers(self) -> list[str]:
        """Return who has given ALL KILL, as race control tells it."""
        events = self.race.official.events
        kind = msg.RaceEvent.COMMAND
        kills = (each for each in events if each.kind == kind and 'RED_RED is' in each.text)
        return [f'{each.official}: {each.text}' for each in kills]

    def wait_for_old_stop(self, least: int) -> None:
        """Return once race control has taken a stop and said its age, at least this (s)."""
        self.race.karts[0].wait_for_state(RED_RED)
        official = self.race.official
        now = official.wait_for_race(lambda each: 'pressed' in each.state_cause, 'its age')
        found = re.fullmatch(r'ALL_KILL.*, (pressed (\d+) s ago)', now.state_cause)
        assert found is not None, now.state_cause
        assert int(found[2]) >= least
        assert found[1] in now.karts[0].hold_reason
        official.wait_for_event(
            lambda each: (
                each.kind == msg.RaceEvent.COMMAND and f'ALL_KILL was {found[1]}.' in each.text
            ),
            'its age among the events',
        )


@pytest.mark.early
@pytest.mark.own_process
@pytest.mark.timeout(240)
def test_a_stop_that_was_pressed_without_a_link_stops_its_race_with_its_age_and_no_later_race(
    parts: contextlib.ExitStack, tmp_path: pathlib.Path
) -> None:
    need_networks()
    need_screen()
    officials = Officials(tmp_path, parts)
    race, official = officials.race, officials.race.official
    console, at_window = officials.window()
    at_window.air(1.0)
    console.click('all_kill')
    console.wait_for('kill_hint', text='SENT 1[2-9] times')
    at_window.air()
    # It was sent twelve times in 5.5 s: what DDS delivers first is the last one.
    officials.wait_for_old_stop(5)
    # Perhaps it was sent once more before the answer came, and the window shows the last one.
    console.wait_for('status', text=r'pressed \d+ s ago')
    console.wait_for('all_kill', pressing='false')

    race.bring_to(GREEN_GREEN)
    with officials.desk() as desk:
        desk.air(1.0)
        ctl = start_rcs_ctl(officials.domain, 'all-kill', '--wait', '300')
    parts.enter_context(ctl)
    parts.callback(ctl.kill)
    # It presses while the others start.
    button, _ = officials.button('Bea')
    held, at_held = officials.button('Carla')
    later, at_later = officials.button('Dan')
    for desk in officials.desks:
        desk.air(1.0)
    console.click('all_kill')
    button.move(True)
    button.move(False)
    held.move(True)
    console.wait_for('all_kill', pressing='true')
    # From 5 s after the press on, a race that begins is certainly another one.
    console.wait_for('kill_hint', text='SENT 1[4-9] times')
    race.bring_to(RED_RED)
    race.bring_to(GREEN_GREEN)
    later.move(True)
    later.move(False)
    officials.wait_until_forgotten('rcs_gui', 'rcs_button_calls')
    # Here too, where race control was heard last up to 3 s later: 35 s after the press.
    # Until then DDS itself may deliver a press that was made without a link.
    console.wait_for('kill_hint', text='SENT 7[0-9] times')
    before = officials.killers()
    for desk in officials.desks:
        if desk not in (at_held, at_later):
            desk.air()

    # First: it says so for 5 s, and the window may take longer to be found again.
    official.wait_for_race(
        lambda each: 'Bea (button): The ALL KILL' in each.button_fault, 'what it says'
    )
    console.wait_for('all_kill', pressing='false')
    # There may be room for one alert only, and the one about a button may be newer.
    banner = console.wait_for('banner', text=rf'{OWN}|\(button\)')
    if not re.search(OWN, banner['text']):
        console.press('F10', see='banner', text=OWN)
    button.program.wait_for_line(r'ALL KILL pressed \d+ s ago is no longer being sent')
    stdout, stderr = ctl.communicate(timeout=PATIENCE)
    assert (ctl.returncode, stdout) == (SUPERSEDED, '')
    assert re.search(DROPPED, stderr)
    assert race.karts[0].state is GREEN_GREEN
    assert officials.killers() == before

    at_later.air()
    officials.wait_for_old_stop(15)
    race.bring_to(GREEN_GREEN)
    at_held.air()  # a later race, but the press goes on
    race.karts[0].wait_for_state(RED_RED)
    race_now = official.wait_for_race(lambda each: 'Carla' in each.state_cause, 'her press')
    assert 'pressed' not in race_now.state_cause
