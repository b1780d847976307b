# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The score sheet for people, and what one kart did well and badly."""

from __future__ import annotations

from evgp_rcs.record import RecordedEvent
from evgp_rehearsal import sheet
from evgp_rehearsal.conduct import conduct
from evgp_rehearsal.incidents import INCIDENTS
from evgp_rehearsal.score import Line


def happened(*events: tuple[float, str, str | None]) -> list[RecordedEvent]:
    """Return events of kart 7, each at a time (s), of a kind, about a state."""
    return [
        RecordedEvent(at, 0, seconds, kind, 7, None, True, state, '', '')
        for at, (seconds, kind, state) in enumerate(events, start=1)
    ]


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
    assert all(finding.good and not finding.note for finding in findings)


def test_a_kart_that_acknowledges_a_red_at_once_gets_a_note() -> None:
    findings = conduct(happened(*RACE, (9.05, 'ACKNOWLEDGED', 'RED_RED')), 7)
    assert [finding.note for finding in findings] == [False, False, False, True]


def test_a_kart_that_was_away_has_had_time_to_stop() -> None:
    away = ((8.0, 'CONNECTED', None), (9.0, 'KART_STATE', 'RED_RED'))
    findings = conduct(happened(*RACE[:-1], *away, (9.05, 'ACKNOWLEDGED', 'RED_RED')), 7)
    assert not any(finding.note for finding in findings)


def test_a_kart_that_is_late_or_silent_or_garbled_did_badly() -> None:
    for more in (
        ((15.0, 'ACKNOWLEDGED', 'RED_RED'),),
        (),
        ((10.0, 'ACKNOWLEDGED', 'RED_RED'), (11.0, 'MALFORMED', None)),
        ((10.0, 'ACKNOWLEDGED', 'RED_RED'), (11.0, 'WITHDRAWN', 'GREEN_GREEN')),
        ((10.0, 'ACKNOWLEDGED', 'RED_RED'), (11.0, 'DISCONNECTED', None)),
    ):
        assert sum(not each.good for each in conduct(happened(*RACE, *more), 7)) == 1


def test_a_kart_that_had_no_time_to_acknowledge_is_not_blamed() -> None:
    findings = conduct(happened(*RACE, (9.5, 'DISCONNECTED', None), (9.9, 'CONNECTED', None)), 7)
    assert all(finding.good for finding in findings)


def test_the_page_says_what_was_wrong_and_what_would_have_been_right() -> None:
    lines = [
        Line('spin', 3, 12.0, 1.5, 1.5),
        Line('person_on_track', 0, 40.0, None, None, wrong=('RED_FLAG', 'OPEN_TRACK'), people=1),
    ]
    page = sheet.page(lines)
    assert '1 of 2 incidents passed' in page
    for words in ('REHEARSAL', 'RED_FLAG, OPEN_TRACK', 'uses the MSR at once'):
        assert words in page
    cells = dict(zip(sheet.HEADINGS, sheet.row(lines[1]), strict=True))
    assert cells['first right'] == 'never'
    assert f'{INCIDENTS["person_on_track"].limit:.0f} s' in cells['solved']
