# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""docs/rehearsal.md, and docs/teams.md of one kart, say of the incidents what the code does."""

from __future__ import annotations

import pathlib
import re

from evgp_rehearsal.incidents import INCIDENTS
from evgp_rehearsal.rehearse_kart import INCIDENTS as OF_ONE_KART

DOCS = pathlib.Path(__file__).parents[1] / 'docs'
TEXT = (DOCS / 'rehearsal.md').read_text(encoding='utf-8')


def rows(heading: str) -> list[list[str]]:
    """Return the cells of the table below a heading."""
    _, _, rest = TEXT.partition(f'\n## {heading}\n')
    lines = [line for line in rest.partition('\n## ')[0].splitlines() if line.startswith('| ')]
    return [[cell.strip(' `') for cell in line.strip('|').split('|')] for line in lines[1:]]


def test_the_table_of_incidents_is_that_of_the_code() -> None:
    assert rows('Incidents') == [[row.name, row.meaning, row.order] for row in INCIDENTS.values()]


def test_the_incidents_for_one_kart_are_all_named() -> None:
    text = (DOCS / 'teams.md').read_text(encoding='utf-8')
    _, _, own = text.partition('\n## A race for your one kart\n')
    listed = re.search(r'Incidents: (.*?)\. `--port`', own, re.DOTALL)
    assert listed is not None
    assert re.findall(r'`(\w+)`', listed[1]) == list(OF_ONE_KART)


def test_the_rule_books_order_is_in_the_rules_where_the_table_says() -> None:
    rules = (DOCS / 'rules.md').read_text(encoding='utf-8')
    headings = re.findall(r'^#+ (.*?)(?: \(§.*\))?$', rules, re.MULTILINE)
    for row in INCIDENTS.values():
        (places,) = re.findall(r'\(([^()]*)\)$', row.order)
        for place in places.split('; '):
            section, _, what = place.partition(': ')
            assert section in headings or section.startswith(('§', 'docs/')), (row.name, place)
            # A name of an alert or a state is found as it stands.
            assert not what.isupper() or what in rules, (row.name, place)
