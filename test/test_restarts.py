# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Race control under `make run`: what ends it for good, and what it comes back after."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import os
import pathlib
import re
import signal
import subprocess
import sys
import time

from evgp_node.restarting import Ends, FIRST_TRIES
from evgp_protocol.states import RaceState
from evgp_testing.part import PATIENCE
from evgp_testing.process import freeze, wait_until_ended
from evgp_testing.race_control import address_of, new_port, write_roster
from evgp_testing.usage import family
from evgp_testing.wire_kart import WireKart
import pytest
from rig.terminal import Terminal
import yaml

ROOT = pathlib.Path(__file__).resolve().parents[1]
KEPT = (sys.executable, '-m', 'evgp_node.restarting')
RED_RED = RaceState.RED_RED
IN_GARAGE = RaceState.IN_GARAGE


STARTED = {'rcs_node': 'listens for 1 kart', 'timekeeper': 'keeps its book in'}
"""What each program that `make run` starts says then."""


class MakeRun(Terminal):
    """`make run` in a terminal of its own. ``inside`` are the processes that were seen there."""

    def __init__(self, folder: pathlib.Path, domain: int, *settings: str) -> None:
        """Start it, with settings of make beside its own."""
        self.port = new_port()
        roster, parameters = write_roster(folder, [1]), folder / 'rcs.yaml'
        record = str(folder / 'record.sqlite3')
        own = {'record': record, 'port': self.port, 'address': '127.0.0.1'}
        parameters.write_text(yaml.safe_dump({'/**': {'ros__parameters': own}}), encoding='utf-8')
        self.inside: set[int] = set()
        super().__init__(
            ['make', 'run', f'ROSTER={roster}', f'PARAMS={parameters}', *settings],
            {'ROS_DOMAIN_ID': str(domain), 'ROS_HOME': str(folder)},
            ROOT,
        )

    def wait_for(self, pattern: str) -> re.Match[str]:
        found = super().wait_for(pattern)
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # one has just ended
            self.inside |= {*family(self.process.pid)}
        return found

    def wait_until_back(self, program: str) -> None:
        """Return once a program has been started again since the last call."""
        self.wait_for('Starting it again')
        self.wait_for(STARTED[program])
        self.shown = ''

    def processes_of(self, program: str) -> list[int]:
        """Return the process of a program, and those that it has started."""
        found = (pid for pid in self.inside if program in ' '.join(command_of(pid)[1:2]))
        return family(next(found))

    def connect(self) -> WireKart:
        """
        Connect the kart, and again until it is sent something.

        The socket of a kart server that is being killed may still take a connection.
        """
        ends = time.monotonic() + PATIENCE
        while True:
            with contextlib.suppress(ConnectionError):
                kart = WireKart(address_of(1), self.port, acknowledges=True)
                with contextlib.suppress(AssertionError):
                    kart.wait_for_frames(1)
                    return kart
                kart.close()
            assert time.monotonic() < ends, self.shown
            time.sleep(0.002)

    def close(self) -> None:
        """Close the terminal, as by its window."""
        self.hang_up()
        for pid in self.inside:
            wait_until_ended(pid)
        self.process.wait(PATIENCE)


def test_race_control_that_was_killed_comes_back_in_red_red(
    parts: contextlib.ExitStack,
    domain: int,
    tmp_path: pathlib.Path,
    record_property: Callable[[str, object], None],
) -> None:
    terminal = parts.enter_context(MakeRun(tmp_path, domain))
    for said in STARTED.values():
        terminal.wait_for(said)
    terminal.shown = ''
    kart = terminal.connect()
    kart.wait_for_state(IN_GARAGE)
    for what, half in (('the ROS half', 0), ('the kart server', 1)):
        halves = terminal.processes_of('rcs_node')
        killed_at = time.monotonic()
        os.kill(halves[half], signal.SIGKILL)

        kart.wait_for_end()
        kart.close()
        kart = terminal.connect()
        back_at = kart.wait_for_state(RED_RED)
        assert [state for _, state in kart.changes] == [RED_RED]
        took = f'{back_at - killed_at:.2f} s'
        print(f'back in RED_RED after {took} without {what}')
        record_property('back', took)
        terminal.wait_until_back('rcs_node')
        assert not {*halves} & {*terminal.processes_of('rcs_node')}
    kart.close()

    # Nor does a kart server that is frozen keep it from coming back.
    ros_half, kart_server, _ = terminal.processes_of('rcs_node')
    freeze(kart_server)
    os.kill(ros_half, signal.SIGKILL)
    for pid in (ros_half, kart_server):
        wait_until_ended(pid)
    with terminal.connect() as kart:
        kart.wait_for_state(RED_RED)
    terminal.wait_until_back('rcs_node')

    os.kill(terminal.processes_of('timekeeper')[0], signal.SIGKILL)
    terminal.wait_until_back('timekeeper')

    terminal.close()  # by its window: all of it ends for good


