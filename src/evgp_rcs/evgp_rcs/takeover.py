# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
``rcs_takeover``, or ``make takeover``: a spare machine becomes race control, with its address.

It takes the address only if nobody answers on any network of the old one; then it starts race
control on the copy that ``rcs_spare`` has kept, as ``make run`` does. A copy proves nothing: the
race comes back in RED_RED, as after a crash. If another machine has the address later, this one
ends: two masters never command together.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
import contextlib
import ipaddress
import os
import pathlib
import signal
import sqlite3
import subprocess
import sys
import threading
import time

from evgp_node.graph import bind_graph, fence_graph, GraphError, INTERFACE, interfaces
from evgp_node.restarting import IN_THE_WAY, keep_running, WRONG_SETTING
from evgp_protocol.frames import DEFAULT_PORT
from evgp_rcs.folder import rcs_folder
from evgp_rcs.neighbours import announce, ask, ask_where_it_is, connect, Found, link, Look, why_not
from evgp_rcs.record import distrust
from evgp_rcs.rival import look_for_rivals
from evgp_rcs.spare import copies, latest, PARAMETERS, RECORD, ROSTER, SOURCE, SpareError
import rclpy
from rclpy.context import Context
from rclpy.node import Node

GRAPH_LOOK = 3.0
"""Time for which a race control is looked for among the officials, in seconds."""

ANNOUNCEMENTS = 5
"""How many times karts are told who has the address now; what one of them misses, the next has."""

# The kernel gives the address back however this process ends. Ctrl-C is not for the shell.
_HOLD = """
trap '' INT HUP TERM QUIT
ip address add "$1" dev "$2" || exit 1
echo held
cat
ip address delete "$1" dev "$2"
"""


def look_everywhere(address: str, port: int, interface: str, source: str) -> list[Look]:
    """
    Look for the old race control on every network that it had.

    :param source: the address of the machine that the copy comes from; empty: not known.
    """
    looks = [link(interface), ask(address, interface), connect(address, port, interface)]
    officials = os.environ.get(INTERFACE, '').strip()
    if officials:
        looks.append(_among_officials(officials))
    if source:
        looks.append(ask_where_it_is(source))
    return looks


def _among_officials(own_address: str) -> Look:
    interface = interfaces().get(own_address)
    if interface is None:
        return Look(Found.NOT_KNOWN, f'no interface of this machine has the address {own_address}')
    there = link(interface)
    if there.found:
        return there
    try:
        bind_graph()
    except GraphError as error:
        return Look(Found.NOT_KNOWN, str(error))
    context = Context()
    rclpy.init(context=context)
    try:
        node = Node(  # of race control's name, to look for its topics
            'rcs', context=context, start_parameter_services=False, enable_rosout=False
        )
        fence_graph()
        until = time.monotonic() + GRAPH_LOOK
        while time.monotonic() < until:
            if look_for_rivals(node):
                domain = context.get_domain_id()
                return Look(
                    Found.ANSWER,
                    f"race control is there on the officials' network (ROS domain {domain})",
                )
            time.sleep(0.05)  # rclpy has nothing to await a change of the graph by
    finally:
        context.shutdown()
    return Look(Found.NOTHING)


