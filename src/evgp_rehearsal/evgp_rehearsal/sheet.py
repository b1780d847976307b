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

"""
The score sheet for people: a table in the terminal, and a page.

Pure: lines in, a table or text out.
"""

from __future__ import annotations

from collections.abc import Sequence
import html

from evgp_protocol.clock import duration
from evgp_rehearsal.incidents import INCIDENTS
from evgp_rehearsal.score import Line
from rich.table import Table
from rich.text import Text

HEADINGS = (
    'at',
    'incident',
    'kart',
    'result',
    'first right',
    'solved',
    'wrong',
    'needless',
    'stopped without need',
    'people in danger',
)
"""What the columns of the sheet are called."""


MISTAKES = 6
"""The column from which on anything is a mistake."""


def row(line: Line) -> tuple[str, ...]:
    """Return the cells of a line, in the order of ``HEADINGS``."""
    return (
        f'{line.at:.0f} s',
        line.incident,
        str(line.kart or ''),
        'PASSED' if line.passed else 'FAILED',
        _seconds(line.first_right, 'never'),
        _seconds(line.solved, f'not within {INCIDENTS[line.incident].limit:.0f} s'),
        _listed(line.wrong),
        _listed(line.needless),
        _listed(line.stopped),
        str(line.people or ''),
    )


def table(lines: Sequence[Line]) -> Table:
    """Return the sheet for the terminal, and below it what a good official would have done."""
    sheet = Table(title='REHEARSAL: score sheet', title_justify='left', title_style='bold')
    for heading in (*HEADINGS[:MISTAKES], 'mistakes'):
        sheet.add_column(heading, overflow='fold')
    for line in lines:
        cells = row(line)
        mistakes = [
            f'{heading}: {cell}'
            for heading, cell in zip(HEADINGS[MISTAKES:], cells[MISTAKES:], strict=True)
            if cell
        ]
        texts = [Text(cell) for cell in (*cells[:MISTAKES], '\n'.join(mistakes))]
        texts[3].stylize('green' if line.passed else 'bold red')
        sheet.add_row(*texts)
    advice = [f'{each.incident}: {INCIDENTS[each.incident].good}' for each in failed(lines)]
    sheet.caption = '\n'.join(advice)
    sheet.caption_justify = 'left'
    return sheet


def page(lines: Sequence[Line]) -> str:
    """Return the sheet as an HTML page that needs nothing else."""
    head = ''.join(f'<th>{html.escape(heading)}' for heading in HEADINGS)
    body = ''.join(
        f'<tr class="{"passed" if line.passed else "failed"}">'
        + ''.join(f'<td>{html.escape(cell)}' for cell in row(line))
        for line in lines
    )
    advice = ''.join(
        f'<li><b>{html.escape(line.incident)}</b>: a good official '
        f'{html.escape(INCIDENTS[line.incident].good)}.'
        for line in failed(lines)
    )
    passed = sum(line.passed for line in lines)
    return _PAGE.format(head=head, body=body, advice=advice, passed=passed, all=len(lines))


def failed(lines: Sequence[Line]) -> list[Line]:
    """Return one line of each incident that was failed."""
    return list({line.incident: line for line in lines if not line.passed}.values())


def _seconds(value: float | None, otherwise: str) -> str:
    return otherwise if value is None else duration(value)


def _listed(values: Sequence[object]) -> str:
    most = 5
    more = f' and {len(values) - most} more' if len(values) > most else ''
    return ', '.join(map(str, values[:most])) + more


_PAGE = """<!doctype html>
<meta charset="utf-8"><title>REHEARSAL: score sheet</title>
<style>
body {{ font: 15px sans-serif; margin: 0 0 2em }}
h1 {{ background: #6a1b9a; color: #fff; margin: 0; padding: .4em 1em; font-size: 20px }}
p, ul, table {{ margin: 1em }}
table {{ border-collapse: collapse }}
th, td {{ border: 1px solid #999; padding: .35em .6em; text-align: left; vertical-align: top }}
th {{ background: #eee }}
td:first-child {{ white-space: nowrap }}
.passed td:nth-child(4) {{ background: #c8e6c9 }}
.failed td:nth-child(4) {{ background: #ffcdd2; font-weight: bold }}
</style>
<h1>REHEARSAL: score sheet</h1>
<p>{passed} of {all} incidents passed. Times are rounded up to half a second, and run from the
beginning of the incident.</p>
<table><tr>{head}{body}</table>
<ul>{advice}</ul>
"""
