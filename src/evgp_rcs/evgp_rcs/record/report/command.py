# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""``rcs_record report``: writes the report of a run."""

from __future__ import annotations

import argparse
import hashlib
import pathlib

from evgp_rcs.record.report.model import Account
from evgp_rcs.record.report.page import page
from evgp_rcs.record.runs import Kept, open_runs, PARTLY, put, Runs
from evgp_rcs.record.store import is_being_written
from evgp_rcs.record.timing import timing_of


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options and the help of `rcs_record report` to a parser."""
    parser.description = (
        'Write the report of the newest run as one HTML file. This runs the rules again, '
        'which takes some 20 s per hour of the run.'
    )
    parser.epilog = 'Open the file in any browser, and print it from there.'
    parser.add_argument(
        '-o', '--output', type=pathlib.Path, required=True, metavar='FILE', help='write this file'
    )
    parser.add_argument(
        '--event', default='', metavar='NAME', help='name of the event, for the heading'
    )


def main(wanted: argparse.Namespace) -> int:
    with open_runs(wanted.file) as runs:
        run = runs.choose(wanted.run)
        kept = runs.read(run)
        sums = _sums(runs, kept)
    timing = timing_of(wanted.file)
    account = Account(kept)
    written = page(runs, account, timing, sums, wanted.event)
    what = f'run {run.number}, {len(account.events)} events'
    return put(written, wanted.output, what) or (PARTLY if account.gaps else runs.code)


def _sums(runs: Runs, kept: Kept) -> list[tuple[str, str]]:
    """
    Return what each SHA-256 sum is of, and the sum.

    With the sum of the stream, the report can be checked against the record at any later time.
    Unless race control is writing the file, there are also sums of the file and of the ``-wal``
    that SQLite leaves after a crash.
    """
    files = [runs.file, runs.file.with_name(f'{runs.file.name}-wal')]
    sums = [
        (f'SHA-256 of the file {file.name}', _sum_of(file.read_bytes()))
        for file in files
        if file.exists() and (file.stat().st_size or file == runs.file)
    ]
    if is_being_written(runs.file):
        sums = [('SHA-256 of the file', 'none: race control was writing it')]
    of_stream = 'SHA-256 of the stream of this run (rcs_record show --stream)'
    return [*sums, (of_stream, _sum_of(b''.join(kept.lines())))]


def _sum_of(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
