# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The timekeeper's book, in real files: what was written comes back, and what is lost is said."""

from __future__ import annotations

import contextlib
import itertools
import pathlib
import sqlite3
import tempfile
import time
from typing import Any

from evgp_node import stream_file
from evgp_node.results import BY_HAND, Standings
from evgp_node.stream import Began, Block, Gap
from evgp_protocol import clock
from evgp_timing.book import Book, BookError, EVENT_LASTS_NS, STREAM, STREAM_LASTS_NS
from evgp_timing.desk import Input, Passed, Told, What
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest
from rig.disks import Harm, in_database
from rig.values import any_of, ANYTHING

NAMES = st.text(st.characters(codec='utf-8'), max_size=12) | st.just(BY_HAND)
INPUTS: st.SearchStrategy[Input] = any_of(
    Input,
    {**ANYTHING, str: NAMES, int: st.integers(0, 2**62), float: st.floats(-1e9, 1e9)},
)
WRITTEN = st.lists(INPUTS | st.just(Standings()), min_size=1, max_size=3)

TOLD = Told(100.0, What.GREEN_GREEN, 'a run', 1, 'Heat 1', sequence=7)


def known(path: pathlib.Path) -> list[Input | Gap]:
    """Return what a timekeeper that is started knows."""
    opened = Book(path)
    try:
        return [*opened.known()]
    finally:
        opened.close()


def written(path: pathlib.Path, *entries: Input | Standings) -> None:
    """Have a timekeeper write entries, one after the other, and end."""
    opened = Book(path)
    for each in entries:
        opened.write(each)
    opened.close()


@pytest.fixture
def path(tmp_path: pathlib.Path) -> pathlib.Path:
    """Return where no book is yet."""
    return tmp_path / 'evgp_rcs' / 'timing.sqlite3'


@settings(max_examples=30)  # each writes files
@given(st.lists(st.lists(WRITTEN, max_size=3), max_size=4))
def test_every_input_comes_back_in_its_order_however_it_was_written_and_results_are_for_reports(
    starts: list[list[list[Input | Standings]]],
) -> None:
    entries = itertools.chain.from_iterable(itertools.chain.from_iterable(starts))
    with tempfile.TemporaryDirectory(dir='/dev/shm') as folder:  # no write waits for a disk
        path = pathlib.Path(folder, 'timing.sqlite3')
        for start in starts:
            opened = Book(path)
            for each in start:
                opened.write(*each)
            opened.close()
        assert known(path) == [each for each in entries if not isinstance(each, Standings)]


def no_database(path: pathlib.Path) -> None:
    path.write_bytes(b'no database' * 1000)


def half_lost(path: pathlib.Path) -> None:
    opened = Book(path)
    for number in range(300):
        opened.write(TOLD._replace(sequence=number, run='x' * number))
    opened.close()
    content = path.read_bytes()
    half = len(content) // 2
    path.write_bytes(content[:half] + bytes([255]) * (len(content) - half))


@pytest.mark.parametrize(
    'damage', [no_database, in_database('PRAGMA user_version = 3'), half_lost]
)
def test_a_file_that_is_no_book_is_left_alone_and_refused_with_what_to_do(
    damage: Harm, path: pathlib.Path
) -> None:
    path.parent.mkdir()
    damage(path)
    before = path.read_bytes()
    with pytest.raises(BookError, match='Move it away, or choose another file') as refused:
        known(path)
    assert str(path) in str(refused.value)
    assert '\n' not in str(refused.value)
    assert path.read_bytes() == before


def test_a_folder_in_which_nobody_may_write_is_refused(tmp_path: pathlib.Path) -> None:
    (tmp_path / 'file').touch()
    with pytest.raises(BookError, match='cannot be written'):
        Book(tmp_path / 'file' / 'timing.sqlite3')


def aged(path: pathlib.Path, by_ns: int) -> None:
    """Have the streams of a book be older than they are, and of another start of the machine."""
    with contextlib.closing(sqlite3.connect(path)) as database, database:
        for rowid, data in database.execute('SELECT rowid, data FROM block').fetchall():
            block = Block.of(data)
            entries = [
                Began('another start', each.wall_ns - by_ns) if isinstance(each, Began) else each
                for each in STREAM.decode(block.data)
            ]
            older = Block(block.entries, b''.join(map(STREAM.encode, entries))).compressed()
            database.execute('UPDATE block SET data = ? WHERE rowid = ?', (older, rowid))


def test_an_event_goes_on_for_three_days_and_what_is_older_is_of_another_also_while_one_runs(
    path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    began_ns, later, opened = time.time_ns(), TOLD._replace(sequence=8), Book(path)

    def go_on_to(age_ns: int) -> None:
        monkeypatch.setattr(time, 'time_ns', lambda: began_ns + age_ns)

    opened.write(TOLD)
    go_on_to(STREAM_LASTS_NS + 10**9)
    opened.write(later)
    opened.close()
    go_on_to(EVENT_LASTS_NS - 10**11)
    assert known(path) == [TOLD, later]
    go_on_to(EVENT_LASTS_NS + 10**9)
    assert known(path) == [later]


def test_a_timekeeper_that_restarted_in_a_race_keeps_its_times_after_a_start_of_the_machine(
    path: pathlib.Path,
) -> None:
    """A stream begins with the results that are known, or with news that is older than it."""
    began = clock.now()
    written(path, TOLD._replace(at=100.0), Passed(130.0, ()))
    written(path, Standings(170.0), Passed(190.0, ()))
    written(path, TOLD._replace(at=195.0), Passed(230.0, ()))
    aged(path, 3_600 * 10**9)
    times = [each.at for each in known(path) if not isinstance(each, Gap)]
    assert times[0] == pytest.approx(began - 3_600.0, abs=30.0)
    assert [each - times[0] for each in times] == pytest.approx([0.0, 30.0, 90.0, 95.0, 130.0])


class Doubtful(sqlite3.Connection):
    """A disk that in doubt takes what it says that it does not take."""

    in_doubt = False

    def execute(self, *given: Any) -> sqlite3.Cursor:
        done = super().execute(*given)
        if self.in_doubt:
            raise sqlite3.OperationalError('disk I/O error')
        return done


@pytest.mark.parametrize(('takes_it', 'before'), [(False, [TOLD]), (True, [TOLD]), (False, [])])
def test_a_disk_that_says_no_is_told_and_what_comes_later_is_written(
    path: pathlib.Path, takes_it: bool, before: list[Told], monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as opening:
        opening.setattr(stream_file, '_Database', Doubtful)
        opened = Book(path)
    for each in before:
        opened.write(each)
    with contextlib.closing(sqlite3.connect(path)) as other, monkeypatch.context() as failing:
        failing.setattr(Doubtful, 'in_doubt', takes_it)
        if not takes_it:
            other.execute('BEGIN IMMEDIATE')
        with pytest.raises(OSError, match='cannot be written'):
            opened.write(TOLD._replace(sequence=8))
    opened.write(TOLD._replace(sequence=9))
    opened.close()
    aged(path, 0)  # also where the first was not taken, there is a beginning
    *told, gap, last = known(path)
    assert isinstance(gap, Gap)
    assert gap.entries == 1
    kept = [each.sequence for each in (*told, last) if isinstance(each, Told)]
    assert kept == [*(each.sequence for each in before), 9]
