"""
The console's ROS side: hears the race, and gives commands, in threads of its own.

Two threads, so that nothing a screen does ever waits for ROS:

- the executor's thread hears `rcs/race` and `rcs/events` and the answers to commands;
- the sender's thread takes commands from a queue and calls the services. It also presses ALL_KILL
  again and again, once asked for, until race control has accepted it.

Whoever listens is called in these threads, and must hand over to its own at once.
"""

from __future__ import annotations

from dataclasses import dataclass, field
import queue
import threading
import time
from typing import Any, Protocol

from evgp_rcs_console import words
from evgp_rcs_console.commands import FORMS
from evgp_rcs_console.reading import read_event, read_race
from evgp_rcs_console.snapshot import Answer, Command, Event, Race
from evgp_rcs_msgs import msg, srv
import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import SetBool, Trigger

PRESS_AGAIN = 0.5
"""How often ALL_KILL is pressed again while nobody answers, seconds."""

GIVE_UP = 15.0
"""How long an answer to any other command is waited for, seconds."""

KINDS: dict[str, Any] = {
    'Trigger': Trigger,
    'SetBool': SetBool,
    'GreenGreen': srv.GreenGreen,
    'GridActive': srv.GridActive,
    'InGarage': srv.InGarage,
    'KartCommand': srv.KartCommand,
    'KartInGarage': srv.KartInGarage,
    'SetInRace': srv.SetInRace,
}


def latched(depth: int) -> QoSProfile:
    """Return the QoS of race control's topics."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


@dataclass(frozen=True)
class Order:
    """A command that was given, and when (monotonic, seconds)."""

    command: Command
    kart: int = 0
    stated: bool = False
    at: float = field(default_factory=time.monotonic)


class Listener(Protocol):
    """
    Who is told what the client hears.

    Called in the client's threads, with its lock held at times: it must not call the client.
    """

    def on_race(self, race: Race, at: float) -> None:
        """Take a snapshot, and when it came (monotonic, seconds)."""

    def on_event(self, event: Event) -> None:
        """Take an event."""

    def on_answer(self, order: Order, answer: Answer) -> None:
        """Take the answer to a command, also that none came."""

    def on_pressing(self, count: int, since: float) -> None:
        """Take how often ALL_KILL was pressed in vain since when; 0: it is not being pressed."""


class Client:
    """
    A client of race control.

    :param context: the ROS context; the process's own if it is None.
    """

    def __init__(
        self, name: str, listener: Listener, context: Context | None = None, **node_options: Any
    ) -> None:
        """Join the domain and begin to hear."""
        self.node = Node(name, context=context, **node_options)
        self._listener = listener
        self._services: dict[str, Any] = {}
        for form in FORMS.values():
            if form.service not in self._services:
                self._services[form.service] = self.node.create_client(
                    KINDS[form.kind], f'rcs/{form.service}'
                )
        self.node.create_subscription(msg.Race, 'rcs/race', self._hear_race, latched(1))
        self.node.create_subscription(msg.RaceEvent, 'rcs/events', self._hear_event, latched(200))
        self.topic: str = self.node.resolve_topic_name('rcs/race')
        self._orders: queue.SimpleQueue[Order | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._waiting: dict[Any, Order] = {}
        self._kill: Order | None = None
        self._presses = 0
        self._press_at = 0.0
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)
        self._hearing = threading.Thread(target=self._hear, name='hearing', daemon=True)
        self._sending = threading.Thread(target=self._send, name='sending', daemon=True)
        self._hearing.start()
        self._sending.start()

    def give(self, command: Command, kart: int = 0, stated: bool = False) -> Order:
        """
        Give a command, and return at once.

        :param stated: the official makes the statement that the command asks for.
        """
        order = Order(command, kart, stated)
        self._orders.put(order)
        return order

    def wait_for(self, command: Command, seconds: float) -> bool:
        """Return whether race control offers a command, once it does or time is up."""
        return bool(self._services[FORMS[command].service].wait_for_service(seconds))

    def close(self) -> None:
        """Leave the domain."""
        self._orders.put(None)
        self._sending.join()
        self._executor.shutdown()
        self._hearing.join()
        self.node.destroy_node()

    # ----- the sender's thread ------------------------------------------------------------

    def _send(self) -> None:
        while True:
            try:
                order = self._orders.get(timeout=self._next_press())
            except queue.Empty:
                self._press()
                self._give_up()
                continue
            if order is None:
                return
            if order.command is Command.ALL_KILL:
                with self._lock:
                    if self._kill is None:
                        self._presses = 0
                    self._kill = order
                self._press()
            else:
                self._call(order)

    def _next_press(self) -> float | None:
        with self._lock:
            if self._kill:
                return max(0.0, self._press_at - time.monotonic())
            return PRESS_AGAIN if self._waiting else None

    def _press(self) -> None:
        with self._lock:
            order = self._kill
            if order is None:
                return
            self._press_at = time.monotonic() + PRESS_AGAIN
            self._presses += 1
            count = self._presses
        self._request(order)
        # Told under the lock: never after it is told that the press was accepted.
        with self._lock:
            if self._kill is order:
                self._listener.on_pressing(count, order.at)

    def _call(self, order: Order) -> None:
        form = FORMS[order.command]
        if self._services[form.service].service_is_ready():
            self._request(order)
            return
        text = words.NOT_THERE_STOP if form.stop else words.NOT_THERE
        name = words.command_name(order.command, order.kart)
        self._listener.on_answer(order, Answer(False, text.format(command=name)))

    def _request(self, order: Order) -> None:
        form = FORMS[order.command]
        request = KINDS[form.kind].Request(**form.request(order.kart, order.stated))
        future = self._services[form.service].call_async(request)
        with self._lock:
            self._waiting[future] = order
        future.add_done_callback(self._answered)

    def _give_up(self) -> None:
        now = time.monotonic()
        with self._lock:
            late = {
                future: order
                for future, order in self._waiting.items()
                if now - order.at > GIVE_UP and order.command is not Command.ALL_KILL
            }
            # Of the presses of one ALL_KILL only the newest few can still be answered.
            presses = [f for f, o in self._waiting.items() if o.command is Command.ALL_KILL]
            for future in presses[:-10]:
                late.setdefault(future, self._waiting[future])
            for future in late:
                del self._waiting[future]
        for future, order in late.items():
            self._services[FORMS[order.command].service].remove_pending_request(future)
            if order.command is not Command.ALL_KILL:
                name = words.command_name(order.command, order.kart)
                text = words.GAVE_UP.format(command=name, age=words.age(GIVE_UP))
                self._listener.on_answer(order, Answer(False, text))

    # ----- the executor's thread ----------------------------------------------------------

    def _answered(self, future: Any) -> None:
        with self._lock:
            order = self._waiting.pop(future, None)
            if order is None or future.cancelled():
                return
            answer = Answer(future.result().success, future.result().message)
            killed = order is self._kill and answer.success
            if killed:
                self._kill = None
                self._listener.on_pressing(0, order.at)
        # An earlier press of the same, or one that failed, is pressed again and not told.
        if killed or order.command is not Command.ALL_KILL:
            self._listener.on_answer(order, answer)

    def _hear_race(self, race: msg.Race) -> None:
        self._listener.on_race(read_race(race), time.monotonic())

    def _hear_event(self, event: msg.RaceEvent) -> None:
        self._listener.on_event(read_event(event))

    def _hear(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            pass  # closed while waiting: that is how it ends


def domain_of(context: Context | None = None) -> int:
    """Return the ROS domain of a context."""
    return int((context or rclpy.utilities.get_default_context()).get_domain_id())
