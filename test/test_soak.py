# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The soak: a short one of the real race control, and proof that its judge finds faults."""

from __future__ import annotations

import ast
import dataclasses
import os
import pathlib
import random
import re
import shutil
import subprocess
import sys
from types import ModuleType
from typing import Any

import evgp_rcs
from evgp_rcs.rules import race as rules
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind, Result
from evgp_testing import judge as judge_module
from evgp_testing.judge import Call, Judge
import pytest
from rig.faults import faults_in, module_with, tree_with
from test_race_faults import FAULTS as SOWN

ROOT = pathlib.Path(__file__).resolve().parents[1]
KARTS = range(1, 6)

KINDS = [
    kind
    for kind in CommandKind
    if kind not in (CommandKind.SET_HEAT, CommandKind.OPEN_TRACK, CommandKind.CLOSE_TRACK)
]
"""The commands that the simulation gives; it has no heats, and nobody on its track."""


FOUND_BY = {
    'what was said before the command is an acknowledgement': (
        'not acknowledged, looser than a stop, held on the grid, not stated'
    ),
    'anything said under the present serial is an acknowledgement': (
        'not acknowledged, looser than a stop, held on the grid, not stated'
    ),
    'an acknowledgement survives the connection': (
        'not connected, looser than a stop, held on the grid, not stated'
    ),
    'a stop is announced as allowed, and refused': 'stop refused',
    'ALL_KILL forgets the karts outside the race': 'looser than a stop, held on the grid',
    'a kart that drops is held in RED_FLAG only': 'lost in the race',
    'GREEN_GREEN while a kart is not connected': (
        'not connected, not acknowledged, unexplained GREEN_GREEN'
    ),
    'GREEN_GREEN while a kart has not acknowledged': 'not acknowledged, not connected',
    'GREEN_GREEN after another command than GRID_ACTIVE': 'GRID_ACTIVE not last',
    'IN_GARAGE releases a kart that never acknowledged its red': (
        'looser than a stop, held on the grid'
    ),
    'GRID_ACTIVE while a kart is held': 'held on the grid, not acknowledged',
    'a kart released during a race goes on with the race': (
        'impossible change, looser than a stop, unexplained GREEN_GREEN'
    ),
    'a later hold loosens an earlier one': 'looser than a stop, impossible change',
}
"""Faults that the oracle's search finds, and the rules one of which the judge must name."""

FAULTS = {
    **{name: SOWN[name]._replace(breaks=tuple(by.split(', '))) for name, by in FOUND_BY.items()},
    **faults_in(
        """
GRID_ACTIVE from a race under way: not from the garage, impossible change, looser than a stop
    COMMANDS: GRID_ACTIVE states IN_GARAGE #1 => (IN_GARAGE, GRID_ACTIVE, RED_FLAG, RED_RED)
a kart outside the race races: outside the race
    _commanded: state in_race => self.state
"""
    ),
}


