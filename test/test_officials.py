# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Officials' commands over real DDS, to race control with plain karts; and a second one there."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import fcntl
import math
import pathlib
from typing import Any

from evgp_node.process import IN_THE_WAY
from evgp_node.qos import latched
from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rcs.ros.kart_client import KART_SERVER_SILENCE
from evgp_rcs.ros.node import ANSWER_TIMEOUT
from evgp_rcs.rules.catalogue import CATALOGUE
from evgp_rcs_msgs import msg, srv
from evgp_testing.fixtures import JoinOfficial, StartRaceControl
from evgp_testing.official import Official, SERVICES
from evgp_testing.process import Process
from evgp_testing.race_control import settings, write_roster
from evgp_testing.ros_side import RosSide
from evgp_testing.wire_race import WireRace
import pytest

GREEN_GREEN = RaceState.GREEN_GREEN
GRID_ACTIVE = RaceState.GRID_ACTIVE
IN_GARAGE = RaceState.IN_GARAGE
RED_FLAG = RaceState.RED_FLAG
RED_RED = RaceState.RED_RED

ROOT = pathlib.Path(__file__).parents[1]

NO_KART = 60000
"""No roster of these tests has it: a command to it is refused."""


@pytest.fixture(scope='module')
def the_race(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRace]:
    """Return a race with one kart, which acknowledges, in all tests that do not change it."""
    with WireRace(tmp_path_factory.mktemp('race'), [1]) as race:
        yield race


@pytest.fixture
def race(the_race: WireRace) -> WireRace:
    """Return that race in the garage, as an official sees it who has just come."""
    the_race.bring_to(IN_GARAGE)
    official, name = the_race.official, 'the last before the test'
    official.call('kart/finish', kart=NO_KART, official=name)
    official.wait_for_event(lambda event: event.official == name, name)
    with official.news:
        official.events.clear()
    return the_race


def test_the_document_of_the_interface_has_the_longest_times_to_an_answer() -> None:
    document = (ROOT / 'docs/ros-interface.md').read_text(encoding='utf-8')
    assert f'within {ANSWER_TIMEOUT:g} s' in document
    assert KART_SERVER_SILENCE < ANSWER_TIMEOUT  # one that hangs is known before


def test_a_second_race_control_here_starts_with_a_name_and_port_of_its_own_and_its_stops_have_it(
    race: WireRace, domain: int, tmp_path: pathlib.Path
) -> None:
    own = settings(tmp_path, write_roster(tmp_path, [1]))

    def second(where: int, *names: str, **parameters: object) -> Process:
        return Process('evgp_rcs', 'rcs_node', where, {**own, **parameters}, names)

    runs = f'another race control runs on this machine as /rcs on ROS domain {race.domain}'
    uses = 'another race control on this machine is using this port'
    port = race.control.port
    for where, given, said in ((race.domain, {}, runs), (domain, {'port': port}, uses)):
        with second(where, **given) as rival:
            assert rival.wait() == IN_THE_WAY
        (line,) = rival.output.splitlines()
        assert said in line

    names = ('-r', '__ns:=/north', '-r', '__node:=control', '-r', '~/red_flag:=/flag')
    with second(race.domain, *names) as other:
        other.wait_for_line('listens for')
        official = race.official
        for name in ('/north/control/all_kill', '/flag'):
            client = official.node.create_client(srv.RaceCommand, name)
            answer: Any = official.request(client, srv.RaceCommand.Request())
            assert answer.success
    race.karts[0].wait_for_frames(10)
    assert race.karts[0].state is IN_GARAGE
    race.bring_to(RED_RED)


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
    official.wait_for_acks(RED_RED, 1)
    assert [state for _, state in kart.changes[before:]] == [RED_RED]


def test_a_stop_of_any_age_is_taken_and_an_age_that_means_something_is_told(
    race: WireRace,
) -> None:
    for age, told in (
        (65.4, 'ALL_KILL was pressed 65 s ago.'),
        (1e300, 'ALL_KILL was pressed 86400 s ago.'),
        (math.inf, 'ALL_KILL was pressed 86400 s ago.'),
        (-math.inf, ''),
        (-65.0, ''),
        (math.nan, ''),
        (1e-300, ''),
    ):
        answer = race.official.call('all_kill', age=age)
        assert answer.success
        assert ('pressed' in answer.message) == bool(told)
        assert answer.message.endswith(told)
    now = race.official.wait_for_race(lambda each: state_of(each.state) is RED_RED, 'the stop')
    assert now.state_cause.endswith(', pressed 65 s ago')
    # What is no stop has no age: it shares the type of its request.
    assert 'pressed' not in race.official.call('kart/undo_finish', kart=1, age=65.0).message


