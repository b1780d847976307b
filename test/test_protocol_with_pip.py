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


def run(*words: object, folder: pathlib.Path) -> tuple[int, str]:
    done = subprocess.run(
        [*map(str, words)],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout


def test_the_wheel_needs_nothing_and_the_example_of_its_readme_and_its_types_work_with_it_alone(
    tmp_path: pathlib.Path,
) -> None:
    made = shutil.ignore_patterns('*.egg-info', '__pycache__', 'build')
    # A build leaves files behind.
    copy = shutil.copytree(PACKAGE, tmp_path / 'source', ignore=made)
    pip('wheel', '--no-index', '--no-deps', '--no-build-isolation', '-w', tmp_path, copy)
    (wheel,) = tmp_path.glob('*.whl')
    with zipfile.ZipFile(wheel) as packed:
        names = packed.namelist()
        (name,) = (each for each in names if each.endswith('/METADATA'))
        said = packed.read(name).decode()
    assert not re.search(r'^Requires-Dist: (?!.*extra ==)', said, re.MULTILINE)
    assert '# evgp_protocol' in said
    assert any(each.endswith('LICENSE') for each in names)
    assert 'evgp_protocol/py.typed' in names

    environment = tmp_path / 'environment'
    subprocess.run([sys.executable, '-m', 'venv', '--without-pip', environment], check=True)
    python = environment / 'bin/python'
    pip('--python', python, 'install', '--no-index', wheel)
    (example,) = blocks('src/evgp_protocol/README.md', 'python')
    shown = run(python, '-I', '-W', 'error', '-c', example, folder=tmp_path)
    assert shown == (0, "b'$GRID_ACTIVE;'\n")

    (tmp_path / 'user.py').write_text(WITH_TYPES, encoding='utf-8')
    words = ['--strict', '--config-file=', '--cache-dir=.cache', '--python-executable', python]
    code, printed = run(sys.executable, '-m', 'mypy', *words, 'user.py', folder=tmp_path)
    assert code == 0, printed
