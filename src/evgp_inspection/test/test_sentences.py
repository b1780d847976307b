# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The table of sentences, the report, and which words count, from traces alone."""

from __future__ import annotations

import dataclasses
import json
import pathlib
from typing import Any

from evgp_inspection.kart_script import STEPS
from evgp_inspection.kart_sentences import BY_NAME, KART
from evgp_inspection.limits import Limits
from evgp_inspection.oracle import Oracle
from evgp_inspection.report import as_html, as_json
from evgp_inspection.traces import Event, Kind
from evgp_inspection.verdicts import Finding, Inspection, judged, select, Verdict
from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState
from hypothesis import given
from hypothesis import strategies as st
import pytest

LIMITS = Limits()
IN_GARAGE, RED_RED = RaceState.IN_GARAGE, RaceState.RED_RED
ROOT = pathlib.Path(__file__).parents[3]


def told(*sent: tuple[float, RaceState]) -> list[Event]:
    """Return the trace of a kart that is sent these states, and whose TCP has them."""
    events = [
        Event(0.0, Kind.OPENED, 1, text='kart'),
        Event(0.0, Kind.SENT, 1, encode(RED_RED)),
        Event(0.1, Kind.UNANSWERED, 1),
        Event(0.2, Kind.SAID, 1, encode(RED_RED)),
    ]
    for at, state in sent:
        events.append(Event(at, Kind.SENT, 1, encode(state)))
        events.append(Event(at + 0.1, Kind.UNANSWERED, 1))
    return events


def acknowledged(*events: Event) -> bool:
    """Return whether a trace shows that the kart has acknowledged RED_RED."""
    return Oracle.of(events, LIMITS).trace.acknowledged(RED_RED)


def test_a_word_that_nothing_follows_answers_the_last_order() -> None:
    def frames(since: float) -> list[Event]:
        return [Event(since + 0.05 * n, Kind.SENT, 1, encode(RED_RED)) for n in range(50)]

    first, *orders = told((3.0, IN_GARAGE), (3.1, RED_RED))
    word = Event(3.25, Kind.SAID, 1, encode(RED_RED))
    told_so = sorted([*frames(0.25), *orders, word], key=lambda event: event.at)
    assert not acknowledged(first, *told_so)
    assert acknowledged(first, *told_so, *frames(3.3))


def test_a_pause_shows_that_a_kart_has_read_what_its_tcp_had_but_a_hold_up_is_none() -> None:
    before = told((1.0, IN_GARAGE))
    order = [Event(5.0, Kind.SENT, 1, encode(RED_RED)), Event(5.1, Kind.UNANSWERED, 1)]
    word = Event(5.2, Kind.SAID, 1, encode(RED_RED))
    assert not acknowledged(*before, *order, word)
    frames = [Event(1.2 + 0.05 * n, Kind.SENT, 1, encode(IN_GARAGE)) for n in range(70)]
    assert acknowledged(*before, *frames, *order, word)


def test_a_word_that_was_under_way_before_the_kart_had_the_order_does_not_count() -> None:
    red = Event(0.0, Kind.SENT, 1, encode(RED_RED))
    word = Event(0.3, Kind.SAID, 1, encode(RED_RED))
    for unanswered, counts in ((0, True), (9, False)):
        look = Event(0.2, Kind.UNANSWERED, 1, value=unanswered, unread=len(word.data))
        assert acknowledged(red, look, word) is counts


# ----- the table ---------------------------------------------------------------------------


def test_every_step_is_one_that_a_clause_needs() -> None:
    assert {step for clause in KART for step in clause.steps} == {*STEPS}


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
        found = {each: Finding(Verdict.PASS, 'so') for each in BY_NAME.values()}
        found[clause] = Finding(Verdict.NOT_JUDGED, 'so')
        verdict = Inspection(found, LIMITS, finished=True).verdict
        assert (verdict is Verdict.PASS) != clause.starred


def test_a_clause_that_only_a_hold_up_excuses_is_no_pass_of_the_whole() -> None:
    held_up = Event(1.0, Kind.HELD_UP, value=1.0)
    for clause in KART:
        findings = {each.name: Finding(Verdict.PASS, 'so') for each in KART}
        findings[clause.name] = Finding(Verdict.FAIL, 'so', evidence=(held_up,))
        found = judged(findings, KART)
        assert Inspection(found, LIMITS, finished=True).verdict is Verdict.NOT_JUDGED


# ----- the report --------------------------------------------------------------------------


def inspected(verdict: Verdict, why: str = 'so it was', **known: Any) -> Inspection:
    checks = {clause: Finding(verdict, why, 1.0) for clause in KART[:2]}
    return Inspection(checks, LIMITS, **{'finished': True, **known})


@given(st.text(max_size=60), st.text(max_size=60))
def test_a_report_is_well_formed_whatever_people_and_karts_are_called(team: str, why: str) -> None:
    assert json.loads(as_json(inspected(Verdict.FAIL, why, team=team)))['team'] == team
    page = as_html(inspected(Verdict.FAIL, why, team='<script>alert(1)</script>'))
    assert '<script' not in page
    assert 'http' not in page


def test_a_report_quotes_each_sentence_that_was_broken_and_no_other() -> None:
    found = {each: Finding(verdict, 'so') for each, verdict in zip(KART, Verdict, strict=False)}
    page = as_html(Inspection(found, LIMITS))
    quoted = [found[each] for each in found if f'<h2>{each.name} ' in page]
    assert [each.verdict for each in quoted] == [Verdict.FAIL]


def test_a_report_shows_the_limits_that_were_used() -> None:
    (clause, *_) = (each for each in KART if each.limit)
    limits = dataclasses.replace(LIMITS, **{clause.limit: 77.5})
    inspection = Inspection({clause: Finding(Verdict.PASS, 'so', 1.0)}, limits)
    (check,) = json.loads(as_json(inspection))['checks']
    assert check['limit_s'] == 77.5
    assert '1.00 s of 77.5 s' in as_html(inspection)


def test_a_report_on_an_inspection_that_was_not_finished_is_no_pass() -> None:
    for finished, verdict in ((True, 'pass'), (False, 'not judged')):
        inspection = inspected(Verdict.PASS, finished=finished)
        assert json.loads(as_json(inspection))['verdict'] == verdict
        assert f'<h1>{verdict.upper()}' in as_html(inspection)


def test_a_report_holds_what_odometry_says_when_it_says_nonsense() -> None:
    events = (Event(0.0, Kind.SPEED, value=float('nan')), Event(0.1, Kind.SPEED, value=1e999))
    found = {KART[0]: Finding(Verdict.FAIL, 'so it was', None, events)}
    (check,) = json.loads(as_json(Inspection(found, LIMITS)))['checks']
    assert [each['value'] for each in check['evidence']] == [None, None]
