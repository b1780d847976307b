# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""`make bridge`: the bridge on a kart's machine that has no installed ROS."""

from __future__ import annotations

import contextlib
import os
import pathlib
import signal
import subprocess

from evgp_protocol.states import RaceState
from evgp_testing.domains import Domain
from evgp_testing.kart import Team
from evgp_testing.part import PATIENCE
from evgp_testing.process import wait_until_ended
from evgp_testing.usage import family
import pytest
from rig.bare_race_control import BareRaceControl
from rig.terminal import Terminal

ROOT = pathlib.Path(__file__).parents[1]


@pytest.fixture
def race(parts: contextlib.ExitStack) -> BareRaceControl:
    return parts.enter_context(BareRaceControl())


@pytest.fixture
def team(parts: contextlib.ExitStack) -> Team:
    return parts.enter_context(Team(parts.enter_context(Domain()).number))


def test_it_listens_to_the_odometry_it_is_told_of_and_comes_back_when_it_is_killed(
    race: BareRaceControl, team: Team, parts: contextlib.ExitStack
) -> None:
    words = ['make', '-s', 'bridge', 'HOST=127.0.0.1', 'ODOM=/odom', f'ARGS=-p port:={race.port}']
    domain = {'ROS_DOMAIN_ID': str(team.context.get_domain_id())}
    made = parts.enter_context(Terminal(words, domain, ROOT))
    first = team.wait_for_state(RaceState.IN_GARAGE)
    # DDS may find its publisher of the race state before its subscription.
    team.wait_until_polled(lambda: team.node.count_subscribers('/odom') == 1, 'to hear odometry')
    os.kill(family(made.process.pid)[-1], signal.SIGKILL)
    team.wait_for(lambda told: told.order not in (0, first.order), 'the bridge again')
    again = family(made.process.pid)[-1]
    made.press('\x03')  # Ctrl-C
    made.end()
    wait_until_ended(again)


@pytest.mark.parametrize(
    ('setting', 'said'),
    [
        ('HOST=', 'make bridge HOST=10.0.0.1'),
        ('HOST=track', "'track' is not an IPv4 address"),
    ],
)
def test_it_does_not_start_again_what_a_wrong_setting_stops(setting: str, said: str) -> None:
    code, printed = make('-s', 'bridge', setting)
    assert code == 2
    assert printed.count(said) == 1


@pytest.mark.parametrize(
    ('arguments', 'required'), [([], False), (['ODOM=/odom'], True), (['ODOM=~/odom'], True)]
)
def test_odometry_that_is_asked_for_is_required(arguments: list[str], required: bool) -> None:
    _, printed = make('-n', 'bridge', 'HOST=127.0.0.1', *arguments)
    assert ('-p odometry_required:=true' in printed) == required
    assert ('~/odom:=' in printed) == required


def make(*words: str) -> tuple[int, str]:
    """Return the exit code of make, and what it prints."""
    done = subprocess.run(
        ['make', *words],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    return done.returncode, done.stdout
