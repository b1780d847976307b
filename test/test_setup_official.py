# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What the officials' commands run, by make and by the package, with stand-ins for programs."""

from __future__ import annotations

from collections.abc import Callable
import os
import pathlib
import re
import shlex
import subprocess

import deb
import pytest
import yaml

ROOT = pathlib.Path(__file__).resolve().parents[1]

STAND_IN = """#!/bin/sh
printf '%s\\n' "${0##*/}" "$@" "graph: $EVGP_GRAPH_INTERFACE" \\
    "range: $ROS_AUTOMATIC_DISCOVERY_RANGE" "ctl: $EVGP_CTL" "takeover: $EVGP_TAKEOVER"
"""
"""Prints its name, its arguments, and what counts of its environment, one a line."""
PROGRAMS = (
    *(f'evgp_rcs/rcs_{each}' for each in ('record', 'roster', 'spare', 'takeover')),
    *('evgp_rcs_console/rcs_ctl', 'evgp_rcs_console/rcs_gui'),
    *('evgp_rehearsal/rehearse', 'evgp_timing/timekeeper_window'),
)

Run = Callable[..., list[str]]


@pytest.fixture(params=['make', 'package'])
def run(request: pytest.FixtureRequest, tmp_path: pathlib.Path) -> Run:
    """Return a function that runs a command, and returns what its programs print."""
    workspace = tmp_path / 'setup/in-workspace'
    files = {workspace: f'cd {tmp_path}; [ "$1" != --console ] || shift; PATH=.:$PATH exec "$@"'}
    for each in PROGRAMS:
        package, name = each.split('/')
        files[tmp_path / 'install' / package / 'lib' / package / name] = STAND_IN
    for name in ('python', 'setpriv'):
        files[tmp_path / name] = STAND_IN
    for path, text in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text if text.startswith('#!') else f'#!/bin/sh\n{text}\n')
        path.chmod(0o755)
    (tmp_path / 'setup/official').symlink_to(ROOT / 'setup/official')

    def run(command: str, *words: str, **environment: str) -> list[str]:
        if request.param == 'package':
            script = deb.script(command).replace(deb.HOME, str(tmp_path))
            started = ['sh', '-c', script, f'evgp-{command}', *words]
        else:
            target = 'console' if command == 'window' else command
            settings = [each for each in words if each[0].isupper()]
            arguments = shlex.join(words[len(settings) :])
            started = ['make', '-s', target, f'IN_WORKSPACE={workspace}', *settings]
            started.append(f'ARGS={arguments}')
        done = subprocess.run(
            started,
            cwd=ROOT,
            env={'PATH': os.environ['PATH'], **environment},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.replace(f'{tmp_path}/', '').splitlines()

    return run


FILE = r"""/x: y\new/it's "#2".yaml"""
"""A path that must stay one word, and one value of a parameter."""


@pytest.mark.parametrize(
    ('command', 'words', 'runs'),
    [
        ('roster', [f'ROSTER={FILE}'], ['rcs_roster', 'check', FILE]),
        ('record', ['report', '-o', 'a b.html'], ['rcs_record', 'report', '-o', 'a b.html']),
        ('record', [], ['rcs_record']),
        ('rehearsal', ['--karts', '6'], ['rehearse', '--karts', '6']),
        ('ctl', ['OFFICIAL=A B', 'red-flag'], ['rcs_ctl', '--official', 'A B', 'red-flag']),
        ('ctl', [], ['rcs_ctl', '--help']),
        ('window', [], ['rcs_gui']),
        (
            'window',
            ["OFFICIAL=Anna O'Neill"],
            ['rcs_gui', '--ros-args', '-p', "official=Anna O'Neill", '--'],
        ),
        (
            'timekeeper',
            ['OFFICIAL=7'],
            ['timekeeper_window', '--ros-args', '-p', 'official=7', '--'],
        ),
        (
            'spare',
            ['FROM=a@10.1.0.5:evgp', f'ROSTER={FILE}', 'PARAMS=rcs.yaml'],
            ['rcs_spare', 'a@10.1.0.5:evgp', '--roster', FILE, '--params', 'rcs.yaml'],
        ),
        (
            'spare',
            ['FROM=b:evgp', 'ROSTER=k', 'PARAMS=p', 'RECORD=r'],
            ['rcs_spare', 'b:evgp', '--roster', 'k', '--params', 'p', '--record', 'r'],
        ),
        (
            'takeover',
            ['ADDRESS=10.0.0.1', 'INTERFACE=eth0', '--port', '1'],
            ['rcs_takeover', '10.0.0.1', 'eth0', '--port', '1'],
        ),
    ],
)
def test_a_command_gives_its_program_what_an_official_gives_it(
    command: str, words: list[str], runs: list[str], run: Run
) -> None:
    printed = run(command, *words)
    assert [*map(read_by_ros, printed)][: len(runs)] == runs
    assert printed[len(runs)].startswith('graph: ')


def read_by_ros(word: str) -> str:
    """Return a parameter as its name and what ROS reads, and any other word as it is."""
    name, _, value = word.partition(':=')
    return f'{name}={yaml.safe_load(value)}' if value else word


def test_run_starts_race_control_and_the_timekeeper_with_their_files(run: Run) -> None:
    files = [f'{each}={FILE}' for each in ('ROSTER', 'PARAMS', 'TIMING')]
    printed = ' '.join(map(read_by_ros, run('run', *files, 'ADDRESS=10.0.0.1')))
    restarting = 'python -m evgp_node.restarting install'
    with_files = f'--ros-args --params-file {FILE} -p roster={FILE}'
    for runs in (
        f'{restarting}/evgp_rcs/lib/evgp_rcs/rcs_node {with_files} -p address=10.0.0.1 graph: ',
        f'setpriv --pdeathsig TERM {restarting}/evgp_timing/lib/evgp_timing/timekeeper '
        f'{with_files} graph: ',
    ):
        assert runs in printed


def test_run_has_files_of_its_own_for_whoever_gives_none(run: Run) -> None:
    printed = run('run')
    files = [printed[at + 1] for at, each in enumerate(printed) if each == '--params-file']
    assert len(files) == 2
    assert all((ROOT / each).exists() for each in files)
    assert not [each for each in printed if each.startswith('address:=')]


@pytest.mark.parametrize('command', ['run', 'window', 'ctl', 'takeover', 'timekeeper'])
def test_a_program_stays_on_the_machine_unless_officials_are_named(command: str, run: Run) -> None:
    for environment, words, is_used in (
        ('', [], ''),
        ('', ['OFFICIALS=10.1.0.5'], '10.1.0.5'),
        ('10.1.0.5', [], '10.1.0.5'),
        ('10.1.0.5', ['OFFICIALS=10.1.0.6'], '10.1.0.6'),
    ):
        printed = run(command, *words, EVGP_GRAPH_INTERFACE=environment)
        assert f'graph: {is_used}' in printed


def test_a_rehearsal_never_joins_the_officials_network(run: Run) -> None:
    printed = run('rehearsal', EVGP_GRAPH_INTERFACE='10.1.0.5')
    assert {'graph: ', 'range: LOCALHOST'} <= {*printed}


def test_command_lines_are_printed_as_they_were_called(
    run: Run, request: pytest.FixtureRequest
) -> None:
    called = {
        'make': ['ctl: ROS_DOMAIN_ID=7 make ctl OFFICIALS=10.1.0.6 ARGS="%s"', 'takeover: '],
        'package': ['ctl: evgp-ctl OFFICIALS=10.1.0.6 %s', 'takeover: evgp-takeover %s %s'],
    }[request.node.callspec.params['run']]
    assert run('ctl', 'OFFICIALS=10.1.0.6', ROS_DOMAIN_ID='7')[-2:] == called


@pytest.mark.parametrize('command', ['roster', 'run', 'timekeeper', 'window'])
def test_a_command_of_the_package_does_not_ignore_a_setting_of_another(command: str) -> None:
    words = [ROOT / 'setup/official', command, 'FROM=10.1.0.6']
    environment = {**os.environ, 'EVGP_CALLED': f'evgp-{command}'}
    done = subprocess.run(words, env=environment, capture_output=True, text=True)
    assert done.returncode == 2
    assert f'evgp-{command} does not accept FROM=10.1.0.6.' in done.stderr


@pytest.mark.parametrize(
    'command', [each for each in deb.COMMANDS if each not in ('ctl', 'record', 'rehearsal')]
)
def test_a_command_of_the_package_explains_itself(command: str) -> None:
    """The others explain themselves in Python."""
    words = [ROOT / 'setup/official', command, '--help']
    environment = {**os.environ, 'EVGP_CALLED': f'evgp-{command}'}
    said = subprocess.check_output(words, env=environment, text=True)
    assert re.match(rf'evgp-{command}: \w.*\nusage: evgp-{command} \[[A-Z]+=\.\.\.\]', said)
