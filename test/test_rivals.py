# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Two race controls on one graph: the second does not start, and if they meet later both know."""

from __future__ import annotations

from collections.abc import Iterator
import pathlib

from evgp_node.process import IN_THE_WAY
from evgp_node.qos import latched
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.process import Process
from evgp_testing.race_control import settings, write_roster
from evgp_testing.ros_side import RosSide
from evgp_testing.wire_race import WireRace
import pytest


@pytest.fixture(scope='module')
def race(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRace]:
    """Return the race that others get in the way of."""
    with WireRace(tmp_path_factory.mktemp('race'), [1]) as race:
        yield race


def second(folder: pathlib.Path, domain: int, *arguments: str, **parameters: object) -> Process:
    """Start another race control, at another port and with a record of its own."""
    own = folder / 'second'
    own.mkdir(exist_ok=True)
    given = {**settings(own, write_roster(own, [1])), **parameters}
    return Process('evgp_rcs', 'rcs_node', domain, given, arguments)


def test_a_second_race_control_here_does_not_start_unless_its_name_and_its_port_are_its_own(
    race: WireRace, domain: int, tmp_path: pathlib.Path
) -> None:
    runs = f'another race control runs on this machine as /rcs on ROS domain {race.domain}'
    uses = 'another race control on this machine is using this port'
    port = race.control.port
    for where, given, said in ((race.domain, {}, runs), (domain, {'port': port}, uses)):
        with second(tmp_path, where, **given) as rival:
            assert rival.wait() == IN_THE_WAY
        (line,) = rival.output.splitlines()
        assert said in line
    with second(tmp_path, race.domain, '-r', '__ns:=/junior') as other:
        other.wait_for_line('listens for')
    race.karts[0].wait_for_frames(10)
    race.bring_to(RaceState.RED_RED)


class Publisher(RosSide):
    """A node called rcs that publishes a race, as race control does."""

    def __init__(self, domain: int) -> None:
        super().__init__('rcs', domain)
        self.publisher = self.node.create_publisher(msg.Race, '~/race', latched(1))
        self.spin()


def test_while_two_race_controls_meet_nothing_that_loosens_is_accepted_and_stops_are(
    race: WireRace,
) -> None:
    official, (kart,) = race.official, race.karts
    race.bring_to(RaceState.IN_GARAGE)
    before = len(kart.changes)
    # Not `official.race`: of two race controls, a client cannot tell whose it hears.
    two = msg.Alert.TWO_RACE_CONTROLS
    rival = Publisher(race.domain)
    try:
        official.wait_for_event(lambda event: event.alert == two, 'two race controls')
        refused = official.call('grid_active', track_clear=True, karts=[1])
        stopped = official.call('all_kill')
    finally:
        rival.close()
    assert (refused.success, stopped.success) == (False, True)
    assert 'another race control' in refused.message
    official.wait_for_event(
        lambda event: (event.kind, event.alert) == (msg.RaceEvent.ALERT_CLEARED, two),
        'that the other is gone',
    )
    official.wait_for_acks(RaceState.RED_RED, 1)
    assert [state for _, state in kart.changes[before:]] == [RaceState.RED_RED]
    official.command('in_garage', track_safe=True)
