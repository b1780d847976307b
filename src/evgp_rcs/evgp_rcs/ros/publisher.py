# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Publishes what the kart server reports, in a thread of its own.

The publisher publishes every event, in order. The kart server has already limited the events that
karts can cause by their reports. If several snapshots of the race are waiting, the publisher
publishes only the newest. A snapshot waits for at most `BATCH` events and may overtake the rest,
so that officials see the current race.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
import contextlib
import math
import queue
import threading
import time

from diagnostic_msgs.msg import DiagnosticArray
from evgp_node.codec import message_of
from evgp_node.official import said_by
from evgp_node.process import wait_until_heard
from evgp_node.qos import DIAGNOSTICS_QOS, latched
from evgp_protocol import clock
from evgp_protocol.states import RaceState
from evgp_rcs.ros.messages import diagnostics_message, events_message
from evgp_rcs.rules.race import Alert, AlertKind, Event, EventKind, StampedEvent
from evgp_rcs.rules.snapshot import NOTHING, Snapshot
from evgp_rcs_msgs import msg
from rclpy.node import Node
from std_msgs.msg import String

RACE_QOS = latched(1)
"""QoS of ``~/race``. With it, a late subscriber gets the current race at once."""

EVENTS_QOS = latched(200)
"""QoS of ``~/events``. With it, a late subscriber gets the last 200 messages."""

OF_EACH_KART = (
    EventKind.KART_STATE,
    EventKind.DELIVERED,
    EventKind.ACKNOWLEDGED,
)
"""Kinds of events that the publisher does not log. The command's own event says what karts are
sent, and other events say whether every kart has answered."""

STATE_EVERY = 0.1
"""Time between two publications of the race's plain state, in seconds."""

STATE_AGE = 1.0
"""Maximum age of a snapshot whose plain state is still published, in seconds. The state may have
changed since, and silence tells readers that the state is unknown."""

BATCH = 100
"""Maximum number of events in one message, and before the next snapshot of the race."""

CLOCK_STEP_NS = 10_000_000
"""Minimum change of the wall clock after which the publisher recomputes the race's times, in
ns."""


