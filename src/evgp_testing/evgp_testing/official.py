# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""An official, who sends every command by a service call and sees the race as officials do."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
import threading
import time
from typing import Any

from evgp_node.qos import latched
from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind, kinds_by_service
from evgp_rcs_msgs import msg, srv
from evgp_testing.ros_side import RosSide
from evgp_testing.witness import Call, Witness
from rclpy.qos import QoSProfile

SERVICES = {entry.service: getattr(srv, entry.service_type) for entry in CATALOGUE.values()}
"""Every official's command, by the name of its service below ``/rcs/``."""

SEES = {
    entry.service: kind for kind, entry in CATALOGUE.items() if {'karts', 'hold'} & {*entry.takes}
}
"""The commands whose requests contain what the official saw, by their services."""


_WAY: dict[RaceState, tuple[RaceState | None, str, dict[str, bool]]] = {
    RaceState.RED_RED: (None, 'all_kill', {}),
    RaceState.IN_GARAGE: (RaceState.RED_RED, 'in_garage', {'track_safe': True}),
    RaceState.GRID_ACTIVE: (RaceState.IN_GARAGE, 'grid_active', {'track_clear': True}),
    RaceState.GREEN_GREEN: (RaceState.GRID_ACTIVE, 'green_green', {}),
    RaceState.RED_FLAG: (RaceState.GREEN_GREEN, 'red_flag', {}),
}
"""The previous state (None for any), command and statement with which a race gets to a state."""


def seen(race: msg.Race | None, service: str, kart: int) -> dict[str, Any]:
    """Return the fields of a request that contain what the official saw in a snapshot."""
    if race is None or service not in SEES:
        return {}
    kind = SEES[service]
    if 'hold' in CATALOGUE[kind].takes:
        held = next((each for each in race.karts if each.number == kart), None)
        return {} if held is None else {'hold': held.hold}
    number = getattr(msg.CommandAvailability, kind.name)
    saw = {'karts': next(each.karts for each in race.commands if each.command == number)}
    return saw | ({'opening': race.track.opening} if 'opening' in CATALOGUE[kind].takes else {})


def kind_of(service: str, request: Mapping[str, Any]) -> CommandKind:
    """
    Return the command that a call of this service with these fields sends.

    :raises ValueError: if there is no such command. The text lists the possible ones.
    """
    kinds = kinds_by_service().get(service)
    if kinds is None:
        raise ValueError(f'there is no command {service!r}; there are: {", ".join(SERVICES)}')
    for kind in kinds:
        if CATALOGUE[kind].fixed.items() <= request.items():
            return kind
    ways = (f'{name}={value}' for kind in kinds for name, value in CATALOGUE[kind].fixed.items())
    raise ValueError(f'{service} needs {" or ".join(ways)}')


TRIES = 5
"""Maximum number of attempts at a command, each with a newer snapshot of the race."""


@dataclass(frozen=True)
class Answer:
    """Race control's answer to a command."""

    success: bool
    message: str


