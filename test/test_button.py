# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A stop button, from its device to the karts: real processes, a line in the device's place."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import errno
import pathlib
import signal
import subprocess
import sys

from evgp_protocol.states import RaceState
from evgp_rcs_console.button_devices import is_asleep, why
from evgp_testing.official import Official
from evgp_testing.race_control import RaceControl
from evgp_testing.wire_race import WireRace
import pytest
from rig.stop_button import Ear, StopButton
from test_security import allowed, in_graph

Manned = tuple[WireRace, StopButton, Ear]


@pytest.fixture(scope='module')
def the_race(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Manned]:
    """Return a race of three karts and one outside, a stop button on it, and who hears that."""
    folder = tmp_path_factory.mktemp('race')
    with (
        WireRace(folder, (1, 2, 3), (4,)) as race,
        Ear(race.domain) as ear,
        StopButton(folder, race.domain) as button,
    ):
        yield race, button, ear


@pytest.fixture
def manned(the_race: Manned) -> Manned:
    """Return that race in GREEN_GREEN, with its button up."""
    race, button, ear = the_race
    button.move(False)
    race.bring_to(RaceState.IN_GARAGE)
    race.bring_to(RaceState.GREEN_GREEN)
    with race.official.news:
        race.official.events.clear()
    ear.wait_for_working()
    return the_race


def test_a_press_stops_every_kart_and_a_held_key_is_one_press_and_is_told(manned: Manned) -> None:
    race, button, ear = manned
    assert race.karts[0].state is RaceState.GREEN_GREEN
    before = ear.heard[-1].presses
    for _ in range(20):
        button.move(True)
    for kart in race.karts:
        kart.wait_for_state(RaceState.RED_RED)
    race.official.wait_for_event(lambda event: event.official.startswith('Anna ('), 'by Anna')
    told = ear.wait_for(lambda each: each.fault and each.presses > before)
    assert told.presses == before + 1
    button.move(False)
    ear.wait_for_working()
    button.move(True)
    ear.wait_for(lambda each: each.presses == before + 2)


def test_a_device_that_is_gone_is_told_and_works_again_once_it_is_back(manned: Manned) -> None:
    race, button, ear = manned
    presses = ear.heard[-1].presses
    for _ in range(3):
        before = len(ear.heard)
        button.unplug()
        button.program.wait_for_line('The device is not connected.*/usb-button')
        assert ear.wait_for(lambda each: each.fault, before).presses == presses
        button.plug()
        ear.wait_for_working()
    assert all(kart.state is RaceState.GREEN_GREEN for kart in race.karts[:3])
    button.move(True)
    race.karts[2].wait_for_state(RaceState.RED_RED)


def test_a_button_whose_program_is_frozen_is_silent_and_its_press_counts_once_it_is_not(
    manned: Manned,
) -> None:
    race, button, ear = manned
    button.program.signal(signal.SIGSTOP)
    button.move(True)
    seen = race.official.wait_for_race(lambda _: True, 'the race')
    before = len(ear.heard) + 1  # one may be on its way
    for _ in range(6):  # race control publishes twice a second
        seen = race.official.wait_for_race(lambda each, seen=seen: each is not seen, 'the next')
    assert len(ear.heard) <= before
    assert race.karts[0].state is RaceState.GREEN_GREEN
    button.program.signal(signal.SIGCONT)
    race.karts[0].wait_for_state(RaceState.RED_RED)


def test_a_press_is_repeated_until_it_is_accepted_and_an_end_in_order_is_told(
    parts: contextlib.ExitStack, domain: int, tmp_path: pathlib.Path
) -> None:
    ear = parts.enter_context(Ear(domain))
    button = parts.enter_context(StopButton(tmp_path, domain))
    assert ear.wait_for(lambda _: True).fault  # it finds nobody
    button.move(True)
    button.move(False)
    ear.wait_for(lambda each: each.presses)
    parts.enter_context(RaceControl(tmp_path, domain, (1,)))
    official = parts.enter_context(Official(domain))
    official.wait_for_event(lambda event: event.official.startswith('Anna ('), 'by Anna')
    ear.wait_for_working()
    working = len(ear.heard) - 1
    assert button.program.close() == 0
    ear.wait_for(lambda each: each.fault, working)
    button.close()
    parts.enter_context(StopButton(tmp_path, domain))
    ear.wait_for(lambda each: each.id != ear.heard[0].id)  # every start has another one


def test_race_control_allows_a_button_all_kill_and_no_other_command(
    manned: Manned,
) -> None:
    _, _, ear = manned
    named = ('rcs_button', '/'), ('rcs_button_calls', '/')
    ear.wait_until_polled(lambda: in_graph(ear.node, *named).asked, 'its nodes in the graph')
    seen = in_graph(ear.node, *named)
    assert seen.published == allowed('/buttons', 'topics', 'publish')
    assert seen.subscribed <= allowed('/buttons', 'topics', 'subscribe')
    assert allowed('/buttons', 'services', 'request') == {'/rcs/all_kill'}
    assert seen.asked == {'/rcs/all_kill'}


def test_whoever_may_not_open_a_device_is_told_the_group() -> None:
    assert 'usermod -aG input' in why(PermissionError(errno.EACCES, 'no'))
    assert why(OSError(errno.EBUSY, '?')) != why(OSError(errno.ENODEV, '?'))


def test_a_usb_device_that_is_suspended_is_asleep(
    monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path
) -> None:
    usb = tmp_path / 'usb1/1-2'
    (usb / '1-2:1.0/input/input7').mkdir(parents=True)
    (usb / 'power').mkdir()
    (usb / 'idVendor').touch()
    (tmp_path / 'event3').mkdir()
    (tmp_path / 'event3/device').symlink_to(usb / '1-2:1.0/input/input7')
    monkeypatch.setattr('evgp_rcs_console.button_devices.SYS', tmp_path)
    for status, asleep in (('active', False), ('suspended', True)):
        (usb / 'power/runtime_status').write_text(f'{status}\n')
        assert is_asleep('/dev/input/event3') is asleep


def test_the_devices_are_shown_and_nothing_is_sent_without_a_screen() -> None:
    """`rcs_button test` names what it cannot open; the program never imports Qt."""
    code = (
        'import sys; from evgp_rcs_console import button; '
        "code = button.main(['rcs_button', 'test', '/dev/input/none', '/dev/null']); "
        "assert not any('PySide6' in each or 'PyQt' in each for each in sys.modules); "
        'sys.exit(code)'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)
    assert done.returncode == 1, done.stderr
    assert [line.split(':')[0] for line in done.stdout.splitlines()[:2]] == [
        '/dev/input/none',
        '/dev/null',
    ]
