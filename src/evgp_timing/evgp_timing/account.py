# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The account of one timing device: its passings, numbered, and its faults.

A passing is the device's report that something crossed the timing line. The account drops passings
that must not count, such as repeats.
"""

from __future__ import annotations

from collections import OrderedDict
import enum
import secrets

from evgp_node.results import Passing
from evgp_timing.passings import CLOCK_TOLERANCE, Event, MAX_RATE, Refused, Unchecked

RECENT = 60.0
"""Time for which the node reports a fault, in seconds."""

REMEMBERED = 1000
"""Maximum number of passings that an account remembers to recognise repeats."""

_LAST = 2**32 - 1


class Trouble(enum.Enum):
    """The faults of a device, worst first. The values are sentences for officials."""

    TOO_MANY = f'The device sends more than {MAX_RATE} passings a second. The rest are ignored'
    MISSED = "Some passings were not received: the device's numbers have gaps. Check the laps"
    RESTARTED = 'The device restarted, or its clock was set back. Check the laps'
    CLOCK = "The device's clock jumped, or its passings arrived late. Check the lap times"
    UNCHECKED = 'The device sends no checksums. Compare unlikely laps with what you saw'
    REPEATED = 'The device sends some passings more than once. Each counts only once'
    REFUSED = "Some of the device's data cannot be read. Check the cable, kind and baud rate"


class Account:
    """
    The passings of one device since this program started.

    :param now: the current time, in seconds.
    :param gates: numbers and labels of transponders that belong to gates instead of karts. Their
        passings are dropped.
    :ivar session: a random value that changes each time the device restarts its numbers.
    :ivar counts: how often each fault has occurred.
    :ivar taken: number of accepted passings.
    :ivar heard_at: when the last complete message arrived, in seconds.
    :ivar last_refusal: why the account refused the last unreadable message; at first, empty.
    """

    def __init__(self, now: float, gates: frozenset[str] = frozenset()) -> None:
        self.session = secrets.token_hex(4)
        self.counts = dict.fromkeys(Trouble, 0)
        self.taken = 0
        self.heard_at = now
        self.last_refusal = ''
        self._noted_at: dict[Trouble, float | None] = dict.fromkeys(Trouble)
        self._gates = gates
        self._number = 0
        self._by_one = False  # its numbers increase by one, so a gap means a lost passing
        self._gaps = 0  # size of the gaps before that was known
        self._recent: OrderedDict[tuple[int, str, int], None] = OrderedDict()
        self._offset: float | None = None  # this computer's clock minus the device's
        self._second = 0
        self._in_second = 0

    def take(self, event: Event, now: float) -> Passing | None:
        """Process an event, and return an accepted passing, numbered in `session`, or None."""
        if isinstance(event, Refused):
            self.last_refusal = event.reason
            self._note(Trouble.REFUSED, now)
            return None
        self.heard_at = now
        if not isinstance(event, Passing):
            return None
        # The number alone is not unique, because a device that restarts begins again at 1.
        identity = event.number, event.transponder, event.stamp_ns
        if identity in self._recent:
            self._note(Trouble.REPEATED, now)
            return None
        self._recent[identity] = None
        if len(self._recent) > REMEMBERED:
            self._recent.popitem(last=False)
        self._watch_count(event, now)
        self._watch_clock(event, now)
        if isinstance(event, Unchecked):
            self._note(Trouble.UNCHECKED, now)
        self._number = event.number or self._number % _LAST + 1
        if self._gates.intersection((event.transponder, *event.transponder.split(' ', 1))):
            return None
        if int(now) != self._second:
            self._second, self._in_second = int(now), 0
        self._in_second += 1
        if self._in_second > MAX_RATE:
            self._note(Trouble.TOO_MANY, now)
            return None
        self.taken += 1
        return event._replace(session=self.session, number=self._number)

    def trouble(self, now: float) -> Trouble | None:
        """Return the worst recent fault, or None."""
        for trouble, at in self._noted_at.items():
            if at is not None and now - at < RECENT:
                return trouble
        return None

    def _watch_count(self, passing: Passing, now: float) -> None:
        if not passing.number or not self._number:
            return
        if passing.number <= self._number:
            self._begin_session(now)
            return
        # Some devices number other things too, and a recording may lack every second passing.
        self._gaps += passing.number - self._number - 1
        self._by_one |= passing.number == self._number + 1
        if self._by_one and self._gaps:
            self._note(Trouble.MISSED, now, self._gaps)
            self._gaps = 0

    def _watch_clock(self, passing: Passing, now: float) -> None:
        offset = now - passing.stamp_ns / 1e9
        if self._offset is not None and abs(offset - self._offset) > CLOCK_TOLERANCE:
            self._note(Trouble.CLOCK, now)
            # Without numbers, only the clock shows that the device restarted.
            if not passing.number and offset > self._offset:
                self._begin_session(now)
            self._offset = None
        if self._offset is None:
            self._offset = offset

    def _begin_session(self, now: float) -> None:
        self._note(Trouble.RESTARTED, now)
        self.session = secrets.token_hex(4)
        self._number = 0
        self._offset = None

    def _note(self, trouble: Trouble, now: float, count: int = 1) -> None:
        self.counts[trouble] += count
        if trouble is not Trouble.UNCHECKED or self.counts[trouble] == count:  # reported once
            self._noted_at[trouble] = now
