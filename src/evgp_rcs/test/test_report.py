# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The report and the results of a run: what the rules make of its stream, and nothing else."""

from __future__ import annotations

import contextlib
import hashlib
import math
import pathlib
import random
import re
import sqlite3

from evgp_node.results import (
    Act,
    Corrected,
    Correction,
    Identity,
    Judged,
    KartResult,
    Mark,
    MOST_PASSINGS,
    Passing,
    Penalty,
    Standings,
    Status,
)
from evgp_node.roster import Format
from evgp_node.stream import Began
from evgp_node.stream_file import BOOK
from evgp_protocol.clock import duration
from evgp_protocol.states import RaceState
from evgp_rcs.record.report import wording
from evgp_rcs.record.report.drawing import drawing, NAMES, WIDTH
from evgp_rcs.record.report.model import (
    Account,
    NO_GRADE,
    NOT_CONNECTED,
    NOT_KNOWN,
    Result,
    Stop,
    Why,
)
from evgp_rcs.record.report.results import COLUMNS, defused
from evgp_rcs.record.report.wording import Clock
from evgp_rcs.record.runs import DONE, open_runs, PARTLY, Runs
from evgp_rcs.record.store import Record, Session
from evgp_rcs.rules import inputs
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.inputs import Entry
from evgp_rcs.rules.race import AlertKind, EventKind, Heat, LastRun, StampedEvent
import pytest
from recorded_races import (
    change_event,
    edit,
    named,
    PaperRace,
    report,
    rows_of,
    Running,
    tables,
    timed,
)
from rig.disks import garble_schema, Harm, in_database

RED_FLAG, RED_RED = RaceState.RED_FLAG.name, RaceState.RED_RED.name
TEAMS = {7: 'Purdue', 8: 'Michigan', 9: 'Kennesaw'}


@pytest.fixture
def paper() -> PaperRace:
    """Return a race with three karts, all connected."""
    paper = PaperRace(TEAMS)
    paper.go('connect 7 8 9, wait 1')
    return paper


def stops(account: Account) -> list[Stop]:
    return [account.stop(account.races[0], each) for each in account.races[0].stops]


Truth = tuple[float, int, tuple[str, str, str, str], bool]
"""When, which kart, what it was sent, its hold, its link's grade and the race's state, and whether
it had answered."""


@pytest.mark.parametrize('seed', range(6))
def test_lanes_and_alerts_show_what_the_rules_had_at_every_moment(seed: int) -> None:
    paper = Running(seed)
    truth: list[Truth] = []
    standing: list[tuple[float, set[tuple[AlertKind, int]]]] = []
    for _ in range(300):
        paper.run(1)
        for kart in paper.race.karts.values():
            what = kart.sent.name if kart.connected else NOT_CONNECTED
            hold = kart.hold.name if kart.hold else ''
            told = what, hold, kart.link.grade.name, paper.race.state.name
            answered = kart.acknowledged_after is not None
            truth.append((paper.now, kart.number, told, answered))
        standing.append((paper.now, {*paper.race._alerts}))
        paper.now += 0.5
    account = paper.account()
    began = paper.stamped[0].monotonic
    looked = 0
    for when, number, told, answered in truth:
        at = when - began + 0.1
        if at < account.length:
            lane = account.lanes[number]
            bands = lane.bands, lane.holds, lane.links, account.race_bands
            now = [next(each for each in one if each.start <= at < each.end) for one in bands]
            assert tuple(each.what for each in now) == told
            if answered:
                assert now[0].acknowledged is not None
                assert now[0].start <= now[0].acknowledged <= at
            looked += 1
    assert looked > 1000
    for when, alerts in standing:
        at = when - began + 0.1
        if at < account.length:
            assert alerts == {
                (each.event.event.alert, each.event.event.kart)
                for each in account.alerts
                if each.event.at <= at < (math.inf if each.ended is None else each.ended)
            }


