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
words=$(printf '%s|' "${0##*/}" "$@")
words="$words$EVGP_GRAPH_INTERFACE|$ROS_AUTOMATIC_DISCOVERY_RANGE"
printf '%s\\n' "$words|$EVGP_CTL|$EVGP_TAKEOVER"
"""
IN_WORKSPACE = """#!/bin/sh
cd "${0%/*}" && PATH=.:$PATH
[ "$1" != --console ] || shift
exec "$@"
"""

Run = Callable[..., list[str]]


@pytest.fixture(params=['make', 'package'])
def run(request: pytest.FixtureRequest, tmp_path: pathlib.Path) -> Run:
    """Return a function that runs a command, and returns the line of each program it starts."""
    programs = [each.relative_to(ROOT) for each in ROOT.glob('install/evgp_*/lib/evgp_*/*')]
    in_workspace = tmp_path / 'in-workspace'
    for path in (*programs, 'python', 'setpriv', in_workspace):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(IN_WORKSPACE if path is in_workspace else STAND_IN)
        (tmp_path / path).chmod(0o755)
    (tmp_path / 'setup').mkdir()
    (tmp_path / 'setup/official').symlink_to(ROOT / 'setup/official')

    def run(command: str, *words: str, **environment: str) -> list[str]:
        settings = [each for each in words if re.match('[A-Z]+=', each)]
        arguments = f'ARGS={shlex.join(words[len(settings) :])}'
        target = 'console' if command == 'window' else command
        started = ['make', '-s', target, f'IN_WORKSPACE={in_workspace}', *settings, arguments]
        if request.param == 'package':
            script = deb.script(command).replace(f'{deb.HOME}/setup/in-', f'{tmp_path}/in-')
            started = ['sh', '-c', script.replace(deb.HOME, str(tmp_path)), command, *words]
        environment['PATH'] = os.environ['PATH']
        printed = subprocess.check_output(started, cwd=ROOT, env=environment, text=True)
        return printed.replace(f'{tmp_path}/', '').splitlines()

    return run


FILE = r"""/x: y\new/it's "#2".yaml"""
"""A path that must stay one word, and one value of a parameter."""

RACE_CONTROL = 'python -m evgp_node.restarting install/evgp_rcs/lib/evgp_rcs/rcs_node --ros-args'
TIMEKEEPER = (
    'setpriv --pdeathsig TERM python -m evgp_node.restarting '
    'install/evgp_timing/lib/evgp_timing/timekeeper --ros-args'
)


@pytest.mark.parametrize(
    ('given', 'runs'),
    [
        ('record report -o "a b"', ['rcs_record report -o "a b"']),
        ('roster ROSTER=FILE', ['rcs_roster check FILE']),
        ('spare FROM=a@b:c ROSTER=FILE PARAMS=p', ['rcs_spare a@b:c --roster FILE --params p']),
        (
            'spare FROM=a ROSTER=b PARAMS=c RECORD=d -v',
            ['rcs_spare a --roster b --params c --record d -v'],
        ),
        ('takeover ADDRESS=a INTERFACE=b --port 1', ['rcs_takeover a b --port 1']),
        ('ctl', ['rcs_ctl --help']),
        ('ctl OFFICIAL=FILE red-flag', ['rcs_ctl --official FILE red-flag']),
        ('window', ['rcs_gui']),
        ('window OFFICIAL=FILE', ['rcs_gui --ros-args -p official=FILE --']),
        ('timekeeper OFFICIAL=7', ['timekeeper_window --ros-args -p official=7 --']),
        ('rehearsal --karts 6', ['rehearse --karts 6']),
        (
            'run ROSTER=FILE PARAMS=FILE TIMING=c ADDRESS=d',
            [
                f'{RACE_CONTROL} --params-file FILE -p roster=FILE -p address=d',
                f'{TIMEKEEPER} --params-file c -p roster=FILE',
            ],
        ),
    ],
)
def test_a_command_gives_its_program_what_an_official_gives_it(
    given: str, runs: list[str], run: Run
) -> None:
    def words(line: str) -> list[str]:
        return [each.replace('FILE', FILE) for each in shlex.split(line)]

    def read_by_ros(word: str) -> str:
        name, _, value = word.partition(':=')
        return f'{name}={yaml.safe_load(value)}' if value else word

    started = [[*map(read_by_ros, line.split('|')[:-4])] for line in run(*words(given))]
    assert sorted(started) == [*map(words, runs)]


