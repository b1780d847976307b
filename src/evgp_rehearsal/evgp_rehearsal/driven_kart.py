# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
