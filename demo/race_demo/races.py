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

"""The two races, driven as officials do: by service calls, looking at what race control says."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import time

from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from race_demo.paddock import BOOTS_LATE, FINISH_DELAYS, Paddock
from race_demo.record import RaceRecord

GREEN_GREEN = RaceState.GREEN_GREEN
GRID_ACTIVE = RaceState.GRID_ACTIVE
IN_GARAGE = RaceState.IN_GARAGE
RED_RED = RaceState.RED_RED

RACING = 2.0
"""How long the karts race, s: the example stack needs that to reach its speed."""

GAP = 0.4
"""Between two karts that cross the finish line, s."""

FINISHERS = (12, 42, 7, 5, 23)
"""The karts of the race, in the order in which they cross the finish line."""


class Races:
    """
    Drives races; everything that is heard of each is in its record.

    :param show_karts: is called where the state of all karts is worth a look.
    """

    def __init__(self, paddock: Paddock, show_karts: Callable[[str], None]) -> None:
        """Drive nothing yet."""
        self._paddock = paddock
        self._official = paddock.official
        self._show_karts = show_karts
        self._all = [entrant.number for entrant in paddock.entrants]
        self._racing = [entrant.number for entrant in paddock.entrants if entrant.in_race]

    def gather(self) -> None:
        """
        Wait until every kart is connected and sees IN_GARAGE.

        :raises AssertionError: if one does not in time.
        """
        self._official.wait_for_connected(*self._all)
        for number in self._all:
            self._paddock.kart(number).wait_for_state(IN_GARAGE)
            # Heard later, it would be taken for one of the first race.
            self._wait_for_order(1, number, IN_GARAGE)

    def race(self, title: str) -> RaceRecord:
        """Drive a race from the garage over the finish to the garage."""
        return self._recorded(title, self._race)

    def incident(self, title: str) -> RaceRecord:
        """Drive a race that ALL_KILL ends."""
        return self._recorded(title, self._incident)

    def _race(self, record: RaceRecord) -> None:
        official = self._official
        official.command('grid_active', track_clear=True)
        ready = [number for number in self._racing if number != BOOTS_LATE]
        try:
            self._wait_for(GRID_ACTIVE, ready)
        finally:
            # Also if one of them is not ready: the answer names all that are not.
            record.refused.append(official.call('green_green'))
        self._paddock.start_stack(BOOTS_LATE)
        self._green()
        for number in FINISHERS:
            official.command('kart/finish', kart=number)
            time.sleep(GAP)
        official.wait_for_race(lambda race: race.over, 'the race goes over by itself')
        record.over = True
        self._end(record, self._racing)

    def _incident(self, record: RaceRecord) -> None:
        official = self._official
        self._green()
        record.all_kill_called = time.monotonic()
        official.command('all_kill')
        record.refused.append(official.call('green_green'))
        self._end(record, self._all)

    def _green(self) -> None:
        self._official.bring_to(GREEN_GREEN, *self._racing)
        self._wait_for(GREEN_GREEN, self._racing)
        time.sleep(RACING)

    def _end(self, record: RaceRecord, stopped: Sequence[int]) -> None:
        """Wait until these karts have stopped, and send everybody to the garage."""
        self._wait_for(RED_RED, stopped)
        self._show_karts(f'{record.title}: every kart has stopped')
        self._official.command('in_garage', track_safe=True)
        for number in stopped:
            self._paddock.kart(number).wait_for_state(IN_GARAGE)
            self._wait_for_order(record.first_event, number, IN_GARAGE)
        self._official.wait_for_race(
            lambda race: all(state_of(kart.sent) is IN_GARAGE for kart in race.karts),
            'every kart is sent IN_GARAGE',
        )

    def _wait_for(self, state: RaceState, numbers: Sequence[int]) -> None:
        """Wait until race control has these karts' acknowledgements, and each sees the state."""
        self._official.wait_for_acks(state, *numbers)
        for number in numbers:
            self._paddock.kart(number).wait_for_state(state)

    def _wait_for_order(self, first: int, number: int, state: RaceState) -> None:
        """Wait until the events, a topic of their own, tell it too, from this one on."""
        self._official.wait_for_event(
            lambda event: (
                event.sequence >= first
                and event.kind == msg.RaceEvent.KART_STATE
                and event.kart == number
                and state_of(event.state) is state
            ),
            f'kart {number} is sent {state.value}',
        )

    def _recorded(self, title: str, drive: Callable[[RaceRecord], None]) -> RaceRecord:
        official = self._official
        began = time.monotonic()
        first = official.events[-1].sequence + 1 if official.events else 1
        record = RaceRecord(title, began, first, self._paddock.entrants, FINISH_DELAYS)
        try:
            drive(record)
        except AssertionError as error:
            # What the parts of a race raise when something does not come in time; behind the
            # first semicolon stands all that came instead.
            record.failure = str(error).split(';')[0]
        record.events = [event for event in list(official.events) if event.sequence >= first]
        record.final = official.race
        record.seen = {
            number: [
                (at, state)
                for at, state in list(self._paddock.kart(number).changes)
                if at >= began
            ]
            for number in self._all
        }
        return record
