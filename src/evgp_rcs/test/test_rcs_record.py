# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""``rcs_record`` as a program: its subcommands, its help, and what it says of a bad file."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import pathlib
import random
import re
import shutil
import sqlite3
import subprocess
import sys

from evgp_node.stream import Block, DamagedError
from evgp_node.stream_file import open_for_writing, WRITE_BLOCK
from evgp_rcs.rcs_record import main as rcs_record
from evgp_rcs.rcs_record import WAYS
from evgp_rcs.record.runs import DONE, FAILED, PARTLY, UNREADABLE
from evgp_rcs.record.store import default_path
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.inputs import Attended, decode, encode, Rules, Shown
from evgp_rcs.rules.race import Attendance
import pytest
from recorded_races import change_event, PaperRace, Running, SETUP
from rig.disks import Harm, in_database, in_place_of
from test_inputs import HOSTILE_JSON, places_in, with_hostile
from test_replay import an_ended_run

Capture = pytest.CaptureFixture[str]
PAGE = 4096
"""Size of a page of SQLite's, in bytes."""

KNOWN = [way for way in WAYS if way != 'mcap' or importlib.util.find_spec('mcap') is not None]
"""The subcommands that can do anything here."""

PROGRAM = (sys.executable, '-m', 'evgp_rcs.rcs_record')


def arguments_of(way: str, record: pathlib.Path) -> list[str]:
    """Return the arguments of a subcommand, with all that it needs; or skip the test."""
    if way not in KNOWN:
        pytest.skip('bags need the Python package mcap, which has no rosdep key')
    output = {
        'report': ['-o', str(record.with_name('report.html'))],
        'mcap': [str(record.with_name('race.mcap'))],
    }
    return [way, str(record), *output.get(way, [])]


def small_record(path: pathlib.Path, team: str = 'Purdue') -> pathlib.Path:
    paper = PaperRace({7: team})
    paper.connect(7)
    return paper.write(path)


