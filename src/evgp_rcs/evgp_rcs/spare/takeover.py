# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
``rcs_takeover`` (``make takeover``) makes a spare machine race control.

The spare machine takes race control's address only if nothing answers on any network of the old
race control. It then starts race control and the timekeeper, as ``make run`` would, with the copy
that ``rcs_spare`` has kept. A copy proves nothing about the karts, so the race comes back in
RED_RED, as after a crash. Race control keeps watching its address. If another machine gets it,
race control ends for good, and this machine releases the address.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
import contextlib
import ipaddress
import os
import pathlib
import sqlite3
import subprocess
import sys
import time

from evgp_node.folder import rcs_folder
from evgp_node.graph import bind_graph, fence_graph, GraphError, INTERFACE, interfaces
from evgp_node.network_cards import cards
from evgp_node.restarting import IN_THE_WAY, keep_running, WRONG_SETTING
from evgp_node.stream_file import BOOK
from evgp_protocol.frames import DEFAULT_PORT
from evgp_rcs.record.run_mark import leave_began, place
from evgp_rcs.ros.rival import refuse_rivals, RivalError
from evgp_rcs.spare.copies import (
    copies,
    latest,
    ORIGIN,
    PARAMETERS,
    RECORD,
    ROSTER,
    SpareError,
)
from evgp_rcs.spare.neighbours import ask, connect, link
import rclpy
from rclpy.context import Context
from rclpy.node import Node

# The shell releases the address when this process ends for whatever reason. Ctrl-C must not reach
# the shell.
_HOLD = """
trap '' INT HUP TERM QUIT
ip address add "$1" dev "$2" || exit 1
echo held
cat
ip address delete "$1" dev "$2"
"""


def look_among_officials(own_address: str) -> str:
    """Check the officials' network, where this machine has this address, as in `neighbours`."""
    interface = interfaces().get(own_address)
    if interface is None:
        return f'no interface of this machine has the address {own_address}'
    context = Context()
    try:
        bind_graph()
        rclpy.init(context=context)
        # With race control's name, this node looks for race control's topics.
        node = Node('rcs', context=context, start_parameter_services=False, enable_rosout=False)
        fence_graph()
        refuse_rivals(node)
    except GraphError as error:
        return str(error)
    except RivalError:
        return "race control answers on the officials' network"
    finally:
        context.try_shutdown()
    return link(interface.name)


