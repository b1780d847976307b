# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Whether a key or a click still means what it meant when the official made it.

A window whose thread is held up finds all that was pressed meanwhile in its queue. It must not act
on a key that was pressed 15 s ago as if it were new. Two things tell, and either is enough:

- the time stamp of the input, by the clock of the display server (``age``);
- the window's own beat: if that came late, what is in the queue has waited (``held_up``).

And a press is meant for what stood there when the official aimed (``Aim``).

Pure: stamps and times go in. Whether an old input is a stop, which acts all the same, is for the
window to say.
"""

from __future__ import annotations

from typing import Generic, TypeVar

T = TypeVar('T')

STALE = 0.5
"""Maximum age of a key or click that acts, unless it is a stop, in seconds."""

SETTLE = 0.3
"""Time after a hold-up during which what comes counts as having waited, in seconds."""

SEEN = 0.3
"""Time that a question must have been there before a click on its YES counts, in seconds."""

AGAIN = 0.4
"""Time within which the same key again is the same press, as in a double click, in seconds."""

AIM = 0.5
"""Time that an official needs to see that something else stands where they aim, in seconds."""

DRIFT = 1e-4
"""Maximum rate at which the display server's clock may lose time against ours (s per s)."""

ANOTHER = 600.0
"""Difference between two stamps' ages from which they are by different clocks, in seconds."""

_WRAP = 1 << 32
"""The display server's clock counts milliseconds in 32 bits."""


class InputClock:
    """
    How old an input is, by the stamp that the display server gave it.

    The server's clock has an epoch of its own. The smallest difference seen between our clock and
    a stamp is the one of the input that came fastest: what differs by more has waited. The
    smallest difference may grow by ``DRIFT``, since the server may be another machine.

    Some inputs are made by the toolkit, with an epoch of its own; and a server's clock may jump,
    as after a suspend. What differs by more than ``ANOTHER`` is by another clock.
    """

    def __init__(self) -> None:
        self._clocks: list[tuple[float, float]] = []  # smallest difference (ms), seen when (s)

    def age(self, stamp: int, now: float) -> float:
        """
        Return for how long an input has waited, in seconds.

        :param stamp: when it was made (ms, modulo 2**32); 0: the server does not say.
        :param now: our clock, which stands still while the machine is suspended, in seconds.
        """
        if not stamp:
            return 0.0
        difference = (now * 1000 - stamp) % _WRAP
        for place, (smallest, seen_at) in enumerate(self._clocks):
            allowed = smallest + (now - seen_at) * 1000 * DRIFT
            waited = (difference - allowed + _WRAP / 2) % _WRAP - _WRAP / 2
            if abs(waited) < ANOTHER * 1000:
                if waited <= 0:
                    self._clocks[place] = (difference, now)
                return max(0.0, waited) / 1000
        self._clocks = [*self._clocks[-3:], (difference, now)]
        return 0.0


class Beat:
    """
    Whether the window's thread was held up.

    :param period: how often ``beat`` is called while it is not, in seconds.
    """

    def __init__(self, period: float, now: float) -> None:
        self._period = period
        self._last = now
        self._late = 0.0
        self._until = now

    def beat(self, now: float) -> None:
        """Take that the thread is alive."""
        self._look(now)
        # Twice in time: what waited in the queue has been taken by then.
        if now >= self._until and now - self._last < self._period + SETTLE:
            self._late = 0.0
        self._last = now

    def held_up(self, now: float) -> float:
        """Return for how long the thread was held up just now, in seconds; 0.0 if it was not."""
        self._look(now)
        return self._late

    def _look(self, now: float) -> None:
        late = now - self._last - self._period
        if late >= STALE:
            self._late = max(self._late, late)
            self._until = now + SETTLE


class Repeats:
    """Keys that are pressed twice in a row, as in a double click."""

    def __init__(self) -> None:
        self._name = ''
        self._at = 0.0

    def same_press(self, name: str, at: float) -> bool:
        """Take a key and when it was pressed; return whether it was pressed just before."""
        same = name == self._name and at - self._at < AGAIN
        self._name, self._at = name, at
        return same


class Aim(Generic[T]):
    """What the official who presses now had in front of them, when what is shown has changed."""

    def __init__(self) -> None:
        self._shown: list[tuple[T, float]] = []

    def change(self, before: T, at: float) -> None:
        """Take what was shown until a time (s)."""
        self._shown = [*self._shown[-9:], (before, at)]

    def seen(self, at: float) -> T | None:
        """Return what was shown ``AIM`` before a press (s); None: what is shown now."""
        return next((shown for shown, until in self._shown if until > at - AIM), None)
