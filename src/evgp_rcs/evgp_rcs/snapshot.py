# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What officials see of the race, as plain data: the kart server makes it, all others show it.

Pure.
"""

from __future__ import annotations

from operator import attrgetter
from typing import NamedTuple

from evgp_protocol.states import RaceState
from evgp_rcs.catalogue import CATALOGUE, CommandKind
from evgp_rcs.laps import Format, Judged, KartResult
from evgp_rcs.link_quality import LinkQuality, POOR_LATELY
from evgp_rcs.race import Alert, Attendance, Heat, Kart, Race, Starts, TrackAccess

Offer = tuple[CommandKind, int, str, str, tuple[int, ...], float | None]
"""The fields of an ``Availability``, as a plain tuple: packing takes a tenth of the time, and a
hundred karts have 700 of them."""

_OFFERED = tuple(kind for kind, entry in CATALOGUE.items() if not entry.of_laps)
_TO_ONE_KART = tuple(kind for kind in _OFFERED if CATALOGUE[kind].to_one_kart)
_TO_ALL = tuple(kind for kind in _OFFERED if not CATALOGUE[kind].to_one_kart)


class KartSnapshot(NamedTuple):
    """
    One kart; the meanings are those of ``Kart``.

    :param poor_lately: its link was poor in the last ``POOR_LATELY``.
    :param laps: of the race that was started last; ``last_lap_done``: it has all of them, and no
        place.
    """

    number: int
    team: str
    in_race: bool
    connected: bool
    sent: RaceState
    sent_since: float
    acknowledged: bool
    reported: RaceState | None
    counts_at: float | None
    hold: RaceState | None
    hold_reason: str
    may_be_moving: bool
    settles_at: float | None
    place: int
    finish_due: float | None
    inspected: str
    ordered_at: float
    delivered_at: float | None
    acknowledged_at: float | None
    link: LinkQuality | None
    poor_lately: bool
    laps: int
    last_lap: float | None
    best_lap: float | None
    last_lap_done: bool
    commands: list[Offer]


class Standings(NamedTuple):
    """
    The results of the race that was started last; the meanings are those of ``Laps``.

    :param overall: the best result of each kart in all heats of this format.
    :param passings: the last ones; ``older``: how many came before.
    """

    at: float
    heat: str
    format: Format  # noqa: A003 - the field's name
    wanted: int
    grid: tuple[int, ...]
    results: tuple[KartResult, ...]
    overall: tuple[KartResult, ...]
    passings: list[Judged]
    older: int


class Snapshot(NamedTuple):
    """
    The race at one time; the meanings are those of ``Race``.

    :param at: the time, on the clock of the rules, in seconds.
    :param commands: the commands that are not to one kart.
    :param laps: how many the race that was started last has; 0: no number is set.
    """

    at: float
    state: RaceState
    state_since: float
    state_cause: str
    race_since: float | None
    over: bool
    karts: list[KartSnapshot]
    commands: list[Offer]
    track: TrackAccess
    alerts: list[Alert]
    laps: int
    heats: tuple[Heat, ...]
    starts: Starts
    there: Attendance


_OF_KART = attrgetter(*KartSnapshot._fields[:-6])

MOST_PASSINGS = 200
"""Maximum number of passings that the results show."""


def snapshot_of(race: Race, now: float) -> Snapshot:
    """Return what officials see of the race at this time, in seconds."""
    return Snapshot(
        now,
        race.state,
        race.state_since,
        race.state_cause,
        race.race_since,
        race.over,
        [
            KartSnapshot._make(
                (
                    *_OF_KART(kart),
                    kart.link_poor_at is not None and now - kart.link_poor_at < POOR_LATELY,
                    *_laps_of(race, kart),
                    [race.availability(kind, number, now)[:] for kind in _TO_ONE_KART],
                )
            )
            for number, kart in sorted(race.karts.items())
        ],
        [race.availability(kind, 0, now)[:] for kind in _TO_ALL],
        race.track_access(),
        race.alerts(now),
        race.laps.wanted,
        race.heats,
        race.order_of_start(),
        race.there,
    )


def _laps_of(race: Race, kart: Kart) -> tuple[int, float | None, float | None, bool]:
    times = race.laps.lap_times(kart.number)
    if not times:
        return 0, None, None, False
    drives = race.state is RaceState.GREEN_GREEN and kart.in_race and kart.hold is None
    done = drives and not kart.place and race.laps.is_done(kart.number)
    return len(times), times[-1], min(times), done


def standings_of(race: Race, now: float) -> Standings:
    """Return the results at this time, in seconds."""
    laps = race.laps
    passings = laps.last_passings(MOST_PASSINGS)
    older = len(laps.crossings) - len(passings)
    found = laps.grid, laps.results, laps.standings(laps.format)
    return Standings(now, laps.heat, laps.format, laps.wanted, *found, passings, older)
