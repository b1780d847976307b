# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The process of the timekeeper's window (`ros2 run evgp_timing timekeeper_window`).

The window may run on any machine of the officials' network. It shows what the timekeeper
publishes, and sends officials' corrections to the timekeeper. It cannot start or stop a race.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from operator import methodcaller
import os
import platform
import queue
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from evgp_node.codec import value_of
from evgp_node.entries import Entry
from evgp_node.graph import fence_graph
from evgp_node.official import claim, tidy
from evgp_node.qos import DIAGNOSTICS_QOS, latched
from evgp_node.results import Standings
from evgp_node.spinning import Spinning
from evgp_node.stamps import seconds_of
from evgp_node.states import state_of
from evgp_node.window import given_official, run_window
from evgp_rcs_msgs import msg, srv
from evgp_timing.corrections import CORRECTIONS
from evgp_timing.desk import Answer
from rclpy.node import Node

NOT_ALLOWED = (
    'ROS does not allow this program to correct results. With SROS2, use the enclave '
    '/officials ({error})'
)

TIMING = 'timing: '
"""Prefix of a timing source's name in diagnostics."""


class Client:
    """
    The window's ROS client.

    It listens to the timekeeper and race control in a thread of its own, and calls the
    timekeeper's services.

    :param node_options: further arguments for the node of rclpy.
    :raises RCLError: if ROS does not allow this client.
    """

    def __init__(self, **node_options: Any) -> None:
        self._inbox: queue.SimpleQueue[Callable[[Any], object]] = queue.SimpleQueue()
        self.node = Node('timekeeper_window', **node_options)
        fence_graph()
        self._services = {
            entry.service: self.node.create_client(
                getattr(srv, entry.service_type), f'rcs/{entry.service}'
            )
            for entry in CORRECTIONS.values()
        }
        subscribe = self.node.create_subscription
        subscribe(msg.Results, 'rcs/timekeeper/results', self._hear_results, latched(1))
        subscribe(msg.Race, 'rcs/race', self._hear_race, latched(1))
        subscribe(DiagnosticArray, '/diagnostics', self._hear_lines, DIAGNOSTICS_QOS)
        log = self.node.get_logger()
        self._spinning = Spinning(
            self.node, lambda error: log.error(f'This window no longer receives news: {error!r}')
        )

    def take(self, window: Any) -> None:
        """Pass the news since the last call to a window, in the calling thread."""
        while not self._inbox.empty():
            self._inbox.get()(window)

    def give(
        self,
        entry: Entry,
        official: str,
        fields: Mapping[str, Any],
        answered: Callable[[Answer], None],
    ) -> None:
        """
        Send a correction of this row, with the fields of its request besides `official`.

        The answer goes to `answered`: later, from `take`, or at once if the timekeeper was not
        found.
        """
        service = self._services[entry.service]
        if not service.service_is_ready():
            answered(Answer(False, 'the timekeeper was not found. Nothing was sent'))
            return
        signed = claim(official, platform.node(), os.getpid())
        request = getattr(srv, entry.service_type).Request(official=signed, **fields)

        def tell(future: Any) -> None:
            if not future.cancelled():
                answer = Answer(future.result().success, future.result().message)
                self._inbox.put(lambda _: answered(answer))

        service.call_async(request).add_done_callback(tell)

    def close(self) -> None:
        self._spinning.stop()
        self.node.destroy_node()

    # ----- the executor's thread ----------------------------------------------------------

    def _hear_results(self, message: msg.Results) -> None:
        try:
            results = value_of(message, Standings)
        except ValueError as error:
            said = f'Ignored results from another version of the timekeeper: {error}'
            self.node.get_logger().warning(said, throttle_duration_sec=10.0)
            return
        self._inbox.put(lambda window: window.on_results(results))

    def _hear_race(self, message: msg.Race) -> None:
        state = state_of(message.state)
        name = 'RACE OVER' if message.over else state.name.replace('_', ' ') if state else ''
        seconds = seconds_of(message.stamp) - seconds_of(message.state_since)
        teams = {kart.number: kart.team for kart in message.karts}
        self._inbox.put(methodcaller('on_race', name, seconds, teams, tidy(message.banner)))

    def _hear_lines(self, message: DiagnosticArray) -> None:
        for each in message.status:
            if each.name.startswith(TIMING):
                name = tidy(each.name.removeprefix(TIMING))
                kind = next((pair.value for pair in each.values if pair.key == 'kind'), '')
                where = tidy(f'{kind} at {each.hardware_id}')
                trouble = '' if each.level == DiagnosticStatus.OK else tidy(each.message, 200)
                self._inbox.put(methodcaller('on_line', name, where, trouble))


def main(arguments: list[str] | None = None) -> int:
    """Open the window and run until it is closed. The result is that of ``run_window``."""
    return run_window('timekeeper_window', _open, NOT_ALLOWED, arguments)


def _open(_: Any) -> Callable[[], object]:
    """Open the window and its client, and return a function that closes both."""
    from evgp_timing.window_widgets import TimekeeperWindow

    client = Client()
    official = given_official(client.node, 'Name of the timekeeper at this window.')
    window = TimekeeperWindow(client.give, client.take, official)
    window.widget.showMaximized()

    def close() -> None:
        window.widget.close()
        client.close()

    return close


if __name__ == '__main__':
    sys.exit(main())
