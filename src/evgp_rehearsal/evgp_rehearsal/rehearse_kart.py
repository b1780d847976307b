# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
``rehearse_kart``: a whole race with one incident, to a team's one kart, without an official.

The kart, by its bridge or its own client, connects to this machine's loopback address. The exit
code is for a team's CI.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
import contextlib
from dataclasses import dataclass
import ipaddress
import itertools
import os
import pathlib
import signal
import sys
import tempfile
import threading
import time

from evgp_node.states import state_of
from evgp_protocol import clock
from evgp_protocol.states import RaceState
from evgp_rcs.rules.race import EventKind
from evgp_rehearsal.conduct import conduct, Cut, Finding, LIMITS, NO_CUT
from evgp_rehearsal.event import recorded
from evgp_testing.domains import Domain
from evgp_testing.official import Official
from evgp_testing.race_control import forget_runs_at, RaceControl
from evgp_testing.wire_kart import WireKart

RACING = 3.0
"""Time that the kart races before anything happens, in seconds."""

BACK = 20.0
"""Time that a kart has to come back after its connection was lost, in seconds."""

SILENCE = 1.5
"""Time that race control says nothing, in seconds. A kart must stop by itself after 1 s, and
connects again; after 2 s it would rightly give up that connection too."""

TO_GARAGE = 20.0
"""Maximum time until a race whose kart stands is in IN_GARAGE, in seconds."""

REMINDS = 5.0
"""Time after which it is said again what is awaited, in seconds."""


@dataclass
class Trial:
    """
    A race control of one kart, and what can be done to that kart.

    :param cut: what an incident did to its connection.
    """

    folder: pathlib.Path
    domain: int
    host: str
    port: int
    kart: int
    address: str
    cut: Cut = NO_CUT

    def __post_init__(self) -> None:
        """Start race control, and an official who sends what the program says."""
        self.began = clock.now()
        forget_runs_at(self.host, self.port)  # a rehearsal that was killed; it is on loopback
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

    def silence(self) -> None:
        """Say nothing for a while, as a network does that is gone."""
        self.control.freeze()
        time.sleep(SILENCE)
        self.control.thaw()
        self.official.command('all_kill')

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

    def say(self, text: str) -> None:
        """Print a line, with the time since the beginning."""
        sys.stdout.write(f'{clock.now() - self.began:6.1f}  {text}\n')
        sys.stdout.flush()

    @contextlib.contextmanager
    def awaiting(self, what: str, limit: float) -> Iterator[Official]:
        """Say what the official awaits for its limit (s), and go on to say it."""
        over = threading.Event()

        def say() -> None:
            for waited in itertools.count(0.0, REMINDS):
                self.say(f'waiting for {what}: {waited:.0f} s of {limit:.0f} s')
                if over.wait(REMINDS):
                    return

        saying = threading.Thread(target=say, daemon=True)
        saying.start()
        self.official.timeout = limit
        try:
            yield self.official
        finally:
            over.set()
            saying.join()

    def _race_control(self) -> RaceControl:
        return RaceControl(
            self.folder,
            self.domain,
            [self.kart],
            parameters={'address': self.host, 'port': self.port},
            teams={self.kart: f'REHEARSAL {self.kart}'},
            addresses=lambda _: self.address,
        )


@dataclass(frozen=True)
class Incident:
    """
    What can happen in mid-race to the one kart.

    :param losses: how often it ends the kart's connection.
    :param unseen: what it asks of a kart and the record does not show.
    """

    play: Callable[[Trial], object]
    losses: int = 0
    unseen: str = ''