@contextlib.contextmanager
def held(address: ipaddress.IPv4Interface, interface: str) -> Iterator[None]:
    """
    Have an address of this machine, until the end of this process at the latest.

    :raises OSError: if it cannot be set.
    """
    rights = [] if os.geteuid() == 0 else ['sudo']
    with subprocess.Popen(
        [*rights, 'sh', '-c', _HOLD, 'sh', str(address), interface],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as shell:
        assert shell.stdout is not None
        if not shell.stdout.readline():
            raise OSError(
                f'{interface} cannot be given {address}: it takes root (sudo, or CAP_NET_ADMIN)'
            )
        yield


class Defence(threading.Thread):
    """
    Announces the address, and ends this process once another machine has it too.

    :ivar lost_to: who has it; empty: nobody.
    """

    def __init__(self, address: str, interface: str) -> None:
        """Begin."""
        super().__init__(name='defence', daemon=True)
        self.lost_to = ''
        self._where = address, interface
        self.start()

    def run(self) -> None:
        """Look again and again."""
        announcements = 0
        while not self.lost_to:
            if announcements < ANNOUNCEMENTS:
                announcements += 1
                announce(*self._where)
            look = ask(*self._where, probes=1)
            if look.found is Found.ANSWER:
                self.lost_to = look.what
                os.kill(os.getpid(), signal.SIGTERM)
            elif look.found is Found.NOT_KNOWN:
                time.sleep(1.0)  # its cable was pulled: nobody is reached either


def take_over(address: ipaddress.IPv4Interface, interface: str, port: int) -> int:
    """
    Take the address, if nobody has it, and run race control until it ends for good.

    :return: the exit code, as that of ``main``.
    :raises SpareError: if there is no copy, or it cannot be used.
    :raises OSError: if the address cannot be set.
    """
    copy = latest()
    source = (copy / SOURCE).read_text(encoding='utf-8')
    _say(f'Looking for the old race control at {address.ip}, on every network ...')
    reason = why_not(look_everywhere(str(address.ip), port, interface, source))
    if reason:
        _say(f'REFUSED: {reason}. Switch the old machine off and unplug it, and plug this one in.')
        return IN_THE_WAY
    age = time.time() - (copy / RECORD).stat().st_mtime
    with held(address, interface):
        if copy == copies():  # what comes after this is another copy
            copy = copy.rename(rcs_folder() / f'takeover-{time.strftime("%Y%m%d-%H%M%S")}')
        try:
            distrust(copy / RECORD)
        except (OSError, sqlite3.Error, ValueError) as error:
            raise SpareError(f'{copy} cannot be used: {error}') from error
        defence = Defence(str(address.ip), interface)
        _say(
            f'This machine is race control now, on a copy {age:.0f} s old ({copy}). Everything is '
            'in doubt: RED_RED. Ctrl-C ends it and gives the address back.'
        )
        settings = {
            'roster': copy / ROSTER,
            'record': copy / RECORD,
            'address': address.ip,
            'port': port,
        }
        given = [word for name in settings for word in ('-p', f'{name}:={settings[name]}')]
        code = keep_running(
            [
                str(pathlib.Path(sys.argv[0]).with_name('rcs_node')),
                *('--ros-args', '--params-file', str(copy / PARAMETERS), *given),
            ]
        )
    if defence.lost_to:
        _say(f'ENDED: {defence.lost_to}. Two machines must never be race control.')
        return 1
    return code


def _say(text: str) -> None:
    print(f'takeover: {text}', file=sys.stderr, flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Take race control's address over, and be race control.

    :return: that of race control; 1 if another machine came to have the address; 2 if there is no
        copy, or a setting is wrong; 3 if the old machine answers, or that cannot be known.
    """
    parser = argparse.ArgumentParser(
        prog='rcs_takeover', description="Become race control, at the old one's address."
    )
    add = parser.add_argument
    add('address', type=_address, help="race control's on the karts' network, such as 10.0.0.1/24")
    add('interface', help="this machine's, on the karts' network, such as eth0")
    add('--port', type=int, default=DEFAULT_PORT, help='where karts connect (%(default)s)')
    given = parser.parse_args(arguments)
    try:
        return take_over(given.address, given.interface, given.port)
    except (SpareError, OSError) as error:
        _say(f'NOT TAKEN OVER: {error}.')
        return WRONG_SETTING


def _address(text: str) -> ipaddress.IPv4Interface:
    return ipaddress.IPv4Interface(text if '/' in text else f'{text}/24')


if __name__ == '__main__':
    sys.exit(main())
