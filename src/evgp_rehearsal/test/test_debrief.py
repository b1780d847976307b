# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The debrief: what it says of an incident, by the record and by the truth of the field."""

from __future__ import annotations

import pathlib
from typing import Any

from evgp_node.results import Act, Corrected, Correction, Identity
from evgp_node.stream_file import BOOK
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import Event, EventKind, StampedEvent
from evgp_rehearsal.debrief import debrief, Occurrence
from evgp_rehearsal.event import corrected
from evgp_rehearsal.field import Crossing, Truth
from evgp_rehearsal.incidents import INCIDENTS
from evgp_timing.book import Book


def ticks(seconds: float) -> int:
    """Return a time in ticks; the incident begins at 10 s."""
    return round((10 + seconds) / 0.05)


def happened(*events: tuple[float, str, int, dict[str, Any]]) -> list[StampedEvent]:
    """Return events, each with its time after the beginning of the incident (s)."""
    return [
        StampedEvent(
            at, 0, 10 + seconds, Event(EventKind[kind], more.pop('text', ''), kart, **more)
        )
        for at, (seconds, kind, kart, more) in enumerate(events, start=1)
    ]


def gave(seconds: float, command: str, **more: Any) -> tuple[float, str, int, dict[str, Any]]:
    """Return that Anna gave a command."""
    given = {'command': CommandKind[command], 'official': 'Anna', **more}
    return seconds, 'COMMAND', given.pop('kart', 0), given


def sent(seconds: float, kart: int, state: RaceState) -> tuple[float, str, int, dict[str, Any]]:
    """Return that a kart is sent a state."""
    return seconds, 'KART_STATE', kart, {'state': state}


def lines(
    incident: str, *events: tuple[float, str, int, dict[str, Any]], kart: int = 0, **truth: Any
) -> list[str]:
    """Return the debrief of an incident of 60 s."""
    took = Occurrence(incident, kart, ticks(0), ticks(60))
    return debrief(took, happened(*events), Truth(**truth))


def test_it_says_what_was_heard_what_was_pressed_and_the_rule_books_order() -> None:
    told = lines(
        'spin',
        gave(-5.0, 'GREEN_GREEN', text='before the incident'),
        gave(3.2, 'RED_FLAG', text='RED_FLAG sent to karts 1, 2.'),
        gave(4.0, 'GREEN_GREEN', text='GREEN_GREEN refused: no.', success=False),
        (5.0, 'ALERT_RAISED', 1, {'text': 'kart 1 is late'}),
        (6.0, 'RACE_STATE', 0, {'text': 'every kart has finished'}),
        kart=1,
        messages=((ticks(0.0), 'kart 1 has spun'),),
    )
    assert told == [
        'spin (kart 1): a kart spins in front of others',
        '  began at 10.0 s of the rehearsal and lasted 60.0 s',
        '     0.0 s  radio: kart 1 has spun',
        '     3.2 s  Anna sent RED_FLAG: RED_FLAG sent to karts 1, 2',
        '     4.0 s  Anna sent GREEN_GREEN: refused: no',
        '     5.0 s  alert: kart 1 is late',
        '     6.0 s  every kart has finished',
        f'  the rule book: {INCIDENTS["spin"].order}',
    ]


def test_it_says_how_long_which_kart_moved_after_which_order_to_stand() -> None:
    moving = [(ticks(-8), kart, True) for kart in (1, 2, 3)]
    moving += [(ticks(3.5), 1, False), (ticks(9), 2, False)]
    told = lines(
        'msr_needed',
        *(sent(-9.0, kart, RaceState.GREEN_GREEN) for kart in (1, 2, 3)),
        *(sent(2.0, kart, RaceState.RED_FLAG) for kart in (2, 3)),
        sent(2.0, 1, RaceState.RED_RED),
        *(sent(8.0, kart, RaceState.RED_RED) for kart in (2, 3)),
        kart=3,
        moving=tuple(moving),
    )
    assert told[2:-1] == [
        '  moved after RED_FLAG at 2.0 s: kart 2 for 6.0 s, kart 3 for 6.0 s',
        '  moved after RED_RED at 2.0 s: kart 1 for 1.5 s',
        '  moved after RED_RED at 8.0 s: kart 2 for 1.0 s, kart 3 for 52.0 s and is still moving',
    ]


