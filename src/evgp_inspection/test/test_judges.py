# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The judges and the report, from traces alone."""

from __future__ import annotations

import dataclasses
import json
import pathlib
import re

from evgp_inspection.kart_clauses import BY_NAME, KART, KART_STEPS
from evgp_inspection.limits import Limits
from evgp_inspection.report import as_html, as_json, Header
from evgp_inspection.traces import describe, Event, Kind, Trace
from evgp_inspection.verdicts import Finding, judge, Result, select, Verdict, verdict_on
from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

LIMITS = Limits()
RED_RED, GREEN_GREEN = RaceState.RED_RED, RaceState.GREEN_GREEN
ROOT = pathlib.Path(__file__).parents[3]

PHASES = sorted({phase for clause in BY_NAME.values() for phase in clause.judge.phases})
FRAMES = [encode(state) for state in RaceState]


@st.composite
def traces(draw: st.DrawFn) -> list[Event]:
    """Any events in any order, their times ascending."""
    events = []
    at = 0.0
    for _ in range(draw(st.integers(0, 40))):
        at += draw(st.sampled_from([0.0, 0.01, 0.3, 1.0, 6.0]))
        kind = draw(st.sampled_from(Kind))
        data = b''
        if kind in (Kind.SENT, Kind.SAID):
            data = draw(st.one_of(st.sampled_from(FRAMES), st.binary(max_size=40)))
        text = draw(st.sampled_from(PHASES)) if kind is Kind.STEP else 'kart 1'
        value = draw(st.floats()) if kind is Kind.SPEED else 1.0
        events.append(Event(at, kind, draw(st.integers(1, 3)), data, text, value))
    return events


@settings(deadline=None)  # the machine may be busy
@given(events=traces())
def test_every_trace_has_a_verdict_for_every_clause_and_its_evidence_is_in_the_trace(
    events: list[Event],
) -> None:
    trace = Trace.of(events)
    for clause in BY_NAME.values():
        finding = judge(BY_NAME, clause, trace, LIMITS).finding
        assert finding.why
        known = {id(event) for event in trace.events}
        assert all(id(event) in known for event in finding.evidence)
        describe(finding.evidence)


def test_of_nothing_nothing_is_judged() -> None:
    for clause in BY_NAME.values():
        assert judge(BY_NAME, clause, Trace(), LIMITS).verdict is Verdict.NOT_JUDGED


def judged(name: str, trace: Trace) -> Result:
    return judge(BY_NAME, BY_NAME[name], trace, LIMITS)


def stop(delay: float, speed: float, turns_for: float) -> Trace:
    """Return the trace of a RED_RED to a kart that drives."""
    events = [
        Event(0.0, Kind.STEP, text='red/green'),
        Event(0.0, Kind.OPENED, 1, text='kart'),
        Event(0.1, Kind.SENT, 1, encode(GREEN_GREEN)),
        Event(0.2, Kind.SAID, 1, encode(GREEN_GREEN)),
        Event(2.0, Kind.STEP, text='red/red'),
        Event(2.0, Kind.SENT, 1, encode(RED_RED)),
        Event(2.0 + delay, Kind.SAID, 1, encode(RED_RED)),
    ]
    for step in range(200):
        at = 2.0 + step * 0.02
        events.append(Event(at, Kind.SPEED, value=speed if at < 2.0 + turns_for else 0.0))
    return Trace.of(sorted(events, key=lambda event: event.at))


@pytest.mark.parametrize('turns_for', [0.3, 1.0, 2.0])
@pytest.mark.parametrize('delay', [0.001, 0.05, 0.5, 1.0, 1.9, 2.5])
def test_a_stop_that_is_acknowledged_fails_while_the_wheels_turn_and_only_then(
    delay: float, turns_for: float
) -> None:
    result = judged('K-3A-10', stop(delay, 5.0, turns_for))
    too_early = delay + LIMITS.slack < turns_for - 0.02 or delay < LIMITS.fastest_stop
    assert (result.verdict is Verdict.FAIL) == too_early


