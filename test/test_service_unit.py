# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Race control and the timekeeper as services of systemd, by the units that are shipped."""

from __future__ import annotations

from collections.abc import Callable
import configparser
import contextlib
import pathlib
import re
import shlex
import shutil
import subprocess

from evgp_node.process import WRONG_SETTING
from evgp_testing.domains import Domain
from evgp_testing.process import Program
from evgp_testing.race_control import settings, write_roster
import pytest
import yaml

ROOT = pathlib.Path(__file__).resolve().parents[1]
UNIT = ROOT / 'src/evgp_rcs/config/evgp-rcs.service'
TIMEKEEPER = ROOT / 'src/evgp_timing/config/evgp-timekeeper.service'
BUTTON = ROOT / 'src/evgp_rcs_console/config/evgp-button.service'

Start = Callable[..., Program]


def unit(folder: pathlib.Path, path: pathlib.Path = UNIT) -> str:
    """Return the unit, with the folders of this machine in place of those that it names."""
    text = path.read_text(encoding='utf-8')
    return text.replace('/opt/evgp', str(ROOT)).replace('/etc/evgp', str(folder))


def service(folder: pathlib.Path, path: pathlib.Path = UNIT) -> dict[str, str]:
    """Return the last value of each setting of the service."""
    parser = configparser.RawConfigParser(strict=False)
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    parser.read_string(unit(folder, path))
    return dict(parser['Service'])


@pytest.mark.skipif(not shutil.which('systemd-analyze'), reason='there is no systemd here')
@pytest.mark.parametrize('path', [UNIT, TIMEKEEPER, BUTTON], ids=lambda path: path.stem)
def test_systemd_finds_nothing_wrong_with_a_unit(
    path: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    written = tmp_path / path.name
    written.write_text(unit(tmp_path, path), encoding='utf-8')
    done = subprocess.run(
        ['systemd-analyze', 'verify', written], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert path.name not in done.stderr  # it may find fault with others


def test_the_service_of_a_button_may_open_a_device_with_the_documented_rule(
    tmp_path: pathlib.Path,
) -> None:
    (group,) = re.findall('GROUP="(\\w+)"', (ROOT / 'docs/button.md').read_text(encoding='utf-8'))
    assert {'input', group} <= {*service(tmp_path, BUTTON)['SupplementaryGroups'].split()}


@pytest.fixture
def start(parts: contextlib.ExitStack, tmp_path: pathlib.Path) -> Start:
    """Return a function that runs a service's command, in its folder's place."""

    def run(path: pathlib.Path = UNIT) -> Program:
        domain = parts.enter_context(Domain())
        words = shlex.split(service(tmp_path, path)['ExecStart'])
        given = {'ROS_HOME': str(tmp_path)}
        command = ['env', '-C', str(ROOT), *words]
        return parts.enter_context(Program('service', command, domain.number, given, end='TERM'))

    return run


def configure(folder: pathlib.Path) -> None:
    """Write the files that the unit names."""
    parameters = settings(folder, write_roster(folder, [1]))
    roster = pathlib.Path(str(parameters.pop('roster')))
    roster.rename(folder / 'karts.yaml')
    given = {'address': parameters['address'], 'port': parameters['port']}
    text = yaml.safe_dump({'/**': {'ros__parameters': given}})
    (folder / 'rcs.yaml').write_text(text, encoding='utf-8')
    shutil.copy(TIMEKEEPER.with_name('timekeeper.yaml'), folder)


def test_the_service_starts_race_control_and_ends_it_in_order(
    start: Start, tmp_path: pathlib.Path
) -> None:
    configure(tmp_path)
    running = start()
    running.wait_for_line(r'listens for .* port (\d+)')
    assert running.close() == 0
    assert (tmp_path / 'evgp_rcs/record.sqlite3').exists()


def test_the_service_of_the_timekeeper_starts_it_with_the_roster_of_race_control(
    start: Start, tmp_path: pathlib.Path
) -> None:
    configure(tmp_path)
    running = start(TIMEKEEPER)
    running.wait_for_line('keeps its book in')
    assert running.close() == 0
    assert (tmp_path / 'evgp_rcs/timing.sqlite3').exists()
    words = [service(tmp_path, path)['ExecStart'].split() for path in (UNIT, TIMEKEEPER)]
    rosters = {word for each in words for word in each if word.startswith('roster:=')}
    assert rosters == {f'roster:={tmp_path}/karts.yaml'}


@pytest.mark.parametrize(
    ('path', 'final'), [(UNIT, []), (TIMEKEEPER, [WRONG_SETTING])], ids=['rcs', 'timekeeper']
)
def test_after_a_wrong_setting_systemd_starts_race_control_again_and_not_its_timekeeper(
    path: pathlib.Path, final: list[int], tmp_path: pathlib.Path
) -> None:
    """Race control may have been up with another roster, so it has to come back (H18)."""
    given = service(tmp_path, path)
    assert given['Restart'] == 'on-failure'
    assert [*map(int, given.get('RestartPreventExitStatus', '').split())] == final
