# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A team comes late: the roster is read again, and nobody is disconnected (§4)."""

from __future__ import annotations

import contextlib
import pathlib

from evgp_protocol.states import RaceState
from evgp_rcs_console.command_line import Exit
from evgp_rcs_msgs import msg
from evgp_testing.domains import Domain
from evgp_testing.official import Official
from evgp_testing.race_control import RaceControl, Timekeeper, write_roster
from evgp_testing.wire_kart import Acknowledges, WireKart
from rig.replaying import replay_without_difference
from test_rcs_ctl import run as rcs_ctl

TEAMS, LATE = (1, 2), 7
GRID_ACTIVE = RaceState.GRID_ACTIVE


def test_a_kart_comes_late_and_races_while_the_others_stay_connected(
    parts: contextlib.ExitStack, tmp_path: pathlib.Path
) -> None:
    domain = parts.enter_context(Domain())
    control = parts.enter_context(RaceControl(tmp_path, domain.number, TEAMS))
    parts.enter_context(Timekeeper(tmp_path, domain.number))
    hears = 'race', 'events', 'results'
    official = parts.enter_context(Official(domain.number, hears=hears))

    def connect(number: int) -> WireKart:
        return parts.enter_context(
            WireKart(f'127.0.0.{100 + number}', control.port, Acknowledges.EACH_CHANGE)
        )

    def addressed(number: int) -> str:
        return f'127.0.0.{100 + number}'

    write_roster(tmp_path, TEAMS, addresses=addressed)
    official.command('reload_roster', take=False)
    race = official.wait_for_race(lambda race: race.reading == 1, 'the roster that was read')
    assert [kart.address for kart in race.karts] != [addressed(each) for each in TEAMS]
    official.command('reload_roster', take=True, reading=1)
    for number in TEAMS:
        connect(number)
    official.wait_for_connected(*TEAMS)

    # Neither a file that is none, nor one that lacks a kart that is connected, changes anything.
    (tmp_path / 'karts.yaml').write_text('karts: 3\n', encoding='utf-8')
    answer = official.call('reload_roster', take=False)
    assert not answer.success
    assert 'karts.yaml:1' in answer.message
    write_roster(tmp_path, [1], addresses=addressed)
    assert not official.call('reload_roster', take=False).success
    assert [kart.number for kart in official.wait_for_race(bool, 'the race').karts] == [*TEAMS]

    heats = {'Heat 1': (*TEAMS, LATE)}
    write_roster(tmp_path, TEAMS, [LATE], heats=heats, addresses=addressed)
    official.command('reload_roster', take=False)
    official.wait_for_race(lambda race: race.reading == 2, 'the roster that was read')
    assert not official.call('reload_roster', take=True, reading=1).success
    refused = rcs_ctl(domain.number, 'take-roster', '1')
    assert refused.returncode == Exit.REFUSED
    assert 'take-roster' not in refused.stderr  # no line to type that would do something else
    official.command('reload_roster', take=True, reading=2)
    official.wait_for_results(lambda results: bool(results.grids), "the timekeeper's heats")
    connect(LATE)
    official.wait_for_connected(*TEAMS, LATE)
    official.command('set_heat', heat='Heat 1')
    official.bring_to(GRID_ACTIVE)
    official.wait_for_acks(GRID_ACTIVE, *TEAMS, LATE)

    assert not official.call('reload_roster', take=False).success
    gone = msg.RaceEvent.DISCONNECTED, msg.RaceEvent.REFUSED_CONNECTION
    assert not [event for event in official.events if event.kind in gone]
    replay_without_difference(tmp_path / 'record.sqlite3')