def test_every_command_tells_who_gave_it_accepted_or_refused_also_to_one_who_comes_late(
    race: WireRace, join_official: JoinOfficial
) -> None:
    control, official = race.control, race.official
    given: dict[int, tuple[bool, str]] = {}
    for kind, entry in CATALOGUE.items():
        request = {**entry.fixed, **({'kart': 1} if entry.to_one_kart else {})}
        name = f'Anna {kind.name}'
        answer = official.call(entry.service, official=name, **request)
        given[getattr(msg.CommandAvailability, kind.name)] = (answer.success, name)

    official.wait_for_event(lambda event: event.command == list(given)[-1], 'the last command')
    told = {
        event.command: (event.success, event.official)
        for event in official.events
        if event.kind == msg.RaceEvent.COMMAND
    }
    caused = {
        (event.kind, given[event.command][1] == event.official)
        for event in official.events
        if event.command and event.kind != msg.RaceEvent.COMMAND
    }
    others = {event.official for event in official.events if not event.command}

    assert told == given
    assert {success for success, _ in given.values()} == {True, False}
    assert caused == {(msg.RaceEvent.RACE_STATE, True), (msg.RaceEvent.KART_STATE, True)}
    assert others == {''}
    for _, name in given.values():
        control.wait_for_line(rf'\[{name}\]')
    last = next(event for event in reversed(official.events) if event.command)
    join_official(control).wait_for_event(lambda event: event == last, 'the same')


def be_found(official: Official, service: str) -> None:
    """
    Return once race control's DDS has found where this official takes the answers of a service.

    An answer before that is lost: rmw_fastrtps waits for 0.1 s (``__rmw_send_response``), which is
    not always enough on a busy computer. The command is in force all the same.
    """
    with contextlib.suppress(AssertionError):
        official.call(service, kart=NO_KART)


def test_every_stop_of_a_burst_is_answered_and_in_force(
    start_race_control: StartRaceControl, join_official: JoinOfficial
) -> None:
    numbers = range(1, 41)
    official = join_official(start_race_control(in_race=numbers))
    be_found(official, 'kart/red_red')
    answers = official.call_all('kart/red_red', [{'kart': number} for number in numbers])
    assert all(answer.success for answer in answers)
    official.wait_for_race(
        lambda race: {state_of(kart.hold) for kart in race.karts} == {RED_RED}, 'every kart held'
    )


def test_a_terminal_that_takes_no_output_holds_nothing_up(
    race: WireRace,
) -> None:
    control, official, (kart,) = race.control, race.official, race.karts
    be_found(official, 'kart/finish')
    with control.output_held_up():
        # Each is logged, and together they are more than the pipe takes.
        assert control.process.stdout is not None
        fcntl.fcntl(control.process.stdout, fcntl.F_SETPIPE_SZ, 4096)
        for _ in range(10):
            official.call_all('kart/finish', [{'kart': NO_KART}] * 50)
        kart.wait_for_frames(20)
        official.command('all_kill')
        kart.wait_for_state(RED_RED)


# ----- the official of teams' own tests ---------------------------------------------------


def test_a_command_that_does_not_exist_or_is_ambiguous_is_answered_with_what_does(
    race: WireRace,
) -> None:
    for give in (race.official.call, race.official.command, race.official.wait_for_available):
        with pytest.raises(ValueError, match="'finish'") as told:
            give('finish', kart=1)
        assert all(service in str(told.value) for service in SERVICES)
    with pytest.raises(ValueError, match='in_race=True or in_race=False'):
        race.official.command('set_in_race', kart=1)


def test_the_way_to_the_grid_closes_an_open_track_first(race: WireRace) -> None:
    official = race.official
    official.command('set_track_open', open=True, no_race_anywhere=True)
    official.wait_for_race(lambda race: race.track.open, 'the track open')
    race.bring_to(GRID_ACTIVE)
    commands = msg.CommandAvailability
    official.wait_for_event(lambda event: event.command == commands.GRID_ACTIVE, 'GRID_ACTIVE')
    *before, _ = (event.command for event in official.events if event.command)
    assert commands.CLOSE_TRACK in before
