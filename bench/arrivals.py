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

"""When frames come to the karts' computer, however late the process of the karts reads them."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import ipaddress
import socket
import struct
import time

from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState
from evgp_testing.part import Part

# Of Linux; Python has no names for them.
SO_TIMESTAMPNS = 35
SO_RCVBUFFORCE = 33

ETH_P_IP = 0x0800

MOST_UNREAD_BYTES = 2**28
"""Of packets, with what the kernel needs for each: those of a thousand karts in some seconds."""

HEADERS_AND_FRAMES_BYTES = 400
"""Of each packet; what is longer is no frame of a kart."""

_TIMESPEC = struct.Struct('@qq')


class Arrivals(Part):
    """
    The frames on the loopback since one of its methods was called last, by the kernel's times.

    :param port: race control's, at 127.0.0.1.
    :raises PermissionError: for others than root, and in some containers.
    """

    def __init__(self, port: int) -> None:
        """Begin to listen."""
        self._sender = ipaddress.IPv4Address('127.0.0.1').packed, port.to_bytes(2, 'big')
        self._latest: dict[bytes, float] = {}
        self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(ETH_P_IP))
        try:
            self._socket.bind(('lo', ETH_P_IP))
            self._socket.setblocking(False)
            self._socket.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, MOST_UNREAD_BYTES)
            self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        except PermissionError:
            self._socket.close()
            raise

    def last(self, state: RaceState, karts: int) -> float:
        """
        Return the time (monotonic, s) by which every kart's computer had the first frame of it.

        :raises AssertionError: if there is no such frame for one of so many karts.
        """
        frame = encode(state)
        first: dict[bytes, float] = {}
        for kart, frames, at in self._heard():
            if frame in frames:
                first.setdefault(kart, at)
        assert len(first) == karts, f'{state.value} came to {len(first)} of {karts} karts'
        return max(first.values())

    def worst_gap(self, karts: int) -> float:
        """
        Return the longest time between two frames to the same kart, s; 0 if there were none.

        The earlier one may have come before the last call, so no gap is between two calls.

        :raises AssertionError: unless frames have ever come to so many karts.
        """
        worst = 0.0
        for kart, _, at in self._heard():
            worst = max(worst, at - self._latest.get(kart, at))
            self._latest[kart] = at
        heard = len(self._latest)
        assert heard == karts, f'frames came to {heard} of {karts} karts'
        return worst

    def _heard(self) -> Iterator[tuple[bytes, bytes, float]]:
        """Give each packet with frames since the last call: the kart's address, they, its time."""
        # The kernel gives the wall time. Between two looks at a clock another process may run.
        wall = max(time.time() - time.monotonic() for _ in range(10))
        with contextlib.suppress(BlockingIOError):
            while True:
                packet, stamps, _, where = self._socket.recvmsg(HEADERS_AND_FRAMES_BYTES, 64)
                header = (packet[0] & 0xF) * 4
                sender = packet[12:16], packet[header:][:2]
                kind = where[2], packet[9]
                if kind != (socket.PACKET_HOST, socket.IPPROTO_TCP) or sender != self._sender:
                    continue
                begin = header + (packet[header + 12] >> 4) * 4
                if frames := packet[begin:]:
                    seconds, nanoseconds = _TIMESPEC.unpack(stamps[0][2])
                    yield packet[16:20], frames, seconds + nanoseconds / 1e9 - wall

    def close(self) -> None:
        """Listen no more."""
        self._socket.close()
