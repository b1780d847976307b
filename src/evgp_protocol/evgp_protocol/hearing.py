# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Determines which order each reply of a kart answers, on one connection.

This module has no socket and no clock: the owner of the connection reports what was sent,
acknowledged by TCP and read, and when a beat begins.

A reply must not count for an order that the kart had not read when it sent the reply. Race control
cannot see what a kart has read, but TCP preserves the sequence in both directions: a kart reads
orders as they were sent, one after the other, and its replies arrive in the same way. Meanwhile,
bytes may be in transit, and either side may have bytes that it has not read. So a reply answers
the *earliest* order that fits:

- The order asks for the state of the reply.
- The order is not before the one that the kart has reached: the one that the last reply answered,
  or one that the kart is otherwise known to have read (below).
- The reply's first byte had not arrived when race control last saw that the kart's TCP had not
  answered the whole order. TCP's answer comes with the reply or before it: a byte that arrived
  without it was sent before the kart had the order.

============================= ========================= ======================================
the kart was sent             it replies                which answers
============================= ========================= ======================================
RED_RED                       RED_RED                   RED_RED
RED_RED, garage, RED_RED      RED_RED, RED_RED, ...     the first RED_RED, each time
RED_RED, garage, RED_RED      IN_GARAGE, RED_RED        IN_GARAGE, then the second RED_RED
RED_RED, garage, RED_RED      RED_RED, `QUIET` nothing, the second RED_RED
                              RED_RED
RED_RED                       GRID_ACTIVE               nothing
============================= ========================= ======================================

*A kart need not acknowledge IN_GARAGE.* If it does not, a reply RED_RED after RED_RED, IN_GARAGE,
RED_RED may be a late one for the first order. Four signs show that the kart has read beyond an
order, however late it reads:

- *A pause.* The kart has replied to the order, its TCP has answered the next one, and then nothing
  came from it for `QUIET`. A kart that echoes every frame sends something each second while it
  reads frames, and its replies arrive within another second. One that sends each change once has
  replied to this order, so its next reply is for a later one. A kart that has not replied to the
  order may still be reading it. `SLOWEST` limits how long that can take, except for a kart that
  has acknowledged an IN_GARAGE, because it will also acknowledge the next one, however late.
- *A count.* A kart that echoes every frame sends one reply for each. After as many replies as it
  was sent frames of the order, it has read them all, and its next reply is for a later order. A
  kart counts as echoing after `ECHOES` replies to one order, unless it ever sends more replies
  than it was sent frames.
- *Few replies.* A kart that replies repeatedly, but less often than `SELDOM`, does not echo every
  frame. So it reads everything at once, replies to the last frame, and is at most `QUIET` late.
  This does not apply if it sends a state that only a long past order can have asked for.
- *A single reply.* The kart sent one reply to the first order, `ONCE` later another one, which may
  be for a later order, and then nothing for `QUIET`. So it does not echo every frame: it sends
  each change once, and the second reply is for the later order (`settled`).

A pause or a count is complete only once `QUIET` has passed since TCP answered the next order.
Until then, and if none of the four signs applies, a reply counts for the earlier order.
``counts_in`` returns how long that can last; if no time makes the reply count, only a new
connection helps.

Nothing counts during a flood, nor for `DEAF` after it. The age of bytes that a flood has queued is
unknown, because a kart that sends faster than it is read has more bytes waiting on its own side.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
import math

from evgp_protocol.frames import FrameDecoder, MalformedFrame, StateFrame
from evgp_protocol.states import RaceState

FLOOD_BYTES = 4096
"""Minimum number of bytes that count as a flood if they arrive in one beat; the rest is read in
the next beat. A kart sends at most about 15 bytes a beat."""

FLOOD = 2.0
"""Maximum duration of a flood, in seconds, after which race control drops the kart."""

DEAF = 1.0
"""Time after a flood during which no reply counts, in seconds. A flood that resumes within this
time counts as the same flood."""

QUIET = 2.0
"""Silence after which a kart has read what its TCP had answered, in seconds. A kart reads
something every second, or drops its connection; its replies have another second to arrive."""

