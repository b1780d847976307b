# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What is kept of an official's name, and what our programs send as one."""

from __future__ import annotations

from evgp_node.official import claim, heard, MOST, said_by, tidy, UNNAMED
from hypothesis import example, given
from hypothesis import strategies as st
import pytest


@given(st.text(st.characters()))
@example('\ud800')
@example('=cmd()\r\n\x1b[2J\u202e<script>\u2028')
def test_what_is_heard_is_one_short_line_that_can_be_printed_and_is_heard_the_same_again(
    text: str,
) -> None:
    official = heard(text)

    assert 0 < len(official) <= MOST
    assert official.isprintable()
    assert official == official.strip()
    official.encode()
    assert heard(official) == official


@given(st.text(st.characters(exclude_categories=('C', 'Z')), min_size=1, max_size=MOST))
def test_an_ordinary_name_stays_as_it_is(name: str) -> None:
    assert heard(name) == name
    assert heard(f' {name}\n') == name


@pytest.mark.parametrize('text', ['', ' ', '\n\t', '\0', '\u202e\u200b', '\x1b'])
def test_a_text_without_a_name_is_unnamed(text: str) -> None:
    assert heard(text) == UNNAMED


def test_nothing_that_turns_the_direction_or_moves_a_cursor_is_left() -> None:
    assert tidy('An\u202ena\x1b[2J\u2066 \r\nM\x07eier') == 'Anna[2J Meier'


PROCESS = st.integers(1, 2**22) | st.none()


@given(st.text(), st.text(), st.text(), PROCESS, PROCESS)
def test_claims_are_heard_as_they_were_sent_and_those_of_two_processes_differ(
    name: str, host: str, other_host: str, process: int | None, other: int | None
) -> None:
    sent = claim(name, host, process)
    assert heard(sent) == sent
    if process is not None and other not in (process, None):
        assert sent != claim(name, other_host, other)


def test_a_claim_names_the_official_the_machine_and_the_process() -> None:
    assert claim('Anna', 'race-pc', 4711) == 'Anna (race-pc 4711)'
    assert claim('Anna', 'race-pc') == 'Anna (race-pc)'
    assert claim('', 'race-pc', 4711) == 'unnamed (race-pc 4711)'


def test_a_sentence_names_its_official_if_there_is_one() -> None:
    assert said_by('RED_FLAG is sent.', 'Anna') == 'RED_FLAG is sent. [Anna]'
    assert said_by('The race is in RED_FLAG.', '') == 'The race is in RED_FLAG.'