def test_a_lane_shows_since_when_a_finish_holds_a_kart_that_has_been_stopped(
    paper: PaperRace,
) -> None:
    paper.go('drive, KART_FINISH 7, RACE_OVER')
    flag = paper.race.karts[7].flag_at
    assert flag is not None
    paper.go('wait 60, lose 9')
    (held,) = (each for each in paper.account().lanes[7].holds if each.what == RED_FLAG)
    assert held.start == pytest.approx(flag - paper.stamped[0].monotonic, abs=0.25)


def test_a_stop_has_who_was_told_with_two_times_and_who_was_slowest(paper: PaperRace) -> None:
    paper.go(
        'drive, wait 5, KART_RED_RED 9, wait 1, say 9, RED_FLAG, deliver 7 0.62, wait 1.38, '
        'say 7, ALL_KILL, wait 1, say 8, wait 0.5, lose 7, wait 2, ALL_KILL'
    )
    account = paper.account()
    alone, flag, kill, again = every = stops(account)
    commands = [named(each.event) for each in every]
    assert commands == ['KART_RED_RED', 'RED_FLAG', 'ALL_KILL', 'ALL_KILL']

    clock = Clock(0)

    def told(stop: Stop) -> dict[int, tuple[str, str, str]]:
        """Return what each kart was sent, and how long its two answers took or why one is none."""
        cells = {each.kart: wording.answers(stop, each, clock) for each in stop.told}
        return {kart: (sent, after, took or at) for kart, (sent, after, at, took) in cells.items()}

    assert told(alone) == {9: ('RED RED', '0.020 s', '1.000 s')}
    assert told(flag)[7] == ('RED FLAG', '0.620 s', '2.000 s')
    assert told(flag)[8][:2] == ('RED FLAG', 'not seen')
    assert told(flag)[8][2].startswith('not acknowledged before it was sent another state')
    assert told(flag)[9][0].startswith('RED RED, already since ')
    assert told(kill)[7][2].startswith('not acknowledged: it lost its connection')
    assert told(kill)[8] == ('RED RED', '0.020 s', '1.000 s')
    assert told(again)[7] == ('nothing: it was not connected', '', '')
    # Kart 9 had been told before: it says nothing about these stops.
    silent = [[each.kart for each in stop.told if each.is_silent] for stop in every]
    assert silent == [[], [8], [7], []]
    slowest = [each.slowest() for each in every]
    assert [each and each.kart for each in slowest] == [9, 7, 8, None]


def test_the_page_has_the_stops_the_refusals_the_corrections_and_the_label_of_each_command(
    paper: PaperRace, tmp_path: pathlib.Path
) -> None:
    paper.go('GREEN_GREEN, ALL_KILL, go_home')  # refused, and no race
    paper.go('drive, KART_FINISH 8, KART_UNDO_FINISH 8, wait 5')
    paper.go('GRID_ACTIVE 0 Grace, ALL_KILL, wait 2, say 7')
    page = report(paper.write(tmp_path / 'record.sqlite3'))
    stopped = table(page, 'stops')
    assert [row[0] for row in stopped] == [f'Kart {kart} ({team})' for kart, team in TEAMS.items()]
    assert [row[4] for row in stopped] == ['2.000 s', '', '']
    assert [row[1:3] for row in table(page, 'refusals')] == [['GRID ACTIVE', 'Grace']]
    assert [row[1:3] for row in table(page, 'corrections')] == [['UNDO FINISH, kart 8', 'Ada']]
    assert any(row[5].startswith('ALL KILL: ') for row in table(page, 'all'))
    assert 'The record has 1 race.' in page
    assert [row[3][:18] for row in tables(page, 'incidents')[-1]] == ['ALL KILL from Ada:']


