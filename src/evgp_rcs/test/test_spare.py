# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""A spare's copy is whole, and proves nothing; an address is taken only if nobody answers."""

from __future__ import annotations

import itertools
import os
import pathlib
import sqlite3
import threading
import time

from evgp_protocol.states import RaceState
from evgp_rcs import spare
from evgp_rcs.neighbours import Found, Look, why_not
from evgp_rcs.orderly_end import OrderlyEnd
from evgp_rcs.race import Doubt, Event, EventKind, KartMemory, RaceMemory, StampedEvent
from evgp_rcs.record import distrust, Record
from evgp_rcs.spare import fetch, keep, latest, NAMES, ORIGIN, RECORD, SpareError
from hypothesis import given, HealthCheck, settings, strategies
import pytest

KARTS = 'karts:\n- {number: 7, team: A, address: 10.0.0.107, in_race: true}\n'


@pytest.fixture
def first(tmp_path: pathlib.Path) -> pathlib.Path:
    """Return the folder of race control's machine."""
    folder = tmp_path / 'first'
    folder.mkdir()
    (folder / 'karts.yaml').write_text(KARTS)
    (folder / 'rcs.yaml').write_text('/**:\n  ros__parameters:\n    pause: 1.0\n')
    return folder


def copy(first: pathlib.Path, folder: pathlib.Path) -> float:
    """Copy as the program does, and return how old the newest event was (s)."""
    return keep(packed(first), str(first), folder)


def packed(first: pathlib.Path, source: str = '') -> bytes:
    record = str(first / 'record.sqlite3')
    return fetch(source or str(first), 'karts.yaml', 'rcs.yaml', record)


def happened(sequence: int) -> StampedEvent:
    return StampedEvent(sequence, time.time_ns(), 0.0, Event(EventKind.CONNECTED, 'x' * 500))


