"""A plain kart that notes when each frame came."""

from __future__ import annotations

import itertools
import time

from evgp_protocol.frames import MalformedFrame, StateFrame
from evgp_testing.wire_kart import Acknowledges, WireKart


class PunctualKart(WireKart):
    """A plain kart that notes when each frame came; ``times`` are monotonic, s."""

    def __init__(
        self, address: str, port: int, acknowledges: Acknowledges, host: str = '127.0.0.1'
    ) -> None:
        """Connect."""
        self.times: list[float] = []
        super().__init__(address, port, acknowledges, host)

    def worst_gap(self, since: float) -> float:
        """Return the longest time between two frames since then, s."""
        times = [at for at in [*self.times, time.monotonic()] if at >= since]
        return max((late - early for early, late in itertools.pairwise(times)), default=0.0)

    def _hear(self, heard: StateFrame | MalformedFrame) -> None:
        self.times.append(time.monotonic())
        super()._hear(heard)
