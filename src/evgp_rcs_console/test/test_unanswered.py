# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The commands that the window has sent, until they are answered."""

from __future__ import annotations

from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs_console.commands import Given, LATE, Standing, Unanswered


def test_the_answer_to_an_older_press_leaves_the_newer_one_waiting() -> None:
    unanswered = Unanswered()
    older, newer = (Given(CommandKind.RACE_OVER, at=at) for at in (1.0, 2.0))
    for given in (older, newer):
        unanswered.add(given)

    unanswered.answered(older)
    assert unanswered.ages(5.0) == {(CommandKind.RACE_OVER, 0): 3.0}
    unanswered.answered(newer)
    assert not unanswered


def test_of_several_commands_the_one_that_has_waited_longest_is_told_once_it_is_late() -> None:
    unanswered = Unanswered()
    older, newer = Given(CommandKind.RACE_OVER, at=1.0), Given(CommandKind.JOIN_RACE, 7, at=1.1)
    unanswered.add(newer)
    unanswered.add(older)

    assert unanswered.oldest(1.0 + LATE / 2) is None
    assert unanswered.oldest(2.0) is older


def test_stops_are_told_once_they_are_late() -> None:
    unanswered = Unanswered()
    kill = Standing(Given(CommandKind.ALL_KILL), since=1.0)
    flag = Standing(Given(CommandKind.RED_FLAG), since=2.0)
    unanswered.stops = (kill, flag)

    late = [unanswered.late_stops(since + LATE / 2) for since in (1.0, 2.0, 3.0)]
    assert late == [[], [kill], [kill, flag]]
