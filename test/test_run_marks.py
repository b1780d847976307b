# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What one race control leaves behind for the next on its machine, however it ends.

What the rules make of a crash is searched (``restart``, ``pause``), also without the last kart;
what a harmed record leaves is in test_record.py.
"""

from __future__ import annotations

import contextlib
import os
import pathlib
import random
import re
import signal
import tempfile
import threading
import time

from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rcs.record.run_mark import place, RUN_BEGAN, RunMark
from evgp_rcs.rules.race import LastRun
from evgp_testing.official import SERVICES
from evgp_testing.process import Process
from evgp_testing.race_control import address_of, new_port, settings, write_roster
from evgp_testing.usage import family
from evgp_testing.wire_kart import kart_socket
from evgp_testing.wire_race import WireRace
import pytest
from rig.replaying import events_of, replay_without_difference

IN_GARAGE = RaceState.IN_GARAGE
GREEN_GREEN = RaceState.GREEN_GREEN
RED_RED = RaceState.RED_RED
KARTS = (1, 2)


Seen = tuple[set[RaceState | None], set[RaceState | None], RaceState | None, bool, bool]
"""What the first connection of each kart was sent, the holds, the state of the race, and whether
the track is open, and open although nobody may be there."""

PROVES_NOTHING: Seen = {RED_RED}, {RED_RED}, RED_RED, True, True
BEGINS: Seen = {IN_GARAGE}, {None}, IN_GARAGE, False, False
"""Karts join in IN_GARAGE on a closed track, as the proposal has it."""


def leave(mark: pathlib.Path, ends_as: LastRun) -> None:
    """Have a mark say how a run ended."""
    run = RunMark(mark)
    run.end(ends_as)
    assert not run.error


class Machine:
    """One machine: race controls that run on it one after the other, at one port."""

    def __init__(self, folder: pathlib.Path) -> None:
        """Have a port of its own."""
        self.folder, self.port = folder, new_port()
        self.at = '127.0.0.1', self.port
        self.mark = place(*self.at)

    def run(
        self,
        folder: str = 'a',
        under: tuple[str, ...] = (),
        others: tuple[int, ...] = (),
        **parameters: object,
    ) -> WireRace:
        """Start race control with roster and record in a folder, its karts and an official."""
        own = self.folder / folder
        own.mkdir(exist_ok=True)
        given = {'port': self.port, 'auto_race_over': False, **parameters}
        return WireRace(own, KARTS, others, others, given, under=under)

    def look(self, folder: str = 'a') -> Seen:
        """Start race control, and return what is seen first; it ends at once."""
        with self.run(folder) as race:
            seen = seen_in(race)
            race.control.lose_power()
            return seen


def seen_in(race: WireRace) -> Seen:
    """Return what is seen first in a run that has just begun."""
    for kart in race.karts:
        kart.wait_for_frames(3)
    seen = race.official.wait_for_race(lambda race: True, 'the race')
    holds = {state_of(kart.hold) for kart in seen.karts}
    track = seen.track
    unsafe = track.open and not track.allowed
    return sent_to(race), holds, state_of(seen.state), track.open, unsafe


def sent_to(race: WireRace) -> set[RaceState | None]:
    """Return all that the karts were sent."""
    return {state for kart in race.karts for _, state in kart.changes}


@pytest.fixture
def machine(tmp_path: pathlib.Path) -> Machine:
    return Machine(tmp_path)


# ----- another record, user, home, unit -------------------------------------------------------


def test_a_machine_begins_in_the_garage_until_a_run_did_not_end_well_whatever_record_it_has(
    machine: Machine,
) -> None:
    """After it, user, record, disk, home, ROS_HOME, unit, folder and roster are all other ones."""
    with machine.run() as race:  # on a new machine
        assert seen_in(race) == BEGINS
        race.official.command('set_track_open', open=True, no_race_anywhere=True)
        race.official.command('set_track_open', open=False)
        assert race.control.close() == 0
    assert machine.mark.read_text(encoding='ascii').strip() == LastRun.ENDED.value
    with tempfile.TemporaryDirectory(dir='/dev/shm') as folder:
        pathlib.Path(folder).chmod(0o777)
        under = ('env', '-C', '/', f'HOME={folder}', f'ROS_HOME={folder}/ros', 'INVOCATION_ID=1')
        if os.geteuid() == 0:  # it may still read the programs, which may be below /root
            under += ('setpriv', '--reuid=12017', '--regid=12017', '--clear-groups')
            under += ('--inh-caps=+dac_read_search', '--ambient-caps=+dac_read_search')
        with machine.run('b', under, (3, 4), record=f'{folder}/record.sqlite3') as race:
            assert seen_in(race) == BEGINS
            race.bring_to(GREEN_GREEN)
            race.control.lose_power()
    for own in ('a', 'c'):  # the record of the good end, and a new one
        assert machine.look(own) == PROVES_NOTHING


# ----- a crash at every moment of a race -----------------------------------------------------

FEW, MANY = 2, int(os.environ.get('EVGP_KILLS', '8'))
"""How often race control is killed in `make test`, and in `make test-long`."""

REFUSED = rf'({"|".join(SERVICES)}): |not within .*: a newer race'
"""What a step says whose command was refused."""


@pytest.mark.timeout(600)
@pytest.mark.parametrize('kills', [FEW, pytest.param(MANY, marks=pytest.mark.long)])
def test_race_control_killed_at_random_comes_back_with_every_kart_held(
    machine: Machine, chance: random.Random, kills: int
) -> None:
    record = machine.folder / 'a' / 'record.sqlite3'
    for kill in range(kills + 1):
        with machine.run() as race:
            if kill:
                assert seen_in(race) == PROVES_NOTHING
                assert not race.official.call('green_green').success
            before, last = chance.choices([*RaceState], k=2)
            race.bring_to(before)
            # It dies while the last step is under way: its ROS half, or all of it.
            end = chance.choice([race.control.kill, race.control.lose_power])
            killer = threading.Timer(chance.uniform(0.0, 0.03), end)
            killer.start()
            race.official.timeout = 0.5
            try:
                race.bring_to(last)
            except AssertionError as error:
                # Nobody answered any more, or what was accepted did not come about any more.
                if re.match(REFUSED, str(error)):
                    raise
            killer.join()
        recorded = [event.sequence for event in events_of(record)]
        assert recorded == list(range(1, len(recorded) + 1))
        replay_without_difference(record)


# ----- a crash at every moment of a start ----------------------------------------------------


def cut_off(process: Process) -> None:
    """Kill all that a program has started, as a loss of power does."""
    pids = family(process.pid)
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGSTOP)
    for pid in reversed(pids):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    process.wait()


@pytest.mark.parametrize('times', [4, pytest.param(30, marks=pytest.mark.long)])
def test_whenever_a_start_is_cut_off_the_mark_says_began_before_a_kart_can_connect(
    machine: Machine, domain: int, chance: random.Random, times: int
) -> None:
    given = settings(machine.folder, write_roster(machine.folder, KARTS))
    for _ in range(times):
        leave(machine.mark, LastRun.ENDED)
        process = Process('evgp_rcs', 'rcs_node', domain, {**given, 'port': machine.port})
        until = time.monotonic() + chance.uniform(0.2, 3.0)
        connected = False
        while time.monotonic() < until and not connected:
            with contextlib.suppress(OSError), kart_socket(address_of(1), machine.at):
                connected = True
            time.sleep(0.001)
        said = machine.mark.read_text(encoding='ascii').strip()
        cut_off(process)
        assert said == RUN_BEGAN or not connected
        assert machine.mark.read_text(encoding='ascii').strip() in (said, RUN_BEGAN)
