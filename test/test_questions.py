# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What the console's questions say a command does, held against what the rules then do.

The race goes at random through the real rules; before each command that asks, the console sees
the race as it is then.
"""

from __future__ import annotations

import copy
import random

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
    RaceMemory,
    RaceTimes,
    Roster,
)
from evgp_rcs.rules.snapshot import Snapshot, snapshot_of
from evgp_rcs_console.client import request_message
from evgp_rcs_console.commands import Given, shows
from evgp_rcs_console.view import Button, Screen
from recorded_races import PaperRace

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

ASKING = {kind for kind in CommandKind if CATALOGUE[kind].asks}
LETS_HUMANS_NEAR = CommandKind.IN_GARAGE, CommandKind.KART_IN_GARAGE, CommandKind.OPEN_TRACK
CONFIRMS_ALSO = {CommandKind.KART_IN_GARAGE, CommandKind.OPEN_TRACK}
"""What the question of IN GARAGE also offers: after the MSR was used, or otherwise."""


def received(given: Given) -> Command:
    """Return a console's command as race control receives it."""
    kinds = kinds_by_service()[CATALOGUE[given.command].service]
    return _asked_for(kinds, request_message(given))._replace(roster=READ)


class Walk(PaperRace):
    """A race that goes where the chance lead it."""

    def __init__(self, chance: random.Random) -> None:
        """Begin in the garage, some karts in the race."""
        self.chance = chance
        karts = tuple(Entrant(each, f'T{each}', chance.random() < 0.6) for each in NUMBERS)
        super().__init__({}, setup=Setup(karts, RaceTimes(finish_delays=(0.5,)), (), 1.0))
        begins = chance.random()
        if begins < 0.3:
            last = chance.choice([*LastRun])
            self.feed(inputs.Recovered(self.now, self._left_behind(), last))
        elif begins < 0.5:  # this machine has no record yet
            self.feed(inputs.Recovered(self.now, None, LastRun.NONE))
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


def check_effects(button: Button, walk: Walk, shown: Snapshot) -> None:
    """Give a command to a copy of the race, and compare what it does with what was said."""
    race, said = copy.deepcopy(walk.race), button.question.effects
    before = {kart.number: (kart.sent, kart.hold) for kart in race.karts.values()}

    outcome = race.command(received(button.gives), walk.now)
    assert outcome.answer is not None
    assert outcome.answer.success, outcome.answer.message
    after = {kart.number: (kart.sent, kart.hold) for kart in race.karts.values()}
    parts = said.now, said.later, said.held, said.rest
    at_once, later, held, rest = ({kart.number for kart in part} for part in parts)
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
    consequences = '\n'.join(button.question.consequences)
    for number in NUMBERS:
        assert f'{number}' in consequences or button.kart or not at_once | later
    for also in button.also:
        answer = race.command(received(also), walk.now).answer
        assert answer is not None
        assert answer.success, answer.message
    if button.command is CommandKind.IN_GARAGE and shown.track.msr_used:
        assert not any(kart.hold for kart in race.karts.values()), 'each was made safe by hand'


def check_warning(button: Button, shown: Snapshot) -> bool:
    """
    Check that a question that lets humans near says what the screen says against it.

    :return: whether the screen says something against it.
    """
    under_way = shown.state in (RaceState.GRID_ACTIVE, RaceState.GREEN_GREEN)
    track, asked = shown.track, button.question
    if button.command not in LETS_HUMANS_NEAR or under_way:  # which is nothing wrong
        return False
    if not track.allowed and track.settled_by is not None:
        # In the question of the command that settles that, it is stated, and is no warning.
        settles = button.command is track.settled_by
        assert (NO_RACE_ANYWHERE in asked.condition) is settles
        assert (track.reason in asked.warning) is not settles
        return False
    if not track.allowed:
        assert track.reason in asked.warning
        assert track.reason not in asked.condition
    elif not track.msr_used:
        assert bool(asked.warning) is not any(kart.connected for kart in shown.karts)
    return not track.allowed


def test_a_question_says_what_each_kart_is_sent_and_what_it_also_offers_is_accepted(
    chance: random.Random,
) -> None:
    asked, offered, against, walks = set(), set(), 0, 0
    while walks < WALKS or not (asked == ASKING and offered == CONFIRMS_ALSO and against):
        assert walks < 10 * WALKS, (asked, offered, against)
        walks += 1
        walk = Walk(chance)
        for _ in range(STEPS):
            walk.step()
            shown = snapshot_of(walk.race, walk.now)
            for button in Screen(shown, 0.0, {}).buttons:
                if button.command in ASKING and button.enabled:
                    asked.add(button.command)
                    offered |= {each.command for each in button.also}
                    against += check_warning(button, shown)
                    check_effects(button, walk, shown)
