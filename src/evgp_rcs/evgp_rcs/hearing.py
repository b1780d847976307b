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
What one kart says on one connection, and which order it can be an answer to.

Pure: counts, bytes and times in, frames out. No socket and no clock: whoever holds the connection
(``kart_link``) says what it read, how much the kernel still holds, and when a beat begins.

Two things are too old to be an answer:

- What arrived before the order went out. Every byte of the connection has a place in the stream,
  counted from 0, and an order notes how many bytes have arrived by then, read or not. A frame is
  an answer only if its first byte has that place or a later one.
- What a flood queued. A kart that sends faster than it is read has more bytes waiting on its own
  side, and nobody knows when it said them. So nothing counts during a flood, nor for `DEAF` after.
"""

from __future__ import annotations

import math

from evgp_protocol.frames import FrameDecoder, MalformedFrame, StateFrame

FLOOD_BYTES = 4096
"""Number of bytes in one beat from which on a kart floods; then it is not read until the next
beat. A kart says some 15 bytes a beat at most."""

FLOOD = 2.0
"""Maximum duration of a flood, in seconds; then the kart is dropped."""

DEAF = 1.0
"""Time after a flood during which nothing a kart says counts as an answer, in seconds. What floods
again before it is over goes on flooding: a flood that comes in pieces is one."""

NO_ORDER = 0
"""Serial of what cannot answer any order; orders count from 1."""

Heard = StateFrame | MalformedFrame


class Hearing:
    """
    Everything that comes from one kart on one connection.

    :param beat_rate: number of beats per second, Hz.
    """

    def __init__(self, beat_rate: float) -> None:
        """Begin with nothing heard and no order."""
        self._decoder = FrameDecoder(ready_is_grid_active=True)
        self._serial = NO_ORDER
        # Places in the stream: up to where it was read and decoded, and where answers begin.
        self._read = 0
        self._decoded = 0
        self._answers_from = 0
        # The frame that the decoder is in began too early to be an answer.
        self._frame_is_old = False
        self._floods_since: float | None = None
        # In beats, not by the time: while race control is held up, it reads nothing of the rest.
        self._beats_after_flood = math.ceil(DEAF * beat_rate)
        self._deaf_beats = 0
        self._read_this_beat = 0

    @property
    def is_full(self) -> bool:
        """Return whether so much was read in this beat that the rest waits for the next."""
        return self._read_this_beat >= FLOOD_BYTES

    def order(self, serial: int, unread: int) -> None:
        """
        Take note that an order goes out now: what has arrived by now is no answer to it.

        :param serial: the order's number, from 1.
        :param unread: number of bytes that have arrived and were not read yet.
        """
        self._serial = serial
        self._answers_from = self._read + unread
        self._frame_is_old = self._decoder.in_frame

    def read(self, count: int) -> None:
        """Take note that so many bytes were read; hand them to ``decode`` next."""
        self._read += count
        self._read_this_beat += count

    def decode(self, data: memoryview) -> list[tuple[Heard, int]]:
        """
        Return what the bytes complete, in order, each with the serial of the order it can answer.

        :param data: what was read last, all of it.
        """
        old = self._answers_from - self._decoded if self._deaf_beats == 0 else len(data)
        old = min(max(old, 0), len(data))
        self._decoded += len(data)
        heard: list[tuple[Heard, int]] = []
        if old:
            heard += [(each, NO_ORDER) for each in self._decoder.feed(data[:old])]
            self._frame_is_old = self._decoder.in_frame
        for each in self._decoder.feed(data[old:]):
            heard.append((each, NO_ORDER if self._frame_is_old else self._serial))
            self._frame_is_old = False
        return heard

    def beat(self, now: float) -> bool:
        """
        Begin the next beat.

        :param now: the time, s.
        :return: whether the kart has flooded for `FLOOD`, with no pause of `DEAF`.
        """
        if not self.is_full:
            self._deaf_beats = max(self._deaf_beats - 1, 0)
            if self._deaf_beats == 0:
                self._floods_since = None
            self._read_this_beat = 0
            return False
        if self._floods_since is None:
            self._floods_since = now
        self._deaf_beats = self._beats_after_flood
        self._read_this_beat = 0
        return now - self._floods_since >= FLOOD
