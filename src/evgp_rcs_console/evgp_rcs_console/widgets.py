# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Parts that the areas of the window are made of, and the areas that are small."""

from __future__ import annotations

from collections.abc import Callable

from evgp_rcs_console.qt import QtCore, QtGui, QtWidgets
from evgp_rcs_console.view import Button, Cell, Danger

Pressed = Callable[[Button, Button], None]
"""Takes the command that a button had when it went down, and the one it has when it is let go."""

WRAP = QtCore.Qt.TextFlag.TextWordWrap.value


def set_property(widget: QtWidgets.QWidget, name: str, value: str) -> None:
    """Give a widget a property that its style depends on."""
    if widget.property(name) != value:
        widget.setProperty(name, value)
        widget.style().unpolish(widget)
        widget.style().polish(widget)


def set_text(widget: QtWidgets.QLabel | QtWidgets.QPushButton, text: str) -> None:
    """Give a label or a button a text."""
    if widget.text() != text:
        widget.setText(text)


class Label(QtWidgets.QLabel):
    """A text with a tone."""

    def __init__(self, name: str = '', **properties: str) -> None:
        """Be empty; the properties are what its style depends on."""
        super().__init__()
        self.setTextFormat(QtCore.Qt.TextFormat.PlainText)
        if name:
            self.setObjectName(name)
        for key, value in properties.items():
            self.setProperty(key, value)

    def show_cell(self, cell: Cell, stale: bool = False) -> None:
        """Show a text in its tone, or greyed."""
        set_text(self, cell.text)
        set_property(self, 'tone', 'stale' if stale else cell.tone.value)


class Fitted(Label):
    """
    A text that takes the room it is given: no text moves what is beside it.

    It is shown in the largest type in which all of it fits, wrapped. If it fits in none, it ends
    after a word with dots, and the bottom line shows all of it when it is pointed at.

    :param sizes: the sizes of type to try, in pixels on a 1366 by 768 screen.
    """

    def __init__(self, name: str, sizes: tuple[int, ...], **properties: str) -> None:
        """Be empty."""
        super().__init__(name, **properties)
        self._sizes = sizes
        self._by = 1.0
        self._whole = ''
        self._fitted: object = None
        self._size = 0
        self.setWordWrap(True)
        self.setSizePolicy(
            QtWidgets.QSizePolicy.Policy.Ignored, QtWidgets.QSizePolicy.Policy.Preferred
        )

    @property
    def whole(self) -> str:
        """Return the text that is not cut."""
        return self._whole

    @property
    def cut(self) -> bool:
        """Return whether not all of it is shown."""
        return self.text() != self._whole

    def fit(self, by: float) -> None:
        """Take the size of a scale."""
        self._by = by
        self._refit()

    def show_text(self, text: str) -> None:
        """Show a text."""
        if text != self._whole:
            self._whole = text
            self.setAccessibleName(text)
            self._refit()

    def show_cell(self, cell: Cell, stale: bool = False) -> None:
        """Show a text in its tone, or greyed."""
        set_property(self, 'tone', 'stale' if stale else cell.tone.value)
        self.show_text(cell.text)

    def sizeHint(self) -> QtCore.QSize:  # noqa: N802 - Qt's name
        """Ask for no room: it is given some."""
        return QtCore.QSize(0, 0)

    def minimumSizeHint(self) -> QtCore.QSize:  # noqa: N802 - Qt's name
        """Do with any room."""
        return QtCore.QSize(0, 0)

    def hasHeightForWidth(self) -> bool:  # noqa: N802 - Qt's name
        """Return that its height never depends on its text."""
        return False

    def resizeEvent(self, event: QtGui.QResizeEvent) -> None:  # noqa: N802 - Qt's name
        """Fit the text into the new room."""
        super().resizeEvent(event)
        self._refit()

    def changeEvent(self, event: QtCore.QEvent) -> None:  # noqa: N802 - Qt's name
        """Fit the text, since its type has changed."""
        super().changeEvent(event)
        if event.type() == QtCore.QEvent.Type.FontChange:
            self._refit()

    def _refit(self) -> None:
        self.ensurePolished()
        room = self.contentsRect().adjusted(0, 0, -2, 0)
        font = QtGui.QFont(self.font())
        wanted = (self._whole, room.width(), room.height(), self._by, font.weight())
        if wanted == self._fitted:
            return
        self._fitted = wanted
        text = self._whole
        for size in self._sizes:
            font.setPixelSize(round(size * self._by))
            if _fits(text, font, room):
                break
        else:
            text = _cut(text, font, room)
        if font.pixelSize() != self._size:
            self._size = font.pixelSize()
            self.setStyleSheet(f'font-size: {self._size}px')
        set_text(self, text)
        self.setToolTip('' if text == self._whole else self._whole)


def _fits(text: str, font: QtGui.QFont, room: QtCore.QRect) -> bool:
    high = QtCore.QRect(0, 0, room.width(), 10_000)
    needed = QtGui.QFontMetrics(font).boundingRect(high, WRAP, text)
    return needed.width() <= room.width() and needed.height() <= room.height()


def _cut(text: str, font: QtGui.QFont, room: QtCore.QRect) -> str:
    """Return as many words as fit, and dots."""
    all_words = text.split(' ')
    few, many = 0, len(all_words)
    while few < many:
        middle = (few + many + 1) // 2
        if _fits(' '.join(all_words[:middle]) + ' …', font, room):
            few = middle
        else:
            many = middle - 1
    if few:
        return ' '.join(all_words[:few]).rstrip(',;:') + ' …'
    metrics = QtGui.QFontMetrics(font)
    return metrics.elidedText(text, QtCore.Qt.TextElideMode.ElideRight, max(0, room.width()))


