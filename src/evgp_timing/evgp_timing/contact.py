# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A light beam or a switch at the line. It sees that a kart crosses, but not which kart."""

from __future__ import annotations

STUCK = 10.0
"""How long a kart may break the beam, in seconds. A beam broken for longer is stuck."""


class Contact:
    """
    A contact. It turns all interruptions of the beam by one kart into one crossing.

    :param debounce: how long the beam must have been free before a crossing, in seconds.
        With it, the wheels and gaps of one kart do not count as several crossings.
    """

    def __init__(self, debounce: float) -> None:
        self._debounce = debounce
        self._broken_at: float | None = None
        self._free_at = 0.0

    def look(self, broken: bool, now: float) -> bool:
        """
        Process the current state of the beam, and return whether a kart is crossing now.

        :param broken: whether the beam is broken.
        :param now: the time, in seconds. It never decreases.
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