class RacePublisher:
    """
    The publisher of the race, its events, its plain state and diagnostics.

    :param on_failure: called with the error, in the publisher's thread, if the publisher fails.
    :param banner: text at the top of every screen; empty if there is none.
    """

    def __init__(
        self,
        node: Node,
        on_failure: Callable[[BaseException], None],
        banner: str = '',
        officials: tuple[str, ...] = (),
        run: str = '',
    ) -> None:
        """Create the publishers. Nothing is published before ``start``."""
        self._node = node
        self._on_failure = on_failure
        self._banner, self._officials = banner, officials
        self._run_id = run
        self._race = node.create_publisher(msg.Race, '~/race', RACE_QOS)
        self._state = node.create_publisher(String, '~/state', 1)  # volatile, to keep no old state
        self._events = node.create_publisher(msg.RaceEvents, '~/events', EVENTS_QOS)
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', DIAGNOSTICS_QOS)
        self._happened: queue.SimpleQueue[list[StampedEvent] | Snapshot | str | None]
        self._happened = queue.SimpleQueue()
        self._graph_alerts: tuple[Alert, ...] = ()
        self._thread = threading.Thread(target=self._run, name='publisher', daemon=True)
        self._diagnosed_at = 0.0
        self._shown = NOTHING
        self._stated: RaceState | None = None
        self._stated_at = -math.inf
        self._clock_ns = 0
        self._sequence = 0

    def publish(self, news: list[StampedEvent] | Snapshot | str) -> None:
        """
        Queue news for publication. Any thread may call this.

        :param news: events; a snapshot of the race; or what is wrong with the ROS graph, as a
            sentence, which is empty if nothing is wrong any longer.
        """
        self._happened.put(news)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        """Publish everything that is waiting and return."""
        if self._thread.ident is not None:
            self._happened.put(None)
            self._thread.join()

    def last_words(self, text: str) -> None:
        """
        Publish the alert that a part of race control has failed. Call this after ``stop``.

        The alert is added to the last published race. This method waits until subscribers have
        received the alert, a sentence for officials.
        """
        now, wall_ns = clock.now(), time.time_ns()
        alert = Alert(AlertKind.PART_FAILED, 0, now, text, use_msr=True)
        race = self._shown._replace(alerts=(alert, *self._shown.alerts))
        self._race.publish(message_of(race, msg.Race, wall_ns - round(now * 1e9)))
        event = Event(EventKind.ALERT_RAISED, text, success=False)
        stamped = StampedEvent(self._sequence + 1, wall_ns, now, event)
        self._events.publish(events_message([stamped], self._run_id))
        wait_until_heard(self._race, self._events)

    def _run(self) -> None:
        try:
            self._publish_until_the_end()
        except BaseException as error:  # noqa: BLE001 - the node ends the process
            self._on_failure(error)

    def _publish_until_the_end(self) -> None:
        waiting: deque[StampedEvent] = deque()
        ended = False
        while not ended or waiting:
            came = []
            if not waiting:
                with contextlib.suppress(queue.Empty):  # if nothing comes, the plain state is due
                    due = self._stated_at + STATE_EVERY - clock.now()
                    came.append(self._happened.get(timeout=max(0.0, due)))
            while not self._happened.empty():
                came.append(self._happened.get())
            newest: Snapshot | None = None
            for news in came:
                if news is None:
                    ended = True
                elif isinstance(news, Snapshot):
                    newest = news
                elif isinstance(news, str):
                    self._take_graph_trouble(news)
                else:
                    waiting += news
            if waiting:
                self._publish([waiting.popleft() for _ in range(min(BATCH, len(waiting)))])
            if newest is not None:
                self._publish_race(newest)
            self._publish_state(clock.now())

    def _publish_state(self, now: float) -> None:
        """Publish the name of the race's state, if it is known and publication is due."""
        race = self._shown
        state = race.state if now - race.stamp <= STATE_AGE else None
        if state is self._stated and now < self._stated_at + STATE_EVERY:
            return
        self._stated, self._stated_at = state, now
        if state is not None:
            self._state.publish(String(data=state.value))

    def _take_graph_trouble(self, text: str) -> None:
        alert = Alert(AlertKind.GRAPH_TROUBLE, 0, clock.now(), text, use_msr=False)
        self._graph_alerts = (alert,) if text else ()
        log = self._node.get_logger()
        if text:
            log.warning(text)
        else:
            log.info('The ROS graph is in order again')

    def _publish(self, batch: list[StampedEvent]) -> None:
        self._events.publish(events_message(batch, self._run_id))
        self._sequence = batch[-1].sequence
        log = self._node.get_logger()
        for _, _, _, event in batch:
            text = said_by(event.text, event.official)
            if event.kind is EventKind.ALERT_RAISED or not event.success:
                log.warning(text)
            elif event.kind not in OF_EACH_KART:
                log.info(text)

    def _publish_race(self, race: Snapshot) -> None:
        clock_ns = time.time_ns() - round(clock.now() * 1e9)
        race = race._replace(
            alerts=(*race.alerts, *self._graph_alerts),
            banner=self._banner,
            officials=self._officials,
        )
        # The same moment keeps the same wall time, so that readers see it as unchanged.
        if abs(clock_ns - self._clock_ns) >= CLOCK_STEP_NS:
            self._clock_ns = clock_ns
        self._race.publish(message_of(race, msg.Race, self._clock_ns))
        self._shown = race
        if race.stamp - self._diagnosed_at >= 1.0:
            self._diagnosed_at = race.stamp
            name = self._node.get_fully_qualified_name().lstrip('/')
            self._diagnostics.publish(diagnostics_message(race, time.time_ns(), name))