BRIDGE = (
    'python -m evgp_node.restarting install/evgp_kart_bridge/lib/evgp_kart_bridge/kart_bridge_node'
    ' --ros-args -p host:=10.0.0.1'
)


@pytest.mark.parametrize('run', ['make'], indirect=True)
def test_odometry_that_is_asked_for_is_required_and_a_bridge_needs_an_address(run: Run) -> None:
    def started(*words: str) -> str:
        (line,) = run('bridge', *words)
        return ' '.join(line.replace("'", '').split('|')[:-4])

    assert started('HOST=10.0.0.1', '-p', 'port:=1') == f'{BRIDGE} -p port:=1'
    for odom in ('/odom', '~/odom'):
        required = f'{BRIDGE} -r ~/odom:={odom} -p odometry_required:=true'
        assert started('HOST=10.0.0.1', f'ODOM={odom}') == required
    done = subprocess.run(['make', '-s', 'bridge'], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, 'make bridge HOST=10.0.0.1' in done.stderr) == (2, True)


@pytest.mark.parametrize('command', ['run', 'window', 'ctl', 'takeover', 'timekeeper'])
def test_a_program_stays_on_the_machine_unless_officials_are_named(command: str, run: Run) -> None:
    for environment, words, is_used in (
        ('', [], ''),
        ('', ['OFFICIALS=10.1.0.5'], '10.1.0.5'),
        ('10.1.0.5', [], '10.1.0.5'),
        ('10.1.0.5', ['OFFICIALS=10.1.0.6'], '10.1.0.6'),
    ):
        printed = run(command, *words, EVGP_GRAPH_INTERFACE=environment)
        assert {line.split('|')[-4] for line in printed} == {is_used}


def test_a_rehearsal_never_joins_the_officials_network(run: Run) -> None:
    (printed,) = run('rehearsal', EVGP_GRAPH_INTERFACE='10.1.0.5')
    assert printed.split('|')[-4:-2] == ['', 'LOCALHOST']


def test_command_lines_are_printed_as_this_one_was_called(run: Run) -> None:
    (printed,) = run('ctl', 'OFFICIALS=10.1.0.6', ROS_DOMAIN_ID='7')
    assert printed.split('|')[-2:] in (
        ['ROS_DOMAIN_ID=7 make ctl OFFICIALS=10.1.0.6 ARGS="%s"', ''],
        ['evgp-ctl OFFICIALS=10.1.0.6 %s', 'evgp-takeover %s %s'],
    )


@pytest.mark.parametrize('command', ['roster', 'run', 'timekeeper', 'window'])
def test_a_command_of_the_package_explains_itself_and_ignores_no_setting_of_another(
    command: str,
) -> None:
    words, called = [ROOT / 'setup/official', command], f'evgp-{command}'
    environment = {**os.environ, 'EVGP_CALLED': called}
    said = subprocess.check_output([*words, '--help'], env=environment, text=True)
    assert re.match(rf'{called}: \w.*\nusage: {called} \[[A-Z]+=\.\.\.\]', said)
    refused = subprocess.run([*words, 'FROM=a'], env=environment, capture_output=True, text=True)
    assert refused.returncode == 2
    assert f'{called} does not accept FROM=a.' in refused.stderr


@pytest.mark.parametrize('command', ['roster', 'run', 'timekeeper', 'window'])
def test_no_argument_is_dropped_in_silence(command: str, run: Run) -> None:
    with pytest.raises(subprocess.CalledProcessError):
        run(command, '--anything')
