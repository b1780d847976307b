# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The Debian package for officials. `setup/try-deb` installs it in a clean Debian, by hand."""

from __future__ import annotations

import os
import pathlib
import re
import shutil
import subprocess
import sys

import deb
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]

STATED = re.compile(
    r'opt/evgp/.+|DEBIAN/(control|prerm)|usr/bin/evgp-\w+'
    r'|usr/share/(applications/evgp-\w+\.desktop|doc/evgp-race-control/copyright)'
    r'|usr/share/bash-completion/completions/evgp-(ctl|record)'
    r'|lib/systemd/system/evgp-\w+\.service'
)
"""What docs/install-officials.md says that the package has."""


@pytest.mark.skipif(shutil.which('dpkg') is None, reason='no dpkg')
def test_a_library_that_is_missing_is_named_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(deb, 'NOT_ON_ALL', 'libevgp-none')
    with pytest.raises(SystemExit, match=r"'apt-get install libevgp-none'\.$"):
        deb.need_libraries()


def test_a_package_for_another_python_than_the_systems_is_not_built(
    tmp_path: pathlib.Path,
) -> None:
    system = tmp_path / 'python3'
    system.symlink_to(f'python{deb.prepare.Interpreter.version}')
    deb.need_python_of(system)
    system.unlink()
    system.symlink_to('python3.9')
    with pytest.raises(SystemExit, match=f"'make deb PYTHON={system}'"):
        deb.need_python_of(system)


def test_the_package_is_neither_removed_nor_replaced_while_a_program_of_it_runs(
    tmp_path: pathlib.Path,
) -> None:
    # In a place of its own, because the script asks about all programs of this machine.
    before_removal = deb.BEFORE_REMOVAL.replace(deb.HOME, str(tmp_path))

    def upgrade() -> int:
        return subprocess.run(['sh', '-c', before_removal, 'prerm', 'upgrade']).returncode

    # as evgp-run starts it, and as the units of systemd do
    for program in (
        [f'{tmp_path}/install/evgp_rcs/lib/evgp_rcs/rcs_node', '60'],
        [f'{tmp_path}/.venv/bin/python', '60'],
    ):
        with subprocess.Popen(program, executable=shutil.which('sleep')) as running:
            while not pathlib.Path(f'/proc/{running.pid}/cmdline').read_bytes():
                pass  # the kernel has not put it there yet
            assert upgrade() == 1
            running.kill()
    assert upgrade() == 0


@pytest.mark.long
@pytest.mark.longest
@pytest.mark.timeout(600)  # it copies, compiles and packs 300 MB
@pytest.mark.skipif(not shutil.which('dpkg-deb'), reason='there is no dpkg-deb')
@pytest.mark.skipif('ROS_DISTRO' in os.environ, reason='the package carries the wheels of ROS')
def test_the_package_has_only_what_is_stated_and_needs_neither_this_clone_nor_a_compiler(
    tmp_path: pathlib.Path,
) -> None:
    words = [ROOT / 'setup/deb.py', '0.0.0', 'none']
    subprocess.run([sys.executable, *words], cwd=ROOT, check=True)
    package = ROOT / 'build/evgp-race-control_0.0.0_amd64.deb'
    subprocess.run(['dpkg-deb', '--raw-extract', package, tmp_path / 'root'], check=True)
    package.unlink()
    files = [each for each in (tmp_path / 'root').rglob('*') if not each.is_dir()]
    paths = [str(each.relative_to(tmp_path / 'root')) for each in files]
    assert [each for each in paths if not STATED.fullmatch(each)] == []
    for path in files:
        assert path.suffix not in ('.c', '.h', '.hpp', '.cmake', '.a'), path
        assert path.is_symlink() or path.stat().st_mode & 0o777 in (0o644, 0o755), path
        content = b'' if path.is_symlink() else path.read_bytes()
        assert b'\0' in content or bytes(ROOT) not in content, path
