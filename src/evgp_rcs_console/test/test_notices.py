# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Alerts until they are seen, and the event log."""

from __future__ import annotations

from typing import Any

from evgp_node.codec import message_of, value_of
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import Alert, AlertKind, Availability, Event, EventKind, StampedEvent
from evgp_rcs.rules.snapshot import Snapshot
from evgp_rcs.words import time_of_day
from evgp_rcs_console.client import spoken
from evgp_rcs_console.notices import (
    ALERT_WAS,
    AlertBook,
    EventLog,
    NEW_RUN,
    OfficialNames,
    summary,
)
from evgp_rcs_msgs import msg
from example_race import KART, offers, RACE, replace
import pytest
from recorded_races import PaperRace


def alert(kart: int, **fields: Any) -> Alert:
    lost = Alert(AlertKind.KART_LOST, kart, 0.0, f'Kart {kart} lost its connection', False)
    return replace(lost, **fields)


def msr_alert(kart: int) -> Alert:
    """Return an alert that asks for the MSR because of a kart."""
    text = f'Kart {kart} has not acknowledged RED_RED'
    return alert(kart, kind=AlertKind.RED_UNACKNOWLEDGED, text=text, use_msr=True)


def shown(book: AlertBook) -> list[str]:
    """Return what the notices say, in their order; those that were seen say that, too."""
    return [f'{notice}{" (seen)" * notice.seen}' for notice in book.shown]


def see_all(book: AlertBook) -> None:
    book.see([notice.number for notice in book.shown])


SEEN = None
"""The official marks every alert as seen."""

LOST, LOST_7 = (f'! ALERT: {alert(kart).text}' for kart in (1, 7))
OTHER_TEXT = alert(1, text='It is otherwise')
MSR, MSR_WAS_USED = msr_alert(3), replace(msr_alert(3), use_msr=False)
UNMOVED = '⚠ USE THE MSR: Kart 3 has not acknowledged RED_RED'
HAD_LOST = 'ENDED: Kart 1 had lost its connection'


@pytest.mark.parametrize(
    'steps',
    [
        [
            ([MSR], True, [UNMOVED]),
            ([], False, ['ENDED: Kart 3 had not acknowledged RED RED']),
            (SEEN, False, []),
        ],
        # It is not forgotten once it is seen, but is to be seen again if it comes again.
        [
            ([alert(1)], True, [LOST]),
            (SEEN, False, [f'{LOST} (seen)']),
            ([], False, []),
            ([alert(1)], True, [LOST]),
        ],
        # One that comes again before it was seen stands beside the old one.
        [
            ([alert(1)], True, [LOST]),
            ([], False, [HAD_LOST]),
            ([alert(1)], True, [LOST, HAD_LOST]),
        ],
        # One that was seen while the MSR was on is new when it asks for it again.
        [
            ([MSR], True, [UNMOVED]),
            ([MSR_WAS_USED], False, [f'! ALERT: {MSR.text}']),
            (SEEN, False, [f'! ALERT: {MSR.text} (seen)']),
            ([MSR], True, [UNMOVED]),
        ],
        # Another text is no other alert.
        [
            ([alert(1)], True, [LOST]),
            ([OTHER_TEXT], False, ['! ALERT: It is otherwise']),
        ],
    ],
)
def test_an_alert_stays_until_it_is_over_and_seen_and_is_new_when_it_comes_again(
    steps: list[tuple[list[Alert] | None, bool, list[str]]],
) -> None:
    book = AlertBook()
    for alerts, is_new, said in steps:
        if alerts is SEEN:
            see_all(book)
        else:
            assert book.update(alerts) is is_new
        assert shown(book) == said


def test_what_is_unseen_and_needs_the_msr_stands_first_and_what_is_seen_last() -> None:
    book = AlertBook()
    book.update([msr_alert(1), alert(2)])
    see_all(book)
    assert book.update([alert(5), msr_alert(4), alert(3), msr_alert(1), alert(2)])
    assert not book.update([alert(5), msr_alert(4), msr_alert(1), alert(2)])

    # Of the unseen ones that need no MSR, the newest is first.
    assert [notice.kart for notice in book.shown] == [4, 5, 3, 1, 2]


def test_alerts_that_find_no_place_are_told_with_their_karts_and_first_those_of_the_msr() -> None:
    book = AlertBook()
    book.update([alert(9), *(msr_alert(kart) for kart in (8, 3, 5, 4))])

    said = [summary(book.shown, places).text for places in (2, 4, 5)]

    assert said == ['⚠ MSR 4, 5', '5 new; not shown: kart 9', '5 new']


def test_two_race_controls_that_speak_in_turn_do_not_pile_up_alerts() -> None:
    book = AlertBook()

    news = [book.update([alert(1 + turn % 2)], two=True) for turn in range(10)]

    assert news == [True, True] + 8 * [False]
    assert len(shown(book)) == 2


def test_the_log_says_a_race_in_a_few_short_lines_without_teams() -> None:
    paper = PaperRace({each: f'Team {each} (FH)' for each in (3, 7, 11)})
    log, official = EventLog(OfficialNames()), 'Anna (pc 1)'
    paper.connect(3, 7, 11)
    for kind in (CommandKind.GRID_ACTIVE, CommandKind.GREEN_GREEN):
        paper.command(kind, official=official)
        paper.acknowledge()
    paper.wait(95.0)
    for kart in (3, 7):
        paper.command(CommandKind.KART_FINISH, kart, official)
    paper.wait(6.0)
    paper.acknowledge()
    paper.wait(3.0)
    paper.command(CommandKind.ALL_KILL, official=official, age=65.0)
    paper.acknowledge()
    paper.wait(9.0)
    for stamped in paper.stamped:
        said = stamped.event._replace(text=spoken(stamped.event.text))
        log.add(stamped._replace(event=said))

    assert [line.text for line in log.lines()] == [
        'Karts 3, 7, 11 connected',
        'GRID ACTIVE · Anna',
        'Every kart in the race acknowledged GRID ACTIVE',
        'GREEN GREEN · Anna',
        'Every kart in the race acknowledged GREEN GREEN',
        'FINISH kart 3, P1 · Anna',
        'FINISH kart 7, P2 · Anna',
        'Kart 7: RED FLAG (finished, P2)',
        'Kart 3: RED FLAG (finished, P1)',
        'Karts 3, 7 acknowledged RED FLAG',
        'Every kart in the race acknowledged its order',
        'ALL KILL, pressed 65 s ago · Anna',
        'Every kart in the race acknowledged RED RED',
    ]