@contextlib.contextmanager
def held(address: ipaddress.IPv4Interface, interface: str) -> Iterator[None]:
    """
    Add an address to an interface of this machine, and remove it at the end of the context.

    The address is also removed if this process ends first.

    :raises OSError: if the address cannot be added.
    """
    command = ['sh', '-c', _HOLD, 'sh', str(address), interface]
    with subprocess.Popen(
        command if os.geteuid() == 0 else ['sudo', *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as shell:
        assert shell.stdout is not None
        if not shell.stdout.readline():
            raise OSError(
                f'the address {address} cannot be added to {interface}. This needs root (sudo, or '
                'CAP_NET_ADMIN)'
            )
        yield


def _parameter(name: str, path: pathlib.Path) -> list[str]:
    """Return the words that set a parameter to a path, which ROS reads as YAML."""
    quoted = str(path).replace("'", "''")
    return ['-p', f"{name}:='{quoted}'"]


@contextlib.contextmanager
def timekeeper(copy: pathlib.Path) -> Iterator[None]:
    """Keep the timekeeper running beside race control, with the roster and book of a copy."""
    python = ['setpriv', '--pdeathsig', 'TERM', sys.executable, '-m', 'evgp_node.restarting']
    command = [sys.executable, '-m', 'evgp_timing.timekeeper', '--ros-args']
    command += [*_parameter('roster', copy / ROSTER), *_parameter('book', copy / BOOK)]
    with subprocess.Popen([*python, *command]) as program:
        try:
            yield
        finally:
            program.terminate()


def take_over(address: ipaddress.IPv4Interface, interface: str, port: int) -> int:
    """
    Take the address over if no other machine has it, and run race control until a final end.

    :return: the exit code, as for ``main``.
    :raises SpareError: if there is no copy.
    :raises OSError, sqlite3.Error, ValueError: if the copy cannot be used, or the address cannot
        be added.
    """
    copy, own = latest(), str(address.ip)
    _say(f'Looking for the old race control at {own}, on every network ...')
    looks = [connect(own, port, interface)]
    rehearsed = interface == 'lo' and address.ip.is_loopback  # there are no other machines
    if not rehearsed:
        looks.append(ask(own, interface))
    if officials := os.environ.get(INTERFACE, '').strip():
        looks.append(look_among_officials(officials))
    if source := (copy / ORIGIN).read_text(encoding='utf-8'):
        looks.append(ask(source))
    if reasons := '; '.join(filter(None, looks)):
        _say(f'REFUSED: {reasons}. Switch off and unplug the old machine, and plug this one in.')
        return IN_THE_WAY
    age = time.time() - (copy / RECORD).stat().st_mtime
    with contextlib.nullcontext() if rehearsed else held(address, interface):
        if copy == copies():  # so that a later copy does not overwrite it
            copy = copy.rename(rcs_folder() / f'takeover-{time.strftime("%Y%m%d-%H%M%S")}')
        leave_began(place(own, port))  # the first machine may have raced on after the copy
        _say(
            f'This machine is race control now. Its copy is {age:.0f} s old ({copy}). Any kart '
            'may be moving, so the race is in RED_RED. Ctrl-C ends race control and releases the '
            'address.'
        )
        command = [str(pathlib.Path(sys.argv[0]).with_name('rcs_node')), '--ros-args']
        command += ['--params-file', str(copy / PARAMETERS), '-p', f'address:={own}']
        command += [*_parameter('roster', copy / ROSTER), *_parameter('record', copy / RECORD)]
        with timekeeper(copy):
            code = keep_running([*command, '-p', f'port:={port}'], gives_way=True)
    if code == IN_THE_WAY:
        _say('ENDED: see above for what is in the way. This machine has released the address.')
    return code


def _say(text: str) -> None:
    print(f'takeover: {text}', file=sys.stderr, flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Take over race control's address, and run race control.

    :return: race control's exit code; 2 if there is no copy or a setting is wrong; 3 if the old
        machine answers or may be there, or if another machine gets the address.
    """
    parser = argparse.ArgumentParser(
        prog=os.environ.get('EVGP_CALLED', 'rcs_takeover'),
        description="Make this machine race control, at the old race control's address.",
    )
    add = parser.add_argument
    add(
        'address',
        type=ipv4_address,
        help="race control's address on the karts' network, such as 10.0.0.1/24",
    )
    add(
        'interface',
        choices=[each.name for each in cards()],
        metavar='interface',
        help="this machine's interface on the karts' network, such as eth0",
    )
    add('--port', type=int, default=DEFAULT_PORT, help='port for karts (default: %(default)s)')
    given = parser.parse_args(arguments)
    try:
        return take_over(given.address, given.interface, given.port)
    except (SpareError, OSError, sqlite3.Error, ValueError) as error:
        _say(f'NOT TAKEN OVER: {error}.')
        return WRONG_SETTING


def ipv4_address(text: str) -> ipaddress.IPv4Interface:
    """
    Return the address and network in a text. The network is a /24 if the text does not name it.

    :raises argparse.ArgumentTypeError: if the text is not an IPv4 address.
    """
    try:
        return ipaddress.IPv4Interface(text if '/' in text else f'{text}/24')
    except ValueError as error:
        raise argparse.ArgumentTypeError(f'{text!r} is not an IPv4 address') from error


if __name__ == '__main__':
    sys.exit(main())
