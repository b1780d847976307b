# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The console's ROS side: hears the race, and gives commands, in threads of its own.

Two threads, so that nothing a screen does ever waits for ROS:

- the executor's thread hears the race, its events, the results and the answers to commands;
- the sender's thread takes commands from a queue and calls the services. It also presses each stop
  again and again, once asked for, until race control has accepted it or it has outlived its race
  (``StandingStops``). That somebody is there goes the same way, so that it is not said where no
  stop gets out.

Whoever listens is called in these threads, and must hand over to its own at once.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
import contextlib
import functools
import ipaddress
import math
import queue
import re
import threading
from typing import Any, Protocol, TypeVar
import uuid

from evgp_node.codec import value_of
from evgp_node.graph import bind_graph, EVERY, fence_graph, reachable_at
from evgp_node.official import MOST_OF_NAME
from evgp_node.process import wait_until_heard
from evgp_node.qos import latched
from evgp_node.rclpy_private import RCLError
from evgp_node.results import Standings
from evgp_node.services import service_class
from evgp_node.spinning import Spinning
from evgp_node.states import state_message
from evgp_protocol.clock import duration, now
from evgp_protocol.states import RaceState
from evgp_rcs.ros.messages import event_of
from evgp_rcs.rules.race import Answer, LEAST_PAUSE, StampedEvent
from evgp_rcs.rules.snapshot import Snapshot
from evgp_rcs.words import STATES
from evgp_rcs_console import texts
from evgp_rcs_console.catalogue import CATALOGUE, Kind, OF_RACE_CONTROL
from evgp_rcs_console.commands import (
    Given,
    PRESS_AGAIN,
    RaceBegan,
    request,
    Standing,
    StandingStops,
)
from evgp_rcs_msgs import msg
import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    qos_profile_services_default,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.signals import SignalHandlerOptions

_Read = TypeVar('_Read')

_NAMES = {each.name: STATES[each] for each in RaceState}
_NAMES |= {each.name: entry.label for each, entry in OF_RACE_CONTROL.items()}
_ONE_NAME = re.compile('|'.join(rf'\b{each}\b' for each in _NAMES))


@functools.lru_cache(maxsize=1000)
def spoken(sentence: str) -> str:
    """Return a sentence of race control with each name as buttons and rows have it."""
    return _ONE_NAME.sub(lambda name: _NAMES[name[0]], sentence)


WITHIN = 4.0
"""Time within which the numbers must go down twice, in seconds; each is heard twice a second."""


class Sources:
    """Hears the numbers of snapshots."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._falls: deque[float] = deque(maxlen=2)

    def hear(self, number: int, now: float) -> None:
        """Take the number of a snapshot and when it came, in seconds."""
        if self._last is not None and number <= self._last:
            self._falls.append(now)
        self._last = number

    def are_two(self, now: float) -> bool:
        """Return whether two race controls are heard."""
        return len(self._falls) == 2 and now - self._falls[0] < WITHIN


GIVE_UP = 15.0
"""Time for which an answer to a command that is no stop is waited for, in seconds."""

THEN_WITHIN = LEAST_PAUSE / 2
"""Maximum time from a press to the last command that it gives, in seconds. So it still comes in
the pause after a stop of another official, in which race control takes none that loosens."""

PRESSES = 10
"""Number of unanswered presses of one stop whose answers are still waited for."""


THERE_EVERY = 0.5
"""Time between two words that somebody is there, in seconds; 2 s without one, and nobody is."""

THERE_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
    # For whoever wants to know by DDS alone: nothing but a word says that the program is alive.
    liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
    liveliness_lease_duration=Duration(seconds=2),
)
"""Of ``rcs/presence``."""

STOP_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""
Of the services of the stops that are for no single kart, to call them.

Fast DDS forgets a machine that it has not heard for 20 s, and what was sent to it. After a shorter
outage it delivers what was sent meanwhile, the oldest first. With ROS's usual depth of 10 the one
that counts, the first, would say an age that is 5 s too small. With 1 it is the newest one, too
small by ``PRESS_AGAIN`` at most. The stops of karts share a service, so there a stop could
push out one of another kart.
"""


class Listener(Protocol):
    """
    Who is told what the client hears.

    Called in the client's threads, with its lock held at times: it must not call the client.
    """

    def on_race(self, race: Snapshot, at: float, two: bool) -> None:
        """
        Take a snapshot.

        :param at: when it came, by the clock that counts a suspend, in seconds.
        :param two: snapshots come from two race controls.
        """

    def on_event(self, event: StampedEvent) -> None:
        """Take an event."""

    def on_results(self, results: Standings) -> None:
        """Take the results as they stand now."""

    def on_answer(self, given: Given, answer: Answer) -> None:
        """Take the answer to a command, also that none came; of a stop, the one that counts."""

    def on_dropped(self, given: Given, why: str) -> None:
        """Take that a stop is not sent any more: a later race has begun; why, as a sentence."""

    def on_pressing(self, stops: tuple[Standing, ...]) -> None:
        """Take the stops that race control has not accepted yet, and how often each was sent."""