class Official(RosSide):
    """
    A client of a running race control, on its domain.

    ``race`` is the newest snapshot, ``results`` are the timekeeper's newest results, and
    ``events`` are all events received, in order.

    :param witness: learns of every call and its answer.
    :param hears: the topics that the official listens to, out of `race`, `events`, `results`.
    """

    def __init__(
        self,
        domain: int,
        name: str = 'official',
        witness: Witness | None = None,
        hears: Collection[str] = ('race', 'events'),
    ) -> None:
        super().__init__(name, domain)
        self._name = name
        self._witness = witness
        self.race: msg.Race | None = None
        self.results: msg.Results | None = None
        self.events: list[msg.RaceEvent] = []
        self._clients = {
            # With the usual depth of 10, the last answers of a burst would push out the first.
            service: self.node.create_client(
                kind, f'/rcs/{service}', qos_profile=QoSProfile(depth=1000)
            )
            for service, kind in SERVICES.items()
        }
        subscribe = self.node.create_subscription
        if 'race' in hears:
            subscribe(msg.Race, '/rcs/race', lambda race: self.learn(race=race), latched(1))
        if 'events' in hears:
            subscribe(msg.RaceEvents, '/rcs/events', self._hear_events, latched(200))
        if 'results' in hears:
            subscribe(
                msg.Results,
                '/rcs/timekeeper/results',
                lambda results: self.learn(results=results),
                latched(1),
            )
        self.spin()

    def call(self, service: str, **request: Any) -> Answer:
        """
        Send a command, such as 'kart/red_red' with ``kart=7``, and return its answer.

        The request includes the official's name and what the official sees (karts, hold), unless
        ``request`` contains them.

        :raises ValueError: if there is no such command. The text lists the possible ones.
        """
        kind = kind_of(service, request)
        if service in SEES:
            self.wait_for_race(lambda race: True, 'a first look at the race')
        request = {
            'official': self._name,
            **seen(self.race, service, request.get('kart', 0)),
            **request,
        }
        entry = CATALOGUE[kind]
        call = Call(
            request['official'],
            kind,
            request.get('kart', 0) if entry.to_one_kart else 0,
            entry.call_is_statement or bool(request.get(entry.statement)),
            began=time.monotonic(),
        )
        if self._witness is not None:
            self._witness.calls.append(call)
        response: Any = self.request(self._clients[service], SERVICES[service].Request(**request))
        call.success, call.ended = response.success, time.monotonic()
        return Answer(response.success, response.message)

    def call_all(self, service: str, requests: Iterable[Mapping[str, Any]]) -> list[Answer]:
        """Send a command many times at once, and return the answers."""
        client = self._clients[service]
        assert client.wait_for_service(self.timeout), f'there is no service {service}'
        answered = threading.Semaphore(0)
        futures = []
        for request in requests:
            future = client.call_async(SERVICES[service].Request(**request))
            future.add_done_callback(lambda _: answered.release())
            futures.append(future)
        deadline = time.monotonic() + self.timeout
        for _ in futures:
            answered.acquire(timeout=max(0.0, deadline - time.monotonic()))
        missing = [at for at, future in enumerate(futures) if not future.done()]
        assert not missing, f'{service}: of {len(futures)} calls, not answered: {missing}'
        responses = [future.result() for future in futures]
        return [Answer(response.success, response.message) for response in responses]

    def command(self, service: str, **request: Any) -> Answer:
        """
        Send a command that must be accepted: a stop at once, any other once it is available.

        :raises AssertionError: if the command is refused. The text contains the reason.
        :raises ValueError: if there is no such command. The text lists the possible ones.
        """
        entry = CATALOGUE[kind_of(service, request)]
        if entry.stop:
            answer = self.call(service, **request)
            assert answer.success, f'{service}: {answer.message}'
            return answer
        for _ in range(TRIES):
            race = self.wait_for_available(service, **request)
            answer = self.call(service, **request)
            if answer.success:
                break
            # The snapshot used for the command may have been out of date.
            self.wait_for_race(lambda newer, seen=race: newer is not seen, 'a newer race')
        assert answer.success, f'{service}: {answer.message}'
        return answer

    def bring_to(
        self,
        state: RaceState,
        *numbers: int,
        acknowledge: Callable[[RaceState], object] = lambda state: None,
    ) -> None:
        """
        Bring the race from its present state to another, as officials do.

        :param numbers: the karts to wait for at each step; if there are none, those in the race.
        :param acknowledge: called at each step with the step's state, for karts that do not
            acknowledge automatically.
        :raises AssertionError: if a step is refused, or a kart does not acknowledge in time.
        """
        race = self.wait_for_race(lambda race: True, 'a first look at the race')
        numbers = numbers or tuple(kart.number for kart in race.karts if kart.in_race)
        if state_of(race.state) is not state:
            before, service, statement = _WAY[state]
            if before is not None:
                self.bring_to(before, *numbers, acknowledge=acknowledge)
            if state is RaceState.GRID_ACTIVE:
                self._close_track()
            self.command(service, **statement)
            self.wait_for_race(
                lambda race: state_of(race.state) is state, f'the race in {state.value}'
            )
        acknowledge(state)
        self.wait_for_acks(state, *numbers, needs_ack=state is not RaceState.IN_GARAGE)

    def wait_for_available(self, service: str, **request: Any) -> msg.Race:
        """Return the first snapshot in which a command is available, for example after a pause."""
        number = request.get('kart', 0)
        wanted = getattr(msg.CommandAvailability, kind_of(service, request).name)

        def available(race: msg.Race) -> bool:
            commands = [*race.commands]
            for kart in race.karts:
                commands += kart.commands if kart.number == number else ()
            return any(each.command == wanted and each.available for each in commands)

        return self.wait_for_race(available, f'{service} {request} available')

    def wait_for_race(self, found: Callable[[msg.Race], object], what: str) -> msg.Race:
        """
        Return the first snapshot for which `found` is true.

        :param what: what the caller waits for, for the failure message.
        """
        self.wait_until(
            lambda: self.race is not None and found(self.race),
            lambda: f'{what}; the race: {self.race!s:.5000}',
        )
        assert self.race is not None
        return self.race

    def wait_for_results(self, found: Callable[[msg.Results], object], what: str) -> msg.Results:
        """Return the timekeeper's first results for which `found` is true."""
        self.wait_until(
            lambda: self.results is not None and found(self.results),
            lambda: f'{what}; the results: {self.results!s:.5000}',
        )
        assert self.results is not None
        return self.results

    def wait_for_event(self, found: Callable[[msg.RaceEvent], object], what: str) -> msg.RaceEvent:
        """Return the first past or future event for which `found` is true."""
        return self.wait_until(
            lambda: next((event for event in self.events if found(event)), None),
            lambda: f'{what}; heard last: {[event.text for event in self.events[-50:]]}',
        )

    def wait_for_kart(
        self, number: int, found: Callable[[msg.KartStatus], object], what: str
    ) -> msg.KartStatus:
        """Return the first status of a kart for which `found` is true."""
        race = self.wait_for_race(
            lambda race: any(kart.number == number and found(kart) for kart in race.karts),
            f'kart {number}: {what}',
        )
        return next(kart for kart in race.karts if kart.number == number)

    def wait_for_acks(self, state: RaceState, *numbers: int, needs_ack: bool = True) -> None:
        """
        Wait until each of these karts is sent this state and has acknowledged it.

        :param needs_ack: False if no acknowledgement is needed, as in IN_GARAGE.
        """
        for number in numbers:
            self.wait_for_kart(
                number,
                lambda kart: state_of(kart.sent) is state and (kart.acknowledged or not needs_ack),
                f'{state.value} acknowledged',
            )

    def wait_for_connected(self, *numbers: int) -> None:
        """Wait until each of these karts is connected."""
        for number in numbers:
            self.wait_for_kart(number, lambda kart: kart.connected, 'connected')

    def tell_each(self, tell: Callable[[msg.RaceEvent], object]) -> None:
        """From now on, call a function with each event, first with those that came before."""

        def pass_on(message: msg.RaceEvents) -> None:
            for event in message.events:
                tell(event)

        self.node.create_subscription(msg.RaceEvents, '/rcs/events', pass_on, latched(200))

    def _close_track(self) -> None:
        """Close the track if it is open, because GRID_ACTIVE needs a closed track."""
        if self.race is not None and self.race.track.open:
            self.command('set_track_open', open=False)
            self.wait_for_race(lambda race: not race.track.open, 'the track closed')

    def _hear_events(self, message: msg.RaceEvents) -> None:
        with self.news:
            self.events += message.events
            self.news.notify_all()
