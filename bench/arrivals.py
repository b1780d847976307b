# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""When frames come to the karts' computer, however late the process of the karts reads them."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import ipaddress
import socket
import struct
import time
from typing import Any

from evgp_testing.part import Part

# Of Linux; Python has no names for them.
SO_RCVBUFFORCE = 33
SO_TIMESTAMPING = 37
RX_SOFTWARE = 1 << 3
SOFTWARE = 1 << 4
"""The kernel gives the time at which it took a packet in, or none. With SO_TIMESTAMPNS it gives,
where it has none, the time at which a packet is read."""

ETH_P_IP = 0x0800

MOST_UNREAD_BYTES = 2**28
"""Of packets, with what the kernel needs for each: those of a thousand karts in some seconds."""

HEADERS_AND_FRAMES_BYTES = 400
"""Of each packet; what is longer is no frame of a kart."""

SET = 0.001
"""Change of the wall clock against the steady one from which it was set, in seconds."""

LONGEST_WAIT = 10.0
"""For the first time that the kernel takes, in seconds."""

_TIMESPEC = struct.Struct('@qq')

TIMES_BYTES = socket.CMSG_SPACE(3 * _TIMESPEC.size)
"""Of the times with each packet: the kernel's, and two that are for network cards."""


class Arrivals(Part):
    """
    The frames on the loopback since the last call of `worst_gap`, by the kernel's times.

    :param port: race control's, at 127.0.0.1.
    :raises PermissionError: for others than root, and in some containers.
    :raises TimeoutError: if the kernel does not begin to take times.
    """

    def __init__(self, port: int) -> None:
        """Begin to listen."""
        self._sender = ipaddress.IPv4Address('127.0.0.1').packed, port.to_bytes(2, 'big')
        self._latest: dict[bytes, float] = {}
        self._wall = 0.0
        self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(ETH_P_IP))
        try:
            self._socket.setblocking(False)
            self._socket.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, MOST_UNREAD_BYTES)
            self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPING, RX_SOFTWARE | SOFTWARE)
            self._socket.bind(('lo', ETH_P_IP))
            self._wait_for_times()
        except (PermissionError, TimeoutError):
            self._socket.close()
            raise

    def _wait_for_times(self) -> None:
        """Wait until Linux takes times: a thread of its own begins with that when it can."""
        until = time.monotonic() + LONGEST_WAIT
        with socket.socket(type=socket.SOCK_DGRAM) as probe:
            probe.bind(('127.0.0.1', 0))
            while time.monotonic() < until:
                probe.sendto(b'', probe.getsockname())
                time.sleep(0.001)
                times = [times for _, times, _, _ in self._packets()]
                if any(times):
                    return
        raise TimeoutError(f'Linux took no time of a packet within {LONGEST_WAIT} s')

    def worst_gap(self, karts: int, going_on: bool = True) -> float:
        """
        Return the longest time between two frames to the same kart, s.

        A gap that spans two calls counts in the second.

        :param going_on: the time since the last frame counts too.
        :raises AssertionError: unless frames have ever come to so many karts, or if the wall clock
            was set since the last call.
        """
        now = time.monotonic()
        worst = 0.0
        for kart, at in self._heard():
            latest = self._latest.get(kart, at)
            assert at > latest - SET, 'the wall clock was set back'
            worst = max(worst, at - latest)
            self._latest[kart] = at
        heard = len(self._latest)
        assert heard == karts, f'frames came to {heard} of {karts} karts'
        return max(worst, now - min(self._latest.values())) if going_on else worst

    def _heard(self) -> Iterator[tuple[bytes, float]]:
        """Give each packet with frames since the last call: the kart's address, and the time."""
        # The kernel gives the wall time. Between two looks at a clock another process may run.
        wall = max(time.time() - time.monotonic() for _ in range(10))
        assert abs(wall - (self._wall or wall)) < SET, 'the wall clock was set'
        self._wall = wall
        for packet, [(_, _, times)], _, where in self._packets():
            header = (packet[0] & 0xF) * 4
            sender = packet[12:16], packet[header:][:2]
            kind = where[2], packet[9]
            if kind != (socket.PACKET_HOST, socket.IPPROTO_TCP) or sender != self._sender:
                continue
            begin = header + (packet[header + 12] >> 4) * 4
            if packet[begin:]:
                seconds, nanoseconds = _TIMESPEC.unpack_from(times)
                yield packet[16:20], seconds + nanoseconds / 1e9 - wall

    def _packets(self) -> Iterator[tuple[bytes, list[tuple[int, int, bytes]], int, Any]]:
        """Give each packet since the last call, as ``recvmsg`` does."""
        with contextlib.suppress(BlockingIOError):
            while True:
                yield self._socket.recvmsg(HEADERS_AND_FRAMES_BYTES, TIMES_BYTES)

    def close(self) -> None:
        """Listen no more."""
        self._socket.close()
