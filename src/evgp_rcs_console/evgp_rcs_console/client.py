# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Connects the console to ROS: receives the race and sends commands.

The client has two threads of its own, so that no screen ever waits for ROS:

- The executor's thread receives the race, its events, the results and the answers to commands.
- The sender's thread takes commands from a queue and calls the services. This thread repeats each
  stop until race control accepts it or a later race ends it (``StandingStops``). The same thread
  announces the official's presence, so a client whose sender hangs announces nothing.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
import contextlib
import functools
import math
import queue
import re
import threading
from typing import Any, Protocol, TypeVar
import uuid

from evgp_node.codec import value_of
from evgp_node.graph import fence_graph, reachable_at
from evgp_node.official import MOST_OF_NAME
from evgp_node.process import wait_until_heard
from evgp_node.qos import latched, volatile
from evgp_node.rclpy_private import RCLError
from evgp_node.results import Standings
from evgp_node.spinning import Spinning
from evgp_node.states import state_message
from evgp_protocol.clock import now
from evgp_protocol.states import RaceState
from evgp_rcs.ros.messages import event_of
from evgp_rcs.rules.race import Answer, LEAST_PAUSE, StampedEvent
from evgp_rcs.rules.snapshot import Snapshot
from evgp_rcs.words import STATES
from evgp_rcs_console import texts
from evgp_rcs_console.catalogue import CATALOGUE, Kind, OF_RACE_CONTROL
from evgp_rcs_console.commands import (
    Given,
    RaceBegan,
    request,
    Standing,
    StandingStops,
)
from evgp_rcs_msgs import msg, srv
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import qos_profile_services_default

_Read = TypeVar('_Read')

_NAMES = {each.name: STATES[each] for each in RaceState}
_NAMES |= {each.name: entry.label for each, entry in OF_RACE_CONTROL.items()}
_ONE_NAME = re.compile('|'.join(rf'\b{each}\b' for each in _NAMES))


@functools.lru_cache(maxsize=1000)
def spoken(sentence: str) -> str:
    """Return a sentence from race control, with states and commands named as on the screen."""
    return _ONE_NAME.sub(lambda name: _NAMES[name[0]], sentence)


WITHIN = 4.0
"""Time within which the sequence numbers of snapshots must fall twice to prove that there are two
race controls, in seconds. Each race control sends at least two snapshots a second."""


class Sources:
    """Detects a second race control by the sequence numbers of snapshots."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._falls: deque[float] = deque(maxlen=2)

    def are_two(self, number: int | None, now: float) -> bool:
        """Return whether there are two, once a snapshot with this number arrives (time in s)."""
        if number is not None and self._last is not None and number <= self._last:
            self._falls.append(now)
        self._last = number
        return len(self._falls) == 2 and now - self._falls[0] < WITHIN


GIVE_UP = 15.0
"""Maximum wait for the answer to a request, in seconds. Stops are repeated much sooner."""

THEN_WITHIN = LEAST_PAUSE / 2
"""Maximum time after a press in which the press may send further commands, in seconds. If another
official sends a stop in the meantime, these commands still arrive during the pause in which race
control refuses everything that loosens."""

PRESENCE_PERIOD = 0.5
"""Time between two announcements of presence, in seconds. After 2 s without one, race control
treats the program as gone."""

ANNOUNCE_QOS = volatile(10)
"""QoS of ``rcs/presence``."""

STOP_QOS = volatile(1)
"""
QoS of the clients that call the stops to more than one kart.

