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

"""All parts of the demonstration: started together, and ended together whatever happens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import contextlib
import os
import pathlib
import tempfile
import time
from typing import TypeVar
import uuid

from evgp_testing.domains import Domain
from evgp_testing.judge import Judge
from evgp_testing.kart import Bridge, ExampleStack, Team
from evgp_testing.official import Official
from evgp_testing.process import Process
from evgp_testing.race_control import address_of, RaceControl
from evgp_testing.wire_kart import Acknowledges, WireKart
from race_demo.record import Entrant

P = TypeVar('P', bound=Process)

PATIENCE = 10.0
"""How long anything is awaited, s: a busy machine needs some, a reader does not wait longer."""

FINISH_DELAYS = (2.0, 1.7, 1.4, 1.1, 0.8)
"""From FINISH to RED_FLAG by place, s: as at an event, the first drives on the longest."""

BRIDGED = {7: 'Purdue', 12: 'Georgia Tech', 23: 'Michigan'}
"""The karts with ROS."""

BOOTS_LATE = 23
"""The kart whose stack is started when the others are ready: GREEN_GREEN must wait for it."""

PLAIN = {
    5: ('Kennesaw State', Acknowledges.EACH_CHANGE),
    42: ('UC Berkeley', Acknowledges.EACH_FRAME),
    64: ('Kettering', Acknowledges.EACH_CHANGE),
}
"""The karts without ROS, and when each says back what it is sent."""

NOT_IN_RACE = (64,)

_KINDS = {
    Acknowledges.EACH_CHANGE: 'TCP, echo by change',
    Acknowledges.EACH_FRAME: 'TCP, echo by frame',
    Acknowledges.NEVER: 'TCP, mute',
}

_MARK = 'EVGP_DEMO'
"""In the environment of every process of the demonstration, and of what these start."""


class Paddock:
    """
    Race control, an official, the karts and their teams; all real, none a mock.

    :ivar exit_codes: of each process, once it has ended.
    :ivar judge: sees what is on the wire of the karts without ROS.
    :param stack: where every part is entered; what closes it ends them all.
    :param mute: a plain kart that never acknowledges, or None.
    """

    def __init__(self, stack: contextlib.ExitStack, mute: int | None = None) -> None:
        """Start everything but the stack of the kart that boots late."""
        self.exit_codes: dict[str, int] = {}
        self._stack = stack
        self._mark = uuid.uuid4().hex
        os.environ[_MARK] = self._mark
        # Of the processes and of the nodes in this one: nobody else's karts are commanded.
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
        plain = {
            number: Acknowledges.NEVER if number == mute else acknowledges
            for number, (_, acknowledges) in PLAIN.items()
        }
        teams = {**BRIDGED, **{number: team for number, (team, _) in PLAIN.items()}}
        kinds = {
            **dict.fromkeys(BRIDGED, 'ROS, bridge + stack'),
            **{number: _KINDS[acknowledges] for number, acknowledges in plain.items()},
        }
        self.entrants: Sequence[Entrant] = [
            Entrant(number, teams[number], kinds[number], number not in NOT_IN_RACE)
            for number in sorted(teams)
        ]
        self.domains = {number: stack.enter_context(Domain()).number for number in (0, *BRIDGED)}
        self.control = self._start('race control', self._race_control(teams))
        racing = {number for number in plain if number not in NOT_IN_RACE}
        self.judge = Judge(racing, NOT_IN_RACE, time.monotonic())
        self.official = stack.enter_context(Official(self.control.domain, judge=self.judge))
        self.official.patience = PATIENCE
        # The processes first: they start beside each other, and beside what follows.
        for number, domain in self.domains.items():
            if number:
                bridge = Bridge(domain, self.control.port, address_of(number))
                self._start(f'bridge {number}', bridge)
                if number != BOOTS_LATE:
                    self.start_stack(number)
        self.teams: Mapping[int, Team] = {number: self._team(number) for number in BRIDGED}
        self.plain: Mapping[int, WireKart] = {
            number: stack.enter_context(
                WireKart(
                    address_of(number),
                    self.control.port,
                    acknowledges,
                    judge=self.judge,
                    kart=number,
                )
            )
            for number, acknowledges in plain.items()
        }

    def start_stack(self, number: int) -> None:
        """Start the example autonomy stack of a kart, beside its bridge."""
        self._start(f'stack {number}', ExampleStack(self.domains[number]))

    def kart(self, number: int) -> Team | WireKart:
        """Return the kart's side: what it sees, when, and a way to wait for it."""
        return self.teams[number] if number in self.teams else self.plain[number]

    def nodes(self) -> dict[int, set[str]]:
        """Return the names of all ROS nodes on each domain; race control's is at number 0."""
        return {
            0: set(self.official.node.get_node_names()),
            **{number: set(team.node.get_node_names()) for number, team in self.teams.items()},
        }

    def leftovers(self) -> list[str]:
        """Return the processes that are still there of all that were started, even indirectly."""
        mark = f'{_MARK}={self._mark}'.encode()
        found = []
        for entry in pathlib.Path('/proc').glob('[0-9]*'):
            try:
                environment = (entry / 'environ').read_bytes().split(b'\0')
                command = (entry / 'cmdline').read_bytes().replace(b'\0', b' ')
            except OSError:
                continue  # it has just ended, or is somebody else's
            if mark in environment and int(entry.name) != os.getpid():
                found.append(f'{entry.name} {command.decode(errors="replace")}')
        return found

    def _race_control(self, teams: Mapping[int, str]) -> RaceControl:
        folder = self._stack.enter_context(tempfile.TemporaryDirectory())
        return RaceControl(
            pathlib.Path(folder),
            self.domains[0],
            in_race=[entrant.number for entrant in self.entrants if entrant.in_race],
            others=NOT_IN_RACE,
            parameters={'finish_delays': list(FINISH_DELAYS)},
            teams=teams,
        )

    def _team(self, number: int) -> Team:
        team = self._stack.enter_context(Team(self.domains[number], name=f'team_{number}'))
        team.patience = PATIENCE
        return team

    def _start(self, name: str, process: P) -> P:
        def end() -> None:
            self.exit_codes[name] = process.close()

        self._stack.callback(end)
        return process