INCIDENTS: Mapping[str, Incident] = {
    'none': Incident(lambda trial: trial.official.command('kart/finish', kart=trial.kart)),
    'all_kill': Incident(lambda trial: trial.official.command('all_kill')),
    'red_red': Incident(lambda trial: trial.official.command('kart/red_red', kart=trial.kart)),
    'red_flag': Incident(lambda trial: trial.official.command('red_flag')),
    'silence': Incident(
        Trial.silence,
        1,
        'had to stop by itself after 1 s of silence: this program cannot see whether it did; '
        'make inspect-kart can',
    ),
    'second_machine': Incident(Trial.second_machine, 2),
    'race_control_crash': Incident(Trial.crash, 1),
}
"""What can happen, by its name; ``none``: the kart finishes."""


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Play a race.

    :return: 0; 1 if the kart did anything badly; 130 after Ctrl-C, which gives the findings so
        far. Where a setting is wrong, the program exits with 2.
    """
    parser = argparse.ArgumentParser(
        prog='rehearse_kart',
        description='Play a whole race with one incident to your kart, and say how it did.',
    )
    parser.add_argument(
        '--host', type=_loopback, default='127.0.0.1', help='where your kart connects; loopback'
    )
    parser.add_argument('--port', type=int, default=12017, help='at which port (%(default)s)')
    parser.add_argument('--kart', type=int, default=1, help='its number (%(default)s)')
    parser.add_argument(
        '--address',
        type=_loopback,
        default='127.0.0.1',
        help="your kart's own address (%(default)s)",
    )
    parser.add_argument('--incident', choices=INCIDENTS, default='none')
    parser.add_argument(
        '--wait', type=float, default=60.0, help='how long your kart is awaited, s (%(default)s)'
    )
    given = parser.parse_args(arguments)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ['EVGP_GRAPH_INTERFACE'] = ''
    print(f'REHEARSAL of kart {given.kart}: {given.incident}', flush=True)
    # As Ctrl-C: a CI that ends this ends race control too.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    try:
        findings, code = _play(given)
    except KeyboardInterrupt:
        return 130
    for finding in findings:
        word = 'note' if finding.note else 'good' if finding.good else 'BAD '
        print(f'{word}  kart {given.kart} {finding.text}')
    bad = sum(not finding.good for finding in findings)
    notes = sum(finding.note for finding in findings)
    verdict = f'{bad} of {len(findings)} findings are BAD' if bad else 'Nothing was bad'
    verdict += f'; {notes} not judged' if notes else ''
    print(f'Ended before the race was over. Until then: {verdict}' if code else verdict)
    return code or int(bad > 0)


def _play(given: argparse.Namespace) -> tuple[list[Finding], int]:
    """Return what was found, and the exit code of what ended it early; 0: nothing did."""
    findings: list[Finding] = []
    code = 0
    with tempfile.TemporaryDirectory() as folder, Domain() as domain:
        trial = Trial(
            pathlib.Path(folder), domain.number, given.host, given.port, given.kart, given.address
        )
        with contextlib.closing(trial):
            print(f'Connect your kart from {given.address} to {given.host}:{given.port}')
            sys.stdout.flush()
            try:
                with trial.official.telling(lambda event: trial.say(event.text)):
                    _race(trial, given.incident, given.wait)
            except AssertionError as error:
                # What was awaited in vain; behind the first semicolon stands what came instead.
                findings.append(Finding(False, f'held the race up: {str(error).split(";")[0]}'))
            except KeyboardInterrupt:
                code = 130
            except SystemExit as ended:
                code = int(ended.code or 0)
            until = clock.now()
        happened = recorded(pathlib.Path(folder))
        # Ctrl-C ends race control too. The kart has not caused what follows.
        until = min(
            [
                until,
                *(event.monotonic for event in happened if event.event.kind is EventKind.ENDED),
            ]
        )
        happened = [event for event in happened if event.monotonic <= until]
    unseen = INCIDENTS[given.incident].unseen
    if unseen and trial.cut is not NO_CUT:
        findings.append(Finding(True, unseen, note=True))
    return [*conduct(happened, given.kart, trial.cut, until), *findings], code


def _race(trial: Trial, name: str, wait: float) -> None:
    """Have the kart race, make the incident happen, and bring the kart to the garage."""
    incident, kart = INCIDENTS[name], trial.kart
    with trial.awaiting('your kart to connect', wait) as official:
        official.wait_for_connected(kart)
    with trial.awaiting('IN_GARAGE', TO_GARAGE) as official:
        official.bring_to(RaceState.IN_GARAGE)
    for state in (RaceState.GRID_ACTIVE, RaceState.GREEN_GREEN):
        what = f'your kart to acknowledge {state.value}'
        with trial.awaiting(what, LIMITS[state]) as official:
            official.bring_to(state)
    trial.say(f'your kart races for {RACING:g} s')
    time.sleep(RACING)
    if incident.losses:
        trial.cut = Cut(clock.now(), incident.losses)
    trial.say(f'now: {name}')
    incident.play(trial)
    with trial.awaiting(
        'your kart to acknowledge a stop', BACK + LIMITS[RaceState.RED_FLAG]
    ) as official:
        official.wait_for_kart(
            kart,
            lambda seen: (
                seen.connected
                and (state_of(seen.sent) or RaceState.IN_GARAGE).is_red
                and seen.acknowledged
            ),
            'connected, and a red acknowledged',
        )
    with trial.awaiting('IN_GARAGE', TO_GARAGE) as official:
        official.bring_to(RaceState.RED_RED)
        official.bring_to(RaceState.IN_GARAGE)


def _loopback(address: str) -> str:
    if ipaddress.IPv4Address(address).is_loopback:
        return address
    raise argparse.ArgumentTypeError(
        f'{address} is not on this machine. A rehearsal reaches loopback addresses only '
        '(127.0.0.1), so that no kart drives by it'
    )


if __name__ == '__main__':
    sys.exit(main())
