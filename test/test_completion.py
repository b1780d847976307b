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


def completed(line: str) -> set[str]:
    """Return what the shell offers behind a line."""
    program, *_ = line.split()
    package = {'rcs_ctl': 'evgp_rcs_console', 'rcs_record': 'evgp_rcs'}[program]
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


@pytest.mark.parametrize(
    ('line', 'offered'),
    [
        ('rcs_ctl ', {*COMMANDS, 'watch', 'results'}),
        ('rcs_ctl kart-r', {'kart-red-red', 'kart-red-flag'}),
        ('rcs_ctl grid-active --', {'--track-is-clear'}),
        ('rcs_record ', {*WAYS}),
        ('rcs_record --', {'--list', '--run'}),
        ('rcs_record report --', {'--event', '--output'}),
    ],
)
def test_every_command_way_and_option_that_fits_is_offered(line: str, offered: set[str]) -> None:
    found = completed(line)

    assert found >= offered
    assert all(each.startswith(line.split(' ')[-1]) for each in found)


def test_a_question_of_the_shell_gives_no_command(domain: int) -> None:
    done = subprocess.run(
        [executable('evgp_rcs_console', 'rcs_ctl'), 'all-kill'],
        env={**os.environ, 'ROS_DOMAIN_ID': str(domain), '_ARGCOMPLETE': '1'},
        capture_output=True,
        text=True,
        check=False,
    )
    assert 'ALL KILL' not in done.stdout + done.stderr
