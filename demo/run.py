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
Show two races: race control, karts with ROS and without, an official; see ``--help``.

    make demo
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import contextlib
import signal
import sys
import time

from evgp_protocol.states import RaceState
from race_demo.checks import (
    check_domains,
    check_end,
    check_incident,
    check_race,
    check_wire,
    Finding,
)
from race_demo.paddock import Paddock, PLAIN
from race_demo.races import Races
from race_demo.screen import make_console, Screen
from rich.console import Console


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Show two races.

    :return: 0 if all that must happen did, 1 if anything is missing, 130 after Ctrl-C.
    """
    parser = argparse.ArgumentParser(
        prog='demo/run.py',
        description='Show a race from the garage to the garage, and one that ALL_KILL ends. '
        'Exit code 1 if anything is missing.',
    )
    parser.add_argument(
        '--mute',
        type=int,
        choices=sorted(PLAIN),
        metavar='KART',
        help='this kart never acknowledges: see that the race does not start, and why '
        f'({", ".join(map(str, sorted(PLAIN)))})',
    )
    mute = parser.parse_args(arguments).mute
    # What ends the demonstration ends its processes too. A shell that puts it into the background
    # has SIGINT ignored, which Python would leave so.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))
    console = make_console()
    began = time.monotonic()
    try:
        findings = _show(console, began, mute)
    except KeyboardInterrupt:
        console.print('Interrupted')
        return 130
    missing = [finding for finding in findings if not finding.ok]
    verdict = 'Nothing is missing'
    if missing:
        verdict = f'{len(missing)} of {len(findings)} findings MISSING'
        for finding in missing:
            console.print(f'MISSING: {finding.text}', markup=False)
    console.rule(f'{verdict}; {time.monotonic() - began:.1f} s', style='bold')
    return 1 if missing else 0


def _show(console: Console, began: float, mute: int | None) -> list[Finding]:
    with contextlib.ExitStack() as stack:
        paddock = Paddock(stack, mute)

        def sees(number: int) -> RaceState | None:
            changes = paddock.kart(number).changes
            return changes[-1][1] if changes else None

        screen = Screen(console, began, paddock.official, paddock.entrants, sees)
        races = Races(paddock, screen.show_karts)
        with screen.watching('The karts connect'):
            races.gather()
        findings: list[Finding] = []
        for title, drive, check in (
            ('Race 1, from the garage to the garage', races.race, check_race),
            ('Race 2, ALL_KILL in mid-race', races.incident, check_incident),
        ):
            with screen.watching(title):
                record = drive(title)
            screen.show_timeline(record)
            found = check(record)
            screen.show_findings(f'{title}: findings', found)
            findings += found
            if record.failure:
                break
        screen.show_karts('At the end')
        around = [check_wire(paddock.judge), check_domains(paddock.nodes())]
    around.append(check_end(paddock.exit_codes, paddock.leftovers()))
    screen.show_findings('Around the races: findings', around)
    return findings + around


if __name__ == '__main__':
    sys.exit(main())
