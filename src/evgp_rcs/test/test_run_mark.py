# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The mark of a run on a real disk: what it proves, and that nothing else does."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import functools
import os
import pathlib
import shutil
import subprocess
import tempfile
import threading

from evgp_rcs.record import run_mark
from evgp_rcs.record.run_mark import (
    FOLDER,
    InUseError,
    leave_began,
    place,
    RUN_BEGAN,
    RunMark,
)
from evgp_rcs.rules.race import LastRun
import pytest
from rig.disks import filled, Harm, in_place_of, remount, small_disk


@pytest.fixture
def path(tmp_path: pathlib.Path) -> pathlib.Path:
    return tmp_path / 'marks' / '12017'


def run(path: pathlib.Path, ends_as: LastRun | None = None) -> LastRun:
    """Have a run begin and end, or die (None), and return what it knew of the last one."""
    mark = RunMark(path)
    if ends_as is None:
        assert mark._file is not None
        os.close(mark._file)
    else:
        mark.end(ends_as)
    return mark.last_run


def test_each_run_knows_how_the_last_one_ended_or_that_one_died_or_failed_to_start_since(
    path: pathlib.Path,
) -> None:
    assert run(path, LastRun.NONE) is LastRun.NONE
    for ended in LastRun:
        run(path, ended)
        mark = RunMark(path)
        mark.end(mark.last_run)  # race control could not start, and leaves it as it was
        assert run(path) is ended
        assert run(path) is LastRun.UNKNOWN
        assert run(path) is LastRun.UNKNOWN


def test_of_two_race_controls_at_one_port_the_second_is_refused_and_changes_nothing(
    path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_mark, 'CLAIM_TIMEOUT', 0.1)
    first = RunMark(path)
    with pytest.raises(InUseError, match='choose another port'):
        RunMark(path)
    leave_began(path)  # it says so already
    monkeypatch.setattr(run_mark, 'CLAIM_TIMEOUT', 20.0)
    threading.Timer(0.1, first.end, (LastRun.ENDED,)).start()
    assert run(path) is LastRun.ENDED  # it has waited for the end of the first


# ----- what proves nothing -----------------------------------------------------------------


def a_link(path: pathlib.Path) -> None:
    path.rename(path.with_name('elsewhere'))
    path.symlink_to('elsewhere')


def a_folder_that_is_a_link(path: pathlib.Path) -> None:
    path.parent.rename(path.parent.with_name('elsewhere'))
    path.parent.symlink_to('elsewhere')


def a_file_for_a_folder(path: pathlib.Path) -> None:
    shutil.rmtree(path.parent)
    path.parent.write_text('ended')


@pytest.mark.parametrize('said', [b'end', b'', bytes(32), b'\xff' * 10_000, b'ended ended\n'])
def test_a_mark_that_is_damaged_proves_nothing_and_is_written_anew(
    path: pathlib.Path, said: bytes
) -> None:
    run(path, LastRun.ENDED)
    path.write_bytes(said)
    mark = RunMark(path)
    assert (mark.last_run, mark.error) == (LastRun.UNKNOWN, '')
    assert mark.why
    mark.end(LastRun.ENDED)
    assert run(path) is LastRun.ENDED


@pytest.mark.parametrize(
    'put',
    [
        in_place_of(os.mkfifo),
        in_place_of(pathlib.Path.mkdir),
        a_link,
        lambda path: path.with_name('elsewhere').hardlink_to(path),
        a_folder_that_is_a_link,
        a_file_for_a_folder,
    ],
    ids=['a pipe', 'a folder', 'a link', 'a second name', 'a folder of links', 'no folder'],
)
def test_what_is_in_the_place_of_a_mark_proves_nothing_and_is_left_alone(
    path: pathlib.Path, put: Harm
) -> None:
    run(path, LastRun.ENDED)
    put(path)
    mark = RunMark(path)
    assert mark.last_run is LastRun.UNKNOWN
    assert str(path) in mark.error
    assert mark.why == mark.error
    with pytest.raises(OSError, match='cannot be used'):
        leave_began(path)
    mark.end(LastRun.ENDED)
    elsewhere = [each for each in path.parent.parent.rglob('elsewhere') if each.is_file()]
    assert all(each.read_text().strip() == 'ended' for each in elsewhere)
    assert run(path, LastRun.UNKNOWN) is LastRun.UNKNOWN


@pytest.fixture
def disk(path: pathlib.Path) -> Iterator[pathlib.Path]:
    """Return the folder of the marks, on a disk of its own."""
    with small_disk(path.parent, '64k') as folder:
        yield folder


@pytest.mark.parametrize('said', ['read-only file system', 'no space left'])
def test_a_mark_that_cannot_be_written_proves_nothing_until_it_can(
    path: pathlib.Path, disk: pathlib.Path, said: str
) -> None:
    mend: Callable[[], object]
    if said == 'no space left':
        mend = filled(disk).unlink
    else:
        run(path, LastRun.ENDED)
        remount(disk, 'ro')
        mend = functools.partial(remount, disk, 'rw')
    mark = RunMark(path)
    assert mark.last_run is LastRun.UNKNOWN
    assert said in mark.error
    mark.keep()
    assert mark.error
    mend()
    mark.keep()
    assert (mark.error, path.read_text().strip()) == ('', RUN_BEGAN)
    mark.end(LastRun.ENDED)
    assert run(path) is LastRun.ENDED


