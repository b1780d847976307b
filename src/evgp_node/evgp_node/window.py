# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Runs a program that is a window: Qt in the main thread, beside a ROS client with its own threads.

Only these programs need Qt, so nothing here loads it before `run_window`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import os
import signal
import sys
from typing import Any

from evgp_node.deadline import end_within
from evgp_node.graph import GraphError
from evgp_node.process import join_graph
from evgp_node.rclpy_private import RCLError, UnknownROSArgsError
from evgp_node.restarting import WRONG_SETTING
from rcl_interfaces.msg import ParameterDescriptor
import rclpy
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

_NO_QT = (
    "Qt for Python or one of its libraries is missing. Install it with 'apt-get install "
    "python3-pyqt6' on Ubuntu 24.04, or 'pip install PySide6-Essentials' and 'apt-get install "
    "qt6-qpa-plugins libgl1 libxcb-cursor0'"
)
_NO_SCREEN = 'no screen is available. Set DISPLAY or WAYLAND_DISPLAY'

END_TIMEOUT = 5.0
"""Maximum time from closing the window to the end of the process, in seconds."""


def run_window(
    name: str,
    open_window: Callable[[Any], Callable[[], object]],
    not_allowed: str,
    arguments: Sequence[str] | None = None,
) -> int:
    """
    Open a window and run until it is closed, or until SIGINT or SIGTERM.

    :param name: name of the program, with which each error message on stderr begins.
    :param open_window: opens the window and its ROS client. Its argument is Qt's application. It
        returns a function that closes both.
    :param not_allowed: sentence for stderr if ROS does not allow the client, with ``{error}``.
    :return: 2 if Qt or a screen is missing, or a setting is wrong. Otherwise the process ends in
        here: with 0 after an orderly end; with 1, and a sentence on stderr, if ROS does not end in
        time.
    """
    program, *given = sys.argv if arguments is None else [name, *arguments]
    try:
        from evgp_node.qt import QtCore, QtWidgets
    except ImportError as error:
        return _refuse(name, f'{_NO_QT} ({error})')
    if not any(map(os.environ.get, ('DISPLAY', 'WAYLAND_DISPLAY', 'QT_QPA_PLATFORM'))):
        return _refuse(name, _NO_SCREEN)
    try:
        join_graph(program, given)
    except (GraphError, RCLError, UnknownROSArgsError) as error:
        return _refuse(name, str(error))
    application = QtWidgets.QApplication(remove_ros_args([program, *given]))
    application.setStyle('Fusion')
    # Python runs these handlers when one of the window's timers gives it the chance. They quit
    # through the event loop, because a direct call has no effect before the loop runs. A
    # KeyboardInterrupt inside Qt would be a crash.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: QtCore.QTimer.singleShot(0, application.quit))
    try:
        close = open_window(application)
    except RCLError as error:
        return _refuse(name, not_allowed.format(error=error))
    try:
        application.exec()
    finally:
        end_within(END_TIMEOUT, 1, 'ROS has hung, so this program ended without it')
        close()
        rclpy.try_shutdown()
    sys.stdout.flush()
    # Exit at once: a library's clean-up could hang, and nothing would end it.
    os._exit(0)


def _refuse(name: str, why: str) -> int:
    print(f'{name}: {why}', file=sys.stderr)
    return WRONG_SETTING


def given_official(node: Node, meaning: str) -> str:
    """Return the official's name that was given at the start; empty if none was given."""
    # ROS reads an unquoted name such as 7 or yes as a number or a truth value; accept that too.
    descriptor = ParameterDescriptor(description=meaning, read_only=True, dynamic_typing=True)
    value = node.declare_parameter('official', '', descriptor).value
    return '' if value is None else str(value)
