# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A team comes late: the roster is read again, and nobody is disconnected (§4)."""

from __future__ import annotations

import concurrent.futures
import contextlib
import os
import pathlib
import pty
import stat

from evgp_protocol.states import RaceState
from evgp_rcs_console.command_line import Exit
from evgp_rcs_msgs import msg
from evgp_testing.domains import Domain
from evgp_testing.official import Official
from evgp_testing.race_control import RaceControl, Timekeeper, write_roster
from evgp_testing.wire_kart import WireKart
from evgp_testing.wire_race import WireRace
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
            WireKart(f'127.0.0.{100 + number}', control.port, acknowledges=True)
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


def test_while_the_disk_of_the_roster_hangs_the_rest_is_answered_and_no_stop_is_undone(
    tmp_path: pathlib.Path,
) -> None:
    roster = tmp_path / 'karts.yaml'
    keyboard, terminal = pty.openpty()  # reading a terminal takes until somebody types
    number = os.fstat(terminal).st_rdev

    def is_read(descriptor: pathlib.Path) -> bool:
        with contextlib.suppress(OSError):
            found = descriptor.stat()
            return stat.S_ISCHR(found.st_mode) and found.st_rdev == number
        return False

    with WireRace(tmp_path, [1]) as race, concurrent.futures.ThreadPoolExecutor(1) as elsewhere:
        official = race.official
        official.command('reload_roster', take=False)
        official.wait_for_race(lambda race: race.reading == 1, 'the roster that was read')
        text = roster.read_bytes()
        roster.unlink()
        roster.symlink_to(os.ttyname(terminal))
        taking = elsewhere.submit(official.call, 'reload_roster', take=True, reading=1)
        try:
            files = pathlib.Path(f'/proc/{race.control.pid}/fd')
            official.wait_until_polled(lambda: any(map(is_read, files.iterdir())), 'a read')
            official.command('kart/red_red', kart=1)
            assert 'IN_GARAGE' in official.call('kart/finish', kart=1).message
            official.wait_for_available('reload_roster', take=True)  # the pause is over
        finally:
            os.write(keyboard, text + b'\4')  # the end of a file, typed
        assert not taking.result().success
        assert official.wait_for_race(bool, 'the race').reading == 1
    os.close(keyboard)
    os.close(terminal)