@pytest.mark.parametrize('what', ['a gap', 'a difference'])
def test_where_the_rules_cannot_follow_the_events_are_listed_and_nothing_else_is_said(
    paper: PaperRace, tmp_path: pathlib.Path, what: str
) -> None:
    paper.go('drive, measure 7 GOOD, wait 10, KART_RED_FLAG 7, lose 9, wait 5')
    paper.batches.append(paper.log.take())
    if what == 'a gap':
        paper.go('KART_FINISH 8')
        lost = paper.log.take()
    paper.go('ALL_KILL 0 Eve, wait 1')
    path = paper.write(tmp_path / 'record.sqlite3', version='')
    if what == 'a difference':
        change_event(
            path,
            lambda each: each.event.official == 'Eve' and each.event.kind is EventKind.COMMAND,
            official='Ada',
        )
    with open_runs(path) as runs:
        account = Account(runs.read(runs.choose(None)))
    assert [band.what for band in account.lanes[7].bands][-2:] == [RED_FLAG, NOT_KNOWN]
    assert [link.what for link in account.lanes[7].links][-2:] == ['GOOD', NO_GRADE]
    assert account.race_bands[-1].what == NOT_KNOWN
    (race,) = account.races
    assert race.incomplete
    out = {result.kart: result.out.why for result in account.results(race) if result.out}
    assert out == {7: Why.STOPPED_ALONE, 8: Why.NOT_KNOWN, 9: Why.LOST}
    assert list(map(named, race.stops)) == ['KART_RED_FLAG']
    text = report(path, code=PARTLY if what == 'a gap' else DONE)
    if what == 'a gap':
        assert f'{len(lost.entries)} entries are missing' in text
    assert 'it only lists the events in the record' in text
    assert 'was recorded with other rules (version unknown' in text
    assert '<b>ALL KILL</b>' in text
    assert {row[1] for row in table(text, 'alerts')} == {'not known'}
    assert 'had not ended when' not in text


def test_a_race_that_was_taken_up_is_shown_as_begun_before(paper: PaperRace) -> None:
    paper.go('drive, KART_FINISH 9')
    again = PaperRace(TEAMS)
    again.feed(inputs.Recovered(again.now, paper.race.memory(), LastRun.UNKNOWN))
    again.go('connect 7 8 9, wait 5, go_home, wait 1')
    account = again.account()
    (race,) = account.races
    assert race.taken_up
    assert not race.incomplete
    assert race.garage is not None
    assert all(each.holds for each in account.lanes.values())
    assert account.results(race) == [Result(9, place=1)]  # nobody knows who else started


def test_a_connection_that_ends_with_race_control_was_not_lost(paper: PaperRace) -> None:
    paper.go('drive, wait 1, RED_FLAG, wait 1, end')
    account = paper.account()
    assert account.outside.incidents == []
    assert list(map(named, account.races[0].incidents)) == ['RED_FLAG']
    (stop,) = stops(account)
    assert {(each.then, each.is_silent) for each in stop.told} == {('', True)}
    assert {lane.bands[-1].what for lane in account.lanes.values()} == {RED_RED}
    looks = {shape.look for shape in drawing(account, (0.0, account.length), Clock(0), '').shapes}
    assert 'mark DELIVERED' in looks
    assert 'mark DISCONNECTED' not in looks


def test_the_timeline_of_a_race_in_a_run_has_what_was_sent_before(paper: PaperRace) -> None:
    paper.go('drive, wait 20, KART_RED_FLAG 7, wait 20')
    shapes = drawing(paper.account(), (10.0, 30.0), Clock(0), '').shapes
    race, green, flag, *_ = (each for each in shapes if each.look.startswith('band'))
    assert [race.words, green.words, flag.words] == ['GREEN GREEN', 'GREEN GREEN', 'RED FLAG']
    assert green.x == pytest.approx(NAMES)
    assert green.width + flag.width == pytest.approx(WIDTH - NAMES)


