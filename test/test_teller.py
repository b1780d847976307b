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

    telling.teller.give_way = give_way
    telling.teller.put(some_events(100))
    telling.teller.put(Race([Kart(7, 'Team', True)]), 0.0)
    telling.teller.start()
    assert race_heard.wait(PATIENCE)


def test_of_too_many_events_the_oldest_are_only_in_the_record(telling: Telling) -> None:
    last = MOST_WAITING + 500
    telling.teller.put(some_events(last))
    telling.teller.start()
    telling.official.wait_for_event(lambda event: event.sequence == last, 'the newest event')
    assert telling.official.events[0].sequence > 500
    assert telling.record.flush(PATIENCE)
    with contextlib.closing(open_read_only(telling.path)) as database:
        assert len(list(events(database, 1))) == last
