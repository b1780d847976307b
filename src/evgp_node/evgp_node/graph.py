# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Binds the ROS graph of this process to loopback, whatever the environment says.

Without SROS2, anyone who can send to a node's DDS sockets can call the node's services. Each of
our programs therefore decides for itself where they are. Before ``rclpy.init``, `bind_graph` tells
DDS to open its sockets only on 127.0.0.1. `fence_graph` then makes the kernel drop everything that
reaches them through another interface. `INTERFACE` adds one more interface by its address, and an
unplugged interface is used again when it comes back with that address.

`reachable_at` reads the result from the sockets themselves and not from the settings.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import ctypes
import html
import ipaddress
import os
import pathlib
import select
import socket
import struct
import sys
import tempfile
import threading

from evgp_node.network_cards import Card, card_news, cards, forget_news
from rclpy.utilities import get_rmw_implementation_identifier

INTERFACE = 'EVGP_GRAPH_INTERFACE'
"""Environment variable with this machine's IPv4 address on the one interface that the graph uses
besides loopback; if it is empty or not set, the graph uses only loopback."""

DOMAIN = 'ROS_DOMAIN_ID'
"""Environment variable with the number of the ROS domain."""

LAST_DOMAIN = 232
"""The last domain that has UDP ports (7400 + 250 for each domain)."""

EVERY = '0.0.0.0'
"""What `reachable_at` returns for every address of this machine."""

LOOPBACK = '127.0.0.1'

ANNOUNCEMENT = 1
"""Time between two announcements of this process to the others, in seconds. A node that does not
search for this process finds it within this time. (With ROS's own SUBNET, nodes search only the
network.)"""

PROCESSES = 120
"""Maximum number of ROS processes on this machine in one domain, because a domain has no more
ports."""

CROWDED = 60
"""Number of ROS processes on this machine in one domain above which race control warns officials.
Each process announces itself to every other; with 115 processes, this took 1.6 processors."""

HEARTBEAT = 0.1
"""Time that a sender waits for an acknowledgement before it asks for one, in seconds. A lost
message arrives late by about this much. Fast DDS's default of 3 s would delay an official's call
or its answer by that much. Cyclone DDS's default is 0.1 s."""

RECEIVE_BUFFER_BYTES = 4 * 2**20
"""Receive buffer of each socket of Fast DDS, in bytes, up to the kernel's net.core.rmem_max. The
``~/race`` of a thousand karts would fill the usual 0.2 MB, and the kernel would drop an answer."""

_OVERRIDDEN = (
    # These say where DDS searches for other processes.
    *('ROS_STATIC_PEERS', 'ROS_LOCALHOST_ONLY', 'ROS_DISCOVERY_SERVER', 'ROS_SUPER_CLIENT'),
    # These are other sources of Fast DDS's settings. FASTDDS_ENVIRONMENT_FILE overrides the rest.
    *('FASTDDS_ENVIRONMENT_FILE', 'FASTDDS_BUILTIN_TRANSPORTS', 'FASTDDS_STATISTICS'),
    *('RMW_FASTRTPS_USE_QOS_FROM_XML', 'RMW_FASTRTPS_PUBLICATION_MODE'),
)

KEEPS_APART = (
    *('FASTDDS_BUILTIN_TRANSPORTS', 'ROS_AUTOMATIC_DISCOVERY_RANGE=OFF'),
    'ROS_DISCOVERY_SERVER',
)
"""Variables with which a shell may keep its programs from reaching ours, which use UDP on
loopback."""

