# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What one kart did well and badly."""

from __future__ import annotations

from typing import Any

from evgp_protocol.states import RaceState
from evgp_rcs.rules.race import Event, EventKind, StampedEvent
from evgp_rehearsal.conduct import conduct, Cut, LIMITS


def happened(*events: tuple[float, str, str | None]) -> list[StampedEvent]:
    """Return events of kart 7, each at a time (s), of a kind, about a state."""
    return [
        StampedEvent(
            at, 0, seconds, Event(EventKind[kind], '', 7, RaceState[state] if state else None)
        )
        for at, (seconds, kind, state) in enumerate(events, start=1)
    ]


def bad(*events: tuple[float, str, str | None], **more: Any) -> int:
    """Return how often kart 7 did badly."""
    return sum(not finding.good for finding in conduct(happened(*events), 7, **more))


RACE = (
    (0.0, 'CONNECTED', None),
    (1.0, 'KART_STATE', 'GRID_ACTIVE'),
    (2.0, 'ACKNOWLEDGED', 'GRID_ACTIVE'),
    (3.0, 'KART_STATE', 'GREEN_GREEN'),
    (3.5, 'ACKNOWLEDGED', 'GREEN_GREEN'),
    (9.0, 'KART_STATE', 'RED_RED'),
)


def test_a_kart_that_acknowledges_in_time_did_nothing_badly() -> None:
    findings = conduct(happened(*RACE, (10.0, 'ACKNOWLEDGED', 'RED_RED')), 7)
    assert len(findings) == 3
    assert all(finding.good for finding in findings)


def test_a_stop_that_is_acknowledged_while_the_kart_races_is_bad() -> None:
    findings = conduct(happened(*RACE, (9.05, 'ACKNOWLEDGED', 'RED_RED')), 7)
    assert [finding.good for finding in findings] == [True, True, False]


def test_another_stop_gives_a_racing_kart_no_time() -> None:
    flagged = ((8.95, 'KART_STATE', 'RED_FLAG'), RACE[-1], (9.05, 'ACKNOWLEDGED', 'RED_RED'))
    assert bad(*RACE[:-1], *flagged) == 1
    stood = ((5.0, 'KART_STATE', 'RED_FLAG'), (8.0, 'ACKNOWLEDGED', 'RED_FLAG'), *flagged[1:])
    assert bad(*RACE[:-1], *stood) == 0


def test_a_kart_that_is_back_at_once_and_says_it_stands_did_badly() -> None:
    for waited, expected in ((0.1, 1), (2.0, 0)):
        back = 9.0 + waited
        findings = conduct(
            happened(
                *RACE[:-1],
                (9.0, 'DISCONNECTED', None),
                (back, 'CONNECTED', None),
                (back, 'KART_STATE', 'RED_RED'),
                (back + 0.05, 'ACKNOWLEDGED', 'RED_RED'),
            ),
            7,
            cut=Cut(9.0, 1),
        )
        assert sum(not finding.good for finding in findings) == expected


def test_a_lost_connection_is_bad_unless_the_incident_ended_it() -> None:
    lost = (
        *RACE,
        (10.0, 'ACKNOWLEDGED', 'RED_RED'),
        (12.0, 'DISCONNECTED', None),
        (12.3, 'CONNECTED', None),
    )
    assert bad(*lost) == 1
    assert bad(*lost, cut=Cut(11.0, 1)) == 0
    assert bad(*lost, cut=Cut(13.0, 1)) == 1
    again = (*lost, (13.0, 'DISCONNECTED', None), (13.3, 'CONNECTED', None))
    assert bad(*again, cut=Cut(11.0, 1)) == 1
    assert bad(*again, cut=Cut(11.0, 2)) == 0


def test_a_kart_has_the_whole_limit_where_the_race_was_cut_short() -> None:
    assert bad(*RACE, until=9.0 + LIMITS[RaceState.RED_RED] - 0.1) == 0
    assert bad(*RACE, until=9.0 + LIMITS[RaceState.RED_RED] + 0.1) == 1


def test_a_kart_that_is_late_or_silent_or_garbled_did_badly() -> None:
    for more in (
        ((15.0, 'ACKNOWLEDGED', 'RED_RED'),),
        (),
        ((10.0, 'ACKNOWLEDGED', 'RED_RED'), (11.0, 'MALFORMED', None)),
        ((10.0, 'ACKNOWLEDGED', 'RED_RED'), (11.0, 'WITHDRAWN', 'GREEN_GREEN')),
        ((10.0, 'ACKNOWLEDGED', 'RED_RED'), (11.0, 'DISCONNECTED', None)),
        ((10.0, 'ACKNOWLEDGED', 'RED_RED'), (11.0, 'REFUSED_CONNECTION', None)),
    ):
        assert bad(*RACE, *more) == 1


def test_a_kart_that_had_no_time_to_acknowledge_is_not_blamed_for_that() -> None:
    gone = ((9.5, 'DISCONNECTED', None), (9.9, 'CONNECTED', None))
    assert bad(*RACE, *gone, cut=Cut(9.4, 1)) == 0
