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

"""``rcs_record results``: who finished when, and who did not and why, as a table."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
import csv
import pathlib
import sys
from typing import TextIO
import unicodedata

from evgp_rcs.plain import plain
from evgp_rcs.replay import Kept
from evgp_rcs.report import wording
from evgp_rcs.report.model import Account, RaceAccount, Result
from evgp_rcs.report.wording import Clock
from evgp_rcs.runs import add_run_arguments, FAILED, open_runs, say

COLUMNS = (
    'run',
    'race',
    'heat',
    'place',
    'kart',
    'team',
    'seconds',
    'started',
    'finished',
    'result',
    'reason',
    'event',
    'complete',
)
"""The columns; what each means is in docs/record.md."""

FORMULA = '=+-@\t\r\n'
"""With what a cell begins that a spreadsheet may run."""


def options() -> argparse.ArgumentParser:
    """Return what reads the command line of `rcs_record results`."""
    parser = argparse.ArgumentParser(
        prog='rcs_record results',
        description='Write the results of each race as CSV: the order, the time from GREEN_GREEN '
        'to the finish, who did not finish and why. A race that is under way is in it as it '
        'stands. Without --run or --all, these are the races of all runs of the day of the newest '
        'run.',
        epilog='Results are not replayed; rcs_record replay does that, and rcs_record report. A '
        'cell of others, such as the name of a team, that a spreadsheet would run as a formula '
        'gets an apostrophe in front. The columns are explained in docs/record.md.',
    )
    add_run_arguments(parser)
    parser.add_argument('--all', action='store_true', help='the races of every run in the record')
    parser.add_argument(
        '-o',
        '--output',
        type=pathlib.Path,
        metavar='FILE',
        help='write this file; otherwise the results are printed',
    )
    return parser


def main(arguments: Sequence[str]) -> int:
    """
    Write the results of a run as CSV.

    :return: the exit code.
    :raises UnreadableError: if the record or the run cannot be read.
    """
    wanted = options().parse_args(arguments)
    with open_runs(wanted.file) as runs:
        newest = runs.choose(wanted.run)
        chosen = [newest] if wanted.run is not None else runs.day_of(newest)
        if wanted.all:
            chosen = runs.listed
        kept = [Kept.read(runs, run, inputs_too=False) for run in chosen]
    rows: list[tuple[str, ...]] = []
    for each in kept:
        account = each.account()
        number = each.run.number
        first_ns = account.first.wall_ns if account.first is not None else each.run.began_ns
        for race in account.races:
            of_race = _rows(account, race, Clock(first_ns), each.damaged)
            rows += ((str(number), *row) for row in of_race)
            if race.taken_up:
                say(
                    f'race {race.number} of run {number} began before this run: who started it is '
                    'not known here'
                )
            elif race.green is None:
                say(f'race {race.number} of run {number} was never started')
        if each.goes_on:
            say(f'race control still writes run {number}: these are the results up to now')
    if wanted.output is None:
        _write(sys.stdout, rows)
        return runs.code
    try:
        with wanted.output.open('w', encoding='utf-8', newline='') as stream:
            _write(stream, rows)
    except OSError as error:
        say(f'{wanted.output} cannot be written: {error.strerror}')
        return FAILED
    races = len({row[:2] for row in rows})
    print(f'{plain(str(wanted.output))}: {races} races of {len(kept)} runs')
    return runs.code


def _write(stream: TextIO, rows: Sequence[Sequence[str]]) -> None:
    table = csv.writer(stream, lineterminator='\n')
    table.writerow(COLUMNS)
    table.writerows(rows)


def _rows(
    account: Account, race: RaceAccount, clock: Clock, damaged: bool
) -> Iterator[tuple[str, ...]]:
    teams = {lane.kart: lane.team for lane in account.lanes}

    def moment(at: float | None) -> str:
        if at is None:
            return ''
        return clock.moment(clock.wall_ns(at)).isoformat(timespec='milliseconds')

    complete = race.stop is not None and not (race.incomplete or race.taken_up or damaged)
    for result in account.results(race):
        out = result.out
        yield (
            str(race.number),
            defused(race.heat),
            str(result.place or ''),
            str(result.kart),
            defused(teams.get(result.kart, '')),
            _seconds(race, result),
            moment(race.green),
            moment(result.finished),
            'FINISHED' if out is None else out.why.name,
            '' if out is None else wording.why_out(out, clock),
            str(out.sequence or '') if out is not None else '',
            'yes' if complete else 'no',
        )


def _seconds(race: RaceAccount, result: Result) -> str:
    if race.green is None or result.finished is None:
        return ''
    return f'{wording.between(race.green, result.finished):.3f}'


def defused(text: str) -> str:
    """Return a text of others as a cell that no spreadsheet runs."""
    shown = plain(text)
    # Some spreadsheets take a wide equals sign for one.
    first = unicodedata.normalize('NFKC', shown.lstrip()[:1])[:1]
    return f"'{shown}" if first and first in FORMULA else shown
