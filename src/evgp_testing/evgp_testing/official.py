"""An official: every command as a service call, and the race as officials see it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
import threading
import time
from typing import Any

from evgp_node.services import service_class
from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rcs.catalogue import CATALOGUE
from evgp_rcs_msgs import msg
from evgp_testing.ros_side import RosSide
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def latched(depth: int) -> QoSProfile:
    """Return the QoS of a reliable, latched topic of which the last `depth` are kept."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


SERVICES = {entry.service: service_class(entry.service_type) for entry in CATALOGUE.values()}
"""Every command of an official, by the name of its service below ``/rcs/``."""

SEES = {
    entry.service: kind
    for kind, entry in CATALOGUE.items()
    if entry.names_karts or entry.names_hold
}
"""The commands that say what the official saw, by their services."""


def seen(race: msg.Race | None, service: str, kart: int) -> dict[str, Any]:
    """Return the fields of a request that say what the official saw in a snapshot."""
    if race is None or service not in SEES:
        return {}
    kind = SEES[service]
    if CATALOGUE[kind].names_hold:
        held = next((each for each in race.karts if each.number == kart), None)
        return {} if held is None else {'hold': held.hold}
    number = getattr(msg.CommandAvailability, kind.name)
    return {'karts': next(each.karts for each in race.commands if each.command == number)}


@dataclass(frozen=True)
class Answer:
    """What race control answered to a command."""

    success: bool
    message: str


class Official(RosSide):
    """
    A client of a running race control, on its domain.

    ``race`` is the newest snapshot, ``events`` every event heard, in order.
    """

    def __init__(self, domain: int, name: str = 'official') -> None:
        """Join race control's domain."""
        super().__init__(name, domain)
        self.race: msg.Race | None = None
        self.events: list[msg.RaceEvent] = []
        self._clients = {
            # With the usual depth of 10 a burst of answers would push out its first ones.
            service: self.node.create_client(
                kind, f'/rcs/{service}', qos_profile=QoSProfile(depth=1000)
            )
            for service, kind in SERVICES.items()
        }
        self.node.create_subscription(msg.Race, '/rcs/race', self._hear_race, latched(1))
        self.node.create_subscription(msg.RaceEvent, '/rcs/events', self._hear_event, latched(200))
        self.spin()

    def call(self, service: str, **request: Any) -> Answer:
        """
        Give a command, such as 'kart/red_red' with ``kart=7``, and return its answer.

        What the official sees (which karts, which hold) goes with it, unless ``request`` says.

        :raises AssertionError: if race control does not answer in time.
        """
        if service in SEES:
            self.wait_for_race(lambda race: True, 'a first look at the race')
        request = {**seen(self.race, service, request.get('kart', 0)), **request}
        response: Any = self.request(self._clients[service], SERVICES[service].Request(**request))
        return Answer(response.success, response.message)

    def call_all(self, service: str, requests: Iterable[Mapping[str, Any]]) -> list[Answer]:
        """
        Give a command many times at once, and return the answers.

        :raises AssertionError: if race control does not answer each in time.
        """
        client = self._clients[service]
        assert client.wait_for_service(self.patience), f'there is no service {service}'
        answered = threading.Semaphore(0)
        futures = []
        for request in requests:
            future = client.call_async(SERVICES[service].Request(**request))
            future.add_done_callback(lambda _: answered.release())
            futures.append(future)
        count = sum(answered.acquire(timeout=self.patience) for _ in futures)
        assert count == len(futures), f'{service}: {count} of {len(futures)} were answered'
        responses = [future.result() for future in futures]
        return [Answer(response.success, response.message) for response in responses]

    def command(self, service: str, **request: Any) -> Answer:
        """
        Give a command that must be accepted, if need be once the pause after a stop is over.

        :raises AssertionError: if it is refused; the text has the reason.
        """
        answer = self.call(service, **request)
        until = time.monotonic() + self.patience
        while (
            'a stop was sent just now' in answer.message
            or 'changed since you looked' in answer.message
        ) and time.monotonic() < until:
            time.sleep(0.05)  # the pause after a stop passes, or a newer race comes
            answer = self.call(service, **request)
        assert answer.success, f'{service}: {answer.message}'
        return answer

    def wait_for_race(self, found: Callable[[msg.Race], object], what: str) -> msg.Race:
        """
        Return the first snapshot for which `found` is true.

        :param what: what is awaited, for the message.
        :raises AssertionError: if none comes in time.
        """
        self.wait_until(
            lambda: self.race is not None and found(self.race),
            lambda: f'{what}; the race: {self.race!s:.5000}',
        )
        assert self.race is not None
        return self.race

    def wait_for_event(self, found: Callable[[msg.RaceEvent], object], what: str) -> msg.RaceEvent:
        """
        Return the first event, heard already or still to come, for which `found` is true.

        :raises AssertionError: if none comes in time.
        """
        return self.wait_until(
            lambda: next((event for event in self.events if found(event)), None),
            lambda: f'{what}; heard last: {[event.text for event in self.events[-50:]]}',
        )

    def wait_for_kart(
        self, number: int, found: Callable[[msg.KartStatus], object], what: str
    ) -> msg.KartStatus:
        """
        Return the first status of a kart for which `found` is true.

        :raises AssertionError: if none comes in time.
        """
        race = self.wait_for_race(
            lambda race: any(kart.number == number and found(kart) for kart in race.karts),
            f'kart {number}: {what}',
        )
        return next(kart for kart in race.karts if kart.number == number)

    def wait_for_acks(self, state: RaceState, *numbers: int) -> None:
        """
        Return once each of these karts is sent, and has acknowledged, this state.

        :raises AssertionError: if that does not happen in time.
        """
        for number in numbers:
            self.wait_for_kart(
                number,
                lambda kart: kart.acknowledged and state_of(kart.sent) is state,
                f'{state.value} acknowledged',
            )

    def wait_for_connected(self, *numbers: int) -> None:
        """
        Return once each of these karts is connected.

        :raises AssertionError: if that does not happen in time.
        """
        for number in numbers:
            self.wait_for_kart(number, lambda kart: kart.connected, 'connected')

    def _hear_race(self, race: msg.Race) -> None:
        with self.news:
            self.race = race
            self.news.notify_all()

    def _hear_event(self, event: msg.RaceEvent) -> None:
        with self.news:
            self.events.append(event)
            self.news.notify_all()
