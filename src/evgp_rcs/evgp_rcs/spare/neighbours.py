# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Whether another machine is there, on the karts' network or the officials': for a takeover.

`why_not` is the decision, and pure. What cannot be known counts as bad as an answer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import enum
import errno
import ipaddress
import socket
from typing import NamedTuple

from evgp_rcs.karts.address_watch import AddressTakenError, AddressWatch, Question
from evgp_rcs.karts.network_cards import Card, cards

ASK_FOR = 3.0
"""Time for which another machine is asked whether it has an address, in seconds."""

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
    if any(each.name == interface and each.plugged for each in cards()):
        return Look(Found.NOTHING)
    return Look(
        Found.NOT_KNOWN,
        f'{interface} is down or has no cable, so this machine cannot know who is there: plug it '
        'in, or name another interface',
    )


def ask(address: str, interface: str, seconds: float = ASK_FOR) -> Look:
    """
    Ask whether another machine on the network of an interface has an address.

    It takes that many seconds, unless there is an answer. It asks as race control does all the
    time, but announces nothing.
    """
    return _ask(address, interface, lambda card: card.name == interface, seconds)


def ask_where_it_is(address: str) -> Look:
    """Ask the same about an address, at the interface that is on its network."""
    where, ip = f'the network of {address}', ipaddress.IPv4Address(address)
    return _ask(address, where, lambda card: any(ip in own.network for own in card.addresses))


def _ask(
    address: str, where: str, there: Callable[[Card], bool], seconds: float = ASK_FOR
) -> Look:
    if not any(map(there, cards())):
        return Look(
            Found.NOT_KNOWN,
            f'this machine has no interface on {where} now, so it cannot know who is there',
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
    """Look whether anything answers at a TCP port; off loopback, a refusal is an answer."""
    with socket.socket() as trying:
        trying.settimeout(ANSWER_WITHIN)
        trying.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, interface.encode())
        refused = 0 if interface == 'lo' else errno.ECONNREFUSED
        if trying.connect_ex((address, port)) in (0, refused):
            return Look(Found.ANSWER, f'{address} answers at TCP port {port}')
    return Look(Found.NOTHING)
