# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The quality of a connection, as the kernel sees it (§2.A, §4.D).

`Answers`, `grade` and `parse` are pure: they take times and counts, and return round trips and
grades. `make_prompt`, `read`, `unanswered`, `unread` and `unsent` use a socket, or asyncio's form
of one, on Linux only. An *answer* comes from the kernel at the other end, whose TCP has received
the bytes, whether or not the kart's program reads them.
"""

from __future__ import annotations

from collections import deque
import dataclasses
import enum
import fcntl
import socket
import struct
import sys
import termios

SIOCOUTQNSD = 0x894B
"""Linux's request for the number of unsent bytes; TIOCOUTQ also counts unanswered ones."""

BEAT_RATE = 12.0
"""Default rate at which race control sends each kart its state, in Hz. §4.C requires 10 per
second, and 11 remain if one beat is skipped. At a higher rate, a kart that reads one frame in each
turn of a slower loop would fall further behind every second (docs/wire.md)."""

GRADE_WINDOW = 10.0
"""Period over which the worst round trip determines the grade, in seconds."""

ANSWER_STEP = 0.2
"""Delay of an answer, compared with the link's quickest, that makes race control skip one beat, in
seconds. After twice this delay, it sends the state only every second beat, after three times only
every third, and so on. A long link therefore still gets 10 states per second (§4.C), but a narrow
one gets fewer, because a stop would wait behind them."""

# struct tcp_info, linux/tcp.h: it only grows at its end. This is Linux 4.1's (2015), and the place
# at which Linux 5.4 (2019) added the window of the other end.
_TCP_INFO = struct.Struct('=8B24I4Q')
_WINDOW = struct.Struct('=I')
_WINDOW_AT = 228
_ENOUGH = _WINDOW_AT + _WINDOW.size
_COUNT = bytes(4)

_TCP_THIN_LINEAR_TIMEOUTS = 16  # since Linux 2.6.34; Python has no name for it


class Grade(enum.Enum):
    """The quality of a link. After UNKNOWN, the members go from the best to the worst."""

    UNKNOWN = 'unknown'
    GOOD = 'good'
    FAIR = 'fair'
    POOR = 'poor'


GRADES = {Grade.GOOD: 0.0, Grade.FAIR: 0.2, Grade.POOR: 0.5}
"""Minimum of the worst round trip of the last `GRADE_WINDOW` for each grade, in seconds.

A frame is sent every 0.083 s. If one is lost, the next one reveals this, and TCP sends the lost
frame again within 0.2 s, so a good link loses only single frames. A poor one was halfway to the
1 s after which the kart stops and race control drops it."""


def grade(worst: float | None) -> Grade:
    """
    Return the grade of a link.

    :param worst: the longest round trip of the last `GRADE_WINDOW`, in seconds, including the age
        of unanswered frames; None if nothing was sent.
    """
    found = Grade.UNKNOWN
    if worst is not None:
        for each, least in GRADES.items():
            if worst >= least:
                found = each
    return found


@dataclasses.dataclass(frozen=True)
class TcpInfo:
    """
    The kernel's data about a connection (``TCP_INFO``).

    :ivar round_trip: smoothed round-trip time, in seconds; 0 if not measured yet.
    :ivar retransmitted: number of segments sent again since the connection began.
    :ivar since_answer: time since the other kernel last answered, in seconds, with an error of 1
        to 4 ms.
    :ivar window: number of bytes that the other kernel would still accept; None if unknown.
    """

    round_trip: float
    retransmitted: int
    since_answer: float
    window: int | None = None


def parse(data: bytes) -> TcpInfo | None:
    """Return the contents of Linux's ``struct tcp_info``; None if it is from too old a kernel."""
    if len(data) < _TCP_INFO.size:
        return None
    fields = _TCP_INFO.unpack_from(data)[8:]
    window = None
    if len(data) >= _ENOUGH:
        (window,) = _WINDOW.unpack_from(data, _WINDOW_AT)
    return TcpInfo(
        round_trip=fields[15] / 1e6,
        retransmitted=fields[23],
        since_answer=fields[12] / 1e3,
        window=window,
    )


def make_prompt(link: socket.socket) -> None:
    """Make a TCP socket prompt: no Nagle's algorithm, and quick retransmission."""
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    try:
        # bbr does not slow down because of lost packets. With the usual algorithms, at 5 % loss a
        # kart hears nothing for a second every twenty minutes.
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_CONGESTION, b'bbr')
    except OSError:
        pass  # this kernel does not have it, or does not allow it
    # Without bbr, retransmit at an even pace. With exponential backoff, a link that fails for half
    # a second is silent for more than one.
    link.setsockopt(socket.IPPROTO_TCP, _TCP_THIN_LINEAR_TIMEOUTS, 1)


def read(link: socket.socket) -> TcpInfo | None:
    """Return the kernel's data about a connection; None if it is closed or the kernel too old."""
    try:
        return parse(link.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _ENOUGH))
    except OSError:
        return None


def unanswered(link: socket.socket) -> int:
    """
    Return the number of bytes that the other end's TCP has not answered.

    :raises OSError: if the socket is closed.
    """
    return _in_kernel(link, termios.TIOCOUTQ)


def unsent(link: socket.socket) -> int:
    """
    Return the number of bytes that the kernel has not sent yet.

    :raises OSError: if the socket is closed.
    """
    return _in_kernel(link, SIOCOUTQNSD)


def unread(link: socket.socket) -> int:
    """
    Return the number of bytes that have arrived but were not read yet.

    :raises OSError: if the socket is closed.
    """
    return _in_kernel(link, termios.FIONREAD)


def _in_kernel(link: socket.socket, which: int) -> int:
    return int.from_bytes(fcntl.ioctl(link.fileno(), which, _COUNT), sys.byteorder)


class Answers:
    """
    Records which frames of one connection the other end's TCP has answered, and how soon.

    :ivar written: number of bytes written so far.
    :ivar answered: number of these bytes that had been answered at the last `look`.
    :ivar wrote_at: time at which the last frame was written, in seconds.
    """

    def __init__(self) -> None:
        self.written = 0
        self.answered = 0
        self.wrote_at = 0.0
        self._open: deque[tuple[int, float]] = deque()  # up to which byte, and when written
        self._quickest: float | None = None

    def wrote(self, size: int, now: float) -> None:
        """Record that a frame of `size` bytes was written at `now`, in seconds."""
        self.written += size
        self.wrote_at = now
        self._open.append((self.written, now))

    def look(self, unanswered: int, now: float) -> list[float]:
        """
        Record how many of the bytes written are unanswered at `now`.

        :return: the round trips of the frames answered since the last look, oldest first, in
            seconds; each is too long by at most the time between the two looks.
        """
        self.answered = self.written - unanswered
        trips = []
        while self._open and self._open[0][0] <= self.answered:
            trips.append(now - self._open.popleft()[1])
        if trips:
            quickest = min(trips)
            self._quickest = quickest if self._quickest is None else min(quickest, self._quickest)
        return trips

    def age(self, now: float) -> float:
        """Return the age of the oldest unanswered frame, in seconds; 0 if all are answered."""
        return now - self._open[0][1] if self._open else 0.0

    def may_beat(self, now: float) -> bool:
        """Return whether it is time to send the state again. A narrow link gets more time."""
        late = self.age(now) - (self._quickest or 0.0)
        beats = int(late / ANSWER_STEP)
        return now - self.wrote_at >= (beats - 0.4) / BEAT_RATE  # beats are not exact
