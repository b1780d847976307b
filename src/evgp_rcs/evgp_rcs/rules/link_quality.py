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
"""Time in seconds between two measurements of a link that is not getting worse."""

POOR_LATELY = 60.0
"""Time in seconds after a poor measurement during which a confirmation of GRID_ACTIVE still names
the kart."""

CLOSING = 0.4
"""Share of the largest window that a kart's TCP has offered. A smaller window means that the kart
is leaving frames unread. With lwIP, the window of a kart that reads everything still shrinks to
half of the largest. With Linux, it is about 64 kB, so unread frames show only after a long
time."""

BYTES_PER_SECOND = BEAT_RATE * len(encode(RaceState.GREEN_GREEN))
"""Number of bytes sent to a kart per second of racing, at the usual rate."""

_WORSE_FROM = {
    Grade.GOOD: GRADES[Grade.FAIR],
    Grade.FAIR: GRADES[Grade.POOR],
    Grade.POOR: math.inf,
}
"""For each grade, the answer time in seconds from which a link gets a worse grade."""


class LinkQuality(NamedTuple):
    """
    One measurement of a link; `LinkQuality.msg` explains the fields.

    A time that is unknown is None here. ``worst_answer`` includes a frame that is still waiting
    for its answer.
    """

    grade: Grade
    worst_answer: float | None
    round_trip: float | None
    retransmitted: int
    behind: float = 0.0

    @property
    def delay(self) -> str:
        """Return what makes the link worse than good, as a phrase about the kart."""
        if self.behind:
            return f'may read a stop {self.behind:.1f} s late'
        return f'takes {self.worst_answer or 0.0:.2f} s to answer'


NOT_MEASURED = LinkQuality(Grade.UNKNOWN, None, None, 0)


class LinkMeter:
    """
    The measurement of one connection.

    :param now: time at which the connection was made, in seconds.
    """

    def __init__(self, now: float) -> None:
        self._worse_from = _WORSE_FROM[Grade.GOOD]
        self._measured_at = now
        self._largest_window = 0
        # The longest answer, then the longest of the later ones, and so on; the first is worst.
        self._longest: deque[tuple[float, float]] = deque()

    def answered(self, took: float, now: float) -> None:
        """Record that a frame was answered after `took` seconds, at the time `now` (s)."""
        while self._longest and self._longest[-1][1] <= took:
            self._longest.pop()
        self._longest.append((now, took))

    def is_due(self, age: float, now: float) -> bool:
        """
        Return whether to measure now: every second, and at once when the link gets worse.

        :param age: age of the oldest unanswered frame, in seconds; 0 if all are answered.
        """
        if now - self._measured_at >= MEASURE_EVERY:
            return True
        return self._worst(age, now) >= self._worse_from

    def measure(
        self, age: float, info: TcpInfo | None, now: float, behind: float = 0.0
    ) -> LinkQuality:
        """
        Return the figures at the time `now`, in seconds.

        :param age: age of the oldest unanswered frame, in seconds; 0 if all are answered.
        :param info: the kernel's figures; None if it has none.
        :param behind: ``LinkQuality.behind``, in seconds, as the kart's reports alone show it.
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
        """Return ``LinkQuality.behind``, in seconds, as the kart's window alone shows it."""
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
