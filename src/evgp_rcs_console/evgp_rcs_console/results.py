# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Turns results into texts: a kart's position, the tables, and the passings. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
import shlex

from evgp_node.results import KartResult, lap_time, Mark, Standings
from evgp_rcs.words import time_of_day
from evgp_rcs_console import texts

_HEADINGS = ('', 'Kart', 'Team', 'Laps', 'Total', 'Last', 'Best', 'Status, penalties')


def position(results: Standings, number: int) -> str:
    """Return a kart's position, if it has one, and its laps; empty if it did not start."""
    kart = results.kart(number)
    if kart is None:
        return ''
    laps = f'{len(kart.lap_times)}/{results.laps}'.removesuffix('/0')
    return f'P{kart.place} {laps}' if kart.place else laps


def has_crossed(results: Standings, number: int) -> bool:
    kart = results.kart(number)
    seen = (each.kart for each in results.passings if each.mark is Mark.COUNTED)
    return (kart is not None and bool(kart.lap_times)) or number in seen


def _row(kart: KartResult, team: str) -> tuple[str, ...]:
    times = map(lap_time, (kart.total, kart.last, kart.best))
    place = f'{kart.place}.' if kart.place else ''
    return place, str(kart.kart), team, str(kart.laps), *times, '; '.join(kart.remarks)


def title(results: Standings) -> str:
    if not (results.karts or results.overall):
        return 'No results yet'
    said = results.heat or texts.RESULTS, results.about, 'published' * results.published
    return ', '.join(filter(None, said))


def table(results: Standings, teams: Mapping[int, str]) -> list[tuple[str, ...]]:
    """Return the results as rows with headings; the standings over all heats, if any, follow."""

    def rows(karts: Iterable[KartResult]) -> Iterator[tuple[str, ...]]:
        return (_row(kart, teams.get(kart.kart, '')) for kart in karts)

    headed = [_HEADINGS, *rows(results.karts)]
    if results.overall in ((), results.karts):
        return headed
    heading = [''] * len(_HEADINGS)
    heading[2] = f'All heats, {results.format}'
    return [*headed, tuple(heading), *rows(results.overall)]


def races(results: Standings) -> list[tuple[str, ...]]:
    """Return a row for each race of the event, which says whether the race counts."""
    return [
        (
            str(each.number),
            time_of_day(each.stamp),
            each.heat,
            f'{each.classified} classified',
            'counts' * each.counts,
        )
        for each in results.races
    ]


def passings(results: Standings) -> list[tuple[str, ...]]:
    return [
        (
            lap_time(each.at),
            f'KART {each.kart}' if each.kart else '?',
            shlex.join(map(str, each.passing.identity)),
            f'{each.mark.value}: {each.struck}' if each.struck else each.mark.value,
        )
        for each in results.passings
    ]
