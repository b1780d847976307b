# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The score sheet: what counts as right, needless and wrong, by fields and by the truth."""

from __future__ import annotations

from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import Event, EventKind, StampedEvent
from evgp_rehearsal.field import TICK_LENGTH
from evgp_rehearsal.incidents import INCIDENTS
from evgp_rehearsal.score import Line, Occurrence, score, STEWARD, Truth
import pytest

MOVES = ((0, 1, True), (0, 2, True))


def sheet(
    incident: str,
    *commands: tuple[float, str, int],
    moving: tuple[tuple[int, int, bool], ...] = MOVES,
    crossed: tuple[tuple[int, int], ...] = (),
    msr: tuple[int, ...] = (),
    official: str = 'Anna',
    accepted: bool = True,
) -> Line:
    """Return the line for commands, each with its time after the beginning, in seconds."""
    events = [
        StampedEvent(
            at,
            0,
            5.0 + seconds,
            Event(
                EventKind.COMMAND,
                '',
                kart,
                command=CommandKind[kind],
                success=accepted,
                official=official,
            ),
        )
        for at, (seconds, kind, kart) in enumerate(commands, start=1)
    ]
    kart = 1 if INCIDENTS[incident].to_kart else 0
    took = Occurrence(incident, kart, round(5 / TICK_LENGTH), round(100 / TICK_LENGTH))
    (line,) = score([took], events, Truth(moving, crossed, msr))
    return line


def test_the_first_right_command_gives_the_time() -> None:
    line = sheet('kart_stuck', (3.1, 'KART_RED_RED', 1), (9.0, 'KART_RED_FLAG', 1))
    assert line.passed
    assert line.first_right == 3.5
    assert line.at == 5.0


def test_a_right_command_that_comes_late_does_not_pass() -> None:
    line = sheet('kart_stuck', (31.0, 'KART_RED_RED', 1))
    assert line.first_right == 31.0
    assert not line.passed


def test_a_stop_of_more_karts_than_needed_is_needless_and_says_whom_it_stopped() -> None:
    line = sheet('kart_stuck', (1.0, 'KART_RED_RED', 1), (2.0, 'ALL_KILL', 0))
    assert line.needless == ('ALL_KILL',)
    assert line.stopped == (2,)
    assert not line.passed


def test_an_msr_that_was_recorded_and_not_used_is_wrong() -> None:
    assert sheet('msr_needed', (1.0, 'RECORD_MSR', 0)).wrong == ('RECORD_MSR',)
    used = (round(5.5 / TICK_LENGTH),)
    assert sheet('msr_needed', (1.0, 'RECORD_MSR', 0), msr=used).passed


def test_the_score_goes_by_when_the_official_acted_not_by_when_the_instructor_clicked() -> None:
    late = (round(12.0 / TICK_LENGTH),)
    line = sheet('person_on_track', (1.0, 'ALL_KILL', 0), (1.5, 'RECORD_MSR', 0), msr=late)
    assert line.passed
    assert (line.first_right, line.solved) == (1.0, 1.5)


def test_an_msr_that_was_called_for_in_time_may_be_recorded_later() -> None:
    early = (round(6.0 / TICK_LENGTH),)
    line = sheet('person_on_track', (14.0, 'RECORD_MSR', 0), msr=early)
    assert line.passed
    assert line.solved == 1.0
    assert not sheet('person_on_track', msr=early).passed  # never recorded


def test_doing_nothing_for_25_s_with_a_person_among_karts_fails() -> None:
    used = (round(31.0 / TICK_LENGTH),)
    line = sheet('person_on_track', (25.0, 'ALL_KILL', 0), (26.5, 'RECORD_MSR', 0), msr=used)
    assert not line.passed
    assert not line.wrong


@pytest.mark.parametrize('command', ['OPEN_TRACK', 'IN_GARAGE'])
def test_letting_people_in_while_a_kart_moves_is_wrong_and_counted(command: str) -> None:
    line = sheet('spin', (1.0, 'RED_FLAG', 0), (2.0, command, 0))
    assert line.wrong == (command,)
    assert line.people == 1


@pytest.mark.parametrize('command', ['OPEN_TRACK', 'IN_GARAGE'])
def test_letting_people_in_once_all_stand_is_fine(command: str) -> None:
    stands = (*MOVES, (130, 1, False), (140, 2, False))
    line = sheet('spin', (1.0, 'RED_FLAG', 0), (9.0, command, 0), moving=stands)
    assert line.passed


def test_a_kart_that_starts_while_the_track_is_open_is_counted() -> None:
    begins = (*MOVES, (110, 1, False), (110, 2, False), (400, 1, True))
    line = sheet('spin', (0.5, 'RED_FLAG', 0), (3.0, 'OPEN_TRACK', 0), moving=begins)
    assert line.people == 1
    assert not line.passed


def test_finishes_must_be_in_the_order_of_the_line() -> None:
    crossed = ((120, 1), (130, 2))
    good = sheet('slow_leader', (2.0, 'KART_FINISH', 1), (2.5, 'KART_FINISH', 2), crossed=crossed)
    assert good.passed
    swapped = sheet(
        'slow_leader', (2.0, 'KART_FINISH', 2), (2.5, 'KART_FINISH', 1), crossed=crossed
    )
    assert swapped.wrong == ('KART_FINISH 2',)
    early = sheet('slow_leader', (0.5, 'KART_FINISH', 1), crossed=crossed)
    assert early.wrong == ('KART_FINISH 1',)


def test_a_release_before_the_incident_is_dealt_with_is_wrong_even_where_refused() -> None:
    line = sheet('false_start', (1.0, 'GREEN_GREEN', 0), accepted=False)
    assert line.wrong == ('GREEN_GREEN (refused)',)


def test_what_the_rehearsal_itself_commands_is_not_judged() -> None:
    line = sheet('kart_stuck', (1.0, 'ALL_KILL', 0), official=STEWARD)
    assert line == sheet('kart_stuck')


def test_commands_at_other_instants_of_one_tick_give_the_same_line() -> None:
    assert sheet('spin', (1.001, 'RED_FLAG', 0)) == sheet('spin', (1.019, 'RED_FLAG', 0))
