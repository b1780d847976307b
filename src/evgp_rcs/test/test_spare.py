# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A spare's copy is whole, and proves nothing; an address is taken only if nobody answers."""

from __future__ import annotations

import contextlib
import io
import itertools
import os
import pathlib
import sqlite3
import tarfile
import threading
import time
from typing import Any

from evgp_node.stream_file import BOOK
from evgp_protocol.states import RaceState
from evgp_rcs.record import run_mark
from evgp_rcs.record.run_mark import RunMark
from evgp_rcs.record.store import Record
from evgp_rcs.rules.inputs import Batch
from evgp_rcs.rules.race import Event, EventKind, LastRun, RaceMemory, StampedEvent
from evgp_rcs.spare import copies as spare
from evgp_rcs.spare import takeover
from evgp_rcs.spare.copies import fetch, keep, latest, NAMES, ORIGIN, RECORD, SpareError
import pytest
from rig.replaying import events_of

KARTS = 'karts:\n- {number: 7, team: A, address: 10.0.0.107, in_race: true}\n'


@pytest.fixture
def first(tmp_path: pathlib.Path) -> pathlib.Path:
    """Return the folder of race control's machine, with a name that is not simple in a URI."""
    folder = tmp_path / 'EVGP #1 %20?'
    folder.mkdir()
    (folder / 'karts.yaml').write_text(KARTS)
    (folder / 'rcs.yaml').write_text('/**:\n  ros__parameters:\n    pause: 1.0\n')
    return folder