@pytest.mark.parametrize(
    ('says', 'turns', 'verdict'),
    [
        (0.01, (0.3, 1.2), Verdict.FAIL),  # its dead time: it had been told to drive
        (0.5, (0.0, 0.4), Verdict.PASS),
        (0.01, (0.0, 0.0), Verdict.PASS),
    ],
    ids=['begins to move after its word', 'says it when it stands', 'never moves'],
)
def test_a_stop_right_after_green_fails_a_kart_that_moves_after_its_word(
    says: float, turns: tuple[float, float], verdict: Verdict
) -> None:
    events = [
        *stop(1.9, 5.0, 1.0).events,
        Event(8.8, Kind.STEP, text='early/green'),
        Event(8.8, Kind.SENT, 1, encode(GREEN_GREEN)),
        Event(9.0, Kind.STEP, text='early/red'),
        Event(9.0, Kind.SENT, 1, encode(RED_RED)),
        Event(9.0 + says, Kind.SAID, 1, encode(RED_RED)),
    ]
    for step in range(100):
        since = step * 0.02
        moves = turns[0] <= since < turns[1]
        events.append(Event(9.0 + since, Kind.SPEED, value=0.4 if moves else 0.0))
    trace = Trace.of(sorted(events, key=lambda event: event.at))
    assert judged('K-3A-14', trace).verdict is verdict


def test_a_stop_that_finds_the_kart_standing_shows_nothing() -> None:
    assert judged('K-3A-10', stop(0.5, 0.0, 0.0)).verdict is Verdict.NOT_JUDGED


def told(*sent: tuple[float, RaceState], read: bool) -> list[Event]:
    """Return the trace of a kart that is sent these states, and of whether its TCP has them."""
    events = [
        Event(0.0, Kind.OPENED, 1, text='kart'),
        Event(0.0, Kind.SENT, 1, encode(RED_RED)),
        Event(0.1, Kind.UNANSWERED, 1),
        Event(0.2, Kind.SAID, 1, encode(RED_RED)),
    ]
    for at, state in sent:
        frame = encode(state)
        events.append(Event(at, Kind.STEP, text='pieces/bytes'))
        events.append(Event(at, Kind.SENT, 1, frame))
        outstanding = 0.0 if read else float(len(frame))
        events.append(Event(at + 0.1, Kind.UNANSWERED, 1, value=outstanding))
    return events


IN_GARAGE = RaceState.IN_GARAGE


def test_a_word_that_can_answer_an_earlier_order_counts_for_that_one() -> None:
    events = told((1.0, IN_GARAGE), (2.0, RED_RED), read=True)
    late = Event(2.2, Kind.SAID, 1, encode(RED_RED))
    assert not Trace.of([*events, late]).acknowledged(RED_RED)
    said = Event(2.15, Kind.SAID, 1, encode(IN_GARAGE))
    assert Trace.of([*events, said, late]).acknowledged(RED_RED)


def test_a_pause_shows_that_a_kart_has_read_what_its_tcp_had_but_a_hold_up_is_none() -> None:
    before = told((1.0, IN_GARAGE), read=True)
    order = [Event(5.0, Kind.SENT, 1, encode(RED_RED)), Event(5.1, Kind.UNANSWERED, 1)]
    word = Event(5.2, Kind.SAID, 1, encode(RED_RED))
    assert not Trace.of([*before, *order, word]).acknowledged(RED_RED)
    frames = [Event(1.2 + 0.05 * n, Kind.SENT, 1, encode(IN_GARAGE)) for n in range(70)]
    assert Trace.of([*before, *frames, *order, word]).acknowledged(RED_RED)


def test_a_word_that_was_under_way_before_the_kart_had_the_order_does_not_count() -> None:
    red = Event(0.0, Kind.SENT, 1, encode(RED_RED))
    word = Event(0.3, Kind.SAID, 1, encode(RED_RED))
    for unanswered, counts in ((0, True), (9, False)):
        look = Event(0.2, Kind.UNANSWERED, 1, value=unanswered, unread=len(word.data))
        assert Trace.of([red, look, word]).acknowledged(RED_RED) is counts


def test_a_computer_that_was_held_up_fails_nobody() -> None:
    trace = stop(0.001, 5.0, 1.0)
    events = [*trace.events, Event(7.0, Kind.HELD_UP, value=0.9)]
    result = judged('K-3A-10', Trace.of(events))
    assert result.verdict is Verdict.NOT_JUDGED


