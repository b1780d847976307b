# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A race control that the tests of a file share: each begins in the garage, without a kart."""

from __future__ import annotations

from collections.abc import Collection, Mapping
import pathlib
from typing import Any

from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_testing.wire_race import WireRace


class Desk(WireRace):
    """Race control and its official, with no kart. For the parameters, see ``WireRace``."""

    def __init__(
        self,
        folder: pathlib.Path,
        racing: Collection[int],
        others: Collection[int] = (),
        parameters: Mapping[str, object] | None = None,
        **more: Any,
    ) -> None:
        super().__init__(folder, racing, others, (*racing, *others), parameters, **more)

    def clear(self, *racing: int) -> None:
        """
        Have a race in the garage without a hold, whatever the test before has left.

        :param racing: the karts in the race, if not those of the beginning.
        """
        official, racing = self.official, racing or self.racing
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