ONCE = 1.5
"""Minimum time between two replies that shows that a kart does not echo every frame, in seconds.
A kart that echoes sends a reply each beat, or after one second in which it reads nothing."""

ECHOES = 24
"""Minimum number of replies to one order from a kart that counts as echoing every frame, if it
sends no more replies than it is sent frames."""

SLOWEST = 8.0
"""Minimum rate at which a kart reads frames, in Hz. Only the inspection finds a slower one."""

SELDOM = 5.0
"""Rate of replies below which a kart does not echo every frame, in Hz. A kart that echoes reads at
least at `SLOWEST`, except that it may read nothing for a second."""

PACE_WINDOW = 4.0
"""Time over which the replies of a kart that echoes every frame are compared with the frames that
it is sent, in seconds. Two consecutive windows with too few replies mean that it reads late."""

PACE = 0.95
"""Minimum share of frames that come back from a kart that echoes every frame and reads in time."""

NO_ORDER = 0
"""Serial of a reply that answers no order; orders count from 1."""

_TOO_OLD = -1
"""Used as the place at which a frame from a flood began; it precedes every `answers_from`."""

BUSY = 0.3
"""Time without a reply after which a kart that echoes every frame counts as busy, or as having
nothing to report, rather than as slow, in seconds."""

Heard = StateFrame | MalformedFrame


@dataclass
class _Order:
    """
    An order that a reply may answer.

    :ivar end: the order's end in the stream to the kart.
    :ivar answers_from: place in the stream from the kart before which no reply can answer the
        order.
    :ivar beat: the beat in which the order was sent.
    :ivar answered_in: the beat in which race control saw that the kart's TCP had answered it.
    :ivar replies: number of replies that answered it.
    :ivar said_in: the beat of the last of these replies.
    """

    serial: int
    state: RaceState
    end: int
    answers_from: int
    beat: int
    answered_in: int | None = None
    replies: int = 0
    said_in: int = 0


class _Pace:
    """
    Estimates how far a kart that echoes every frame may be behind, from its number of replies.

    The result is an upper bound, because a kart that reads everything at once and replies only to
    the last frame looks the same if it does so less often than it is sent frames. How soon the
    kart replies to a new state shows the truth.
    """

    def __init__(self, beat_rate: float) -> None:
        self._beat_rate = beat_rate
        self._window = math.ceil(PACE_WINDOW * beat_rate)
        # Whether the kart has replied to the last order, and the counts since then in a window:
        self._has_replied = False
        self._frames_of_order = self._replies_of_order = 0
        self._frames = self._replies = 0
        # Frames since its last reply, as long as it may still be carrying out the last order.
        self._unsaid = 0
        self._slow = 0  # consecutive windows with too few replies
        self._lost = 0  # frames sent but not echoed
        self.replies_seldom = False

    @property
    def behind(self) -> float:
        """Return how far the kart may be behind, in seconds; 0 if nothing suggests that it is."""
        return self._lost / self._beat_rate if self._slow > 1 else 0.0

    def begin(self) -> None:
        """Record a new order, to which the kart replies when it has carried it out."""
        self._has_replied = False
        self._unsaid = 0

    def sent(self) -> None:
        """Record a frame of the last order."""
        if not self._has_replied:
            self._unsaid += 1
            return
        self._frames_of_order += 1
        if self._frames_of_order == self._window:
            if self._replies_of_order > 1:
                self.replies_seldom = self._replies_of_order < SELDOM * PACE_WINDOW
            self._frames_of_order = self._replies_of_order = 0
        self._frames += 1
        self._judge()

    def said(self, after: int | None) -> None:
        """
        Record a reply to the last order.

        :param after: number of beats since the kart's TCP answered the order, if this is the first
            reply to it.
        """
        if after is not None:
            # A slow kart may have left the order unread for all of that time.
            self._lost = after if self._slow > 1 else min(self._lost, after)
            if self._lost < 3:
                self._lost = self._slow = 0
        if not self._has_replied:
            self._has_replied = True
            self._frames_of_order = self._replies_of_order = 0
        else:
            self._replies += 1
        self._replies_of_order += 1

    def said_before(self) -> None:
        """Record a reply to an earlier order than the last, which the kart has not reached yet."""
        if self._unsaid < BUSY * self._beat_rate:  # longer: it was silent for a reason
            self._frames += self._unsaid
            self._replies += 1
        self._unsaid = 0
        self._judge()

    def _judge(self) -> None:
        """At the end of a window, compare its replies with its frames."""
        if self._frames < self._window:
            return
        if self._replies >= PACE * self._frames:
            self._lost = max(0, self._lost - max(0, self._replies - self._frames))
            if self._slow < 2 or not self._lost:
                self._slow = self._lost = 0
        elif self._replies >= 0.9 * SLOWEST / self._beat_rate * self._frames:
            self._lost += self._frames - self._replies
            self._slow += 1
        self._frames = self._replies = 0


