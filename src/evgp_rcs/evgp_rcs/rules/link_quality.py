# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
How good the link to one kart is: the figures that officials see, and what they are made of.

Pure: times and counts in, figures out. ``evgp_protocol.link`` has the words *good*, *fair* and
*poor* and where they begin; ``kart_link`` holds the socket and says what its kernel tells. It is
the kart's *kernel* that answers, whether or not the kart's program reads (§2.A, §4.D).
"""

from __future__ import annotations

from collections import deque
import math
from typing import NamedTuple

from evgp_protocol.frames import encode
from evgp_protocol.link import BEAT_RATE, Grade, grade, GRADE_WINDOW, GRADES, TcpInfo
from evgp_protocol.states import RaceState

MEASURE_EVERY = 1.0
"""Time between two measurements of a link that gets no worse, in seconds."""

POOR_LATELY = 60.0
"""Time after a link was poor in which GRID_ACTIVE's question names its kart, in seconds."""

CLOSING = 0.4
"""Share of the largest window that a kart's TCP has offered, below which the kart leaves unread
what it is sent. lwIP's window of a kart that reads everything goes down to half of it; Linux's, of
some 64 kB, shows nothing for a long time."""

BYTES_PER_SECOND = BEAT_RATE * len(encode(RaceState.GREEN_GREEN))
"""Number of bytes that a kart is sent in a second of racing, at the usual rate."""

_WORSE_FROM = {
    Grade.GOOD: GRADES[Grade.FAIR],
    Grade.FAIR: GRADES[Grade.POOR],
    Grade.POOR: math.inf,
}
"""For each grade, the answer with which a link gets worse, in seconds."""


class LinkQuality(NamedTuple):
    """
    One measurement of a link. What the kernel does not tell is None; a number of it is 0.

    :param worst_answer: the longest that a frame waited for the answer of the kart's kernel in the
        last ``GRADE_WINDOW``, or has been waiting, s; the grade goes by it.
    :param round_trip: there and back, smoothed by the kernel, s; its mean deviation is
        ``round_trip_variation``, s.
    :param retransmitted: segments sent again, on this connection.
    :param retransmitted_last_second: those of them since the measurement before this one.
    :param unanswered_bytes: bytes that the kart's kernel has not answered.
    :param answered_ago: time since anything came from it, s.
    :param worst_gap: the longest time between two frames since the measurement before, s.
    :param behind: how far the kart's program may be behind in reading what it is sent, s; 0:
        nothing shows that it is.
    """

    grade: Grade
    worst_answer: float | None
    round_trip: float | None
    round_trip_variation: float | None
    retransmitted: int
    retransmitted_last_second: int
    unanswered_bytes: int
    answered_ago: float | None
    worst_gap: float | None
    behind: float = 0.0


NOT_MEASURED = LinkQuality(Grade.UNKNOWN, None, None, None, 0, 0, 0, None, None)


class LinkMeter:
    """
    Measures one connection.

    :param now: when it was made, s.
    """

    def __init__(self, now: float) -> None:
        self._worse_from = _WORSE_FROM[Grade.GOOD]
        self._measured_at = now
        self._retransmitted = 0
        self._wrote_at = now
        self._worst_gap = 0.0
        self._largest_window = 0
        # The longest answer, and each that is the longest after it; so the first is the worst.
        self._longest: deque[tuple[float, float]] = deque()

    def wrote(self, now: float) -> None:
        """Take note that a frame was written, at a time in seconds."""
        self._worst_gap = max(self._worst_gap, now - self._wrote_at)
        self._wrote_at = now

    def answered(self, took: float, now: float) -> None:
        """Take note that a frame was answered at a time, after some time (both s)."""
        while self._longest and self._longest[-1][1] <= took:
            self._longest.pop()
        self._longest.append((now, took))

    def is_due(self, age: float, now: float) -> bool:
        """
        Return whether to measure at a time (s): each second, and at once when it gets worse.

        :param age: of the oldest frame that is not answered, s; 0: all are.
        """
        if now - self._measured_at >= MEASURE_EVERY:
            return True
        return self._worst(age, now) >= self._worse_from

    def measure(
        self, age: float, unanswered: int, info: TcpInfo | None, now: float, behind: float = 0.0
    ) -> LinkQuality:
        """
        Return the figures at a time, in seconds.

        :param age: of the oldest frame that is not answered, s; 0: all are.
        :param unanswered: number of bytes that are not.
        :param info: what the kernel tells; None: it does not.
        :param behind: how far the kart's program may be behind by what it says (s); 0: it is not.
        """
        behind = max(behind, self._behind_by_window(info))
        worst = round(self._worst(age, now), 4)
        again = self._retransmitted if info is None else info.retransmitted
        quality = LinkQuality(
            Grade.POOR if behind else grade(worst),
            worst,
            None if info is None else round(info.round_trip, 4),
            None if info is None else round(info.variation, 4),
            again,
            again - self._retransmitted,
            unanswered,
            None if info is None else round(info.since_answer, 4),
            round(max(self._worst_gap, now - self._wrote_at), 4),
            round(behind, 1),
        )
        self._worse_from = _WORSE_FROM[grade(worst)]
        self._measured_at = now
        self._retransmitted = again
        self._worst_gap = 0.0
        return quality

    def _behind_by_window(self, info: TcpInfo | None) -> float:
        """Return how much the kart may have left unread, as time at most (s); 0: nothing shows."""
        if info is None or info.window is None:
            return 0.0
        self._largest_window = max(self._largest_window, info.window)
        if info.window >= CLOSING * self._largest_window:
            return 0.0
        return (self._largest_window - info.window) / BYTES_PER_SECOND

    def _worst(self, age: float, now: float) -> float:
        while self._longest and now - self._longest[0][0] > GRADE_WINDOW:
            self._longest.popleft()
        return max(age, self._longest[0][1] if self._longest else 0.0)
