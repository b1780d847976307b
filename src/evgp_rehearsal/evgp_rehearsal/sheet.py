# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The score sheet for people: a table in the terminal, and the same as a page.

Pure: lines in, a table or text out.
"""

from __future__ import annotations

from collections.abc import Sequence
import io

from evgp_protocol.clock import duration
from evgp_rehearsal.incidents import INCIDENTS
from evgp_rehearsal.score import Line
from rich.console import Console
from rich.table import Table
from rich.text import Text

HEADINGS = ('at', 'incident', 'kart', 'result', 'first right', 'solved', 'mistakes')
"""What the columns of the sheet are called."""

MISTAKES = ('wrong', 'needless', 'stopped without need', 'people in danger')
"""What the last column may have."""

PAGE_WIDTH = 130
"""Width of the page, in characters."""


def row(line: Line) -> tuple[str, ...]:
    """Return the cells of a line, in the order of ``HEADINGS``."""
    mistakes = (*map(_listed, (line.wrong, line.needless, line.stopped)), line.people)
    return (
        f'{line.at:.0f} s',
        line.incident,
        str(line.kart or ''),
        'PASSED' if line.passed else 'FAILED',
        _seconds(line.first_right, 'never'),
        _seconds(line.solved, f'not within {INCIDENTS[line.incident].limit:.0f} s'),
        '\n'.join(
            f'{what}: {each}' for what, each in zip(MISTAKES, mistakes, strict=True) if each
        ),
    )


def table(lines: Sequence[Line]) -> Table:
    """Return the sheet, and below it what a good official would have done."""
    passed = sum(line.passed for line in lines)
    title = f'REHEARSAL: score sheet, {passed} of {len(lines)} incidents passed'
    sheet = Table(title=title, title_justify='left', title_style='bold', caption_justify='left')
    for heading in HEADINGS:
        sheet.add_column(heading, overflow='fold')
    for line in lines:
        cells = [Text(cell) for cell in row(line)]
        cells[3].stylize('green' if line.passed else 'bold red')
        sheet.add_row(*cells)
    failed = dict.fromkeys(line.incident for line in lines if not line.passed)
    advice = [f'{name}: a good official {INCIDENTS[name].good}' for name in failed]
    if any(each.startswith('RECORD_MSR') for line in lines for each in line.wrong):
        advice.append('RECORD_MSR is wrong where the instructor was not told to use the MSR')
    times = 'Times run from the beginning of the incident, rounded up to half a second.'
    if not lines:
        times = (
            "No incident began. The instructor's page begins them, or --incident, such as spin."
        )
    sheet.caption = '\n'.join([times, *advice])
    return sheet


def page(lines: Sequence[Line]) -> str:
    """Return the sheet as an HTML page that needs nothing else."""
    console = Console(record=True, width=PAGE_WIDTH, file=io.StringIO())
    console.print(table(lines))
    return console.export_html(inline_styles=True)


def _seconds(value: float | None, otherwise: str) -> str:
    return otherwise if value is None else duration(value)


def _listed(values: Sequence[object]) -> str:
    most = 5
    more = f' and {len(values) - most} more' if len(values) > most else ''
    return ', '.join(map(str, values[:most])) + more
