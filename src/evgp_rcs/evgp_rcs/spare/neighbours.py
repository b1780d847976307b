# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The checks before a takeover for another race control on the karts' and the officials' networks.

`why_not`, which is pure, decides whether the takeover is allowed. An unknown result forbids it as
an answer does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import enum
import errno
import ipaddress
import socket
from typing import NamedTuple

from evgp_node.network_cards import Card, cards
from evgp_rcs.karts.address_watch import AddressTakenError, AddressWatch, Question

ASK_FOR = 3.0
"""Time for which this machine asks who else has an address, in seconds."""

ANSWER_WITHIN = 1.0
"""Maximum time to connect to the old race control, in seconds."""


class Found(enum.IntEnum):
    """The result of a check, from best to worst."""

    NOTHING = 0
    NOT_KNOWN = 1
    ANSWER = 2


class Look(NamedTuple):
    """The check of a network. `what` says what answered, or why the result is not known."""

    found: Found
    what: str = ''


def why_not(looks: Sequence[Look]) -> str:
    """Return why these checks forbid taking an address over; empty if they allow it."""
    worst = max(looks, key=lambda look: look.found, default=Look(Found.NOT_KNOWN, 'not checked'))
    return '' if worst.found is Found.NOTHING else worst.what


def link(interface: str) -> Look:
    """Check that an interface is up and has a cable, or it would hear no other machine."""
    if any(each.name == interface and each.plugged for each in cards()):
        return Look(Found.NOTHING)
    return Look(
        Found.NOT_KNOWN,
        f'{interface} is down or has no cable, so this machine cannot know who else is there. '
        'Plug it in, or name another interface',
    )


def ask(address: str, interface: str, seconds: float = ASK_FOR) -> Look:
    """
    Ask whether another machine on the network of an interface has an address.

    The questions are those of race control's own watch, but nothing is announced.

    :param seconds: time without an answer after which nobody has the address, in seconds.
    """
    return _ask(address, interface, lambda card: card.name == interface, seconds)


def ask_where_it_is(address: str) -> Look:
    """Ask on each interface in an address's network whether another machine has the address."""
    where, ip = f'the network of {address}', ipaddress.IPv4Address(address)
    return _ask(address, where, lambda card: any(ip in own.network for own in card.addresses))


def _ask(
    address: str, where: str, there: Callable[[Card], bool], seconds: float = ASK_FOR
) -> Look:
    if not any(map(there, cards())):
        return Look(
            Found.NOT_KNOWN,
            f'this machine has no interface on {where} now, so it cannot know who else is there',
        )
    watch = AddressWatch(
        lambda now: [Question(address, each) for each in now if there(each)], announces=False
    )
    try:
        not_known = watch.first_look(seconds)
    except AddressTakenError as error:
        return Look(Found.ANSWER, str(error))
    finally:
        watch.close()
    return Look(Found.NOT_KNOWN, not_known) if not_known else Look(Found.NOTHING)


def connect(address: str, port: int, interface: str) -> Look:
    """
    Check whether anything answers at a TCP port through an interface.

    Except on loopback, a refusal is an answer too.
    """
    with socket.socket() as trying:
        trying.settimeout(ANSWER_WITHIN)
        trying.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, interface.encode())
        refused = 0 if interface == 'lo' else errno.ECONNREFUSED
        if trying.connect_ex((address, port)) in (0, refused):
            return Look(Found.ANSWER, f'{address} answers at TCP port {port}')
    return Look(Found.NOTHING)
