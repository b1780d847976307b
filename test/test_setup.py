# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What the set-up decides, and what it says to a machine that it cannot be set up on."""

from __future__ import annotations

import dataclasses
import os
import pathlib
import re
import subprocess
import sys

import prepare
import pytest

ROOT = pathlib.Path(__file__).resolve().parent.parent


FITTING = prepare.Interpreter(
    executable='python3.12',
    version='3.12',
    implementation='CPython',
    machine='Linux x86_64',
    libc=('glibc', '2.36'),
    has_venv=True,
    has_headers=True,
    modules=frozenset({'colcon_core', 'pytest', 'rclpy', 'yaml'}),
)


ARM = dataclasses.replace(FITTING, version='3.13', machine='Linux aarch64')


def without(*names: str) -> object:
    """Return an interpreter that fits but for these modules."""
    return dataclasses.replace(FITTING, modules=FITTING.modules - {*names})


@pytest.mark.parametrize(
    ('sourced', 'python', 'advice'),
    [
        (False, FITTING, None),
        *(
            (False, dataclasses.replace(FITTING, **change), advice)
            for change, advice in (
                ({'version': '3.10'}, 'install CPython 3.11 to 3.14'),
                ({'version': '3.15'}, 'install CPython 3.11 to 3.14'),
                ({'implementation': 'PyPy'}, 'install CPython 3.11 to 3.14'),
                ({'machine': 'Linux aarch64'}, 'install ROS 2 Jazzy itself'),
                ({'machine': 'Darwin x86_64'}, 'install ROS 2 Jazzy itself'),
                ({'libc': ('', '')}, 'install ROS 2 Jazzy itself'),
                ({'libc': ('glibc', '2.27')}, 'install ROS 2 Jazzy itself'),
                ({'has_venv': False}, "'apt-get install python3.12-venv'"),
                ({'has_headers': False}, "'apt-get install python3.12-dev'"),
            )
        ),
        (True, ARM, None),
        (True, without('rclpy'), 'source the setup.bash of your ROS 2'),
        (True, without('pytest'), "'apt-get install python3-pytest'"),
        (True, without('colcon_core'), "'apt-get install python3-colcon-common-extensions'"),
    ],
)
def test_a_python_that_does_not_fit_is_told_what_to_install(
    sourced: bool, python: object, advice: str | None
) -> None:
    reason = prepare.why_unfit(python, sourced=sourced)
    assert reason is None if advice is None else advice in reason


@pytest.mark.parametrize(
    ('environment', 'sourced', 'advice'),
    [
        ({}, False, None),
        ({'ROS_DISTRO': ''}, False, None),
        ({'ROS_DISTRO': 'jazzy'}, True, None),
        ({'ROS_DISTRO': 'lyrical'}, True, None),
        ({'ROS_DISTRO': 'humble'}, False, 'Jazzy or Lyrical'),
    ],
)
def test_an_installed_ros_is_used_where_it_is_sourced_and_not_another(
    environment: dict[str, str], sourced: bool, advice: str | None
) -> None:
    assert prepare.is_sourced(environment) is sourced
    reason = prepare.why_no_ros(environment)
    assert reason is None if advice is None else advice in reason


@pytest.mark.parametrize(
    ('marked', 'there', 'made'),
    [
        (None, True, True),  # nothing, or half-made
        ('', True, True),  # damaged
        ('other', True, True),
        ('wanted', False, True),
        ('wanted', True, False),
    ],
)
def test_what_is_there_is_made_anew_unless_it_is_what_is_wanted(
    tmp_path: pathlib.Path, marked: str | None, there: bool, made: bool
) -> None:
    stamp = tmp_path / 'stamp'
    if marked is not None:
        stamp.write_text(marked)
    marks = []
    prepare.make(stamp, 'wanted', lambda: marks.append(stamp.exists()), there)
    assert marks == ([False] if made else [])
    assert stamp.read_text() == 'wanted'


