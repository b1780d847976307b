# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The report of an inspection, as lines for the terminal, as HTML for paper, and as JSON."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
import datetime
import html
import json
import math
import os
import pathlib
import sys
from typing import Any

from evgp_inspection import VERSION
from evgp_inspection.kart_sentences import BY_STATEMENT
from evgp_inspection.traces import describe
from evgp_inspection.verdicts import Clause, Inspection, Verdict
from evgp_protocol.clock import duration


def line(inspection: Inspection, clause: Clause) -> str:
    """Return a check in one line, with the reason below if it was not passed."""
    finding = inspection.checks[clause]
    word = {Verdict.PASS: 'pass', Verdict.FAIL: 'FAIL', Verdict.NOT_JUDGED: '  - '}
    text = f'{word[finding.verdict]}  {clause.name}  {clause.title:58} '
    text = f'{text}{_times(inspection, clause):>16}'.rstrip()
    return text if finding.verdict is Verdict.PASS else f'{text}\n                {finding.why}'


def _times(inspection: Inspection, clause: Clause) -> str:
    measured, limit = inspection.checks[clause].measured, inspection.limit_of(clause)
    text = '' if measured is None else duration(measured, 2)
    return text if limit is None or not text else f'{text} of {limit:g} s'


def as_json(inspection: Inspection) -> str:
    """Return the complete report as JSON, each check with the part of the trace that led to it."""
    checks: list[dict[str, Any]] = [
        {
            'clause': clause.name,
            'title': clause.title,
            'section': clause.section,
            'source': clause.source,
            'sentence': clause.sentence,
            'verdict': finding.verdict.value,
            'why': finding.why,
            'measured_s': finding.measured,
            'limit_s': inspection.limit_of(clause),
            'evidence': [
                {
                    'at_s': round(event.at, 6),
                    'what': event.kind.value,
                    'connection': event.link or None,
                    'bytes_hex': event.data.hex() or None,
                    'text': event.text or None,
                    'value': event.value if math.isfinite(event.value) else None,
                    'bytes_unread': event.unread or None,
                }
                for event in finding.evidence
            ],
        }
        for clause, finding in inspection.checks.items()
    ]
    whole = {
        **dataclasses.asdict(dataclasses.replace(inspection, checks={})),
        'statements': BY_STATEMENT,
        'version': VERSION,
        'verdict': inspection.verdict.value,
        'counts': {each.value: len(inspection.having(each)) for each in Verdict},
        'checks': checks,
    }
    return json.dumps(whole, indent=1, ensure_ascii=False, allow_nan=False)


def deliver(
    text: str, folder: str, name: str, began: datetime.datetime, files: Mapping[str, str]
) -> None:
    """
    Write the files of a report, then print a text.

    :param folder: the folder for the files; if empty, none is written.
    :param files: the endings of the files, with their texts.
    """
    lines = [text]
    try:
        for ending, whole in files.items() if folder else ():
            path = pathlib.Path(folder) / f'{name}-{began:%Y%m%d-%H%M%S}.{ending}'
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(whole, encoding='utf-8')
            lines.append(f'written: {path}')
    except OSError as error:
        lines.append(f'The report cannot be written: {error}')
    show(*lines)


def show(*lines: str) -> None:
    """Print lines, even if the terminal is gone or nobody reads them."""
    try:
        print(*lines, sep='\n', flush=True)
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


_STYLE = """\
@page { size: A4; margin: 10mm }
body { font: 8pt/1.2 sans-serif; color: #000; background: #fff; max-width: 190mm; margin: 0 auto }
h1 { font-size: 14pt; margin: 0 0 1mm }
h2 { font-size: 10pt; margin: 4mm 0 1mm; break-after: avoid }
p { margin: 0 0 1mm }
table { border-collapse: collapse; width: 100% }
th, td { text-align: left; padding: 0.3mm 1mm; border-bottom: 0.1mm solid #999 }
td { vertical-align: top }
td.time { text-align: right; white-space: nowrap }
.fail { background: #000; color: #fff; font-weight: bold }
.pass { font-weight: bold }
.note { font-size: 7pt; color: #333 }
pre { font: 6.5pt/1.25 monospace; white-space: pre-wrap; overflow-wrap: anywhere; margin: 0 }
.sign { margin-top: 4mm; border-top: 0.2mm solid #000; width: 70mm }
"""


def as_html(inspection: Inspection) -> str:
    """
    Return the report as a self-contained HTML file. A pass prints on one A4 page.

    After the table, each failed check is shown with its sentence and the part of the trace that
    led to it.
    """
    e = html.escape
    facts = [
        f'<b>{e(inspection.subject)}</b>',
        f'team <b>{e(inspection.team) or "not named"}</b>',
        e(inspection.began),
        f'inspector <b>{e(inspection.inspector) or "nobody (unattended)"}</b>',
        f'evgp_inspection {VERSION}',
        f'{inspection.seconds / 60:.1f} minutes',
    ]
    rows = []
    for clause, finding in inspection.checks.items():
        kind = finding.verdict.value
        note = ''
        if finding.verdict is not Verdict.PASS:
            note = f'<div class="note">{e(finding.why)}</div>'
        rows.append(
            f'<tr><td>{e(clause.name)}</td><td>{e(clause.title)}{note}</td>'
            f'<td class="{kind.partition(" ")[0]}">{e(kind)}</td>'
            f'<td class="time">{e(_times(inspection, clause))}</td></tr>'
        )
    limits = dataclasses.asdict(inspection.limits).items()
    used = ', '.join(f'{name} {value:g}' for name, value in limits)
    parts = [
        '<!DOCTYPE html>',
        '<html lang="en"><head><meta charset="utf-8">',
        f'<title>Inspection of {e(inspection.subject)}</title>',
        f'<style>{_STYLE}</style></head><body>',
        f'<h1>{e(inspection.summary())}</h1>',
        f'<p>{" · ".join(facts)}</p>',
        *(f'<p><b>{e(remark)}</b></p>' for remark in inspection.remarks),
        '<table><thead><tr><th>clause</th><th>a good kart</th><th>verdict</th>'
        '<th>measured</th></tr></thead>',
        f'<tbody>{"".join(rows)}</tbody></table>',
        f'<p class="note">Limits, in s (standstill: m/s): {e(used)}.</p>',
        *(f'<p class="note">☐ {e(statement)}</p>' for statement in BY_STATEMENT),
        '<p class="sign">Signature</p>',
    ]
    for clause, finding in inspection.having(Verdict.FAIL).items():
        parts += [
            f'<h2>{e(clause.name)} {e(clause.title)}</h2>',
            f'<p>{e(clause.section)}, {e(clause.source)}: “{e(clause.sentence)}”</p>',
            f'<p><b>{e(finding.why)}</b></p>',
            f'<pre>{e(chr(10).join(describe(finding.evidence)))}</pre>',
        ]
    return '\n'.join([*parts, '</body></html>', ''])