def test_a_wrong_setting_of_the_timekeeper_ends_it_alone_and_ctrl_c_ends_race_control_in_red_red(
    parts: contextlib.ExitStack, domain: int, tmp_path: pathlib.Path
) -> None:
    wrong = tmp_path / 'timekeeper.yaml'
    wrong.write_text('/**:\n  ros__parameters: {min_lap_time: 0.0}\n', encoding='utf-8')
    terminal = parts.enter_context(MakeRun(tmp_path, domain, f'TIMING={wrong}'))
    terminal.wait_for('parameter min_lap_time')
    terminal.wait_for('listens for 1 kart')
    with terminal.connect() as kart:
        kart.wait_for_state(IN_GARAGE)
        terminal.press('\x03')
        kart.wait_for_end()
        assert kart.state is RED_RED
    for pid in terminal.inside:
        wait_until_ended(pid)


def command_of(pid: int) -> list[str]:
    """Return the words of a process's command; none, or an empty one: it has ended."""
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        return pathlib.Path(f'/proc/{pid}/cmdline').read_text(encoding='utf-8').split('\0')
    return []


# ----- when, and how soon -------------------------------------------------------------------


def test_at_first_only_an_orderly_end_and_a_wrong_setting_are_final() -> None:
    assert [code for code in range(-20, 20) if Ends(0.0).is_final(code, 0.0)] == [0, 2]


def test_what_is_in_the_way_of_the_first_start_for_long_is_final() -> None:
    ends = Ends(5.0)

    assert not ends.is_final(3, 5.0 + FIRST_TRIES - 0.1)
    assert ends.is_final(3, 5.0 + FIRST_TRIES)


@pytest.mark.parametrize('died', [-9, 1])
def test_a_program_that_was_up_is_tried_again_whatever_keeps_it_from_starting_now(
    died: int,
) -> None:
    ends = Ends(0.0)

    assert not any(ends.is_final(code, 1000.0) for code in (died, 2, 3, 2))
    assert ends.is_final(0, 1000.0)


def test_one_that_gives_way_is_tried_again_for_some_time_after_it_was_up_and_no_more() -> None:
    ends = Ends(0.0, gives_way=True)

    assert not any(ends.is_final(code, 1000.0) for code in (1, 3, 2))
    assert not ends.is_final(3, 1000.0 + FIRST_TRIES - 0.1)
    assert ends.is_final(3, 1000.0 + FIRST_TRIES)


PROGRAM = """
import os, signal, sys
with open(sys.argv[1], 'a') as log:
    print('run', file=log)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_program_that_dies_again_and_again_is_tried_again_and_ends_with_ctrl_c_between(
    tmp_path: pathlib.Path,
) -> None:
    log = tmp_path / 'log'
    with subprocess.Popen(
        # As a shell that ignores SIGCHLD has its programs do.
        ['env', '--ignore-signal=CHLD', *KEPT, sys.executable, '-c', PROGRAM, str(log)],
        stderr=subprocess.PIPE,
        text=True,
    ) as kept:
        assert kept.stderr is not None
        told = [kept.stderr.readline() for _ in range(3)]
        kept.send_signal(signal.SIGINT)

        assert kept.wait(PATIENCE) == 0

    assert log.read_text().splitlines() == ['run'] * 3
    assert all('SIGKILL' in line and 'Starting it again' in line for line in told)


LASTING = """
import signal, sys
signal.signal(signal.SIGTERM, lambda *_: sys.exit(print('ends in order') or 7))
print('runs', flush=True)
signal.pause()
"""


@pytest.mark.parametrize('number', ['SIGINT', 'SIGTERM', 'SIGHUP', 'SIGQUIT', 'SIGKILL'])
def test_whatever_signal_it_gets_its_program_ends_in_order_and_it_passes_on_the_code_if_it_can(
    number: str,
) -> None:
    with subprocess.Popen(
        [*KEPT, sys.executable, '-c', LASTING], stdout=subprocess.PIPE, text=True
    ) as kept:
        assert kept.stdout is not None
        assert kept.stdout.readline() == 'runs\n'
        kept.send_signal(signal.Signals[number])
        assert kept.wait(PATIENCE) == (-signal.SIGKILL if number == 'SIGKILL' else 7)
        assert kept.stdout.read() == 'ends in order\n'


OFTEN_HEALTHY = """
import sys
from evgp_node import restarting
restarting.HEALTHY = 0.0
sys.exit(restarting.keep_running(sys.argv[1:]))
"""


def test_a_program_that_ran_for_long_is_started_again_at_once_however_often_it_died(
    tmp_path: pathlib.Path,
) -> None:
    command = [sys.executable, '-c', PROGRAM, str(tmp_path / 'log')]
    with subprocess.Popen(
        [sys.executable, '-c', OFTEN_HEALTHY, *command], stderr=subprocess.PIPE, text=True
    ) as kept:
        assert kept.stderr is not None
        told = [kept.stderr.readline() for _ in range(3)]
        kept.send_signal(signal.SIGINT)
        kept.wait(PATIENCE)

    assert all(line.endswith('Starting it again now.\n') for line in told), told
