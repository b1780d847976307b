# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Converts other programs' lists of karts to rosters with gaps.

It reads two formats: an entry list exported by timing software (CSV), and the list of the first
race control (`address: team`). Neither has everything that a roster needs, so an official must
fill in the rest.
"""

from __future__ import annotations

from collections.abc import Iterable
import csv
import ipaddress
import json
import re
from typing import TypeAlias

_Kart: TypeAlias = tuple[str, str, str, list[str]]
"""The number, team, address and transponders of a kart; empty where the list has none."""

_NUMBER = re.compile('(start|kart|car)?(no|nr|number)|kart')
_TEAM = ('team', 'teamname', 'name', 'firstname', 'lastname')


def as_roster(text: str) -> tuple[str, str]:
    """
    Return another program's list as a roster, and the name of the field that each kart lacks.

    If the text is not such a list, the result is ('', '').
    """
    lines = [line for line in text.removeprefix('\ufeff').splitlines() if line.strip()]
    if lines and lines[0].startswith('sep='):  # for Excel
        del lines[0]
    if not lines:
        return '', ''
    pairs = [line.partition(':') for line in lines if not line.lstrip().startswith('#')]
    if pairs and all(_is_address(address) and team.strip() for address, _, team in pairs):
        old: Iterable[_Kart] = (
            ('', _bare(team), _bare(address), []) for address, _, team in pairs
        )
        return _roster(old), 'number'
    head, *rows = _cells(lines)
    names = [re.sub('[^a-z]', '', each.lower()) for each in head]
    numbers = [at for at, each in enumerate(names) if _NUMBER.fullmatch(each)]
    teams = [at for at, each in enumerate(names) if each in _TEAM]
    if not (numbers and teams) or lines[0].startswith('#'):
        return '', ''
    carried = [at for at, each in enumerate(names) if each.startswith('transponder')]

    def cells(row: list[str], places: list[int]) -> list[str]:
        return [row[at].strip() for at in places if at < len(row) and row[at].strip()]

    karts = (
        (''.join(cells(row, numbers)[:1]), ' '.join(cells(row, teams)), '', cells(row, carried))
        for row in rows
        if any(map(str.strip, row))  # Excel exports empty rows too
    )
    return _roster(karts), 'address'


def _cells(lines: list[str]) -> list[list[str]]:
    """Return the rows of a table, of which each line that is not inside quotes is one."""
    delimiter = max(',;\t', key=lines[0].count)
    try:
        return [*csv.reader(lines, delimiter=delimiter, strict=True)]
    except csv.Error:
        # A quotation mark that nothing closes must not swallow the karts that follow.
        return [[_bare(cell) for cell in line.split(delimiter)] for line in lines]


def _bare(text: str) -> str:
    return text.strip(' "\'')


def _is_address(text: str) -> bool:
    try:
        ipaddress.IPv4Address(_bare(text))
    except ValueError:
        return False
    return True


def _roster(karts: Iterable[_Kart]) -> str:
    """Return a roster of these karts, some of whose fields may be empty."""
    lines = ['karts:']
    for number, team, address, transponders in karts:
        # JSON is also YAML, and quotes anything in a name.
        lines += [f'  - number: {number}', f'    team: {json.dumps(team, ensure_ascii=False)}']
        lines += [f'    address: {address}', '    in_race: true']
        if transponders:
            lines.append(f'    transponders: {json.dumps(transponders, ensure_ascii=False)}')
    return '\n'.join(map(str.rstrip, lines)) + '\n'
