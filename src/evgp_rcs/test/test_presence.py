# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Who is there to stop the race, by what programs say and when."""

from __future__ import annotations

from dataclasses import dataclass

from evgp_rcs.ros.node import PRESENCE_QOS
from evgp_rcs.ros.presence import (
    BUTTON,
    MOST_PROGRAMS,
    Presences,
    SILENT_AFTER,
    TIMEKEEPER,
)
from hypothesis import given
from hypothesis import strategies as st
import pytest
from rclpy.duration import Duration
from rclpy.qos import LivelinessPolicy, qos_check_compatible, QoSCompatibility, QoSProfile


@dataclass
class Word:
    """What a program says."""

    id: str = 'one'  # noqa: A003 - the field's name
    program: str = 'rcs_gui'
    official: str = ''
    fault: str = ''


def button(name: str, fault: str = '') -> Word:
    """Return what a stop button says."""
    return Word(name, BUTTON, fault=fault)


@pytest.fixture
def presences() -> Presences:
    return Presences()


def test_a_program_counts_until_it_says_nothing_for_so_long(presences: Presences) -> None:
    presences.hear(Word('a'), 10.0)
    presences.hear(Word('a', official='Anna'), 10.0)  # who gives her name later
    presences.hear(Word('b', 'rcs_ctl'), 11.0)

    assert presences.attendance(11.9)[:2] == (2, 'Anna (window), terminal')
    assert presences.attendance(12.0)[:2] == (1, 'terminal')
    assert presences.attendance(13.0)[:2] == (0, '')


@pytest.mark.parametrize(
    'liveliness', [LivelinessPolicy.AUTOMATIC, LivelinessPolicy.MANUAL_BY_TOPIC]
)
def test_a_program_is_heard_whatever_its_publisher_offers(liveliness: LivelinessPolicy) -> None:
    lease = Duration(seconds=2)
    offered = QoSProfile(depth=10, liveliness=liveliness, liveliness_lease_duration=lease)
    assert qos_check_compatible(offered, PRESENCE_QOS) == (QoSCompatibility.OK, '')


def test_a_fault_that_lasts_counts_as_silence_and_one_that_is_over_does_not(
    presences: Presences,
) -> None:
    presences.hear(Word(fault='race control is not found yet'), 10.0)
    assert presences.attendance(10.0).able_to_stop == 0
    presences.hear(Word(), 10.0)
    presences.hear(Word(fault='race control is gone'), 11.0)
    assert presences.attendance(11.9).able_to_stop == 1
    presences.hear(Word(fault='race control is gone'), 11.9)
    assert presences.attendance(12.0).able_to_stop == 0
    presences.hear(Word(), 12.5)
    assert presences.attendance(12.5).able_to_stop == 1


def test_the_timekeeper_never_counts(presences: Presences) -> None:
    presences.hear(Word(program=TIMEKEEPER), 10.0)
    assert presences.attendance(10.0) == (0, '', '')


def test_an_official_who_signs_as_timekeeper_counts(presences: Presences) -> None:
    presences.hear(Word('a', BUTTON, TIMEKEEPER), 10.0)
    assert presences.attendance(10.0).able_to_stop == 1
    assert f'{TIMEKEEPER} (button)' in presences.attendance(13.0).button_fault


def test_a_button_with_a_fault_is_told_until_it_works_again(presences: Presences) -> None:
    presences.hear(button('a'), 10.0)
    presences.hear(button('a', 'unplugged'), 11.0)
    assert 'unplugged' in presences.attendance(11.0).button_fault
    presences.hear(button('a'), 11.5)
    assert not presences.attendance(11.5).button_fault


def test_a_button_that_is_gone_is_missed_until_another_is_started_in_its_place(
    presences: Presences,
) -> None:
    presences.hear(button('a'), 10.0)
    presences.hear(button('b'), 10.0)
    presences.hear(button('b'), 11.5)
    assert presences.attendance(12.5).button_fault
    presences.hear(button('b'), 13.0)
    assert presences.attendance(100.0).button_fault
    presences.hear(button('c'), 100.0)
    assert presences.attendance(100.0).button_fault, 'one of two is still missing'
    presences.hear(button('d'), 100.0)
    assert not presences.attendance(100.0).button_fault


def test_a_button_that_is_back_before_it_was_missed_is_never_missed(presences: Presences) -> None:
    presences.hear(button('a'), 10.0)
    presences.hear(button('b'), 10.5)
    for at in (11.5, 12.5, 13.5):
        presences.hear(button('b'), at)
        assert not presences.attendance(at).button_fault


WORDS = st.builds(
    Word,
    id=st.text(max_size=3) | st.sampled_from('ab'),
    program=st.sampled_from((BUTTON, 'rcs_gui', '')) | st.text(),
    official=st.text(),
    fault=st.just('') | st.text(),
)


@given(st.lists(st.tuples(WORDS, st.floats(0.0, 3.0)), max_size=30))
def test_whatever_is_said_what_is_told_is_short_and_nobody_counts_who_was_silent(
    said: list[tuple[Word, float]],
) -> None:
    presences = Presences()
    now = 0.0
    for word, step in said:
        now += step
        presences.hear(word, now)
        found = presences.attendance(now)
        assert (found.able_to_stop > 0) == bool(found.who_can_stop)
        assert len(found.who_can_stop) < 300
        assert len(found.button_fault) < 1000
        assert found.who_can_stop.isprintable()
        assert found.button_fault.isprintable()
    assert not presences.attendance(now + SILENT_AFTER + 0.001).able_to_stop


def test_buttons_that_are_gone_keep_no_window_from_being_heard(presences: Presences) -> None:
    for number in range(MOST_PROGRAMS):
        presences.hear(button(f'button {number}'), 10.0)

    assert not presences.hear(Word('early'), 10.5)
    assert presences.hear(Word('late'), 10.0 + SILENT_AFTER)
    assert presences.attendance(10.0 + SILENT_AFTER)[:2] == (1, 'window')


def test_a_window_that_is_gone_gives_way_and_not_the_button_that_officials_miss(
    presences: Presences,
) -> None:
    presences.hear(button('button'), 10.0)
    for number in range(1, MOST_PROGRAMS):
        presences.hear(Word(str(number)), 10.0)
    later = 10.0 + SILENT_AFTER

    assert presences.hear(Word('new'), later)
    assert presences.attendance(later).button_fault