def test_a_set_up_that_cannot_use_its_files_says_why_in_one_sentence(
    tmp_path: pathlib.Path,
) -> None:
    (tmp_path / 'setup').mkdir()
    alone = tmp_path / 'setup/prepare.py'
    alone.write_text((ROOT / 'setup/prepare.py').read_text())
    done = subprocess.run([sys.executable, alone], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith('The set-up failed (')
    assert str(tmp_path / 'setup/build.txt') in done.stderr
    assert len(done.stderr.splitlines()) == 1


BROKEN = (
    'INCLUDE "/opt/python/cp312-cp312/include/python3.12;'
    '/opt/python/cp312-cp312/lib/python3.12/site-packages/numpy/_core/include"'
)


def test_the_folders_of_the_wheels_builder_become_those_of_this_machine_and_stay() -> None:
    once = prepare.repaired(BROKEN, 'inc', r'si\te')
    assert once == r'INCLUDE "inc;si\te/numpy/_core/include"'
    assert prepare.repaired(once, 'inc', r'si\te') == once


@pytest.mark.parametrize(
    ('path', 'before', 'rebuilds'),
    [
        ('package/msg/State.msg', 'before', True),
        ('package/CMakeLists.txt', 'before', True),
        ('package/setup.cfg', 'before', True),
        ('package/package/module.py', 'before', False),
        ('package/test/test_module.py', 'before', False),
        ('package/config/parameters.yaml', 'before', False),
        ('package/launch/node.launch.py', 'before', False),
        ('package/config/new.yaml', None, True),
        ('package/launch/new.launch.py', None, True),
    ],
)
def test_what_changed_or_is_new_is_built_anew_where_a_link_does_not_do(
    tmp_path: pathlib.Path, path: str, before: str | None, rebuilds: bool
) -> None:
    file = tmp_path / path
    file.parent.mkdir(parents=True)
    if before is not None:
        file.write_text(before)
    was = prepare.digest(prepare.build_inputs(tmp_path))
    file.write_text('after')
    assert (prepare.digest(prepare.build_inputs(tmp_path)) != was) is rebuilds


def put_python(folder: pathlib.Path, answer: str, code: int) -> pathlib.Path:
    """Put a Python into a folder that gives this answer when it is asked whether it fits."""
    folder.mkdir(exist_ok=True)
    python = folder / 'python3.12'
    python.write_text(f'#!/bin/sh\necho "{answer}"\nexit {code}\n')
    python.chmod(0o755)
    return folder


def find_python(*path: pathlib.Path, **environment: str) -> tuple[int, str]:
    """Return the exit code of find-python with this PATH, and what it says."""
    done = subprocess.run(
        ['/bin/sh', ROOT / 'setup' / 'find-python'],
        env={'PATH': os.pathsep.join([*map(str, path), '/usr/bin']), **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout.strip()


def test_find_python_says_what_to_do_where_python_does_not_run() -> None:
    said = 'PYTHON=no-such-python does not run; name a Python 3.11 to 3.14.'
    assert find_python(PYTHON='no-such-python') == (1, said)


def test_a_python_that_fits_is_found_behind_one_that_does_not(tmp_path: pathlib.Path) -> None:
    pyenv = put_python(tmp_path / 'pyenv', 'install what is there', 1)
    system = put_python(tmp_path / 'system', '/the/one', 0)
    assert find_python(pyenv, system) == (0, '/the/one')


@pytest.mark.skipif(not os.access('/usr/bin/python3', os.X_OK), reason='no /usr/bin/python3')
def test_where_none_fits_the_advice_is_for_the_python_of_the_system(
    tmp_path: pathlib.Path,
) -> None:
    pyenv = put_python(tmp_path / 'pyenv', 'install what is there', 1)
    code, said = find_python(pyenv, ROS_DISTRO='unheard-of')  # no Python fits
    assert code == 1
    assert 'unheard-of' in said


def printed(*words: object, **environment: str) -> str:
    """Return what a command prints that succeeds."""
    done = subprocess.run(
        [*map(str, words)], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture
def beside(tmp_path: pathlib.Path) -> dict[str, str]:
    """Return an environment that has plugins of an installed ROS, which break what loads them."""
    (tmp_path / 'intruder.py').write_text('raise RuntimeError')
    made = tmp_path / 'intruder-1.0.dist-info'
    made.mkdir()
    (made / 'METADATA').write_text('Metadata-Version: 2.1\nName: intruder\nVersion: 1.0\n')
    (made / 'entry_points.txt').write_text(
        '[flake8.extension]\nX9 = intruder:check\n'
        '[pytest11]\nlaunch_testing = intruder\nlaunch_ros = intruder\n'
    )
    path = f'{tmp_path}{os.pathsep}{os.environ.get("PYTHONPATH", "")}'
    return {**os.environ, 'PYTHONPATH': path}


def test_lint_loads_no_flake8_plugin_of_the_system(beside: dict[str, str]) -> None:
    beside['PATH'] = f'{pathlib.Path(sys.executable).parent}:{beside["PATH"]}'
    assert 'import_order' in printed(ROOT / 'setup/without-ros', 'flake8', '--version', **beside)


def test_a_run_of_pytest_loads_no_launch_plugin_of_ros(beside: dict[str, str]) -> None:
    words = ['-m', 'pytest', '--collect-only', '-q', __file__, '-k', 'no_launch']
    assert 'no_launch' in printed(sys.executable, *words, **beside)


def pins(lock: str) -> dict[str, str]:
    """Return the versions that a lock file names, by package."""
    text = (ROOT / 'setup' / lock).read_text()
    return dict(re.findall(r'^([a-z0-9-]+)==(\S+)', text, re.MULTILINE))


@pytest.mark.parametrize('lock', ['build.txt', 'tools.txt'])
def test_the_locks_agree(lock: str) -> None:
    assert pins(lock).items() <= pins('ros.txt').items()


def test_a_shell_that_exports_cdpath_finds_the_workspace() -> None:
    environment = {**os.environ, 'CDPATH': '.'}
    assert printed('setup/in-workspace', 'echo', 'there', **environment) == 'there\n'


@pytest.mark.parametrize(
    'target',
    ['bench', 'demo', 'screenshots', 'sim', 'soak', 'test', 'test-alone', 'test-long'],
)
def test_a_simulated_race_never_joins_the_officials_network(target: str) -> None:
    environment = {**os.environ, 'EVGP_GRAPH_INTERFACE': '10.1.0.5'}
    lines = printed('make', '-s', target, 'IN_WORKSPACE=sh -c env', **environment).splitlines()
    assert 'EVGP_GRAPH_INTERFACE=' in lines
    assert 'ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST' in lines


def test_the_makes_that_tests_run_know_nothing_of_what_make_test_was_told() -> None:
    words = ['-s', 'test', 'ARGS=-k roster', 'WORKERS=3', 'IN_WORKSPACE=sh -c env']
    names = {line.partition('=')[0] for line in printed('make', *words, **os.environ).splitlines()}
    assert 'PATH' in names
    assert not names & {'ARGS', 'MAKEFLAGS', 'MFLAGS', 'WORKERS'}
