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

import contextlib
import socket
import struct
import time

from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState

# Of Linux; Python has no names for them.
SO_TIMESTAMPNS = 35
SO_RCVBUFFORCE = 33

ETH_P_IP = 0x0800

MOST_UNREAD_BYTES = 2**28
"""Of packets, with what the kernel needs for each: those of a thousand karts in some seconds."""

HEADERS_AND_FRAMES_BYTES = 400
"""Of each packet; what is longer is no frame of a kart."""

_TIMESPEC = struct.Struct('@qq')


class Arrivals:
    """
    The packets of race control on the loopback since this was made, each with the kernel's time.

    :param port: race control's.
    :raises PermissionError: for others than root.
    """

    def __init__(self, port: int) -> None:
        """Begin to listen."""
        self._port = port.to_bytes(2, 'big')
        self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(ETH_P_IP))
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, MOST_UNREAD_BYTES)
        self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)

    def last(self, state: RaceState, karts: int) -> float:
        """
        Return the time (monotonic, s) by which every kart's computer had the first frame of it.

        :raises AssertionError: if there is no such frame for one of so many karts.
        """
        frame = encode(state)
        # The kernel gives the wall time.
        wall = time.time() - time.monotonic()
        first: dict[bytes, float] = {}
        with contextlib.suppress(BlockingIOError):
            while True:
                packet, stamps, _, where = self._socket.recvmsg(HEADERS_AND_FRAMES_BYTES, 64)
                header = (packet[0] & 0xF) * 4
                tcp = packet[header:]
                if where[2] == socket.PACKET_HOST and tcp[:2] == self._port and frame in tcp:
                    to = packet[16:20]
                    seconds, nanoseconds = _TIMESPEC.unpack(stamps[0][2])
                    first.setdefault(to, seconds + nanoseconds / 1e9 - wall)
        assert len(first) == karts, f'{state.value} came to {len(first)} of {karts} karts'
        return max(first.values())

    def close(self) -> None:
        """Stop listening."""
        self._socket.close()
