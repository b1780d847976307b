# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Finds out whether a key or a click still means what it meant when the official made it.

If the window's thread hangs, everything that is pressed meanwhile waits in its queue. A key that
was pressed 15 s ago must not act as if it were new. Two signs show that an input is old:

- its time stamp, on the display server's clock (``InputClock``);
- the window's own beat: if it was late, the inputs in the queue have waited (``Beat``).

A press is meant for what was on the screen when the official aimed (``Aim``).

Pure: stamps and times go in. The caller lets stops act however old they are.
"""

from __future__ import annotations

from typing import Generic, TypeVar

T = TypeVar('T')

STALE = 0.5
"""Age from which a key or click no longer acts, in seconds. Stops act at any age."""

SETTLE = 0.3
"""Minimum time after a hang for which inputs still count as having waited, in seconds."""

SEEN = 0.3
"""Time for which a question must be open before a click on its YES counts, in seconds."""

AGAIN = 0.4
"""Time within which two presses of the same key in a row count as one, in seconds."""

AIM = 0.5
"""Time that an official needs to notice that the target has changed, in seconds."""

DRIFT = 1e-4
"""Maximum rate at which the display server's clock loses time against ours, in s per s."""

ANOTHER = 600.0
"""Difference in age from which two stamps come from different clocks, in seconds."""

_WRAP = 1 << 32
"""The display server's clock counts milliseconds in 32 bits."""


class InputClock:
    """
    Computes the age of an input from the stamp that the display server gave it.

    The server's clock has its own epoch. The smallest difference seen between our clock and a
    stamp belongs to the input that arrived fastest; an input with a larger difference has waited.
    The smallest difference may grow by ``DRIFT``, because the server may be on another machine.

    The toolkit makes some inputs itself, by a clock with yet another epoch. The server's clock may
    also jump, for example after a suspend. A stamp that differs by ``ANOTHER`` or more therefore
    counts as one from another clock.
    """

    def __init__(self) -> None:
        self._clocks: list[tuple[float, float]] = []  # smallest difference (ms), seen when (s)

    def age(self, stamp: int, now: float) -> float:
        """
        Return how long an input has waited, in seconds.

        :param stamp: the time at which it was made (ms, modulo 2**32); 0 if it is not known.
        :param now: the time by our clock, which stops while the machine is suspended, in seconds.
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
    Detects that the thread of the window has hung.

    :param period: normal time between two calls of ``beat``, in seconds.
    """

    def __init__(self, period: float, now: float) -> None:
        self._period = period
        self._last = now
        self._late = 0.0
        self._until = now

    def beat(self, now: float) -> None:
        self._look(now)
        # Once two beats in a row are in time, everything that had waited has been handled.
        if now >= self._until and now - self._last < self._period + SETTLE:
            self._late = 0.0
        self._last = now

    def held_up(self, now: float) -> float:
        """Return for how long the thread has just hung, in seconds; 0.0 if it has not."""
        self._look(now)
        return self._late

    def _look(self, now: float) -> None:
        late = now - self._last - self._period
        if late >= STALE:
            self._late = max(self._late, late)
            self._until = now + SETTLE


class Aim(Generic[T]):
    """Remembers what the official saw before the screen changed."""

    def __init__(self) -> None:
        self._shown: list[tuple[T, float]] = []

    def change(self, before: T, at: float) -> None:
        """Record what was shown until a time (s)."""
        self._shown = [*self._shown[-9:], (before, at)]

    def seen(self, at: float) -> T | None:
        """Return what was shown ``AIM`` before a press (time in s); None: it is still shown."""
        return next((shown for shown, until in self._shown if until > at - AIM), None)