class Client:
    """
    A client of race control.

    :param context: the ROS context; the process's own if it is None.
    :param commands: what it may be asked to give. For each of them it needs a permission where
        SROS2 is in force; to hear the race it needs none of them.
    :param there: the program at which an official sits (``say_there``); empty: nobody does, as
        without that permission.
    :param hears: the listener hears the race. Otherwise the client alone does, for its stops.
    :raises RCLError: if ROS does not let it be that client.
    """

    def __init__(
        self,
        name: str,
        listener: Listener,
        context: Context | None = None,
        commands: Iterable[Kind] = tuple(CATALOGUE),
        there: str = '',
        hears: bool = True,
        **node_options: Any,
    ) -> None:
        """Join the domain and begin to hear."""
        self.node = Node(name, context=context, **node_options)
        fence_graph()
        self._listener = listener
        self._services: dict[str, Any] = {}
        for entry in map(CATALOGUE.__getitem__, commands):
            if entry.service not in self._services:
                alone = entry.stop and not entry.to_one_kart
                self._services[entry.service] = self.node.create_client(
                    service_class(entry.service_type),
                    f'rcs/{entry.service}',
                    qos_profile=STOP_QOS if alone else qos_profile_services_default,
                )
        subscribe = self.node.create_subscription
        subscribe(msg.Race, 'rcs/race', self._hear_race, latched(1))
        self._hears = hears
        if hears:
            subscribe(msg.RaceEvents, 'rcs/events', self._hear_events, latched(200))
            subscribe(msg.Results, 'rcs/timekeeper/results', self._hear_results, latched(1))
        self._program, self._id = there, uuid.uuid4().hex
        self._there: Publisher | None = None
        if there:
            with contextlib.suppress(RCLError):  # a screen for spectators
                self._there = self.node.create_publisher(msg.Presence, 'rcs/presence', THERE_QOS)
        self.topic: str = self.node.resolve_topic_name('rcs/race')
        self._sources = Sources()
        self._began = RaceBegan()
        self._stop_given_at = -math.inf
        self._given: queue.SimpleQueue[Given | msg.Presence | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._waiting: dict[Any, Given] = {}
        self._standing = StandingStops()
        self._karts: frozenset[int] | None = None
        self._hearing = Spinning(self.node, self._fail)
        self._sending = threading.Thread(target=self._send, name='sending', daemon=True)
        self._sending.start()

    def give(self, given: Given) -> None:
        """Give a command, and return at once."""
        self._given.put(given)

    def say_there(self, official: str, fault: str, presses: int = 0) -> None:
        """
        Say that an official is there who can stop the race, and return at once.

        :param official: who; empty: nobody said.
        :param fault: why the race cannot be stopped from there now; empty: it can.
        :param presses: of a button: how often it was pressed.
        """
        word = msg.Presence(program=self._program, id=self._id, fault=fault, presses=presses)
        word.official = official[:MOST_OF_NAME]
        self._given.put(word)

    def wait_for(self, command: Kind, seconds: float) -> bool:
        """Return whether race control offers a command, once it does or time is up."""
        return bool(self._services[CATALOGUE[command].service].wait_for_service(seconds))

    def close(self) -> None:
        """Leave the domain."""
        self._given.put(None)
        self._sending.join()
        if self._there is not None:
            wait_until_heard(self._there)
        self._hearing.stop()
        self.node.destroy_node()

    # ----- the sender's thread ------------------------------------------------------------

    def _send(self) -> None:
        while True:
            with contextlib.suppress(queue.Empty):
                given = self._given.get(timeout=self._wake())
                if given is None:
                    return
                if isinstance(given, msg.Presence):
                    self._say(given)
                elif CATALOGUE[given.command].stop:
                    with self._lock:
                        self._standing.add(given, now())
                        self._stop_given_at = now()
                else:
                    self._call(given)
            # Each time: what else goes this way, such as that somebody is there, puts off neither.
            self._press()
            self._give_up()

    def _say(self, word: msg.Presence) -> None:
        if self._there is not None:
            if not self.node.count_services(self.node.resolve_service_name('rcs/all_kill')):
                word.fault = word.fault or texts.NO_SERVICE
            self._there.publish(word)

    def _wake(self) -> float | None:
        with self._lock:
            press = self._standing.next_press(now())
            if press is None:
                return PRESS_AGAIN if self._waiting else None
            return press

    def _press(self) -> None:
        with self._lock:
            pressed = self._standing.press(now(), self._finds)
        for given in pressed:
            self._request(given)
        # Told under the lock: never after it is told that the press was accepted.
        with self._lock:
            if self._standing.pressed:
                self._listener.on_pressing(self._standing.pressed)

    def _finds(self, given: Given) -> bool:
        return bool(self._services[CATALOGUE[given.command].service].service_is_ready())

    def _call(self, given: Given) -> None:
        if self._finds(given):
            self._request(given)
            return
        why = texts.not_there(given.command, texts.full_name(given))
        self._listener.on_answer(given, Answer(False, why))

    def _request(self, given: Given) -> None:
        service = self._services[CATALOGUE[given.command].service]
        future = service.call_async(request_message(given))
        with self._lock:
            self._waiting[future] = given
        future.add_done_callback(self._answered)

    def _give_up(self) -> None:
        """Forget what can no longer be answered."""
        late: dict[Any, Given] = {}
        presses: dict[tuple[Kind, int], list[Any]] = {}
        with self._lock:
            for future, given in self._waiting.items():
                if CATALOGUE[given.command].stop:
                    presses.setdefault((given.command, given.kart), []).append(future)
                elif now() - given.at > GIVE_UP:
                    late[future] = given
            for futures in presses.values():
                for future in futures[:-PRESSES]:
                    late[future] = self._waiting[future]
            for future in late:
                del self._waiting[future]
        for future, given in late.items():
            self._services[CATALOGUE[given.command].service].remove_pending_request(future)
            if not CATALOGUE[given.command].stop:
                text = texts.gave_up(given, duration(GIVE_UP, 0))
                self._listener.on_answer(given, Answer(False, text))

    # ----- the executor's thread ----------------------------------------------------------

    def _answered(self, future: Any) -> None:
        with self._lock:
            given = self._waiting.pop(future, None)
            if given is None or future.cancelled():
                return
            answer = Answer(future.result().success, spoken(future.result().message))
            stood = self._standing.stands(given)
            if answer.success:
                ended = self._standing.accepted(given)
            else:
                # By the rules race control refuses a stop for one reason only: it has no such
                # kart. Whatever else it says, the stop is not in force.
                unknown = self._karts is not None and given.kart not in {0, *self._karts}
                self._standing.refused(given, answer.message, final=unknown)
                ended = stood and unknown
            if ended:
                self._listener.on_pressing(self._standing.pressed)
            follows = given.followed_by() if answer.success else None
            soon = now() - given.at < THEN_WITHIN and self._stop_given_at < given.at
        # An earlier press of the same, or one that failed, is pressed again and not told.
        if ended or not CATALOGUE[given.command].stop:
            self._listener.on_answer(given, answer)
        if follows is not None and soon:
            self.give(follows)
        elif follows is not None:
            self._listener.on_answer(follows, Answer(False, texts.not_followed(follows)))

    def _hear_race(self, message: msg.Race, info: dict[str, Any]) -> None:
        at = now()
        number = info.get('publication_sequence_number')
        if number is not None:
            self._sources.hear(number, at)
        two = self._sources.are_two(at)
        race = self._read(lambda: value_of(message, Snapshot, spoken))
        if race is None:
            return
        began = self._began.hear(race.stamp, race.race_since, at)
        with self._lock:
            self._karts = frozenset(kart.number for kart in race.karts)
            # Of two race controls nobody knows of which race the press was.
            ended = [] if two else self._standing.outlived(began, at)
            if ended:
                self._listener.on_pressing(self._standing.pressed)
        for given in ended:
            self._listener.on_dropped(given, texts.dropped(given, at))
        if self._hears:
            self._listener.on_race(race, at, two)

    def _hear_events(self, message: msg.RaceEvents) -> None:
        for each in message.events:
            event = self._read(functools.partial(event_of, each, spoken))
            if event is not None:
                self._listener.on_event(event)

    def _hear_results(self, message: msg.Results) -> None:
        results = self._read(lambda: value_of(message, Standings, spoken))
        if results is not None:
            self._listener.on_results(results)

    def _read(self, read: Callable[[], _Read]) -> _Read | None:
        """Return what a message says; None: it is not race control's, and is not shown."""
        try:
            return read()
        except ValueError as error:
            said = f'A message is left out that is not of this race control: {error}'
            self.node.get_logger().warning(said, throttle_duration_sec=10.0)
            return None

    def _fail(self, error: BaseException) -> None:
        # Nothing is heard from now on: the screen says so, and stops are pressed on.
        self.node.get_logger().error(f'The race is no longer heard: {error!r}')


def join_graph(program: str, arguments: Sequence[str]) -> None:
    """
    Start ROS on the officials' graph: loopback, or the interface that is named.

    :raises GraphError: if no interface has the address that is named.
    """
    bind_graph()
    # A signal is the program's own business: its window and its children are to end in order.
    rclpy.init(args=[program, *arguments], signal_handler_options=SignalHandlerOptions.NO)


def request_message(given: Given) -> Any:
    """Return the request of a command."""
    fields = {
        name: state_message(given.hold) if name == 'hold' else value
        for name, value in request(given, now()).items()
    }
    return service_class(CATALOGUE[given.command].service_type).Request(**fields)


def domain_of(context: Context | None = None) -> int:
    """Return the ROS domain of a context."""
    return int((context or rclpy.utilities.get_default_context()).get_domain_id())


def looking(topic: str, context: Context | None = None) -> str:
    """Return where a client looks for race control, as a sentence says it."""
    beyond = [each for each in reachable_at() if not ipaddress.IPv4Address(each).is_loopback]
    where = texts.ON_THIS_MACHINE
    if beyond:
        addresses = texts.EVERY_ADDRESS if EVERY in beyond else ' and '.join(beyond)
        where = texts.AT_ADDRESSES.format(addresses=addresses)
    return texts.LOOKING.format(topic=topic, domain=domain_of(context), where=where)
