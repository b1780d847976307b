# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A light beam or a switch at the line: it sees when a kart crosses, but not which one."""

from __future__ import annotations

STUCK = 10.0
"""Time after which a broken beam counts as stuck rather than as a kart, seconds."""


class Contact:
    """
    Turns all interruptions of a beam by one kart into one crossing.

    :param debounce: time the beam must have been free before a crossing, seconds, so that wheels
        and gaps of one kart do not count again.
    """

    def __init__(self, debounce: float) -> None:
        self._debounce = debounce
        self._broken_at: float | None = None
        self._free_at = 0.0

    def look(self, broken: bool, now: float) -> bool:
        """Return whether a kart crosses now; `now` is in seconds and never decreases."""
        if self._broken_at is None:
            self._broken_at = self._free_at = now
        crosses = broken and now - self._broken_at >= self._debounce
        if broken:
            self._broken_at = now
        else:
            self._free_at = now
        return crosses

    def is_stuck(self, now: float) -> bool:
        """Return whether the beam has been broken for too long."""
        return self._broken_at is not None and now - self._free_at >= STUCK
