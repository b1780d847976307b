# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The record on a real disk: what is written, what is found again, what a bad disk costs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import dataclasses
import math
import os
import pathlib
import sqlite3
import time
from typing import Any, Literal

from evgp_node import stream_file
from evgp_node.stream_file import blocks_of, open_for_reading
from evgp_protocol.states import RaceState
from evgp_rcs.rcs_record import main as print_timeline
from evgp_rcs.record.runs import PARTLY
import evgp_rcs.record.store
from evgp_rcs.record.store import left_behind, Record
from evgp_rcs.rules.inputs import Batch, entries_of, Entry, Rules, Setup, Tick
from evgp_rcs.rules.race import (
    Doubt,
    Event,
    EventKind,
    KartMemory,
    RaceMemory,
    RaceTimes,
    StampedEvent,
)
import pytest
from rig.disks import garble_schema, Harm, in_database, remount, small_disk
from rig.replaying import events_of

HOME = RaceMemory(RaceState.IN_GARAGE, {7: KartMemory(True, False, 0, Doubt.NONE, False)})
RACING = RaceMemory(RaceState.GREEN_GREEN, {7: KartMemory(True, False, 0, Doubt.MOVING, False)})
OPEN = dataclasses.replace(HOME, track_open=True)


Begin = Callable[[], Record]


@pytest.fixture
def path(tmp_path: pathlib.Path) -> pathlib.Path:
    return tmp_path / 'folder' / 'record.sqlite3'


@pytest.fixture
def begin(path: pathlib.Path) -> Iterator[Begin]:
    """Return a function that begins a run; it ends with the test."""
    with contextlib.ExitStack() as stack:

        def start() -> Record:
            record = Record(path)
            stack.callback(record._release)
            return record

        yield start


def event(sequence: int, text: str = 'something', **more: object) -> StampedEvent:
    kind = EventKind.CONNECTED
    return StampedEvent(sequence, time.time_ns(), sequence / 10, Event(kind, text, **more))


def ending(success: bool) -> StampedEvent:
    """Return the last event of a run, which says how it ended."""
    return StampedEvent(1, time.time_ns(), 0.1, Event(EventKind.ENDED, 'ends', success=success))


def put(record: Record, *entries: Entry, first: int = 0) -> None:
    record.put(Batch(first, entries))


def have_written(record: Record, memory: RaceMemory) -> None:
    """Have this on the disk for the next run."""
    record.remember(memory)
    assert record.write()


def texts(path: pathlib.Path, run: int) -> list[str]:
    return [each.event.text for each in events_of(path, run)]


def test_a_run_finds_what_was_saved_last_even_if_a_start_was_cut_off_since(begin: Begin) -> None:
    first = begin()
    assert first.left_behind is None
    first.remember(RACING)
    first.end()
    begin().end()  # it was cut off before it saved anything
    second = begin()
    assert second.left_behind == RACING
    second.remember(RACING)
    second.remember(OPEN)  # both before it comes to write
    second.end()
    assert begin().left_behind == OPEN


# ----- a record that was harmed ------------------------------------------------------------


@pytest.mark.parametrize(
    'harm',
    [
        lambda path: os.truncate(path, 1000),
        in_database("UPDATE memory SET data = '[1, 2'"),
        garble_schema,
        pathlib.Path.unlink,
    ],
)
def test_a_record_that_was_harmed_knows_nothing(
    begin: Begin, path: pathlib.Path, harm: Harm
) -> None:
    record = begin()
    record.remember(HOME)
    record.end()
    harm(path)
    assert begin().left_behind is None


def test_a_crash_is_known_although_all_that_lay_beside_the_record_was_deleted(
    begin: Begin, path: pathlib.Path
) -> None:
    begin().end()  # an earlier run, that ended in order
    record = begin()
    have_written(record, HOME)
    have_written(record, RACING)
    found = path.read_bytes()  # by a machine that lost its power, once somebody deleted the -wal
    record.end()
    for left in path.parent.iterdir():
        left.unlink()
    path.write_bytes(found)
    assert begin().left_behind == RACING


