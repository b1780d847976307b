"""A plain TCP kart that acknowledges what a simulated kart has reached."""

from __future__ import annotations

from collections.abc import Callable
import contextlib

from evgp_protocol.states import RaceState
from evgp_testing.judge import Judge
from evgp_testing.race_control import address_of
from evgp_testing.wire_kart import Acknowledges, WireKart


class DrivenKart(WireKart):
    """
    The connection of a simulated kart.

    :param hear: takes its number, and each state that it is sent and was not sent before, in the
        thread that reads.
    :param judge: is told what is seen on this connection.
    :raises OSError: if race control cannot be reached.
    """

    def __init__(
        self,
        number: int,
        port: int,
        hear: Callable[[int, RaceState], None],
        judge: Judge | None = None,
    ) -> None:
        """Connect."""
        self._hear = hear
        super().__init__(address_of(number), port, Acknowledges.NEVER, judge=judge, kart=number)

    def answer(self, state: RaceState, change: bool) -> None:
        """Hand on what is new; the simulated kart answers once it has carried it out."""
        if change:
            self._hear(self.kart, state)

    def acknowledge(self, state: RaceState) -> None:
        """Say what the simulated kart has reached."""
        with contextlib.suppress(OSError):  # it is gone: the reader is told next
            self.say(state)
