# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The oracle over a whole trace, from traces alone."""

from __future__ import annotations

from evgp_inspection.kart_script import STEPS
from evgp_inspection.kart_sentences import BY_NAME
from evgp_inspection.limits import Limits
from evgp_inspection.oracle import LOSSES, Oracle, STANDS, TURNS
from evgp_inspection.traces import describe, Event, Kind
from evgp_inspection.verdicts import judged, Verdict
from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

FRAMES = [encode(state) for state in RaceState]
LIMITS = Limits()
TICK = 0.05


def trace(
    stop: RaceState | None, driven: float, late: float, braking: float, moves_off: float = 1e9
) -> list[Event]:
    """
    Return the trace of a kart that drives, and stops.

    :param stop: what it is sent; None: its connection ends.
    :param driven: time for which it drives, s.
    :param late: time after which it begins to brake, s.
    :param braking: how it slows down, m/s².
    :param moves_off: time after the stop when it drives again by itself, s.
    """
    events = [Event(0.0, Kind.OPENED, 1, text='kart')]
    orders = [(1.0, RaceState.RED_RED), (2.0, RaceState.GRID_ACTIVE), (3.0, RaceState.GREEN_GREEN)]
    stops = 3.0 + driven
    if stop is not None:
        orders.append((stops, stop))
    speed = 0.0
    for tick in range(round((stops + 12.0) / TICK)):
        at = tick * TICK
        sent = [state for since, state in orders if since <= at]
        if sent and (stop is not None or at < stops):
            events.append(Event(at, Kind.SENT, 1, encode(sent[-1])))
            if sent[-1] is not stop:
                events.append(Event(at + 0.01, Kind.UNANSWERED, 1))
                events.append(Event(at + 0.02, Kind.SAID, 1, encode(sent[-1])))
        if stop is None and abs(at - stops) < TICK / 2:
            events.append(Event(at, Kind.CLOSED, 1, text='closed'))
        drives = 3.0 <= at < stops + late or at > stops + moves_off
        speed = 6.0 if drives else max(speed - braking * TICK, 0.0)
        events.append(Event(at + 0.03, Kind.SPEED, value=speed))
    return sorted(events, key=lambda event: event.at)


STOPS = st.sampled_from([RaceState.RED_RED, RaceState.RED_FLAG, None])
STOPPED = {RaceState.RED_RED: 'K-3A-14', RaceState.RED_FLAG: 'K-3A-16', None: 'K-3E-11'}


def failed(events: list[Event]) -> set[str]:
    """Return the sentences that a trace breaks."""
    findings = Oracle.of(events, LIMITS).findings()
    return {name for name, finding in findings.items() if finding.verdict is Verdict.FAIL}


@settings(max_examples=30)
@given(STOPS, st.floats(0.5, 20.0), st.floats(0.0, 0.4), st.floats(2.5, 12.0))
def test_a_kart_that_brakes_in_time_and_stands_breaks_nothing(
    stop: RaceState | None, driven: float, late: float, braking: float
) -> None:
    said = {'K-3A-06', 'K-3A-09'}  # the kart of this trace says no stop
    assert failed(trace(stop, driven, late, braking)) <= said


GAP = 2 * LIMITS.slack + 0.1


@pytest.mark.parametrize('begins', [8.2, 12.0, 18.5])
def test_a_stop_whose_odometry_has_a_gap_is_not_judged(begins: float) -> None:
    events = [
        event
        for event in trace(RaceState.RED_RED, 5.0, 0.1, 12.0)
        if not (event.kind is Kind.SPEED and begins < event.at < begins + GAP)
    ]
    findings = Oracle.of(events, LIMITS).findings()
    assert findings['K-3A-14'].verdict is Verdict.NOT_JUDGED
    assert findings['K-3A-15'].verdict is Verdict.NOT_JUDGED