@pytest.mark.parametrize('began_ns', [0, 499_999, 500_000, 999_999_999])
def test_the_times_that_are_shown_add_up_and_are_rounded_never_cut(
    chance: random.Random, began_ns: int
) -> None:
    clock = Clock(began_ns)

    def shown(at: float) -> int:
        hours, minutes, rest = clock.at(at, 3).split(':')
        return (int(hours) * 60 + int(minutes)) * 60_000 + round(float(rest) * 1000)

    for _ in range(1000):
        start = chance.uniform(0.0, 50.0)
        start, end = round(start, 3), round(start + chance.uniform(0.0, 9.0), 3)
        took = float(duration(end - start, 3).removesuffix(' s'))
        assert (shown(end) - shown(start)) % 86_400_000 == round(took * 1000)
    shown_at = [Clock(0).at(at, digits)[6:] for at, digits in ((50.26, 1), (50.96, 1), (50.5, 0))]
    assert shown_at == ['50.3', '51.0', '51']


# ----- places, and why a kart has none ---------------------------------------------------------


BECAME: dict[str, tuple[list[int], dict[int, tuple[Why, str]], str, str]] = {
    'drive, KART_FINISH 3, KART_FINISH 2, KART_UNDO_FINISH 3': ([2], {}, '', ''),
    # The one was stopped before its finish was undone; the other drove on.
    'drive, KART_FINISH 3, KART_FINISH 2, KART_UNDO_FINISH 3, wait 13, KART_FINISH 1, '
    'KART_UNDO_FINISH 2, RACE_OVER, go_home': (
        [1],
        {2: (Why.FINISH_UNDONE, 'KART_UNDO_FINISH'), 3: (Why.RACE_STOPPED, 'RACE_OVER')},
        'KART_UNDO_FINISH',
        'RACE_OVER',
    ),
    # Only the first reason counts, and nothing after a finish takes its place away.
    'drive, wait 1, KART_FINISH 1, KART_FINISH 2, lose 1, KART_RED_RED 2, lose 3, '
    'KART_RED_FLAG 4, wait 1, KART_RED_RED 3, lose 4, RED_FLAG, lose 5, KART_RED_RED 6, '
    'RACE_OVER, go_home': (
        [1, 2],
        {
            3: (Why.LOST, 'DISCONNECTED'),
            4: (Why.STOPPED_ALONE, 'KART_RED_FLAG'),
            5: (Why.RACE_STOPPED, 'RED_FLAG'),
            6: (Why.RACE_STOPPED, 'RED_FLAG'),
        },
        'DISCONNECTED KART_RED_RED DISCONNECTED KART_RED_FLAG KART_RED_RED DISCONNECTED '
        'RED_FLAG DISCONNECTED KART_RED_RED',
        'KART_RED_RED KART_RED_FLAG KART_RED_RED RED_FLAG KART_RED_RED RACE_OVER',
    ),
    # A kart takes its stop back.
    'drive, say 1 GRID_ACTIVE, ALL_KILL, acknowledge, say 1 GREEN_GREEN': (
        [],
        {1: (Why.RACE_STOPPED, 'ALL_KILL')},
        'ALL_KILL WITHDRAWN',
        'ALL_KILL',
    ),
    'drive, end': ([], {6: (Why.RACE_CONTROL_ENDED, 'ENDED')}, '', ''),
    # It goes over by itself.
    'drive, KART_FINISH 1, KART_FINISH 2, KART_FINISH 3, KART_FINISH 4, KART_FINISH 5, '
    'KART_FINISH 6, wait 30': ([1, 2, 3, 4, 5, 6], {}, '', 'RACE_STATE'),
}
"""Stories of six karts: who has a place, why others do not, the incidents and the stops."""