@contextlib.contextmanager
def bound(folder: pathlib.Path, to: pathlib.Path) -> Iterator[None]:
    """Have a folder in the place of another one, too."""
    subprocess.run(['mount', '--bind', str(folder), str(to)], check=True)
    try:
        yield
    finally:
        subprocess.run(['umount', '-l', str(to)], check=True)


@pytest.mark.parametrize('kind', ['tmpfs', 'ramfs', 'PrivateTmp'])
def test_a_place_in_memory_or_of_one_service_is_none_for_a_mark_even_over_one_that_is_on_a_disk(
    kind: str, path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, above = path.parent, path.parent.parent
    monkeypatch.setattr(run_mark, 'FOLDER', folder)
    run(path, LastRun.ENDED)
    with small_disk(folder, '64k'):  # or the test is skipped
        pass
    private = above / 'systemd-private-1f-evgp-rcs.service'
    private.mkdir()
    is_private = kind == 'PrivateTmp'
    other = bound(private, above) if is_private else small_disk(above, '64k', kind)
    with bound(folder, folder), other:
        mark = RunMark(path)
    assert mark.last_run is LastRun.UNKNOWN
    said = 'is private to this service: set PrivateTmp=no' if is_private else 'is in memory'
    assert f'{above} {said}' in mark.error


@pytest.mark.parametrize('what', ['the mark', 'the folder', 'another mark', 'a folder'])
def test_a_mark_that_is_taken_away_during_a_run_is_there_again(
    path: pathlib.Path, what: str
) -> None:
    mark = RunMark(path)
    if what == 'the folder':
        shutil.rmtree(path.parent)
    else:
        path.unlink()
    if what == 'another mark':
        path.write_text('ended')
    if what == 'a folder':
        path.mkdir()
        mark.keep()
        assert str(path) in mark.error
        path.rmdir()
    mark.keep()
    assert mark.error == ''
    assert path.read_text().strip() == RUN_BEGAN
    mark.end(LastRun.UNKNOWN)
    assert run(path) is LastRun.UNKNOWN


# ----- users of the machine ----------------------------------------------------------------


def as_user(user: int, path: pathlib.Path, ends_as: LastRun) -> str:
    """Have a run of another user begin and end, and return what it knew of the last one."""
    read, write = os.pipe()
    child = os.fork()
    if not child:
        os.setgroups([])
        os.setgid(user)
        os.setuid(user)
        os.umask(0o077)
        mark = RunMark(path)
        mark.end(ends_as)
        os.write(write, mark.last_run.name.encode())
        os._exit(0)
    os.close(write)
    with open(read, encoding='ascii') as said:  # noqa: PTH123 - a pipe
        knew = said.read()
    os.waitpid(child, 0)
    return knew


@pytest.fixture
def shared() -> Iterator[pathlib.Path]:
    """Return a folder that all users share, as /var/tmp is."""
    with tempfile.TemporaryDirectory() as folder:
        shared = pathlib.Path(folder)
        shared.chmod(0o1777)
        yield shared


@pytest.mark.skipif(os.geteuid() != 0, reason='it takes root to be another user')
def test_every_user_of_the_machine_has_the_same_mark(shared: pathlib.Path) -> None:
    path = shared / 'marks' / '12017'
    assert as_user(1001, path, LastRun.ENDED) == 'NONE'
    assert as_user(1002, path.with_name('12018'), LastRun.ENDED) == 'NONE'
    assert as_user(1002, path, LastRun.UNKNOWN) == 'ENDED'
    assert run(path, LastRun.ENDED) is LastRun.UNKNOWN
    assert as_user(1001, path, LastRun.UNKNOWN) == 'ENDED'
    # Somebody has taken it from the others.
    path.write_text('ended')
    path.chmod(0o600)
    assert as_user(1002, path, LastRun.ENDED) == 'UNKNOWN'
    # Only its own user makes it everybody's again.
    assert as_user(1001, path, LastRun.ENDED) == 'ENDED'
    assert as_user(1002, path, LastRun.ENDED) == 'ENDED'


@pytest.mark.skipif(not shutil.which('systemd-tmpfiles'), reason='there is no systemd here')
def test_systemd_does_not_delete_a_mark_that_is_old(
    path: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    run(path, LastRun.ENDED)
    other = path.with_name('other')
    other.write_text('old too')
    rules = tmp_path / 'rules.conf'
    rules.write_text(f'd {path.parent} 0777 - - bamcABMC:0\n')
    subprocess.run(['systemd-tmpfiles', '--clean', str(rules)], check=False)
    assert path.exists()
    assert not other.exists()


# ----- where it is -------------------------------------------------------------------------


def test_there_is_one_place_for_each_port_and_loopback_addresses_have_their_own() -> None:
    assert place('0.0.0.0', 12017) == place('10.0.0.1', 12017) == FOLDER / '12017'
    assert place('10.0.0.1', 12018) == FOLDER / '12018'
    assert place('127.0.0.1', 12017) not in (FOLDER / '12017', place('127.0.0.2', 12017))
