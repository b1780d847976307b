# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The quality of the link to one kart: the figures that officials see, and their computation.

The code is pure: it turns times and counts into figures. ``evgp_protocol.link`` defines the grades
*good*, *fair* and *poor*; ``karts.link`` holds the socket and reads the kernel's figures. The
kart's *kernel* answers, whether or not the kart's program reads (§2.A, §4.D).
"""

from __future__ import annotations

from collections import deque
import math
from typing import NamedTuple

from evgp_protocol.frames import encode
from evgp_protocol.link import BEAT_RATE, Grade, grade, GRADE_WINDOW, GRADES, TcpInfo
from evgp_protocol.states import RaceState

MEASURE_EVERY = 1.0
"""Time between two measurements of a link that does not get worse, in seconds."""

POOR_LATELY = 60.0
"""How long after a poor link GRID_ACTIVE's confirmation names its kart, in seconds."""

CLOSING = 0.4
"""Share of the largest window that a kart's TCP has offered; a smaller window means that the kart
is leaving frames unread. The lwIP window of a kart that reads everything shrinks to half of the
largest. Linux has a window of about 64 kB, which shows unread frames only after a long time."""

BYTES_PER_SECOND = BEAT_RATE * len(encode(RaceState.GREEN_GREEN))
"""Number of bytes sent to a kart per second of racing, at the usual rate."""

_WORSE_FROM = {
    Grade.GOOD: GRADES[Grade.FAIR],
    Grade.FAIR: GRADES[Grade.POOR],
    Grade.POOR: math.inf,
}
"""For each grade, the answer time from which a link is worse than that, in seconds."""


class LinkQuality(NamedTuple):
    """
    One measurement of a link. Times that the kernel does not report are None, and numbers are 0.

    :param worst_answer: longest time that a frame waited, or has been waiting, for an answer from
        the kart's kernel in the last ``GRADE_WINDOW``, in seconds; the grade depends on it.
    :param round_trip: round-trip time, smoothed by the kernel, in seconds.
    :param retransmitted: number of segments retransmitted on this connection.
    :param behind: how late the kart's program may be in reading what it is sent, in seconds; 0 if
        there is no sign of that.
    """

    grade: Grade
    worst_answer: float | None
    round_trip: float | None
    retransmitted: int
    behind: float = 0.0


NOT_MEASURED = LinkQuality(Grade.UNKNOWN, None, None, 0)


class LinkMeter:
    """
    Measures one connection.

    :param now: time at which the connection was made, in seconds.
    """

    def __init__(self, now: float) -> None:
        self._worse_from = _WORSE_FROM[Grade.GOOD]
        self._measured_at = now
        self._largest_window = 0
        # The longest answer, then the longest of the later ones, and so on; the first is worst.
        self._longest: deque[tuple[float, float]] = deque()

    def answered(self, took: float, now: float) -> None:
        """Record that a frame was answered, how long that took (s), and when (s)."""
        while self._longest and self._longest[-1][1] <= took:
            self._longest.pop()
        self._longest.append((now, took))

    def is_due(self, age: float, now: float) -> bool:
        """
        Return whether a measurement is due: each second, and at once when the link gets worse.

        :param age: age of the oldest unanswered frame, in seconds; 0 if all are answered.
        """
        if now - self._measured_at >= MEASURE_EVERY:
            return True
        return self._worst(age, now) >= self._worse_from

    def measure(
        self, age: float, info: TcpInfo | None, now: float, behind: float = 0.0
    ) -> LinkQuality:
        """
        Return the figures at a time in seconds.

        :param age: age of the oldest unanswered frame, in seconds; 0 if all are answered.
        :param info: the kernel's figures; None if it has none.
        :param behind: how late the kart's program may be in reading, according to its reports, in
            seconds; 0 if there is no sign of that.
        """
        behind = max(behind, self._behind_by_window(info))
        worst = round(self._worst(age, now), 4)
        quality = LinkQuality(
            Grade.POOR if behind else grade(worst),
            worst,
            None if info is None else round(info.round_trip, 4),
            0 if info is None else info.retransmitted,
            round(behind, 1),
        )
        self._worse_from = _WORSE_FROM[grade(worst)]
        self._measured_at = now
        return quality

    def _behind_by_window(self, info: TcpInfo | None) -> float:
        """Return the kart's maximum delay in reading, by its window (s); 0 if there is no sign."""
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
