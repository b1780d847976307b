# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The checks before a takeover for another race control on the karts' and the officials' networks.

Each check returns why this machine may not take the address over, as a phrase, or an empty text if
nothing else is there. An unknown result forbids the takeover as an answer does.
"""

from __future__ import annotations

import errno
import ipaddress
import socket

from evgp_node.network_cards import Card, cards
from evgp_rcs.karts.address_watch import AddressTakenError, AddressWatch, Question

ASK_FOR = 3.0
"""Time for which this machine asks who else has an address, in seconds."""

ANSWER_WITHIN = 1.0
"""Maximum time to connect to the old race control, in seconds."""


def link(interface: str) -> str:
    """Check that an interface is up and has a cable, or it would hear no other machine."""
    if any(each.name == interface and each.plugged for each in cards()):
        return ''
    return (
        f'{interface} is down or has no cable, so this machine cannot know who else is there. '
        'Plug it in, or name another interface'
    )


def ask(address: str, interface: str = '') -> str:
    """
    Ask for `ASK_FOR` whether another machine has an address.

    The questions are those of race control's own watch, but nothing is announced.

    :param interface: where to ask; if empty, on each interface in the address's network.
    """
    where, ip = interface or f'the network of {address}', ipaddress.IPv4Address(address)

    def there(card: Card) -> bool:
        if interface:
            return card.name == interface
        return any(ip in own.network for own in card.addresses)

    if not any(map(there, cards())):
        return f'this machine has no interface on {where} now, so it cannot know who else is there'
    watch = AddressWatch(
        lambda now: [Question(address, each) for each in now if there(each)], announces=False
    )
    try:
        return watch.first_look(ASK_FOR)
    except AddressTakenError as error:
        return str(error)
    finally:
        watch.close()


def connect(address: str, port: int, interface: str) -> str:
    """
    Check whether anything answers at a TCP port through an interface.

    Except on loopback, a refusal is an answer too.
    """
    with socket.socket() as trying:
        trying.settimeout(ANSWER_WITHIN)
        trying.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, interface.encode())
        refused = 0 if interface == 'lo' else errno.ECONNREFUSED
        if trying.connect_ex((address, port)) in (0, refused):
            return f'{address} answers at TCP port {port}'
    return ''
