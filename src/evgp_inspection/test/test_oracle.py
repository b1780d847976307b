# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The oracle over a whole trace, from traces alone."""

from __future__ import annotations

from evgp_inspection.limits import Limits
from evgp_inspection.oracle import breaches, Law
from evgp_inspection.traces import Event, Kind, Trace
from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState
from hypothesis import given, settings
from hypothesis import strategies as st

LIMITS = Limits()
TICK = 0.05


def trace(
    stop: RaceState | None, driven: float, late: float, braking: float, moves_off: float = 1e9
) -> Trace:
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
    return Trace.of(sorted(events, key=lambda event: event.at))


STOPS = st.sampled_from([RaceState.RED_RED, RaceState.RED_FLAG, None])
LAWS = {RaceState.RED_RED: Law.RED, RaceState.RED_FLAG: Law.FLAG, None: Law.LOST}


@settings(deadline=None, max_examples=30)  # the machine may be busy
@given(STOPS, st.floats(0.5, 20.0), st.floats(0.0, 0.4), st.floats(2.5, 12.0))
def test_a_kart_that_brakes_in_time_and_stands_breaks_no_law(
    stop: RaceState | None, driven: float, late: float, braking: float
) -> None:
    assert breaches(trace(stop, driven, late, braking), LIMITS) == []


@settings(deadline=None, max_examples=30)  # the machine may be busy
@given(STOPS, st.floats(0.5, 20.0), st.floats(0.8, 8.0))
def test_a_kart_that_begins_to_brake_late_breaks_the_law_of_what_it_was_told(
    stop: RaceState | None, driven: float, late: float
) -> None:
    found = breaches(trace(stop, driven, late, 12.0), LIMITS)
    assert {breach.law for breach in found} == {LAWS[stop]}


def test_a_stop_that_is_late_after_a_minute_of_driving_is_found() -> None:
    assert breaches(trace(RaceState.RED_RED, 60.0, 7.8, 12.0), LIMITS)


@settings(deadline=None, max_examples=30)  # the machine may be busy
@given(STOPS, st.floats(3.0, 11.0))
def test_a_kart_that_moves_off_long_after_a_stop_is_found(
    stop: RaceState | None, moves_off: float
) -> None:
    found = breaches(trace(stop, 5.0, 0.1, 12.0, moves_off), LIMITS)
    assert {breach.law for breach in found} == {LAWS[stop]}