@pytest.mark.parametrize('story', BECAME)
def test_of_each_starter_the_place_is_told_or_why_it_has_none_and_of_the_race_its_incidents(
    story: str,
) -> None:
    paper = PaperRace(dict.fromkeys(range(1, 7), ''))
    paper.connect(*paper.race.karts)
    paper.go(story)
    account = paper.account()
    (race,) = account.races
    became = account.results(race)
    out = {each.kart: (each.out.why, each.out.event) for each in became if each.out}
    places, reasons, incidents, stopped = BECAME[story]
    assert [each.kart for each in became if each.place] == places
    assert {*out} == {*paper.race.karts} - {*places}
    for kart, (why, event) in reasons.items():
        assert (out[kart][0], named(out[kart][1])) == (why, event)
    assert ' '.join(map(named, race.incidents)) == incidents
    assert ' '.join(map(named, race.stops)) == stopped


# ----- rcs_record report ----------------------------------------------------------------------

HOSTILE = (
    '<script>document.title="broken"</script>',
    '</script><script>document.title="broken"</script>',
    '"><img src="http://192.0.2.1/x" onerror="document.title=1">',
    '\u202egnp.exe\u202c',
    'x' * 10_000,
    '${title}\x00\x1b[2J',
    *('=cmd()', '+1', '-1', '@SUM(A1)', '\t=1', '\r=1', ' =1', '\uff1d1', '"\n=1,2"', '\u202e=1'),
    '=' + 'x' * 10_000,
)


@pytest.fixture
def written(paper: PaperRace, tmp_path: pathlib.Path) -> pathlib.Path:
    paper.go('drive, wait 5, ALL_KILL, end')
    return paper.write(tmp_path / 'record.sqlite3')


def table(page: str, kind: str) -> list[list[str]]:
    """Return the cells of the only table of this kind."""
    (found,) = tables(page, kind)
    return found


DRIVE_AND_STOP = 'drive, wait 40, KART_FINISH 7, wait 1, KART_FINISH 8, ALL_KILL'
"""A race in which 7 finishes before 8, and 9 not at all."""

LAPS = Standings(
    race=1,
    heat='Heat A',
    laps=2,
    karts=(
        KartResult(8, 1, Status.CLASSIFIED, 2, 28.0, (12.0, 14.0), ()),
        KartResult(9, 0, Status.DNF, 1, 16.0, (13.0,), ()),
        KartResult(
            7,
            0,
            Status.DISQUALIFIED,
            2,
            29.0,
            (14.0, 14.0),
            (Penalty(7, 0, 0, True, 'it was pushed', 'Grace'),),
        ),
    ),
    passings=(
        Judged(Passing('line', 'today', 7), 9, Mark.DOUBTFUL, 29.0, ''),
        Judged(Passing('line', 'today', 10, transponder='4711'), 0, Mark.UNKNOWN, 40.0, ''),
        Judged(Passing('line', 'today', 2), 9, Mark.STRUCK, 16.0, 'it was 8, by Grace'),
    ),
)


