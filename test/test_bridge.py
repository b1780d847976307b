# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The bridge as a process, between race control's end of the wire and a team's node."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import itertools
import os
import pathlib
import re
import signal
import socket
import subprocess
import time
from typing import Any

from evgp_kart_bridge.lamp import BLUE, YELLOW
from evgp_kart_bridge.node import WARN_AFTER
from evgp_node.graph import INTERFACE, kept_apart_by
from evgp_node.qos import latched
from evgp_node.states import state_message, state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs.srv import Acknowledge
from evgp_testing.domains import Domain, free_port
from evgp_testing.fixtures import JoinTeam, StartBase, StartBridge
from evgp_testing.kart import Bridge, Team
from evgp_testing.part import PATIENCE
from evgp_testing.process import executable, Process, Program
from evgp_testing.race_control import address_of
from evgp_testing.ros_side import RosSide
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
import pytest
from rclpy.qos import DurabilityPolicy
from rclpy.qos import qos_profile_sensor_data as best_effort
from rig.bare_race_control import BareRaceControl
from rig.faulty_nodes import BridgeThatHangs, BridgeThatRaises, program_of, StackThatRaises
from std_msgs.msg import Bool, ColorRGBA, String
from std_srvs.srv import SetBool

GRID_ACTIVE = RaceState.GRID_ACTIVE
GREEN_GREEN = RaceState.GREEN_GREEN
IN_GARAGE = RaceState.IN_GARAGE
RED_FLAG = RaceState.RED_FLAG
RED_RED = RaceState.RED_RED


class OneKartRace:
    """
    Race control's end of the wire, a kart's bridge, and its team.

    :param bridge_has: parameters of the bridge.
    """

    def __init__(
        self,
        parts: contextlib.ExitStack,
        program: str = 'kart_bridge_node',
        arguments: tuple[str, ...] = (),
        **bridge_has: object,
    ) -> None:
        self._parts, self._domain = parts, parts.enter_context(Domain()).number
        self.control = parts.enter_context(BareRaceControl())
        self.start_bridge(bridge_has, program, arguments)
        self.team = parts.enter_context(Team(self._domain))
        self.team.wait_for_state(IN_GARAGE)

    def start_bridge(self, *bridge_has: Any) -> None:
        bridge = Bridge(self._domain, self.control.port, address_of(1), *bridge_has)
        self.bridge = self._parts.enter_context(bridge)

    def command(self, state: RaceState) -> None:
        self.control.say(state)
        self.team.wait_for_state(state)

    def acknowledge(self, state: RaceState) -> None:
        # Once the bridge has received odometry, if it is required.
        self.team.wait_until_polled(
            lambda: self.team.acknowledge(state).success, f'{state.value} to be taken'
        )
        self.control.wait_until_it_says(state)

    def green(self) -> None:
        self.command(GRID_ACTIVE)
        self.acknowledge(GRID_ACTIVE)
        self.start()

    def start(self) -> None:
        self.control.wait_until_it_says(GRID_ACTIVE)
        self.command(GREEN_GREEN)
        self.team.wait_for_stop(False)

    def drive(self, stack: Process) -> None:
        stack.wait_for_line('IN_GARAGE')
        self.team.wait_for_speed(lambda speed: speed == 0.0)
        self.command(GRID_ACTIVE)
        # The stack acknowledges by itself; what it has not heard, it would not start from.
        self.start()
        self.team.wait_for_speed(lambda speed: speed > 1.0)


def start_stack(domain: int, program: str = 'example_stack', **parameters: object) -> Process:
    return Process('evgp_kart_bridge', program, domain, parameters)


def publish(
    kind: type, topic: str, qos: Any, message: object = None
) -> Callable[[RosSide], object]:
    """Return what has a node publish on a topic of its bridge, beside whoever does."""

    def act(side: RosSide) -> None:
        publisher = side.node.create_publisher(kind, f'/kart_bridge/{topic}', qos)
        publisher.publish(message or kind())

    return act


# ----- from race control to the stack ------------------------------------------------------


