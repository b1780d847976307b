# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Every incident with each automatic official, on the table: rules, field and official only."""

from __future__ import annotations

from collections.abc import Iterator
import pathlib

from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CATALOGUE
from evgp_rehearsal.field import Field
from evgp_rehearsal.incidents import can_begin, choose_kart, INCIDENTS
from evgp_rehearsal.officials import Act, Good, View
from evgp_rehearsal.plan import Plan, read_plan
import pytest
from table_top import play

FILE = pathlib.Path(__file__).parents[1] / 'config' / 'rehearsal.yaml'

SEEDS = (1, 2)


class Idle:
    """An official who does nothing."""

    def act(self, view: View) -> None:
        """Do nothing."""


class Frantic:
    """An official who presses everything, one after the other."""

    def __init__(self) -> None:
        self._presses: Iterator[Act] = iter(())

    def act(self, view: View) -> Act:
        """Press the next button."""
        press = next(self._presses, None)
        if press is None:
            self._presses = iter(
                [
                    Act(kind, kart)
                    for kind, entry in CATALOGUE.items()
                    if not (entry.names_heat or entry.of_laps)  # there are none
                    for kart in (sorted(view.karts) if entry.to_one_kart else [0])
                ]
            )
            press = next(self._presses)
        return press


def the_plan(seed: int, laps: int = 4) -> Plan:
    """Return the plan that is shipped, short and with another seed."""
    text = FILE.read_text(encoding='utf-8')
    return read_plan(text.replace('seed: 1', f'seed: {seed}').replace('laps: 6', f'laps: {laps}'))


def laps_of(name: str) -> int:
    """Return how many laps the race of an incident needs at least."""
    return 1 if name == 'slow_leader' else 4


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('name', INCIDENTS)
def test_a_good_official_passes(name: str, seed: int) -> None:
    line = play(the_plan(seed, laps_of(name)), name, Good())
    assert line.passed, line


@pytest.mark.parametrize('name', INCIDENTS)
def test_an_official_who_does_nothing_fails(name: str) -> None:
    line = play(the_plan(1, laps_of(name)), name, Idle())
    assert not line.passed, line
    assert line.first_right is None


@pytest.mark.parametrize('name', INCIDENTS)
def test_an_official_who_presses_everything_fails(name: str) -> None:
    line = play(the_plan(1, laps_of(name)), name, Frantic())
    assert not line.passed, line
    assert line.wrong


@pytest.mark.parametrize('official', [Good, Frantic])
@pytest.mark.parametrize('name', INCIDENTS)
def test_the_same_seed_and_the_same_commands_give_the_same_score(
    name: str, official: type[Good]
) -> None:
    plan = the_plan(4, laps_of(name))
    assert play(plan, name, official()) == play(plan, name, official())


def test_an_incident_can_begin_in_a_race_that_a_kart_has_left() -> None:
    field = Field(the_plan(1))
    racing = sorted(field.karts)[1:]
    for number in racing:
        field.hear(number, RaceState.GREEN_GREEN)
    for _ in range(100):
        field.step()
    spin = INCIDENTS['spin']
    assert can_begin(spin, field, RaceState.GREEN_GREEN)
    assert {choose_kart(field, spin) for _ in range(100)} == set(racing)
