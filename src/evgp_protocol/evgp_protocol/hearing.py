# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What one kart says on one connection, and which order each word answers.

Pure: counts, bytes and times in, frames out. No socket and no clock: whoever holds the connection
says what was sent, answered and read, and when a beat begins.

A word must not count for an order that the kart had not read when it said it. Race control cannot
see what a kart has read. It knows that TCP keeps the order both ways: a kart reads the orders in
the order in which they went out, and its words arrive in the order in which it said them. Between
them lie bytes under way, bytes that a kart has not read yet, and bytes that race control has not
read yet. So a word answers the *earliest* order that it can answer:

- It asks for the same state.
- It is not earlier than the order that the kart has reached: the order that the last word
  answered, or one that something else has shown to be read (below).
- The word's first byte had not arrived when race control last saw that the kart's TCP had not
  answered the whole order. TCP brings the answer with the word, or before it: a byte that was
  there without it was sent before the kart had the order.

============================= ========================= ======================================
the kart was sent             it says                   which answers
============================= ========================= ======================================
RED_RED                       RED_RED                   RED_RED
RED_RED, garage, RED_RED      RED_RED, RED_RED, ...     the first RED_RED, each time
RED_RED, garage, RED_RED      IN_GARAGE, RED_RED        IN_GARAGE, then the second RED_RED
RED_RED, garage, RED_RED      RED_RED, `QUIET` nothing, the second RED_RED
                              RED_RED
RED_RED                       GRID_ACTIVE               nothing
============================= ========================= ======================================

*What IN_GARAGE hides.* It need not be said back. After RED_RED, IN_GARAGE, RED_RED a word RED_RED
may be a late one for the first. Four things show that the kart has read what came after an order,
each for every habit of which it is used, and however late the kart reads:

- *A pause.* The kart has spoken of the order; the next one was answered by its TCP; and then
  nothing came from it for `QUIET`. A kart that says every frame back says something each second
  while it reads frames that it answers, and its words come within another second. One that says
  each change once has spoken of this order, and its next word is for a later one. A kart that has
  not spoken of the order may be reading it yet, and only now have something to say: for that one
  `SLOWEST` bounds how long it can take to read what was sent before; but not where it has said
  IN_GARAGE back, for then it says the next one too, however late.
- *A count.* A kart that says every frame back says one word for each. Once it has said as many
  for the order as frames of that were sent, it has read them all, and its next word is for a later
  order. It is taken for such a kart after `ECHOES` words for one order, and not if it ever says
  more words than it is sent frames.
- *Few words.* A kart that speaks less often than `SELDOM`, but again and again, does not say every
  frame back. So it reads all there is at once and says the last of it, and is not later than
  `QUIET`; unless it says what only an order of long ago can have asked for.
- *A word that stays alone.* The kart had said one word for the first order, and `ONCE` later
  another one, which may be for a later order, and then nothing for `QUIET`. So it does not say
  every frame back: it says each change once, and the second word is for the later order
  (`settled`).

No pause and no count is over before the next order's frames were answered for `QUIET`. Until then,
and where none of the four comes, what the kart says is its word for the earlier order.
``counts_in`` is how long that can last; where no time makes it count, only a new connection does.

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

ONCE = 1.5
"""Time between two words from which on they are not of a kart that says every frame back, in
seconds. It says one a beat, and if it reads nothing for a second, one after a second."""

ECHOES = 24
"""Number of words for one order from which on a kart counts as one that says every frame back, if
it says no more words than it is sent frames."""

SLOWEST = 8.0
"""Minimum rate at which a kart reads frames, Hz. What reads more slowly, only inspection finds."""

SELDOM = 5.0
"""Rate of words below which a kart does not say every frame back, Hz: it reads `SLOWEST`, and may
read nothing for a second."""

PACE_WINDOW = 4.0
"""Time over which the words of a kart that says every frame back are counted against the frames
that it is sent, in seconds. Two such times with too few words, one after the other: it reads late.
"""

