# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""``rcs_record laps``: laps, times, places and penalties of each race, as CSV or JSON."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
import json
from typing import Any, NamedTuple

from evgp_rcs.record.report.model import Account, standing, with_late_penalties
from evgp_rcs.record.report.results import as_csv, defused, put, runs_of, table_options
from evgp_rcs.rules.laps import Format, Laps, overall


def options() -> argparse.ArgumentParser:
    """Return what reads the command line of `rcs_record laps`."""
    parser = table_options(
        'laps',
        'Write the laps of each race: places, times, penalties. The rules count them '
        'again from the passings in the record, with the corrections of officials.',
        'The column overall is the place among all races of that format that are written: '
        'in a time trial of one kart after the other, that is the result. Of a kart with several '
        'results, only the best has one.',
    )
    parser.add_argument('--json', action='store_true', help='JSON; otherwise CSV')
    return parser


def main(arguments: Sequence[str]) -> int:
    """
    Write the laps of runs.

    :return: the exit code.
    :raises UnreadableError: if the record or the run cannot be read.
    """
    wanted = options().parse_args(arguments)
    accounts, code = runs_of(wanted)
    races: list[Raced] = []
    for run in accounts:
        for number, each in run.laps.items():
            if each.is_recalled and races and _is_same(races[-1].laps, each):
                races.pop()
            races.append(Raced(run, number, each))
        last = next(reversed(run.laps.values()), None)
        if last is not None:
            races = [each._replace(laps=with_late_penalties(each.laps, last)) for each in races]
    rows = [row for each in races for row in _rows(*each)]
    _place_overall(rows, standing([each.laps for each in races]))
    text = json.dumps(rows, indent=1) + '\n'
    if not wanted.json:
        text = as_csv(COLUMNS, ([_cell(row[name]) for name in COLUMNS] for row in rows))
    return put(text, wanted.output, f'{len(rows)} results of {len(accounts)} runs', code)


class Raced(NamedTuple):
    """A race of a run, by its number there, with its laps."""

    run: Account
    number: int
    laps: Laps


def _is_same(laps: Laps, recalled: Laps) -> bool:
    """Return whether a race was taken up that the run before had."""
    return (laps.heat, set(laps.karts)) == (recalled.heat, set(recalled.karts))


def _rows(run: Account, number: int, laps: Laps) -> Iterator[dict[str, Any]]:
    teams = run.teams
    for result in laps.results:
        yield {
            'run': run.kept.run.number,
            'race': number,
            'heat': laps.heat,
            'format': laps.format.value,
            'grid': laps.grid.index(result.kart) + 1 if result.kart in laps.grid else 0,
            'place': result.place,
            'overall': 0,
            'kart': result.kart,
            'team': teams.get(result.kart, ''),
            'status': result.status.name,
            'laps': result.laps,
            'total': _ms(result.total),
            'best': _ms(result.best),
            'lap_times': [_ms(each) for each in result.lap_times],
            'penalties': [f'{each} ({each.official})' for each in result.penalties],
            'of': laps,
            'result': result,
        }


def _place_overall(rows: list[dict[str, Any]], races: list[Laps]) -> None:
    """Give the best result of each kart in these races its place among all of its format."""
    for format_ in Format:
        counts = [row for row in rows if any(row['of'] is each for each in races)]
        own = [row for row in counts if row['format'] == format_.value]
        for best in overall(format_, [row['result'] for row in own]):
            same = (row for row in own if row['result']._replace(place=best.place) == best)
            next(same)['overall'] = best.place
    for row in rows:
        del row['result'], row['of']


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds, 3)


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f'{value:.3f}'
    if isinstance(value, list):
        separator = '; ' if value and isinstance(value[0], str) else ' '
        return defused(separator.join(_cell(each) for each in value))
    return defused(str(value)) if isinstance(value, str) else str(value or '')


COLUMNS = (
    'run',
    'race',
    'heat',
    'format',
    'grid',
    'place',
    'overall',
    'kart',
    'team',
    'status',
    'laps',
    'total',
    'best',
    'lap_times',
    'penalties',
)
"""The columns of the CSV; what each means is in docs/record.md."""
