# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What documents point at is there: tests, files, headings, clauses of the inspection."""

from __future__ import annotations

import ast
from collections.abc import Iterator
import functools
import itertools
import pathlib
import re
import subprocess

from evgp_inspection.kart_sentences import BY_NAME
from evgp_rcs_msgs.msg import Alert
import pytest
from race_oracle import PROPERTIES

ROOT = pathlib.Path(__file__).resolve().parents[1]
LISTED = subprocess.run(
    ['git', 'ls-files', '*.md'], cwd=ROOT, capture_output=True, text=True, check=False
).stdout.split()
DOCUMENTS = LISTED or [str(each.relative_to(ROOT)) for each in ROOT.glob('docs/**/*.md')]

EXAMPLES = {'test_my_stack.py', 'test_mine.py', 'test_stopping_distance.py'}
"""Files that a document tells its reader to write, or that are of kit/template."""


def text_of(document: str) -> str:
    return (ROOT / document).read_text(encoding='utf-8')


@functools.cache
def functions_by_file() -> dict[str, set[str]]:
    """Return the functions and rules of each test file, by the file's name."""
    found: dict[str, set[str]] = {}
    for path in (*ROOT.glob('test/*.py'), *ROOT.glob('src/*/test/*.py')):
        tree = ast.walk(ast.parse(path.read_text(encoding='utf-8')))
        names = {node.name for node in tree if isinstance(node, ast.FunctionDef)}
        found.setdefault(path.name, set()).update(names)
    return found


def cited(text: str) -> set[tuple[str, str]]:
    """Return the tests that a text cites as ``file::name``; of a whole file, the name is empty."""
    return set(re.findall(r'\b(test_\w+\.py)(?:::(\w+))?', text))


@pytest.mark.parametrize('document', DOCUMENTS)
def test_every_test_that_a_document_cites_is_there(document: str) -> None:
    there = functions_by_file()
    missing = [
        f'{file}::{name}'
        for file, name in sorted(cited(text_of(document)))
        if file not in EXAMPLES and (file not in there or (name and name not in there[file]))
    ]
    assert missing == []


def rows_of(document: str, heading: str) -> Iterator[list[str]]:
    """Return the rows of the tables below a heading, without those of the tables' headings."""
    _, _, below = text_of(document).partition(heading)
    lines = re.split(r'^##? ', below, flags=re.MULTILINE)[0].splitlines()
    for above, line in itertools.pairwise(lines):
        if line.startswith('|') and not {*line} <= {*'|-: '} and above.startswith('|'):
            yield [cell.strip() for cell in line.strip('|').split(' | ')]


def hazard_rows() -> list[list[str]]:
    rows = [
        *rows_of('docs/safety.md', '## Hazards'),
        *rows_of('docs/safety_annex.md', '## Inside the software'),
    ]
    return [row for row in rows if re.fullmatch(r'H\d+', row[0])]


def test_every_hazard_has_a_number_a_test_and_somebody_who_accepts_what_is_left() -> None:
    rows = hazard_rows()
    assert sorted(int(row[0][1:]) for row in rows) == [*range(1, len(rows) + 1)]
    assert len(rows) > 70
    for number, _, severity, stops, shown, left, accepts in rows:
        assert severity in ('A', 'B', 'C'), number
        assert all((stops, left)), number
        if shown.startswith('no test: '):  # What only people prevent says so, and which procedure.
            assert 'Nothing here' in stops or 'cannot detect' in stops, number
            assert re.fullmatch(r'no test: P\d+a?(, P\d+a?)*', shown), number
        else:
            assert cited(shown), number
        assert re.match(r'(organiser|team|software)\b', accepts), number


def test_every_hazard_is_named_by_a_control_action() -> None:
    named: set[int] = set()
    for row in rows_of('docs/safety_annex.md', '## Unsafe control actions'):
        for first, last in re.findall(r'\bH(\d+)(?: to H(\d+))?', ' '.join(row[1:])):
            named.update(range(int(first), int(last or first) + 1))
    assert named == {int(row[0][1:]) for row in hazard_rows()}


def test_every_hazard_and_procedure_that_is_named_is_there() -> None:
    log = text_of('docs/safety.md') + text_of('docs/safety_annex.md')
    there = re.findall(r'^\| ([HPLN]\d+a?) \|', log, re.MULTILINE)
    assert len(there) == len({*there})
    assert {*re.findall(r'\b[HPLN]\d+a?\b', log)} == {*there}
    for document in ('docs/clauses.md', 'docs/operations.md', 'docs/race-day.md'):
        assert {*re.findall(r'\b[HPN]\d+a?\b', text_of(document))} <= {*there}, document


BRACKETS = r'`test_race_exhaustive\.py` \(([\w, -]+)\)'


def test_every_row_names_tests_or_properties_that_are_there() -> None:
    used: set[str] = set()
    for document in ('docs/safety.md', 'docs/safety_annex.md', 'docs/clauses.md'):
        rows = '\n'.join(re.findall(r'^\|.*', text_of(document), re.MULTILINE))
        for words in re.findall(BRACKETS, rows):
            used.update(words.split(', '))
        whole = [file for file, name in cited(re.sub(BRACKETS, '', rows)) if not name]
        assert whole == [], document
    assert used <= PROPERTIES.keys()


def test_an_official_finds_what_to_do_for_every_alert() -> None:
    rows = [row for row in rows_of('docs/rules.md', '## Alerts') if row[0] != 'the window says']
    found = [name.partition(':')[0] for says, todo, name in rows if says and todo]
    names = {name for name in dir(Alert) if isinstance(getattr(Alert, name), int)}
    assert sorted(found) == sorted({name for name in names if name.isupper()} - {'UNKNOWN'})


def test_every_sentence_of_the_proposal_is_met_by_something_that_is_there() -> None:
    every = rows_of('docs/clauses.md', '## Sentence by sentence')
    rows = [row for row in every if row[0].startswith('§')]
    assert len(re.findall('[/,]', ' '.join(row[0] for row in rows))) > 90  # one for each sentence
    for number, _, met, shown in rows:
        clauses = set(re.findall(r'\bK-\d\w?-\d\d\b', shown))
        assert clauses <= BY_NAME.keys(), number
        assert met, number
        assert cited(shown) or clauses or re.search(r'\b(organiser|team|official)s?\b', shown), (
            number
        )


def anchors(document: pathlib.Path) -> set[str]:
    """Return the anchors of a document's headings, as GitHub makes them."""
    headings = re.findall(r'^#+ (.*)', document.read_text(encoding='utf-8'), re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', each.lower()).strip().replace(' ', '-') for each in headings}


@pytest.mark.parametrize('document', DOCUMENTS)
def test_every_link_of_a_document_leads_somewhere(document: str) -> None:
    path = ROOT / document
    prose = re.sub(r'^```.*?^```', '', text_of(document), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r'\]\((?!https?:)([^)\s]+)\)', prose):
        file, _, anchor = target.partition('#')
        other = (path.parent / file).resolve() if file else path
        assert other.exists(), target
        assert not anchor or anchor in anchors(other), target
