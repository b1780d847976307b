# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A beam that a kart breaks: one crossing for each kart."""

from __future__ import annotations

from evgp_timing.contact import Contact, STUCK
from hypothesis import given
from hypothesis import strategies as st

DEBOUNCE = 0.2
BROKEN_OR_FREE = st.lists(st.tuples(st.floats(0.001, 1.0), st.booleans()), min_size=1, max_size=60)


@given(BROKEN_OR_FREE)
def test_a_kart_crosses_when_the_beam_was_free_for_long_enough(
    looks: list[tuple[float, bool]],
) -> None:
    contact, now = Contact(DEBOUNCE), 100.0
    last_broken, was_broken = now + looks[0][0], False  # it begins with the first look
    for after, broken in looks:
        now += after
        free = not was_broken and now - last_broken >= DEBOUNCE
        assert contact.look(broken, now) == (broken and free)
        last_broken, was_broken = now if broken else last_broken, broken


def test_a_beam_that_stays_broken_is_told_until_it_is_free() -> None:
    contact = Contact(DEBOUNCE)
    assert not contact.is_stuck(0.0)
    contact.look(False, 0.0)
    contact.look(True, 1.0)
    assert not contact.is_stuck(STUCK - 0.1)
    contact.look(True, STUCK)
    assert contact.is_stuck(STUCK)
    contact.look(False, STUCK + 1)
    assert not contact.is_stuck(STUCK + 1)
