# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The record's process, at the other end of a real socket pair."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import functools
import itertools
import os
import pathlib
import select
import signal
import time

from evgp_node.stream import Gap
from evgp_protocol.states import RaceState
from evgp_rcs.karts import record_process
from evgp_rcs.karts.channel import Written
from evgp_rcs.karts.record_process import RecordProcess
from evgp_rcs.record import run_mark, store
from evgp_rcs.record.run_mark import RUN_BEGAN
from evgp_rcs.record.runs import open_runs
from evgp_rcs.record.store import left_behind, Record, RecordError
from evgp_rcs.rules.inputs import Batch, Tick
from evgp_rcs.rules.race import Event, EventKind, LastRun, RaceMemory, StampedEvent
from evgp_testing.process import freeze
import pytest
from rig.disks import filled, Harm, in_database, remount, small_disk
from rig.replaying import events_of

PATIENCE = 20.0
HOME = RaceMemory(RaceState.IN_GARAGE, {})
GRID = RaceMemory(RaceState.GRID_ACTIVE, {}, gridded=7)


def started(path: pathlib.Path, mark: pathlib.Path | None = None) -> RecordProcess:
    running = RecordProcess(path, mark or path.with_name('mark'))
    running._socket.setblocking(False)  # as its loop does
    return running


@pytest.fixture
def record(path: pathlib.Path) -> Iterator[RecordProcess]:
    running = started(path)
    yield running
    with contextlib.suppress(ProcessLookupError):
        os.kill(running.pid, signal.SIGCONT)
    with contextlib.suppress(OSError):  # the test has ended it
        running.end(PATIENCE, LastRun.UNKNOWN)


def put(record: RecordProcess, *numbers: int, text: str = 'something') -> None:
    told = Event(EventKind.CONNECTED, text)
    stamped = [StampedEvent(number, time.time_ns(), 0.1, told) for number in numbers]
    record.put(Batch(numbers[0] - 1, stamped))


def wait_for(record: RecordProcess, found: Callable[[], object]) -> None:
    """Return once `found` is true, while what comes is taken in; there is no loop that does."""
    until = time.monotonic() + PATIENCE
    while not found():
        assert time.monotonic() < until
        record.look()
        time.sleep(0.01)


def numbers_in(path: pathlib.Path) -> list[int]:
    return [event.sequence for event in events_of(path, 1)]


def test_what_has_reached_it_is_written_as_it_ends_with_the_kart_server_and_by_no_signal(
    path: pathlib.Path,
) -> None:
    written = 100
    if not (pid := os.fork()):
        dying = started(path)
        for signal_of_a_terminal_or_systemd in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            os.kill(dying.pid, signal_of_a_terminal_or_systemd)
        freeze(dying.pid)  # so that all of it still waits
        for number in range(1, written + 1):
            put(dying, number)
        assert not dying._end.unsent
        os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(pid, 0)
    until = time.monotonic() + PATIENCE
    while True:
        assert time.monotonic() < until
        with contextlib.suppress(RecordError):
            again = Record(path)
            again.end()
            break
    assert again.left_behind is None
    assert numbers_in(path) == [*range(1, written + 1)]


def test_a_process_that_is_killed_is_trouble_at_once_and_holds_nobody_up(
    record: RecordProcess,
) -> None:
    os.kill(record.pid, signal.SIGKILL)
    wait_for(record, record.trouble)
    assert 'its process has ended' in record.trouble()
    put(record, 1)
    record.remember(HOME)
    record.on_saved = lambda grid: pytest.fail('nobody can know')
    record.remember(GRID)
    assert '1 are lost' in record.trouble()


def test_a_process_that_is_frozen_is_trouble_until_it_goes_on_and_nothing_is_lost(
    record: RecordProcess, path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record_process, 'SLOW', 0.2)
    freeze(record.pid)
    for number in range(1, 2001):  # more than the pair takes
        put(record, number)
    assert record._end.unsent
    wait_for(record, record.trouble)
    assert '2000 events wait' in record.trouble()
    os.kill(record.pid, signal.SIGCONT)

    def written() -> bool:
        record._end._flush()  # as the loop does
        return not record._unwritten

    wait_for(record, written)
    assert record.trouble() == ''
    assert numbers_in(path) == [*range(1, 2001)]


def test_a_mark_that_cannot_be_written_is_trouble_until_it_can(path: pathlib.Path) -> None:
    mark = path.with_name('mark')
    mark.mkdir()
    record = started(path)
    assert record.opened.last_run is LastRun.UNKNOWN
    assert str(mark) in record.opened.why
    assert str(mark) in record.trouble()
    mark.rmdir()
    wait_for(record, lambda: not record.trouble())
    assert mark.read_text().strip() == RUN_BEGAN
    record.end(PATIENCE, LastRun.ENDED)
    again = RecordProcess(path, mark)
    assert again.opened.last_run is LastRun.ENDED
    again.end(PATIENCE, LastRun.ENDED)


