"""What race control tells, and in which order, over real DDS."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import dataclasses
import itertools
import pathlib
import threading
import time

from evgp_rcs.node import MOST_WAITING, Teller, TURN
from evgp_rcs.race import Event, EventKind, Kart, Race, StampedEvent
from evgp_rcs.record import events, open_read_only, Record
from evgp_rcs.roster import Roster, RosterEntry
import pytest
from race_parts.domains import Domain
from race_parts.official import Official
from race_parts.process import PATIENCE
from race_parts.ros_side import RosSide


@dataclasses.dataclass
class Telling:
    """A teller that is not started yet, who listens to it, and its record with the file."""

    teller: Teller
    official: Official
    record: Record
    path: pathlib.Path


@pytest.fixture
def telling(tmp_path: pathlib.Path) -> Iterator[Telling]:
    path = tmp_path / 'record.sqlite3'
    roster = Roster((RosterEntry(7, 'Team', '127.0.0.7', True),))
    with (
        Domain() as domain,
        contextlib.closing(RosSide('rcs', domain.number)) as rcs,
        contextlib.closing(Official(domain.number)) as official,
    ):
        record = Record(path)
        teller = Teller(rcs.node, roster, record)
        yield Telling(teller, official, record, path)
        teller.stop()
        record.end(PATIENCE)


def some_events(count: int) -> list[StampedEvent]:
    return [
        StampedEvent(number, time.time_ns(), 0.0, Event(EventKind.REPORTED, 'news', kart=7))
        for number in range(1, count + 1)
    ]


def alert(text: str) -> StampedEvent:
    return StampedEvent(1, time.time_ns(), 0.0, Event(EventKind.ALERT_RAISED, text))


def test_the_race_does_not_wait_for_all_the_events_before_it(telling: Telling) -> None:
    race_heard = threading.Event()
    steps = itertools.count(1)

    def give_way() -> None:
        step = next(steps)
        if step == 1:
            time.sleep(2 * TURN)  # frames go out: that the time of a turn passes is meant
        if step == 10:
            telling.official.wait_for_race(lambda race: race.karts[0].number == 7, 'the race')
            race_heard.set()

    telling.teller.courtesy = lambda: give_way
    telling.teller.put(some_events(100))
    telling.teller.put(Race([Kart(7, 'Team', True)]), 0.0)
    telling.teller.start()
    assert race_heard.wait(PATIENCE)


def test_an_alert_is_told_however_much_karts_say_behind_it(telling: Telling) -> None:
    telling.teller.put([alert('use the MSR'), *some_events(MOST_WAITING)])
    telling.teller.start()
    told = telling.official.wait_for_event(lambda event: True, 'the alert')
    assert told.text == 'use the MSR'


def test_an_alert_is_told_however_often_karts_say_too_much(telling: Telling) -> None:
    steps = itertools.count(1)

    def give_way() -> None:
        if next(steps) == 1:  # the second alert is left for the next turn, with as much again
            telling.teller.put(some_events(MOST_WAITING))
            time.sleep(2 * TURN)

    telling.teller.courtesy = lambda: give_way
    telling.teller.put([alert('one'), alert('two'), *some_events(MOST_WAITING)])
    telling.teller.start()
    telling.official.wait_for_event(lambda event: event.text == 'two', 'the second alert')


def test_what_is_not_told_is_in_the_record(telling: Telling) -> None:
    telling.teller.put(some_events(MOST_WAITING + 1))
    telling.teller.start()
    telling.teller.stop()
    assert telling.record.flush(PATIENCE)
    with contextlib.closing(open_read_only(telling.path)) as database:
        assert len(list(events(database, 1))) == MOST_WAITING + 1
