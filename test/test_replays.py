# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A race of real processes is run again from its record, also while it is still on."""

from __future__ import annotations

import contextlib
import pathlib
import shutil
import subprocess
import time

from evgp_protocol.states import RaceState
from evgp_rcs.record.store import events, open_read_only
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import EventKind, StampedEvent
from evgp_testing.part import PATIENCE
from evgp_testing.process import executable
from evgp_testing.wire_race import WireRace
import pytest
from recorded_races import change_event
from rig.replaying import replay_without_difference

# Three as they connect, and then two of each to the race; RED_FLAG and RED_RED.
ORDERS = 3 + 2 + 2 + 1 + 3


def replay(record: pathlib.Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [executable('evgp_rcs', 'rcs_record'), 'replay', str(record)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=60,
    )


@pytest.mark.parametrize('crashes', [False, True], ids=['ended', 'crashed'])
def test_a_race_is_replayed_without_a_difference_while_it_is_on_and_after_it(
    tmp_path: pathlib.Path, crashes: bool
) -> None:
    record = tmp_path / 'record.sqlite3'
    with WireRace(tmp_path, (1, 2), [3]) as race:
        race.bring_to(RaceState.GREEN_GREEN)
        race.official.command('kart/finish', kart=1)
        race.karts[0].wait_for_state(RaceState.RED_FLAG)
        (meanwhile,) = replay_without_difference(record)
        race.official.command('all_kill')
        race.official.wait_for_acks(RaceState.RED_RED, 1, 2, 3)
        if crashes:
            # A stop does not wait for the record, which another thread writes.
            until = time.monotonic() + PATIENCE
            while replay_without_difference(record)[0].orders < ORDERS:
                assert time.monotonic() < until, 'the record lacks the last stop'
            race.control.lose_power()
    done = replay(record)
    assert done.returncode == 0, done.stdout
    (replayed,) = replay_without_difference(record)
    assert replayed.inputs > meanwhile.inputs
    assert replayed.orders >= ORDERS
    moves = (
        (EventKind.COMMAND, CommandKind.KART_FINISH, -0.6),
        (EventKind.RACE_STATE, CommandKind.GREEN_GREEN, 1.0),
    )
    for kind, command, by in moves:
        moved = shutil.copytree(tmp_path, tmp_path / command.name) / record.name

        def is_meant(
            each: StampedEvent, kind: EventKind = kind, command: CommandKind = command
        ) -> bool:
            return (each.event.kind, each.event.command) == (kind, command)

        with contextlib.closing(open_read_only(moved)) as database:
            (event,) = [each for each in events(database, 1) if is_meant(each)]
        change_event(moved, is_meant, monotonic=event.monotonic + by)
        assert replay(moved).returncode == 1, f'nothing was said of {command}, moved by {by} s'
