# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Results as texts: what a row shows of them, the table, and the passings. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from evgp_node.results import Judged, KartResult, Mark, Standings, Status
from evgp_rcs.words import lap_time
from evgp_rcs_console import texts

STATUS = {
    Status.RUNNING: '',
    Status.CLASSIFIED: 'classified',
    Status.DNF: 'did not finish',
    Status.NOT_CLASSIFIED: 'no lap',
    Status.DISQUALIFIED: 'disqualified',
}


def position(results: Standings, number: int) -> str:
    """Return the position of a kart; empty: it has none."""
    kart = results.kart(number)
    return f'P{kart.place}' if kart is not None and kart.place else ''


def progress(results: Standings, number: int) -> str:
    """Return the lap of a kart, and how far it is behind the first one; empty: no lap yet."""
    kart = results.kart(number)
    if kart is None or not kart.lap_times:
        return ''
    text = f'lap {len(kart.lap_times)}' + (f'/{results.laps}' if results.laps else '')
    first = results.karts[0]
    if kart is first or kart.total is None or first.total is None:
        return text
    behind = first.laps - kart.laps
    gap = (
        f'{kart.total - first.total:.1f} s' if not behind else f'{behind} lap{"s" * (behind > 1)}'
    )
    return f'{text} +{gap}'


@dataclass(frozen=True)
class ResultColumn:
    """
    A column of the results.

    :param width: in pixels on a 1366 by 768 screen; 0: the width that the others leave.
    :param cell: what it shows of a kart and its team.
    """

    heading: str
    width: int
    cell: Callable[[KartResult, str], str]


RESULT_COLUMNS = (
    ResultColumn('', 28, lambda kart, team: f'{kart.place}.' if kart.place else ''),
    ResultColumn('Kart', 40, lambda kart, team: str(kart.kart)),
    ResultColumn('Team', 0, lambda kart, team: team),
    ResultColumn('Laps', 36, lambda kart, team: str(kart.laps)),
    ResultColumn('Total', 74, lambda kart, team: lap_time(kart.total)),
    ResultColumn('Last', 66, lambda kart, team: lap_time(next(iter(kart.lap_times[-1:]), None))),
    ResultColumn('Best', 66, lambda kart, team: lap_time(kart.best)),
    ResultColumn('Status, penalties', 150, lambda kart, team: '; '.join(_notes(kart))),
)


def _notes(kart: KartResult) -> list[str]:
    return [*filter(None, [STATUS[kart.status]]), *map(str, kart.penalties)]


def title(results: Standings) -> str:
    """Return what the results are of."""
    if not (results.karts or results.overall):
        return texts.NO_RESULTS
    laps = texts.RESULTS_LAPS.format(count=results.laps) if results.laps else ''
    return ', '.join(
        filter(
            None,
            (results.heat or texts.RESULTS_TITLE, results.format.value.replace('_', ' '), laps),
        )
    )


def table(results: Standings, teams: Mapping[int, str]) -> list[tuple[str, ...]]:
    """
    Return the table, a row for each kart, best first; then those of all heats of its format.

    :param teams: the team of each kart of the roster.
    """

    def rows(karts: Iterable[KartResult]) -> list[tuple[str, ...]]:
        return [
            tuple(column.cell(kart, teams.get(kart.kart, '')) for column in RESULT_COLUMNS)
            for kart in karts
        ]

    if results.overall in ((), results.karts):
        return rows(results.karts)
    heading = [''] * len(RESULT_COLUMNS)
    heading[2] = texts.ALL_HEATS.format(format=results.format.value.replace('_', ' '))
    return [*rows(results.karts), tuple(heading), *rows(results.overall)]


def crossing(judged: Judged) -> tuple[str, str, str, str]:
    """Return when a passing was, whose it is, who saw it, and what became of it."""
    passing = judged.passing
    kart = texts.FIELD_KART.format(number=judged.kart) if judged.kart else '?'
    seen = f'{passing.identity} {passing.transponder}'.rstrip()
    mark = f'{judged.mark.value}: {judged.struck}' if judged.struck else judged.mark.value
    return lap_time(judged.at), kart, seen, mark


def is_struck(judged: Judged) -> bool:
    """Return whether an official struck a passing out."""
    return judged.mark is Mark.STRUCK
