# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Hears the sources of passings of the timing line, and hands on what they say, in a thread.

A stop never waits for it: what is heard waits in a queue with an end, and goes to the kart server
in small batches with a pause between them. What does not fit is counted, and told.
"""

from __future__ import annotations

import contextlib
import queue
import threading

from evgp_node.qos import latched
from evgp_rcs.karts.channel import Passings
from evgp_rcs.karts.server import KartServerError
from evgp_rcs.ros.kart_client import KartServerClient
from evgp_rcs.ros.messages import passing_of
from evgp_rcs.rules.laps import Passing
from evgp_rcs_msgs import msg
from rclpy.node import Node

LINE_QOS = latched(1000)
"""Of ``~/passings``: what a source said before race control found it comes too."""

MOST_WAITING = 1000
"""Maximum number of passings that wait for the kart server."""

MOST_IN_A_BATCH = 50
"""Maximum number of passings in a batch. The rules take some 0.3 ms for one of that size, for
which a stop waits."""

PAUSE = 0.05
"""Time between two batches, in seconds."""


class Line:
    """The timing line, as far as its sources are heard in this graph."""

    def __init__(self, node: Node, server: KartServerClient) -> None:
        """Listen; nothing is handed on before ``start``."""
        self._server = server
        self._heard: queue.Queue[Passing] = queue.Queue(MOST_WAITING)
        self._dropped = 0
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name='line', daemon=True)
        node.create_subscription(msg.Passing, '~/passings', self._hear, LINE_QOS)

    def start(self) -> None:
        """Begin to hand on."""
        self._thread.start()

    def stop(self) -> None:
        """Hand nothing on any more."""
        self._closing.set()

    def _hear(self, message: msg.Passing) -> None:
        try:
            self._heard.put_nowait(passing_of(message))
        except queue.Full:
            self._dropped += 1  # the other thread may lose one of thousands

    def _run(self) -> None:
        while not self._closing.wait(PAUSE):
            if not self._server.takes_passings:
                continue
            with contextlib.suppress(queue.Empty, KartServerError):
                # The first that comes goes at once: its time is the time of arrival.
                batch = [self._heard.get(timeout=1.0)]
                while len(batch) < MOST_IN_A_BATCH and not self._heard.empty():
                    batch.append(self._heard.get())
                dropped, self._dropped = self._dropped, 0
                self._server.passed(Passings(tuple(batch), dropped))