def test_a_race_reaches_the_stack_and_its_acknowledgements_race_control(
    parts: contextlib.ExitStack,
) -> None:
    race = OneKartRace(parts)
    race.bridge.wait_for_line('Until odometry arrives on /kart_bridge/odom')
    race.team.wait_for_stop(True)
    lamp = race.team.hear(ColorRGBA, '/kart_bridge/lamp', latched(1))
    plain = race.team.hear(String, '/kart_bridge/state')

    def wait_for_lamp(colour: tuple[float, float, float]) -> None:
        race.team.wait_until(
            lambda: lamp and (lamp[-1].r, lamp[-1].g, lamp[-1].b) == colour,
            lambda: f'another colour; the last are {lamp[-3:]}',
        )

    race.command(GRID_ACTIVE)
    wait_for_lamp(YELLOW)
    race.bridge.wait_for_line(
        'GRID_ACTIVE has not been acknowledged for 5 s.*/kart_bridge/acknowl'
    )
    race.green()
    race.team.wait_until(lambda: plain[-1].data == 'GREEN_GREEN', lambda: f'it; {plain[-1]}')
    (publisher,) = race.team.node.get_publishers_info_by_topic('/kart_bridge/state')
    assert publisher.qos_profile.durability is DurabilityPolicy.VOLATILE
    plain.clear()
    race.team.wait_until(lambda: len(plain) > 9, lambda: 'more, though nothing changes')
    assert {each.data for each in plain} == {'GREEN_GREEN'}
    race.acknowledge(GREEN_GREEN)
    race.team.drive_at(0.0)
    race.bridge.wait_for_line('has read 0.00 m/s for 5 s in GREEN_GREEN.*twist')
    race.team.drive_at(3.0)
    race.command(RED_FLAG)
    race.bridge.wait_for_line('The stop is not acknowledged yet: odometry says 3.00')
    race.team.drive_at(0.0)
    race.acknowledge(RED_FLAG)
    race.command(RED_RED)
    race.bridge.wait_for_line('RED_RED has not been acknowledged for 5 s')
    race.acknowledge(RED_RED)
    race.command(IN_GARAGE)
    race.control.wait_until_it_says(IN_GARAGE)
    assert race.team.states[-5:] == [GRID_ACTIVE, GREEN_GREEN, RED_FLAG, RED_RED, IN_GARAGE]
    assert race.bridge.close() == 0
    assert 'IN_GARAGE has not been acknowledged' not in race.bridge.output
    told = re.findall(r'(\w+) is acknowledged', race.bridge.output)
    assert told == ['GRID_ACTIVE', 'GREEN_GREEN', 'RED_FLAG', 'RED_RED']
    race.team.wait_until(lambda: plain[-1].data == 'RED_RED', lambda: f'the end: {plain[-1]}')
    wait_for_lamp(BLUE)


def test_no_red_is_acknowledged_while_required_odometry_does_not_come(
    parts: contextlib.ExitStack,
) -> None:
    race = OneKartRace(parts, arguments=('-r', '~/odom:=/odometry'))  # which requires it
    race.bridge.wait_for_line('Obey IN_GARAGE')
    # It has started well, and has raised no alarm.
    before = list(
        itertools.takewhile(lambda line: 'Obey IN_GARAGE' not in line, race.bridge.lines)
    )
    assert any('Starting: ' in line for line in before)
    assert not any('[WARN]' in line for line in before), race.bridge.output
    race.command(RED_RED)
    answer = race.team.acknowledge(RED_RED)
    assert not answer.success
    assert 'no odometry on /odometry' in answer.message
    race.bridge.wait_for_line('can be acknowledged: no odometry on /odometry')


