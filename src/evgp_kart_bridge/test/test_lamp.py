# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The lamp on a kart, by what the kart obeys and when."""

from evgp_kart_bridge.lamp import BLUE, Colour, DARK, lamp, PHASE, YELLOW
from evgp_protocol.states import RaceState
import pytest


@pytest.mark.parametrize(
    ('state', 'before', 'after'),
    [
        (RaceState.IN_GARAGE, (DARK, DARK), (DARK, DARK)),
        (RaceState.GRID_ACTIVE, (YELLOW, YELLOW), (YELLOW, YELLOW)),
        (RaceState.GREEN_GREEN, (YELLOW, DARK), (YELLOW, DARK)),
        (RaceState.RED_FLAG, (YELLOW, DARK), (BLUE, BLUE)),
        (RaceState.RED_RED, (BLUE, DARK), (BLUE, DARK)),
    ],
)
def test_the_lamp_says_finished_only_on_the_word_that_the_kart_stands(
    state: RaceState, before: tuple[Colour, Colour], after: tuple[Colour, Colour]
) -> None:
    shown = [tuple(lamp(state, said, PHASE * at) for at in (2.5, 1.5)) for said in (False, True)]
    assert shown == [before, after]
