# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Bad peers of race control, each in a process of its own, and the race that must not notice."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import pathlib
import select
import subprocess
import sys

from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_testing.process import PATIENCE
from evgp_testing.race_control import address_of
from evgp_testing.wire_race import WireRace

RACING = (1, 2)
BAD = 3
KART = address_of(BAD)
STRANGER = '127.0.9.9'

ATTACKS = {
    'slow_reader': KART,
    'flood': KART,
    'random_bytes': KART,
    'endless_frame': KART,
    'nuls': KART,
    'nested': KART,
    'half_close': KART,
    'reset': KART,
    'reconnects': KART,
    'hammer': STRANGER,
    'many_connections': STRANGER,
}
"""Every attack of ``bad_peer``, and from where: a kart of the roster, or a stranger."""

_SCRIPT = pathlib.Path(__file__).with_name('bad_peer.py')


def attacked_race(folder: pathlib.Path) -> WireRace:
    """Start a race with two good karts, and one in the roster that is not good."""
    return WireRace(folder, RACING, [BAD], absent=[BAD])


def end_race(race: WireRace) -> None:
    """Bring the race to IN_GARAGE, and have the bad kart made safe if it is held until then."""
    race.bring_to(RaceState.IN_GARAGE)
    bad = race.official.wait_for_kart(BAD, lambda kart: True, 'its status')
    if state_of(bad.hold) is not None:
        race.official.command('kart/in_garage', kart=BAD, made_safe_by_hand=True)


@contextlib.contextmanager
def attacking(name: str, port: int, host: str = '127.0.0.1') -> Iterator[None]:
    """
    Have a bad peer attack race control meanwhile.

    :raises AssertionError: if it does not get under way.
    """
    with subprocess.Popen(
        [sys.executable, '-I', str(_SCRIPT), name, host, str(port), ATTACKS[name]],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as peer:
        assert peer.stdin is not None
        assert peer.stdout is not None
        try:
            under_way, _, _ = select.select([peer.stdout], [], [], PATIENCE)
            assert under_way, f'{name} did not get under way'
            assert peer.stdout.readline() == b'ready\n'
            yield
        finally:
            peer.stdin.close()
            try:
                peer.wait(10)
            except subprocess.TimeoutExpired:
                peer.kill()
