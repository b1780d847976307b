# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs the officials' window: `ros2 run evgp_rcs_console rcs_gui`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import faulthandler
import importlib
import os
import pathlib
import signal
import sys
import threading
import time
from typing import Any

from evgp_node.graph import GraphError
from evgp_node.process import join_graph
from evgp_node.rclpy_private import RCLError, UnknownROSArgsError
from evgp_rcs_console import texts
from evgp_rcs_console.client import Client, looking, PRESENCE_PERIOD, spoken
from evgp_rcs_console.settings import Signature
from rcl_interfaces.msg import ParameterDescriptor
import rclpy
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

_NO_QT = (
    "rcs_gui: Qt for Python or one of its libraries is missing. Install it with 'apt-get install "
    "python3-pyqt6' on Ubuntu 24.04, or 'pip install PySide6-Essentials' and 'apt-get install "
    "qt6-qpa-plugins libgl1 libxcb-cursor0'."
)

BATTERY_LOW = 25
"""Highest charge of the battery at which the window warns, in percent."""

BATTERY_PERIOD = 30.0
"""Time between two readings of the battery, in seconds."""

END_TIMEOUT = 5.0
"""Time after its window is closed at which the process ends at the latest, in seconds."""


def main(
    arguments: Sequence[str] | None = None, on_window: Callable[[Any], object] | None = None
) -> int:
    """
    Open the window and run until it is closed.

    :param on_window: called with the window once it is open.
    :return: 2 if Qt or a screen is missing, or a setting is wrong. Otherwise the process ends in
        here: with 0 after an orderly end; with 1 if ROS does not end in time, after it has printed
        on stderr where it hung.
    """
    try:
        from evgp_rcs_console.display import Inbox
        from evgp_rcs_console.qt import QtCore, QtWidgets
        from evgp_rcs_console.window import ConsoleWindow
    except ImportError as error:
        print(f'{_NO_QT} ({error})', file=sys.stderr)
        return 2
    if not any(map(os.environ.get, ('DISPLAY', 'WAYLAND_DISPLAY', 'QT_QPA_PLATFORM'))):
        no_display = 'rcs_gui: no screen is available. Set DISPLAY or WAYLAND_DISPLAY.'
        print(no_display, file=sys.stderr)
        return 2
    # The window reads every key itself. All that an input method could do is swallow keys, such as
    # the space bar while an accent is composed.
    os.environ['QT_IM_MODULE'] = 'none'
    # The thread that sends ALL KILL must not wait for the thread that draws.
    sys.setswitchinterval(0.001)
    given = list(sys.argv if arguments is None else ['rcs_gui', *arguments])
    try:
        join_graph(given[0], given[1:])
    except (GraphError, RCLError, UnknownROSArgsError) as error:
        print(f'rcs_gui: {error}', file=sys.stderr)
        return 2
    application = QtWidgets.QApplication(remove_ros_args(given))
    # Python runs these handlers when the window's timer gives it the chance. They quit through the
    # event loop, because a direct call has no effect before the loop runs. A KeyboardInterrupt
    # inside Qt would be a crash.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: QtCore.QTimer.singleShot(0, application.quit))
    application.setStyle('Fusion')
    keep_awake()
    inbox = Inbox()

    def say(sentence: str) -> str:
        return inbox.names.in_text(spoken(sentence))

    try:
        client = Client('rcs_gui', inbox, there='rcs_gui', say=say)
    except RCLError as error:
        print(f'rcs_gui: {texts.NOT_ALLOWED.format(error=error)}', file=sys.stderr)
        return 2
    signature = Signature(_official(client.node), os.getpid())
    window = ConsoleWindow(inbox, client.give, signature, looking(client.topic))
    # Without a window manager, as on a screen for this window alone, nothing maximises it.
    window.setGeometry(application.primaryScreen().availableGeometry())
    window.showMaximized()
    threading.Thread(target=watch_battery, args=[inbox.battery.emit], daemon=True).start()
    # The thread that handles keys and clicks announces the window, so that the announcements end
    # if it hangs.
    there = QtCore.QTimer(window)
    there.timeout.connect(lambda: client.announce(signature.name, window.unheard))
    there.timeout.emit()
    there.start(round(1000 * PRESENCE_PERIOD))
    if on_window is not None:
        on_window(window)
    try:
        application.exec()
    finally:
        # This works whatever DDS does, because its thread needs no lock of the interpreter.
        faulthandler.dump_traceback_later(END_TIMEOUT, exit=True)
        window.close()
        client.close()
        rclpy.try_shutdown()
    sys.stdout.flush()
    # Exit at once: a library's clean-up could hang, and nothing would end it.
    os._exit(0)


def keep_awake() -> None:
    """
    Ask the desktop not to blank the screen while this process runs.

    It does not wait for an answer. On a desktop without this service, it has no effect.
    """
    from evgp_rcs_console.qt import QtCore

    try:
        dbus = importlib.import_module(QtCore.__name__.replace('QtCore', 'QtDBus'))
    except ImportError:
        return
    bus = dbus.QDBusConnection.sessionBus()
    if not bus.isConnected():
        return
    name = 'org.freedesktop.ScreenSaver'
    path = f'/{name.replace(".", "/")}'
    call = dbus.QDBusMessage.createMethodCall(name, path, name, 'Inhibit')
    call.setArguments([texts.TITLE, 'An EVGP race is on this screen.'])
    bus.asyncCall(call)


def watch_battery(show: Callable[[int | None], object]) -> None:
    """Have the charge of a low battery shown, in a thread, as some batteries answer slowly."""
    while True:
        show(low_battery(pathlib.Path('/sys/class/power_supply')))
        time.sleep(BATTERY_PERIOD)


def low_battery(folder: pathlib.Path) -> int | None:
    """Return the charge of the battery in percent; None if it is not low or not in use."""
    charges = []
    for supply in folder.glob('*'):
        try:
            told = [(supply / name).read_text().strip() for name in ('type', 'status', 'capacity')]
        except OSError:
            continue
        if told[:2] == ['Battery', 'Discharging'] and told[2].isdecimal():
            charges.append(int(told[2]))
    return min((each for each in charges if each <= BATTERY_LOW), default=None)


def _official(node: Node) -> str:
    """Return the official's name that was given at the start; empty if none was given."""
    meaning = 'Official at this window; empty: the saved name, or one chosen in the window.'
    # ROS reads an unquoted name such as 7 or yes as a number or a truth value; accept that too.
    descriptor = ParameterDescriptor(description=meaning, read_only=True, dynamic_typing=True)
    value = node.declare_parameter('official', '', descriptor).value
    return '' if value is None else str(value)


if __name__ == '__main__':
    sys.exit(main())
