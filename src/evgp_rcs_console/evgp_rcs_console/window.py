# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Connects the parts of the officials' window with each other and with the client.

Everything here runs in the Qt thread. News from ROS arrives through the signals of ``Inbox``,
which Qt queues. Commands go out through ``give``, which returns at once.
"""

from __future__ import annotations

from evgp_protocol import clock
from evgp_rcs_console import settings, texts
from evgp_rcs_console.display import Display, Inbox
from evgp_rcs_console.input import CommandInput, Give, Keyboard, LateInput, Mouse
from evgp_rcs_console.qt import QtCore, QtGui, QtWidgets
from evgp_rcs_console.settings import Signature
from evgp_rcs_console.style import DAY, look, NIGHT

LOOK = 100
"""Time between two updates of everything that changes with time, in milliseconds."""


class ConsoleWindow(Display):
    """The window of one official."""

    def __init__(self, inbox: Inbox, give: Give, signature: Signature, looking: str) -> None:
        super().__init__(looking, inbox)
        self.setWindowTitle(texts.TITLE)
        self.setFocusPolicy(QtCore.Qt.FocusPolicy.StrongFocus)
        look.palette = NIGHT if settings.kept(settings.NIGHT) else DAY
        self._late = LateInput(LOOK / 1000, self)
        self.presses = presses = CommandInput(give, signature, self, self._late)
        self._mouse, self._keyboard = Mouse(presses), Keyboard(presses)
        # It acts on the press, so that a press also counts if the pointer then slips off.
        self.kill.button.pressed.connect(presses.kill)
        self.events.filter.clicked.connect(presses.toggle_events)
        self.foot.official.clicked.connect(
            lambda: self.open_sheet(self.officials, self.officials.first)
        )
        # The signals come from other threads, so they are always queued.
        queued = QtCore.Qt.ConnectionType.QueuedConnection
        inbox.came.connect(self.take_races, queued)
        inbox.event.connect(self.take_event, queued)
        inbox.results.connect(self.take_results, queued)
        inbox.answer.connect(self.take_answer, queued)
        inbox.pressing.connect(self.take_pressing, queued)
        inbox.dropped.connect(presses.take_dropped, queued)
        inbox.battery.connect(self.foot.show_battery, queued)
        self._timer = QtCore.QTimer(self)
        self._timer.timeout.connect(self.look)
        self._timer.start(LOOK)
        self.winId()  # makes the native window, which gets every key and click first
        self.windowHandle().installEventFilter(self)
        application = QtWidgets.QApplication.instance()
        assert isinstance(application, QtWidgets.QApplication)
        application.focusChanged.connect(self.bottom.move)
        self.foot.show_name(signature.name)
        self.fit()
        self.setFocus()
        self.look()

    def look(self) -> None:
        super().look()
        self._late.beat(clock.now())

    def changeEvent(self, event: QtCore.QEvent) -> None:  # noqa: N802 - Qt's name
        super().changeEvent(event)
        if event.type() == QtCore.QEvent.Type.ActivationChange and hasattr(self, '_mouse'):
            self._mouse.take_activation(self.isActiveWindow())
            self.refresh()

    def eventFilter(  # noqa: N802 - Qt's name
        self, watched: QtCore.QObject, event: QtCore.QEvent
    ) -> bool:
        """Handle keys and the mouse before any widget gets them."""
        kind = event.type()
        if kind == QtCore.QEvent.Type.KeyPress:
            assert isinstance(event, QtGui.QKeyEvent)
            return self._keyboard.take(event)
        if isinstance(event, QtGui.QMouseEvent):
            return self._mouse.take(event)
        # An open menu would take clicks and keys, even those of stops.
        return bool(kind == QtCore.QEvent.Type.ContextMenu)

    def closeEvent(self, event: QtGui.QCloseEvent) -> None:  # noqa: N802 - Qt's name
        self._timer.stop()
        self.alerts.alarm.close()
        super().closeEvent(event)