def test_a_disk_that_writes_each_event_in_time_is_no_trouble_although_there_is_always_one_waiting(
    path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = Record.write

    def slow_write(record: Record) -> bool:
        time.sleep(0.2)
        return write(record)

    monkeypatch.setattr(record_process, 'SLOW', 0.8)
    with monkeypatch.context() as in_the_process:
        in_the_process.setattr(Record, 'write', slow_write)
        record = started(path)
    for number in range(1, 41):
        put(record, number)
        time.sleep(0.05)  # what is tested is that time goes by
        record.look()
        assert record.trouble() == ''
    record.end(PATIENCE, LastRun.UNKNOWN)


def test_what_no_disk_takes_needs_bounded_memory_and_leaves_a_gap_that_is_seen(
    record: RecordProcess, path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record_process, 'MOST_UNWRITTEN_BYTES', 10_000)
    freeze(record.pid)
    for number in range(1, 101):
        put(record, number, text=1000 * 'x')
    assert record._bytes <= 10_000
    lost = record._lost
    assert 80 < lost < 100
    assert f'{lost} are lost' in record.trouble()
    for _ in range(20_000):
        record.remember(HOME)
    assert not record._end.unsent  # it knows that already
    for number in range(20_000):
        record.remember((HOME, GRID)[number % 2])
    assert 10_000 < record._end.unsent < 20_000
    monkeypatch.setattr(record_process, 'MOST_UNWRITTEN_BYTES', 20_000)
    os.kill(record.pid, signal.SIGCONT)
    ticks = itertools.count(100)

    def no_trouble() -> bool:
        record.put(Batch(next(ticks), [Tick(0.1)]))  # there is always something to write
        record._end._flush()  # as the loop does
        record.look()
        return not record.trouble()

    wait_for(record, no_trouble)
    record.put(Batch(next(ticks), [StampedEvent(101, 0, 0.1, Event(EventKind.CONNECTED, ''))]))
    record.end(PATIENCE, LastRun.UNKNOWN)
    assert numbers_in(path) == [*range(1, 101 - lost), 101]
    with open_runs(path) as runs:
        entries = runs.read(runs.choose(1)).entries()
    assert [each.entries for each in entries if isinstance(each, Gap)] == [lost]


# ----- a file that cannot be written ----------------------------------------------------------

Mend = Callable[[], object]


def no_record(make: Harm) -> Callable[[pathlib.Path], Mend]:
    """Return what has something else in the place of the record, and returns its end."""

    def put_there(path: pathlib.Path) -> Mend:
        make(path)
        before = path.stat().st_mtime_ns

        def move_away() -> None:  # as the official is told to do
            assert path.rename(path.with_name('away')).stat().st_mtime_ns == before

        return move_away

    return put_there


def full(room: int) -> Callable[[pathlib.Path], Mend]:
    """Return what leaves so much room on the disk, in bytes, and returns how to make more."""

    def fill(path: pathlib.Path) -> Mend:
        ballast = filled(path.parent)
        os.truncate(ballast, ballast.stat().st_size - room)
        return ballast.unlink

    return fill


def read_only(path: pathlib.Path) -> Mend:
    remount(path.parent, 'ro')
    return functools.partial(remount, path.parent, 'rw')


def moved(replaced: bool) -> Callable[[pathlib.Path], Mend]:
    def move(path: pathlib.Path) -> Mend:
        away = path.rename(path.with_name('away'))
        if replaced:
            path.touch()
        return functools.partial(away.replace, path)

    return move


NO_FILE, NO_RECORD = 'is not a file', 'is not a record of this race control'
FROM_THE_START: dict[str, tuple[Callable[[pathlib.Path], Mend], str]] = {
    'a folder': (no_record(pathlib.Path.mkdir), NO_FILE),
    'a pipe': (no_record(os.mkfifo), NO_FILE),
    'a text': (no_record(lambda path: path.write_text('karts: [] # as wrong\n' * 9)), NO_RECORD),
    'another database': (no_record(in_database('CREATE TABLE invoices (sum)')), NO_RECORD),
    'a full disk': (full(0), 'full'),
    'an almost full disk': (full(16 * 1024), 'full'),
    'a read-only disk': (read_only, 'read-only file system'),
}
IN_THE_RUN: dict[str, tuple[Callable[[pathlib.Path], Mend], str]] = {
    'a disk that becomes full': (full(0), 'full'),
    'moved': (moved(False), 'moved'),
    'replaced': (moved(True), 'moved'),
}


@pytest.mark.parametrize('harm', [*FROM_THE_START, *IN_THE_RUN])
def test_while_the_file_takes_nothing_that_is_trouble_and_a_grid_is_told_to_be_there_once_it_is(
    harm: str, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, 'RETRY', 0.1)
    spoil, sentence = {**FROM_THE_START, **IN_THE_RUN}[harm]
    with small_disk(tmp_path / 'disk', '512k') as disk:
        path = disk / 'record.sqlite3'
        mend = spoil(path) if harm in FROM_THE_START else None
        record = started(path, tmp_path / 'mark')
        assert record.opened.left_behind is None
        if mend is None:
            put(record, 1)
            wait_for(record, lambda: not record._unwritten)
            mend = spoil(path)
        told: list[int] = []
        record.on_saved = told.append
        put(record, *range(1 + (harm in IN_THE_RUN), 1001), text=100 * 'x')
        record.remember(GRID)
        tries: list[Written] = []
        while len(tries) < 3:  # the last of them knows of the grid
            select.select([record._socket], [], [], PATIENCE)
            tries += record._end.receive()
        assert {each.gridded for each in tries} == {0}
        wait_for(record, lambda: sentence in record.trouble())
        assert record.trouble().startswith(f'The record {path} fails: ')
        mend()
        wait_for(record, lambda: told)
        assert told == [7]
        assert record.trouble() == ''
        assert left_behind(path) == GRID
        record.end(PATIENCE, LastRun.UNKNOWN)
        assert numbers_in(path) == [*range(1, 1001)]


def test_a_record_that_another_race_control_has_is_refused(
    path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_mark, 'CLAIM_TIMEOUT', 0.1)
    other = Record(path)
    with pytest.raises(RecordError, match='choose another file with the parameter record'):
        RecordProcess(path, path.with_name('mark'))
    other.end()