@pytest.fixture(autouse=True)
def marks(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> pathlib.Path:
    """Return where the marks of this machine are: a real race may be prepared here."""
    folder = tmp_path / 'marks'
    monkeypatch.setattr(run_mark, 'FOLDER', folder)
    return folder


def copy(first: pathlib.Path, folder: pathlib.Path) -> float:
    """Copy as the program does, and return how old the newest event was (s)."""
    return keep(packed(first), str(first), folder)


def packed(first: pathlib.Path, source: str = '') -> bytes:
    return fetch(source or str(first), 'karts.yaml', 'rcs.yaml', str(first / 'record.sqlite3'))


def tarred(first: pathlib.Path) -> bytes:
    """Return what is fetched while nobody writes, without the program that fetches it."""
    with io.BytesIO() as packed:
        with tarfile.open(fileobj=packed, mode='w') as tar:
            for name in NAMES:
                tar.add(first / name, name)
        return packed.getvalue()


def record(first: pathlib.Path) -> None:
    """Have race control record an event."""
    written = Record(first / 'record.sqlite3')
    written.put(Batch(0, [happened(1)]))
    written.end()


def happened(sequence: int) -> StampedEvent:
    return StampedEvent(sequence, time.time_ns(), 0.0, Event(EventKind.CONNECTED, 'x' * 500))


def test_each_copy_of_a_record_that_is_being_written_is_one_moment_of_it(
    first: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    folder = tmp_path / 'spare'
    begun, ended = threading.Event(), threading.Event()

    def race() -> None:
        written, numbers = Record(first / 'record.sqlite3'), itertools.count(1)
        while not ended.is_set():
            new = [happened(next(numbers)) for _ in range(10)]
            written.put(Batch(new[0].sequence - 1, new))
            # Some go into the file itself: its two files change at once.
            written.remember(RaceMemory(RaceState.IN_GARAGE, {}))
            assert written.write(), written.error
            begun.set()
        written.end()

    writer = threading.Thread(target=race)
    writer.start()
    assert begun.wait(30)
    counts = []
    try:
        for _ in range(5):
            assert copy(first, folder) < 30
            with sqlite3.connect(folder / RECORD) as database:
                assert database.execute('PRAGMA integrity_check').fetchone() == ('ok',)
            database.close()
            told = [each.sequence for each in events_of(folder / RECORD)]
            counts.append((len(told), told[-1]))
    finally:
        ended.set()
        writer.join()
    assert all(count == last and count % 10 == 0 for count, last in counts)
    assert counts[-1] > counts[0]


@pytest.mark.parametrize('cut', [0, 1, 600, 5000, -20000])
def test_what_came_in_part_does_not_take_the_place_of_the_last_copy(
    cut: int, first: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    record(first)
    folder = tmp_path / 'spare'
    keep(tarred(first), '', folder)
    before = [(folder / name).read_bytes() for name in NAMES]
    (first / 'karts.yaml').write_text(KARTS.replace('A', 'B'))
    whole = tarred(first)

    with pytest.raises(SpareError):
        keep(whole[:cut], '', folder)

    assert [(folder / name).read_bytes() for name in NAMES] == before


@pytest.mark.parametrize('missing', NAMES)
def test_a_first_machine_without_all_of_it_is_told_in_one_line_and_by_the_exit_code(
    missing: str, first: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record(first)
    (first / missing).unlink()
    words = ['--roster', 'karts.yaml', '--params', 'rcs.yaml', '--once', '--record']
    assert spare.main([str(first), *words, str(first / 'record.sqlite3')]) == 1
    (line,) = capsys.readouterr().out.splitlines()
    assert missing in line


def test_the_book_of_laps_is_copied_too_if_there_is_one(
    first: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    record(first)
    folder = tmp_path / 'spare'
    copy(first, folder)
    assert not (folder / BOOK).exists()
    with contextlib.closing(sqlite3.connect(first / BOOK)) as book:
        book.executescript('PRAGMA journal_mode = WAL; CREATE TABLE block (run)')
        copy(first, folder)
    with contextlib.closing(sqlite3.connect(folder / BOOK)) as copied:
        assert copied.execute('SELECT name FROM sqlite_master').fetchall() == [('block',)]
    for each in first.glob(f'{BOOK}*'):
        each.unlink()
    copy(first, folder)
    assert not [*folder.glob(f'{BOOK}*')]


def test_another_machine_is_asked_by_ssh_and_never_for_a_password(
    first: pathlib.Path, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the place of ssh: what it is told, and the same command on this machine."""
    programs = tmp_path / 'programs'
    programs.mkdir()
    ssh = programs / 'ssh'
    ssh.write_text(
        f'#!/bin/sh\necho "$@" > {programs}/told\nfor last; do :; done\nexec sh -c "$last"\n'
    )
    ssh.chmod(0o755)
    monkeypatch.setenv('PATH', f'{programs}:{os.environ["PATH"]}')
    monkeypatch.chdir(tmp_path)
    record(first)
    source = f'anna@10.1.0.5:{first.name}'

    keep(packed(first, source), source, tmp_path)

    told = (programs / 'told').read_text()
    assert 'BatchMode=yes' in told
    assert ' anna@10.1.0.5 ' in told
    assert (tmp_path / ORIGIN).read_text() == '10.1.0.5'


@pytest.mark.parametrize('wrong', ['', '-oProxyCommand=x@10.1.0.5', 'anna@laptop'])
def test_a_source_is_an_address_or_a_folder(wrong: str) -> None:
    with pytest.raises(SystemExit):
        spare.main([wrong, '--roster', 'karts.yaml', '--params', 'rcs.yaml', '--once'])


@pytest.mark.parametrize(
    ('parameters', 'name'),
    [
        ('', '12017'),
        ('{}', '12017'),
        ('/**: {ros__parameters: {pause: 1.0}}', '12017'),
        ('/**: {ros__parameters: {port: 4001}}', '4001'),
        ('/**: {ros__parameters: {pause: 1.0}}\n/board: {ros__parameters: {port: 1}}', '12017'),
        ('/rcs: {ros__parameters: {address: 10.0.0.1, port: 4001}}', '4001'),
        ('rcs: {ros__parameters: {address: 127.0.0.1}}', '127.0.0.1:12017'),
    ],
)
def test_with_a_copy_the_mark_of_this_machine_says_began_and_another_port_is_left_alone(
    parameters: str, name: str, first: pathlib.Path, tmp_path: pathlib.Path, marks: pathlib.Path
) -> None:
    """So no start here proves anything: race control may have raced on after the copy."""
    record(first)
    (first / 'rcs.yaml').write_text(parameters)
    for each in (name, '4002'):
        RunMark(marks / each).end(LastRun.ENDED)
    keep(tarred(first), '', tmp_path / 'spare')
    assert RunMark(marks / name).last_run is LastRun.UNKNOWN
    assert RunMark(marks / '4002').last_run is LastRun.ENDED


@pytest.mark.parametrize(
    'wrong', ['a: [', '/**: {ros__parameters: {port: many}}', '/**: &all {rcs: *all}']
)
def test_without_a_mark_there_is_no_copy(
    wrong: str, first: pathlib.Path, tmp_path: pathlib.Path, marks: pathlib.Path
) -> None:
    record(first)
    with pytest.raises(SpareError):
        (first / 'rcs.yaml').write_text(wrong)
        keep(tarred(first), '', tmp_path / 'spare')
    (first / 'rcs.yaml').write_text('{}')
    (marks / '12017').mkdir(parents=True)
    with pytest.raises(SpareError, match='12017'):
        keep(tarred(first), '', tmp_path / 'spare')
    assert not (tmp_path / 'spare' / RECORD).exists()


def test_the_newest_copy_is_taken_and_after_a_takeover_what_that_has_made_of_it(
    first: pathlib.Path, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('ROS_HOME', str(tmp_path))
    with pytest.raises(SpareError):
        latest()
    record(first)
    keep(tarred(first), '', spare.copies())
    assert latest() == spare.copies()
    taken = spare.copies().rename(spare.copies().with_name('takeover-1'))
    assert latest() == taken
    keep(tarred(first), '', spare.copies())
    assert latest() == spare.copies()
    os.utime(taken / RECORD)
    assert latest() == taken


def test_once_a_takeover_has_used_the_copy_the_old_machine_is_copied_no_more(
    first: pathlib.Path, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may be switched on again for its record, which is older than the one made here since."""
    monkeypatch.setenv('ROS_HOME', str(tmp_path))
    record(first)
    taken = spare.copies().with_name('takeover-1')

    def keep_and_take(*given: Any) -> float:
        age = keep(*given)
        spare.copies().rename(taken)
        return age

    monkeypatch.setattr(spare, 'keep', keep_and_take)
    monkeypatch.setattr(spare, 'COPY_EVERY', 0.0)
    words = ['--roster', 'karts.yaml', '--params', 'rcs.yaml', '--record']
    assert spare.main([str(first), *words, str(first / 'record.sqlite3')]) == 0
    assert latest() == taken


@pytest.mark.parametrize(
    ('address', 'interface', 'said'),
    [
        ('', 'lo', "'' is not an IPv4 address"),
        ('10.0.0.1', '', 'choose from'),
        ('10.0.0.1', 'e9', 'choose from'),
    ],
)
def test_a_takeover_names_a_wrong_address_and_the_interfaces_that_there_are(
    address: str, interface: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        takeover.main([address, interface])
    assert said in capsys.readouterr().err
