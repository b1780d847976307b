# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
``rcs_record results``: writes the timekeeper's results and the order of FINISH as a table.

Only the timekeeper classifies karts, so a race without timing has only the order of FINISH.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
import csv
import io
import pathlib
import unicodedata

from evgp_node.results import KartResult, Standings, Status
from evgp_rcs.record.plain import plain
from evgp_rcs.record.report import wording
from evgp_rcs.record.report.model import Account, RaceAccount, Result
from evgp_rcs.record.report.wording import Clock
from evgp_rcs.record.runs import open_runs, PARTLY, put, say
from evgp_rcs.record.timing import timing_of

COLUMNS = (
    'run',
    'race',
    'heat',
    'place',
    'finish',
    'kart',
    'team',
    'seconds',
    'started',
    'finished',
    'result',
    'reason',
    'event',
    'complete',
    'format',
    'grid',
    'status',
    'laps',
    'total',
    'best',
    'lap_times',
    'penalties',
    'overall',
)
"""Columns of the table; docs/record.md explains them."""

FORMULA = '=+-@\t\r\n'
"""First characters with which a spreadsheet may run a cell as a formula."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options and the help of `rcs_record results` to a parser."""
    parser.description = (
        "Write the results of each race as CSV: the timekeeper's places, laps, times "
        'and penalties, the order of FINISH, and who did not finish and why. A race that is under '
        'way has its results up to now. Without --run or --all, the table has the races of the '
        "newest run's day, which begins after six hours or more without race control."
    )
    parser.epilog = (
        'This runs the rules again, which takes some 20 s per hour of the runs. A name or '
        'text that a spreadsheet would run as a formula gets an apostrophe in front. '
        'docs/record.md explains the columns.'
    )
    parser.add_argument('--all', action='store_true', help='the races of every run in the record')
    parser.add_argument(
        '-o',
        '--output',
        type=pathlib.Path,
        metavar='FILE',
        help='write this file instead of printing the results',
    )


def main(wanted: argparse.Namespace) -> int:
    """Write the results of the named runs as CSV, oldest first."""
    with open_runs(wanted.file) as runs:
        newest = runs.choose(wanted.run)
        chosen = [newest] if wanted.run is not None else runs.day_of(newest)
        if wanted.all:
            chosen = runs.listed
        if left_out := len(runs.listed) - len(chosen):
            say(f'{left_out} of {len(runs.listed)} runs are left out; use --all for every run')
        kept = [runs.read(run) for run in chosen]
        code = runs.code
    timing = timing_of(wanted.file)
    rows: list[tuple[str, ...]] = []
    for account in map(Account, kept):
        run = account.kept.run.number
        if lacks := account.replay.lacks:
            say(f'run {run} is only partly known: {lacks}')
            code = PARTLY
        clock = Clock(account.began_ns)
        # Runs of several days are several events.
        overall = timing.overall(runs.day_of(account.kept.run))
        for race in account.races:
            timed = timing.results.get((account.kept.run.id, race.number))
            best = overall[timed.format].overall if timed else ()
            places = {each.kart: each.place for each in best}
            rows += ((str(run), *row) for row in _rows(account, race, clock, timed, places))
            if race.taken_up:
                say(
                    f'race {race.number} of run {run} began before this run, so its starters are '
                    'not known here'
                )
            elif race.green is None:
                say(f'race {race.number} of run {run} was never started')
        if account.kept.run.goes_on:
            say(f'race control is still writing run {run}; these are the results up to now')
    stream = io.StringIO()
    csv.writer(stream, lineterminator='\n').writerows([COLUMNS, *rows])
    what = f'{len({row[:2] for row in rows})} races of {len(kept)} runs'
    return put(stream.getvalue(), wanted.output, what) or code


def _rows(
    account: Account,
    race: RaceAccount,
    clock: Clock,
    timing: Standings | None,
    places: Mapping[int, int],
) -> Iterator[tuple[str, ...]]:
    def moment(at: float | None) -> str:
        if at is None:
            return ''
        return clock.moment(clock.wall_ns(at)).isoformat(timespec='milliseconds')

    complete = race.stop is not None and not (race.incomplete or race.taken_up)
    for result in account.results(race):
        took = None
        if race.green is not None and result.finished is not None:
            took = result.finished - race.green
        out = result.out
        event = None if out is None else out.event
        timed = None if timing is None else timing.kart(result.kart)
        place = result.place if timed is None else timed.place
        yield (
            str(race.number),
            defused(race.heat),
            str(place or ''),
            str(result.place or ''),
            str(result.kart),
            defused(account.teams.get(result.kart, '')),
            _time(took),
            moment(race.green),
            moment(result.finished),
            *_became(result, timed, clock),
            '' if event is None else str(event.sequence),
            'yes' if complete else 'no',
            *_timed(timing, timed, places.get(result.kart, 0)),
        )


def _became(result: Result, timed: KartResult | None, clock: Clock) -> tuple[str, str]:
    """Return a kart's result in one word, and why it did not finish."""
    if timed is not None and timed.status is Status.DISQUALIFIED:
        return Status.DISQUALIFIED.name, 'see its penalties'
    if result.out is None:
        return 'FINISHED', ''
    return result.out.why.name, wording.why_out(result.out, clock)


def _timed(timing: Standings | None, kart: KartResult | None, overall: int) -> tuple[str, ...]:
    if timing is None or kart is None:
        return ('',) * 9
    grid = timing.grid.index(kart.kart) + 1 if kart.kart in timing.grid else ''
    return (
        timing.format.value,
        str(grid),
        kart.status.name,
        str(kart.laps),
        _time(kart.total),
        _time(kart.best),
        ' '.join(map(_time, kart.lap_times)),
        defused('; '.join(f'{each} ({each.official})' for each in kart.penalties)),
        str(overall or ''),
    )


def _time(seconds: float | None) -> str:
    return '' if seconds is None else f'{seconds:.3f}'


def defused(text: str) -> str:
    """Return an untrusted text as a cell that no spreadsheet runs as a formula."""
    shown = plain(text)
    # Some spreadsheets treat a full-width equals sign like a normal one.
    first = unicodedata.normalize('NFKC', shown.lstrip()[:1])[:1]
    return f"'{shown}" if first and first in FORMULA else shown
