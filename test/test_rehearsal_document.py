# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The rule book's order for an incident is in the documents where the incident says so."""

from __future__ import annotations

import pathlib
import re

from evgp_rehearsal.incidents import INCIDENTS

DOCS = pathlib.Path(__file__).parents[1] / 'docs'


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