def test_a_breach_stays_one_whatever_cannot_be_judged_after_it() -> None:
    moves_off = trace(RaceState.RED_RED, 5.0, 0.1, 12.0, moves_off=6.0)
    unseen = [
        event._replace(at=event.at + 40.0, link=2)
        for event in trace(RaceState.RED_RED, 5.0, 0.1, 12.0)
        if not (event.kind is Kind.SPEED and 8.2 < event.at < 8.2 + GAP)
    ]
    findings = Oracle.of([*moves_off, *unseen], LIMITS).findings()
    assert findings['K-3A-15'].verdict is Verdict.FAIL
    assert findings['K-3A-14'].verdict is Verdict.NOT_JUDGED


@pytest.mark.parametrize('stop', [RaceState.RED_RED, None])
@pytest.mark.parametrize('again', [0.45, 0.85, -0.5])
def test_a_kart_that_gets_faster_again_while_it_brakes_is_found(
    stop: RaceState | None, again: float
) -> None:
    def speed(since: float) -> float:
        if since > 3.0:
            return max(6.0 * again - 12.0 * (since - 3.0), 0.0)
        return 6.0 * again if since > 1.3 else max(6.0 - 5.0 * max(since, 0.0), 0.3)

    events = [
        event._replace(value=speed(event.at - 5.0))
        if event.kind is Kind.SPEED and event.at > 5.0
        else event
        for event in trace(stop, 2.0, 0.0, 12.0)
    ]
    assert STOPPED[stop] in failed(events)


LATE = 5.0 + LIMITS.red_red + 0.5
"""When the kart of a trace stops after 2 s, and the time to say so has passed, s."""


@pytest.mark.parametrize(
    ('more', 'breaks'),
    [
        (
            [
                Event(LATE, Kind.UNANSWERED, 1),
                Event(LATE, Kind.SAID, 1, encode(RaceState.RED_RED)),
            ],
            'K-3A-09',
        ),
        ([Event(4.0, Kind.ANSWER, text=TURNS, value=0.0)], 'K-3A-05'),
    ],
    ids=['acknowledges too late', 'is seen to stand'],
)
def test_a_kart_that_does_too_little_is_found(more: list[Event], breaks: str) -> None:
    events = [*trace(RaceState.RED_RED, 2.0, 0.1, 12.0), *more]
    assert breaks in failed(sorted(events, key=lambda event: event.at))


def test_a_computer_that_was_held_up_fails_nobody() -> None:
    events = trace(RaceState.RED_RED, 2.0, 3.0, 12.0)
    for late, verdict in ((9.0, Verdict.NOT_JUDGED), (40.0, Verdict.FAIL)):
        held_up = Event(late, Kind.HELD_UP, value=3.0)
        findings = Oracle.of([*events, held_up], LIMITS).findings()
        (finding,) = judged(findings, [BY_NAME['K-3A-14']]).values()
        assert finding.verdict is verdict


# Made once: to make a strategy anew for each event takes longer than to draw from it.
AFTER, LINKS = st.sampled_from([0.0, 0.01, 0.3, 1.0, 6.0]), st.integers(1, 3)
KINDS, SPEEDS = st.sampled_from(Kind), st.floats()
BYTES = st.sampled_from(FRAMES) | st.binary(max_size=40)
TEXTS = st.sampled_from([*STEPS, *LOSSES, STANDS, TURNS])


@st.composite
def traces(draw: st.DrawFn) -> list[Event]:
    """Any events in any order, their times ascending."""
    events = []
    at = 0.0
    for _ in range(draw(st.integers(0, 60))):
        at += draw(AFTER)
        kind = draw(KINDS)
        data = draw(BYTES) if kind in (Kind.SENT, Kind.SAID) else b''
        value = draw(SPEEDS) if kind is Kind.SPEED else 1.0
        events.append(Event(at, kind, draw(LINKS), data, draw(TEXTS), value))
    return events


@given(events=traces())
def test_every_trace_has_findings_on_sentences_that_exist_and_their_evidence_is_in_it(
    events: list[Event],
) -> None:
    judged = Oracle.of(events, LIMITS)
    for name, finding in judged.findings().items():
        assert name in BY_NAME
        assert finding.why
        known = {id(event) for event in judged.trace.events}
        assert all(id(event) in known for event in finding.evidence)
        describe(finding.evidence)