def test_no_start_waits_for_who_reads_the_record_as_a_spare_does(
    begin: Begin, path: pathlib.Path
) -> None:
    record = begin()
    have_written(record, HOME)
    with contextlib.closing(open_for_reading(path)) as database:
        database.execute('BEGIN')
        assert [*blocks_of(database, 1)]
        have_written(record, RACING)
        assert record.error == ''
    assert left_behind(path) == RACING


# ----- a bad disk --------------------------------------------------------------------------


def test_a_record_on_a_disk_that_is_read_only_is_read_by_the_next_run_and_by_officials(
    tmp_path: pathlib.Path,
) -> None:
    with small_disk(tmp_path / 'disk', '512k') as disk:
        path = disk / 'record.sqlite3'
        record = Record(path)
        put(record, event(1))
        record.remember(RACING)
        record.end()
        remount(disk, 'ro')
        assert left_behind(path) == RACING
        assert texts(path, 1) == ['something']


class Doubtful(sqlite3.Connection):
    """A disk that takes every transaction, and says each time that it has not."""

    def __exit__(self, *error: Any) -> Literal[False]:
        super().__exit__(*error)
        raise sqlite3.OperationalError('disk I/O error')


def test_what_a_disk_took_although_it_said_no_is_no_failure_for_ever(
    begin: Begin, path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as failing:
        failing.setattr(stream_file, '_Database', Doubtful)
        record = begin()
        put(record, event(1, 'first'))
        assert not record.write()
        assert record.error == 'disk I/O error'
    put(record, event(2, 'second'), first=1)
    assert record.write(), record.error
    assert texts(path, 1) == ['first', 'second']


# ----- the timeline ------------------------------------------------------------------------


def test_the_list_has_every_run_and_how_it_ended_and_the_last_is_told_in_order(
    begin: Begin, path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for success in (False, True):
        record = begin()
        put(record, ending(success))
        record.end()
    record = begin()
    put(record, event(1, 'first', kart=7), event(2, 'refused', kart=8, success=False))
    put(record, event(4, 'behind'), first=3)
    assert record.write()
    assert print_timeline([str(path), '--list']) == 0
    crashed, ended, running = capsys.readouterr().out.splitlines()
    assert 'did not end normally' in crashed
    assert 'not end' not in ended
    assert 'still running' in running
    put(record, event(5, 'last'), first=4)
    record.end()
    assert print_timeline([str(path)]) == PARTLY
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.split()[0] == '3'
    assert 'did not end normally' in head
    assert [line.split()[-1] for line in lines] == ['first', 'refused', '...', 'behind', 'last']
    assert ' ! refused' in lines[1]
    assert '1 entry is missing' in lines[2]
    assert print_timeline([str(path), '--kart', '7', '--run', '3']) == PARTLY
    _, *lines = capsys.readouterr().out.splitlines()
    assert [line.split()[-1] for line in lines] == ['first', '...', 'behind', 'last']
    assert print_timeline([str(path), '--run', '7']) == 2
    assert f'{path} has no run 7; it has 1, 2, 3' in capsys.readouterr().err
    begin().end()  # looking whether a run is in progress keeps no race control from starting


# ----- when it is written ------------------------------------------------------------------


def test_entries_without_events_wait_for_others_but_not_for_long_and_the_rest_for_nothing(
    begin: Begin, path: pathlib.Path
) -> None:
    record = begin()
    assert record.due_in() == math.inf
    put(record, Tick(1.0))
    put(record, Tick(2.0), first=1)
    assert 0 < record.due_in() <= evgp_rcs.record.store.INPUTS_EVERY
    assert record.write()
    assert record.due_in() == math.inf
    with contextlib.closing(open_for_reading(path)) as database:
        _, *found = entries_of(blocks_of(database, 1))
    assert found == [Tick(1.0), Tick(2.0)]
    for urgent in (event(1), Rules('rules', Setup((), RaceTimes(), (), 0.0)), HOME):
        if isinstance(urgent, RaceMemory):
            record.remember(urgent)
        else:
            put(record, urgent, first=2)
        assert record.due_in() == 0.0
        assert record.write()
    put(record, Tick(3.0), first=3)
    record.end()  # which waits for no event, either
    with contextlib.closing(open_for_reading(path)) as database:
        assert [*entries_of(blocks_of(database, 1))][-1] == Tick(3.0)
