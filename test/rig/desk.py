# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A race control that the tests of a file share: each begins in the garage, without a kart."""

from __future__ import annotations

from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_testing.official import Official
from evgp_testing.race_control import RaceControl


class Desk:
    """
    Race control, and its official.

    :param racing: the karts in the race at the beginning of each test.
    """

    def __init__(
        self, control: RaceControl, official: Official, racing: tuple[int, ...] = (1,)
    ) -> None:
        self.control, self.official, self._racing = control, official, racing

    def clear(self, *racing: int) -> None:
        """
        Have a race in the garage without a hold, whatever the test before has left.

        :param racing: the karts in the race, if not the usual ones.
        """
        official, racing = self.official, racing or self._racing
        official.wait_for_race(
            lambda race: not any(kart.connected for kart in race.karts), 'every kart away'
        )
        official.command('record_msr')
        official.command('in_garage', track_safe=True)
        race = official.wait_for_race(
            lambda race: state_of(race.state) is RaceState.IN_GARAGE, 'the race in the garage'
        )
        for kart in race.karts:
            if state_of(kart.hold) is not None:
                official.command('kart/in_garage', kart=kart.number, made_safe_by_hand=True)
            if kart.in_race is not (kart.number in racing):
                official.command('set_in_race', kart=kart.number, in_race=not kart.in_race)
        if race.track.open:
            official.command('set_track_open', open=False)
