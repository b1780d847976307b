# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The officials' window as a process: `ros2 run evgp_rcs_console rcs_gui`."""

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
from evgp_node.rclpy_private import RCLError, UnknownROSArgsError
from evgp_rcs_console import texts
from evgp_rcs_console.client import Client, join_graph, looking, THERE_EVERY
from evgp_rcs_console.settings import Signature
from rcl_interfaces.msg import ParameterDescriptor
import rclpy
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

BATTERY_LOW = 25
"""Charge of the battery from which on the window warns, in percent."""

BATTERY_PERIOD = 30.0
"""Time between two looks at the battery, in seconds."""

END_TIMEOUT = 5.0
"""Maximum time the process takes to end after its window was closed, in seconds."""


def main(
    arguments: Sequence[str] | None = None, on_window: Callable[[Any], object] | None = None
) -> int:
    """
    Open the window, and run until it is closed.

    :param on_window: is called with the window once it is there.
    :return: 0 after an orderly end, 2 if there is no Qt or no screen, or if a setting is wrong.
        If ROS does not end in time, the process exits with 1 and says on stderr where it hung.
    """
    try:
        from evgp_rcs_console.display import Inbox
        from evgp_rcs_console.qt import QtCore, QtWidgets
        from evgp_rcs_console.window import ConsoleWindow
    except ImportError as error:
        print(f'{texts.NO_QT} ({error})', file=sys.stderr)
        return 2
    if not any(map(os.environ.get, ('DISPLAY', 'WAYLAND_DISPLAY', 'QT_QPA_PLATFORM'))):
        print(texts.NO_DISPLAY, file=sys.stderr)
        return 2
    # The window reads every key itself. An input method could only keep one from it, such as the
    # space bar while an accent is being composed.
    os.environ['QT_IM_MODULE'] = 'none'
    # The thread that sends ALL KILL must not wait for one that draws.
    sys.setswitchinterval(0.001)
    given = list(sys.argv if arguments is None else ['rcs_gui', *arguments])
    try:
        join_graph(given[0], given[1:])
    except (GraphError, UnknownROSArgsError) as error:
        print(f'rcs_gui: {error}', file=sys.stderr)
        return 2
    application = QtWidgets.QApplication(remove_ros_args(given))
    # Python runs these when the window's timer gives it the chance. To quit at once would be in
    # vain before the loop runs. Not later: KeyboardInterrupt inside Qt is a crash.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: QtCore.QTimer.singleShot(0, application.quit))
    application.setStyle('Fusion')
    keep_awake()
    inbox = Inbox()
    try:
        client = Client('rcs_gui', inbox, there='rcs_gui')
    except RCLError as error:
        print(f'rcs_gui: {texts.NOT_ALLOWED.format(error=error)}', file=sys.stderr)
        return 2
    signature = Signature(_given(client.node, 'official', _OFFICIAL), os.getpid())
    window = ConsoleWindow(inbox, client.give, signature, looking(client.topic))
    # Where no window manager runs, as on a screen for the window alone, nobody maximises it.
    window.setGeometry(application.primaryScreen().availableGeometry())
    window.showMaximized()
    battery = QtCore.QTimer(window)
    level = Battery()
    battery.timeout.connect(lambda: window.show_battery(level.low))
    battery.start(1000)
    # By the thread that takes keys and clicks: where that hangs, nobody is there.
    there = QtCore.QTimer(window)
    there.timeout.connect(lambda: client.say_there(signature.name, window.unheard))
    there.timeout.emit()
    there.start(round(1000 * THERE_EVERY))
    if on_window is not None:
        on_window(window)
    try:
        application.exec()
    finally:
        # Whatever DDS does: this thread needs no lock of the interpreter.
        faulthandler.dump_traceback_later(END_TIMEOUT, exit=True)
        window.close()
        client.close()
        rclpy.try_shutdown()
    sys.stdout.flush()
    # At once: a library's own end could hang too, when nobody watches any more.
    os._exit(0)


def keep_awake() -> None:
    """
    Ask the desktop not to blank the screen as long as this process runs.

    Nothing waits for an answer, and without such a desktop nothing happens.
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
    call.setArguments([texts.TITLE, texts.AWAKE])
    bus.asyncCall(call)


class Battery:
    """The battery of this machine, read in a thread of its own: some take long to answer."""

    def __init__(self, folder: pathlib.Path = pathlib.Path('/sys/class/power_supply')) -> None:
        self.low: int | None = None
        self._folder = folder
        threading.Thread(target=self._read, name='battery', daemon=True).start()

    def _read(self) -> None:
        while True:
            self.low = low_battery(self._folder)
            time.sleep(BATTERY_PERIOD)


def low_battery(folder: pathlib.Path) -> int | None:
    """
    Return the charge of the machine's battery, in percent; None: it is not low, or not in use.

    :param folder: where Linux tells of power supplies.
    """
    charges = []
    for supply in folder.glob('*'):
        try:
            told = [(supply / name).read_text().strip() for name in ('type', 'status', 'capacity')]
        except OSError:
            continue
        if told[:2] == ['Battery', 'Discharging'] and told[2].isdecimal():
            charges.append(int(told[2]))
    return min((each for each in charges if each <= BATTERY_LOW), default=None)


_OFFICIAL = 'Who commands from this window; empty: the name that is kept, or asked for.'


def _given(node: Node, parameter: str, meaning: str) -> str:
    """Return a text that the node was given as a parameter, if it was."""
    # A name such as 7 or yes, unquoted, is a number or a truth to ROS: no reason not to start.
    descriptor = ParameterDescriptor(description=meaning, read_only=True, dynamic_typing=True)
    value = node.declare_parameter(parameter, '', descriptor).value
    return '' if value is None else str(value)


if __name__ == '__main__':
    sys.exit(main())