IN_A_ROW = 10
"""Maximum length of what a button in a kart's row says in one line, in characters."""


class CommandButton(QtWidgets.QPushButton):
    """
    A command. One that is not allowed looks and is disabled, but can still be focused and tapped.

    Then it says why: a keyboard and a touch screen know no hovering.

    A stop acts when the button goes down: whatever stands there when the hand goes up, or whether
    the button is still there then, is no matter. Anything else acts when the button is let go.
    """

    def __init__(self, pressed: Pressed, large: bool = False) -> None:
        """Wait to be told the command."""
        super().__init__()
        self.button: Button | None = None
        self.setFocusPolicy(QtCore.Qt.FocusPolicy.StrongFocus)
        self.setProperty('large', 'true' if large else 'false')
        self._give = pressed
        self._down: Button | None = None
        self.pressed.connect(self._go_down)
        self.clicked.connect(self._let_go)

    def show_button(self, button: Button) -> None:
        """Show a command and whether it is allowed."""
        if button == self.button:
            return
        self.button = button
        name = button.command.value.lower()
        self.setObjectName(f'{name}_{button.kart}' if button.kart else name)
        text = f'{button.label}  {button.key}' if button.key else button.label
        if button.kart and len(text) > IN_A_ROW:
            text = text.replace(' ', '\n', 1)
        set_text(self, text)
        set_property(self, 'stop', 'true' if button.is_stop else 'false')
        set_property(self, 'barred', 'false' if button.enabled else 'true')
        tip = button.explanation
        self.setToolTip(tip)
        self.setAccessibleDescription(tip)

    def _go_down(self) -> None:
        self._down = self.button
        if self.button is not None and self.button.is_instant:
            self._give(self.button, self.button)

    def _let_go(self) -> None:
        down, self._down = self._down, None
        if down is not None and self.button is not None and not down.is_instant:
            self._give(down, self.button)


class RaceButton(QtWidgets.QWidget):
    """
    A command to the race with the reason below it, always there to be read.

    :param lines: how many lines the reason may have.
    """

    def __init__(self, pressed: Pressed, lines: int) -> None:
        """Wait to be told the command."""
        super().__init__()
        self._lines = lines
        self.press = CommandButton(pressed, large=True)
        self._reason = Fitted('', (12, 11), reason='true')
        self._reason.setAlignment(QtCore.Qt.AlignmentFlag.AlignTop)
        column(self, self.press, self._reason).setSpacing(0)

    def show_button(self, button: Button) -> None:
        """Show a command and whether it is allowed."""
        self.press.show_button(button)
        self._reason.show_text(button.reason)

    def fit(self, by: float) -> None:
        """Take the size of a scale."""
        self.press.setFixedHeight(round(38 * by))
        self._reason.setFixedHeight(round(13 * self._lines * by))
        self._reason.fit(by)


class DangerPanel(QtWidgets.QFrame):
    """Race control is gone, or must not be relied on: in the largest type."""

    def __init__(self) -> None:
        """Say nothing yet."""
        super().__init__()
        self.setObjectName('danger')
        self._title = Fitted('danger_title', (40, 36, 32, 28))
        self._detail = Fitted('danger_detail', (16, 15, 14, 13, 12))
        self._advice = Fitted('danger_advice', (56, 50, 46, 42, 36, 30))
        left = QtWidgets.QVBoxLayout()
        left.addWidget(self._title, 3)
        left.addWidget(self._detail, 4)
        layout = QtWidgets.QHBoxLayout(self)
        layout.setContentsMargins(6, 0, 6, 0)
        layout.addLayout(left, 3)
        layout.addWidget(self._advice, 2)
        for label in (self._title, self._advice, self._detail):
            label.setAlignment(QtCore.Qt.AlignmentFlag.AlignCenter)

    def fit(self, by: float) -> None:
        """Take the size of a scale."""
        for label in (self._title, self._advice, self._detail):
            label.fit(by)

    def show_danger(self, danger: Danger) -> None:
        """Say it."""
        self._title.show_text(danger.title)
        self._advice.show_text(danger.advice)
        self._detail.show_text(danger.detail)


class NumberField(QtWidgets.QFrame):
    """The kart that a command by key acts on, in large type."""

    def __init__(self) -> None:
        """Be empty."""
        super().__init__()
        self.setObjectName('number_field')
        self._title = Fitted('number', (34, 28, 22, 18))
        self._detail = Fitted('number_detail', (15, 13, 12, 11))
        layout = column(self, self._title, self._detail)
        layout.setSpacing(0)
        layout.setStretch(0, 5)
        layout.setStretch(1, 2)
        for label in (self._title, self._detail):
            label.setAlignment(QtCore.Qt.AlignmentFlag.AlignCenter)

    def fit(self, by: float) -> None:
        """Take the size of a scale."""
        self.setFixedHeight(round(64 * by))
        self._title.fit(by)
        self._detail.fit(by)

    def show_cells(self, title: Cell, detail: Cell) -> None:
        """Show a kart's number and team, or why there is none."""
        set_property(self, 'tone', title.tone.value)
        self._title.show_cell(title)
        self._detail.show_cell(detail)


def column(parent: QtWidgets.QWidget, *children: QtWidgets.QWidget) -> QtWidgets.QVBoxLayout:
    """Put widgets below each other, without margins."""
    layout = QtWidgets.QVBoxLayout(parent)
    layout.setContentsMargins(0, 0, 0, 0)
    for child in children:
        layout.addWidget(child)
    return layout


def pair(above: QtWidgets.QWidget, below: QtWidgets.QWidget) -> QtWidgets.QWidget:
    """Put two widgets below each other, as one."""
    both = QtWidgets.QWidget()
    column(both, above, below).setSpacing(0)
    return both
