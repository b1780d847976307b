# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What becomes of the passings of one device: who they are, which are left out, what is wrong."""

from __future__ import annotations

from collections import OrderedDict
import enum
import secrets

from evgp_timing.passings import Event, Passing, Refused

MAX_RATE = 200
"""Maximum number of passings that are taken in one second; the rest are counted and left out."""

CLOCK_TOLERANCE = 0.5
"""Maximum change between the device's clock and this computer's between two passings, seconds."""

RECENT = 60.0
"""Time for which what was wrong is told, seconds."""

REMEMBERED = 1000
"""Number of passings by which a repeated one is known."""

_LAST = 2**32 - 1


class Trouble(enum.Enum):
    """What a device may do wrong, as officials read it; the worst first."""

    TOO_MANY = f'It sends more than {MAX_RATE} passings a second. The rest are left out'
    MISSED = 'Passings of it were not received: its count has gaps. Look at the laps'
    RESTARTED = 'It began anew: switched off, or its clock was set back. Look at the laps'
    CLOCK = 'Its clock jumped, or its passings came late. Look at the lap times'
    UNCHECKED = 'It sends no checksums. What is changed on the way to here is not noticed'
    REPEATED = 'It sends passings again. They count once'
    REFUSED = 'Some of what it sends cannot be read. Look at its cable, its kind and the baud rate'


class Account:
    """
    The passings of one device, from the start of this program on.

    :param gates: numbers and labels of transponders whose passings are left out: no kart's.
    :ivar session: another each time the device begins to count anew.
    :ivar counts: how often each trouble occurred.
    :ivar taken: number of passings taken.
    :ivar heard_at: when something whole was last heard, seconds.
    :ivar last_refusal: why something could not be read.
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
        self._by_one = False  # it has counted by one: a gap is what was not received
        self._gaps = 0  # of its count before that
        self._recent: OrderedDict[tuple[int, str, int], None] = OrderedDict()
        self._offset: float | None = None  # of this computer's clock to the device's
        self._second = 0
        self._in_second = 0

    def take(self, event: Event, now: float) -> int | None:
        """Return the number of a passing within `session`; None: it is none, or is left out."""
        if isinstance(event, Refused):
            self.last_refusal = event.reason
            self._note(Trouble.REFUSED, now)
            return None
        self.heard_at = now
        if not isinstance(event, Passing):
            return None
        # A number alone would not do: it comes again when the device begins to count anew.
        identity = event.number, event.transponder, event.time_us
        if identity in self._recent:
            self._note(Trouble.REPEATED, now)
            return None
        self._recent[identity] = None
        if len(self._recent) > REMEMBERED:
            self._recent.popitem(last=False)
        self._watch_count(event, now)
        self._watch_clock(event, now)
        if not event.checked:
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
        return self._number

    def trouble(self, now: float) -> Trouble | None:
        """Return the worst of what was wrong lately."""
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
        # Some devices count more than passings, and a capture may keep each second one.
        self._gaps += passing.number - self._number - 1
        self._by_one |= passing.number == self._number + 1
        if self._by_one and self._gaps:
            self._note(Trouble.MISSED, now, self._gaps)
            self._gaps = 0

    def _watch_clock(self, passing: Passing, now: float) -> None:
        offset = now - passing.time_us / 1_000_000
        if self._offset is not None and abs(offset - self._offset) > CLOCK_TOLERANCE:
            self._note(Trouble.CLOCK, now)
            # A device that does not count shows a restart by its clock alone.
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
        if trouble is not Trouble.UNCHECKED or self.counts[trouble] == count:  # said once
            self._noted_at[trouble] = now