def test_report_and_table_have_what_the_timekeeper_says_of_a_race_but_no_laps_by_hand(
    paper: PaperRace, tmp_path: pathlib.Path
) -> None:
    paper.go(DRIVE_AND_STOP)
    asked = (
        Correction(Act.PENALISE, 'Grace', 8, seconds=5, reason='it cut the corner'),
        Correction(Act.COUNT, 'Ben', 8),
        Correction(Act.STRIKE, 'Ben', passing=Identity('line', 'today', 2), reason='it was 8'),
    )
    given = [Corrected(paper.now, each, race=race) for each in asked for race in (1, 2)]
    given.append(Corrected(0.0, asked[0]._replace(kart=9), race=1))  # the machine began again
    record = paper.write(tmp_path / 'record.sqlite3')
    page = report(timed(record, Standings(race=1), LAPS, *given))
    assert 'no difference' in page
    assert table(page, 'order results') == [
        ['1.', 'Kart 8 (Michigan)', '2', '28.000 s', '12.000 s', '', 'classified'],
        ['-', 'Kart 9 (Kennesaw)', '1', '16.000 s', '13.000 s', '', 'did not finish'],
        [
            '-',
            'Kart 7 (Purdue)',
            '2',
            '29.000 s',
            '14.000 s',
            'disqualified: it was pushed (Grace)',
            'disqualified',
        ],
    ]
    assert [row[1] for row in table(page, 'laps')] == [
        '1: 12.000 ★ 2: 14.000',
        '1: 13.000 ★',
        '1: 14.000 ★ 2: 14.000 ★',
    ]
    assert table(page, 'chart') == [['1', '8', '7', '9'], ['2', '8', '7']]
    assert [row[1:] for row in table(page, 'passings')] == [
        ['Kart 9 (Kennesaw)', 'line 7', 'doubtful'],
        ['not known', 'line 10, transponder 4711', 'unknown'],
        ['Kart 9 (Kennesaw)', 'line 2', 'struck out: it was 8, by Grace'],
    ]
    when = Clock(paper.stamped[0].wall_ns).time(paper.stamped[-1].wall_ns, 1)
    assert table(page, 'of_timing') == [
        [when, 'Grace', 'penalise a kart, kart 8, +5 s: it cut the corner'],
        [when, 'Ben', 'strike a passing out, passing line 2: it was 8'],
        ['later', 'Grace', 'penalise a kart, kart 9, +5 s: it cut the corner'],
    ]
    rows = {row['kart']: row for row in rows_of(record)}
    found = {kart: (row['place'], row['finish'], row['result']) for kart, row in rows.items()}
    assert found == {
        '7': ('', '1', 'DISQUALIFIED'),
        '8': ('1', '2', 'FINISHED'),
        '9': ('', '', 'RACE_STOPPED'),
    }
    assert rows['7']['penalties'] == 'disqualified: it was pushed (Grace)'
    words = f'the last {MOST_PASSINGS} passings'
    assert words not in page
    record.with_name(BOOK).unlink()
    full = LAPS._replace(passings=LAPS.passings[:1] * MOST_PASSINGS)
    assert words in report(timed(record, full))


def be_long_ago(entries: list[Entry]) -> None:
    entries[:] = [
        each._replace(wall_ns=1) if isinstance(each, Began | StampedEvent) else each
        for each in entries
    ]


def test_the_table_has_the_races_of_the_day_or_run_and_always_the_newest_standing_of_the_day(
    path: pathlib.Path,
) -> None:
    """A penalty for an earlier race is in its own results and in the standing of all."""
    one, two = (KartResult(kart, 1, Status.CLASSIFIED, 1, 9.0, (9.0,), ()) for kart in (7, 8))
    penalised = one._replace(total=14.0)
    trial = Standings(race=1, format=Format.TIME_TRIAL, karts=(one,), overall=(one,))
    ids = []
    for _ in range(3):
        paper = PaperRace(TEAMS)
        paper.go(f'connect 7 8 9, wait 1, {DRIVE_AND_STOP}')
        paper.write(path)
        ids.append(paper.race.run)
    edit(path, be_long_ago)
    timed(
        path,
        *(trial._replace(run=each) for each in ids[:2]),
        trial._replace(karts=(two,), overall=(one, two._replace(place=2))),
        trial._replace(run=ids[1], karts=(penalised,), overall=(two, penalised._replace(place=2))),
    )
    told = 'run', 'kart', 'total', 'overall'
    rows = [('1', '7', '9.000', '1'), ('2', '7', '14.000', '2'), ('3', '8', '9.000', '1')]
    for asked, wanted in (
        ('', rows[1:]),
        ('--all', rows),
        ('--run 1', rows[:1]),
        ('--run 2', rows[1:2]),
        ('--run 3', rows[2:]),
    ):
        found = rows_of(path, *asked.split())
        timed_rows = [tuple(row[each] for each in told) for row in found if row['overall']]
        assert timed_rows == wanted
        assert {row['run'] for row in found} == {run for run, *_ in wanted}
    for run in ('2', '3'):
        page = report(path, '--run', run)
        assert [row[:2] for row in tables(page, 'order results')[-1]] == [
            ['1.', 'Kart 8 (Michigan)'],
            ['2.', 'Kart 7 (Purdue)'],
        ]


