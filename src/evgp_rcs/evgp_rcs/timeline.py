"""The record of a race as a timeline in the terminal: ``rcs_record``, or ``make record``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import contextlib
import datetime
import pathlib
import sqlite3
import sys

from evgp_rcs.record import (
    default_path,
    events,
    is_being_written,
    open_read_only,
    RecordedEvent,
    Session,
    sessions,
)

FINISHED = 'FINISHED'
"""Kind of an event of older versions, which told each finish a second time."""


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Print the runs of race control in a record, or the timeline of one.

    :return: 0, or 2 if the record or the run cannot be read.
    """
    parser = argparse.ArgumentParser(
        prog='rcs_record',
        description="Print the newest run in race control's record, as a timeline.",
        epilog='Race control keeps its record in the file that its parameter "record" names. '
        f'Without the parameter that is {default_path()}, which is read here as well. A run is '
        'what happened between one start of race control and its end.',
    )
    parser.add_argument(
        'file',
        nargs='?',
        type=pathlib.Path,
        default=default_path(),
        help='the record, if it is not %(default)s',
    )
    parser.add_argument('--list', action='store_true', help='list all runs, oldest first')
    parser.add_argument(
        '--run', type=int, metavar='NUMBER', help='print this run, by its number in the list'
    )
    parser.add_argument(
        '--kart',
        type=int,
        metavar='NUMBER',
        help='print the events of this kart, and those that concern no single kart',
    )
    wanted = parser.parse_args(arguments)
    try:
        with contextlib.closing(open_read_only(wanted.file)) as database:
            runs = sessions(database)
            # Race control writes the newest run only.
            present = runs[-1] if runs and is_being_written(wanted.file) else None
            if wanted.list:
                for each in runs:
                    print(_describe(each, each is present))
                return 0
            run = _choose(runs, wanted.run)
            if run is None:
                known = ', '.join(str(each.number) for each in runs)
                what = f'no run {wanted.run}; it has {known}' if runs else 'no run yet'
                print(f'rcs_record: {wanted.file} has {what}', file=sys.stderr)
                return 2
            happened = list(events(database, run.number))
            before = _choose(runs, run.number - 1) if wanted.run is None else None
        # With the record closed: it may be a pager that is slow, and the race must not wait.
        if before is not None and before.ended_ns is None:
            file = '' if wanted.file == default_path() else f' {wanted.file}'
            print(
                f'The run before this one, {before.number}, was not ended in good order. Print it '
                f'with: rcs_record{file} --run {before.number} (or make record '
                f"ARGS='{file.lstrip()}{' ' if file else ''}--run {before.number}')"
            )
        print(_describe(run, run is present))
        _print_timeline(happened, wanted.kart)
    except FileNotFoundError:
        print(
            f'rcs_record: there is no {wanted.file}. Name the file that the parameter "record" '
            'of race control names',
            file=sys.stderr,
        )
        return 2
    except (OSError, sqlite3.Error) as error:
        print(f'rcs_record: {wanted.file} cannot be read: {error}', file=sys.stderr)
        return 2
    return 0


def _choose(runs: Sequence[Session], number: int | None) -> Session | None:
    if number is None:
        return runs[-1] if runs else None
    return next((run for run in runs if run.number == number), None)


def _describe(run: Session, present: bool) -> str:
    ended = _clock(run.ended_ns) if run.ended_ns is not None else 'not ended in good order'
    if present:
        ended = 'still running'
    began = f'{_day(run.began_ns)} {_clock(run.began_ns)}'
    return f'{run.number:4}  {began} - {ended}  {run.events} events'


def _print_timeline(happened: Sequence[RecordedEvent], kart: int | None) -> None:
    first: float | None = None
    expected = 1
    for event in happened:
        if event.sequence != expected:
            print(f'       ... {event.sequence - expected} events are missing ...')
        expected = event.sequence + 1
        first = event.monotonic if first is None else first
        if kart is not None and event.kart not in (0, kart):
            continue
        if event.kind == FINISHED:
            continue  # the command before it said so
        mark = ' ' if event.success else '!'
        print(f'{_clock(event.wall_ns)} {event.monotonic - first:10.3f} {mark} {event.text}')


def _time(wall_ns: int) -> datetime.datetime:
    return datetime.datetime.fromtimestamp(wall_ns / 1e9).astimezone()


def _day(wall_ns: int) -> str:
    return _time(wall_ns).strftime('%Y-%m-%d')


def _clock(wall_ns: int) -> str:
    return _time(wall_ns).strftime('%H:%M:%S.%f')[:-3]


if __name__ == '__main__':
    sys.exit(main())
