# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A spare machine takes race control's address over once the first is dead, and never before."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import os
import pathlib
import subprocess
import sys
import time

from evgp_node import graph
from evgp_node.restarting import IN_THE_WAY
from evgp_protocol.frames import DEFAULT_PORT
from evgp_protocol.states import RaceState
from evgp_rcs.record.run_mark import FOLDER, place, RUN_BEGAN, RunMark
from evgp_rcs.rules.race import LastRun
from evgp_rcs.spare.copies import ORIGIN
from evgp_testing.part import PATIENCE
from evgp_testing.process import executable, Process, Program
from evgp_testing.race_control import RaceControl, settings, write_roster
import pytest
from rig.masters import FIRST, Masters, NUMBERS, SPARE
from rig.networks import kart_address, Namespace, need_networks, own_disk, RACE_CONTROL


class Event(Masters):
    """Two machines, of which the second is the first one's spare."""

    def start_first(self, monkeypatch: pytest.MonkeyPatch) -> RaceControl:
        """Start race control on the first machine, with every kart connected."""
        monkeypatch.setenv(graph.INTERFACE, FIRST)
        control = self.start(self.first)
        self.wait_for(RaceState.IN_GARAGE)
        return control

    def copy(self) -> None:
        folder = self.folder / '1'  # of the first that was started
        (folder / 'rcs.yaml').write_text('/**:\n  ros__parameters:\n    pause: 1.0\n')
        subprocess.run(
            [
                *own_disk(self.folder / 'disk of the spare'),
                *(executable('evgp_rcs', 'rcs_spare'), str(folder), '--once'),
                *('--record', str(folder / 'record.sqlite3')),
                *('--roster', 'karts.yaml', '--params', 'rcs.yaml'),
            ],
            env=self._environment(),
            check=True,
        )

    def take_over(self) -> Program:
        with self.spare.inside():
            return self.stack.enter_context(
                Program(
                    'takeover',
                    [
                        *own_disk(self.folder / 'disk of the spare'),
                        *(executable('evgp_rcs', 'rcs_takeover'), RACE_CONTROL, 'eth0'),
                    ],
                    self.domain,
                    {**self._environment(), graph.INTERFACE: SPARE},
                    end='TERM',
                )
            )

    @property
    def home(self) -> pathlib.Path:
        """Return the folder of the spare's ROS, whose name has what YAML may take for its own."""
        return self.folder / r"Anna's\new"

    def _environment(self) -> dict[str, str]:
        return {**os.environ, 'ROS_HOME': str(self.home)}


@pytest.fixture
def event(parts: contextlib.ExitStack, tmp_path: pathlib.Path) -> Event:
    """Return the machines; skip where none can be made, but not where all tests must run."""
    need_networks()
    return Event(parts, tmp_path)


def test_a_spare_takes_over_and_sends_every_kart_red_red_and_ends_when_the_first_comes_back(
    event: Event,
    monkeypatch: pytest.MonkeyPatch,
    record_property: Callable[[str, object], None],
) -> None:
    control = event.start_first(monkeypatch)
    monkeypatch.delenv(graph.INTERFACE)  # this process's own node uses only loopback
    official = event.official(event.first)
    official.wait_for_connected(*NUMBERS)
    event.copy()  # in which nothing is under way
    official.bring_to(RaceState.GREEN_GREEN, *NUMBERS)
    official.command('kart/red_red', kart=3)
    # As an earlier takeover that ended in order leaves it; the first has raced on since.
    mark = place(RACE_CONTROL, DEFAULT_PORT).relative_to(FOLDER.parent)
    RunMark(event.folder / 'disk of the spare' / mark).end(LastRun.ENDED)

    died_at = time.monotonic()
    event.plug('first-karts', up=False)
    event.plug('first-officials', up=False)
    control.lose_power()
    takeover = event.take_over()
    took = event.wait_for(RaceState.RED_RED, died_at) - died_at
    record_property('from the death to the last RED_RED', f'{took:.1f} s')
    print(f'{took:.1f} s from the death of the first to the last RED_RED')
    assert all(
        {state for _, state in kart.changes} == {RaceState.RED_RED}
        for kart in event.links.values()
    )
    assert took < 60.0

    event.plug('first-karts', up=True)
    assert takeover.wait() == IN_THE_WAY, takeover.output
    assert all(kart.state is RaceState.RED_RED for kart in event.links.values())
    with event.spare.inside():
        left = subprocess.run(['ip', 'address'], capture_output=True, text=True, check=True)
    assert f'{RACE_CONTROL}/' not in left.stdout


def test_nothing_is_taken_over_while_the_first_may_be_there_on_any_network(
    event: Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused() -> str:
        with event.take_over() as takeover:
            assert takeover.wait() == IN_THE_WAY, takeover.output
        assert len(takeover.lines) == 2
        return takeover.lines[1]

    control = event.start_first(monkeypatch)
    event.copy()
    refused()
    event.plug('first-officials', up=False)
    refused()
    event.wait_for(RaceState.IN_GARAGE)
    event.plug('first-officials', up=True)
    event.plug('first-karts', up=False)
    assert "race control answers on the officials' network" in refused()
    # Its race control is gone, and would start again, or was frozen and goes on.
    control.lose_power()
    (event.home / 'evgp_rcs' / 'spare' / ORIGIN).write_text(FIRST)
    assert FIRST in refused()
    event.plug('first-officials', up=False)
    event.plug('spare-karts', up=False)
    assert 'eth0 is down' in refused()


HOLDING = """
import ipaddress, sys
from evgp_rcs.spare.takeover import held
with held(ipaddress.IPv4Interface('10.77.0.1/24'), 'lo'):
    print('held', flush=True)
    sys.stdin.read()
"""


def test_the_address_is_given_back_however_the_takeover_ends() -> None:
    need_networks()
    with Namespace() as machine, machine.inside():

        def has_it() -> bool:
            shown = subprocess.run(['ip', 'address'], capture_output=True, text=True, check=True)
            return f'{RACE_CONTROL}/' in shown.stdout

        with subprocess.Popen(
            [sys.executable, '-c', HOLDING], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        ) as holder:
            assert holder.stdout is not None
            assert holder.stdout.readline()
            assert has_it()
            holder.kill()
        ends = time.monotonic() + PATIENCE
        while has_it():
            assert time.monotonic() < ends
            time.sleep(0.02)


def test_race_control_does_not_start_where_another_machine_has_its_address(
    event: Event, tmp_path: pathlib.Path
) -> None:
    event.spare.ip(f'addr add {RACE_CONTROL}/24 dev eth0')
    roster = write_roster(tmp_path, NUMBERS, addresses=kart_address)
    given = {**settings(tmp_path, roster), 'address': RACE_CONTROL}
    mark = place(RACE_CONTROL, int(str(given['port'])))
    run = RunMark(mark)
    run.end(LastRun.ENDED)
    with (
        event.first.inside(),
        Process('evgp_rcs', 'rcs_node', event.domain, given) as control,
    ):
        assert control.wait() == IN_THE_WAY
    (line,) = control.output.splitlines()
    assert RACE_CONTROL in line
    # The other one may race on until it is unplugged: then this one knows nothing.
    assert mark.read_text().strip() == RUN_BEGAN