@pytest.mark.parametrize(
    ('noticed', 'seconds', 'verdict'),
    [
        (2.0, 1.2, 'fail'),
        (4.9, 1.2, 'not judged'),
        (5.2, 1.2, 'not judged'),
        (9.0, 1.2, 'fail'),
        (9.0, 3.8, 'not judged'),
    ],
)
def test_a_connection_that_is_dropped_right_after_a_hold_up_fails_nobody(
    noticed: float, seconds: float, verdict: str
) -> None:
    # The kart took it for silence, as it must. That may be read before the hold-up is noticed.
    events = [
        Event(0.0, Kind.OPENED, 1, text='kart'),
        Event(5.0, Kind.STEP, text='pieces/many'),
        Event(5.0, Kind.SENT, 1, encode(RED_RED)),
        Event(5.1, Kind.CLOSED, 1, text='closed'),
        Event(5.15, Kind.STEP, text='pieces/many_after'),
        Event(noticed, Kind.HELD_UP, value=seconds),
    ]
    trace = Trace.of(sorted(events, key=lambda event: event.at))
    result = judged('K-4C-03', trace)
    assert result.verdict.value == verdict
    shown = any(event.kind is Kind.HELD_UP for event in result.finding.evidence)
    assert shown == (verdict != 'fail')


@settings(deadline=None)  # the machine may be busy
@given(st.lists(st.binary(max_size=20), max_size=20))
def test_it_does_not_matter_how_the_words_of_a_kart_are_cut(pieces: list[bytes]) -> None:
    def words(parts: list[bytes]) -> list[tuple[RaceState | None, str]]:
        trace = Trace.of(Event(1.0, Kind.SAID, 1, part) for part in parts)
        return [(said.state, said.reason) for said in trace.now.said]

    whole = b''.join(pieces)
    assert words(pieces) == words([whole]) == words([bytes([each]) for each in whole])


# ----- the table ---------------------------------------------------------------------------


def test_every_clause_has_a_name_of_its_own_and_steps_and_limits_that_exist() -> None:
    assert tuple(BY_NAME.values()) == KART
    for clause in BY_NAME.values():
        assert re.fullmatch(r'K-\d[A-F]-\d\d', clause.name)
        assert set(clause.steps) <= set(KART_STEPS)
        assert not clause.judge.limit or hasattr(LIMITS, clause.judge.limit)
        assert clause.name in clause.explain()
        for cause in clause.unless:
            assert cause != clause.name
            assert clause.name not in BY_NAME[cause].unless  # they would excuse each other


def test_a_sentence_of_a_document_is_in_it() -> None:
    for clause in BY_NAME.values():
        if clause.source != 'proposal':
            text = (ROOT / clause.source).read_text(encoding='utf-8')
            assert clause.sentence in ' '.join(text.split())


def test_clauses_are_selected_by_the_beginnings_of_their_names() -> None:
    assert [each.name for each in select(KART, 'k-3a-07, K-4D-01')] == ['K-3A-07', 'K-4D-01']
    assert all(each.name.startswith('K-4D') for each in select(KART, 'K-4D'))
    assert select(KART, '') == KART
    with pytest.raises(ValueError, match='K-9'):
        select(KART, 'K-3A-07,K-9')


def test_an_inspection_is_no_pass_while_a_starred_clause_was_not_judged() -> None:
    for clause in BY_NAME.values():
        found = [
            Result(each, Finding(Verdict.NOT_JUDGED if each is clause else Verdict.PASS, 'so'))
            for each in BY_NAME.values()
        ]
        assert (verdict_on(found) is Verdict.PASS) != clause.judge.starred


# ----- the report --------------------------------------------------------------------------

HEADER = Header('kart 7', 'A & <B>', 'Ada "\x00"', '2026-05-01T10:00:00+02:00', 100.0, {})


def results(verdict: Verdict, why: str = 'so it was') -> list[Result]:
    return [Result(clause, Finding(verdict, why, 1.0, ()), 5.0) for clause in KART]


@settings(deadline=None)  # the machine may be busy
@given(st.text(max_size=60), st.text(max_size=60))
def test_a_report_is_well_formed_whatever_people_and_karts_are_called(team: str, why: str) -> None:
    header = dataclasses.replace(HEADER, team=team)
    failed = results(Verdict.FAIL, why)
    assert json.loads(as_json(header, failed))['team'] == team
    page = as_html(dataclasses.replace(HEADER, team='<script>alert(1)</script>'), failed)
    assert '<script' not in page
    assert 'http' not in page


def test_a_report_holds_what_odometry_says_when_it_says_nonsense() -> None:
    events = (Event(0.0, Kind.SPEED, value=float('nan')), Event(0.1, Kind.SPEED, value=1e999))
    result = Result(KART[0], Finding(Verdict.FAIL, 'so it was', None, events))
    (check,) = json.loads(as_json(HEADER, [result]))['checks']
    assert [each['value'] for each in check['evidence']] == [None, None]