After 20 s of silence, Fast DDS forgets a machine and everything that was sent to that machine.
After a shorter outage, Fast DDS delivers the requests sent in the meantime, oldest first, and race
control acts on the first one. With ROS's usual depth of 10, the age in that request would be up to
5 s too small; with a depth of 1, at most ``PRESS_AGAIN``. The stops to single karts share a
service and keep the usual depth, because one kart's stop could otherwise push out another's.
"""


class Listener(Protocol):
    """
    Receives everything that arrives at the client.

    The client calls these methods in its own threads, sometimes with a lock held. A listener must
    therefore return at once and must not call the client.
    """

    def on_race(self, race: Snapshot, at: float, two: bool) -> None:
        """Handle a snapshot that arrived at a time (s), perhaps from one of two race controls."""

    def on_event(self, event: StampedEvent) -> None: ...

    def on_results(self, results: Standings) -> None: ...

    def on_answer(self, given: Given, answer: Answer) -> None:
        """Handle the final answer to a command, or a message that no answer arrived in time."""

    def on_dropped(self, given: Given, why: str) -> None:
        """Handle a stop that was dropped because a later race began; the sentence says so."""

    def on_pressing(self, stops: tuple[Standing, ...]) -> None:
        """Handle the list of all stops that race control has not accepted yet."""


class Client:
    """
    A client of race control.

    :param commands: the commands that the client can send. With SROS2, each of them needs a
        permission, and a client that only receives the race needs none of these permissions.
    :param there: name under which the program announces its presence (``announce``). The client
        announces nothing if the name is empty or SROS2 does not permit announcements.
    :param hears: whether snapshots are passed to the listener. The client always receives them.
    :param say: returns a sentence from race control in the words of this program.
    :raises RCLError: if ROS does not allow this client.
    """

    def __init__(
        self,
        name: str,
        listener: Listener,
        context: Context | None = None,
        commands: Iterable[Kind] = tuple(CATALOGUE),
        there: str = '',
        hears: bool = True,
        say: Callable[[str], str] = spoken,
        **node_options: Any,
    ) -> None:
        self.node = Node(name, context=context, **node_options)
        fence_graph()
        self._listener = listener
        self._services: dict[str, Any] = {}
        for entry in map(CATALOGUE.__getitem__, commands):
            if entry.service not in self._services:
                alone = entry.stop and not entry.to_one_kart
                self._services[entry.service] = self.node.create_client(
                    getattr(srv, entry.service_type),
                    f'rcs/{entry.service}',
                    qos_profile=STOP_QOS if alone else qos_profile_services_default,
                )
        subscribe = self.node.create_subscription
        subscribe(msg.Race, 'rcs/race', self._hear_race, latched(1))
        self._hears, self._say = hears, say
        if hears:
            subscribe(msg.RaceEvents, 'rcs/events', self._hear_events, latched(200))
            subscribe(msg.Results, 'rcs/timekeeper/results', self._hear_results, latched(1))
        self._program, self._id = there, uuid.uuid4().hex
        self._there: Publisher | None = None
        if there:
            with contextlib.suppress(RCLError):  # a spectators' screen has no permission
                publish = self.node.create_publisher
                self._there = publish(msg.Presence, 'rcs/presence', ANNOUNCE_QOS)
        self.topic: str = self.node.resolve_topic_name('rcs/race')
        self._sources = Sources()
        self._began = RaceBegan()
        self._stop_given_at = -math.inf
        self._given: queue.SimpleQueue[Given | msg.Presence | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._waiting: dict[Any, tuple[Given, float]] = {}  # each request, and when it was sent
        self._standing = StandingStops()
        self._karts: frozenset[int] | None = None
        self._hearing = Spinning(self.node, self._fail)
        self._sending = threading.Thread(target=self._send, name='sending', daemon=True)
        self._sending.start()

    def give(self, given: Given) -> None:
        """Queue a command for sending and return at once."""
        self._given.put(given)

    def announce(self, official: str, fault: str, presses: int = 0) -> None:
        """
        Announce that an official can stop the race from this program, and return at once.

        :param official: the official's name; empty if unknown.
        :param fault: why this program cannot stop the race now; empty if it can.
        :param presses: number of presses, for a program that reads a physical button.
        """
        presence = msg.Presence(program=self._program, id=self._id, fault=fault, presses=presses)
        presence.official = official[:MOST_OF_NAME]
        self._given.put(presence)

    def wait_for(self, command: Kind, seconds: float) -> bool:
        """Wait for a command's service; return whether it was found within so many seconds."""
        return bool(self._services[CATALOGUE[command].service].wait_for_service(seconds))

    def close(self) -> None:
        self._given.put(None)
        self._sending.join()
        if self._there is not None:
            wait_until_heard(self._there)
        self._hearing.stop()
        self.node.destroy_node()

    # ----- the sender's thread ------------------------------------------------------------

    def _send(self) -> None:
        while True:
            with self._lock:
                wait = self._standing.next_press(now())
            with contextlib.suppress(queue.Empty):
                given = self._given.get(timeout=wait)
                if given is None:
                    return
                if isinstance(given, msg.Presence):
                    self._publish(given)
                elif CATALOGUE[given.command].stop:
                    with self._lock:
                        self._standing.add(given, now())
                        self._stop_given_at = now()
                elif self._finds(given):
                    self._request(given)
                else:
                    self._failed(given, texts.not_there(given.command, texts.full_name(given)))
            # After each item of the queue, so that announcements never delay stops or time limits.
            self._press()
            self._give_up()

    def _publish(self, presence: msg.Presence) -> None:
        if self._there is None:
            return
        # Whatever fails here, such as DDS by a wall clock past 2038, this thread must send stops.
        with contextlib.suppress(Exception):
            if not self.node.count_services(self.node.resolve_service_name('rcs/all_kill')):
                presence.fault = presence.fault or "it cannot find race control's services"
            self._there.publish(presence)

    def _press(self) -> None:
        with self._lock:
            pressed = self._standing.press(now(), self._finds)
        for given in pressed:
            self._request(given)
        # The lock ensures that no stop is reported as unaccepted after it was reported accepted.
        with self._lock:
            if self._standing.pressed:
                self._listener.on_pressing(self._standing.pressed)

    def _finds(self, given: Given) -> bool:
        return bool(self._services[CATALOGUE[given.command].service].service_is_ready())

    def _request(self, given: Given) -> None:
        service = self._services[CATALOGUE[given.command].service]
        try:
            future = service.call_async(request_message(given))
        except Exception as error:  # noqa: BLE001 - whatever it is, this thread must send stops
            why = f'{texts.full_name(given)} was not sent: {error}.'
            if CATALOGUE[given.command].stop:
                with self._lock:
                    self._standing.refused(given, why, final=False)
            else:
                self._failed(given, why)
            return
        with self._lock:
            self._waiting[future] = given, now()
        future.add_done_callback(self._answered)

    def _give_up(self) -> None:
        """Stop waiting for answers to requests that were sent too long ago."""
        with self._lock:
            late = [each for each, (_, at) in self._waiting.items() if now() - at > GIVE_UP]
            given_up = [(future, self._waiting.pop(future)[0]) for future in late]
        for future, given in given_up:
            self._services[CATALOGUE[given.command].service].remove_pending_request(future)
            if not CATALOGUE[given.command].stop:
                self._failed(given, texts.no_answer(given, GIVE_UP))

    def _failed(self, given: Given, why: str) -> None:
        """Report why a command failed, and what was confirmed with it and is not sent."""
        why = ' '.join(filter(None, (why, _unsent(given))))
        self._listener.on_answer(given, Answer(False, why))

    # ----- the executor's thread ----------------------------------------------------------

    def _answered(self, future: Any) -> None:
        with self._lock:
            given, _ = self._waiting.pop(future, (None, 0.0))
            if given is None or future.cancelled():
                return
            answer = Answer(future.result().success, self._say(future.result().message))
            if answer.success:
                ended = self._standing.accepted(given)
            else:
                # By the rules, race control refuses a stop only for a kart that is not in its
                # roster. After any other failure, the stop is not in force and is sent again.
                known = self._karts is None or given.kart in self._karts
                final = CATALOGUE[given.command].to_one_kart and not known
                ended = self._standing.refused(given, answer.message, final)
            if ended:
                self._listener.on_pressing(self._standing.pressed)
            follows = given.followed_by() if answer.success else None
            soon = now() - given.at < THEN_WITHIN and self._stop_given_at < given.at
        # A stop that failed is sent again. Such failures and answers to older presses are not
        # reported.
        if ended or not CATALOGUE[given.command].stop:
            if answer.success:
                self._listener.on_answer(given, answer)
            else:
                self._failed(given, answer.message)
        if follows is not None and soon:
            self.give(follows)
        elif follows is not None:
            why = f'{_unsent(given)} The previous command took too long. Press again now.'
            self._listener.on_answer(follows, Answer(False, why))

    def _hear_race(self, message: msg.Race, info: dict[str, Any]) -> None:
        at = now()
        two = self._sources.are_two(info.get('publication_sequence_number'), at)
        race = self._read(lambda: value_of(message, Snapshot, self._say))
        if race is None:
            return
        began = self._began.hear(race.stamp, race.race_since, at)
        with self._lock:
            self._karts = frozenset(kart.number for kart in race.karts)
            # With two race controls, nobody knows which of the two races the press was for.
            ended = [] if two else self._standing.superseded(began, at)
            if ended:
                self._listener.on_pressing(self._standing.pressed)
        for given in ended:
            why = (
                f'{texts.full_name(given)}, pressed {round(at - given.at)} s ago, is no longer '
                f'being sent, because race control did not answer and another race has begun '
                f'since then. Press again to stop that race.'
            )
            self._listener.on_dropped(given, why)
        if self._hears:
            self._listener.on_race(race, at, two)

    def _hear_events(self, message: msg.RaceEvents) -> None:
        for each in message.events:
            event = self._read(functools.partial(event_of, each, self._say))
            if event is not None:
                self._listener.on_event(event)

    def _hear_results(self, message: msg.Results) -> None:
        results = self._read(lambda: value_of(message, Standings, self._say))
        if results is not None:
            self._listener.on_results(results)

    def _read(self, read: Callable[[], _Read]) -> _Read | None:
        """Return the content of a message; None if it is from another version."""
        try:
            return read()
        except ValueError as error:
            ignored = f'Ignored a message from another version of race control: {error}'
            self.node.get_logger().warning(ignored, throttle_duration_sec=10.0)
            return None

    def _fail(self, error: BaseException) -> None:
        # From now on, nothing is received. The screen shows that, and stops are still sent.
        self.node.get_logger().error(f'This program is no longer receiving the race: {error!r}')


def _unsent(given: Given) -> str:
    """Return a sentence that names the commands after this one; empty if there are none."""
    return f'Not sent: {", ".join(map(texts.full_name, given.then))}.' if given.then else ''


def request_message(given: Given) -> Any:
    fields = request(given, now())
    if 'hold' in fields:
        fields['hold'] = state_message(fields['hold'])
    return getattr(srv, CATALOGUE[given.command].service_type).Request(**fields)


def domain_of() -> int:
    return int(rclpy.utilities.get_default_context().get_domain_id())


def looking(topic: str) -> str:
    """Return a phrase that says where a client looks for race control."""
    at = ' and '.join(reachable_at())
    where = f'at {at}' if at else 'on this machine only (OFFICIALS= is not set)'
    return f'{topic} in ROS domain {domain_of()}, {where}'