def test_karts_that_are_lost_together_make_one_line_and_must_stop() -> None:
    told = lines(
        'reconnect_storm',
        *((1.0 + kart / 10, 'DISCONNECTED', kart, {}) for kart in (1, 2)),
        *((4.0 + kart / 10, 'CONNECTED', kart, {}) for kart in (1, 2)),
        moving=((ticks(-8), 1, True), (ticks(2.6), 1, False)),
    )
    assert told[2:-1] == [
        '     1.1 s  karts 1, 2: connection lost',
        '     4.1 s  karts 1, 2: connected',
        '  moved after the loss of its connection at 1.1 s: kart 1 for 1.5 s',
    ]


def test_it_says_when_the_msr_was_used_and_recorded_where_a_person_was_among_karts() -> None:
    told = lines(
        'person_on_track',
        gave(25.0, 'ALL_KILL', text='ALL_KILL'),
        gave(26.0, 'RECORD_MSR', text='recorded'),
        gave(33.0, 'RECORD_MSR', text='recorded'),
        people=((ticks(0), True),),
        msr=(ticks(-5), ticks(31)),  # also in the incident before, after which all was repaired
    )
    assert told[2:-1] == [
        '     0.0 s  a person is on the track',
        '    25.0 s  Anna sent ALL_KILL: ALL_KILL',
        '    26.0 s  Anna sent RECORD_MSR: recorded - the MSR had not been used yet',
        '    31.0 s  the MSR is used',
        '    33.0 s  Anna sent RECORD_MSR: recorded',
    ]
    assert told[-1].endswith('humans are in danger (§3.D)')


def test_it_says_that_people_were_let_in_while_a_kart_moved_or_karts_sent_to_a_person() -> None:
    told = lines(
        'person_on_track',
        gave(1.0, 'IN_GARAGE', text='sent'),
        gave(9.0, 'GRID_ACTIVE', text='refused', success=False),
        gave(10.0, 'GRID_ACTIVE', text='sent'),
        gave(50.0, 'GRID_ACTIVE', text='sent'),
        moving=((ticks(-8), 1, True), (ticks(2), 1, False)),
        people=((ticks(0), True), (ticks(40), False)),
    )
    assert told[3:7] == [
        '     1.0 s  Anna sent IN_GARAGE: sent - WHILE KART 1 MOVED',
        '     9.0 s  Anna sent GRID_ACTIVE: refused',
        '    10.0 s  Anna sent GRID_ACTIVE: sent - WITH A PERSON ON THE TRACK',
        '    40.0 s  a person is off the track',
    ]
    assert told[7] == '    50.0 s  Anna sent GRID_ACTIVE: sent'


def test_it_says_what_officials_asked_the_timekeeper_for_and_who_was_at_the_line() -> None:
    asked = (
        Correction(Act.STRIKE, 'Anna', passing=Identity('line', 'x', 12), reason='x'),
        Correction(Act.STRIKE, 'Anna', passing=Identity('line', 'x', 13), reason='x'),
        Correction(Act.COUNT, kart=3),
        Correction(Act.PUBLISH, 'too late'),
    )
    crossings = [Crossing(0.0, 9, real=True)] * 11
    crossings += [Crossing(0.0, 4, real=True), Crossing(0.0, 3, real=False)]
    told = debrief(
        Occurrence('false_passing', 3, ticks(0), ticks(60)),
        [],
        Truth(crossings=crossings),
        [Corrected(10 + 20.0 * at + 5.0, each) for at, each in enumerate(asked)],
    )
    assert told[2:-1] == [
        '     5.0 s  Anna sent the timekeeper STRIKE PASSING for line 12 - kart 4 crossed '
        'the line there',
        '    25.0 s  Anna sent the timekeeper STRIKE PASSING for line 13 - kart 3 did not cross '
        'the line there',
        '    45.0 s  someone sent the timekeeper LAP for kart 3',
    ]


def test_corrections_from_before_and_after_a_restart_of_the_timekeeper_are_found(
    tmp_path: pathlib.Path,
) -> None:
    given = [Corrected(at, Correction(Act.COUNT, 'Ben', 7)) for at in (10.0, 20.0)]
    for each in given:
        book = Book(tmp_path / BOOK)
        book.write(each)
        book.close()
    assert corrected(tmp_path) == given
