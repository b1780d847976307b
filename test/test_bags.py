# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A race on real parts, replayed, as a report, and as a bag that another reader reads."""

from __future__ import annotations

import itertools
import pathlib
import re
import shutil
import sys
from typing import Any, NamedTuple

from evgp_protocol.states import RaceState
from evgp_rcs.rcs_record import main as rcs_record
from evgp_rcs.record.runs import open_runs
from evgp_rcs.ros.publisher import EVENTS_QOS, RACE_QOS
from evgp_rcs.rules.inputs import Entry, Ordered
from evgp_rcs.rules.race import StampedEvent
from evgp_rcs_msgs import msg
from evgp_testing.official import Official
from evgp_testing.race_control import Timekeeper
from evgp_testing.wire_race import WireRace
from evgp_timing.timekeeper import RESULTS_QOS
import pytest
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    qos_check_compatible,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
)
from recorded_races import edit
from rig.replaying import events_of, replay_without_difference
from rosbags.highlevel import AnyReader
import yaml

ROOT = pathlib.Path(__file__).resolve().parents[1]

Published = dict[str, list[tuple[int, Any]]]


def read(path: pathlib.Path) -> Published:
    """Return the messages of each topic, with their times (ns)."""
    found: Published = {}
    with AnyReader([path]) as reader:
        for connection, at, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((at, message))
    return found


def bagged(record: pathlib.Path, code: int = 0) -> Published:
    """Make a bag of a record, and return what is in it."""
    bag = record.with_suffix('.mcap')
    assert rcs_record(['mcap', str(record), str(bag)]) == code
    found = read(bag)
    bag.unlink()
    return found


class Recorded(NamedTuple):
    """The record of a race on real parts, and the latched topics that there were."""

    record: pathlib.Path
    latched: set[str]


@pytest.fixture(scope='module')
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """
    Return what is left of the very first race, which went to GREEN_GREEN and was stopped.

    It is replayed without a difference while the race is on, and after it.
    """
    folder = tmp_path_factory.mktemp('recorded')
    record = folder / 'record.sqlite3'
    with WireRace(folder, [1]) as race, Timekeeper(folder, race.domain):
        race.bring_to(RaceState.GREEN_GREEN)
        race.official.call('in_garage', track_safe=True)
        (meanwhile,) = replay_without_difference(record)
        race.bring_to(RaceState.RED_RED)
        latched = latched_by(race.official)
        published = race.official.wait_for_race(lambda race: True, 'the race')
        assert race.control.close() == 0
    (replayed,) = replay_without_difference(record)
    assert replayed.inputs > meanwhile.inputs
    assert replayed.orders >= 4  # as the kart connects, and one to each state
    assert replayed.kept.run.id == published.run  # by which a report finds the results
    return Recorded(record, latched)


def latched_by(official: Official) -> set[str]:
    """Return the topics that race control and the timekeeper latch."""
    node = official.node
    official.wait_until_polled(
        lambda: node.count_publishers('/rcs/timekeeper/results') == 1, 'the timekeeper'
    )
    return {
        topic
        for topic, _ in node.get_topic_names_and_types()
        for publisher in node.get_publishers_info_by_topic(topic)
        if publisher.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
    }


@pytest.fixture
def race(recorded: Recorded, tmp_path: pathlib.Path) -> pathlib.Path:
    """Return a copy of that record, for a test to change."""
    return pathlib.Path(shutil.copy(recorded.record, tmp_path))


def test_the_report_of_a_real_race_tells_who_stopped_it_and_of_its_end_no_alert(
    race: pathlib.Path,
) -> None:
    page = race.with_name('report.html')
    assert rcs_record(['report', str(race), '-o', str(page)]) == 0
    text = re.sub('<[^>]*>', '', page.read_text(encoding='utf-8'))
    assert 'Stopped: RED RED by official, ALL KILL, ' in text
    assert 'no difference' in text
    assert 'ended normally at' in text
    assert 'MSR' not in text


