# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What the console's questions say a command does, held against what the rules then do.

The race goes at random through the real rules; before each command that asks, the console sees
the race as it is then. All tests look at the same races.
"""

from __future__ import annotations

from collections.abc import Iterator
import pickle
import random
from typing import NamedTuple

from evgp_protocol.states import RaceState
from evgp_rcs.ros.node import _asked_for
from evgp_rcs.rules import inputs
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind, kinds_by_service
from evgp_rcs.rules.inputs import Setup
from evgp_rcs.rules.race import (
    Command,
    Doubt,
    Entrant,
    KartMemory,
    LastRun,
    NO_RACE_ANYWHERE,
    Race,
    RaceMemory,
    RaceTimes,
    Roster,
)
from evgp_rcs.rules.snapshot import KartSnapshot, Snapshot, snapshot_of
from evgp_rcs_console.client import request_message
from evgp_rcs_console.commands import Given, shows
from evgp_rcs_console.questions import Effects
from evgp_rcs_console.view import Button, Screen
import pytest
from recorded_races import PaperRace
from rig.seed import dice_of

WALKS = 60
STEPS = 40
NUMBERS = (1, 2, 3, 4, 7)
READ = Roster(tuple(Entrant(each, 'Another', True) for each in NUMBERS))
"""What the file of the roster says."""

NEXT = {
    RaceState.IN_GARAGE: CommandKind.GRID_ACTIVE,
    RaceState.GRID_ACTIVE: CommandKind.GREEN_GREEN,
    RaceState.GREEN_GREEN: CommandKind.KART_FINISH,
    RaceState.RED_FLAG: CommandKind.RACE_OVER,
    RaceState.RED_RED: CommandKind.IN_GARAGE,
}
"""What an official does next in a race."""

ASKING = [kind for kind in CommandKind if CATALOGUE[kind].asks]


LETS_HUMANS_NEAR = (
    CommandKind.IN_GARAGE,
    CommandKind.KART_IN_GARAGE,
    CommandKind.OPEN_TRACK,
)

CONFIRMS_ALSO = {CommandKind.KART_IN_GARAGE, CommandKind.OPEN_TRACK}
"""What the question of IN GARAGE also offers: after the MSR was used, or otherwise."""


def received(given: Given) -> Command:
    """Return a console's command as race control receives it."""
    kinds = kinds_by_service()[CATALOGUE[given.command].service]
    return _asked_for(kinds, request_message(given))._replace(roster=READ)


class Question(NamedTuple):
    """
    A command that asks and can be given: what the window says that it does, and the race it is in.

    ``shown`` is that race as the console sees it; ``race`` is pickled, since it goes on.
    """

    button: Button
    said: Effects
    shown: Snapshot
    race: bytes
    now: float


class Walk(PaperRace):
    """A race that goes where the chance lead it."""

    def __init__(self, chance: random.Random) -> None:
        """Begin in the garage, some karts in the race."""
        self.chance = chance
        karts = tuple(Entrant(each, f'T{each}', chance.random() < 0.6) for each in NUMBERS)
        super().__init__({}, setup=Setup(karts, RaceTimes(finish_delays=(0.5,)), (), 1.0))
        if chance.random() < 0.3:
            last = chance.choice([*LastRun])
            self.feed(inputs.Recovered(self.now, self._left_behind(), last))
        self.connect(*(number for number in NUMBERS if chance.random() < 0.8))

    def _left_behind(self) -> RaceMemory:
        """Return what a race control that was killed may have left."""

        def perhaps() -> bool:
            return self.chance.random() < 0.5

        karts = {
            number: KartMemory(perhaps(), perhaps(), 0, self.chance.choice(list(Doubt)), perhaps())
            for number in NUMBERS
        }
        return RaceMemory(self.chance.choice(list(RaceState)), karts, perhaps(), perhaps())

    def step(self) -> None:
        """Do one thing, most often what a race is made of."""
        chance, number = self.chance, self.chance.choice(NUMBERS)
        self.now += chance.choice((0.1, 0.1, 1.0, 20.0))
        what = chance.random()
        if what < 0.2:
            self.connect(number)
        elif what < 0.27:
            self.lose(number)
        elif what < 0.55:
            for each in NUMBERS:
                if chance.random() < 0.9:
                    self.say(each)
        elif what < 0.6:
            self.say(number, chance.choice(list(RaceState)))
        elif what < 0.65:
            self.feed(inputs.Tick(self.now))
        else:
            usual = chance.random() < 0.5
            kind = NEXT[self.race.state] if usual else chance.choice(list(CommandKind))
            kart = number if CATALOGUE[kind].to_one_kart else 0
            answer = self.command(kind, kart, roster=READ).answer
            assert answer is not None
            if answer.success:  # the console sees its result in the race
                shown = snapshot_of(self.race, self.now)
                assert shows(shown, Given(kind, kart)), (kind, answer)

    def questions(self) -> Iterator[Question]:
        """Yield every command that asks and can be given now."""
        race, shown = pickle.dumps(self.race), snapshot_of(self.race, self.now)
        for button in Screen(shown, 0.0, {}).buttons:
            if button.command in ASKING and button.enabled:
                yield Question(button, button.question.effects, shown, race, self.now)


