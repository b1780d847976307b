# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Passings of a source in the officials' graph, over real DDS: laps, results, corrections."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import math
import pathlib
import time

from evgp_node.qos import latched
from evgp_node.stamps import stamp_of
from evgp_protocol.states import RaceState
from evgp_rcs.ros.line import LINE_QOS
from evgp_rcs_msgs import msg
from evgp_testing.ros_side import RosSide
from evgp_testing.wire_race import WireRace
import pytest


class TimingLine(RosSide):
    """A source of passings, which also hears the results."""

    def __init__(self, domain: int) -> None:
        super().__init__('line', domain)
        self.results: list[msg.Results] = []
        self._began_ns = time.time_ns()
        self._passings = self.node.create_publisher(msg.Passing, '/rcs/passings', LINE_QOS)
        self.node.create_subscription(msg.Results, '/rcs/results', self._hear, latched(1))
        self.spin()

    def _hear(self, results: msg.Results) -> None:
        with self.news:
            self.results.append(results)
            self.news.notify_all()

    def sees(self, number: int, **fields: object) -> None:
        # By its clock 0.3 s lie between the first and the others, however fast they are said.
        stamp = stamp_of(self._began_ns + (number > 1) * 300_000_000)
        named = {'kart': 1, 'stamp': stamp, **fields}
        self._passings.publish(msg.Passing(source='line', session='today', number=number, **named))

    def wait_for(self, found: Callable[[msg.Results], bool], what: str) -> msg.Results:
        def newest() -> msg.Results | None:
            fits = self.results and found(self.results[-1])
            return self.results[-1] if fits else None

        return self.wait_until(newest, lambda: f'{what}: {self.results[-1:]}')


def marks(results: msg.Results) -> list[int]:
    return [each.mark for each in results.passings]


@pytest.fixture
def race(parts: contextlib.ExitStack, tmp_path: pathlib.Path) -> WireRace:
    """Return a race with one kart, which acknowledges."""
    return parts.enter_context(WireRace(tmp_path, [1], parameters={'min_lap_time': 0.1}))


@pytest.fixture
def line(race: WireRace) -> Iterator[TimingLine]:
    side = TimingLine(race.domain)
    yield side
    side.close()


def test_a_source_counts_laps_and_an_official_corrects_them(
    race: WireRace, line: TimingLine
) -> None:
    official = race.official
    race.bring_to(RaceState.GREEN_GREEN)
    line.wait_for(lambda results: len(results.karts) == 1, 'a race')
    line.sees(1, strength=math.nan)
    line.wait_for(lambda results: len(results.passings) == 1, 'the first passing')
    line.sees(1)  # the same one, said again
    line.sees(2)
    results = line.wait_for(lambda results: results.karts[0].laps == 1, 'a lap')
    assert marks(results) == [msg.JudgedPassing.COUNTED] * 2
    (lap,) = results.karts[0].lap_times
    assert lap > 0.1
    assert math.isnan(results.passings[0].passing.strength)
    lap = official.wait_for_event(lambda event: event.kind == msg.RaceEvent.LAP, 'the lap')
    assert (lap.kart, lap.lap) == (1, 1)
    official.wait_for_race(lambda seen: seen.karts[0].laps == 1, 'the lap in the race')

    which = {'source': 'line', 'session': 'today', 'number': 2}
    official.command('set_passing_struck', **which, struck=True, reason='a marshal crossed')
    struck = line.wait_for(lambda results: results.karts[0].laps == 0, 'no lap')
    assert 'a marshal crossed' in struck.passings[1].struck
    official.command('set_passing_struck', **which, struck=False)
    official.command('kart/penalise', kart=1, seconds=5, reason='a short cut')
    result = line.wait_for(lambda results: bool(results.karts[0].penalties), 'the penalty')
    assert result.karts[0].total > 5.0
    assert marks(result) == [msg.JudgedPassing.COUNTED] * 2


def test_a_flood_of_passings_is_bounded_and_told_and_stops_go_on(
    race: WireRace, line: TimingLine
) -> None:
    official = race.official
    race.bring_to(RaceState.GREEN_GREEN)
    for number in range(1, 3001):
        line.sees(number, kart=0, transponder='4711')
    official.command('kart/red_red', kart=1)
    official.wait_for_race(
        lambda seen: any(each.kind == msg.Alert.LAPS_SOURCE for each in seen.alerts), 'the alert'
    )
