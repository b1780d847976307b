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
What one kart says on one connection, and which order each word answers.

Pure: counts, bytes and times in, frames out. No socket and no clock: whoever holds the connection
(``kart_link``) says what was sent, answered and read, and when a beat begins.

A word must not count for an order that the kart had not read when it said it. Race control cannot
see what a kart has read. It knows that TCP keeps the order both ways: a kart reads the orders in
the order in which they went out, and its words arrive in the order in which it said them. Between
them lie bytes under way, bytes that a kart has not read yet, and bytes that race control has not
read yet. So a word answers the *earliest* order that it can answer:

- It asks for the same state.
- It is not earlier than the order that the kart's words have reached: the order that the last
  word answered, or one that a pause has shown to be read (below).
- The word's first byte had not arrived when race control last saw that the kart's TCP had not
  answered the whole order. TCP brings the answer with the word, or before it: a byte that was
  there without it was sent before the kart had the order.

============================= ========================= ======================================
the kart was sent             it says                   which answers
============================= ========================= ======================================
RED_RED                       RED_RED                   RED_RED
RED_RED, garage, RED_RED      RED_RED, RED_RED, ...     the first RED_RED, each time
RED_RED, garage, RED_RED      IN_GARAGE, RED_RED        IN_GARAGE, then the second RED_RED
RED_RED, garage for `QUIET`   nothing
... and then RED_RED          RED_RED                   the second RED_RED
RED_RED                       GRID_ACTIVE               nothing
============================= ========================= ======================================

*A pause.* IN_GARAGE need not be said back. When the kart's TCP has answered an order, and for
`QUIET` after that nothing came from the kart, then it has read that order. A kart that reads and
says each frame late is not silent; one that reads nothing for 1 s gives its connection up. One
that says each *change* late is silent in between: so for a kart that has said IN_GARAGE back on
this connection no pause counts. It will say the next one too, and IN_GARAGE comes between any two
orders of the same state.

What a flood queued answers nothing either. A kart that sends faster than it is read has more bytes
waiting on its own side, and nobody knows when it said them: nothing counts during a flood, nor for
`DEAF` after.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
import math

from evgp_protocol.frames import FrameDecoder, MalformedFrame, StateFrame
from evgp_protocol.states import RaceState

FLOOD_BYTES = 4096
"""Number of bytes in one beat from which on a kart floods; then it is not read until the next
beat. A kart says some 15 bytes a beat at most."""

FLOOD = 2.0
"""Maximum duration of a flood, in seconds; then the kart is dropped."""

DEAF = 1.0
"""Time after a flood during which nothing a kart says counts as an answer, in seconds. What floods
again before it is over goes on flooding: a flood that comes in pieces is one."""

QUIET = 2.0
"""Time of silence after which a kart has read what its TCP had answered before, in seconds. A kart
reads something every second, or gives its connection up; its words have another second to come."""

NO_ORDER = 0
"""Serial of what cannot answer any order; orders count from 1."""

_TOO_OLD = -1
"""In place of where a frame began: during a flood."""

Heard = StateFrame | MalformedFrame


@dataclass
class _Order:
    """
    An order that what the kart says may answer.

    :ivar end: up to where it reaches in the stream to the kart.
    :ivar answers_from: from where on its answers are in the stream from the kart.
    :ivar answered_in: the beat in which the kart's TCP was seen to have answered it.
    """

    serial: int
    state: RaceState
    end: int
    answers_from: int
    answered_in: int | None = None


