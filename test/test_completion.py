# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The shell completes the command lines of rcs_ctl and rcs_record, by argcomplete."""

from __future__ import annotations

import os
import pathlib
import shutil
import subprocess
import sys

from evgp_rcs.rcs_record import WAYS
from evgp_rcs_console.command_line import COMMANDS
from evgp_testing.domains import Domain
from evgp_testing.process import executable
import pytest

SHELL = """
eval "$(register-python-argcomplete $1)"
COMP_LINE=$2 COMP_POINT=${#2} COMP_TYPE=9
how=$(complete -p $1)
how=${how#*-F }
IFS=$'\\n'
${how%% *} $1
printf '%s\\n' "${COMPREPLY[@]}"
"""
"""What bash does when someone types $2 and presses the tabulator."""

pytestmark = pytest.mark.skipif(
    shutil.which('register-python-argcomplete', path=str(pathlib.Path(sys.executable).parent))
    is None
    and shutil.which('register-python-argcomplete') is None,
    reason='there is no argcomplete',
)


def completed(package: str, program: str, line: str) -> set[str]:
    """Return what the shell offers behind a line."""
    folders = [
        pathlib.Path(executable(package, program)).parent,
        pathlib.Path(sys.executable).parent,
    ]
    path = os.pathsep.join([*map(str, folders), os.environ['PATH']])
    done = subprocess.run(
        ['bash', '-c', SHELL, 'bash', program, line],
        env={**os.environ, 'PATH': path},
        capture_output=True,
        text=True,
        check=True,
    )
    return {each.strip() for each in done.stdout.splitlines()} - {''}


def ctl(line: str) -> set[str]:
    return completed('evgp_rcs_console', 'rcs_ctl', line)


def record(line: str) -> set[str]:
    return completed('evgp_rcs', 'rcs_record', line)


def test_every_command_of_an_official_is_offered() -> None:
    assert {*COMMANDS, 'watch', 'results'} <= ctl('rcs_ctl ')
    assert ctl('rcs_ctl kart-r') == {'kart-red-red', 'kart-red-flag'}


def test_the_options_of_a_command_are_offered() -> None:
    assert '--track-is-clear' in ctl('rcs_ctl grid-active --')


def test_what_can_be_done_with_a_record_is_offered() -> None:
    assert set(WAYS) <= record('rcs_record ')
    assert {'--list', '--run'} <= record('rcs_record --')
    assert {'--event', '--output'} <= record('rcs_record report --')


def test_a_question_of_the_shell_gives_no_command() -> None:
    with Domain() as domain:
        done = subprocess.run(
            [executable('evgp_rcs_console', 'rcs_ctl'), 'all-kill'],
            env={**os.environ, 'ROS_DOMAIN_ID': str(domain.number), '_ARGCOMPLETE': '1'},
            capture_output=True,
            text=True,
            check=False,
        )
    assert 'ALL KILL' not in done.stdout + done.stderr
