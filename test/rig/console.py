# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The officials' window on a screen of its own: real clicks in, and what is really shown out.

The window runs in a process of its own, started by this module (``-m rig.console``), which adds
a probe to it: it answers, in the Qt thread, what the window's widgets show and where they are.
Commands never go through the probe; they are clicks and keys on the X server.
"""

from __future__ import annotations

from collections.abc import Callable
import contextlib
from multiprocessing import connection
import os
import pathlib
import re
import sys
import threading
import time
from typing import Any

from evgp_testing.part import PATIENCE
from evgp_testing.process import Program
from rig.screen import Screen

DROPPED = 'while the window was not responding'
CHANGED = '(list of karts|alerts have) just changed|Click again'
"""Of what the window says of a key or a click that it dropped."""

OPEN = 'The probe of the window listens'

SLOW = 3.0
"""Time after which a press was dropped with the same words as one before, in seconds."""


class Console(Program):
    """
    An official's window on a screen of its own.

    :param folder: where its socket goes.
    """

    def __init__(self, folder: pathlib.Path, domain: int, screen: Screen) -> None:
        """Open the window; it need not find race control."""
        self.screen = screen
        self._asking: Callable[[], None] = lambda: None
        address = folder / f'probe{screen.display[1:]}'
        address.unlink(missing_ok=True)
        super().__init__(
            'rcs_gui',
            [sys.executable, '-m', 'rig.console', str(address)],
            domain,
            {
                'DISPLAY': screen.display,
                'QT_QPA_PLATFORM': 'xcb',
                'PYTHONPATH': os.pathsep.join(sys.path),
                # The official's name is kept below it.
                'ROS_HOME': str(folder),
            },
        )
        try:
            self.wait_for_line(OPEN)
            self._probe = connection.Client(str(address))
        except BaseException:
            self.close()
            raise

    def wait_for(self, name: str, **wanted: object) -> dict[str, Any]:
        """
        Return a widget once it is visible and as wanted.

        :param wanted: ``text``, a pattern that must be found in it; anything else must be equal,
            as ``barred='false'``. ``visible=False``: that it is hidden.
        :raises AssertionError: if it does not become so in time.
        """
        # Less than this end's own patience, so that it learns what there is instead.
        answer = self._is(name, wanted, PATIENCE - 5)
        assert answer['found'], (
            f'{name} did not become {wanted}; it is {answer["widget"]}\n{self._seen()}'
        )
        widget: dict[str, Any] = answer['widget']
        return widget

    def _seen(self) -> str:
        """Return every text that the window shows, and what it has printed."""
        shown = (
            f'{name}: {widget["text"]!r} (barred: {widget["barred"]})'
            for name, widget in self._ask(do='widgets').items()
            if widget['text']
        )
        return '\n'.join((*shown, self.output))

    def click(self, name: str, **wanted: object) -> None:
        """Click a widget, once it is visible and as wanted."""
        x, y = self.place(name, **wanted)
        self.screen.click(x, y)

    def hover(self, name: str) -> None:
        self.screen.move(*self.place(name))

    def place(self, name: str, **wanted: object) -> tuple[int, int]:
        """Return the middle of a widget, once it is visible and as wanted."""
        widget = self.wait_for(name, **wanted)
        return widget['x'] + widget['width'] // 2, widget['y'] + widget['height'] // 2

    def key(self, *names: str) -> None:
        for name in names:
            self.screen.key(name)

    def press(self, *names: str, see: str, **wanted: object) -> dict[str, Any]:
        """
        Press keys, and return a widget once it is as wanted.

        On a busy machine the window may be held up; then it drops keys, and says so. What it says
        it dropped is pressed again, as an official would.
        """
        return self.until(lambda: self.key(*names), see, **wanted)

    def press_on(self, button: str, see: str, **wanted: object) -> dict[str, Any]:
        """Click a widget, again if the window says that it dropped that, as ``press`` does."""
        return self.until(lambda: self.click(button), see, **wanted)

    def until(self, act: Callable[[], None], name: str, **wanted: object) -> dict[str, Any]:
        """
        Press or click by a function, again if the window drops that, as ``press`` does.

        A question that is not true any more, since race control was not heard for a moment, is
        asked again first, also as an official would.
        """
        ends = time.monotonic() + PATIENCE
        while time.monotonic() < ends:
            before = self.wait_for('status')['text']
            act()
            slow = time.monotonic() + SLOW
            while time.monotonic() < ends:
                answer = self._is(name, wanted, 0.1)
                if answer['found']:
                    widget: dict[str, Any] = answer['widget']
                    if name in ('question', 'yes', 'no'):
                        self._asking = act
                    return widget
                said = self.wait_for('status')['text']
                if re.search(f'{DROPPED}|{CHANGED}', said) and (
                    said != before or time.monotonic() > slow
                ):
                    break
                spoilt = {'text': 'Press NO and start again'}
                if time.monotonic() > slow and self._is('question_warning', spoilt)['found']:
                    self.key('n')
                    self._asking()
                    self.wait_for('yes', barred='false')
                    break
                if name == 'question' and time.monotonic() > slow:
                    break  # the same key again so soon is taken for a slip, without a word
        return self.wait_for(name, **wanted)

    def _is(self, name: str, wanted: dict[str, Any], seconds: float = 0.0) -> dict[str, Any]:
        """Return a widget within some seconds, and whether it was found as wanted."""
        return dict(self._ask(do='wait', name=name, wanted=wanted, seconds=seconds))

    def ask(self, *names: str, **wanted: object) -> None:
        """Press keys until the last one has the window ask a question, as wanted."""
        self.press(*names, see='question', **wanted)

    def block(self) -> None:
        """Have the window's own thread do nothing until `go_on`; return once it has begun."""
        self._ask(do='block')

    def go_on(self) -> None:
        self._probe.send({'do': 'go on'})

    def close(self) -> int:
        """Close it in an orderly way, or by force if that takes too long; return its exit code."""
        code = super().close()
        if hasattr(self, '_probe'):
            self._probe.close()
        return code

    def _ask(self, **question: Any) -> Any:
        with contextlib.suppress(OSError, EOFError):
            self._probe.send(question)
            if self._probe.poll(PATIENCE):
                return self._probe.recv()
        raise AssertionError(f'the window does not answer:\n{self.output}')


