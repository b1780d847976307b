# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Officials who command at random, but often enough in a way that advances the race."""

from __future__ import annotations

import concurrent.futures
import random
import threading
import time
from typing import Any

from evgp_rcs.rules.catalogue import CATALOGUE
from evgp_rcs_msgs import msg
from evgp_testing.official import Official, SERVICES
from evgp_testing.part import Part
from evgp_testing.witness import Witness

IN_GARAGE = msg.RaceState.IN_GARAGE
GRID_ACTIVE = msg.RaceState.GRID_ACTIVE
GREEN_GREEN = msg.RaceState.GREEN_GREEN
RED_FLAG = msg.RaceState.RED_FLAG
RED_RED = msg.RaceState.RED_RED

STOPS = {entry.service: entry for entry in CATALOGUE.values() if entry.stop}


class Officials(Part):
    """
    Two officials: one goes through random races; the other may call a stop at the same moment.

    :param numbers: the karts in the roster.
    :param disciplined: set while the karts should behave.
    """

    def __init__(
        self,
        domain: int,
        numbers: list[int],
        witness: Witness,
        rng: random.Random,
        disciplined: threading.Event,
    ) -> None:
        self.races = 0
        self.greens = 0
        self.calls = 0
        self.accepted = 0
        self._numbers = numbers
        self._rng = rng
        self._disciplined = disciplined
        self._stop = threading.Event()
        self._wanted: set[int] = set()
        self._since = time.monotonic()
        self._lasts = 0.0
        self._state = 0
        # It subscribes only to what it needs, because the karts need this process's time.
        self._first = Official(domain, 'first_official', witness, hears=['race'])
        self._second = Official(domain, 'second_official', witness, hears=[])
        self._beside = concurrent.futures.ThreadPoolExecutor(1)

    def step(self) -> None:
        """Take one action, or wait a little for news."""
        race = self._first.race
        if race is None:
            self._pause(0.1)
            return
        state = race.state.state
        if state != self._state:
            self._state = state
            self._since = time.monotonic()
            self._lasts = self._rng.choice((0.1, 0.5, 1.0, 3.0))
            if state == IN_GARAGE:
                self._plan()
        if self._rng.random() < 0.1:
            self._anything()
        elif state == IN_GARAGE:
            self._in_garage(race)
        elif state == GRID_ACTIVE:
            self._on_the_grid(race)
        elif state == GREEN_GREEN:
            self._racing(race)
        else:
            self._stopped(race)

    def close(self) -> None:
        self._stop.set()
        self._beside.shutdown()
        self._first.close()
        self._second.close()

    # ----- through a race -----------------------------------------------------------------

    def _plan(self) -> None:
        """Choose the karts of the next race, and whether they should behave."""
        size = self._rng.choice((1, 2, 3, 5, 10, 10, 30, len(self._numbers)))
        self._wanted = set(self._rng.sample(self._numbers, min(size, len(self._numbers))))
        self.races += 1
        if self._rng.random() < 0.8:
            self._disciplined.set()
        else:
            self._disciplined.clear()

    def _in_garage(self, race: msg.Race) -> None:
        for kart in race.karts:
            wanted = kart.number in self._wanted
            if kart.in_race != wanted:
                self._call('set_in_race', kart=kart.number, in_race=wanted)
            if wanted and kart.may_be_moving and not kart.hold.state:
                self._call('kart/red_red', kart=kart.number)
            elif wanted and kart.hold.state and self._rng.random() < 0.9:
                self._call('kart/in_garage', kart=kart.number, made_safe_by_hand=True)
        self._call('grid_active', track_clear=True)
        self._pause(0.02)

    def _on_the_grid(self, race: msg.Race) -> None:
        ready = all(kart.acknowledged for kart in race.karts if kart.in_race)
        late = time.monotonic() - self._since > self._lasts
        if ready and self._rng.random() < 0.9:
            if self._call('green_green'):
                self.greens += 1
            self._pause(0.02)
        elif late and self._rng.random() < 0.3:
            self._call(self._rng.choice(('green_green', 'race_over', 'all_kill')))
        elif late and self._rng.random() < 0.5:
            self._call('in_garage', track_safe=True)
        elif self._rng.random() < 0.2:
            self._call('green_green')
        else:
            self._pause(0.03)

    def _racing(self, race: msg.Race) -> None:
        # A race should have faults.
        self._disciplined.clear()
        if time.monotonic() - self._since < self._lasts:
            racing = [kart.number for kart in race.karts if kart.in_race]
            if racing and self._rng.random() < 0.1:
                self._call('kart/finish', kart=self._rng.choice(racing))
            self._pause(0.05)
            return
        self._call(self._rng.choice(('all_kill', 'red_flag', 'race_over', 'record_msr')))

    def _stopped(self, race: msg.Race) -> None:
        if race.state.state == RED_FLAG:
            self._pause(self._rng.uniform(0, 0.3))
            self._call('race_over')
            return
        if self._call('in_garage', track_safe=True):
            return
        if time.monotonic() - self._since > self._lasts:
            # Karts that do not acknowledge are made safe by hand.
            self._disciplined.set()
            for kart in race.karts:
                if kart.in_race and not kart.acknowledged:
                    self._call('kart/in_garage', kart=kart.number, made_safe_by_hand=True)
        self._pause(0.05)

    def _anything(self) -> None:
        """Give any command at all, with any statement."""
        service = self._rng.choice(list(SERVICES))
        if service in STOPS and self._rng.random() < 0.8:
            # With too many stops, no race would ever start.
            service = self._rng.choice([name for name in SERVICES if name not in STOPS])
        request: dict[str, Any] = {}
        for name, kind in SERVICES[service].Request.get_fields_and_field_types().items():
            if kind == 'boolean':
                request[name] = self._rng.random() < 0.5
            elif kind == 'uint16':
                request[name] = self._rng.choice(self._numbers)
        self._call(service, **request)

    def _call(self, service: str, **request: Any) -> bool:
        """Give a command, sometimes with a simultaneous stop by the other official."""
        if self._stop.is_set():
            return False
        beside = None
        if service not in ('set_in_race', 'kart/in_garage') and self._rng.random() < 0.03:
            stop = self._rng.choice([*STOPS])
            of_one = {'kart': self._rng.choice(self._numbers)} if STOPS[stop].to_one_kart else {}
            beside = self._beside.submit(self._second.call, stop, **of_one)
        answers = [self._first.call(service, **request)]
        if beside is not None:
            answers.append(beside.result())
        self.calls += len(answers)
        self.accepted += sum(answer.success for answer in answers)
        return answers[0].success

    def _pause(self, seconds: float) -> None:
        self._stop.wait(seconds)
