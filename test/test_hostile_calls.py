# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""No call of any service, and no message, ends a node or makes it deaf: each is refused."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import ctypes
import random
import re
from typing import Any

from evgp_node.official import MOST
from evgp_node.qos import latched
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg, srv
from evgp_testing.domains import Domain, free_port
from evgp_testing.kart import Bridge
from evgp_testing.official import SERVICES
from evgp_testing.process import Process
from evgp_testing.race_control import address_of
from evgp_testing.ros_side import RosSide
from evgp_testing.wire_race import WireRace
from nav_msgs.msg import Odometry
import pytest
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
import rclpy
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger
from test_security import in_graph
from type_description_interfaces.srv import GetTypeDescription

OF_RCLPY: dict[str, Any] = {
    'describe_parameters': DescribeParameters,
    'get_parameters': GetParameters,
    'get_parameter_types': GetParameterTypes,
    'list_parameters': ListParameters,
    'set_parameters': SetParameters,
    'set_parameters_atomically': SetParametersAtomically,
    'get_type_description': GetTypeDescription,
}
"""The services that every node has from rclpy."""

ALL_KILL = msg.CommandAvailability.ALL_KILL

OF_BRIDGE: dict[str, Any] = {'acknowledge': srv.Acknowledge, 'team_stop': SetBool}

TEXTS = ['', '.', '/', '~', 'roster', 'use_sim_time', 'a' * 5000, '\0', 'ü', '{}', '%s%n', '..a']

NAMES = (
    *(b'', b'J\xfcrgen', b'\xff\xfe', b'\xc3(', b'\xed\xa0\x80', b'a\0b', b'\x1b[2J\r\n'),
    b'x' * 2**20,
)

NUMBERS = {
    'uint8': [0, 1, 9, 10, 200, 255],
    'uint16': [0, 1, 2, 65535],
    'uint32': [0, 1, 2**32 - 1],
    'uint64': [0, 1, 2**64 - 1],
    'int64': [0, -1, 2**63 - 1, -(2**63)],
    'double': [0.0, float('nan'), float('inf'), -1e308],
    'boolean': [False, True],
    'octet': [b'\0', b'\xff'],
}

NESTED = {
    'Parameter': Parameter,
    'rcl_interfaces/Parameter': Parameter,
    'rcl_interfaces/ParameterValue': ParameterValue,
    'evgp_rcs_msgs/RaceState': msg.RaceState,
}


class Hostile(RosSide):
    """A node that calls whatever there is, with whatever can be sent."""

    def __init__(self, domain: int, chance: random.Random) -> None:
        super().__init__('hostile', domain)
        self.chance = chance
        self.spin()

    def client(self, name: str, kind: Any) -> Any:
        """Return a client of a service that is there."""
        client = self.node.create_client(kind, name)
        assert client.wait_for_service(self.timeout), name
        return client

    def filled(self, kind: Any) -> Any:
        """Return a message with what nobody expects in each field."""
        message = kind()
        for field, of in message.get_fields_and_field_types().items():
            inner = of.removeprefix('sequence<').removesuffix('>').partition(',')[0]
            if of.startswith('sequence<'):
                count = self.chance.choice([0, 1, 2, 100])
                setattr(message, field, [self._value(inner) for _ in range(count)])
            elif not of.endswith(']'):
                setattr(message, field, self._value(of))
        return message

    def _value(self, of: str) -> Any:
        if of in NESTED:
            return self.filled(NESTED[of])
        # A new kind of field: say above what is hostile in it.
        return self.chance.choice(TEXTS if of.startswith('string') else NUMBERS[of])


# ----- requests that Python cannot make ---------------------------------------------------


class String(ctypes.Structure):
    """As ``rosidl_runtime_c__String``."""

    _fields_ = (('data', ctypes.c_char_p), ('size', ctypes.c_size_t), ('room', ctypes.c_size_t))


class Strings(ctypes.Structure):
    """As ``rosidl_runtime_c__String__Sequence``, which is all of a request of get_parameters."""

    _fields_ = (
        ('data', ctypes.POINTER(String)),
        ('size', ctypes.c_size_t),
        ('room', ctypes.c_size_t),
    )


def text_of(data: bytes) -> String:
    """Return a text that need be no UTF-8, as a client in C can send it."""
    return String(data, len(data), len(data) + 1)