# ----- what it logs ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('name', 'value', 'apart'),
    [
        ('FASTDDS_BUILTIN_TRANSPORTS', 'LARGE_DATA', True),
        ('FASTDDS_BUILTIN_TRANSPORTS', 'DEFAULT', False),
        ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF', True),
        ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET', False),
    ],
)
def test_what_may_keep_the_bridge_unheard_is_named(
    name: str, value: str, apart: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for each in ('FASTDDS_BUILTIN_TRANSPORTS', 'ROS_AUTOMATIC_DISCOVERY_RANGE'):
        monkeypatch.delenv(each, raising=False)
    monkeypatch.setenv(name, value)
    assert kept_apart_by() == (f'{name}={value}' if apart else '')


def test_a_stack_that_hears_no_bridge_and_a_bridge_without_a_reader_say_where_they_look(
    parts: contextlib.ExitStack, domain: int
) -> None:
    closing = parts.enter_context(socket.create_server(('127.0.0.1', 0)))
    elsewhere = parts.enter_context(Domain()).number
    bridge = parts.enter_context(Bridge(domain, closing.getsockname()[1], address_of(1)))
    side = parts.enter_context(RosSide('reader', domain))
    side.spin()
    subscribe, leave = side.node.create_subscription, side.node.destroy_subscription
    lock = subscribe(Bool, '/kart_bridge/stop', print, 1)
    for _ in range(5):  # attempts within some 3 s
        closing.accept()[0].close()
    # A failure that comes back with every attempt is not logged every time.
    logged = [line.partition(': ')[2] for line in bridge.lines]
    closed = [text for text in logged if 'closed the connection' in text]
    assert closed
    assert len(closed) == len(set(closed)), bridge.output

    began = time.monotonic()
    where = f'on /kart_bridge/race_state in ROS domain {elsewhere}:.*{INTERFACE}'
    # With LARGE_DATA it depends on the machine whether it is heard.
    for at, name, value, said in (
        (elsewhere, 'ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST', where),
        (domain, 'FASTDDS_BUILTIN_TRANSPORTS', 'SHM', ''),
    ):
        # Under LOCALHOST, as tests have it, Fast DDS would not look at its variable.
        environment = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET', name: value}
        program = executable('evgp_kart_bridge', 'shortest_stack')
        said = said or f'.*: this shell sets {name}={value}, which may'
        with Program('stack', [program], at, environment) as stack:
            stack.wait_for_line(f'no bridge is heard {said}')

    # A stack that reads the lock or the plain state alone is read; that time passes is awaited.
    time.sleep(max(0.0, began + WARN_AFTER + 1.0 - time.monotonic()))
    plain = subscribe(String, '/kart_bridge/state', print, 1)
    leave(lock)
    time.sleep(WARN_AFTER + 1.0)
    assert 'No node has read' not in bridge.output
    leave(plain)
    where = f'/kart_bridge/race_state in ROS domain {domain}'
    bridge.wait_for_line(f'No node has read {where} .*{INTERFACE}')


# ----- the team's own stop -----------------------------------------------------------------


def test_a_bridge_that_is_started_again_heeds_what_was_pressed_before_and_fits_no_old_number(
    parts: contextlib.ExitStack,
) -> None:
    race = OneKartRace(parts)
    why = 'the safety remote says stop', "the MSR's contact is open"
    for remote in ('tsr', 'msr'):
        publish(Bool, remote, latched(1), Bool(data=True))(race.team)
    numbers: list[int] = []
    for _ in range(3):
        # A bridge that starts stops its kart too, but for another reason.
        told = race.team.wait_for(
            lambda state: (
                state.order not in (0, *numbers[-1:]) and all(each in state.reason for each in why)
            ),
            'both stops, told by another bridge',
        )
        assert state_of(told.state) is RED_RED
        assert not any(race.team.acknowledge(RED_RED, each).success for each in numbers)
        numbers.append(told.order)
        race.bridge.kill()
        race.start_bridge()
    # They do not just begin to count again, not even near.
    gaps = [abs(after - before) for before, after in itertools.pairwise(numbers)]
    assert min(gaps) > 1_000_000


def offer(kind: type, service: str) -> Callable[[RosSide], object]:
    return lambda side: side.node.create_service(kind, f'/kart_bridge/{service}', lambda _, a: a)


def test_a_second_node_in_a_role_of_the_kart_stops_it_until_it_has_left(
    parts: contextlib.ExitStack,
) -> None:
    race = OneKartRace(parts)

    def wait_for_stop(reason: str) -> None:
        # DDS may find a publisher before the name of its node.
        told = race.team.wait_for(lambda state: reason in state.reason, reason)
        assert told.team_stop
        assert state_of(told.state) is RED_RED

    def check(act: Callable[[RosSide], object], reason: str) -> None:
        race.team.wait_for_state(IN_GARAGE)
        with RosSide('second', race.bridge.domain) as second:
            act(second)
            wait_for_stop(reason)

    with Bridge(race.bridge.domain, free_port(), address_of(2)) as another:
        said = f'another bridge runs in ROS domain {race.bridge.domain}, stop one of them'
        for bridge in (race.bridge, another):
            bridge.wait_for_line(said)
        wait_for_stop(said)
    publish(Bool, 'msr', 10, Bool(data=False))(race.team)
    check(publish(String, 'tsr', 10), 'does not publish std_msgs/Bool: /second')
    publish(Bool, 'tsr', 10, Bool(data=False))(race.team)
    race.team.drive_at(0.0)
    several = 'more than one publisher of ~/'
    for act, reason in (
        (publish(Bool, 'tsr', latched(1)), f'{several}tsr: /second, /team'),
        (publish(Bool, 'msr', 10), f'{several}msr: /second, /team'),  # says closed
        (publish(Bool, 'stop', latched(1)), f'{several}stop: /kart_bridge, /second'),
        (publish(String, 'state', 1), f'{several}state'),
        (offer(Acknowledge, 'acknowledge'), 'another node offers ~/acknowledge'),
        (offer(SetBool, 'team_stop'), 'another node offers ~/team_stop'),
    ):
        check(act, reason)
    # Where stops could get lost, the kart stays stopped: nobody knows what was missed.
    lost = [f'a publisher of ~/{remote} is not RELIABLE' for remote in ('msr', 'tsr')]
    for remote, reason in zip(('msr', 'tsr'), lost, strict=True):
        with RosSide('second', race.bridge.domain) as second:
            publish(Bool, remote, best_effort)(second)
            wait_for_stop(reason)
    told = race.team.wait_for(lambda state: several not in state.reason, 'the second to be gone')
    assert all(reason in told.reason for reason in lost)
    assert (told.team_stop, state_of(told.state)) == (True, RED_RED)
    # Either odometry may be the one that stands still.
    with RosSide('second', race.bridge.domain) as second:
        publish(Odometry, 'odom', 10)(second)
        wait_for_stop(f'{several}odom: /second, /team')
        race.control.say(RED_RED)
        race.team.wait_for(lambda told: state_of(told.commanded) is RED_RED, 'the stop')
        for _ in range(100):
            answer = race.team.acknowledge(RED_RED)
            assert not answer.success
            assert f'{several}odom' in answer.message
    race.team.wait_until_polled(lambda: race.team.acknowledge(RED_RED).success, 'one alone')


def test_a_remote_or_contact_that_is_wired_stops_the_kart_unless_it_is_certainly_closed(
    start_bridge: StartBridge, join_team: JoinTeam
) -> None:
    team = join_team(start_bridge(tsr_timeout=0.5, msr_timeout=0.5))
    remote, contact = 'the safety remote', "the MSR's contact"
    silent = f'nothing from {remote} for 0.5 s, nothing from {contact} for 0.5 s'
    topics = ('/kart_bridge/tsr', '/kart_bridge/msr')
    publishers = [team.node.create_publisher(Bool, each, 1) for each in topics]
    contacts = Bool()

    def wait_for_stop(reason: str) -> None:
        team.wait_for(lambda state: state.team_stop and reason in state.reason, reason)

    wait_for_stop(silent)
    reading = team.node.create_timer(0.05, lambda: [each.publish(contacts) for each in publishers])
    team.wait_for(lambda state: not state.team_stop, 'both closed')
    contacts.data = True
    wait_for_stop(f'{remote} says stop, {contact} is open')
    contacts.data = False
    team.wait_for(lambda state: not state.team_stop, 'both closed again')
    reading.cancel()
    wait_for_stop(silent)


# ----- the bridge's own end ----------------------------------------------------------------


def test_a_bridge_that_fails_or_does_not_hear_its_team_stops_the_kart(
    parts: contextlib.ExitStack, tmp_path: pathlib.Path
) -> None:
    race = OneKartRace(parts, program_of(BridgeThatRaises, tmp_path))
    stack = parts.enter_context(start_stack(race.bridge.domain))

    def check(reason: str) -> None:
        race.drive(stack)
        assert reason in race.team.wait_for_state(RED_RED).reason
        race.team.wait_for_stop(True)
        race.team.wait_for_speed(lambda speed: speed == 0.0)

    check('the bridge has ended')
    assert race.bridge.wait() == 1
    assert 'LookupError: the fault' in race.bridge.output

    stack.lines.clear()
    race.control.say(IN_GARAGE)
    race.start_bridge({}, program_of(BridgeThatHangs, tmp_path))
    race.team.wait_for_state(IN_GARAGE)
    check("the bridge has not received its team's messages for 1 s")
    race.bridge.kill()


def test_a_stack_that_fails_brakes_to_a_stop(
    parts: contextlib.ExitStack, tmp_path: pathlib.Path
) -> None:
    race = OneKartRace(parts)
    program = program_of(StackThatRaises, tmp_path)
    with start_stack(race.bridge.domain, program) as stack:
        race.drive(stack)
        assert stack.wait() == 1
        assert 'LookupError: the fault' in stack.output
    race.team.wait_for_speed(lambda speed: speed == 0.0)


# ----- a wrong environment -----------------------------------------------------------------


@pytest.mark.parametrize(
    ('package', 'program', 'arguments', 'environment', 'said'),
    [
        # Our nodes all start by one function (test_bad_settings.py).
        ('evgp_kart_bridge', 'example_stack', (), {'ROS_DOMAIN_ID': '233'}, '233'),
        ('evgp_rcs_console', 'rcs_ctl', ('watch',), {'ROS_DOMAIN_ID': '233'}, '233'),
        (
            *('evgp_kart_bridge', 'shortest_stack', (), {'RMW_IMPLEMENTATION': 'rmw_none_cpp'}),
            'RMW_IMPLEMENTATION is rmw_none_cpp, which is not installed here',
        ),
    ],
)
def test_a_ros_domain_or_middleware_that_does_not_exist_is_refused_in_one_sentence(
    package: str, program: str, arguments: tuple[str, ...], environment: dict[str, str], said: str
) -> None:
    done = subprocess.run(
        [executable(package, program), *arguments],
        env={**os.environ, **environment},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 2, done.stderr
    (line,) = (done.stdout + done.stderr).strip().splitlines()
    assert said in line


# ----- one kart, which no test here ends ---------------------------------------------------


@pytest.fixture(scope='module')
def the_kart() -> Iterator[OneKartRace]:
    with contextlib.ExitStack() as parts:
        yield OneKartRace(
            parts, auto_acknowledge_stop=True, standstill_time=0.2, drive_in_garage=True
        )


@pytest.fixture
def kart(the_kart: OneKartRace) -> OneKartRace:
    """Return a kart in the garage, whose odometry says that it stands; no test here ends it."""
    the_kart.command(IN_GARAGE)
    the_kart.team.roll_at(0.0)
    the_kart.bridge.lines.clear()
    return the_kart


def test_an_acknowledgement_that_cannot_be_taken_is_answered_with_what_to_send(
    kart: OneKartRace,
) -> None:
    kart.team.wait_for_stop(False)  # in the garage, as its team has set
    for state, said in (
        (GREEN_GREEN, 'race control commands IN_GARAGE, not GREEN_GREEN'),
        (None, '0 is not a race state'),
    ):
        answer = kart.team.acknowledge(state)
        assert not answer.success
        assert answer.message.startswith(said)
        assert f'{state_message(IN_GARAGE).state} IN_GARAGE' in answer.message
    for commanded in (GRID_ACTIVE, RED_RED):
        kart.command(commanded)
        told = kart.team.state
        assert told is not None
        answer = kart.team.acknowledge(None, 0)
        assert not answer.success
        said = f'order: {told.order}, reached: {{state: {told.reached.state}}}'
        assert answer.message == f'once the kart has reached that state, send {{{said}}}'
        kart.team.wait_until_polled(
            lambda told=told: kart.team.acknowledge(state_of(told.reached), told.order).success,
            f'what it says to be taken: {said}',
        )


def test_no_red_is_acknowledged_while_the_pose_moves_whatever_the_twist_says(
    kart: OneKartRace,
) -> None:
    kart.green()
    kart.team.roll_at(6.0)
    kart.bridge.wait_for_line('counts as moving: the pose')
    kart.command(RED_RED)
    assert not kart.team.acknowledge(RED_RED).success
    kart.team.roll_at(0.0)
    kart.control.wait_until_it_says(RED_RED)


def test_a_kart_that_stops_itself_in_green_green_says_red_red_once_it_stands(
    kart: OneKartRace,
) -> None:
    kart.green()
    kart.team.drive_at(3.0)
    kart.acknowledge(GREEN_GREEN)
    stopped = kart.team.team_stop(True)
    told = kart.team.wait_for_state(RED_RED)
    assert stopped.message == f'The kart obeys RED_RED: {told.reason}'
    assert (state_of(told.reached), told.acknowledged) == (RED_RED, False)
    moving = kart.team.acknowledge(RED_RED)
    assert 'odometry says 3.00 m/s' in moving.message
    assert 'standstill_speed' in moving.message
    assert kart.control.said is GREEN_GREEN
    kart.team.drive_at(0.0)
    kart.control.wait_until_it_says(RED_RED)
    kart.bridge.wait_for_line('RED_RED is acknowledged')
    assert kart.team.team_stop(False).success
    told = kart.team.wait_for(lambda state: not state.team_stop, 'the release')
    assert (state_of(told.commanded), state_of(told.state)) == (GREEN_GREEN, RED_RED)
    assert kart.team.stop is True


def test_a_driver_by_the_plain_state_stops_by_it_and_by_its_silence_and_needs_a_new_grid_to_start(
    kart: OneKartRace, start_base: StartBase, parts: contextlib.ExitStack
) -> None:
    base = start_base(kart.bridge)
    told = kart.team.hear(Twist, '/cmd_vel')

    def start_driver() -> Process:
        domain = kart.bridge.domain
        return parts.enter_context(Process('evgp_kart_bridge', 'plain_driver', domain))

    def check_that_it_stands() -> None:
        told.clear()
        kart.team.wait_until(lambda: len(told) > 20, lambda: 'commands')
        assert {command.linear.x for command in told} == {0.0}

    def go() -> None:
        kart.green()  # the test's team acknowledges
        base.wait_for_speed(lambda speed: speed > 1.0)

    driver = start_driver()
    driver.wait_for_line('IN_GARAGE')
    go()
    kart.command(RED_FLAG)  # it never gets faster after that, however slow it is
    driver.wait_for_line('RED_FLAG')
    speed = base.speed
    told.clear()
    kart.team.wait_until(lambda: len(told) > 10, lambda: 'commands')
    assert max(command.linear.x for command in told) < speed + 0.1
    kart.command(IN_GARAGE)
    go()
    driver.kill()
    base.wait_for_speed(lambda speed: speed == 0.0)
    driver = start_driver()
    driver.wait_for_line('GREEN_GREEN: waiting for the next GRID_ACTIVE')
    check_that_it_stands()

    kart.command(IN_GARAGE)
    driver.wait_for_line('IN_GARAGE')
    go()
    kart.bridge.signal(signal.SIGSTOP)
    driver.wait_for_line('nothing on kart_bridge/state for 0.5 s: stopping')
    base.wait_for_speed(lambda speed: speed == 0.0)
    driver.lines.clear()
    kart.bridge.signal(signal.SIGCONT)
    # After 1 s of silence the bridge itself goes to RED_RED; it may have been frozen for less.
    driver.wait_for_line(r'waiting for the next GRID_ACTIVE|: RED_RED$')
    check_that_it_stands()