_FAST_DDS = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
<library_settings><intraprocess_delivery>{intraprocess}</intraprocess_delivery></library_settings>
<profiles>
  <transport_descriptors>
    <transport_descriptor>
      <transport_id>graph</transport_id>
      <type>UDPv4</type>
      <receiveBufferSize>{receive_buffer}</receiveBufferSize>
      <interfaceWhiteList>{addresses}</interfaceWhiteList>
      <maxInitialPeersRange>{processes}</maxInitialPeersRange>
    </transport_descriptor>
  </transport_descriptors>
  <participant profile_name="graph" is_default_profile="true">
    <rtps>
      {calls}
      <builtin>
        <discovery_config>
          <leaseAnnouncement><sec>{announcement}</sec></leaseAnnouncement>
        </discovery_config>
        {listening}
        <initialPeersList>{peers}</initialPeersList>
        <mutation_tries>{processes}</mutation_tries>
      </builtin>
      <userTransports><transport_id>graph</transport_id></userTransports>
      <useBuiltinTransports>false</useBuiltinTransports>
    </rtps>
  </participant>
  <data_writer profile_name="graph_writer" is_default_profile="true">
    <times><heartbeatPeriod><nanosec>{heartbeat_ns}</nanosec></heartbeatPeriod></times>
  </data_writer>
</profiles>
</dds>
"""

_CALLS = '<defaultUnicastLocatorList>{}</defaultUnicastLocatorList>'
_UNICAST = '<metatrafficUnicastLocatorList>{}</metatrafficUnicastLocatorList>'
_MULTICAST = '<metatrafficMulticastLocatorList>{}</metatrafficMulticastLocatorList>'
_LOCATOR = '<locator><udpv4><address>{}</address></udpv4></locator>'
_DISCOVERY_GROUP = '239.255.0.1'

_CYCLONE_DDS = """<CycloneDDS>
  <Domain Id="any">
    <General>
      <Interfaces>{interfaces}</Interfaces>
      <AllowMulticast>{multicast}</AllowMulticast>
    </General>
    <Discovery>
      <ParticipantIndex>auto</ParticipantIndex>
      <MaxAutoParticipantIndex>{processes}</MaxAutoParticipantIndex>
      <Peers><Peer address="127.0.0.1"/></Peers>
      <SPDPInterval>{announcement} s</SPDPInterval>
    </Discovery>
  </Domain>
