# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Who is there to stop the race, over real DDS; test_console.py has the same with real windows."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.ros_side import RosSide
from evgp_testing.wire_race import WireRace
import pytest
from rclpy.duration import Duration
from rclpy.qos import LivelinessPolicy, QoSProfile

GREEN_GREEN = RaceState.GREEN_GREEN

NOBODY_THERE = msg.Alert.NOBODY_THERE
BUTTON_FAULT = msg.Alert.BUTTON_FAULT

MANUAL = QoSProfile(
    depth=10,
    liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
    liveliness_lease_duration=Duration(seconds=2),
)
"""What the publisher of another program may offer."""


class Programs(RosSide):
    """Programs that say what they are told to, once a second."""

    def __init__(self, domain: int, qos: QoSProfile) -> None:
        super().__init__('programs', domain)
        self.words: dict[str, msg.Presence] = {}
        self._publisher = self.node.create_publisher(msg.Presence, '/rcs/presence', qos)
        self.node.create_timer(1.0, self._say)
        self.spin()

    def say(self, program: str, number: int = 1, **fields: object) -> None:
        """Have a program say this from now on."""
        self.words[f'{program} {number}'] = msg.Presence(
            program=program, id=f'{program} {number}', **fields
        )
        self._say()

    def _say(self) -> None:
        for word in list(self.words.values()):
            self._publisher.publish(word)


def alerts(race: msg.Race) -> set[int]:
    return {each.kind for each in race.alerts}


def wait_for(race: WireRace, found: Callable[[msg.Race], object], what: str) -> msg.Race:
    return race.official.wait_for_race(found, what)


@pytest.fixture(scope='module')
def the_race(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRace]:
    """Return the race of all tests of this file, with one kart, which acknowledges."""
    parameters = {'nobody_there': 0.1}
    with WireRace(tmp_path_factory.mktemp('race'), [1], parameters=parameters) as race:
        yield race


@pytest.fixture
def race(the_race: WireRace) -> WireRace:
    """Return the race in the garage, with nobody there."""
    the_race.bring_to(RaceState.IN_GARAGE)
    wait_for(the_race, lambda seen: not seen.able_to_stop, 'nobody any more')
    with the_race.official.news:
        the_race.official.events.clear()
    return the_race


# Whatever its publisher offers, a program is heard.
@pytest.fixture(params=[QoSProfile(depth=10), MANUAL], ids=['ours', 'manual'])
def programs(race: WireRace, request: pytest.FixtureRequest) -> Iterator[Programs]:
    side = Programs(race.domain, request.param)
    yield side
    side.close()


def test_a_race_is_stopped_once_nobody_is_heard_any_more_and_only_if_somebody_was(
    race: WireRace, programs: Programs
) -> None:
    race.bring_to(GREEN_GREEN)
    for _ in range(4):  # 2 s; it would be stopped after 0.1
        before = race.official.race
        now = wait_for(race, lambda seen, before=before: seen is not before, 'another snapshot')
        assert (now.able_to_stop, now.state.state) == (0, msg.RaceState.GREEN_GREEN)

    programs.say('rcs_gui', official='Anna')
    programs.say('rcs_button')
    seen = wait_for(race, lambda seen: seen.able_to_stop == 2, 'both')
    assert seen.who_can_stop == 'Anna (window), button'
    del programs.words['rcs_gui 1']
    wait_for(race, lambda seen: seen.able_to_stop == 1, 'one')
    assert race.karts[0].state is GREEN_GREEN
    programs.say('rcs_button', fault='it is unplugged')

    stopped = race.official.wait_for_event(
        lambda event: (
            event.kind == event.RACE_STATE and event.state.state == msg.RaceState.RED_FLAG
        ),
        'RED_FLAG',
    )
    race.karts[0].wait_for_state(RaceState.RED_FLAG)
    assert (stopped.command, stopped.official) == (0, '')
    raised = [each.alert for each in race.official.events if each.kind == each.ALERT_RAISED]
    assert {NOBODY_THERE, BUTTON_FAULT} <= {*raised}
    # Whoever comes back undoes nothing.
    programs.say('rcs_button')
    wait_for(race, lambda seen: seen.able_to_stop and not alerts(seen), 'no alert')
    assert race.karts[0].state is RaceState.RED_FLAG
