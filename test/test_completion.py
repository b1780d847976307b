# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The shell completes the command lines of rcs_ctl and rcs_record, by argcomplete."""

from __future__ import annotations

import os
import pathlib
import subprocess

from evgp_rcs.rcs_record import WAYS
from evgp_rcs_console.command_line import COMMANDS
from evgp_testing.process import executable
import pytest

pytest.importorskip('argcomplete')


@pytest.mark.parametrize(
    ('package', 'line', 'offered'),
    [
        ('evgp_rcs_console', 'rcs_ctl ', {*COMMANDS, 'watch', 'results'}),
        ('evgp_rcs_console', 'rcs_ctl all-kill', {'all-kill'}),
        ('evgp_rcs_console', 'rcs_ctl kart-r', {'kart-red-red', 'kart-red-flag'}),
        ('evgp_rcs_console', 'rcs_ctl grid-active --', {'--track-is-clear'}),
        ('evgp_rcs', 'rcs_record ', {*WAYS}),
        ('evgp_rcs', 'rcs_record --', {'--list', '--run'}),
        ('evgp_rcs', 'rcs_record report --', {'--event', '--output'}),
    ],
)
def test_every_command_way_and_option_that_fits_is_offered_and_none_is_given(
    domain: int, tmp_path: pathlib.Path, package: str, line: str, offered: set[str]
) -> None:
    program, *_ = line.split()
    told = tmp_path / 'told'
    asked = {'ROS_DOMAIN_ID': str(domain), 'COMP_LINE': line, 'COMP_POINT': str(len(line))}
    asked |= {'_ARGCOMPLETE': '1', '_ARGCOMPLETE_STDOUT_FILENAME': str(told)}  # as bash asks
    done = subprocess.run(
        [executable(package, program), *line.split()[1:]],
        env={**os.environ, **asked, '_ARGCOMPLETE_IFS': '\n'},
        capture_output=True,
        check=True,
    )

    found = {each.strip() for each in told.read_text().splitlines()}
    assert found >= offered
    assert all(each.startswith(line.split(' ')[-1]) for each in found)
    assert not done.stdout + done.stderr
