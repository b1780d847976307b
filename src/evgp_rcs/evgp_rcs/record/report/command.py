# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""``rcs_record report``: writes the report of a run."""

from __future__ import annotations

import argparse
import datetime
import hashlib
import math
import pathlib
import re

from evgp_rcs.record.report.model import Account, Part
from evgp_rcs.record.report.page import page
from evgp_rcs.record.report.wording import Clock
from evgp_rcs.record.runs import Kept, open_runs, PARTLY, put, Runs, UnreadableError
from evgp_rcs.record.store import is_being_written
from evgp_rcs.record.timing import timing_of


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options and the help of `rcs_record report` to a parser."""
    parser.description = (
        'Write the report of the newest run, or of a part of it, as one HTML file. '
        'This runs the rules again, which takes some 20 s per hour of the run.'
    )
    parser.epilog = (
        'TIME is a time of day (14:05 or 14:05:30), which means the first such time after '
        'the run began; or a day and a time (2026-05-30T14:05); or a plus and the seconds since '
        'the first event (+90). A report of a part says so at the top, at the timeline, at the '
        'table, and on every printed page. Open the file in any browser, and print it from there.'
    )
    parser.add_argument(
        '-o', '--output', type=pathlib.Path, required=True, metavar='FILE', help='write this file'
    )
    parser.add_argument(
        '--event', default='', metavar='NAME', help='name of the event, for the heading'
    )
    parser.add_argument('--from', dest='start', metavar='TIME', help='leave out what is earlier')
    parser.add_argument('--to', dest='end', metavar='TIME', help='leave out what is later')
    parser.add_argument(
        '--kart',
        type=int,
        metavar='NUMBER',
        help='show only this kart, and what concerns no single kart',
    )


def main(wanted: argparse.Namespace) -> int:
    """
    Write the report of one run of a record.

    :return: the exit code.
    :raises UnreadableError: if the record or the run cannot be read, or lacks the part.
    """
    with open_runs(wanted.file) as runs:
        run = runs.choose(wanted.run)
        kept = runs.read(run)
        sums = _sums(runs, kept)
    # The record is closed by now, so that race control does not wait for the rest.
    account = Account(kept, timing_of(wanted.file))
    part = _part(account, wanted.start, wanted.end, wanted.kart)
    written = page(runs, account, part, sums, wanted.event)
    what = f'run {run.number}, {len(account.events)} events'
    return put(written, wanted.output, what) or (PARTLY if account.gaps else runs.code)


def _sums(runs: Runs, kept: Kept) -> list[tuple[str, str]]:
    """
    Return what each SHA-256 sum is of, and the sum.

    With the sum of the stream, the report can be checked against the record at any later time.
    Unless race control is writing the file, there are also sums of the file and of the ``-wal``
    that SQLite leaves after a crash.
    """
    digest = hashlib.sha256()
    for line in kept.lines():
        digest.update(line)
    files = [runs.file, runs.file.with_name(f'{runs.file.name}-wal')]
    sums = [
        (f'SHA-256 of the file {file.name}', _sum_of(file))
        for file in files
        if file.exists() and (file.stat().st_size or file == runs.file)
    ]
    if is_being_written(runs.file):
        sums = [('SHA-256 of the file', 'none: race control was writing it')]
    of_stream = 'SHA-256 of the stream of this run (rcs_record show --stream)'
    return [*sums, (of_stream, digest.hexdigest())]


def _sum_of(file: pathlib.Path) -> str:
    digest = hashlib.sha256()
    with file.open('rb') as opened:
        while chunk := opened.read(1 << 20):
            digest.update(chunk)
    return digest.hexdigest()


def _part(account: Account, start: str | None, end: str | None, kart: int | None) -> Part:
    clock = Clock(account.began_ns)
    part = Part(
        0.0 if start is None else seconds_of(start, clock),
        math.inf if end is None else seconds_of(end, clock),
        kart,
    )
    if part.start > account.length:
        raise UnreadableError(
            f'--from {start}: the run had ended at {clock.at(account.length, 1)}'
        )
    if part.end < part.start:
        raise UnreadableError(f'--to {end}: the part begins later')
    if kart is not None and kart not in account.lanes:
        known = ', '.join(map(str, account.lanes)) or 'no kart'
        raise UnreadableError(f'--kart {kart}: the run has {known}')
    return part


def seconds_of(text: str, clock: Clock) -> float:
    """
    Return the seconds from the first event to a time from the command line.

    :raises UnreadableError: if the text is not a time.
    """
    began = clock.moment(clock.began_ns)
    if re.fullmatch(r'\+\d+(\.\d+)?', text):
        return float(text[1:])
    of_day = re.fullmatch(r'\d?\d:\d\d(:\d\d(\.\d{1,6})?)?', text)
    hours = '0' * (text[1:2] == ':')
    try:
        moment = datetime.datetime.fromisoformat(
            f'{began:%Y-%m-%d}T{hours}{text}' if of_day else text
        )
    except ValueError as error:
        examples = '14:05:30, 2026-05-30T14:05, +90'
        raise UnreadableError(f'{text} is not a time. Examples: {examples}') from error
    at = (moment.replace(tzinfo=moment.tzinfo or clock.zone) - began).total_seconds()
    # A time of day in the first minute means the beginning itself, not the next day.
    return at + 86400.0 if of_day and at < -60.0 else max(0.0, at)