class Simulation:
    """
    The rules of the race and a wire that is only thought, at random, in a time of its own.

    :param module: the rules, right or with a fault.
    """

    def __init__(self, module: ModuleType, seed: int) -> None:
        """Begin with every kart connected."""
        self.rng = random.Random(seed)
        self.module = module
        self.now = 100.0
        in_race = {1, 2, 3}
        self.race = module.Race(
            [module.Kart(number=number, in_race=number in in_race) for number in KARTS],
            module.RaceTimes(finish_delays=(0.5,), finish_stop=2.0, pause=0.0, settle=0.0),
            self.now,
        )
        self.judge = Judge(in_race, set(KARTS) - in_race, self.now)
        self.links: dict[int, int] = {}
        self.sent: dict[int, tuple[Any, int]] = {}
        self.on_the_way: list[tuple[int, int, int, Any]] = []
        self.opened = 0
        for kart in KARTS:
            self.connect(kart)

    def run(self, steps: int) -> None:
        """Let random things happen, and judge them; end at the first violation."""
        for _ in range(steps):
            self.now += self.rng.choice((0.001, 0.01, 0.1, 0.1, 1.0))
            self.step()
            self.deliver(self.race.tick(self.now))
            for kart in self.links:
                if self.rng.random() < 0.5:
                    self.hear(kart)
            self.judge.judge(self.now)
            if self.judge.violations:
                return
        self.judge.finish()

    def step(self) -> None:
        kart = self.rng.choice(KARTS)
        what = self.rng.random()
        if what < 0.45:
            for number in KARTS:
                if self.rng.random() < 0.8:
                    self.say(number, self.rng.random() < 0.85)
        elif what < 0.5:
            self.disconnect(kart)
        elif what < 0.58:
            self.connect(kart)
        elif what < 0.9:
            self.bring_on()
        else:
            self.command(self.rng.choice(KINDS), kart, self.rng.random() < 0.5)
        if self.on_the_way and self.rng.random() < 0.3:
            number, link, serial, state = self.on_the_way.pop(0)
            if self.links.get(number) == link:
                self.deliver(self.race.heard(number, serial, state, self.now))

    def bring_on(self) -> None:
        """Give the command that most likely brings the race on."""
        state = self.race.state.value
        if state == 'IN_GARAGE':
            for kart in list(self.race.racing()):
                if kart.may_be_moving and kart.hold is None:
                    self.command(CommandKind.KART_RED_RED, kart.number, False)
                if kart.hold is not None and self.rng.random() < 0.7:
                    self.command(CommandKind.KART_IN_GARAGE, kart.number, True)
            if self.rng.random() < 0.2:
                self.command(CommandKind.JOIN_RACE, self.rng.choice(KARTS), True)
            self.command(CommandKind.GRID_ACTIVE, None, True)
        elif state == 'GRID_ACTIVE':
            self.command(CommandKind.GREEN_GREEN, None, False)
        elif state == 'GREEN_GREEN' and self.rng.random() < 0.5:
            self.command(
                self.rng.choice(
                    (CommandKind.RED_FLAG, CommandKind.RACE_OVER, CommandKind.ALL_KILL)
                ),
                None,
                False,
            )
        elif state == 'RED_FLAG':
            self.command(CommandKind.RACE_OVER, None, False)
        elif state == 'RED_RED':
            self.command(CommandKind.IN_GARAGE, None, True)
            for kart in list(self.race.racing()):
                # Who is lost, or stays silent, is made safe by hand.
                silent = self.race.state.value == 'RED_RED' and not kart.acknowledged
                if silent and self.rng.random() < 0.1:
                    self.command(CommandKind.KART_IN_GARAGE, kart.number, True)

    def command(self, kind: CommandKind, kart: int | None, statement: bool) -> None:
        entry = CATALOGUE[kind]
        kart = kart if entry.to_one_kart else None
        statement = statement or entry.call_is_statement
        call = Call(kind, kart, statement, self.now)
        self.judge.called(call)
        module = self.module
        hold = self.race.karts[kart].hold if kart else None
        seen = frozenset(self.race.availability(kind, kart or 0, self.now).karts)
        outcome = self.race.command(
            module.Command(kind, kart or 0, statement, seen, hold, opening=self.race.opening),
            self.now,
        )
        if outcome.start is not None:
            outcome = self.race.start_saved(True, outcome.start.number, self.now)
        self.deliver(outcome)
        call.ended = self.now + 0.0005
        call.success, call.message = outcome.answer.success, outcome.answer.message
        self.judge.answered(call)

    def connect(self, kart: int) -> None:
        self.opened += 1
        if kart in self.links:
            self.judge.closed(self.links[kart], self.now, self.now)
        self.links[kart] = self.opened
        self.judge.opened(self.opened, kart, self.now)
        self.deliver(self.race.connected(kart, self.now))

    def disconnect(self, kart: int) -> None:
        if kart in self.links:
            self.judge.closed(self.links.pop(kart), self.now, self.now)
            self.deliver(self.race.disconnected(kart, 'it was closed', self.now))

    def say(self, kart: int, right: bool) -> None:
        if kart not in self.links:
            return
        state, serial = self.sent[kart]
        if not right:
            state = self.rng.choice(list(self.module.RaceState))
        self.judge.said(self.links[kart], state.value, self.now, self.now)
        if not right and self.rng.random() < 0.5:
            # It is heard later, maybe behind a command that this kart has not seen.
            self.on_the_way.append((kart, self.links[kart], serial, state))
        else:
            self.deliver(self.race.heard(kart, serial, state, self.now))

    def deliver(self, outcome: Any) -> None:
        for order in outcome.orders:
            self.sent[order.kart] = order.state, order.serial
            self.hear(order.kart)

    def hear(self, kart: int) -> None:
        state = self.sent[kart][0].value
        self.judge.frame(self.links[kart], state, self.now - 0.0001, self.now + 0.0001)


def run_soak(
    *arguments: str, before_on_path: pathlib.Path | None = None
) -> subprocess.CompletedProcess[str]:
    path = [str(before_on_path)] if before_on_path else []
    return subprocess.run(
        [sys.executable, str(ROOT / 'soak' / 'run.py'), *arguments],
        env={**os.environ, 'PYTHONPATH': os.pathsep.join([*path, os.environ['PYTHONPATH']])},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=100,
    )


@pytest.mark.parametrize('seconds', [6, pytest.param(12, marks=pytest.mark.long)])
def test_race_control_breaks_no_rule_in_a_short_soak(seconds: int, chance: random.Random) -> None:
    seed = chance.randrange(1_000_000)
    # Of the faults that come while a race is planned, one in twenty is let through.
    often = '--fault-every', '0.5'
    done = run_soak('--seconds', str(seconds), '--karts', '20', '--seed', str(seed), *often)

    assert done.returncode == 0, done.stdout
    assert f'seed {seed}, 20 karts' in done.stdout
    assert re.search(r'^violations +0$', done.stdout, re.MULTILINE), done.stdout
    assert re.search(r'^replay +[1-9].*; no difference', done.stdout, re.MULTILINE), done.stdout
    for counted in ('frames sent to karts', 'frames said by karts', 'faults injected', 'commands'):
        assert re.search(rf'^{counted} +[1-9]', done.stdout, re.MULTILINE), done.stdout
    assert re.search(r'memory of rcs_node +[\d.]+ MiB, then [\d.]+ MiB', done.stdout)