def test_a_bag_has_all_that_was_published_at_its_times_although_the_clock_was_set_back(
    race: pathlib.Path,
) -> None:
    def set_back(entries: list[Entry]) -> None:
        for place, each in enumerate(entries):
            if isinstance(each, StampedEvent) and each.sequence > 5:
                entries[place] = each._replace(wall_ns=each.wall_ns - 3600 * 10**9)

    edit(race, set_back)
    with open_runs(race) as runs:
        run = runs.choose(None)
    first, *_ = recorded = events_of(race)
    zero = first.wall_ns, first.monotonic
    times = [zero[0] + round((each.monotonic - zero[1]) * 1e9) for each in recorded]
    found = bagged(race)
    assert set(found) == {'/rcs/race', '/rcs/events', '/diagnostics'}
    told = [(at, event) for at, message in found['/rcs/events'] for event in message.events]
    assert [
        (at, event.sequence, event.text, event.stamp.sec * 10**9 + event.stamp.nanosec)
        for at, event in told
    ] == [
        # The messages themselves say what the clock showed.
        (at, each.sequence, each.event.text, each.wall_ns)
        for at, each in zip(times, recorded, strict=True)
    ]
    for topic in ('/rcs/events', '/rcs/race'):
        assert {message.run for _, message in found[topic]} == {run.id}
    states = [message.state.state for _, message in found['/rcs/race']]
    assert [state for state, _ in itertools.groupby(states)] == [
        msg.RaceState.IN_GARAGE,
        msg.RaceState.GRID_ACTIVE,
        msg.RaceState.GREEN_GREEN,
        msg.RaceState.RED_RED,
    ]
    for messages in found.values():
        at = [at for at, _ in messages]
        assert at == sorted(at)
        # At the times at which it was published, not at those at which the bag was made.
        assert run.began_ns <= at[0]
        assert at[-1] <= times[-1] + 10**9


def test_a_bag_has_events_to_the_end_and_the_race_as_far_as_the_rules_can_follow(
    race: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = bagged(race)
    assert len(capsys.readouterr().out.splitlines()) == 1

    def lose_the_last_order(entries: list[Entry]) -> None:
        entries.pop(max(n for n, each in enumerate(entries) if isinstance(each, Ordered)))

    edit(race, lose_the_last_order)
    cut = bagged(race, code=3)
    assert len(capsys.readouterr().out.splitlines()) == 2
    assert len(cut['/rcs/events']) == len(whole['/rcs/events'])
    assert 0 < len(cut['/rcs/race']) < len(whole['/rcs/race'])
    edit(race, lambda entries: entries.pop(1))
    assert set(bagged(race, code=3)) == {'/rcs/events'}


def test_without_the_package_for_bags_it_is_said_how_to_get_it(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delitem(sys.modules, 'evgp_rcs.ros.bag', raising=False)
    for name in [name for name in sys.modules if name.split('.')[0] == 'mcap']:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, 'mcap', None)
    assert rcs_record(['mcap', str(tmp_path / 'race.mcap')]) == 2
    assert 'pip install mcap' in capsys.readouterr().err


def overrides() -> dict[str, QoSProfile]:
    """Return how rosbag2 listens to the topics that it is told of, by bag_qos.yaml."""
    text = (ROOT / 'src/evgp_rcs/config/bag_qos.yaml').read_text(encoding='utf-8')
    return {
        topic: QoSProfile(
            history=HistoryPolicy[given['history'].upper()],
            depth=given['depth'],
            reliability=ReliabilityPolicy[given['reliability'].upper()],
            durability=DurabilityPolicy[given['durability'].upper()],
        )
        for topic, given in yaml.safe_load(text).items()
    }


def test_rosbag2_is_told_of_every_latched_topic_and_gets_all_that_it_keeps(
    recorded: Recorded,
) -> None:
    latched = {
        '/rcs/race': RACE_QOS,
        '/rcs/events': EVENTS_QOS,
        '/rcs/timekeeper/results': RESULTS_QOS,
    }
    assert recorded.latched - {'/rosout'} == overrides().keys() == latched.keys()
    for topic, published in latched.items():
        listens = overrides()[topic]
        compatible, reason = qos_check_compatible(published, listens)
        assert compatible is not QoSCompatibility.ERROR, reason
        assert listens.durability is published.durability
        assert listens.depth >= published.depth
