# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Bad peers: while one does its worst, the karts of the race and the officials do not notice.

docs/dev/performance.md says how little; here, frames are counted.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import pathlib
import resource
import select
import subprocess
import sys
import time

from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.part import PATIENCE
from evgp_testing.race_control import address_of
from evgp_testing.usage import open_files, resident
from evgp_testing.wire_kart import kart_socket, WireKart
from evgp_testing.wire_race import WireRace
import pytest

GRID_ACTIVE = RaceState.GRID_ACTIVE
GREEN_GREEN = RaceState.GREEN_GREEN
RED_RED = RaceState.RED_RED

RACING = (1, 2)
BAD = 3
KART = address_of(BAD)
STRANGER = '127.0.9.9'

ATTACKS = {
    'flood': KART,
    'random_bytes': KART,
    'reset': KART,
    'reconnects': KART,
    'hammer': STRANGER,
    'many_connections': STRANGER,
}
"""Every attack of ``bad_peer``, and from where: a kart of the roster, or a stranger."""

_SCRIPT = pathlib.Path(__file__).with_name('rig') / 'bad_peer.py'

STRETCH = 1.5
"""How long each attack goes on before ALL_KILL, s."""

LEAST_RATE = 10.0
"""Frames per second that every kart is sent at least (§4.C)."""

MOST_LINES = 80
"""More lines than this in the log of one attack nobody reads."""

MOST_MEMORY = 30 * 1024
"""So much more memory race control may need after an attack, KiB: one copy of what it has."""


def end_race(race: WireRace) -> None:
    """Bring the race to IN_GARAGE, and have the bad kart made safe if it is held until then."""
    race.bring_to(RaceState.IN_GARAGE)
    bad = race.official.wait_for_kart(BAD, lambda kart: True, 'its status')
    if state_of(bad.hold) is not None:
        race.official.command('kart/in_garage', kart=BAD, made_safe_by_hand=True)


@contextlib.contextmanager
def attacking(name: str, port: int) -> Iterator[None]:
    """
    Have a bad peer attack race control meanwhile.

    :raises AssertionError: if it does not get under way.
    """
    with subprocess.Popen(
        [sys.executable, '-I', str(_SCRIPT), name, '127.0.0.1', str(port), ATTACKS[name]],
        stdout=subprocess.PIPE,
    ) as peer:
        assert peer.stdout is not None
        try:
            under_way, _, _ = select.select([peer.stdout], [], [], PATIENCE)
            assert under_way, f'{name} did not get under way'
            assert peer.stdout.readline() == b'ready\n'
            yield
        finally:
            peer.kill()


def check_frames(race: WireRace) -> None:
    """Check that every good kart goes on to be sent frames."""
    before = [kart.frames for kart in race.karts]
    began = time.monotonic()
    while time.monotonic() - began < STRETCH:
        race.karts[0].wait_for_frames(1)
    least = LEAST_RATE * (time.monotonic() - began)
    sent = [kart.frames - frames for kart, frames in zip(race.karts, before, strict=True)]
    assert min(sent) >= least, sent


def check_all_kill(race: WireRace) -> None:
    """Check that ALL_KILL reaches every good kart, and nothing else has."""
    race.official.command('all_kill')
    for kart in race.karts:
        kart.wait_for_state(RED_RED)
        assert [state for _, state in kart.changes][-3:] == [GRID_ACTIVE, GREEN_GREEN, RED_RED]
        assert not kart.malformed


@pytest.fixture(scope='module')
def attacked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRace]:
    """
    Return the race that all attacks of this file meet, one after the other.

    Two of its karts are good, and one in the roster is not.
    """
    folder = tmp_path_factory.mktemp('attacked')
    with WireRace(folder, RACING, [BAD], absent=[BAD]) as race:
        yield race


@pytest.mark.parametrize('attack', ATTACKS)
def test_a_bad_peer_costs_only_itself(attacked: WireRace, attack: str) -> None:
    control = attacked.control
    attacked.bring_to(GREEN_GREEN)
    lines = len(control.lines)
    memory = resident(control.pid)
    with attacking(attack, control.port):
        check_frames(attacked)
        check_all_kill(attacked)
    told = control.lines[lines:]
    assert len(told) <= MOST_LINES, '\n'.join(told)
    assert resident(control.pid) - memory <= MOST_MEMORY
    end_race(attacked)


def test_out_of_files_the_race_goes_on_and_karts_come_back_later(attacked: WireRace) -> None:
    control = attacked.control
    attacked.bring_to(GREEN_GREEN)
    lines, pid = len(control.lines), control.kart_server_pid
    _, hard = resource.prlimit(pid, resource.RLIMIT_NOFILE)
    resource.prlimit(pid, resource.RLIMIT_NOFILE, (open_files(pid) + 1, hard))
    with attacking('many_connections', control.port):
        check_frames(attacked)
        check_all_kill(attacked)
    assert len(control.lines) - lines <= MOST_LINES, control.output
    resource.prlimit(pid, resource.RLIMIT_NOFILE, (hard, hard))
    with WireKart(address_of(BAD), control.port) as late:
        late.wait_for_frames(1)
    end_race(attacked)


def test_a_kart_that_reconnects_too_often_is_refused_and_told_of_seldom(
    attacked: WireRace,
) -> None:
    official = attacked.official
    with attacking('reconnects', attacked.control.port):
        event = official.wait_for_event(
            lambda event: (
                event.kind == msg.RaceEvent.REFUSED_CONNECTION and 'too often' in event.text
            ),
            'refused',
        )
    assert event.text.startswith(f'A connection from kart {BAD} (Team {BAD}) was refused')
    # It is let in again soon: until then the connection ends without a frame.
    frames = 0
    while not frames:
        with kart_socket(address_of(BAD), ('127.0.0.1', attacked.control.port)) as kart:
            frames = len(kart.recv(64))
            time.sleep(0.0 if frames else 0.1)
