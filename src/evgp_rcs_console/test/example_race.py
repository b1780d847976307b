# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The race of one kart from which the tests of the console make theirs."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import Availability, Event, EventKind, Kart, Race, TrackAccess
from evgp_rcs.rules.snapshot import NOTHING, Snapshot, snapshot_of
from evgp_rcs_console.view import Danger, Latest

_Value = TypeVar('_Value')


def replace(value: _Value, **changes: Any) -> _Value:
    """Return a named tuple or a dataclass with other fields."""
    changed: _Value = getattr(value, '_replace', dataclasses.replace)(
        *([] if hasattr(value, '_replace') else [value]), **changes
    )
    return changed


def offers(*others: Availability) -> tuple[Availability, ...]:
    """Return the availability of every command: as passed, or else available."""
    by_kind = {each: Availability(each, True) for each in CommandKind}
    return tuple((by_kind | {each.command: each for each in others}).values())


EVERYTHING = offers()

KART = (
    snapshot_of(Race([Kart(7, 'Purdue', True)]), 0.0)
    .karts[0]
    ._replace(
        connected=True,
        sent=RaceState.GRID_ACTIVE,
        reported=RaceState.IN_GARAGE,
        commands=EVERYTHING,
    )
)
RACE = NOTHING._replace(
    stamp=40.0,
    state=RaceState.GRID_ACTIVE,
    karts=(KART,),
    commands=EVERYTHING,
    track=TrackAccess(False, False, 'the race is in GRID_ACTIVE', False),
)


def warning(
    race: Snapshot,
    two: bool = False,
    silent_for: float = 0.0,
    ended: bool | None = None,
    then: Snapshot | None = None,
) -> Danger:
    """
    Return the warning of a screen that heard this race, and then nothing for some time (s).

    :param ended: whether race control said that it ends in order; None: it said nothing.
    :param then: what came last.
    """
    latest = Latest(began=0.0, looking='here')
    latest.take_race(race, 0.0, two)
    if ended is not None:
        latest.take_event(Event(EventKind.ENDED, 'it ends', success=ended))
    if then is not None:
        latest.take_race(then, 0.0, False)
    return latest.danger(silent_for)
