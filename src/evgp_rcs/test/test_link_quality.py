# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""How good a link is, by times and counts alone."""

from __future__ import annotations

import dataclasses

from evgp_protocol.link import Grade, grade, GRADE_WINDOW, GRADES, TcpInfo
from evgp_rcs.rules.link_quality import BYTES_PER_SECOND, LinkMeter, LinkQuality, MEASURE_EVERY
from hypothesis import given
from hypothesis import strategies as st
import pytest

POOR, FAIR = GRADES[Grade.POOR], GRADES[Grade.FAIR]
SOME_TIMES = st.sampled_from((0.0, 0.05, FAIR, POOR, MEASURE_EVERY, GRADE_WINDOW))
TIMES = st.one_of(SOME_TIMES, st.floats(0.0, 30.0))


def info(retransmitted: int = 0) -> TcpInfo:
    return TcpInfo(0.04123456, retransmitted, 0.012)


@given(st.lists(st.tuples(TIMES, TIMES, TIMES), min_size=1, max_size=40))
def test_the_grade_goes_by_the_worst_answer_of_the_window(
    steps: list[tuple[float, float, float]],
) -> None:
    meter, now, all_answers = LinkMeter(0.0), 0.0, []
    for step, took, age in steps:
        now += step
        meter.answered(took, now)
        all_answers.append((now, took))
        quality = meter.measure(age, info(), now)
        in_window = [each for at, each in all_answers if now - at <= GRADE_WINDOW]
        assert quality.worst_answer == round(max(age, *in_window), 4)
        assert quality.grade is grade(quality.worst_answer)


@given(st.lists(st.tuples(st.floats(0.0, 2.0), TIMES, TIMES), max_size=40))
def test_a_link_that_gets_worse_is_measured_at_once_and_every_other_each_second(
    steps: list[tuple[float, float, float]],
) -> None:
    ranks = [*Grade]
    meter, now, at, known = LinkMeter(0.0), 0.0, 0.0, Grade.UNKNOWN
    for step, took, age in steps:
        now += step
        meter.answered(took, now)
        due = meter.is_due(age, now)
        quality = meter.measure(age, info(), now) if due else None
        if quality is None:
            assert now - at < MEASURE_EVERY
        elif now - at < MEASURE_EVERY:
            assert quality.grade not in (Grade.UNKNOWN, Grade.GOOD)
            assert ranks.index(quality.grade) > ranks.index(known)
        if quality is not None:
            at, known = now, quality.grade
        assert age < POOR or known is Grade.POOR


@pytest.mark.parametrize(
    ('windows', 'grades'),
    [
        ((5760, 2880, 5760, 2880), 'GGGG'),  # lwIP, of a kart that reads all there is
        ((5760, 4000, 2000, 500), 'GGPP'),  # the same, of one that leaves ever more unread
        ((5760, 500, 5760), 'GPG'),
        ((500, 500), 'GG'),  # a small window says nothing
    ],
)
def test_a_window_that_closes_shows_how_late_a_kart_reads(
    windows: tuple[int, ...], grades: str
) -> None:
    meter = LinkMeter(0.0)
    meter.answered(0.01, 0.05)
    seen = ''
    for second, window in enumerate(windows, 1):
        told = dataclasses.replace(info(), window=window)
        quality = meter.measure(0.0, told, float(second))
        seen += quality.grade.name[0]
        unread = (max(windows[:second]) - window) / BYTES_PER_SECOND
        assert quality.behind == (round(unread, 1) if quality.grade is Grade.POOR else 0.0)
    assert seen == grades


def test_a_kernel_that_tells_nothing_makes_no_figure_up() -> None:
    meter = LinkMeter(0.0)
    meter.answered(FAIR, 1.0)
    quality = meter.measure(0.0, None, 1.0)
    assert (quality.round_trip, quality.retransmitted) == (None, 0)
    # What race control measures itself is known all the same.
    assert quality.grade is Grade.FAIR


def test_figures_are_rounded_for_the_record() -> None:
    quality = LinkMeter(0.0).measure(0.0, info(7), 1.0)
    assert quality == LinkQuality(Grade.GOOD, 0.0, 0.0412, 7)