@pytest.mark.parametrize(
    ('harm', 'sentence'),
    [
        (pathlib.Path.unlink, 'there is only the order of FINISH'),
        (
            lambda book: book.write_bytes(bytes(10_000)),
            "the timekeeper's results are missing",
        ),
        (garble_schema, 'its schema is garbled'),
        (in_database("UPDATE block SET data = x'00112233'"), 'results may be missing'),
        (in_database('PRAGMA user_version = 1'), 'its version is 1, not'),
    ],
)
def test_without_a_book_that_can_be_read_there_is_a_sentence_and_the_order_of_finish(
    paper: PaperRace,
    tmp_path: pathlib.Path,
    capsys: pytest.CaptureFixture[str],
    harm: Harm,
    sentence: str,
) -> None:
    paper.go(DRIVE_AND_STOP)
    record = timed(paper.write(tmp_path / 'record.sqlite3'), LAPS)
    harm(record.with_name(BOOK))
    page = report(record)
    assert sentence in capsys.readouterr().err
    assert 'class="order results"' not in page
    assert [row[:2] for row in table(page, 'order')][:2] == [
        ['1.', 'Kart 7 (Purdue)'],
        ['2.', 'Kart 8 (Michigan)'],
    ]
    assert rows_of(record)
    assert sentence in capsys.readouterr().err


def test_a_report_says_whether_the_run_ended_in_good_order_and_was_replayed(
    written: pathlib.Path,
) -> None:
    page = report(written)
    assert 'ended normally at' in page
    assert re.search(r'<li>(?:(?!</li>).)*no difference</bdi></li>', page)
    change_event(written, lambda each: each.event.kind is EventKind.ENDED, success=False)
    assert 'Race control did not end normally: ' in report(written)
    change_event(written, lambda each: each.sequence == 5, text='nothing')
    assert re.search(r'<li class=bad>.*The first difference is event 5,', report(written))
    edit(written, lambda entries: entries.pop(1))
    assert 'was not replayed' in report(written)


def test_the_sums_are_of_the_file_and_of_the_events_and_none_of_a_file_that_is_being_written(
    written: pathlib.Path,
) -> None:
    def sums(page: str) -> list[str]:
        return re.findall(r'<code>(\w{64})</code>', page)

    first, again = sums(report(written)), sums(report(written))
    assert first == again
    assert hashlib.sha256(written.read_bytes()).hexdigest() in first
    change_event(written, lambda each: each.sequence == 5, text='nothing')
    assert not set(sums(report(written))) & set(first)
    record = Record(written)
    page = report(written)
    record.end()
    assert len(sums(page)) == 1
    assert 'race control was writing it' in page


def test_what_others_have_written_is_nothing_but_text_and_no_spreadsheet_runs_it(
    tmp_path: pathlib.Path,
) -> None:
    teams = dict(enumerate(HOSTILE, 1))
    paper = PaperRace(teams, [Heat('=cmd()', tuple(teams))])
    paper.command(CommandKind.SET_HEAT, heat='=cmd()')
    paper.connect(*teams)
    paper.drive()
    for number, name in teams.items():
        paper.command(CommandKind.KART_RED_RED, number, official=name)
    paper.wait(1.0)
    penalties = tuple(Penalty(1, 1, 0, False, each, each) for each in HOSTILE)
    hostile = LAPS._replace(
        karts=(LAPS.karts[0]._replace(kart=1, penalties=penalties),),
        passings=tuple(
            Judged(Passing(each, each, 1, 0, each), 0, Mark.STRUCK, 1.0, each) for each in HOSTILE
        ),
        questions=HOSTILE,
    )
    record = timed(paper.write(tmp_path / 'record.sqlite3'), hostile)
    page = report(record)
    assert [row[3][:11] for row in table(page, 'passings')] == ['struck out:'] * len(HOSTILE)
    assert '<script' not in page
    assert '<img' not in page
    assert not re.search('[\u202a-\u202e\u2066-\u2069\x00\x1b]', page)
    rows = rows_of(record)
    found = {int(row['kart']): (row['heat'], row['team']) for row in rows}
    assert found == {number: (defused('=cmd()'), defused(team)) for number, team in teams.items()}
    for cell in (cell for row in rows for cell in row.values()):
        assert cell.isprintable()
        assert cell.lstrip()[:1] not in {*'=+-@\uff1d'}


