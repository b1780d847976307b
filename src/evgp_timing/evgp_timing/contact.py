# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A light beam or a switch at the line, which detects that a kart crosses, but not which one."""

from __future__ import annotations

STUCK = 10.0
"""Time after which a broken beam is stuck, in seconds, because no kart needs that long."""


class Contact:
    """
    A contact, which merges all interruptions of the beam by one kart into one crossing.

    :param debounce: minimum time for which the beam must be free before the next crossing, in
        seconds, so that the wheels and gaps of one kart do not count as several crossings.
    """

    def __init__(self, debounce: float) -> None:
        self._debounce = debounce
        self._broken_at: float | None = None
        self._free_at = 0.0

    def look(self, broken: bool, now: float) -> bool:
        """
        Process whether the beam is broken, and return whether a new crossing begins.

        :param now: the time, in seconds, which never decreases.
        """
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
