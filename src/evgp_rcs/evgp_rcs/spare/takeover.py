# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
``rcs_takeover``, or ``make takeover``: a spare machine becomes race control, with its address.

It takes the address only if nobody answers on any network of the old one; then it starts race
control and the timekeeper on the copy that ``rcs_spare`` has kept, as ``make run`` does. A copy
proves nothing: the race comes back in RED_RED, as after a crash. Race control watches its address
all the time. If another machine comes to have it, race control ends, does not start again, and the
address is given back.
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
from evgp_node.restarting import IN_THE_WAY, keep_running, WRONG_SETTING
from evgp_node.stream import BOOK
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
from evgp_rcs.spare.neighbours import ask, ask_where_it_is, connect, Found, link, Look, why_not
import rclpy
from rclpy.context import Context
from rclpy.node import Node

# The kernel gives the address back however this process ends. Ctrl-C is not for the shell.
_HOLD = """
trap '' INT HUP TERM QUIT
ip address add "$1" dev "$2" || exit 1
echo held
cat
ip address delete "$1" dev "$2"
"""


def look_among_officials(own_address: str) -> Look:
    """Look for a race control on the officials' network, where this machine has that address."""
    interface = interfaces().get(own_address)
    if interface is None:
        return Look(Found.NOT_KNOWN, f'no interface of this machine has the address {own_address}')
    context = Context()
    try:
        bind_graph()
        rclpy.init(context=context)
        # Of race control's name, to look for its topics.
        node = Node('rcs', context=context, start_parameter_services=False, enable_rosout=False)
        fence_graph()
        refuse_rivals(node)
    except GraphError as error:
        return Look(Found.NOT_KNOWN, str(error))
    except RivalError:
        return Look(Found.ANSWER, "race control answers on the officials' network")
    finally:
        context.try_shutdown()
    return link(interface)


@contextlib.contextmanager
def held(address: ipaddress.IPv4Interface, interface: str) -> Iterator[None]:
    """
    Give this machine an address, until this process ends at the latest.

    :raises OSError: if it cannot be set.
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
                f'{interface} cannot be given {address}; it takes root (sudo, or CAP_NET_ADMIN)'
            )
        yield


@contextlib.contextmanager
def timekeeper(copy: pathlib.Path) -> Iterator[None]:
    """Keep the timekeeper running beside race control, on the book of a copy."""
    python = ['setpriv', '--pdeathsig', 'TERM', sys.executable, '-m', 'evgp_node.restarting']
    command = [sys.executable, '-m', 'evgp_timing.timekeeper', '--ros-args']
    command += ['-p', f'roster:={copy / ROSTER}', '-p', f'book:={copy / BOOK}']
    with subprocess.Popen([*python, *command]) as program:
        try:
            yield
        finally:
            program.terminate()


def take_over(address: ipaddress.IPv4Interface, interface: str, port: int) -> int:
    """
    Take the address, if nobody has it, and run race control until it ends for good.

    :return: the exit code, as that of ``main``.
    :raises SpareError: if there is no copy.
    :raises OSError, sqlite3.Error, ValueError: if the copy cannot be used, or the address cannot
        be set.
    """
    copy, own = latest(), str(address.ip)
    _say(f'Looking for the old race control at {own}, on every network ...')
    looks = [connect(own, port, interface)]
    rehearsed = interface == 'lo' and address.ip.is_loopback  # nobody else can be there
    if not rehearsed:
        looks.append(ask(own, interface))
    if officials := os.environ.get(INTERFACE, '').strip():
        looks.append(look_among_officials(officials))
    if source := (copy / ORIGIN).read_text(encoding='utf-8'):
        looks.append(ask_where_it_is(source))
    if reason := why_not(looks):
        _say(f'REFUSED: {reason}. Switch the old machine off and unplug it, and plug this one in.')
        return IN_THE_WAY
    age = time.time() - (copy / RECORD).stat().st_mtime
    with contextlib.nullcontext() if rehearsed else held(address, interface):
        if copy == copies():  # what comes after this is another copy
            copy = copy.rename(rcs_folder() / f'takeover-{time.strftime("%Y%m%d-%H%M%S")}')
        leave_began(place(own, port))  # the first machine may have raced on since the copy
        _say(
            f'This machine is race control now, on a copy {age:.0f} s old ({copy}). Everything is '
            'in doubt: RED_RED. Ctrl-C ends it and gives the address back.'
        )
        command = [str(pathlib.Path(sys.argv[0]).with_name('rcs_node')), '--ros-args']
        command += ['--params-file', str(copy / PARAMETERS), '-p', f'address:={own}']
        command += ['-p', f'roster:={copy / ROSTER}', '-p', f'record:={copy / RECORD}']
        with timekeeper(copy):
            code = keep_running([*command, '-p', f'port:={port}'], gives_way=True)
    if code == IN_THE_WAY:
        _say('ENDED: something is in the way, as said above, and the address is given back.')
    return code


def _say(text: str) -> None:
    print(f'takeover: {text}', file=sys.stderr, flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Take race control's address over, and be race control.

    :return: that of race control; 2 if there is no copy, or a setting is wrong; 3 if the old
        machine answers, if that cannot be known, or if another one came to have the address.
    """
    parser = argparse.ArgumentParser(
        prog=os.environ.get('EVGP_CALLED', 'rcs_takeover'),
        description="Become race control, at the old one's address.",
    )
    add = parser.add_argument
    add(
        'address',
        type=ipv4_address,
        help="race control's address on the karts' network, such as 10.0.0.1/24",
    )
    add('interface', help="this machine's interface on the karts' network, such as eth0")
    add('--port', type=int, default=DEFAULT_PORT, help='where karts connect (%(default)s)')
    given = parser.parse_args(arguments)
    try:
        return take_over(given.address, given.interface, given.port)
    except (SpareError, OSError, sqlite3.Error, ValueError) as error:
        _say(f'NOT TAKEN OVER: {error}.')
        return WRONG_SETTING


def ipv4_address(text: str) -> ipaddress.IPv4Interface:
    """Return an address and its network; if the text does not name the network, a /24."""
    return ipaddress.IPv4Interface(text if '/' in text else f'{text}/24')


if __name__ == '__main__':
    sys.exit(main())