def test_each_copy_of_a_record_that_is_being_written_is_one_moment_of_it(
    first: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    folder = tmp_path / 'spare'
    begun, ended = threading.Event(), threading.Event()

    def race() -> None:
        record, numbers = Record(first / 'record.sqlite3'), itertools.count(1)
        while not ended.is_set():
            record.put([happened(next(numbers)) for _ in range(10)])
            # Some go into the file itself: its two files change at once.
            record.remember(RaceMemory(RaceState.IN_GARAGE, {}), time.monotonic(), surely=True)
            assert record.write(), record.error
            begun.set()
        record.end()

    writer = threading.Thread(target=race)
    writer.start()
    assert begun.wait(30)
    counts = []
    try:
        for _ in range(5):
            assert copy(first, folder) < 30
            with sqlite3.connect(folder / RECORD) as database:
                assert database.execute('PRAGMA integrity_check').fetchone() == ('ok',)
                counts += database.execute('SELECT count(*), max(sequence) FROM event')
            database.close()
    finally:
        ended.set()
        writer.join()
    assert all(count == last and count % 10 == 0 for count, last in counts)
    assert counts[-1] > counts[0]


@pytest.mark.parametrize('cut', [0, 1, 600, 5000, -20000])
def test_what_came_in_part_does_not_take_the_place_of_the_last_copy(
    cut: int, first: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    record, folder = Record(first / 'record.sqlite3'), tmp_path / 'spare'
    record.put([happened(1)])
    record.end()
    copy(first, folder)
    before = [(folder / name).read_bytes() for name in NAMES]
    (first / 'karts.yaml').write_text(KARTS.replace('A', 'B'))
    whole = packed(first)

    with pytest.raises(SpareError):
        keep(whole[:cut], '', folder)

    assert [(folder / name).read_bytes() for name in NAMES] == before


@pytest.mark.parametrize('missing', ['karts.yaml', 'rcs.yaml', 'record.sqlite3'])
def test_a_first_machine_without_all_of_it_is_told(
    missing: str, first: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    Record(first / 'record.sqlite3').end()
    (first / missing).unlink()
    with pytest.raises(SpareError):
        copy(first, tmp_path / 'spare')


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
    record = Record(first / 'record.sqlite3')
    record.put([happened(1)])
    record.end()
    source = 'anna@10.1.0.5:first'

    keep(packed(first, source), source, tmp_path)

    told = (programs / 'told').read_text()
    assert 'BatchMode=yes' in told
    assert ' anna@10.1.0.5 ' in told
    assert (tmp_path / ORIGIN).read_text() == '10.1.0.5'


@pytest.mark.parametrize('wrong', ['', '-oProxyCommand=x@10.1.0.5', 'anna@laptop'])
def test_a_source_is_an_address_or_a_folder(wrong: str) -> None:
    with pytest.raises(SystemExit):
        spare.main([wrong, '--roster', 'karts.yaml', '--params', 'rcs.yaml', '--once'])


MEMORIES = strategies.builds(
    RaceMemory,
    strategies.sampled_from(RaceState),
    strategies.dictionaries(
        strategies.integers(1, 3),
        strategies.builds(
            KartMemory,
            strategies.booleans(),
            strategies.booleans(),
            strategies.integers(0, 3),
            strategies.sampled_from(Doubt),
            strategies.booleans(),
        ),
    ),
    strategies.booleans(),
    strategies.booleans(),
)


@settings(
    max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(memory=MEMORIES, taken_before=strategies.booleans(), proof_too=strategies.booleans())
def test_a_copy_proves_no_orderly_end_and_no_msr_and_forgets_no_hold(
    memory: RaceMemory,
    taken_before: bool,
    proof_too: bool,
    first: pathlib.Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    path, folder = first / 'record.sqlite3', tmp_path_factory.mktemp('spare')
    run = Record(path)
    run.put([happened(1)])
    run.remember(memory, 0.0)
    run.end()
    if taken_before:  # an earlier copy, on which race control ran here and ended in good order
        copy(first, folder)
        earlier = Record(folder / RECORD)
        earlier.remember(memory, 0.0)
        earlier.end()
    copy(first, folder)
    if proof_too:  # somebody copies all that is there, by hand
        OrderlyEnd(folder / RECORD).write(OrderlyEnd(path).take())

    distrust(folder / RECORD)

    found = Record(folder / RECORD)
    found.end(in_order=False)
    left = found.left_behind
    assert left is not None
    assert not left.final
    assert not left.msr_used
    assert (left.state, left.karts, left.track_open) == (
        memory.state,
        memory.karts,
        memory.track_open,
    )


def test_the_newest_copy_is_taken_and_after_a_takeover_what_that_has_made_of_it(
    first: pathlib.Path, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('ROS_HOME', str(tmp_path))
    with pytest.raises(SpareError):
        latest()
    record = Record(first / 'record.sqlite3')
    record.put([happened(1)])
    record.end()
    copy(first, spare.copies())
    assert latest() == spare.copies()
    taken = spare.copies().rename(spare.copies().with_name('takeover-1'))
    assert latest() == taken
    copy(first, spare.copies())
    assert latest() == spare.copies()
    os.utime(taken / RECORD)
    assert latest() == taken


def test_only_when_nothing_answers_and_everything_is_known_is_an_address_taken() -> None:
    assert why_not([]) != ''
    for found in itertools.product(Found, repeat=4):
        looks = [Look(each, f'{each.name} {at}' if each else '') for at, each in enumerate(found)]
        reason = why_not(looks)
        assert (reason == '') == ({*found} == {Found.NOTHING})
        assert not reason or reason.startswith(max(found).name)


def test_a_copy_that_fails_is_told_in_one_line_and_by_the_exit_code(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ['--roster', 'karts.yaml', '--params', 'rcs.yaml', '--record', 'none', '--once']
    assert spare.main([str(tmp_path), *words]) == 1
    assert len(capsys.readouterr().out.splitlines()) == 1