def send(client: Any, request: ctypes.Structure) -> None:
    """Send a request that Python cannot make."""
    number = ctypes.c_int64()
    with client.handle:
        code = ctypes.CDLL('librcl.so').rcl_send_request(
            ctypes.c_void_p(client.handle.pointer), ctypes.byref(request), ctypes.byref(number)
        )
    assert code == 0


# ----- nodes of ours, each of which is a StrictNode --------------------------------------


Attacked = tuple[Process, str, dict[str, Any], int]


@pytest.fixture(scope='module')
def race(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRace]:
    """Return the race whose race control is attacked."""
    with WireRace(tmp_path_factory.mktemp('attacked'), [1]) as race:
        yield race
        assert race.control.close() == 0, race.control.output


@pytest.fixture(scope='module', params=['rcs', 'kart_bridge'])
def attacked(request: pytest.FixtureRequest) -> Iterator[Attacked]:
    """Return a running process, its node's name, that node's own services, and the domain."""
    if request.param == 'rcs':
        race = request.getfixturevalue('race')
        yield race.control, 'rcs', SERVICES, race.domain
    else:
        with (
            Domain() as domain,
            Bridge(domain.number, free_port(), address_of(1)) as bridge,
        ):
            yield bridge, 'kart_bridge', OF_BRIDGE, domain.number
            assert bridge.close() == 0, bridge.output


@pytest.fixture
def join_hostile(parts: contextlib.ExitStack, chance: random.Random) -> Callable[[int], Hostile]:
    """Return a function that lets a hostile node join a domain."""

    def join(domain: int) -> Hostile:
        return parts.enter_context(Hostile(domain, chance))

    return join


@pytest.fixture
def hostile(attacked: Attacked, join_hostile: Callable[[int], Hostile]) -> Hostile:
    """Return a hostile node in the graph of the attacked one."""
    return join_hostile(attacked[3])


def test_every_call_is_answered_whatever_is_in_it(attacked: Attacked, hostile: Hostile) -> None:
    _, name, own, _ = attacked
    for service, kind in {**OF_RCLPY, **own}.items():
        client = hostile.client(f'/{name}/{service}', kind)
        for _ in range(30):
            hostile.request(client, hostile.filled(kind.Request))


def test_no_parameter_can_be_changed_while_it_runs_least_of_all_to_a_type_that_does_not_exist(
    attacked: Attacked, hostile: Hostile
) -> None:
    process, name, _, _ = attacked
    listing, one_by_one, all_or_none = (
        hostile.client(f'/{name}/{each}', OF_RCLPY[each])
        for each in ('list_parameters', 'set_parameters', 'set_parameters_atomically')
    )
    listed: Any = hostile.request(listing, ListParameters.Request())
    integer = ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=1)
    for value, said in ((ParameterValue(type=200), '200'), (integer, '')) * 2:
        # rclpy lets a call make one that has no name, which nobody reads.
        parameters = [Parameter(name=each, value=value) for each in listed.result.names if each]
        each: Any = hostile.request(one_by_one, SetParameters.Request(parameters=parameters))
        every: Any = hostile.request(
            all_or_none, SetParametersAtomically.Request(parameters=parameters)
        )
        assert len(each.results) == len(parameters)
        for result in (*each.results, every.result):
            assert not result.successful
            assert said in result.reason

    process.wait_for_line('Traceback')


def test_a_name_that_is_no_text_and_random_messages_end_nothing(
    attacked: Attacked, hostile: Hostile
) -> None:
    _, name, _, _ = attacked
    for service in ('get_parameters', 'describe_parameters', 'get_parameter_types'):
        client = hostile.client(f'/{name}/{service}', OF_RCLPY[service])
        for text in (b'\xff\xfe', b'\xc3(', b'a\0b', b'\xed\xa0\x80'):
            send(client, Strings(ctypes.pointer(text_of(text)), 1, 1))
    if name == 'kart_bridge':
        for topic, kind, sizes in (('odom', Odometry, (0, 1, 4, 20, 800)), ('tsr', Bool, (0, 1))):
            publisher = hostile.node.create_publisher(kind, f'/{name}/{topic}', 10)
            hostile.wait_until_polled(lambda p=publisher: p.get_subscription_count() > 0, topic)
            for _ in range(100):
                body = hostile.chance.randbytes(hostile.chance.choice(sizes))
                publisher.publish(b'\0\1\0\0' + body)

    # It still answers and, once all tests are done, ends in order.
    client = hostile.client(f'/{name}/list_parameters', ListParameters)
    hostile.request(client, ListParameters.Request())