# ----- in the window's process ------------------------------------------------------------


def probe(window: Any, address: str) -> None:
    """Answer the questions of a ``Console`` from within the window's process."""
    from evgp_node.qt import QtCore, QtGui, QtWidgets, Signal
    from evgp_rcs_console import texts
    from evgp_rcs_console.alerts import AlertsArea
    from evgp_rcs_console.widgets import Text

    listener = connection.Listener(address)
    print(OPEN)
    talking = listener.accept()

    def describe(widget: Any) -> dict[str, Any]:
        corner = widget.mapToGlobal(QtCore.QPoint(0, 0))
        if isinstance(widget, AlertsArea):
            document = QtGui.QTextDocument()
            document.setHtml(widget.findChild(QtWidgets.QLabel, 'alert_texts').text())
            text = document.toPlainText()
        elif isinstance(widget, QtWidgets.QListWidget):
            text = '\n'.join(widget.item(place).text() for place in range(widget.count()))
        elif hasattr(widget, 'text') and widget.text():
            text = widget.text().replace('&&', '&')
        else:
            parts = widget.findChildren(Text)
            text = '\n'.join(each.text() for each in parts if each.isVisibleTo(widget))
        return {
            'visible': widget.isVisible(),
            'text': text,
            'focus': widget.hasFocus(),
            'x': corner.x(),
            'y': corner.y(),
            'width': widget.width(),
            'height': widget.height(),
            **{name: widget.property(name) for name in ('barred', 'tone', 'pressing')},
        }

    def describe_row(number: int) -> dict[str, Any] | None:
        """Return a kart's row as if it were a widget: it is a row of a table."""
        table = window.karts.table
        if number not in window.karts.numbers:
            return None
        model, place = table.model(), window.karts.numbers.index(number)
        cells = [model.index(place, column) for column in range(model.columnCount())]
        rect, row = table.visualRect(cells[0]), table.rows[place]
        corner = table.viewport().mapToGlobal(rect.topLeft())
        return describe(table) | {
            'text': '\n'.join(filter(None, (each.data() for each in cells))),
            'linked': 'false' if row.link.text == texts.NOT_LINKED else 'true',
            'x': corner.x(),
            'y': corner.y(),
            'width': table.columnViewportPosition(6),
            'height': rect.height(),
        }

    def find(name: str) -> dict[str, Any] | None:
        if name.startswith('kart_') and name[5:].isdecimal():
            return describe_row(int(name[5:]))
        widget = window.findChild(QtWidgets.QWidget, name)
        return describe(widget) if widget is not None else None

    def fits(found: dict[str, Any] | None, wanted: dict[str, Any]) -> bool:
        if found is None or not found['visible']:
            return wanted.get('visible') is False
        return all(
            re.search(value, found[name]) if name == 'text' else found[name] == value
            for name, value in wanted.items()
        )

    def wait(name: str, wanted: dict[str, Any], until: float, before: Any = None) -> None:
        found = find(name)
        over = time.monotonic() > until
        # Twice the same: a layout that is on its way has places where nothing stays.
        if over or (fits(found, wanted) and found == before):
            talking.send({'found': fits(found, wanted), 'widget': found})
        else:
            QtCore.QTimer.singleShot(20, lambda: wait(name, wanted, until, found))

    class Asked(QtCore.QObject):
        question = Signal(object)

    def take(question: dict[str, Any]) -> None:
        if question['do'] == 'widgets':
            named = [each for each in window.findChildren(QtWidgets.QWidget) if each.isVisible()]
            found = {each.objectName(): describe(each) for each in named if each.objectName()}
            talking.send(
                found | {f'kart_{each}': describe_row(each) for each in window.karts.numbers}
            )
        elif question['do'] == 'wait':
            until = time.monotonic() + question['seconds']
            wait(question['name'], question['wanted'], until)
        elif question['do'] == 'block':
            going_on.clear()
            talking.send(True)
            going_on.wait()

    going_on = threading.Event()
    asked = Asked()
    asked.question.connect(take, QtCore.Qt.ConnectionType.QueuedConnection)
    window.probe = asked

    def listen() -> None:
        with contextlib.suppress(EOFError):
            while question := talking.recv():
                if question['do'] == 'go on':
                    going_on.set()
                else:
                    asked.question.emit(question)

    window.activateWindow()
    threading.Thread(target=listen, daemon=True).start()


def main() -> int:
    """Open the window with a probe in it."""
    from evgp_rcs_console.gui import main as gui

    attach: Callable[[Any], None] = lambda window: probe(window, sys.argv[1])  # noqa: E731
    return gui([], attach)


if __name__ == '__main__':
    sys.exit(main())
