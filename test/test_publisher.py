# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What race control tells, and in which order, over real DDS."""

from __future__ import annotations

from collections.abc import Iterator
import dataclasses
import threading
import time

from evgp_protocol import clock
from evgp_rcs.ros.publisher import RacePublisher
from evgp_rcs.rules.race import Event, EventKind, Kart, Race, StampedEvent
from evgp_rcs.rules.snapshot import Snapshot, snapshot_of
from evgp_rcs_msgs import msg
from evgp_testing.domains import Domain
from evgp_testing.official import Official
from evgp_testing.part import PATIENCE
from evgp_testing.ros_side import RosSide
import pytest
from rclpy.qos import DurabilityPolicy
from std_msgs.msg import String


@dataclasses.dataclass
class Telling:
    """A publisher that is not started yet, who listens to it, and what ended it."""

    publisher: RacePublisher
    official: Official
    failed: threading.Event
    failures: list[BaseException]


@pytest.fixture
def telling() -> Iterator[Telling]:
    failed = threading.Event()
    failures: list[BaseException] = []

    def fail(error: BaseException) -> None:
        failures.append(error)
        failed.set()

    with (
        Domain() as domain,
        RosSide('rcs', domain.number) as rcs,
        Official(domain.number) as official,
    ):
        publisher = RacePublisher(rcs.node, fail)
        yield Telling(publisher, official, failed, failures)
        publisher.stop()


def some_events(count: int) -> list[StampedEvent]:
    return [
        StampedEvent(number, time.time_ns(), 0.0, Event(EventKind.REPORTED, 'news', kart=7))
        for number in range(1, count + 1)
    ]


def a_race() -> Snapshot:
    return snapshot_of(Race([Kart(7, 'Team', True)]), clock.now())


def test_the_race_does_not_wait_for_all_the_events_before_it(telling: Telling) -> None:
    telling.publisher.publish(some_events(5000))
    telling.publisher.publish(a_race())
    telling.publisher.start()
    telling.official.wait_for_race(lambda race: race.karts[0].number == 7, 'the race')
    assert len(telling.official.events) < 5000


def test_a_race_that_is_at_rest_is_told_again_with_the_time(telling: Telling) -> None:
    race = a_race()
    telling.publisher.start()
    telling.publisher.publish(race)
    first = telling.official.wait_for_race(lambda race: True, 'the race')
    telling.publisher.publish(race._replace(stamp=race.stamp + 1.0))
    again = telling.official.wait_for_race(
        lambda told: told.stamp != first.stamp, 'the race a second later'
    )
    assert str(again.karts) == str(first.karts)  # not ==: what is not known of a link is NaN
    assert again.stamp.sec - first.stamp.sec in (1, 2)
    telling.publisher.publish(race._replace(stamp=race.stamp + 2.0, over=True))
    telling.official.wait_for_race(lambda told: told.over, 'the change')


def test_the_plain_state_is_said_again_until_the_race_is_old_and_none_is_kept(
    telling: Telling,
) -> None:
    node, heard = telling.official.node, telling.official.hear(String, '/rcs/state')
    telling.official.wait_until_polled(
        lambda: telling.publisher._state.get_subscription_count(), 'its subscriber'
    )
    telling.publisher.publish(a_race())
    telling.publisher.start()
    telling.official.wait_until(lambda: len(heard) > 5, lambda: f'the state; heard {heard}')
    (publisher,) = node.get_publishers_info_by_topic('/rcs/state')
    assert publisher.qos_profile.durability is DurabilityPolicy.VOLATILE
    telling.official.wait_until_polled(lambda: telling.publisher._stated is None, 'silence')
    telling.publisher.publish(some_events(1))  # other news do not bring it back
    telling.official.wait_for_event(lambda event: event.kart == 7, 'news')
    assert telling.publisher._stated is None
    count = len(heard)
    telling.publisher.publish(a_race())
    telling.official.wait_until(lambda: len(heard) > count, lambda: 'the state, again')
    assert {each.data for each in heard} == {'IN_GARAGE'}


def test_a_publisher_that_cannot_go_on_says_so_and_its_last_words_are_heard(
    telling: Telling,
) -> None:
    telling.publisher.publish(a_race())
    telling.publisher.start()
    telling.official.wait_for_race(lambda race: True, 'a race')
    telling.publisher.publish(a_race()._replace(track=None))  # type: ignore[arg-type]
    assert telling.failed.wait(PATIENCE)
    assert isinstance(telling.failures[0], AttributeError)

    telling.publisher.stop()
    telling.publisher.last_words('race control has failed')

    race = telling.official.wait_for_race(lambda race: bool(race.alerts), 'an alert')
    assert (race.alerts[0].kind, race.alerts[0].use_msr) == (msg.Alert.PART_FAILED, True)
    assert race.karts[0].number == 7
    telling.official.wait_for_event(
        lambda event: event.kind == msg.RaceEvent.ALERT_RAISED, 'the alert among the events'
    )
