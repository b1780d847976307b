# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The race of one kart from which the tests of the console make theirs."""

from __future__ import annotations

from evgp_rcs.catalogue import CommandKind
from evgp_rcs_console.snapshot import Available, Kart, Race, State, Track

EVERYTHING = {command: Available(True) for command in CommandKind}
"""Race control offers every command."""

KART = Kart(
    number=7,
    team='Purdue',
    in_race=True,
    connected=True,
    sent=State.GRID_ACTIVE,
    sent_for=40.0,
    acknowledged=False,
    reported=State.IN_GARAGE,
    hold=State.UNKNOWN,
    hold_reason='',
    may_be_moving=False,
    place=0,
    commands=EVERYTHING,
)
RACE = Race(
    state=State.GRID_ACTIVE,
    state_for=40.0,
    over=False,
    karts=(KART,),
    commands=EVERYTHING,
    track=Track(is_open=False, allowed=False, reason='the race is in GRID_ACTIVE', msr_used=False),
    alerts=(),
)