def test_a_page_has_the_event_the_officials_and_room_to_sign_and_lets_in_only_its_own_style(
    written: pathlib.Path,
) -> None:
    assert '<html' in report(PaperRace(TEAMS).write(written.with_name('of no event')))
    page = report(written)
    assert 'Event: <span class="blank">' in page
    assert 'Officials: <bdi>Ada</bdi>.' in page
    assert '<h2>Signatures</h2>' in page
    assert 'Event: <bdi>EVGP &lt;2026&gt;</bdi>' in report(written, '--event', 'EVGP <2026>')
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]*)"', page)
    assert policy.startswith("default-src 'none';")
    assert 'unsafe' not in policy
    assert 'script' not in policy
    assert not re.search(r'\s(src|href|style|on\w+)=', page)


# ----- rcs_record results ---------------------------------------------------------------------


def test_table_and_report_have_for_every_kart_of_every_race_its_time_or_why_it_has_none(
    paper: PaperRace, path: pathlib.Path
) -> None:
    paper.go('drive, wait 20, KART_FINISH 8, RACE_OVER, go_home')
    paper.go('drive, lose 9, wait 1, connect 8')  # which pushes the first one out unsaid
    record = paper.write(path)
    rows = rows_of(record)
    assert {*map(tuple, rows)} == {COLUMNS}
    told = ('run', 'race', 'kart', 'team', 'seconds', 'result', 'complete')
    assert [[row[each] for each in told] for row in rows] == [
        ['1', '1', '8', 'Michigan', '20.000', 'FINISHED', 'yes'],
        ['1', '1', '7', 'Purdue', '', 'RACE_STOPPED', 'yes'],
        ['1', '1', '9', 'Kennesaw', '', 'RACE_STOPPED', 'yes'],
        ['1', '2', '7', 'Purdue', '', 'STILL_RACING', 'no'],
        ['1', '2', '8', 'Michigan', '', 'LOST', 'no'],
        ['1', '2', '9', 'Kennesaw', '', 'LOST', 'no'],
    ]
    assert re.fullmatch(r'2026-05-30T\d\d:\d\d:\d\d\.\d{3}[+-]\d\d:\d\d', rows[0]['started'])
    assert rows[0]['finished'] > rows[0]['started']
    lost = next(each for each in paper.stamped if each.event.kind is EventKind.DISCONNECTED)
    assert rows[-1]['event'] == str(lost.sequence)
    page = report(record)
    assert "Race control's own report: " in page
    assert '2 lost connections during a race' in page
    assert [row[2] for each in tables(page, 'order') for row in each] == [
        '20.000 s' if row['seconds'] else f'did not finish: {row["reason"]}' for row in rows
    ]


def test_a_day_ends_with_hours_without_race_control_and_not_at_midnight(
    tmp_path: pathlib.Path,
) -> None:
    began = (0, 20, 23, 25, 40)  # hours; each run takes one
    times = [(at * 3600 * 10**9, (at + 1) * 3600 * 10**9) for at in began]
    listed = [Session(n, at, None, 1, end, str(n)) for n, (at, end) in enumerate(times)]
    with contextlib.closing(sqlite3.connect(':memory:')) as database:
        runs = Runs(tmp_path, database, listed)
        days = [[each.number for each in runs.day_of(run)] for run in listed]
    assert days == [[0], [1, 2, 3], [1, 2, 3], [1, 2, 3], [4]]