@pytest.fixture(scope='module')
def recorded(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """Return a record of dozens of pages: a short run, and a long one with what went into it."""
    path = tmp_path_factory.mktemp('recorded') / 'record.sqlite3'
    small_record(path)
    an_ended_run(steps=1000).write(path)
    return path


@pytest.fixture
def good(recorded: pathlib.Path, path: pathlib.Path) -> pathlib.Path:
    """Return a record to do anything with."""
    shutil.copy(recorded, path)
    return path


# ----- the command ----------------------------------------------------------------------------


@pytest.mark.parametrize('way', ['', *WAYS])
def test_the_help_has_every_subcommand_and_each_has_its_own(way: str, capsys: Capture) -> None:
    with pytest.raises(SystemExit) as ended:
        rcs_record([way, '--help'] if way else ['-h'])
    assert ended.value.code == 0
    out = capsys.readouterr().out
    assert out.startswith(f'usage: rcs_record {way}')
    assert str(default_path()) in out.replace('\n', '')
    if not way:
        lines = [line.split()[0] for line in out.splitlines() if line.startswith('  ')]
        assert {*WAYS, '0', '1', '2', '3'} <= {*lines}
        assert max(map(len, out.splitlines())) < 110


def test_the_word_show_may_be_left_out(path: pathlib.Path, capsys: Capture) -> None:
    small_record(path)
    for rest in ([], ['--list'], ['--run', '1', '--kart', '7']):
        assert rcs_record([str(path), *rest]) == 0
        without = capsys.readouterr().out
        assert rcs_record(['show', str(path), *rest]) == 0
        assert capsys.readouterr().out == without


@pytest.mark.parametrize('way', ['report', 'results', 'mcap'])
def test_what_is_made_of_a_record_is_not_written_over_one_and_what_cannot_be_written_is_named(
    way: str, path: pathlib.Path, capsys: Capture
) -> None:
    before = small_record(path).read_bytes()
    for output in (path, path / 'no'):
        arguments = arguments_of(way, path)[:2] + ['-o'] * (way != 'mcap') + [str(output)]
        assert rcs_record(arguments) == FAILED
        assert str(output) in capsys.readouterr().err
    assert path.read_bytes() == before


def test_a_misspelt_subcommand_is_no_file(capsys: Capture) -> None:
    assert rcs_record(['reprot', '-o', 'x.html']) == UNREADABLE
    assert 'report' in capsys.readouterr().err


def test_whoever_reads_no_further_gets_no_trace_of_python(recorded: pathlib.Path) -> None:
    with subprocess.Popen(
        [*PROGRAM, str(recorded)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as program:
        assert program.stdout is not None
        assert program.stderr is not None
        program.stdout.readline()
        program.stdout.close()
        assert program.stderr.read() == b''
    assert program.returncode == 0


def test_a_terminal_of_few_characters_shows_what_it_can(path: pathlib.Path) -> None:
    done = subprocess.run(
        [*PROGRAM, str(small_record(path, 'Zürich 走'))],
        capture_output=True,
        env={**os.environ, 'PYTHONIOENCODING': 'ascii'},
    )
    assert (done.returncode, done.stderr) == (0, b'')
    assert b'Z?rich ?' in done.stdout


# ----- bad files ------------------------------------------------------------------------------


def cut_to(share: float, more: int = 0) -> Harm:
    """Return what leaves a share of the file, and some bytes more."""
    return lambda path: os.truncate(path, int(path.stat().st_size * share) + more)


def change(path: pathlib.Path, statement: str, *values: object) -> None:
    with contextlib.closing(sqlite3.connect(path)) as database, database:
        database.execute(statement, values)


def overwritten(path: pathlib.Path, at: int) -> None:
    with path.open('r+b') as file:
        file.seek(at // PAGE * PAGE)
        file.write(b'\xff' * PAGE)


def locked(path: pathlib.Path) -> sqlite3.Connection:
    """Have another program have the record for itself while it has this connection."""
    database = sqlite3.connect(path, isolation_level=None)
    database.execute('PRAGMA locking_mode = EXCLUSIVE')
    database.execute('BEGIN EXCLUSIVE')
    return database


def a_book(path: pathlib.Path) -> None:
    """Have the timekeeper's book there."""
    book, run = open_for_writing(path)
    with contextlib.closing(book):
        book.execute(WRITE_BLOCK, (run, 1, NO_TICK))


UNREADABLE_FILES: dict[str, Harm] = {
    'locked': locked,
    'nothing': pathlib.Path.unlink,
    'empty': cut_to(0.0),
    'a folder': in_place_of(pathlib.Path.mkdir),
    'a pipe': in_place_of(os.mkfifo),
    'a text': lambda path: path.write_text('Kart 7 was first.\n' * 1000),
    'another database': in_place_of(in_database('CREATE TABLE bookmark (url TEXT)')),
    'another database that looks like one': in_place_of(
        in_database('CREATE TABLE memory (day TEXT); PRAGMA user_version = 2')
    ),
    "the timekeeper's book": in_place_of(a_book),
    'a later version': in_database('PRAGMA user_version = 99'),
    'a garbled beginning': lambda path: overwritten(path, 0),
    'cut in its first page': cut_to(0.0, 1000),
}


@pytest.mark.parametrize('way', WAYS)
@pytest.mark.parametrize('harm', UNREADABLE_FILES.values(), ids=UNREADABLE_FILES)
def test_a_file_that_is_no_record_gets_one_sentence(
    way: str, harm: Harm, good: pathlib.Path, capsys: Capture
) -> None:
    held = harm(good)
    assert rcs_record(arguments_of(way, good)) == UNREADABLE
    told = capsys.readouterr()
    assert told.out == ''
    (line,) = told.err.splitlines()
    assert line.startswith('rcs_record: ')
    assert str(good) in line
    made = {'report.html', 'race.mcap'}
    assert not made & {each.name for each in good.parent.iterdir()}
    if isinstance(held, sqlite3.Connection):
        held.close()


def pages_overwritten(path: pathlib.Path) -> None:
    for share in (0.3, 0.6):
        overwritten(path, int(path.stat().st_size * share))


MIDDLE = 'WHERE run = 2 AND number = (SELECT max(number) / 2 FROM block WHERE run = 2)'
NO_TICK = Block(0, b'["Tick","x"]\n').compressed()


def block_replaced(data: object) -> Harm:
    """Return what puts something else in the place of a block in the middle."""
    query = f'UPDATE block SET data = ? {MIDDLE}'  # noqa: S608
    return lambda path: change(path, query, data)


OF_SQLITE: dict[str, Harm] = {
    'half': cut_to(0.5),
    'a byte too many': cut_to(1.0, 1),
    'pages overwritten': pages_overwritten,
}
DAMAGED_FILES: dict[str, Harm] = {
    **OF_SQLITE,
    'a block of another type': block_replaced('noon'),
    'a block that is garbled': block_replaced(b'garbled'),
    'a block with an entry of another type': block_replaced(NO_TICK),
    'a block that is missing': in_database(f'DELETE FROM block {MIDDLE}'),  # noqa: S608
}


@pytest.mark.parametrize('harm', DAMAGED_FILES)
def test_of_a_damaged_record_events_before_and_behind_the_damage_are_shown_and_a_gap_is_said(
    harm: str, good: pathlib.Path, capsys: Capture
) -> None:
    assert rcs_record([str(good)]) == DONE
    events = capsys.readouterr().out.splitlines()
    DAMAGED_FILES[harm](good)
    assert rcs_record([str(good), '--run', '2']) == PARTLY
    shown = capsys.readouterr().out.splitlines()
    assert len(shown) > 5
    left = [line for line in shown[1:] if 'missing' not in line]
    assert harm != 'pages overwritten' or len(shown[1:]) - len(left) == 2
    assert set(left) <= set(events)
    assert harm == 'half' or left[-1] == events[-1]
    assert rcs_record([str(good), '--run', '2', '--stream']) == PARTLY
    told = capsys.readouterr()
    assert told.out
    assert harm in OF_SQLITE or 'entries are missing' in told.err
    assert rcs_record(arguments_of('report', good)) == PARTLY
    text = good.with_name('report.html').read_text(encoding='utf-8')
    assert ('The record is damaged' in text) == (harm in OF_SQLITE)
    code = rcs_record(['replay', str(good)])
    if harm == 'a block that is missing':
        counts, missing = capsys.readouterr().out.splitlines()[-2:]
        assert (code, counts.endswith('no difference')) == (PARTLY, True)
        assert re.search(r'(1 entry is|\d+ entries are) missing', missing)


def blocks_moved(path: pathlib.Path, chance: random.Random) -> None:
    """Remove, repeat, swap or replace a block; not the last one, which nobody misses."""
    with contextlib.closing(sqlite3.connect(path)) as database, database:
        numbers = [n for (n,) in database.execute('SELECT number FROM block ORDER BY number')]
        one, other = chance.sample(numbers[:-1], 2)
        move = 'UPDATE block SET number = ? WHERE number = ?'
        again = 'INSERT INTO block SELECT run, ?, data FROM block WHERE number = ?'
        statements: tuple[tuple[str, tuple[object, ...]], ...] = chance.choice(
            (
                (('DELETE FROM block WHERE number = ?', (one,)),),
                ((again, (numbers[-1] + 1, one)),),
                ((move, (-1, one)), (move, (one, other)), (move, (other, -1))),
                (('UPDATE block SET data = ? WHERE number = ?', (NO_TICK, one)),),
            )
        )
        for statement in statements:
            database.execute(*statement)


def bits_flipped(path: pathlib.Path, chance: random.Random) -> None:
    data = bytearray(path.read_bytes())
    for _ in range(chance.choice((1, 20, 1000))):
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    path.write_bytes(data)


def truncated(path: pathlib.Path, chance: random.Random) -> None:
    os.truncate(path, chance.randrange(1, path.stat().st_size))


def stream_of(path: pathlib.Path, capsys: Capture) -> str:
    rcs_record(['show', str(path), '--stream'])
    return str(capsys.readouterr().out)


WHOLE = (blocks_moved, bits_flipped, truncated)


@pytest.mark.parametrize('seed', range(50))
def test_whatever_was_done_to_a_record_it_is_read_or_refused_and_a_change_is_found(
    seed: int, path: pathlib.Path, capsys: Capture
) -> None:
    chance = random.Random(seed)
    an_ended_run(seed, 200).write(path)
    before = stream_of(path, capsys)
    WHOLE[seed % len(WHOLE)](path, chance)
    codes = {}
    for arguments in (['show', str(path), '--list'], *(arguments_of(way, path) for way in KNOWN)):
        codes[arguments[0]] = rcs_record(arguments)
        told = capsys.readouterr()
        assert told.out or codes[arguments[0]] == UNREADABLE
        assert all(line.startswith('rcs_record: ') for line in told.err.splitlines())
    assert {*codes.values()} <= {DONE, FAILED, UNREADABLE, PARTLY}
    assert codes['replay'] != DONE or stream_of(path, capsys) == before


@pytest.mark.parametrize(
    'where', [*list(places_in(json.loads(encode(Rules('', SETUP)))))[1:]], ids=str
)
def test_whatever_stands_in_a_setup_each_subcommand_ends_with_a_sentence(
    where: tuple[int, ...], path: pathlib.Path, capsys: Capture
) -> None:
    Running(seed=1).run(20).write(path)
    text = encode(Rules('', SETUP)).decode()
    refused = False
    for hostile in HOSTILE_JSON:
        harmed = Block(1, with_hostile(text, where, hostile).encode('latin-1') + b'\n')
        try:
            list(decode(harmed.data))
        except DamagedError:
            if refused:
                continue  # one is as another: there is no setup
            refused = True
        query = 'UPDATE block SET data = ? WHERE number = 2'
        change(path, query, harmed.compressed())
        for way in KNOWN:
            path.with_name('race.mcap').unlink(missing_ok=True)
            assert rcs_record(arguments_of(way, path)) in (DONE, FAILED, UNREADABLE, PARTLY)


@pytest.mark.parametrize('way', ['replay', 'mcap'])
def test_a_name_that_no_message_can_hold_is_damage(way: str, path: pathlib.Path) -> None:
    paper = PaperRace({7: 'Purdue'})
    paper.connect(7)
    paper.feed(Attended(paper.now, Attendance(1, '\ud800')))
    paper.log.add(Shown(paper.now))
    paper.write(path)
    assert rcs_record(arguments_of(way, path)) != DONE


# ----- a clock that was set -------------------------------------------------------------------


def test_with_a_clock_that_was_set_back_the_order_and_the_time_to_the_finish_are_right(
    path: pathlib.Path, capsys: Capture
) -> None:
    paper = PaperRace({7: 'Purdue', 8: 'Michigan'})
    paper.connect(7, 8)
    paper.drive()
    paper.wait(10.0)
    paper.wall_offset_ns -= 3_600_000_000_000
    next_event = paper.stamped[-1].sequence + 1
    crossed = {'race': paper.race.number, 'attempt': paper.race.karts[7].attempt}
    paper.command(CommandKind.KART_FINISH, 7, run=paper.race.run, **crossed)  # by the timekeeper
    paper.command(CommandKind.ALL_KILL)
    paper.write(path)
    assert rcs_record([str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()[1:]
    assert len(lines) == len(paper.stamped)
    for line, each in zip(lines, paper.stamped, strict=True):
        assert each.event.text in line
    clocks = [line.split()[0] for line in lines]
    seconds = [float(line.split()[1]) for line in lines]
    assert seconds == sorted(seconds)
    assert clocks != sorted(clocks)
    assert rcs_record(['results', str(path)]) == 0
    _, first, _ = capsys.readouterr().out.splitlines()
    assert ',10.000,' in first
    assert rcs_record(['replay', str(path)]) == DONE
    counts, told, _ = capsys.readouterr().out.splitlines()
    assert counts.endswith('no difference')
    assert f'first by -3600.000 s before event {next_event},' in told


# ----- names of others ------------------------------------------------------------------------


HOSTILE = '\x1b[2J\x1b]0;owned\x07\u202egnp\u2066\x00\r\nKart 9 finished\u2028'


def test_a_hostile_text_or_file_name_does_nothing_to_the_terminal(
    path: pathlib.Path, capsys: Capture
) -> None:
    paper = PaperRace({7: HOSTILE, 8: 'x' * 10_000})
    paper.connect(7, 8)
    paper.command(CommandKind.KART_RED_RED, 7, official=HOSTILE)
    paper.write(path, HOSTILE)
    assert rcs_record([str(path)]) == DONE
    told = capsys.readouterr().out.splitlines()
    assert len(told) == 1 + len(paper.stamped)
    change_event(path, lambda each: each.sequence == 1, text=HOSTILE)
    assert rcs_record(['replay', str(path)]) == FAILED
    assert all(line.isprintable() for line in [*told, *capsys.readouterr().out.splitlines()])
    assert rcs_record([str(path.with_name('a\x1b[2J\udcff.sqlite3'))]) == UNREADABLE
    (line,) = capsys.readouterr().err.splitlines()
    assert line.isprintable()
