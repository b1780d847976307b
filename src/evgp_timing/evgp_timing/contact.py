# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A light beam or switch at the line. It detects that a kart crosses, but not which kart."""

from __future__ import annotations

STUCK = 10.0
"""Time after which a broken beam counts as stuck, in seconds. No kart breaks it for so long."""


class Contact:
    """
    A contact, which merges all interruptions of the beam by one kart into one crossing.

    :param debounce: minimum time for which the beam must be free before the next crossing, in
        seconds. Without it, each wheel of a kart could count as a crossing.
    """

    def __init__(self, debounce: float) -> None:
        self._debounce = debounce
        self._broken_at: float | None = None
        self._free_at = 0.0
        self._was_broken = False

    def look(self, broken: bool, now: float) -> bool:
        """
        Process a reading of the beam, and return whether a new crossing begins.

        :param now: the time, in seconds, which never decreases.
        """
        if self._broken_at is None:
            self._broken_at = self._free_at = now
        # A beam that was broken the last time may have stayed so, however long ago that was.
        crosses = not self._was_broken and broken and now - self._broken_at >= self._debounce
        self._was_broken = broken
        if broken:
            self._broken_at = now
        else:
            self._free_at = now
        return crosses

    def is_stuck(self, now: float) -> bool:
        """Return whether the beam has been broken for too long."""
        return self._broken_at is not None and now - self._free_at >= STUCK