</CycloneDDS>
"""


class GraphError(RuntimeError):
    """The graph cannot be bound as required. The text says why, and what to do."""


class NotNowError(GraphError):
    """The graph cannot be bound as required now, but perhaps later."""


def _refuse_domain() -> None:
    """Refuse what is not a ROS domain, or one without UDP ports."""
    given = os.environ.get(DOMAIN) or '0'
    if not given.isdecimal() or int(given) > LAST_DOMAIN:
        raise GraphError(
            f'{DOMAIN} is {given}, which is not a ROS domain. '
            f'Set a number from 0 to {LAST_DOMAIN}, preferably up to 101'
        )


def bind_graph(*, always_here: bool = False) -> None:
    """
    Make DDS open its sockets only on loopback and on the interface that `INTERFACE` names.

    Call this before ``rclpy.init``. It changes the environment of this process. With Fast DDS, it
    also sets `HEARTBEAT` and `RECEIVE_BUFFER_BYTES`.

    :param always_here: whether programs that start on this machine find this one even while the
        interface that `INTERFACE` names is gone.
    :raises NotNowError: if no interface has that address now.
    :raises GraphError: if no interface can have that address, if the ROS domain does not exist, or
        if this function cannot configure the ROS middleware.
    """
    _refuse_domain()
    interface = _named_interface()
    middleware = get_rmw_implementation_identifier()
    if not middleware.startswith(('rmw_fastrtps', 'rmw_cyclonedds')):
        raise GraphError(
            f'{middleware} cannot be bound to one interface here, so anyone on the network could '
            'send commands. Set RMW_IMPLEMENTATION=rmw_fastrtps_cpp'
        )
    for name in _OVERRIDDEN:
        os.environ.pop(name, None)
    # Only with this range does ROS leave everything to the settings below.
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SYSTEM_DEFAULT'
    # Race control's call to itself must prove that other calls can arrive (evgp_rcs.ros.node).
    content = fast_dds_profile(interface, intraprocess=False, always_here=always_here)
    profile = _private_file(content)
    os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] = profile
    os.environ['FASTDDS_DEFAULT_PROFILES_FILE'] = profile
    # Otherwise, a file with a certain name in the working directory would override the profile.
    os.environ['SKIP_DEFAULT_XML_FILE'] = '1'
    os.environ['SKIP_DEFAULT_XML'] = '1'
    os.environ['CYCLONEDDS_URI'] = cyclone_dds_configuration(interface)


def kept_apart_by() -> str:
    """
    Return the settings that may keep this process from reaching our programs, as text.

    Each has the form ``NAME=value``. They are separated by commas; without any, the text is empty.
    """
    found = []
    for name, _, bad in (each.partition('=') for each in KEEPS_APART):
        given = os.environ.get(name, '')
        if given not in ('', 'DEFAULT', 'UDPv4') and bad in ('', given):
            found.append(f'{name}={given}')
    return ', '.join(found)


def fence_graph() -> None:
    """
    Make the kernel drop datagrams that reach this process's UDP sockets by other interfaces.

    Call this as soon as there is a node, because the first node opens the sockets. Binding them to
    an address is not enough, because Linux accepts a datagram for any of its addresses on any
    interface. From then on, a thread follows the address that `INTERFACE` names to the interface
    that has it.

    :raises GraphError: if no interface can have that address.
    :raises NotNowError: if no interface has that address now, or DDS found no free port.
    """
    while _profiles:
        _profiles.pop().close()  # DDS has read the profile
    named = _named_interface()
    _fence(named)
    with udp_sockets() as found:
        listens = any(map(_is_read, found))
    if not listens:
        raise NotNowError(
            'too many ROS processes are running on this machine, so this one cannot be reached. A '
            f'ROS domain has ports for {PROCESSES}. End some of them, or use another {DOMAIN}'
        )
    if named and named not in _followed:
        _followed.add(named)
        # Create this socket here, because it belongs to the network of the thread that creates it.
        threading.Thread(
            target=_follow, args=(named, card_news()), name='fence', daemon=True
        ).start()


_followed: set[str] = set()


def _follow(named: str, news: socket.socket) -> None:
    """Renew the fence whenever an interface or an address of this machine comes or goes."""
    while True:
        with contextlib.suppress(OSError):  # the address is gone again
            _fence(named)
        select.select([news], [], [])
        forget_news(news)


def _fence(named: str) -> None:
    """Restrict each UDP socket to loopback and the interface that has this address, if any."""
    indices = [socket.if_nametoindex('lo')]
    with contextlib.suppress(KeyError, OSError):  # the interface was unplugged
        indices.append(interfaces()[named].number)
    with udp_sockets() as found:
        for each in found:
            _attach_filter(each, indices)
            if len(indices) > 1:
                _renew_multicast(each, named)


def keep_to_interface(server: socket.socket, address: str) -> None:
    """Restrict a TCP server to loopback and the interface that has this address now."""
    card = interfaces().get(address)
    loopback = socket.if_nametoindex('lo')
    _attach_filter(server, [loopback if card is None else card.number, loopback])


def network_of(address: str) -> ipaddress.IPv4Network | None:
    """Return the network of an address of this machine; None if no interface has it now."""
    own = (each for card in cards() for each in card.addresses)
    return next((each.network for each in own if str(each.ip) == address), None)


def trouble_of_graph(domain: int) -> str:
    """
    Return what is wrong with this process's graph, as a sentence; empty if nothing is.

    This takes about a millisecond. Any thread may call it.
    """
    named = os.environ.get(INTERFACE, '').strip()
    if named and named not in interfaces():
        return (
            f'No interface of this machine has the address {named} now, so consoles on other '
            'machines cannot reach race control. Plug it in. Until then, use this machine to stop '
            'karts'
        )
    if count_processes(domain) <= CROWDED:
        return ''
    return (
        f'More than {CROWDED} ROS processes are running on this machine in domain {domain}, which '
        f'has room for {PROCESSES}. End those that you do not need, or a console may fail to start'
    )


def count_processes(domain: int) -> int:
    """Return the number of ROS processes (strictly, contexts) of a domain on this machine."""
    first = 7410 + 250 * domain
    taken = {int(line[1].rpartition(':')[2], 16) for line in _lines(_NETWORK / 'udp')}
    return len(taken.intersection(range(first, first + 2 * PROCESSES, 2)))


class Inbox:
    """
    A check whether DDS still reads this process's sockets.

    A thread of DDS reads each socket. If that thread hangs, the oldest datagram stays unread.
    """

    def __init__(self) -> None:
        with udp_sockets() as found:
            read = {os.fstat(each.fileno()).st_ino: each for each in found if _is_read(each)}
            self._sockets = [each.dup() for each in read.values()]
        self._oldest = [(b'', 0)] * len(self._sockets)
        for each in self._sockets:
            each.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)

    def unread(self) -> int:
        """
        Check the sockets again.

        :return: the number of checks in a row, including this one, that found the same datagram
            unread; the largest such number of all sockets.
        """
        for at, each in enumerate(self._sockets):
            stamp = _oldest_arrival(each)
            before, looks = self._oldest[at]
            self._oldest[at] = stamp, (looks + 1 if stamp == before else 1) if stamp else 0
        return max(looks for _, looks in self._oldest)


def reachable_at() -> tuple[str, ...]:
    """
    Return the IPv4 addresses at which other machines can reach the graph of this process.

    They are the address that `INTERFACE` names and all others of its interface, because the fence
    (`fence_graph`) accepts everything that arrives there.
    """
    named = os.environ.get(INTERFACE, '').strip()
    if not named:
        return ()
    card = interfaces().get(named)
    own = {ipaddress.IPv4Address(named), *(each.ip for each in (card.addresses if card else ()))}
    return tuple(str(each) for each in sorted(own) if not each.is_loopback)


def refuse_open_graph(kart_address: str) -> None:
    """
    Refuse a graph that programs on the karts' network could reach.

    Call this once there is a node.

    :param kart_address: address at which race control listens for karts, or `EVERY`.
    :raises GraphError: if programs could reach the graph from there, and SROS2 is not enforced.
    """
    if is_security_enforced() or ipaddress.IPv4Address(kart_address).is_loopback:
        return
    at = reachable_at()
    if not at or kart_address not in (EVERY, *at):
        return
    karts = 'every address' if kart_address == EVERY else kart_address
    raise GraphError(
        f'karts connect at {karts}, and the ROS graph can be reached at {" and ".join(at)}, so '
        "anyone on the karts' network could start karts. Set the parameter address (make run "
        "ADDRESS=...) to this machine's address on the karts' network, and officials "
        "(OFFICIALS=...) to the one on the officials' network, or leave officials out. For other "
        'ways, see docs/security.md'
    )


def where_reachable() -> str:
    """Return a sentence that says where the graph of this process can be reached."""
    graph = f'The ROS graph of domain {os.environ.get(DOMAIN) or 0}'
    at = ' and '.join(reachable_at())
    if not at:
        return f'{graph} can be reached only from this machine'
    secured = ', and requires keys (SROS2)' if is_security_enforced() else ''
    return f'{graph} can be reached from other machines, at {at}{secured}'


def is_security_enforced() -> bool:
    return (
        os.environ.get('ROS_SECURITY_ENABLE') == 'true'
        and os.environ.get('ROS_SECURITY_STRATEGY') == 'Enforce'
    )


def fast_dds_profile(
    interface: str, *, intraprocess: bool = True, always_here: bool = False
) -> str:
    """
    Return the profile for Fast DDS.

    :param interface: address of the interface besides loopback; empty if there is none.
    :param intraprocess: whether messages within a process bypass the sockets.
    :param always_here: as for `bind_graph`. For each program with this setting, the others on the
        network send a copy of what is for it to their own loopback.
    """
    addresses = [LOOPBACK, *filter(None, [interface])]
    # DDS finds other machines by multicast, which it sends only through this interface.
    group = [_DISCOVERY_GROUP] if interface else []
    calls = listening = ''
    if not interface:
        # DDS must not open a multicast socket. Such a socket would hear every interface on which
        # any program of this machine has joined the group.
        listening = _UNICAST.format(_locators(addresses))
    elif always_here:
        # By itself, DDS would name only the interface to other programs.
        calls = _CALLS.format(_locators(addresses))
        listening = _UNICAST.format(_locators(addresses)) + _MULTICAST.format(_locators(group))
    return _FAST_DDS.format(
        addresses=''.join(f'<address>{each}</address>' for each in addresses),
        processes=PROCESSES,
        announcement=ANNOUNCEMENT,
        heartbeat_ns=round(HEARTBEAT * 1e9),
        receive_buffer=RECEIVE_BUFFER_BYTES,
        intraprocess='FULL' if intraprocess else 'OFF',
        calls=calls,
        listening=listening,
        peers=_locators([LOOPBACK, *group]),
    )


def _locators(addresses: list[str]) -> str:
    return ''.join(_LOCATOR.format(each) for each in addresses)


def cyclone_dds_configuration(interface: str) -> str:
    """
    Return the configuration for Cyclone DDS.

    :param interface: address of the interface besides loopback; empty if there is none.
    """
    addresses = [LOOPBACK, *filter(None, [interface])]
    return _CYCLONE_DDS.format(
        interfaces=''.join(
            f'<NetworkInterface address="{html.escape(each)}"/>' for each in addresses
        ),
        multicast='spdp' if interface else 'false',
        processes=PROCESSES,
        announcement=ANNOUNCEMENT,
    )


def _private_file(content: str) -> str:
    """
    Return the path of a file that only this user can read, and that `fence_graph` deletes.

    :raises GraphError: if no such file can be written.
    """
    # Fast DDS requires a file with a name, which a memfd does not have. If the disk is full, the
    # file is in memory, because a stop must be sent, and race control start, even then.
    data = content.encode()
    for folder in (None, '/dev/shm'):  # noqa: S108 - other users cannot take this file's name
        with contextlib.suppress(OSError):
            file = tempfile.NamedTemporaryFile(  # noqa: SIM115
                buffering=0, prefix='evgp-graph-', suffix='.xml', dir=folder
            )
            if file.write(data) == len(data):
                _profiles.append(file)
                return file.name
    raise GraphError('no file can be written to /tmp or to /dev/shm. Make room in one of them')


_profiles: list[tempfile._TemporaryFileWrapper[bytes]] = []


def _may_come(named: str) -> bool:
    """Return whether an interface could ever have this address."""
    try:
        address = ipaddress.IPv4Address(named)
    except ValueError:
        return False
    return not (address.is_unspecified or address.is_multicast)


def _named_interface() -> str:
    """
    Return the address that `INTERFACE` names; empty if the graph uses only loopback.

    :raises NotNowError: if no interface of this machine has the address now.
    :raises GraphError: if no interface can ever have the address.
    """
    named = os.environ.get(INTERFACE, '').strip()
    if not named:
        return ''
    known = interfaces()
    if named not in known:
        others = [each for each in known if not ipaddress.IPv4Address(each).is_loopback]
        raise (NotNowError if _may_come(named) else GraphError)(
            f"no interface of this machine has the officials' address {named!r} "
            f'({INTERFACE}). Name one of: {", ".join(others) or "(there is none)"}'
        )
    return '' if ipaddress.IPv4Address(named).is_loopback else named


# ----- from the kernel --------------------------------------------------------------------

_DESCRIPTORS = pathlib.Path('/proc/self/fd')
_NETWORK = pathlib.Path('/proc/thread-self/net')
_SO_ATTACH_FILTER = 26
_SO_TIMESTAMPNS = 35
_LOAD_INTERFACE = (0x20, 0, 0, 0xFFFFF000 + 8)  # BPF_LD | BPF_W | BPF_ABS, SKF_AD_IFINDEX
_JUMP_IF_EQUAL = 0x15  # BPF_JMP | BPF_JEQ | BPF_K
_RETURN = 0x06  # BPF_RET | BPF_K


def interfaces() -> dict[str, Card]:
    """Return this machine's interfaces by their IPv4 addresses."""
    return {str(each.ip): card for card in cards() for each in card.addresses}


