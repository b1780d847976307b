# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""``rcs_record laps``: laps, times, places and penalties of each race, as CSV or JSON."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
import csv
import io
import json
import pathlib
from typing import Any, get_args

from evgp_rcs.inputs import entries_of, feed, Input, InputsError, Recovered
from evgp_rcs.laps import Format, Laps, overall
from evgp_rcs.plain import plain
from evgp_rcs.replay import Kept
from evgp_rcs.report.results import defused
from evgp_rcs.runs import add_run_arguments, FAILED, open_runs, PARTLY, say

_INPUTS = get_args(Input)


def options() -> argparse.ArgumentParser:
    """Return what reads the command line of `rcs_record laps`."""
    parser = argparse.ArgumentParser(
        prog='rcs_record laps',
        description='Write the laps of each race: places, times, penalties. The rules count them '
        'again from the passings in the record, with the corrections of officials. Without --run '
        'or --all, these are the races of all runs of the day of the newest run.',
        epilog='The column overall is the place among all races of that format that are written: '
        'in a time trial of one kart after the other, that is the result. Of a kart with several '
        'results, only the best has one. The columns are explained in docs/record.md.',
    )
    add_run_arguments(parser)
    parser.add_argument('--all', action='store_true', help='the races of every run in the record')
    parser.add_argument('--json', action='store_true', help='JSON; otherwise CSV')
    parser.add_argument(
        '-o',
        '--output',
        type=pathlib.Path,
        metavar='FILE',
        help='write this file; otherwise the laps are printed',
    )
    return parser


def main(arguments: Sequence[str]) -> int:
    """
    Write the laps of runs.

    :return: the exit code.
    :raises UnreadableError: if the record or the run cannot be read.
    """
    wanted = options().parse_args(arguments)
    with open_runs(wanted.file) as runs:
        newest = runs.choose(wanted.run)
        chosen = [newest] if wanted.run is not None else runs.day_of(newest)
        if wanted.all:
            chosen = runs.listed
        kept = [Kept.read(runs, run) for run in chosen]
    rows: list[dict[str, Any]] = []
    code = runs.code
    for each in kept:
        laps, lacks = counted(each)
        for recalled in filter(lambda laps: laps.is_recalled, laps.values()):
            rows = _without(recalled, rows)
        rows += _rows(each, laps)
        if lacks:
            say(f'of run {each.run.number} not all can be read: {lacks}')
            code = PARTLY
    _place_overall(rows)
    text = json.dumps(rows, indent=1) + '\n' if wanted.json else _csv(rows)
    if wanted.output is None:
        print(text, end='')
        return code
    try:
        wanted.output.write_text(text, encoding='utf-8', newline='')
    except OSError as error:
        say(f'{wanted.output} cannot be written: {error.strerror}')
        return FAILED
    print(f'{plain(str(wanted.output))}: {len(rows)} results of {len(kept)} runs')
    return code


def counted(kept: Kept) -> tuple[dict[int, Laps], str]:
    """
    Return the laps of each race of a run, by its number, as they stood at last.

    And why some are missing, as the rest of a sentence; empty: none is.
    """
    if kept.setup is None:
        return {}, kept.lacks
    race = kept.setup.race()
    laps: dict[int, Laps] = {}
    known: Laps | None = None
    try:
        for entry in entries_of(kept.blocks):
            if isinstance(entry, _INPUTS):
                feed(entry, race)
            if isinstance(entry, Recovered) and entry.memory is not None and entry.memory.final:
                known = race.laps  # that race was over, and its own run has it
            if race.laps is not None and race.laps is not known:
                laps[race.grids] = race.laps
    except InputsError as error:
        return laps, str(error)
    except Exception as error:  # noqa: BLE001 - other rules may have recorded the inputs
        return laps, f'the rules cannot run on it ({error!r})'
    return laps, ''


def _without(recalled: Laps, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows without those of the same race, if it is the last one."""
    if not rows:
        return rows
    last = [(row['run'], row['race']) == (rows[-1]['run'], rows[-1]['race']) for row in rows]
    same = {row['kart'] for row, is_last in zip(rows, last, strict=True) if is_last}
    if same != set(recalled.karts) or rows[-1]['heat'] != recalled.heat:
        return rows
    return [row for row, is_last in zip(rows, last, strict=True) if not is_last]


def _rows(kept: Kept, counts: Mapping[int, Laps]) -> Iterator[dict[str, Any]]:
    teams = {} if kept.setup is None else {kart.number: kart.team for kart in kept.setup.karts}
    for number, laps in counts.items():
        for result in laps.results:
            yield {
                'run': kept.run.number,
                'race': number,
                'heat': laps.heat,
                'format': laps.format.value,
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
                'result': result,
            }


def _place_overall(rows: list[dict[str, Any]]) -> None:
    """Give the best result of each kart its place among all of its format."""
    for format_ in Format:
        own = [row for row in rows if row['format'] == format_.value]
        for best in overall(format_, [row['result'] for row in own]):
            same = (row for row in own if row['result']._replace(place=best.place) == best)
            next(same)['overall'] = best.place
    for row in rows:
        del row['result']


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds, 3)


def _csv(rows: list[dict[str, Any]]) -> str:
    stream = io.StringIO()
    table = csv.writer(stream, lineterminator='\n')
    table.writerow(COLUMNS)
    for row in rows:
        table.writerow([_cell(row[name]) for name in COLUMNS])
    return stream.getvalue()


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
