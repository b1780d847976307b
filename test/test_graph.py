# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The ROS graphs: nobody on another machine is in them, and everybody on this one is."""

from __future__ import annotations

import contextlib
import pathlib
import re
import socket
from xml.etree import ElementTree

from evgp_node import graph
from evgp_node.process import IN_THE_WAY
from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.domains import Domain, free_port
from evgp_testing.fixtures import StartRaceControl
from evgp_testing.kart import Bridge
from evgp_testing.official import Official
from evgp_testing.part import PATIENCE
from evgp_testing.process import executable, Process, Program
from evgp_testing.race_control import address_of, RaceControl, settings, write_roster
from evgp_testing.wire_kart import WireKart
import pytest
from rig.foreign_node import ForeignNode
from rig.networks import Namespace, need_networks

KARTS = '10.77.0.1'
"""Race control's address on the karts' network, and a bridge's on its own: the same here."""

STRANGER = '10.77.0.66'
OFFICIALS = '10.78.0.1'
OFFICIAL = '10.78.0.2'

NEIGHBOURS: dict[str, dict[str, str]] = {
    'as an installed ROS has it': {},
    'on its own machine only': {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'},
}

STRANGERS = [
    {
        'ROS_AUTOMATIC_DISCOVERY_RANGE': reach,
        'ROS_STATIC_PEERS': f'{KARTS};{OFFICIALS}',
        'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4',
    }
    for reach in ('SUBNET', 'LOCALHOST')
]
"""What strangers have in their environments. They come by the network, because a network namespace
keeps no shared memory apart; over it, some strangers among themselves hung (in `publish`, with the
interpreter's lock). One whose range is LOCALHOST uses it anyway: ROS adds it there."""

WIDEST = {
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET',
    'ROS_STATIC_PEERS': f'{STRANGER};{OFFICIAL}',
    'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4',
    'RMW_FASTRTPS_USE_QOS_FROM_XML': '1',
}
"""Everything that widens a graph, in the environment of our own programs."""


class TwoNetworks:
    """A machine with one cable to the karts' network, and one to the officials'."""

    def __init__(self, stack: contextlib.ExitStack) -> None:
        """Make it, a stranger's machine on the first, and an official's on the second."""
        self.own, self.stranger, self.official = (
            stack.enter_context(Namespace()) for _ in range(3)
        )
        self.own.cable('karts', KARTS, self.stranger, STRANGER)
        self.plug_in_officials()
        self.stranger.ip(
            # Linux takes a datagram for any of its addresses at any interface.
            f'route add {OFFICIALS} via {KARTS}',
            'route add 239.0.0.0/8 dev eth0',
        )
        # As with two network cards, one of which leads on: whoever knows no better goes there.
        self.own.ip(f'route add default via {STRANGER}')

    def plug_in_officials(self) -> None:
        """Lay the cable to the officials' network."""
        self.own.cable('officials', OFFICIALS, self.official, OFFICIAL)
        self.official.ip('route add 239.0.0.0/8 dev eth0')


@pytest.fixture
def networks(parts: contextlib.ExitStack) -> TwoNetworks:
    """Return the networks; skip where none can be made, but not where all tests must run."""
    need_networks()
    return TwoNetworks(parts)


def strangers(networks: TwoNetworks, domain: int) -> list[ForeignNode]:
    """Start strangers on the karts' network, which look around in all ways at once."""
    with networks.stranger.inside():
        return [ForeignNode(domain, environment) for environment in STRANGERS]


def check_that_none_got_in(strangers: list[ForeignNode]) -> None:
    found = [each.found() for each in strangers]
    assert not any(found), found


def test_a_stranger_on_the_network_finds_nothing_of_race_control_or_a_bridge_and_changes_nothing(
    networks: TwoNetworks,
    start_race_control: StartRaceControl,
    parts: contextlib.ExitStack,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for variable in WIDEST.items():
        monkeypatch.setenv(*variable)
    with networks.own.inside():
        control = start_race_control(in_race=[1], address='0.0.0.0')
        bridge = beside(control, parts)
        official = parts.enter_context(Official(control.domain))
        watch = parts.enter_context(ctl(control.domain, 'watch'))
    before = official.wait_for_race(lambda race: race.karts, 'the race')
    for each in (control, bridge):
        each.wait_for_line('can be reached only from this machine')
    watch.wait_for_line('Team 1')

    check_that_none_got_in(strangers(networks, control.domain))
    official.command('kart/red_flag', kart=1)
    after = official.wait_for_race(
        lambda race: state_of(race.karts[0].sent) is RaceState.RED_FLAG, 'the flag'
    )
    assert after.state == before.state
    official.wait_for_event(lambda event: event.command, 'the only command')
    assert [event.command for event in official.events if event.command] == [
        msg.CommandAvailability.KART_RED_FLAG
    ]


def beside(control: RaceControl, parts: contextlib.ExitStack) -> Bridge:
    """Start a bridge on race control's domain: so one stranger looks for both."""
    return parts.enter_context(Bridge(control.domain, free_port(), address_of(1)))


def ctl(domain: int, *words: str) -> Program:
    return Program('rcs_ctl', [executable('evgp_rcs_console', 'rcs_ctl'), *words], domain)


def ended(program: Program) -> tuple[int, str]:
    """Return a program's exit code and what it printed; a busy machine takes its time."""
    with program:
        program.process.wait(2 * PATIENCE)
        return program.wait(), program.output


def check_that_an_official_sees(domain: int) -> None:
    """Check that a terminal in this namespace shows the race."""
    code, printed = ended(ctl(domain, 'watch', '--once', '--wait', '40'))
    assert (code, 'Team 1' in printed) == (0, True)


def test_a_race_goes_on_while_the_officials_address_is_gone_and_its_officials_are_back_with_it(
    networks: TwoNetworks,
    start_race_control: StartRaceControl,
    parts: contextlib.ExitStack,
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """
    A cable that is pulled takes the address along, where NetworkManager is in charge.

    Meanwhile, strangers on the karts' network get in no more than without an officials' network.
    """
    with networks.own.inside(), monkeypatch.context() as patch:
        patch.setenv(graph.INTERFACE, OFFICIALS)
        control = start_race_control(in_race=[1], address=KARTS)
    assert f'at {OFFICIALS}' in control.wait_for_line('can be reached.*')[0]
    outside = strangers(networks, control.domain)
    with networks.own.inside():
        kart = parts.enter_context(
            WireKart(address_of(1), control.port, acknowledges=True, host=KARTS)
        )
        official = parts.enter_context(Official(control.domain))
    with networks.official.inside(), monkeypatch.context() as patch:
        patch.setenv(graph.INTERFACE, OFFICIAL)
        watch = parts.enter_context(ctl(control.domain, 'watch'))
    official.wait_for_connected(1)
    official.bring_to(RaceState.GREEN_GREEN, 1)
    watch.wait_for_line('GREEN GREEN')

    # A loose plug: the address goes and comes, and goes again while the fence moves.
    networks.own.ip(
        *(f'addr del {OFFICIALS}/24 dev officials', f'addr add {OFFICIALS}/24 dev officials') * 300
    )
    networks.own.ip('link del officials')
    control.wait_for_line(f'No interface of this machine has the address {OFFICIALS} now')
    kart.wait_for_frames(100)  # in 5 s; it would be given up as deaf after 2 s
    assert kart.state is RaceState.GREEN_GREEN
    official.command('red_flag')
    kart.wait_for_state(RaceState.RED_FLAG)
    with networks.own.inside(), ctl(control.domain, 'all-kill') as stopped:  # which starts now
        kart.wait_for_state(RaceState.RED_RED)
        assert stopped.wait() == 0

    watch.lines.clear()
    networks.plug_in_officials()  # an interface with another number
    control.wait_for_line('graph is in order again')
    watch.wait_for_line('RED RED')
    monkeypatch.setenv(graph.INTERFACE, OFFICIAL)
    with networks.official.inside():
        assert ended(ctl(control.domain, 'all-kill', '--wait', '40'))[0] == 0
        rival = race_control(parts, tmp_path, control.domain)
        assert rival.wait() == IN_THE_WAY
    (line,) = rival.output.splitlines()
    assert 'another race control publishes /rcs/race' in line
    check_that_none_got_in(outside)


def test_a_console_reaches_race_control_among_many_ros_processes_and_officials_are_told_of_them(
    parts: contextlib.ExitStack, domain: int, tmp_path: pathlib.Path
) -> None:
    def take(processes: range) -> None:
        """Take the ports of so many ROS processes, by their numbers in the domain."""
        for number in (2 * each + odd for each in processes for odd in (0, 1)):
            taken = parts.enter_context(socket.socket(type=socket.SOCK_DGRAM))
            with contextlib.suppress(OSError):  # race control or the official has it
                taken.bind((graph.LOOPBACK, 7410 + 250 * domain + number))

    take(range(graph.CROWDED - 5))
    control = parts.enter_context(RaceControl(tmp_path, domain, [1]))
    beside(control, parts)
    names = {'/rcs/all_kill', '/kart_bridge/acknowledge', '/rcs/race', '/kart_bridge/race_state'}
    for way, environment in NEIGHBOURS.items():
        found = ForeignNode(domain, environment, *names).found()
        assert names <= found, way
    check_that_an_official_sees(control.domain)
    official = parts.enter_context(Official(control.domain))
    official.wait_for_race(lambda race: race.karts and not race.alerts, 'a race without an alert')

    take(range(graph.CROWDED - 5, graph.CROWDED + 5))
    official.wait_for_race(
        lambda race: [each.kind for each in race.alerts] == [msg.Alert.GRAPH_TROUBLE],
        'the alert that there are too many',
    )
    official.command('all_kill')
    check_that_an_official_sees(control.domain)


# ----- what is refused --------------------------------------------------------------------


def test_race_control_whose_graph_can_be_reached_from_where_karts_connect_starts_only_if_accepted(
    networks: TwoNetworks,
    monkeypatch: pytest.MonkeyPatch,
    parts: contextlib.ExitStack,
    tmp_path: pathlib.Path,
    start_race_control: StartRaceControl,
) -> None:
    said = f'the ROS graph can be reached at {OFFICIALS}'
    monkeypatch.setenv(graph.INTERFACE, OFFICIALS)
    networks.own.ip('addr add 10.78.0.9/24 dev officials')
    with networks.own.inside():
        control = race_control(parts, tmp_path, address='10.78.0.9')
        accepted = start_race_control(in_race=[1], address='0.0.0.0', accept_open_graph=True)
        monkeypatch.setattr(graph, 'reachable_at', lambda: (OFFICIALS,))
        for address in ('0.0.0.0', OFFICIALS):
            with pytest.raises(graph.GraphError, match=said):
                graph.refuse_open_graph(address)
        graph.refuse_open_graph(KARTS)
        assert control.wait() == 2

    (line,) = control.output.splitlines()
    assert said in line
    assert f'at {OFFICIALS}' in accepted.wait_for_line('can be reached.*')[0]


def test_no_program_starts_on_an_interface_that_is_not_there(
    monkeypatch: pytest.MonkeyPatch, parts: contextlib.ExitStack, tmp_path: pathlib.Path
) -> None:
    monkeypatch.setenv(graph.INTERFACE, '10.1.0.5')
    control = race_control(parts, tmp_path)
    assert control.wait() == IN_THE_WAY
    (line,) = control.output.splitlines()
    assert re.search(r'no interface of this machine has .*10\.1\.0\.5.*Name one of', line)


def race_control(
    parts: contextlib.ExitStack, folder: pathlib.Path, domain: int = 0, **parameters: object
) -> Process:
    """Start a race control that need not come to listen; 0: on a domain of its own."""
    domain = domain or parts.enter_context(Domain()).number
    given = {**settings(folder, write_roster(folder, [1])), **parameters}
    return parts.enter_context(Process('evgp_rcs', 'rcs_node', domain, given))


@pytest.mark.parametrize(
    ('name', 'value', 'said'),
    [
        *((graph.INTERFACE, each, 'no interface') for each in ('0.0.0.0', '239.255.0.1', 'eth0')),
        *((graph.DOMAIN, each, f'{each}, which is not a ROS') for each in ('233', '-1', 'seven')),
    ],
)
def test_an_interface_or_domain_that_can_never_be_is_refused_for_good(
    name: str, value: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(name, value)
    with pytest.raises(graph.GraphError, match=said) as refusal:
        graph.bind_graph()
    assert not isinstance(refusal.value, graph.NotNowError)


def test_a_middleware_that_cannot_be_bound_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(graph, 'get_rmw_implementation_identifier', lambda: 'rmw_zenoh_cpp')
    with pytest.raises(graph.GraphError, match='rmw_zenoh_cpp cannot be bound'):
        graph.bind_graph()


# ----- what DDS is told -------------------------------------------------------------------


@pytest.mark.parametrize('interface', ['', OFFICIALS])
def test_cyclone_dds_is_told_of_these_interfaces_only(interface: str) -> None:
    """It cannot run here: this is the document only."""
    told = ElementTree.fromstring(graph.cyclone_dds_configuration(interface))  # noqa: S314

    addresses = [each.get('address') for each in told.iter('NetworkInterface')]
    assert addresses == ['127.0.0.1', *filter(None, [interface])]
    assert [each.text for each in told.iter('AllowMulticast')] == [
        'spdp' if interface else 'false'
    ]
