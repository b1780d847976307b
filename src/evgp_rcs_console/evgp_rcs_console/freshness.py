# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Whether a key or a click still means what it meant when the official made it.

If the window's thread has hung, its queue contains everything pressed meanwhile. It must not act
on a key that was pressed 15 s ago as if it were new. Either of two signs shows an old input:

- the time stamp of the input, by the clock of the display server (``age``);
- the window's own beat: if it was late, the inputs in the queue have waited (``held_up``).

A press is also meant for what was on the screen when the official aimed (``Aim``).

Pure: stamps and times go in. The window decides whether an old input is a stop, which acts anyway.
"""

from __future__ import annotations

from typing import Generic, TypeVar

T = TypeVar('T')

STALE = 0.5
"""Maximum age of a key or click that acts, in seconds. Stops have no such limit."""

SETTLE = 0.3
"""Time after a hang during which inputs count as having waited, in seconds."""

SEEN = 0.3
"""Time a question must have been visible before a click on its YES counts, in seconds."""

AGAIN = 0.4
"""Time within which pressing the same key again is one press, as in a double click, in seconds."""

AIM = 0.5
"""Time an official needs to notice that their target on the screen has changed, in seconds."""

DRIFT = 1e-4
"""Maximum rate at which the display server's clock may lose time against ours, in s per s."""

ANOTHER = 600.0
"""Difference between two stamps' ages above which they come from different clocks, in seconds."""

_WRAP = 1 << 32
"""The display server's clock counts milliseconds in 32 bits."""


class InputClock:
    """
    Computes the age of an input from the stamp that the display server gave it.

    The server's clock has its own epoch. The smallest difference seen between our clock and a
    stamp belongs to the fastest input; an input with a larger difference has waited. The smallest
    difference may grow by ``DRIFT``, because the server may be another machine.

    The toolkit makes some inputs itself, with yet another epoch, and a server's clock may jump, as
    after a suspend. A stamp that differs by more than ``ANOTHER`` comes from another clock.
    """

    def __init__(self) -> None:
        self._clocks: list[tuple[float, float]] = []  # smallest difference (ms), seen when (s)

    def age(self, stamp: int, now: float) -> float:
        """
        Return how long an input has waited, in seconds.

        :param stamp: when it was made (ms, modulo 2**32); 0: the server does not say.
        :param now: our clock, which stops while the machine is suspended, in seconds.
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
    Detects that the window's thread hung.

    :param period: normal time between two calls of ``beat``, in seconds.
    """

    def __init__(self, period: float, now: float) -> None:
        self._period = period
        self._last = now
        self._late = 0.0
        self._until = now

    def beat(self, now: float) -> None:
        """Record that the thread is alive."""
        self._look(now)
        # After two beats in time, everything that waited in the queue has been handled.
        if now >= self._until and now - self._last < self._period + SETTLE:
            self._late = 0.0
        self._last = now

    def held_up(self, now: float) -> float:
        """Return how long the thread has just hung, in seconds; 0.0 if it has not."""
        self._look(now)
        return self._late

    def _look(self, now: float) -> None:
        late = now - self._last - self._period
        if late >= STALE:
            self._late = max(self._late, late)
            self._until = now + SETTLE


class Repeats:
    """Detects keys that are pressed twice in a row, as in a double click."""

    def __init__(self) -> None:
        self._name = ''
        self._at = 0.0

    def same_press(self, name: str, at: float) -> bool:
        """Record a key press (time in s); return whether it repeats the one just before."""
        same = name == self._name and at - self._at < AGAIN
        self._name, self._at = name, at
        return same


class Aim(Generic[T]):
    """Remembers what the official saw before the screen changed under their hand."""

    def __init__(self) -> None:
        self._shown: list[tuple[T, float]] = []

    def change(self, before: T, at: float) -> None:
        """Record what was shown until a time (s)."""
        self._shown = [*self._shown[-9:], (before, at)]

    def seen(self, at: float) -> T | None:
        """Return what was shown ``AIM`` before a press (s); None: what is shown now."""
        return next((shown for shown, until in self._shown if until > at - AIM), None)
