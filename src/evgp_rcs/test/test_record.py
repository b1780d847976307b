"""The record on a real disk: what is written, what is found again, what a bad disk costs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import os
import pathlib
import sqlite3
import subprocess
import threading
import time

from evgp_protocol.states import RaceState
from evgp_rcs.race import (
    Command,
    CommandKind,
    Event,
    EventKind,
    Kart,
    KartMemory,
    Race,
    RaceMemory,
    StampedEvent,
)
from evgp_rcs.record import events, open_read_only, Record, RecordError, sessions
from evgp_rcs.timeline import main as print_timeline
import pytest

PATIENCE = 20.0
HOME = RaceMemory(RaceState.IN_GARAGE, {7: KartMemory(True, False, 0, False)})
RACING = RaceMemory(RaceState.GREEN_GREEN, {7: KartMemory(True, False, 0, True)})

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
            stack.callback(record.end, PATIENCE)
            return record

        yield start


def event(sequence: int, text: str = 'something', **more: object) -> StampedEvent:
    kind = EventKind.CONNECTED
    return StampedEvent(sequence, time.time_ns(), sequence / 10, Event(kind, text, **more))


def crash(record: Record) -> None:
    """Leave the file as a killed process does: written, but not ended."""
    assert record.flush(PATIENCE)
    record.end(PATIENCE, in_order=False)


def texts(path: pathlib.Path, run: int) -> list[str]:
    with contextlib.closing(open_read_only(path)) as database:
        return [each.text for each in events(database, run)]


def test_every_event_is_there_once_and_in_order(begin: Begin, path: pathlib.Path) -> None:
    record = begin()
    for first in range(1, 1000, 10):
        record.put([event(first + n, f'event {first + n}') for n in range(10)])
    assert record.flush(PATIENCE)
    assert texts(path, 1) == [f'event {n}' for n in range(1, 1001)]


def test_all_of_an_event_is_written(begin: Begin, path: pathlib.Path) -> None:
    race = Race([Kart(7, 'Purdue', True)])
    (told,) = race.command(Command(CommandKind.KART_RED_RED, 7), 1.0).events
    begin_ns = time.time_ns()
    record = begin()
    record.put([StampedEvent(1, begin_ns, 1.5, told)])
    assert record.flush(PATIENCE)
    with contextlib.closing(open_read_only(path)) as database:
        (found,) = events(database, 1)
    assert (found.sequence, found.wall_ns, found.monotonic) == (1, begin_ns, 1.5)
    assert (found.kind, found.kart, found.command) == ('COMMAND', 7, 'KART_RED_RED')
    assert (found.success, found.text) == (True, told.text)


def test_a_run_that_ended_at_home_leaves_nothing_behind(begin: Begin) -> None:
    record = begin()
    record.remember(HOME, 0.0)
    record.end(PATIENCE)
    assert begin().left_behind is None


def test_a_run_that_crashed_at_home_leaves_its_race(begin: Begin) -> None:
    record = begin()
    record.remember(HOME, 0.0)
    crash(record)
    assert begin().left_behind == HOME


@pytest.mark.parametrize('in_order', [True, False], ids=['ended', 'crashed'])
def test_a_run_that_was_not_at_home_leaves_its_race(begin: Begin, in_order: bool) -> None:
    record = begin()
    record.remember(HOME, 0.0)
    record.remember(RACING, 0.0)
    assert record.flush(PATIENCE)
    record.end(PATIENCE, in_order)
    assert begin().left_behind == RACING


def test_an_older_race_does_not_take_the_place_of_a_newer_one(begin: Begin) -> None:
    record = begin()
    record.remember(RACING, 2.0)
    record.remember(HOME, 1.0)
    assert record.flush(PATIENCE)
    crash(record)
    assert begin().left_behind == RACING


def test_a_run_that_crashed_before_it_remembered_anything_is_doubt(begin: Begin) -> None:
    crash(begin())
    left_behind = begin().left_behind
    assert left_behind is not None
    assert not left_behind.karts


def test_a_run_finds_what_the_last_one_left_and_not_an_older_one(begin: Begin) -> None:
    first = begin()
    first.remember(RACING, 0.0)
    crash(first)
    second = begin()
    second.remember(HOME, 0.0)
    second.end(PATIENCE)
    assert begin().left_behind is None


def test_two_race_controls_cannot_have_one_record(begin: Begin, path: pathlib.Path) -> None:
    begin()
    with pytest.raises(RecordError, match='choose another file with the parameter record'):
        Record(path)


def test_a_file_that_is_no_record_is_refused_and_left_alone(
    begin: Begin, path: pathlib.Path
) -> None:
    path.parent.mkdir()
    path.write_text(
        'karts: [] # the wrong file, and longer than a header of SQLite has bytes\n' * 3
    )
    before = path.read_bytes()
    with pytest.raises(RecordError, match='is no record of race control'):
        begin()
    assert path.read_bytes() == before


def test_another_database_is_refused_and_left_alone(begin: Begin, path: pathlib.Path) -> None:
    path.parent.mkdir()
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.execute('CREATE TABLE invoices (sum INTEGER)')
    with pytest.raises(RecordError, match='its version is 0'):
        begin()


def test_a_reader_beside_the_writer_disturbs_neither(begin: Begin, path: pathlib.Path) -> None:
    record = begin()
    record.put([event(1)])
    assert record.flush(PATIENCE)
    with contextlib.closing(open_read_only(path)) as database:
        database.execute('BEGIN')
        assert len(list(events(database, 1))) == 1
        record.put([event(2)])
        assert record.flush(PATIENCE)
    assert len(texts(path, 1)) == 2


def test_a_run_that_is_over_is_told_from_one_that_crashed(
    begin: Begin, path: pathlib.Path
) -> None:
    crash(begin())
    begin().end(PATIENCE)
    with contextlib.closing(open_read_only(path)) as database:
        assert [run.ended_ns is None for run in sessions(database)] == [True, False]


# ----- a bad disk --------------------------------------------------------------------------


@pytest.fixture
def small_disk(tmp_path: pathlib.Path) -> Iterator[pathlib.Path]:
    """Return a file system of 512 KiB."""
    folder = tmp_path / 'disk'
    folder.mkdir()
    mounted = subprocess.run(
        ['mount', '-t', 'tmpfs', '-o', 'size=512k', 'tmpfs', str(folder)],
        capture_output=True,
        text=True,
        check=False,
    )
    if mounted.returncode:
        why = f'a file system cannot be mounted here: {mounted.stderr.strip()}'
        # In CI it must be possible; elsewhere it needs root.
        (pytest.fail if os.environ.get('EVGP_ALL_TESTS') else pytest.skip)(why)
    try:
        yield folder
    finally:
        subprocess.run(['umount', '-l', str(folder)], check=True)


def wait_for(found: Callable[[], object]) -> None:
    """Return once `found` is true; a disk has no event to await."""
    until = time.monotonic() + PATIENCE
    while not found():
        assert time.monotonic() < until
        time.sleep(0.01)


def test_a_full_disk_is_trouble_until_there_is_room_and_no_event_is_lost(
    small_disk: pathlib.Path,
) -> None:
    path = small_disk / 'record.sqlite3'
    record = Record(path)
    record.put([event(1)])
    assert record.flush(PATIENCE)
    ballast = small_disk / 'ballast'
    with pytest.raises(OSError, match='No space left'):
        ballast.write_bytes(bytes(1 << 20))
    count = 2000
    record.put([event(n, f'event {n} ' + 100 * 'x') for n in range(2, count + 1)])
    wait_for(record.trouble)
    assert (
        record.trouble()
        == f'The record {path} fails: database or disk is full; {count - 1} events wait'
    )
    ballast.unlink()
    assert record.flush(PATIENCE)
    wait_for(lambda: not record.trouble())
    record.end(PATIENCE)
    assert len(texts(path, 1)) == count


def test_a_disk_that_turns_read_only_is_trouble_until_it_can_be_written(
    small_disk: pathlib.Path,
) -> None:
    path = small_disk / 'record.sqlite3'
    record = Record(path)
    record.put([event(1)])
    assert record.flush(PATIENCE)
    record.end(PATIENCE, in_order=False)
    subprocess.run(['mount', '-o', 'remount,ro', str(small_disk)], check=True)
    second = Record(path)
    assert 'read-only file system' in second.trouble()
    # What cannot be written may still be read.
    assert second.left_behind is not None
    second.put([event(1, 'while it could not be written')])
    subprocess.run(['mount', '-o', 'remount,rw', str(small_disk)], check=True)
    assert second.flush(PATIENCE)
    second.end(PATIENCE)
    assert texts(path, 2) == ['while it could not be written']


def test_a_folder_that_cannot_be_made_is_trouble_and_the_end_does_not_hang(
    tmp_path: pathlib.Path,
) -> None:
    (tmp_path / 'folder').write_text('a file where a folder should be')
    record = Record(tmp_path / 'folder' / 'record.sqlite3')
    assert record.trouble()
    record.put([event(1)])
    assert not record.flush(0.0)
    record.end(PATIENCE)


# ----- the timeline ------------------------------------------------------------------------


def test_the_timeline_tells_the_last_run_in_order(
    begin: Begin, path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    crash(begin())
    record = begin()
    record.put([event(1, 'first'), event(2, 'refused', success=False), event(4, 'last')])
    assert record.flush(PATIENCE)
    assert print_timeline([str(path)]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.split()[0] == '2'
    assert [line.split()[-1] for line in lines] == ['first', 'refused', '...', 'last']
    assert ' ! refused' in lines[1]
    assert '... 1 events are missing ...' in lines[2]


def test_the_timeline_of_one_kart_leaves_the_others_out(
    begin: Begin, path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = begin()
    record.put([event(1, 'of 7', kart=7), event(2, 'of 8', kart=8), event(3, 'of all')])
    assert record.flush(PATIENCE)
    assert print_timeline([str(path), '--kart', '7']) == 0
    out = capsys.readouterr().out
    assert 'of 7' in out
    assert 'of all' in out
    assert 'of 8' not in out


def test_the_list_has_every_run(
    begin: Begin, path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    crash(begin())
    begin().end(PATIENCE)
    assert print_timeline([str(path), '--list']) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert 'not ended in good order' in first
    assert 'not ended' not in second


def test_a_record_that_is_not_there_is_named(
    path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert print_timeline([str(path)]) == 2
    assert f'there is no {path}' in capsys.readouterr().err


@pytest.mark.parametrize(
    'hand_over',
    [lambda record: record.put([event(1)]), lambda record: record.remember(RACING, 0.0)],
    ids=['events', 'memory'],
)
def test_the_writer_waits_while_frames_go_out(
    begin: Begin, hand_over: Callable[[Record], None]
) -> None:
    record = begin()
    asked, calm = threading.Event(), threading.Event()

    def give_way() -> None:
        asked.set()
        calm.wait(PATIENCE)

    record.courtesy = lambda: give_way
    hand_over(record)
    assert asked.wait(PATIENCE)
    assert not record.flush(0.0)
    calm.set()
    assert record.flush(PATIENCE)
