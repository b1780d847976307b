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
Whether another machine is there, on the karts' network or the officials'.

``ask`` and ``link`` go by what ``arping`` and ``ip`` say (iputils-arping, iproute2); `why_not` is
the decision, and pure. What cannot be known counts as bad as an answer.
"""

from __future__ import annotations

from collections.abc import Sequence
import enum
import errno
import json
import os
import re
import socket
import subprocess
from typing import Any, NamedTuple

ANSWER_WITHIN = 1.0
"""Maximum time for a connection to the old race control, in seconds."""


class Found(enum.IntEnum):
    """What a look has found; the worst is the highest."""

    NOTHING = 0
    NOT_KNOWN = 1
    ANSWER = 2


class Look(NamedTuple):
    """One look at a network; `what` says what answered where, or why that cannot be known."""

    found: Found
    what: str = ''


def why_not(looks: Sequence[Look]) -> str:
    """Return why an address must not be taken after these looks; empty: it may be."""
    worst = max(looks, key=lambda look: look.found, default=Look(Found.NOT_KNOWN, 'nobody looked'))
    return '' if worst.found is Found.NOTHING else worst.what


def link(interface: str) -> Look:
    """Look whether an interface is up, with a cable in it: otherwise nobody could be heard."""
    for entry in _ip('link', 'show', 'dev', interface):
        if {'UP', 'LOWER_UP'} <= {*entry['flags']}:
            return Look(Found.NOTHING)
    return Look(
        Found.NOT_KNOWN,
        f'{interface} is down or has no cable, so this machine cannot know who is there: plug it '
        'in, or name another interface',
    )


def ask(address: str, interface: str, probes: int = 3) -> Look:
    """
    Ask by ARP whether another machine on the network of an interface has an address (RFC 5227).

    It takes a second for each probe, unless there is an answer. Without root it needs an
    ``arping`` that is allowed to, as Debian's and Ubuntu's is.
    """
    command = ['arping', '-D', '-c', str(probes), '-w', str(probes + 1), '-I', interface, address]
    done = _run(command)
    # A mistake has the same exit code as an answer, and a cable that is pulled the same as none.
    # This machine itself answers where two of its interfaces are on one network.
    answer = re.search(r'(?:reply|request) from .*', done.stdout, re.IGNORECASE)
    own = {entry.get('address', '').lower() for entry in _ip('link')}
    is_own = answer and own.intersection(re.findall(r'[\w:]{17}', answer[0].lower()))
    if done.returncode == 1 and answer and not is_own:
        return Look(Found.ANSWER, f'another machine on {interface} has {address} ({answer[0]})')
    if is_own or (done.returncode == 0 and 'Received 0 response' in done.stdout):
        return Look(Found.NOTHING)
    return Look(
        Found.NOT_KNOWN,
        f'arping cannot ask on {interface} who has {address}: '
        f'{_last_line(done.stderr + done.stdout)} (apt-get install iputils-arping)',
    )


def ask_where_it_is(address: str) -> Look:
    """Ask the same about an address, at the interface that is on its network."""
    for route in _ip('route', 'get', address):
        if 'gateway' not in route:
            return max(link(route['dev']), ask(address, route['dev']))
    return Look(
        Found.NOT_KNOWN,
        f'this machine has no address on the network of {address} now, so it cannot know whether '
        'that machine is off',
    )


def connect(address: str, port: int, interface: str) -> Look:
    """Look whether anything answers at a TCP port; off loopback, a refusal is an answer."""
    with socket.socket() as trying:
        trying.settimeout(ANSWER_WITHIN)
        trying.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, interface.encode())
        refused = 0 if interface == 'lo' else errno.ECONNREFUSED
        if trying.connect_ex((address, port)) in (0, refused):
            return Look(Found.ANSWER, f'{address} answers at TCP port {port}')
    return Look(Found.NOTHING)


def announce(address: str, interface: str) -> None:
    """Tell everybody on a network that this machine has an address (gratuitous ARP)."""
    _run(['arping', '-U', '-c', '1', '-w', '1', '-I', interface, address])


def _ip(*words: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(_run(['ip', '-json', *words]).stdout or '[]')
    return found


def _run(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Run a command beside the terminal, whose Ctrl-C is not for it."""
    try:
        return subprocess.run(
            command,
            capture_output=True,
            text=True,
            check=False,
            start_new_session=True,
            env={**os.environ, 'LC_ALL': 'C'},
        )
    except OSError as error:
        return subprocess.CompletedProcess(command, 127, '', f'{command[0]}: {error.strerror}')


def _last_line(text: str) -> str:
    return (text.strip().splitlines() or ['it says nothing'])[-1]
