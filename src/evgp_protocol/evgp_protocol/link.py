# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
How good a connection is, by what its kernel says (§2.A, §4.D).

`Answers`, `grade` and `parse` are pure: times and counts in, round trips and a word out.
`make_prompt`, `read`, `unanswered`, `unread` and `unsent` are for a socket; Linux only. What is
answered is so by the *kernel* at the other end: its TCP has what was sent, whether or not the
kart's program reads.
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
from typing import Protocol

SIOCOUTQNSD = 0x894B
"""Linux's request for the number of bytes not sent yet; TIOCOUTQ's have not been answered."""

BEAT_RATE = 12.0
"""How often race control sends each kart its state by default, Hz. §4.C wants 10 in a second: with
one beat skipped, 11 are left. No more, since a kart that reads one frame in each turn of a slower
loop is later with every second (docs/wire.md)."""

GRADE_WINDOW = 10.0
"""Time for which the worst round trip counts for the grade, in seconds."""

ANSWER_STEP = 0.2
"""Time by which an answer is later than the quickest of a link, in seconds: from two of them on,
the state is sent every second beat only, from three on every third, and so on. So a long way is no
reason to send less (§4.C wants 10 states a second), but a narrow one is, on which a stop would
wait behind them."""

# struct tcp_info, linux/tcp.h: it only ever grows at its end. This is Linux 4.1's (2015), and
# where Linux 5.4 (2019) put the window of the other end.
_TCP_INFO = struct.Struct('=8B24I4Q')
_WINDOW = struct.Struct('=I')
_WINDOW_AT = 228
_ENOUGH = _WINDOW_AT + _WINDOW.size
_COUNT = bytes(4)

_TCP_THIN_LINEAR_TIMEOUTS = 16  # since Linux 2.6.34; Python does not name it


class Grade(enum.Enum):
    """How good a link is; the members stand from the best to the worst."""

    UNKNOWN = 'unknown'
    GOOD = 'good'
    FAIR = 'fair'
    POOR = 'poor'


GRADES = {Grade.GOOD: 0.0, Grade.FAIR: 0.2, Grade.POOR: 0.5}
"""For each grade, the worst round trip of the last `GRADE_WINDOW` from which on it applies, s.

A frame is sent every 0.083 s. Where one is lost, the next shows it, and it is there within 0.2 s:
a good link loses single frames at most. A poor one was halfway to the 1 s after which the kart
stops by itself and race control takes it for lost."""


def grade(worst: float | None) -> Grade:
    """
    Return how good a link is.

    :param worst: the longest round trip of the last `GRADE_WINDOW`, s; also of what is not
        answered yet, up to now. None: nothing was sent.
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
    What the kernel knows of a connection (``TCP_INFO``).

    :ivar round_trip: smoothed, s; 0: not measured yet.
    :ivar variation: of the round trip, s.
    :ivar retransmitted: segments that were sent again, of the whole connection.
    :ivar unanswered: segments that were sent and are not answered.
    :ivar since_answer: time since the other end's kernel last answered, s; exact to 1 to 4 ms.
    :ivar answered: bytes that the other end's kernel has answered, of the whole connection.
    :ivar window: bytes that the other end's kernel would still take; None: it is not known.
    """

    round_trip: float
    variation: float
    retransmitted: int
    unanswered: int
    since_answer: float
    answered: int
    window: int | None = None


def parse(data: bytes) -> TcpInfo | None:
    """Return what Linux's ``struct tcp_info`` says; None: it is shorter, so of an older kernel."""
    if len(data) < _TCP_INFO.size:
        return None
    fields = _TCP_INFO.unpack_from(data)[8:]
    window = None
    if len(data) >= _ENOUGH:
        (window,) = _WINDOW.unpack_from(data, _WINDOW_AT)
    return TcpInfo(
        round_trip=fields[15] / 1e6,
        variation=fields[16] / 1e6,
        retransmitted=fields[23],
        unanswered=fields[4],
        since_answer=fields[12] / 1e3,
        answered=fields[26],
        window=window,
    )


class Socket(Protocol):
    """What is needed of a socket; asyncio's have it too."""

    def fileno(self) -> int:
        """Return its number; -1: it is closed."""

    def setsockopt(self, level: int, option: int, value: int | bytes, /) -> None:
        """Set an option."""

    def getsockopt(self, level: int, option: int, size: int, /) -> bytes:
        """Return an option of so many bytes at most."""


def make_prompt(link: Socket) -> None:
    """Make a TCP socket prompt: no Nagle, and what was lost is sent again soon."""
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    try:
        # It does not take lost packets for a sign to send less. With the usual ones, where
        # 5 % are lost a kart hears nothing for a second every twenty minutes.
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_CONGESTION, b'bbr')
    except OSError:
        pass  # this kernel does not have it, or not for everyone
    # What was lost is sent again at an even pace (where it is not bbr that decides). With
    # ever longer waits, a link that fails for half a second is silent for more than one.
    link.setsockopt(socket.IPPROTO_TCP, _TCP_THIN_LINEAR_TIMEOUTS, 1)


def read(link: Socket) -> TcpInfo | None:
    """Return what the kernel knows of a TCP connection; None: it does not say, or it is closed."""
    try:
        return parse(link.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _ENOUGH))
    except OSError:
        return None


def unanswered(link: Socket) -> int:
    """
    Return how many bytes in the kernel the other end's TCP has not answered.

    :raises OSError: if the socket is closed.
    """
    return _in_kernel(link, termios.TIOCOUTQ)


def unsent(link: Socket) -> int:
    """
    Return how many bytes in the kernel have not left yet.

    :raises OSError: if the socket is closed.
    """
    return _in_kernel(link, SIOCOUTQNSD)


def unread(link: Socket) -> int:
    """
    Return how many bytes have arrived and were not read yet.

    :raises OSError: if the socket is closed.
    """
    return _in_kernel(link, termios.FIONREAD)


def _in_kernel(link: Socket, which: int) -> int:
    return int.from_bytes(fcntl.ioctl(link.fileno(), which, _COUNT), sys.byteorder)


class Answers:
    """
    Which frames of one connection the other end's TCP has answered, and how long it took.

    :ivar written: bytes written so far.
    :ivar answered: bytes of them that were answered when last looked.
    :ivar wrote_at: when the last frame was written, s.
    """

    def __init__(self) -> None:
        self.written = 0
        self.answered = 0
        self.wrote_at = 0.0
        self._open: deque[tuple[int, float]] = deque()  # up to which byte, and when written
        self._quickest: float | None = None

    def wrote(self, size: int, now: float) -> None:
        """Take note that a frame of so many bytes is written at a time, s."""
        self.written += size
        self.wrote_at = now
        self._open.append((self.written, now))

    def look(self, unanswered: int, now: float) -> list[float]:
        """
        Take note of how many of the bytes written are unanswered at a time.

        :return: the round trips of the frames that are answered since the last look, oldest
            first, s: each at most too long by the time between the two looks.
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
        """Return the age of the oldest unanswered frame, s; 0: all are answered."""
        return now - self._open[0][1] if self._open else 0.0

    def may_beat(self, now: float) -> bool:
        """Return whether the state may be sent again: on a narrow link not yet (`ANSWER_STEP`)."""
        late = self.age(now) - (self._quickest or 0.0)
        beats = int(late / ANSWER_STEP)
        return now - self.wrote_at >= (beats - 0.4) / BEAT_RATE  # beats are not exact
