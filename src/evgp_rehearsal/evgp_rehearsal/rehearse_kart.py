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

"""
``rehearse_kart``: a whole race with one incident, to a team's one kart, without an official.

The kart, by its bridge or its own client, connects to this machine's loopback address. The exit
code is for a team's CI.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
import contextlib
from dataclasses import dataclass
import ipaddress
import os
import pathlib
import signal
import sys
import tempfile
import time

from evgp_node.states import state_of
from evgp_protocol import clock
from evgp_protocol.states import RaceState
from evgp_rcs.record import events, open_read_only, sessions
from evgp_rehearsal.conduct import conduct, Finding, LIMITS
from evgp_testing.domains import Domain
from evgp_testing.official import Official
from evgp_testing.race_control import RaceControl
from evgp_testing.wire_kart import WireKart

RACING = 3.0
"""Time that the kart races before anything happens, in seconds."""

BACK = 20.0
"""Time that a kart has to come back after its connection was lost, in seconds."""

SILENCE = 2.0
"""Time that race control says nothing, in seconds; a kart must stop by itself after 1 s."""


@dataclass
class Trial:
    """A race control of one kart, and what can be done to that kart."""

    folder: pathlib.Path
    domain: int
    host: str
    port: int
    kart: int
    address: str

    def __post_init__(self) -> None:
        """Start race control, and an official who sends what the program says."""
        self.control = self._race_control()
        try:
            self.official = Official(self.domain, 'rehearse_kart')
        except BaseException:
            self.control.close()
            raise

    def close(self) -> None:
        """End both."""
        self.official.close()
        self.control.close()

    def all_kill(self) -> None:
        """Stop every kart."""
        self.official.command('all_kill')

    def red_red(self) -> None:
        """Stop this kart."""
        self.official.command('kart/red_red', kart=self.kart)

    def red_flag(self) -> None:
        """Flag the race."""
        self.official.command('red_flag')

    def silence(self) -> None:
        """Say nothing for a while, as a network does that is gone."""
        self.control.freeze()
        time.sleep(SILENCE)
        self.control.thaw()
        self.all_kill()

    def second_machine(self) -> None:
        """Connect from the kart's own address: that takes its place."""
        with WireKart(self.address, self.port, host=self.host):
            time.sleep(1.0)

    def crash(self) -> None:
        """Kill race control, and start it again."""
        os.kill(self.control.kart_server_pid, signal.SIGKILL)
        self.control.kill()
        self.official.race = None
        self.control = self._race_control()

    def _race_control(self) -> RaceControl:
        return RaceControl(
            self.folder,
            self.domain,
            [self.kart],
            parameters={'address': self.host, 'port': self.port},
            teams={self.kart: f'REHEARSAL {self.kart}'},
            addresses=lambda _: self.address,
        )


INCIDENTS: Mapping[str, Callable[[Trial], None]] = {
    'none': lambda trial: trial.official.command('kart/finish', kart=trial.kart) and None,
    'all_kill': Trial.all_kill,
    'red_red': Trial.red_red,
    'red_flag': Trial.red_flag,
    'silence': Trial.silence,
    'second_machine': Trial.second_machine,
    'race_control_crash': Trial.crash,
}
"""What can happen in mid-race to the one kart; ``none``: it finishes."""


UNSEEN = {
    'silence': 'had to stop by itself after 1 s of silence: this program cannot see whether it '
    'did; make inspect-kart can',
}
"""What an incident asks of a kart and the record does not show."""


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Play a race.

    :return: 0; 1 if the kart did anything badly; 2 if a setting is wrong; 130 after Ctrl-C.
    """
    parser = argparse.ArgumentParser(
        prog='rehearse_kart',
        description='Play a whole race with one incident to your kart, and say how it did.',
    )
    parser.add_argument('--host', default='127.0.0.1', help='where your kart connects; loopback')
    parser.add_argument('--port', type=int, default=12017, help='at which port (%(default)s)')
    parser.add_argument('--kart', type=int, default=1, help='its number (%(default)s)')
    parser.add_argument(
        '--address', default='127.0.0.1', help="your kart's own address (%(default)s)"
    )
    parser.add_argument('--incident', choices=INCIDENTS, default='none')
    parser.add_argument(
        '--wait', type=float, default=60.0, help='how long your kart is awaited, s (%(default)s)'
    )
    given = parser.parse_args(arguments)
    for address in (given.host, given.address):
        if not _is_loopback(address):
            print(
                f'rehearse_kart: {address} is not on this machine. A rehearsal reaches loopback '
                'addresses only (127.0.0.1), so that no kart drives by it',
                file=sys.stderr,
            )
            return 2
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ['EVGP_GRAPH_INTERFACE'] = ''
    print(f'REHEARSAL of kart {given.kart}: {given.incident}', flush=True)
    # As Ctrl-C: a CI that ends this ends race control too.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    try:
        findings = _play(given)
    except KeyboardInterrupt:
        return 130
    for finding in findings:
        word = 'note' if finding.note else 'good' if finding.good else 'BAD '
        print(f'{word}  kart {given.kart} {finding.text}')
    bad = sum(not finding.good for finding in findings)
    print(f'{bad} of {len(findings)} findings are BAD' if bad else 'Nothing was bad')
    return 1 if bad else 0


def _play(given: argparse.Namespace) -> list[Finding]:
    findings: list[Finding] = []
    with tempfile.TemporaryDirectory() as folder, Domain() as domain:
        trial = Trial(
            pathlib.Path(folder), domain.number, given.host, given.port, given.kart, given.address
        )
        with contextlib.closing(trial):
            official = trial.official
            print(f'Connect your kart from {given.address} to {given.host}:{given.port}')
            sys.stdout.flush()
            try:
                official.patience = given.wait
                official.wait_for_connected(given.kart)
                official.patience = LIMITS['GRID_ACTIVE'] + 5.0
                official.bring_to(RaceState.GREEN_GREEN)
                time.sleep(RACING)
                INCIDENTS[given.incident](trial)
                _home(trial)
            except AssertionError as error:
                # What was awaited in vain; behind the first semicolon stands what came instead.
                findings.append(Finding(False, f'held the race up: {str(error).split(";")[0]}'))
            # What follows is the end of race control, which the kart has not caused.
            until = clock.now()
        record = pathlib.Path(folder, 'record.sqlite3')
        with contextlib.closing(open_read_only(record)) as database:
            happened = [
                event
                for run in sessions(database)
                for event in events(database, run.number)
                if event.monotonic <= until
            ]
    notes = [Finding(True, UNSEEN[given.incident], note=True)] if given.incident in UNSEEN else []
    return [*conduct(happened, given.kart), *findings, *notes]


def _home(trial: Trial) -> None:
    """Stop the race, wait until the kart has acknowledged, and send it to the garage."""
    official = trial.official
    official.patience = BACK + LIMITS['RED_FLAG']
    official.wait_for_kart(
        trial.kart,
        lambda kart: (
            kart.connected
            and (state_of(kart.sent) or RaceState.IN_GARAGE).is_red
            and kart.acknowledged
        ),
        'connected, and a red acknowledged',
    )
    official.patience = LIMITS['RED_FLAG'] + 5.0
    official.bring_to(RaceState.RED_RED)
    official.bring_to(RaceState.IN_GARAGE)


def _is_loopback(address: str) -> bool:
    try:
        return ipaddress.IPv4Address(address).is_loopback
    except ValueError:
        return False


if __name__ == '__main__':
    sys.exit(main())
