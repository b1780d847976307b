# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""`make bridge`: the bridge on a kart's machine that has no installed ROS."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import os
import pathlib
import signal
import subprocess

from evgp_protocol.states import RaceState
from evgp_testing.domains import Domain
from evgp_testing.kart import Team
from evgp_testing.part import PATIENCE
import pytest
from rig.bare_race_control import BareRaceControl

ROOT = pathlib.Path(__file__).parents[1]


@pytest.fixture
def domain(parts: contextlib.ExitStack) -> int:
    return parts.enter_context(Domain()).number


@pytest.fixture
def race(parts: contextlib.ExitStack) -> BareRaceControl:
    return parts.enter_context(BareRaceControl())


@pytest.fixture
def made(domain: int, race: BareRaceControl) -> Iterator[subprocess.Popen[str]]:
    """Give the command in a terminal of its own, as it were."""
    with subprocess.Popen(
        ['make', '-s', 'bridge', 'HOST=127.0.0.1', 'ODOM=/odom', f'ARGS=-p port:={race.port}'],
        cwd=ROOT,
        env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as made:
        yield made
        with contextlib.suppress(ProcessLookupError):
            os.killpg(made.pid, signal.SIGKILL)


def bridges(session: int) -> list[int]:
    """Return the processes of the bridge in a session."""
    found = []
    for each in pathlib.Path('/proc').glob('[0-9]*'):
        with contextlib.suppress(OSError, IndexError):
            words = (each / 'cmdline').read_bytes().split(b'\0')
            is_bridge = words[1].endswith(b'/kart_bridge_node')
            if is_bridge and os.getsid(int(each.name)) == session:
                found.append(int(each.name))
    return found


def test_it_listens_to_the_odometry_it_is_told_of_and_comes_back_when_it_is_killed(
    made: subprocess.Popen[str], domain: int, race: BareRaceControl, parts: contextlib.ExitStack
) -> None:
    team = parts.enter_context(Team(domain))
    first = team.wait_for_state(RaceState.IN_GARAGE)
    assert team.node.count_subscribers('/odom') == 1
    (bridge,) = bridges(made.pid)
    os.kill(bridge, signal.SIGKILL)
    team.wait_for(lambda told: told.order not in (0, first.order), 'the bridge again')
    os.killpg(made.pid, signal.SIGINT)  # Ctrl-C
    made.wait(PATIENCE)
    assert bridges(made.pid) == []


def test_it_does_not_start_again_what_a_wrong_setting_stops() -> None:
    for setting, said in (('HOST=', 'make bridge HOST=10.0.0.1'), ('HOST=track', 'track')):
        done = subprocess.run(
            ['make', '-s', 'bridge', setting],
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
        assert done.returncode == 2
        assert said in done.stderr


@pytest.mark.parametrize(
    ('arguments', 'required'), [([], False), (['ODOM=/odom'], True), (['ODOM=~/odom'], True)]
)
def test_odometry_that_is_asked_for_is_required(arguments: list[str], required: bool) -> None:
    printed = subprocess.run(
        ['make', '-n', 'bridge', 'HOST=127.0.0.1', *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=True,
    ).stdout
    assert ('-p odometry_required:=true' in printed) == required
    assert ('~/odom:=' in printed) == required