class Hearing:
    """
    Everything that comes from one kart on one connection.

    Every byte has a place in its stream, counted from 0.

    :param beat_rate: number of beats per second, Hz.
    """

    def __init__(self, beat_rate: float) -> None:
        """Begin with nothing heard and no order."""
        self._decoder = FrameDecoder(ready_is_grid_active=True)
        # The order that the kart's words have reached, and all after it.
        self._orders: deque[_Order] = deque()
        self._says_garage = False
        # Places in the stream from the kart: up to where it was read and decoded; and a place
        # before which the frame that the decoder is in did not begin.
        self._read = 0
        self._decoded = 0
        self._began = 0
        # Times are in beats: while race control is held up, it reads nothing of the rest.
        self._beats = 0
        self._heard_in = 0
        self._pause_beats = math.ceil(QUIET * beat_rate)
        self._floods_since: float | None = None
        self._beats_after_flood = math.ceil(DEAF * beat_rate)
        self._deaf_beats = 0
        self._read_this_beat = 0

    @property
    def is_full(self) -> bool:
        """Return whether so much was read in this beat that the rest waits for the next."""
        return self._read_this_beat >= FLOOD_BYTES

    @property
    def waits(self) -> bool:
        """Return whether the kart's TCP was not seen yet to have answered all orders."""
        return bool(self._orders) and self._orders[-1].answered_in is None

    @property
    def has_reached_last(self) -> bool:
        """Return whether no word that comes now can answer an order before the last one."""
        return len(self._orders) <= 1

    def order(self, serial: int, state: RaceState, end: int, unread: int) -> None:
        """
        Take note that an order goes out now: what has arrived by now is no answer to it.

        :param serial: the order's number, from 1.
        :param end: up to where it reaches in the stream to the kart.
        :param unread: number of bytes that have arrived and were not read yet.
        """
        self._orders.append(_Order(serial, state, end, self._read + unread))

    def look(self, answered: int, unread: int) -> None:
        """
        Take note of how much the kart's TCP has answered.

        :param answered: up to which place in the stream to the kart.
        :param unread: number of bytes that had arrived before, and were not read yet.
        """
        for order in reversed(self._orders):
            if order.answered_in is not None:
                break
            if answered >= order.end:
                order.answered_in = self._beats
            else:
                order.answers_from = self._read + unread

    def read(self, count: int) -> None:
        """Take note that so many bytes were read; hand them to ``decode`` next."""
        self._read += count
        self._read_this_beat += count
        self._heard_in = self._beats

    def decode(self, data: memoryview) -> list[tuple[Heard, int]]:
        """
        Return what the bytes complete, in order, each with the serial of the order it answers.

        :param data: what was read last, all of it.
        """
        begin, end = self._decoded, self._decoded + len(data)
        self._decoded = end
        # A frame that began before a place from which on an order has answers is none of them.
        cuts = {order.answers_from for order in self._orders if begin < order.answers_from < end}
        heard: list[tuple[Heard, int]] = []
        at = begin
        for cut in (*sorted(cuts), end):
            place = at if self._deaf_beats == 0 else _TOO_OLD
            if not self._decoder.in_frame:
                self._began = place
            part = slice(at - begin, cut - begin)
            for each in self._decoder.feed(data[part]):
                heard.append((each, self._answered_by(each)))
                self._began = place
            at = cut
        return heard

    def beat(self, now: float) -> bool:
        """
        Begin the next beat.

        :param now: the time, s.
        :return: whether the kart has flooded for `FLOOD`, with no pause of `DEAF`.
        """
        self._beats += 1
        while len(self._orders) > 1 and self._paused_after(self._orders[1]):
            self._orders.popleft()
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

    def _answered_by(self, heard: Heard) -> int:
        """Return the serial of the order that this frame answers; the kart has reached it then."""
        if self._deaf_beats == 0 and isinstance(heard, StateFrame):
            for passed, order in enumerate(self._orders):
                if order.state is heard.state and order.answers_from <= self._began:
                    for _ in range(passed):
                        self._orders.popleft()
                    self._says_garage |= order.state is RaceState.IN_GARAGE
                    return order.serial
        return NO_ORDER

    def _paused_after(self, order: _Order) -> bool:
        """Return whether nothing came for `QUIET` since the kart's TCP had answered an order."""
        if order.answered_in is None or self._says_garage:
            return False
        return self._beats - max(order.answered_in, self._heard_in) > self._pause_beats