def test_a_stop_acts_whatever_its_official_is_called(
    race: WireRace, join_hostile: Callable[[int], Hostile]
) -> None:
    client = join_hostile(race.domain).client('/rcs/all_kill', SERVICES['all_kill'])
    for name in NAMES:
        heard = len(race.official.events)
        send(client, text_of(name))  # all of the request
        race.karts[0].wait_for_state(RaceState.RED_RED)
        told = race.official.wait_until(
            lambda heard=heard: [
                each for each in race.official.events[heard:] if each.command == ALL_KILL
            ],
            lambda name=name: f'the stop of {name[:9]!r}',
        )[0]
        assert told.success
        assert 0 < len(told.official) <= MOST
        assert told.official.isprintable()


def test_nothing_but_calls_occupies_the_threads_beside_race_controls_own(
    race: WireRace, join_hostile: Callable[[int], Hostile]
) -> None:
    hostile = join_hostile(race.domain)
    hostile.node.create_subscription(ParameterEvent, '/parameter_events', print, latched(1))
    race.control.wait_for_line(r"\[rcs\]: .*'/parameter_events', requesting incompatible QoS")

    beside = ('rcs_stops', '/'), ('rcs_roster', '/')
    hostile.wait_until_polled(
        lambda: '/rcs/all_kill' in in_graph(hostile.node, *beside).served, 'the nodes in the graph'
    )
    seen = in_graph(hostile.node, *beside)
    race.official.command('all_kill')

    race.karts[0].wait_for_state(RaceState.RED_RED)
    assert not seen.published | seen.subscribed
    assert not re.search(r'\[rcs_(stops|roster)\]', race.control.output)


# ----- what raises in a callback of ours --------------------------------------------------


class Broken(RosSide):
    """A node whose callbacks raise."""

    def __init__(self, domain: int) -> None:
        """Offer services that raise or cannot be answered, and listen to a topic so."""
        super().__init__('broken', domain)
        self.node.create_service(Trigger, '~/call', self._raise)
        self.node.create_service(Trigger, '~/unsendable', lambda *_: 'no response')
        self.node.create_subscription(Bool, '~/topic', self._raise, 10)
        # Whoever takes a request of it gets into trouble, as with one that cannot be read.
        unreadable = self.node.create_service(Trigger, '~/unreadable', self._raise)
        unreadable.srv_type = type('Unreadable', (), {'Request': int, 'Response': int})
        self.spin()

    def _raise(self, *_: object) -> None:
        raise ArithmeticError('broken')


@pytest.mark.parametrize(
    ('name', 'said'),
    [
        ('unreadable', 'A call of ~/unreadable could not be read'),
        ('unsendable', 'The answer of ~/unsendable could not be sent'),
    ],
)
def test_a_call_that_raises_is_refused_and_one_that_cannot_be_read_or_answered_is_dropped(
    parts: contextlib.ExitStack,
    domain: int,
    join_hostile: Callable[[int], Hostile],
    capfd: pytest.CaptureFixture[str],
    name: str,
    said: str,
) -> None:
    broken = parts.enter_context(Broken(domain))
    hostile = join_hostile(domain)
    dropped, raises = (hostile.client(f'/broken/{each}', Trigger) for each in (name, 'call'))

    for _ in range(3):
        dropped.call_async(Trigger.Request())
        answer: Any = hostile.request(raises, Trigger.Request())
        assert not answer.success
        assert 'USE THE MSR' in answer.message

    printed: list[str] = []
    hostile.wait_until_polled(
        lambda: printed.append(capfd.readouterr().err) or said in ''.join(printed),
        'the line that says so',
    )
    assert 'ArithmeticError: broken' in ''.join(printed)
    hostile.request(raises, Trigger.Request())
    assert not broken.failures


@pytest.mark.parametrize(
    ('shut_down', 'said'), [(True, r'ExternalShutdown|not valid'), (False, 'broken')]
)
def test_a_failure_that_no_call_made_is_told_and_ends_the_spinning(
    domain: int, join_hostile: Callable[[int], Hostile], shut_down: bool, said: str
) -> None:
    broken = Broken(domain)
    publisher = join_hostile(domain).node.create_publisher(Bool, '/broken/topic', 10)
    if shut_down:  # under the spinning
        rclpy.shutdown(context=broken.context)

    broken.wait_until_polled(
        lambda: (not shut_down and publisher.publish(Bool())) or broken.failures,
        'the failure is told',
    )

    with pytest.raises(AssertionError, match=said):
        broken.close()
