# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A race of real processes is run again from its record, also while it is still on.

test_crashes.py does so after each crash; what a replay finds is in test_replay.py.
"""

from __future__ import annotations

import pathlib

from evgp_protocol.states import RaceState
from evgp_rcs.rcs_record import main as rcs_record
from evgp_testing.wire_race import WireRace
from rig.replaying import replay_without_difference

# Three as they connect, and then two of each to the race; RED_FLAG and RED_RED.
ORDERS = 3 + 2 + 2 + 1 + 3


def test_a_race_is_replayed_without_a_difference_while_it_is_on_and_after_it(
    tmp_path: pathlib.Path,
) -> None:
    record = tmp_path / 'record.sqlite3'
    with WireRace(tmp_path, (1, 2), [3]) as race:
        race.bring_to(RaceState.GREEN_GREEN)
        race.official.command('kart/finish', kart=1)
        race.karts[0].wait_for_state(RaceState.RED_FLAG)
        (meanwhile,) = replay_without_difference(record)
        race.official.command('all_kill')
        race.official.wait_for_acks(RaceState.RED_RED, 1, 2, 3)
    assert rcs_record(['replay', str(record)]) == 0
    (replayed,) = replay_without_difference(record)
    assert replayed.inputs > meanwhile.inputs
    assert replayed.orders >= ORDERS