def numbers(karts: tuple[KartSnapshot, ...]) -> set[int]:
    return {kart.number for kart in karts}


@pytest.fixture(scope='module')
def chance(request: pytest.FixtureRequest) -> random.Random:
    """Return the chance of all these tests."""
    return dice_of(request)


@pytest.fixture(scope='module')
def questions(chance: random.Random) -> list[Question]:
    """Return every question on the way of some races, and of more if a situation is missing."""
    asked: list[Question] = []
    for number in range(10 * WALKS):
        if number >= WALKS and has_all(asked):
            break
        walk = Walk(chance)
        for _ in range(STEPS):
            walk.step()
            asked += walk.questions()
    return asked


def has_all(questions: list[Question]) -> bool:
    """Return whether there is every situation that a test here is about."""
    asked = {each.button.command for each in questions}
    let_near = {
        each.shown.track.allowed for each in questions if each.button.command in LETS_HUMANS_NEAR
    }
    return asked == set(ASKING) and False in let_near and offered(questions) == CONFIRMS_ALSO


def offered(questions: list[Question]) -> set[object]:
    """Return what an official could confirm together with a question's own command."""
    return {each.command for question in questions for each in question.button.also}


def check(question: Question) -> None:
    """Give the command and compare what it does to each kart with what the question said."""
    button, said, shown, pickled, now = question
    race: Race = pickle.loads(pickled)  # noqa: S301 - from above
    before = {kart.number: (kart.sent, kart.hold) for kart in race.karts.values()}

    outcome = race.command(received(button.gives), now)
    assert outcome.answer is not None
    assert outcome.answer.success, outcome.answer.message
    after = {kart.number: (kart.sent, kart.hold) for kart in race.karts.values()}
    at_once, later, held, rest = map(numbers, (said.now, said.later, said.held, said.rest))
    assert sorted([*at_once, *later, *held, *rest]) == sorted(NUMBERS), 'each is named once'
    changed = {number for number in NUMBERS if before[number] != after[number]}
    sent = {order.kart for order in outcome.orders}
    if button.command is CommandKind.RECORD_MSR:
        assert changed <= at_once | later  # who was stopped already is sent the same again
        assert sent <= at_once
    else:
        assert changed == at_once | later
        assert sent == at_once
    for number in at_once | later:
        assert after[number][0].value == CATALOGUE[button.command].sends.value
    assert all(race.karts[number].connected for number in at_once)
    assert not any(race.karts[number].connected for number in later)
    assert all(after[number][1] is not None for number in held)
    assert all(after[number][1] is None for number in rest - changed)
    said = '\n'.join(button.question.consequences)
    for number in NUMBERS:
        assert f'{number}' in said or button.kart or not at_once | later
    for also in button.also:
        answer = race.command(received(also), now).answer
        assert answer.success, answer.message
    if button.command is CommandKind.IN_GARAGE and shown.track.msr_used:
        assert not any(kart.hold for kart in race.karts.values()), 'each was made safe by hand'


def test_a_question_says_what_each_kart_is_sent_and_what_it_also_offers_is_accepted(
    questions: list[Question],
) -> None:
    asked: dict[CommandKind, int] = dict.fromkeys(ASKING, 0)
    for question in questions:
        asked[question.button.command] += 1
        check(question)
    print(asked)
    assert all(asked.values()), asked
    assert offered(questions) == CONFIRMS_ALSO


def test_a_question_that_lets_humans_near_says_what_the_screen_says_against_it(
    questions: list[Question],
) -> None:
    against = 0
    for button, _, shown, _, _ in questions:
        if button.command not in LETS_HUMANS_NEAR:
            continue
        if shown.state in (RaceState.GRID_ACTIVE, RaceState.GREEN_GREEN):
            continue  # that a race is under way is nothing wrong
        if not shown.track.allowed and shown.track.settled_by is not None:
            # One command settles that: it is stated there, and no warning.
            settles = button.command is shown.track.settled_by
            assert (NO_RACE_ANYWHERE in button.question.condition) is settles
            assert (shown.track.reason in button.question.warning) is not settles
        elif not shown.track.allowed:
            against += 1
            assert shown.track.reason in button.question.warning
            assert shown.track.reason not in button.question.condition
        elif not shown.track.msr_used:
            nobody_connected = not any(kart.connected for kart in shown.karts)
            assert bool(button.question.warning) is nobody_connected
    assert against
