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
Publishes what the kart server tells, in a thread of its own.

Events go out in order, all of them unless more than `MOST_UNTOLD` wait. Of several copies of the
race only the newest does, and that may overtake events: it waits for no more of them than are
published in `TURN`, so that what officials see is the present race.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
import queue
import threading
import time

from diagnostic_msgs.msg import DiagnosticArray
from evgp_node.process import wait_until_heard
from evgp_protocol import clock
from evgp_rcs.channel import Copy
from evgp_rcs.inputs import digest, offers
from evgp_rcs.messages import (
    diagnostics_message,
    event_message,
    failure_alert,
    graph_alert,
    race_message,
)
from evgp_rcs.official import said_by
from evgp_rcs.race import Event, EventKind, StampedEvent
from evgp_rcs.roster import Roster
from evgp_rcs_msgs import msg
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

RACE_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Of ``~/race``: a late subscriber gets the present race at once."""

EVENTS_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=200,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Of ``~/events``: a late subscriber gets the last 200 events."""

TURN = 0.05
"""Maximum time spent publishing events before a newer race is published, in seconds."""

PAUSE = 0.001
"""Time after each event in which no further one is published, in seconds. Without it a stop waits
for the interpreter and the processors while a hundred karts acknowledge."""

MOST_PAUSED = 1000
"""Maximum backlog of events with such pauses; a longer one is published without."""

MOST_UNTOLD = 5000
"""Maximum backlog of events to publish; beyond it, `LESSER` events go to the record only."""

LESSER = (EventKind.ACKNOWLEDGED, EventKind.KART_STATE, EventKind.REPORTED)
"""What karts do by the hundred, and what ``~/race`` shows as well."""


class Teller:
    """
    Publishes the race, its events and diagnostics.

    :param on_failure: is called, in the teller's thread, when it cannot go on.
    :param on_published: takes, in the teller's thread, the number of a copy that was published,
        and the digest of the commands that it offered.
    :param banner: what every screen says at its top.
    """

    def __init__(
        self,
        node: Node,
        roster: Roster,
        on_failure: Callable[[BaseException], None],
        on_published: Callable[[int, int], None] = lambda number, offered: None,
        banner: str = '',
    ) -> None:
        """Create the publishers; nothing is published before ``start``."""
        self._node = node
        self._on_failure = on_failure
        self._on_published = on_published
        self._banner = banner
        self._addresses = {entry.number: entry.address for entry in roster.entries}
        self._race = node.create_publisher(msg.Race, '~/race', RACE_QOS)
        self._events = node.create_publisher(msg.RaceEvent, '~/events', EVENTS_QOS)
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._happened: queue.SimpleQueue[list[StampedEvent] | Copy | str | None]
        self._happened = queue.SimpleQueue()
        self._graph_alerts: list[msg.Alert] = []
        self._thread = threading.Thread(target=self._run, name='teller', daemon=True)
        self._told_diagnostics = 0.0
        self._published = msg.Race()
        self._sequence = 0

    def events(self, events: list[StampedEvent]) -> None:
        """Take events, from any thread."""
        self._happened.put(events)

    def race(self, copy: Copy) -> None:
        """Take a copy of the race, from any thread."""
        self._happened.put(copy)

    def graph_trouble(self, text: str) -> None:
        """Take, from any thread, what is wrong with the graph from now on; empty: nothing."""
        self._happened.put(text)

    def start(self) -> None:
        """Begin to publish."""
        self._thread.start()

    def stop(self) -> None:
        """Publish what is still to be told, and return."""
        if self._thread.ident is not None:
            self._happened.put(None)
            self._thread.join()

    def last_words(self, text: str) -> None:
        """
        Publish the alert that a part of race control has failed, after ``stop``.

        It goes on top of the last race that could be published, and waits until subscribers have
        it.
        """
        wall_ns = time.time_ns()
        alert = failure_alert(text, wall_ns)
        self._published.alerts = [alert, *self._published.alerts]
        self._race.publish(self._published)
        event = Event(EventKind.ALERT_RAISED, text, success=False)
        stamped = StampedEvent(self._sequence + 1, wall_ns, clock.now(), event)
        self._events.publish(event_message(stamped))
        wait_until_heard(self._race, self._events)

    def _run(self) -> None:
        try:
            self._publish_until_the_end()
        except BaseException as error:  # noqa: BLE001 - handed to whoever ends the process
            self._on_failure(error)

    def _publish_until_the_end(self) -> None:
        waiting: deque[StampedEvent] = deque()
        ended = False
        while not ended or waiting:
            came = [] if waiting else [self._happened.get()]
            while not self._happened.empty():
                came.append(self._happened.get())
            newest: Copy | None = None
            for news in came:
                if news is None:
                    ended = True
                elif isinstance(news, Copy):
                    newest = news
                elif isinstance(news, str):
                    self._take_graph_trouble(news)
                else:
                    waiting += news
            if len(waiting) > MOST_UNTOLD:
                waiting = self._without_lesser(waiting)
            until = time.monotonic() + TURN
            while waiting and time.monotonic() < until:
                self._tell(waiting.popleft())
                if not ended and len(waiting) <= MOST_PAUSED:
                    time.sleep(PAUSE)
            if newest is not None:
                self._tell_race(newest)

    def _take_graph_trouble(self, text: str) -> None:
        self._graph_alerts = [graph_alert(text, time.time_ns())] if text else []
        log = self._node.get_logger()
        if text:
            log.warning(text)
        else:
            log.info('The ROS graph is in order again')

    def _without_lesser(self, events: deque[StampedEvent]) -> deque[StampedEvent]:
        """Return the events that are told when there are too many to tell them all."""
        kept = [each for each in events if each.event.kind not in LESSER][-MOST_UNTOLD:]
        self._node.get_logger().warning(
            f'{len(events) - len(kept)} events came faster than they can be published; '
            'only the record has them'
        )
        return deque(kept)

    def _tell(self, stamped: StampedEvent) -> None:
        event = stamped.event
        log = self._node.get_logger()
        text = said_by(event.text, event.official)
        if event.kind is EventKind.ALERT_RAISED or not event.success:
            log.warning(text)
        elif event.kind is EventKind.ACKNOWLEDGED:
            log.debug(text)  # that all have, or that one is late, is told for itself
        elif event.kind is not EventKind.KART_STATE:  # the command says it
            log.info(text)
        self._events.publish(event_message(stamped))
        self._sequence = stamped.sequence

    def _tell_race(self, copy: Copy) -> None:
        race, at = copy.race, copy.at
        wall_ns = time.time_ns() - round((clock.now() - at) * 1e9)
        offered = offers(race, at)
        message = race_message(race, at, wall_ns, self._addresses, offered, self._banner)
        message.alerts = [*message.alerts, *self._graph_alerts]
        self._race.publish(message)
        self._on_published(copy.number, digest(offered))
        self._published = message
        if at - self._told_diagnostics >= 1.0:
            self._told_diagnostics = at
            name = self._node.get_fully_qualified_name().lstrip('/')
            self._diagnostics.publish(
                diagnostics_message(race, at, time.time_ns(), name, self._addresses)
            )