@contextlib.contextmanager
def udp_sockets() -> Iterator[list[socket.socket]]:
    """Provide each UDP socket of this process in the network of the calling thread."""
    numbers = {line[9] for name in ('udp', 'udp6') for line in _lines(_NETWORK / name)}
    with contextlib.ExitStack() as stack:
        found = []
        for own in list(_DESCRIPTORS.iterdir()):
            try:
                # Use a copy, because the original may be closed and its number used again.
                descriptor = os.dup(int(own.name))
            except OSError:
                continue
            what = str((_DESCRIPTORS / str(descriptor)).readlink())
            if what.removeprefix('socket:[').removesuffix(']') in numbers:
                found.append(stack.enter_context(socket.socket(fileno=descriptor)))
            else:
                os.close(descriptor)
        yield found


def _is_read(each: socket.socket) -> bool:
    """Return whether Fast DDS reads this socket. It uses other sockets only to send."""
    return _sends_multicast_at(each) == '0.0.0.0'


def _sends_multicast_at(each: socket.socket) -> str:
    """Return a socket's multicast address. Fast DDS sets it on sockets that it sends with."""
    return socket.inet_ntoa(each.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, 4))


def _oldest_arrival(each: socket.socket) -> bytes:
    """Return when the oldest datagram in a socket arrived; empty if none waits."""
    try:
        what = socket.MSG_PEEK | socket.MSG_DONTWAIT
        _, further, _, _ = each.recvmsg(1, socket.CMSG_SPACE(16), what)
    except OSError:  # above all BlockingIOError
        return b''
    return next((data for _, kind, data in further if kind == _SO_TIMESTAMPNS), b'')