class Hearing:
    """
    Receives everything that one kart sends on one connection.

    Every byte has a place in its stream, counted from 0.

    :param beat_rate: number of beats per second, in Hz.
    """

    def __init__(self, beat_rate: float) -> None:
        self._decoder = FrameDecoder(ready_is_grid_active=True)
        # The order that the kart's replies have reached, and all later ones.
        self._orders: deque[_Order] = deque()
        # Whether the kart acknowledged the last IN_GARAGE that it is known to have read.
        self._acknowledges_garage = False
        # Whether it has sent more replies to an order than it was sent frames.
        self._outruns = False
        # Whether it has sent a state that none of these orders asks for.
        self._is_late = False
        # Even at `SLOWEST`, the kart has read the frames up to this beat.
        self._slowest = 0.0
        # A reply that is for a later order if nothing follows it, with its place; and the replies
        # that turned out to be for a later order.
        self._alone: tuple[StateFrame, int] | None = None
        self._settled: list[tuple[StateFrame, int]] = []
        # Places in the stream from the kart: up to which it was read, and up to which it was read
        # while nothing counted.
        self._read = 0
        self._deaf_to = 0
        # Times are in beats: while race control is stalled, it reads nothing either.
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
        """Return whether this beat's limit is reached; the rest then waits for the next beat."""
        return self._read_this_beat >= FLOOD_BYTES

    @property
    def waits(self) -> bool:
        """Return whether the kart's TCP has not yet answered all orders, as far as is known."""
        return bool(self._orders) and self._orders[-1].answered_in is None

    @property
    def has_reached_last(self) -> bool:
        """Return whether a reply that arrives now can answer only the last order."""
        return len(self._orders) <= 1

    @property
    def behind(self) -> float:
        """Return how late the kart may read, in seconds; 0 if there is no sign of that."""
        return self._pace.behind

    def counts_in(self) -> float:
        """
        Return the maximum time until a reply counts for the last order (s); 0 if unknown.

        Call this after ``decode``, for a reply that did not count although the last order asks for
        its state. The time is right if the kart repeats the reply, or is known to send each change
        once.
        """
        beats = self._pause_beats + 1
        if len(self._orders) < 2:
            return beats / self._beat_rate
        first, last = self._orders[0], self._orders[-1]
        if first.state is last.state and first.replies > 1 and self._alone is None:
            answered_in = self._orders[1].answered_in
            if answered_in is not None:
                beats = max(beats - self._beats + answered_in, 1)
            if not self._reads_all:
                if self._outruns:
                    return 0.0
                beats = max(beats, max(ECHOES, self._frames_of_first()) - first.replies)
        return beats / self._beat_rate

    def settled(self) -> list[tuple[StateFrame, int]]:
        """Return the replies that, since the last call, turned out to be for a later order."""
        settled, self._settled = self._settled, []
        return settled

    def sent_again(self) -> None:
        """Record that the last order's frame was sent once more."""
        self._pace.sent()

    def order(self, serial: int, state: RaceState, end: int, unread: int) -> None:
        """
        Record that an order is sent now. Bytes that have already arrived cannot answer it.

        :param serial: the order's number, from 1.
        :param end: the order's end in the stream to the kart.
        :param unread: number of bytes that have arrived but were not read yet.
        """
        self._orders.append(_Order(serial, state, end, self._read + unread, self._beats))
        self._pace.begin()

    def look(self, answered: int, unread: int) -> None:
        """
        Record how much the kart's TCP has answered.

        :param answered: place in the stream to the kart up to which it has answered.
        :param unread: number of bytes that, before `answered` was determined, had arrived but were
            not read yet.
        """
        for order in reversed(self._orders):
            if order.answered_in is not None:
                break
            if answered >= order.end:
                order.answered_in = self._beats
            else:
                order.answers_from = self._read + unread

    def read(self, count: int) -> None:
        """Record that `count` bytes were read; pass them to ``decode`` next."""
        self._read += count
        self._read_this_beat += count
        self._heard_in = self._beats

    def decode(self, data: memoryview) -> list[tuple[Heard, int]]:
        """
        Return the frames that the bytes complete, each with the serial of the order it answers.

        :param data: all bytes of the last read.
        """
        begin = self._read - len(data)
        if self._deaf_beats:
            self._deaf_to = self._read
        heard: list[tuple[Heard, int]] = []
        for each, at in self._decoder.decode(data):
            place = begin + at if begin + at >= self._deaf_to else _TOO_OLD
            heard.append((each, self._answered_by(each, place)))
        return heard

    def beat(self, now: float) -> bool:
        """
        Begin the next beat.

        :param now: the time, in seconds.
        :return: whether the kart has flooded for `FLOOD` without a pause of `DEAF`.
        """
        self._beats += 1
        self._slowest = min(self._slowest + SLOWEST / self._beat_rate, self._beats)
        if self._alone is not None and self._silent_for() > self._pause_beats:
            reply, place = self._alone
            self._pass()
            self._settled.append((reply, self._answered_by(reply, place)))
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
        Return the serial of the order that a frame answers, which the kart has then reached.

        :param place: the place at which the frame began.
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
            self._pace.said_before()
            return NO_ORDER
        for _ in range(can[0]):
            self._pass()
        order = self._orders[0]
        once = order.replies == 1 and self._beats - order.said_in >= ONCE * self._beat_rate
        order.replies += 1
        order.said_in = self._beats
        self._slowest = max(self._slowest, order.beat)
        if len(self._orders) == 1:
            first_after = None
            if order.replies == 1 and order.answered_in is not None:
                first_after = self._beats - order.answered_in
            self._pace.said(first_after)
        else:
            self._pace.said_before()
        if len(can) == 1:
            if order.state is not RaceState.IN_GARAGE:
                self._outruns |= order.replies > self._frames_of_first()
        elif once:
            self._alone = heard, place
        return order.serial

    def _pass(self) -> None:
        """Record that the kart has read beyond the first order."""
        order = self._orders.popleft()
        if order.state is RaceState.IN_GARAGE:
            self._acknowledges_garage = order.replies > 0

    def _has_read_on(self) -> bool:
        """Return whether the kart is known to have read the second order without a reply to it."""
        first, second = self._orders[0], self._orders[1]
        if second.answered_in is None or self._beats - second.answered_in <= self._pause_beats:
            return False
        if self._silent_for() > self._pause_beats:
            late = self._slowest - self._pause_beats <= second.beat
            return first.replies > 0 or not (self._acknowledges_garage or late)
        if self._reads_all:
            return first.replies > 0
        counted = first.state is not RaceState.IN_GARAGE and not self._outruns
        return counted and first.replies >= max(ECHOES, self._frames_of_first())

    @property
    def _reads_all(self) -> bool:
        """Return whether the kart's replies so far show that it reads everything at once."""
        return self._pace.replies_seldom and not self._is_late

    def _frames_of_first(self) -> int:
        """Return an upper bound of the number of frames of the first order that were sent."""
        until = self._orders[1].beat if len(self._orders) > 1 else self._beats
        return until - self._orders[0].beat + 1

    def _silent_for(self) -> int:
        """Return the number of beats since the last byte arrived."""
        return self._beats - self._heard_in
