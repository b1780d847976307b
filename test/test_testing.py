# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What teams get with ``evgp_testing``: a plugin that needs little, and failures that say much."""

from __future__ import annotations

import os
import pathlib
import re
import subprocess
import sys
import time

from evgp_protocol.states import RaceState
from evgp_rcs.rules import race
from evgp_testing.wire_kart import WireKart
from evgp_testing.witness import Witness
import pytest
from rig.bare_race_control import BareRaceControl
from rig.faults import Fault, module_with


def test_the_plugin_loads_neither_ros_nor_qt_nor_the_officials_window() -> None:
    code = (
        'import sys, evgp_testing.plugin\n'
        'names = {name.partition(".")[0] for name in sys.modules}\n'
        'print(*sorted(names & {"rclpy", "evgp_rcs_console", "evgp_rcs_msgs", "PyQt5", "PyQt6", '
        '"PySide2", "PySide6", "python_qt_binding"}))\n'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, '\n'), done.stderr


FAILING = """
import os
import pytest

def test_beside_race_control(start_race_control):
    start_race_control(in_race=[7])
    assert not 'found out'

def test_with_chance(chance):
    assert not chance.randrange(10**9), 'the chance fell'

@pytest.mark.own_process
def test_that_fails():
    assert not os.getenv('EVGP_TEST_IN_OWN_PROCESS'), 'in its own'

@pytest.mark.own_process
def test_that_cannot_run():
    pytest.skip('for a reason')
"""


def run_pytest(folder: pathlib.Path, *arguments: str) -> str:
    """Run the tests of a folder, of which some fail; return what pytest printed."""
    plugins = '-p rig.seed -p rig.own_process -p no:cacheprovider'
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', *arguments],
        cwd=folder,
        env={**os.environ, 'PYTEST_ADDOPTS': plugins, 'PYTHONPATH': os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1, done.stdout + done.stderr
    return done.stdout


def test_a_failure_shows_what_its_processes_printed_and_the_seed_that_gives_it_again(
    tmp_path: pathlib.Path,
) -> None:
    """In a worker, whose report has to reach the process that prints it; some in their own."""
    (tmp_path / 'test_failing.py').write_text(FAILING, encoding='utf-8')
    (tmp_path / 'test_second.py').write_text('def test_after(): ...\n', encoding='utf-8')
    printed = run_pytest(tmp_path, '-n', '1', '-rA')
    assert re.search(r'^-+ rcs_node \(\d+, runs\) -+$', printed, re.MULTILINE)
    assert re.search(r'listens for .* port \d+', printed)
    for outcome in (
        'FAILED test_failing.py::test_that_fails - ',
        'SKIPPED [1] ',
        'PASSED test_second.py::test_after',
    ):
        assert re.search(f'^{re.escape(outcome)}', printed, re.MULTILINE), printed
    assert 'in its own' in printed
    assert 'for a reason' in printed
    seeds = re.findall(r'--seed (\d+)', printed)
    fell = re.findall(r'assert not (\d+)', printed)
    again = run_pytest(tmp_path, '--seed', seeds[0], '-k', 'chance')
    assert re.findall(r'assert not (\d+)', again) == fell


def test_a_fault_that_fits_its_function_not_exactly_once_is_an_error() -> None:
    for does in ('skips nowhere', 'skips kart', 'never nowhere', 'nowhere => 1'):
        with pytest.raises(AssertionError, match='times in'):
            module_with(race, Fault('_drop', does))
    with pytest.raises(ValueError, match='unpack'):
        module_with(race, Fault('_nowhere', 'skips kart'))


def test_a_plain_kart_keeps_when_it_was_sent_and_said_what() -> None:
    witness = Witness()
    with (
        BareRaceControl() as control,
        WireKart('127.0.1.1', control.port, True, witness=witness, kart=1) as kart,
    ):
        kart.wait_for_state(RaceState.IN_GARAGE)
        control.exchange(RaceState.GREEN_GREEN)
        kart.send(b'$GRID_')
        cut = time.monotonic()
        kart.send(b'ACTIVE;$READY;')
    assert witness.links == [kart]
    *said, in_pieces, ready = kart.said
    assert in_pieces[0] is ready[0] is RaceState.GRID_ACTIVE
    assert [state for _, state in kart.changes] == [state for state, _, _ in said]
    times = [kart.opened, kart.times[0]]
    for (read, _), (_, before, after) in zip(kart.changes, said, strict=True):
        times += [read, before, after]
    times += [cut, *in_pieces[1:]]
    assert times == sorted(times)
    assert kart.times[-1] <= kart.closed_at