def test_every_alert_that_has_ended_is_told_in_words_in_the_log_and_until_it_is_seen() -> None:
    for kind in AlertKind:
        kart = 7 if '{kart}' in ALERT_WAS[kind] else 0
        book, log = AlertBook(), EventLog(OfficialNames())
        book.update([Alert(kind, kart, 0.0, 'it is so', True)])
        book.update([])
        (ended,) = book.shown
        happened = Event(EventKind.ALERT_CLEARED, 'ended', kart, alert=kind)
        log.add(StampedEvent(1, 0, 0.0, happened))
        line = log.lines()[-1]

        assert line.text == str(ended)
        assert ended.text.startswith('Kart 7 ') is bool(kart)
        assert '_' not in ended.text


def test_a_line_of_several_karts_is_of_each_of_them_and_only_what_is_the_same_joins_it() -> None:
    log = EventLog(OfficialNames())

    def add(sequence: int, kart: int, kind: EventKind, state: RaceState | None = None) -> int:
        """Add an event; return the number of lines afterwards."""
        success = kind is not EventKind.DISCONNECTED
        log.add(
            StampedEvent(sequence, 0, 0.0, Event(kind, 'so it is', kart, state, success=success))
        )
        return len(log.lines())

    red, flag = RaceState.RED_RED, RaceState.RED_FLAG
    assert add(1, 1, EventKind.ACKNOWLEDGED, red) == 1
    assert add(2, 12, EventKind.ACKNOWLEDGED, red) == 1
    assert add(3, 5, EventKind.ACKNOWLEDGED, flag) == 2
    assert add(4, 5, EventKind.DISCONNECTED) == 3

    both, other, gone = (line.text for line in log.lines())
    assert both == 'Karts 1, 12 acknowledged RED RED'
    assert (other, gone) == ('Kart 5 acknowledged RED FLAG', '✗ so it is')
    assert {line.clock for line in log.lines()} == {time_of_day(0.0)}
    assert [line.text for line in log.lines(5)] == [other, gone]
    # A line about all karts is never replaced by a line about one.
    assert add(5, 0, EventKind.ALL_ACKNOWLEDGED, flag) == 4
    assert [line.text for line in log.lines(12)] == [both, 'so it is']
    assert add(6, 9, EventKind.ACKNOWLEDGED, flag) == 5
    # No event of a new run joins a line of the last run.
    assert add(1, 1, EventKind.CONNECTED) == 7
    assert log.lines()[5].text == NEW_RUN


def test_what_is_repeated_for_ever_has_one_line_that_counts_it_and_hides_no_other_line() -> None:
    log, why = EventLog(OfficialNames()), 'was refused: no kart in the roster has that address'
    one, other = (
        Event(EventKind.REFUSED_CONNECTION, f'A connection from {address} {why}', success=False)
        for address in ('10.0.0.8', '10.0.0.9')
    )
    rubbish = Event(EventKind.MALFORMED, "From kart 5 (Purdue): no frame: b'x'", 5, success=False)
    events = [one, Event(EventKind.CONNECTED, 'connected', 5), *[one, other, rubbish] * 40]
    for sequence, event in enumerate(events, 1):
        log.add(StampedEvent(sequence, sequence * 1_000_000_000, 0.0, event))

    assert [(line.clock, line.text) for line in log.lines()] == [
        (time_of_day(2), 'Kart 5 connected'),
        (time_of_day(120), f'✗ {one.text} (at least 41 times)'),
        (time_of_day(121), f'✗ {other.text} (at least 40 times)'),
        (time_of_day(122), f'✗ {rubbish.text} (at least 40 times)'),
    ]
    assert len(log.lines(5)) == 4
    log.add(StampedEvent(1, 0, 0.0, one))
    assert log.lines()[-1].text == f'✗ {one.text}'  # this run has it once
    assert len(log.lines()) == 6


def test_an_official_is_called_by_name_wherever_the_race_names_one_unless_two_have_it() -> None:
    officials = OfficialNames()

    def race_with(held: str) -> Snapshot:
        refused = offers(Availability(CommandKind.KART_FINISH, False, f'kart 7 is held: {held}'))
        kart = replace(KART, hold_reason=held, commands=refused)
        return replace(RACE, karts=(kart,), commands=refused, state_cause=held)

    message = message_of(race_with('ALL KILL by Anna (pc 1); RED RED by Bob (pc 2)'), msg.Race)
    for claim, told in (
        ('Anna (pc 1)', 'ALL KILL by Anna; RED RED by Bob (pc 2)'),
        ('Bob (pc 2)', 'ALL KILL by Anna; RED RED by Bob'),
        ('Anna (pc 3)', 'ALL KILL by Anna (pc 1); RED RED by Bob'),
    ):
        officials.take(claim)
        assert value_of(message, Snapshot, officials.in_text) == race_with(told)
    assert officials.names == ['Anna', 'Bob']
