"""Officials who command at random, and often enough what brings the race on."""

from __future__ import annotations

import concurrent.futures
import random
import threading
import time
from typing import Any

from evgp_rcs.catalogue import CATALOGUE
from evgp_rcs_msgs import msg
from evgp_testing.official import latched, seen, SERVICES
from evgp_testing.ros_side import RosSide
from race_soak.checker import Call, Checker, STOPS

IN_GARAGE = msg.RaceState.IN_GARAGE
GRID_ACTIVE = msg.RaceState.GRID_ACTIVE
GREEN_GREEN = msg.RaceState.GREEN_GREEN
RED_FLAG = msg.RaceState.RED_FLAG
RED_RED = msg.RaceState.RED_RED

KART_STOPS = tuple(
    entry.service for entry in CATALOGUE.values() if entry.stop and entry.to_one_kart
)
STATEMENTS = tuple(entry.statement for entry in CATALOGUE.values() if entry.statement)


class _Caller(RosSide):
    """An official's client of every service; two of them call at the same time."""

    def __init__(self, name: str, domain: int, checker: Checker, lock: threading.Lock) -> None:
        """Join race control's domain."""
        super().__init__(name, domain)
        self.calls = 0
        self.accepted = 0
        self._checker = checker
        self._lock = lock
        self._clients = {
            service: self.node.create_client(kind, f'/rcs/{service}')
            for service, kind in SERVICES.items()
        }

    def wait_for_services(self) -> None:
        """
        Return once every service is there.

        :raises AssertionError: if one is not in time.
        """
        for client in self._clients.values():
            assert client.wait_for_service(self.patience), client.srv_name

    def call(self, service: str, **request: Any) -> bool:
        """
        Give a command and return whether it was accepted; the checker is told.

        :raises AssertionError: if there is no answer.
        """
        call = Call(
            command=service,
            kart=request.get('kart'),
            statement=any(request.get(name) for name in STATEMENTS),
            in_race=bool(request.get('in_race')),
            began=time.monotonic(),
        )
        with self._lock:
            self._checker.called(call)
        response: Any = self.request(self._clients[service], SERVICES[service].Request(**request))
        call.success, call.message = response.success, response.message
        call.ended = time.monotonic()
        with self._lock:
            self._checker.answered(call)
        self.calls += 1
        self.accepted += call.success
        return call.success


class Officials:
    """
    Two officials: one goes through races, at random; the other calls a stop at the same moment.

    :param numbers: the karts of the roster.
    :param disciplined: set while the karts are to behave.
    """

    def __init__(
        self,
        domain: int,
        numbers: list[int],
        checker: Checker,
        lock: threading.Lock,
        rng: random.Random,
        disciplined: threading.Event,
    ) -> None:
        """Join race control's domain."""
        self.races = 0
        self.greens = 0
        self._numbers = numbers
        self._rng = rng
        self._disciplined = disciplined
        self._stop = threading.Event()
        self._race: msg.Race | None = None
        self._wanted: set[int] = set()
        self._since = time.monotonic()
        self._patience = 0.0
        self._state = 0
        self._first = _Caller('first_official', domain, checker, lock)
        self._second = _Caller('second_official', domain, checker, lock)
        self._first.node.create_subscription(msg.Race, '/rcs/race', self._hear, latched(1))
        self._beside = concurrent.futures.ThreadPoolExecutor(1)
        self._first.spin()
        self._second.spin()
        for caller in (self._first, self._second):
            caller.wait_for_services()

    @property
    def calls(self) -> int:
        """Return how many calls were answered."""
        return self._first.calls + self._second.calls

    @property
    def accepted(self) -> int:
        """Return how many calls were accepted."""
        return self._first.accepted + self._second.accepted

    def step(self) -> None:
        """Do one thing, or wait a little for news."""
        race = self._race
        if race is None:
            self._pause(0.1)
            return
        state = race.state.state
        if state != self._state:
            self._state = state
            self._since = time.monotonic()
            self._patience = self._rng.choice((0.1, 0.5, 1.0, 3.0))
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
        """Leave."""
        self._stop.set()
        self._beside.shutdown()
        self._first.close()
        self._second.close()

    # ----- through a race -----------------------------------------------------------------

    def _plan(self) -> None:
        """Choose who takes part next, and whether the karts are to behave."""
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
        late = time.monotonic() - self._since > self._patience
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
        # Faults belong into a race.
        self._disciplined.clear()
        if time.monotonic() - self._since < self._patience:
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
        if time.monotonic() - self._since > self._patience:
            # Who does not acknowledge is made safe by hand.
            self._disciplined.set()
            for kart in race.karts:
                if kart.in_race and not kart.acknowledged:
                    self._call('kart/in_garage', kart=kart.number, made_safe_by_hand=True)
        self._pause(0.05)

    def _anything(self) -> None:
        """Give any command at all, with any statement."""
        service = self._rng.choice(list(SERVICES))
        if service in STOPS and self._rng.random() < 0.8:
            # Too many stops, and no race ever starts.
            service = self._rng.choice([name for name in SERVICES if name not in STOPS])
        request: dict[str, Any] = {}
        for name, kind in SERVICES[service].Request.get_fields_and_field_types().items():
            if kind == 'boolean':
                request[name] = self._rng.random() < 0.5
            elif kind == 'uint16':
                request[name] = self._rng.choice(self._numbers)
        self._call(service, **request)

    def _call(self, service: str, **request: Any) -> bool:
        """Give a command, now and then with a stop of the other official at the same moment."""
        if self._stop.is_set():
            return False
        request = {**seen(self._race, service, request.get('kart', 0)), **request}
        beside = None
        if service not in ('set_in_race', 'kart/in_garage') and self._rng.random() < 0.03:
            stop = self._rng.choice(STOPS)
            of_one = {'kart': self._rng.choice(self._numbers)} if stop in KART_STOPS else {}
            beside = self._beside.submit(self._second.call, stop, **of_one)
        success = self._first.call(service, **request)
        if beside is not None:
            beside.result()
        return success

    def _pause(self, seconds: float) -> None:
        self._stop.wait(seconds)

    def _hear(self, race: msg.Race) -> None:
        self._race = race