PACE = 0.95
"""Share of the frames sent that a kart says back at least, if it says every frame that it reads
back and reads as many as it is sent."""

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
    :ivar beat: the beat in which it went out.
    :ivar answered_in: the beat in which the kart's TCP was seen to have answered it.
    :ivar words: number of words that answered it; ``said_in``: the beat of the last of them.
    """

    serial: int
    state: RaceState
    end: int
    answers_from: int
    beat: int
    answered_in: int | None = None
    words: int = 0
    said_in: int = 0


class _Pace:
    """
    How far a kart that says every frame back may be behind, by its words against the frames.

    One that reads all there is at once and says the last back looks the same, if it does so less
    often than it is sent frames. So what this says is the most that it may be. How soon the kart
    says a new state shows it.
    """

    def __init__(self, beat_rate: float) -> None:
        self._beat_rate = beat_rate
        self._window = math.ceil(PACE_WINDOW * beat_rate)
        self._counts = False
        self._frames = self._words = 0
        self._slow = 0  # windows with too few words, one after the other
        self._lost = 0  # frames that were sent and not said back
        self.speaks_seldom = False

    @property
    def behind(self) -> float:
        """Return how far the kart may be behind, in seconds; 0: nothing says that it is."""
        return self._lost / self._beat_rate if self._slow > 1 else 0.0

    def begin(self) -> None:
        """Take note of a new order: the kart says it back when it has done it."""
        self._counts = False

    def sent(self) -> None:
        """Take note of a frame of the last order."""
        self._frames += 1
        if not self._counts or self._frames < self._window:
            return
        if self._words > 1:
            self.speaks_seldom = self._words < SELDOM * PACE_WINDOW
        if self._words >= PACE * self._frames:
            self._lost = max(0, self._lost - max(0, self._words - self._frames))
            if self._slow < 2 or not self._lost:
                self._slow = self._lost = 0
        elif self._words >= 0.9 * SLOWEST / self._beat_rate * self._frames:
            self._lost += self._frames - self._words
            self._slow += 1
        self._frames = self._words = 0

    def said(self, after: int | None) -> None:
        """
        Take note of a word for the last order.

        :param after: number of beats since the kart's TCP had answered the order, if this is the
            first word for it.
        """
        self._words += 1
        if after is not None:
            # Of a slow one, all of that may be time for which it has not read the order.
            self._lost = after if self._slow > 1 else min(self._lost, after)
            if self._lost < 3:
                self._lost = self._slow = 0
        if not self._counts:
            self._counts = True
            self._frames = self._words = 0


class Hearing:
    """
    Everything that comes from one kart on one connection.

    Every byte has a place in its stream, counted from 0.

    :param beat_rate: number of beats per second, Hz.
    """

    def __init__(self, beat_rate: float) -> None:
        self._decoder = FrameDecoder(ready_is_grid_active=True)
        # The order that the kart's words have reached, and all after it.
        self._orders: deque[_Order] = deque()
        # Whether it has said the last IN_GARAGE back that it is known to have read.
        self._says_garage = False
        # Whether it has said more words for an order than it was sent frames.
        self._outruns = False
        # Whether it has said what none of its orders asks for that it may be reading.
        self._is_late = False
        # The beat up to whose frame the kart has read at least, at `SLOWEST`.
        self._slowest = 0.0
        # A word that is for a later order if nothing follows it, and its place; what became so.
        self._alone: tuple[StateFrame, int] | None = None
        self._settled: list[tuple[StateFrame, int]] = []
        # Places in the stream from the kart: up to where it was read and decoded; and a place
        # before which the frame that the decoder is in did not begin.
        self._read = 0
        self._decoded = 0
        self._began = 0
        # Times are in beats: while race control is held up, it reads nothing of the rest.
        self._beats = 0
        self._heard_in = 0
        self._beat_rate = beat_rate
        self._pace = _Pace(beat_rate)
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

    @property
    def behind(self) -> float:
        """Return how far the kart's reading may be behind, in seconds; 0: nothing says so."""
        return self._pace.behind

    def counts_in(self) -> float:
        """
        Return in how many seconds a word for the last order's state counts for it, at the latest.

        Ask after ``decode``, of a word that did not count. It holds if the kart goes on saying it,
        or was heard to say each change once. 0: nobody knows.
        """
        beats = self._pause_beats + 1
        if len(self._orders) < 2:
            return beats / self._beat_rate
        first, last = self._orders[0], self._orders[-1]
        if first.state is last.state and first.words > 1 and self._alone is None:
            answered_in = self._orders[1].answered_in
            if answered_in is not None:
                beats = max(beats - self._beats + answered_in, 1)
            if not self._reads_all:
                if self._outruns:
                    return 0.0
                beats = max(beats, max(ECHOES, self._frames_of_first()) - first.words)
        return beats / self._beat_rate

    def settled(self) -> list[tuple[StateFrame, int]]:
        """Return the words that turned out to be for a later order since the last call."""
        settled, self._settled = self._settled, []
        return settled

    def sent_again(self) -> None:
        """Take note that the last order's frame was sent once more."""
        self._pace.sent()

    def order(self, serial: int, state: RaceState, end: int, unread: int) -> None:
        """
        Take note that an order goes out now: what has arrived by now is no answer to it.

        :param serial: the order's number, from 1.
        :param end: up to where it reaches in the stream to the kart.
        :param unread: number of bytes that have arrived and were not read yet.
        """
        self._orders.append(_Order(serial, state, end, self._read + unread, self._beats))
        self._pace.begin()

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
                heard.append((each, self._answered_by(each, self._began)))
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
        self._slowest = min(self._slowest + SLOWEST / self._beat_rate, self._beats)
        if self._alone is not None and self._silent_for() > self._pause_beats:
            word, place = self._alone
            self._pass()
            self._settled.append((word, self._answered_by(word, place)))
        while len(self._orders) > 1 and self._has_read_on():
            self._pass()
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

    def _answered_by(self, heard: Heard, place: int) -> int:
        """
        Return the serial of the order that a frame answers; the kart has reached it then.

        :param place: where the frame began, or a place before that at which it had not begun.
        """
        self._alone = None
        if self._deaf_beats or not isinstance(heard, StateFrame):
            return NO_ORDER
        asked = any(order.state is heard.state for order in self._orders)
        self._is_late |= not asked and heard.state is not RaceState.IN_GARAGE  # it may greet
        can = [
            passed
            for passed, order in enumerate(self._orders)
            if order.state is heard.state and order.answers_from <= place
        ]
        if not can:
            return NO_ORDER
        for _ in range(can[0]):
            self._pass()
        order = self._orders[0]
        once = order.words == 1 and self._beats - order.said_in >= ONCE * self._beat_rate
        order.words += 1
        order.said_in = self._beats
        self._says_garage |= order.state is RaceState.IN_GARAGE
        self._slowest = max(self._slowest, order.beat)
        if len(self._orders) == 1:
            first_after = None
            if order.words == 1 and order.answered_in is not None:
                first_after = self._beats - order.answered_in
            self._pace.said(first_after)
        if len(can) == 1:
            if order.state is not RaceState.IN_GARAGE:
                self._outruns |= order.words > self._frames_of_first()
        elif once:
            self._alone = heard, place
        return order.serial

    def _pass(self) -> None:
        """Take note that the kart has read on from the first order."""
        order = self._orders.popleft()
        if order.state is RaceState.IN_GARAGE:
            self._says_garage = order.words > 0

    def _has_read_on(self) -> bool:
        """Return whether the kart is known to have read the second order, though it says none."""
        first, second = self._orders[0], self._orders[1]
        if second.answered_in is None or self._beats - second.answered_in <= self._pause_beats:
            return False
        if self._silent_for() > self._pause_beats:
            late = self._slowest - self._pause_beats <= second.beat
            return first.words > 0 or not (self._says_garage or late)
        if self._reads_all:
            return first.words > 0
        counted = first.state is not RaceState.IN_GARAGE and not self._outruns
        return counted and first.words >= max(ECHOES, self._frames_of_first())

    @property
    def _reads_all(self) -> bool:
        """Return whether the kart reads all there is at once, by what it has said so far."""
        return self._pace.speaks_seldom and not self._is_late

    def _frames_of_first(self) -> int:
        """Return how many frames of the first order were sent at most."""
        until = self._orders[1].beat if len(self._orders) > 1 else self._beats
        return until - self._orders[0].beat + 1

    def _silent_for(self) -> int:
        """Return for how many beats nothing has come."""
        return self._beats - self._heard_in
