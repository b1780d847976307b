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
import signal
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from evgp_node.codec import value_of
from evgp_node.deadline import end_within
from evgp_node.entries import Entry
from evgp_node.graph import fence_graph, GraphError
from evgp_node.official import claim, tidy
from evgp_node.process import join_graph
from evgp_node.qos import DIAGNOSTICS_QOS, latched
from evgp_node.rclpy_private import RCLError, UnknownROSArgsError
from evgp_node.results import Standings
from evgp_node.spinning import Spinning
from evgp_node.stamps import seconds_of
from evgp_node.states import state_of
from evgp_rcs_msgs import msg, srv
from evgp_timing.corrections import CORRECTIONS
from evgp_timing.desk import Answer
from rcl_interfaces.msg import ParameterDescriptor
import rclpy
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

_NO_QT = (
    "Qt for Python or one of its libraries is missing. Install it with 'apt-get install "
    "python3-pyqt6' on Ubuntu 24.04, or 'pip install PySide6-Essentials' and 'apt-get install "
    "qt6-qpa-plugins libgl1 libxcb-cursor0'"
)
NO_DISPLAY = 'There is no screen for the window. Set DISPLAY or WAYLAND_DISPLAY'
NOT_ALLOWED = (
    'ROS does not allow this program to correct results. With SROS2, use the enclave /officials'
)

TIMING = 'timing: '
"""Prefix of a timing source's name in diagnostics."""

END_TIMEOUT = 5.0
"""Maximum time from closing the window to the end of the process, in seconds."""


class Client:
    """
    The window's ROS client.

    It listens to the timekeeper and race control in a thread of its own, and calls the
    timekeeper's services.

    :param node_options: further arguments for the node of rclpy.
    :raises RCLError: if ROS does not allow this client.
    """

    def __init__(self, **node_options: Any) -> None:
        """Create the node and start to listen."""
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
        """End the thread and destroy the node."""
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
        self._inbox.put(lambda window: window.on_race(name, seconds, teams))

    def _hear_lines(self, message: DiagnosticArray) -> None:
        for each in message.status:
            if each.name.startswith(TIMING):
                name = tidy(each.name.removeprefix(TIMING))
                kind = next((pair.value for pair in each.values if pair.key == 'kind'), '')
                where = tidy(f'{kind} at {each.hardware_id}')
                trouble = '' if each.level == DiagnosticStatus.OK else tidy(each.message, 200)
                self._inbox.put(methodcaller('on_line', name, where, trouble))


def main(arguments: list[str] | None = None) -> int:
    """
    Open the window, and run until it is closed.

    :param arguments: command-line arguments; None for those of this process.
    :return: 0 after an orderly end; 2 if Qt or a screen is missing, or a setting is wrong.
    """
    program, *given = ['timekeeper_window', *arguments] if arguments is not None else sys.argv
    try:
        from evgp_timing.window_widgets import QtCore, QtWidgets, TimekeeperWindow
    except ImportError as error:
        return _refuse(f'{_NO_QT} ({error})')
    if not any(map(os.environ.get, ('DISPLAY', 'WAYLAND_DISPLAY', 'QT_QPA_PLATFORM'))):
        return _refuse(NO_DISPLAY)
    try:
        join_graph(program, given)
        client = Client()
    except RCLError as error:
        return _refuse(f'{NOT_ALLOWED} ({error})')
    except (GraphError, UnknownROSArgsError) as error:
        return _refuse(str(error))
    application = QtWidgets.QApplication(remove_ros_args([program, *given]))
    application.setStyle('Fusion')
    # Python runs these handlers only when one of Qt's timers calls Python.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: QtCore.QTimer.singleShot(0, application.quit))
    # ROS reads an unquoted name such as 7 or yes as a number or a truth value, so accept any type.
    descriptor = ParameterDescriptor(
        description='Name of the timekeeper at this window.', read_only=True, dynamic_typing=True
    )
    official = client.node.declare_parameter('official', '', descriptor).value
    window = TimekeeperWindow(client.give, client.take, str(official or ''))
    window.widget.showMaximized()
    application.exec()
    end_within(END_TIMEOUT, 0)  # even if DDS hangs
    client.close()
    rclpy.try_shutdown()
    return 0


def _refuse(why: str) -> int:
    print(f'timekeeper_window: {why}', file=sys.stderr)
    return 2


if __name__ == '__main__':
    sys.exit(main())
