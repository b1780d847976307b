# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Race control is killed, again and again, and each time it comes back no kart may move.

What the rules make of a crash is searched (``restart``, ``pause``), also without the last kart;
what a harmed record leaves is in test_record.py, and that the mark goes before it in
test_run_marks.py.
"""

from __future__ import annotations

from collections.abc import Callable
import os
import pathlib
import random
import re
import threading

from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_testing.official import SERVICES
from evgp_testing.race_control import new_port
from evgp_testing.wire_race import WireRace
import pytest
from rig.replaying import events_of, replay_without_difference

IN_GARAGE, RED_RED = RaceState.IN_GARAGE, RaceState.RED_RED

RACING, OUTSIDE = (1, 2), 3
FEW, MANY = 2, int(os.environ.get('EVGP_KILLS', '8'))
"""How often race control is killed in `make test`, and in `make test-long`."""

REFUSED = rf'({"|".join(SERVICES)}): |not within .*: a newer race'
"""What a step says whose command was refused."""


# The steps of a race, each from where the official has seen the one before it leave off.


def hold_the_spectator(race: WireRace) -> None:
    race.official.command('kart/red_red', kart=OUTSIDE)
    race.official.wait_for_acks(RED_RED, OUTSIDE)


def finish(race: WireRace) -> None:
    race.official.command('kart/finish', kart=RACING[0])
    race.karts[0].wait_for_state(RaceState.RED_FLAG)


def kill_all(race: WireRace) -> None:
    race.official.command('all_kill')
    race.official.wait_for_acks(RED_RED, *RACING)


def over(race: WireRace) -> None:
    race.official.command('race_over')
    race.official.wait_for_acks(RED_RED, *RACING)


def home(race: WireRace) -> None:
    official = race.official
    official.command('in_garage', track_safe=True)
    # What an official held alone is not released with the race.
    seen = official.wait_for_race(
        lambda race: state_of(race.state) is IN_GARAGE, 'the race in IN_GARAGE'
    )
    for status in seen.karts:
        if state_of(status.hold) is not None:
            official.command('kart/in_garage', kart=status.number)
    for kart in race.karts:
        kart.wait_for_state(IN_GARAGE)
    official.wait_for_race(
        lambda race: all(state_of(kart.hold) is None for kart in race.karts), 'no kart held'
    )
    official.command('set_track_open', open=False)


STEPS: tuple[Callable[[WireRace], None], ...] = (
    hold_the_spectator,
    lambda race: race.bring_to(RaceState.GRID_ACTIVE),
    lambda race: race.bring_to(RaceState.GREEN_GREEN),
    finish,
    kill_all,
    over,
    home,
)


def check_restart(race: WireRace) -> None:
    """Check, from outside, that everything stands still, and bring it home."""
    seen = race.official.wait_for_race(
        lambda race: all(kart.connected and kart.acknowledged for kart in race.karts),
        'every kart back and stopped',
    )
    assert state_of(seen.state) is RED_RED
    assert {state_of(kart.hold) for kart in seen.karts} == {RED_RED}
    assert [kart.in_race for kart in seen.karts] == [True, True, False]
    assert seen.track.open
    for kart in race.karts:
        assert [state for _, state in kart.changes] == [RED_RED]
    assert not race.official.call('green_green').success
    home(race)


# Each kill takes about two seconds, most of it starting a process.
@pytest.mark.timeout(600)
@pytest.mark.parametrize('kills', [FEW, pytest.param(MANY, marks=pytest.mark.long)])
def test_race_control_killed_at_random_comes_back_with_every_kart_held(
    kills: int,
    tmp_path: pathlib.Path,
    chance: random.Random,
    record_property: Callable[[str, object], None],
) -> None:
    record = tmp_path / 'record.sqlite3'
    given = {'port': new_port(), 'finish_delays': '[0.05]', 'auto_race_over': False}
    published = unrecorded = 0
    for kill in range(kills + 1):
        with WireRace(tmp_path, RACING, [OUTSIDE], parameters=given) as race:
            if kill:
                check_restart(race)
            if kill == kills:
                break
            steps = STEPS[: chance.randint(1, len(STEPS))]
            for step in steps[:-1]:
                step(race)
            # The last step is under way while race control dies.
            killer = threading.Timer(chance.uniform(0.0, 0.03), race.control.kill)
            killer.start()
            race.official.timeout = 0.5
            try:
                steps[-1](race)
            except AssertionError as error:
                # Nobody answered any more, or what was accepted did not come about any more.
                if re.match(REFUSED, str(error)):
                    raise
            killer.join()
        recorded = [event.sequence for event in events_of(record)]
        assert recorded == list(range(1, len(recorded) + 1))
        replay_without_difference(record)
        published += len(race.official.events)
        unrecorded += sum(each.sequence > len(recorded) for each in race.official.events)
    replay_without_difference(record)
    figures = f'{kills} kills, {published} events published, {unrecorded} of them not recorded'
    print(figures)
    record_property('crashes', figures)
