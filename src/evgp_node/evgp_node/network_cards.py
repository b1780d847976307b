# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The network interfaces of this machine, as the kernel reports them now (rtnetlink, without root).

This module does not read ``/sys``, because ``/sys`` shows the interfaces of the network namespace
in which it was mounted, and this process may be in another one.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import ipaddress
import socket
import struct
import sys
from typing import NamedTuple

LOOPBACK_CARD = 'lo'
"""Name of the loopback interface. Its other end is always this machine."""

_DUMP = 0x0301  # NLM_F_REQUEST | NLM_F_DUMP
_DONE, _NEW_LINK, _GET_LINK, _NEW_ADDRESS, _GET_ADDRESS = 3, 16, 18, 20, 22
_HEAD = struct.Struct('=IHHII')
_LINK = struct.Struct('=BxHiII')
_ADDRESS = struct.Struct('=BBBBI')
_ATTRIBUTE = struct.Struct('=HH')
_HARDWARE, _NAME, _EXTRA_MASK, _TIMES_DOWN = 1, 3, 29, 48  # IFLA_...
_LOCAL = 2  # IFA_LOCAL
_NO_STATISTICS = struct.pack('=HHI', 8, _EXTRA_MASK, 8)  # RTEXT_FILTER_SKIP_STATS
_UP_AND_PLUGGED = 0x10001  # IFF_UP | IFF_LOWER_UP
_LINKS_AND_ADDRESSES = 0x11  # RTMGRP_LINK | RTMGRP_IPV4_IFADDR
_BYTES = 1 << 18


class Card(NamedTuple):
    """
    A network interface.

    :param number: the kernel's number of the interface, which changes when it is unplugged.
    :param hardware: hardware address, such as 02:00:00:00:00:01. Empty if it has none.
    :param plugged: whether the interface is up and has a cable or a WLAN.
    :param losses: how often the interface has lost its cable or WLAN so far.
    """

    name: str
    number: int
    hardware: str
    plugged: bool
    losses: int
    addresses: tuple[ipaddress.IPv4Interface, ...] = ()

    def has(self, address: str) -> bool:
        return ipaddress.IPv4Address(address) in [each.ip for each in self.addresses]


def cards() -> tuple[Card, ...]:
    """
    Return the interfaces of this machine. This takes about 0.1 ms.

    :raises OSError: if the kernel does not report them.
    """
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as kernel:
        found = {}
        for _, body in _asked(kernel, _GET_LINK, _LINK.pack(0, 0, 0, 0, 0) + _NO_STATISTICS):
            _, _, index, flags, _ = _LINK.unpack_from(body)
            about = dict(_attributes(body, _LINK.size))
            found[index] = Card(
                about[_NAME].rstrip(b'\0').decode(errors='replace'),
                index,
                about.get(_HARDWARE, b'').hex(':'),
                flags & _UP_AND_PLUGGED == _UP_AND_PLUGGED,
                int.from_bytes(about.get(_TIMES_DOWN, b''), sys.byteorder),
            )
        for _, body in _asked(kernel, _GET_ADDRESS, _ADDRESS.pack(socket.AF_INET, 0, 0, 0, 0)):
            _, prefix, _, _, index = _ADDRESS.unpack_from(body)
            about = dict(_attributes(body, _ADDRESS.size))
            # IFA_ADDRESS, the second one, can be the address of the other end.
            address = ipaddress.IPv4Interface((about.get(_LOCAL) or about[1], prefix))
            if index in found:
                card = found[index]
                found[index] = card._replace(addresses=(*card.addresses, address))
    return tuple(found.values())


def card_news() -> socket.socket:
    """
    Return a socket that can be read when an interface or an address comes, changes or goes.

    What it says does not matter (`forget_news`), because `cards` says what there is then.
    """
    news = socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE)
    news.bind((0, _LINKS_AND_ADDRESSES))
    news.setblocking(False)
    return news


def forget_news(news: socket.socket) -> None:
    """Read everything that waits in a socket of `card_news`."""
    with contextlib.suppress(OSError):  # above all BlockingIOError; ENOBUFS does no harm
        while True:
            news.recv(_BYTES)


def _asked(kernel: socket.socket, kind: int, body: bytes) -> Iterator[tuple[int, bytes]]:
    kernel.send(_HEAD.pack(_HEAD.size + len(body), kind, _DUMP, 0, 0) + body)
    while True:
        for answer, content in _messages(kernel.recv(_BYTES)):
            if answer == _DONE:
                return
            if answer not in (_NEW_LINK, _NEW_ADDRESS):
                raise OSError(f'the kernel answered {answer} to rtnetlink {kind}')
            yield answer, content


def _messages(data: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at < len(data):
        length, kind, _, _, _ = _HEAD.unpack_from(data, at)
        begin, end = at + _HEAD.size, at + length
        yield kind, data[begin:end]
        at += (length + 3) & ~3


def _attributes(data: bytes, at: int) -> Iterator[tuple[int, bytes]]:
    while at < len(data):
        length, kind = _ATTRIBUTE.unpack_from(data, at)
        begin, end = at + _ATTRIBUTE.size, at + length
        yield kind & 0x3FFF, data[begin:end]
        at += (length + 3) & ~3
