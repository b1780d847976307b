# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs the officials' window: `ros2 run evgp_rcs_console rcs_gui`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import functools
import importlib
import os
import pathlib
import sys
import threading
import time
from typing import Any

from evgp_node.window import given_official, run_window
from evgp_rcs_console import texts
from evgp_rcs_console.client import Client, looking, PRESENCE_PERIOD, spoken
from evgp_rcs_console.settings import Signature

BATTERY_LOW = 25
"""Highest charge of the battery at which the window warns, in percent."""

BATTERY_PERIOD = 30.0
"""Time between two readings of the battery, in seconds."""


def main(
    arguments: Sequence[str] | None = None, on_window: Callable[[Any], object] | None = None
) -> int:
    """
    Open the window and run until it is closed. The result is that of ``run_window``.

    :param on_window: called with the window once it is open.
    """
    # The window reads every key itself. All that an input method could do is swallow keys, such as
    # the space bar while an accent is composed.
    os.environ['QT_IM_MODULE'] = 'none'
    # The thread that sends ALL KILL must not wait for the thread that draws.
    sys.setswitchinterval(0.001)
    return run_window('rcs_gui', functools.partial(_open, on_window), texts.NOT_ALLOWED, arguments)


def _open(on_window: Callable[[Any], object] | None, application: Any) -> Callable[[], object]:
    """Open the window and its client, and return a function that closes both."""
    from evgp_node.qt import QtCore
    from evgp_rcs_console.display import Inbox
    from evgp_rcs_console.window import ConsoleWindow

    keep_awake()
    inbox = Inbox()

    def say(sentence: str) -> str:
        return inbox.names.in_text(spoken(sentence)) if sentence else ''

    client = Client('rcs_gui', inbox, there='rcs_gui', say=say)
    meaning = 'Official at this window; empty: the saved name, or one chosen in the window.'
    signature = Signature(given_official(client.node, meaning), os.getpid())
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

    def close() -> None:
        window.close()
        client.close()

    return close


def keep_awake() -> None:
    """
    Ask the desktop not to blank the screen while this process runs.

    It does not wait for an answer. On a desktop without this service, it has no effect.
    """
    from evgp_node.qt import QtCore

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


if __name__ == '__main__':
    sys.exit(main())
