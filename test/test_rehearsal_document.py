# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""docs/rehearsal.md says of the incidents what the code does."""

from __future__ import annotations

import pathlib
import re

from evgp_rehearsal.incidents import INCIDENTS

DOCS = pathlib.Path(__file__).parents[1] / 'docs'
TEXT = (DOCS / 'rehearsal.md').read_text(encoding='utf-8')


def rows(heading: str) -> list[list[str]]:
    """Return the cells of the table below a heading."""
    _, _, rest = TEXT.partition(f'\n## {heading}\n')
    lines = [line for line in rest.partition('\n## ')[0].splitlines() if line.startswith('| ')]
    return [[cell.strip(' `') for cell in line.strip('|').split('|')] for line in lines[1:]]


def test_the_table_of_incidents_is_that_of_the_code() -> None:
    assert rows('Incidents') == [[row.name, row.meaning, row.order] for row in INCIDENTS.values()]


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