@pytest.mark.long
def test_a_race_control_with_a_fault_does_not_pass_the_soak(
    chance: random.Random, tmp_path: pathlib.Path
) -> None:
    # Each ALL_KILL shows it, however far the races get on a busy computer.
    fault = FAULTS['ALL_KILL forgets the karts outside the race']
    package = pathlib.Path(evgp_rcs.__path__[0])
    changed = tmp_path / 'evgp_rcs'
    shutil.copytree(package, changed, ignore=shutil.ignore_patterns('__pycache__'))
    faulty = ast.unparse(tree_with(rules, fault))
    (changed / 'rules' / 'race.py').write_text(faulty, encoding='utf-8')

    done = run_soak(
        *('--seconds', '60', '--karts', '12', '--until-violation'),
        *('--seed', str(chance.randrange(1_000_000))),
        before_on_path=tmp_path,
    )

    assert done.returncode == 1, done.stdout
    assert any(f'{rule}: ' in done.stdout for rule in fault.breaks), done.stdout


@pytest.mark.parametrize('seed', range(6))
def test_the_judge_raises_no_false_alarm(seed: int) -> None:
    simulation = Simulation(rules, seed)

    simulation.run(3000)

    assert simulation.judge.violations == []
    assert simulation.judge.judged['frame'] > 3000


@pytest.mark.parametrize('name', FAULTS)
def test_the_judge_finds_a_fault_in_the_rules(name: str) -> None:
    fault = FAULTS[name]
    module = module_with(rules, fault)
    for seed in range(30):
        simulation = Simulation(module, seed)
        simulation.run(1500)
        if simulation.judge.violations:
            break

    assert simulation.judge.violations, 'it was not found'
    assert simulation.judge.violations[0].rule in fault.breaks


def test_a_frame_to_somebody_who_is_not_in_the_roster_is_a_violation() -> None:
    judge = Judge({1}, {2}, 0.0)

    judge.stranger('127.0.9.1', b'$IN_GARAGE;', 1.0)
    judge.rubbish(1, b'$IN_GARAGE', 1.0)
    judge.finish()

    assert [violation.rule for violation in judge.violations] == ['stranger', 'rubbish']


@pytest.mark.parametrize(
    ('unanswered', 'state', 'broken'),
    [
        (CommandKind.ALL_KILL, 'RED_RED', ['stop not answered']),
        (CommandKind.GRID_ACTIVE, 'GREEN_GREEN', ['unexplained GREEN_GREEN']),
        (CommandKind.GRID_ACTIVE, 'GRID_ACTIVE', []),
    ],
)
def test_what_comes_after_a_call_without_an_answer_is_judged(
    unanswered: CommandKind, state: str, broken: list[str]
) -> None:
    judge = Judge({1}, {2}, 0.0)
    judge.opened(1, 1, 0.5)
    judge.frame(1, 'IN_GARAGE', 0.9, 1.0)
    judge.called(Call(unanswered, None, True, 2.0))
    for at in (3.0, 4.0):
        judge.frame(1, state, at - 0.1, at)
    judge.judge(5.0)
    judge.finish()
    assert [violation.rule for violation in judge.violations] == broken
    assert judge.judged['frame'] == 3


@pytest.mark.parametrize(
    ('began', 'ended', 'wrong'),
    [
        pytest.param(2.0, 2.5, True, id='before GREEN_GREEN'),
        pytest.param(3.1, 3.2, False, id='at the same time'),
    ],
)
def test_green_green_is_wrong_only_if_the_other_command_was_in_force_before_it_was_given(
    began: float, ended: float, wrong: bool
) -> None:
    judge = Judge({1}, {2}, 0.0)
    for call in (
        Call(CommandKind.GRID_ACTIVE, None, True, 1.0, 1.5, True),
        Call(CommandKind.KART_RED_FLAG, 2, False, began, ended, True),
        Call(CommandKind.GREEN_GREEN, None, False, 3.0, 3.5, True),
    ):
        judge.called(call)
        judge.answered(call)
    judge.finish()

    rules_broken = [violation.rule for violation in judge.violations]
    assert ('GRID_ACTIVE not last' in rules_broken) is wrong


@pytest.mark.parametrize(
    'unknown', [CommandKind.GRID_ACTIVE, CommandKind.JOIN_RACE, CommandKind.ALL_KILL]
)
def test_the_judge_does_not_begin_with_a_command_that_it_does_not_know(
    unknown: CommandKind, monkeypatch: pytest.MonkeyPatch
) -> None:
    if CATALOGUE[unknown].stop:
        monkeypatch.setitem(
            CATALOGUE, unknown, dataclasses.replace(CATALOGUE[unknown], result=Result())
        )
    else:
        known = {kind: seen for kind, seen in judge_module.SEEN.items() if kind is not unknown}
        monkeypatch.setattr(judge_module, 'SEEN', known)
    with pytest.raises(LookupError, match=unknown.value):
        Judge({1}, {2}, 0.0)
