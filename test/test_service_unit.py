# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Race control and the timekeeper as services of systemd, by the units that are shipped."""

from __future__ import annotations

import configparser
import pathlib
import re
import shlex
import shutil
import subprocess

from evgp_node.process import WRONG_SETTING
from evgp_testing.process import Program
from evgp_testing.race_control import settings, write_roster
import pytest
import yaml

ROOT = pathlib.Path(__file__).resolve().parents[1]
UNIT = ROOT / 'src/evgp_rcs/config/evgp-rcs.service'
TIMEKEEPER = ROOT / 'src/evgp_timing/config/evgp-timekeeper.service'
BUTTON = ROOT / 'src/evgp_rcs_console/config/evgp-button.service'


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


def configure(folder: pathlib.Path) -> None:
    """Write the files that the unit names."""
    parameters = settings(folder, write_roster(folder, [1]))
    roster = pathlib.Path(str(parameters.pop('roster')))
    roster.rename(folder / 'karts.yaml')
    given = {'address': parameters['address'], 'port': parameters['port']}
    text = yaml.safe_dump({'/**': {'ros__parameters': given}})
    (folder / 'rcs.yaml').write_text(text, encoding='utf-8')
    shutil.copy(TIMEKEEPER.with_name('timekeeper.yaml'), folder)


@pytest.mark.parametrize(
    ('path', 'line', 'kept'),
    [
        (UNIT, r'listens for .* port (\d+)', 'record.sqlite3'),
        (TIMEKEEPER, 'keeps its book in', 'timing.sqlite3'),
    ],
    ids=['rcs', 'timekeeper'],
)
def test_a_service_starts_its_program_with_one_roster_for_all_and_ends_it_in_order(
    path: pathlib.Path, line: str, kept: str, domain: int, tmp_path: pathlib.Path
) -> None:
    configure(tmp_path)
    words = shlex.split(service(tmp_path, path)['ExecStart'])
    assert f'roster:={tmp_path}/karts.yaml' in words
    given = {'ROS_HOME': str(tmp_path)}
    command = ['env', '-C', str(ROOT), *words]
    with Program('service', command, domain, given, end='TERM') as running:
        running.wait_for_line(line)
        assert running.close() == 0
    assert (tmp_path / 'evgp_rcs' / kept).exists()


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