def _renew_multicast(each: socket.socket, named: str) -> None:
    """Let a socket send and receive multicast on the interface that has this address now."""
    bound = ipaddress.ip_address(each.getsockname()[0])
    if _sends_multicast_at(each) == named:
        # The kernel has stored the interface's number and not its address.
        each.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(named))
    elif bound.is_multicast or bound.is_unspecified:  # and so open to several interfaces
        membership = socket.inet_aton(_DISCOVERY_GROUP) + socket.inet_aton(named)
        for option in (socket.IP_DROP_MEMBERSHIP, socket.IP_ADD_MEMBERSHIP):
            with contextlib.suppress(OSError):  # not a member, or the address is gone
                each.setsockopt(socket.IPPROTO_IP, option, membership)


def _lines(path: pathlib.Path) -> list[list[str]]:
    with contextlib.suppress(FileNotFoundError), path.open(encoding='ascii') as file:
        return [line.split() for line in file][1:]
    return []  # a machine without IPv6


def _attach_filter(to: socket.socket, indices: list[int]) -> None:
    """Restrict a socket to the interfaces with these numbers."""
    count = len(indices)
    program = [
        _LOAD_INTERFACE,
        *((_JUMP_IF_EQUAL, count - at, 0, index) for at, index in enumerate(indices)),
        (_RETURN, 0, 0, 0),
        (_RETURN, 0, 0, 0xFFFFFFFF),
    ]
    code = ctypes.create_string_buffer(b''.join(struct.pack('HBBI', *each) for each in program))
    to.setsockopt(
        socket.SOL_SOCKET,
        _SO_ATTACH_FILTER,
        struct.pack('HP', len(program), ctypes.addressof(code)),
    )


if __name__ == '__main__':
    try:
        print(fast_dds_profile(_named_interface()), end='')
    except GraphError as error:
        sys.exit(str(error))
