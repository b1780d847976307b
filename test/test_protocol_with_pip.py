# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""evgp_protocol as a plain package for pip: no ROS, no network, typed."""

from __future__ import annotations

import pathlib
import re
import shutil
import subprocess
import sys
import zipfile

import pytest
from test_team_workspace import blocks

PACKAGE = pathlib.Path(__file__).resolve().parents[1] / 'src/evgp_protocol'

WITH_TYPES = """
from evgp_protocol.kart import Kart
from evgp_protocol.states import RaceState

state: RaceState = Kart().verdict.state
"""


def pip(*arguments: object) -> None:
    subprocess.run(
        [sys.executable, '-m', 'pip', '--disable-pip-version-check', *map(str, arguments)],
        check=True,
        capture_output=True,
        text=True,
    )


@pytest.fixture(scope='module')
def wheel(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """Return the package's wheel, built from a copy, since a build leaves files behind."""
    folder = tmp_path_factory.mktemp('wheel')
    made = shutil.ignore_patterns('*.egg-info', '__pycache__', 'build')
    copy = shutil.copytree(PACKAGE, folder / 'evgp_protocol', ignore=made)
    pip('wheel', '--no-index', '--no-deps', '--no-build-isolation', '-w', folder, copy)
    (built,) = folder.glob('*.whl')
    return built


@pytest.fixture(scope='module')
def python(wheel: pathlib.Path) -> pathlib.Path:
    """Return the interpreter of an environment with this package and nothing else."""
    environment = wheel.parent / 'environment'
    subprocess.run([sys.executable, '-m', 'venv', '--without-pip', environment], check=True)
    interpreter = environment / 'bin/python'
    pip('--python', interpreter, 'install', '--no-index', wheel)
    return interpreter


def test_the_example_of_its_readme_runs_with_this_package_alone(python: pathlib.Path) -> None:
    (example,) = blocks('src/evgp_protocol/README.md', 'python')
    done = subprocess.run(
        [python, '-I', '-W', 'error', '-c', example], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "b'$GRID_ACTIVE;'\n", '')


def test_its_types_reach_who_uses_it(python: pathlib.Path, tmp_path: pathlib.Path) -> None:
    (tmp_path / 'user.py').write_text(WITH_TYPES, encoding='utf-8')
    words = ['--strict', '--config-file=', '--cache-dir=.cache', '--python-executable', python]
    done = subprocess.run(
        [sys.executable, '-m', 'mypy', *words, 'user.py'],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def test_the_wheel_asks_for_nothing_and_has_its_licence_and_readme(wheel: pathlib.Path) -> None:
    with zipfile.ZipFile(wheel) as packed:
        (name,) = (each for each in packed.namelist() if each.endswith('/METADATA'))
        said = packed.read(name).decode()
        names = packed.namelist()
    assert not re.search(r'^Requires-Dist: (?!.*extra ==)', said, re.MULTILINE)
    assert '# evgp_protocol' in said
    assert any(each.endswith('LICENSE') for each in names)
    assert 'evgp_protocol/py.typed' in names
