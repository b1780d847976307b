# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A race control that the tests of a file share: each begins in the garage, without a kart."""

from __future__ import annotations

from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_testing.official import Official
from evgp_testing.race_control import RaceControl


class Desk:
    """Race control with kart 1 in the race and kart 2 outside it, and its official."""

    def __init__(self, control: RaceControl, official: Official) -> None:
        self.control, self.official = control, official

    def clear(self) -> None:
        """Have a race in the garage without a hold, whatever the test before has left."""
        for number in (1, 2):
            self.official.wait_for_kart(number, lambda kart: not kart.connected, 'away')
        self.official.command('record_msr')
        self.official.command('in_garage', track_safe=True)
        race = self.official.wait_for_race(
            lambda race: state_of(race.state) is RaceState.IN_GARAGE, 'the race in the garage'
        )
        for kart in race.karts:
            if state_of(kart.hold) is not None:
                self.official.command('kart/in_garage', kart=kart.number, made_safe_by_hand=True)
