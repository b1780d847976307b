# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""``rcs_record show``: prints a run as a timeline in the terminal."""

from __future__ import annotations

import argparse
import sys

from evgp_node.official import said_by
from evgp_node.stream import Gap
from evgp_rcs.record.plain import plain
from evgp_rcs.record.report.wording import Clock
from evgp_rcs.record.runs import Kept, open_runs, PARTLY, say
from evgp_rcs.record.store import Session


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options and the help of `rcs_record show` to a parser."""
    parser.description = (
        "Print the newest run in race control's record, as a timeline: the time of "
        'day, the seconds since the first event, and what happened. A refused command has a !. '
        'Events are in the order in which they happened, even if the clock of the computer was '
        'set; the seconds are from a clock that cannot be set.'
    )
    parser.epilog = 'show is the default.'
    parser.add_argument('--list', action='store_true', help='list all runs, oldest first')
    parser.add_argument(
        '--stream',
        action='store_true',
        help='print every entry of the run as recorded, including inputs and orders: one line of '
        'JSON each',
    )
    parser.add_argument(
        '--kart',
        type=int,
        metavar='NUMBER',
        help='print the events of this kart, and those that concern no single kart',
    )


def main(wanted: argparse.Namespace) -> int:
    with open_runs(wanted.file) as runs:
        if wanted.list:
            for each in runs.listed:
                print(_describe(each))
            return runs.code
        run = runs.choose(wanted.run)
        kept = runs.read(run)
    if wanted.stream:
        for lines in kept.lines():
            sys.stdout.write(lines.decode(errors='replace'))
        gaps = [each for each in kept.events() if isinstance(each, Gap)]
        for gap in gaps:
            say(str(gap))
        return PARTLY if gaps else runs.code
    print(_describe(run))
    is_whole = _print_timeline(kept, wanted.kart)
    return runs.code if is_whole else PARTLY


def _describe(run: Session) -> str:
    clock = Clock(run.began_ns)
    ended = 'did not end normally' if run.ended_ns is None else clock.time(run.ended_ns, 3)
    if not run.events:
        ended = 'did not start'
    if run.goes_on:
        ended = 'still running'
    began = f'{clock.moment(run.began_ns):%Y-%m-%d} {clock.time(run.began_ns, 3)}'
    return f'{run.number:4}  {began} - {ended}  {run.events} events'


def _print_timeline(kept: Kept, kart: int | None) -> bool:
    """Print the events and gaps and return whether there were no gaps."""
    began: float | None = None
    is_whole = True
    for each in kept.events():
        if isinstance(each, Gap):
            is_whole = False
            print(f'       ... {plain(str(each))} ...')
            continue
        began = each.monotonic if began is None else began
        event = each.event
        if kart is not None and event.kart not in (0, kart):
            continue
        mark = ' ' if event.success else '!'
        said = plain(said_by(event.text, event.official))
        time = Clock(each.wall_ns).time(each.wall_ns, 3)
        print(f'{time} {each.monotonic - began:10.3f} {mark} {said}')
    return is_whole
