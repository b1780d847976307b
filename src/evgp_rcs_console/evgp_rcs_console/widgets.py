# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What the areas of the window are made of: texts that fit, cards, and buttons."""

from __future__ import annotations

from collections.abc import Callable
import functools
from typing import NamedTuple, TypeVar

from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.words import Cell, STATE_CELLS, Tone
from evgp_rcs_console.catalogue import CATALOGUE
from evgp_rcs_console.qt import QtCore, QtGui, QtWidgets
from evgp_rcs_console.style import FAMILIES, GAP, LEAST, look, RADIUS, SMALL, TEXT
from evgp_rcs_console.view import Button, STEP_STATES

Part = TypeVar('Part', bound=QtWidgets.QWidget)

Pressed = Callable[[Button, Button], None]
"""Takes the command that a button had when it went down, and the one it has when it is let go."""

_FLAGS = QtCore.Qt.AlignmentFlag
LEFT = _FLAGS.AlignLeft | _FLAGS.AlignVCenter
RIGHT = _FLAGS.AlignRight | _FLAGS.AlignVCenter
CENTER = _FLAGS.AlignHCenter | _FLAGS.AlignVCenter
TOP = _FLAGS.AlignLeft | _FLAGS.AlignTop
_WRAP = QtCore.Qt.TextFlag.TextWordWrap.value


@functools.lru_cache(maxsize=200)
def font(pixels: int, bold: bool = False) -> QtGui.QFont:
    """Return a font of a size in pixels, with digits of one width."""
    there = QtGui.QFontDatabase.families()
    family = next((each for each in FAMILIES if each in there), FAMILIES[-1])
    made = QtGui.QFont([family, FAMILIES[-1]])
    made.setPixelSize(max(1, pixels))
    made.setBold(bold)
    if family == FAMILIES[-1]:
        made.setStretch(90)  # it is wide
    if hasattr(QtGui.QFont, 'setFeature'):
        made.setFeature(QtGui.QFont.Tag('tnum'), 1)
    return made


class Drawn(NamedTuple):
    """A text that a widget shows: all of it, what is shown of it, and the room that it has."""

    whole: str
    shown: str
    room: QtCore.QRect
    used: QtCore.QRect


@functools.lru_cache(maxsize=4000)
def fitted(
    text: str, width: int, height: int, size: int, least: int, bold: bool, wrap: bool
) -> tuple[str, int]:
    """
    Return what is shown of a text in a room, and the size of its type; sizes in pixels.

    It is shown in the largest type in which all of it fits. If it fits in none, it ends after a
    word with dots.
    """
    for pixels in range(size, least - 1, -1):
        if _fits(text, width, height, pixels, bold, wrap):
            return text, pixels
    words = text.split(' ')
    few, many = 0, len(words)
    while few < many:
        middle = (few + many + 1) // 2
        if _fits(' '.join(words[:middle]) + ' …', width, height, least, bold, wrap):
            few = middle
        else:
            many = middle - 1
    if few:
        return ' '.join(words[:few]).rstrip(',;:') + ' …', least
    metrics = QtGui.QFontMetrics(font(least, bold))
    return metrics.elidedText(text, QtCore.Qt.TextElideMode.ElideRight, max(0, width)), least


def _fits(text: str, width: int, height: int, size: int, bold: bool, wrap: bool) -> bool:
    needed = _extent(text, width, size, bold, wrap)
    return needed.width() <= width and needed.height() <= height


def _extent(text: str, width: int, size: int, bold: bool, wrap: bool) -> QtCore.QRect:
    room = QtCore.QRect(0, 0, max(0, width), 10_000)
    return QtGui.QFontMetrics(font(size, bold)).boundingRect(room, _WRAP if wrap else 0, text)


class Pen:
    """
    Draws a widget.

    :ivar drawn: the texts that it has drawn.
    """

    def __init__(self, widget: QtWidgets.QWidget) -> None:
        self.painter = QtGui.QPainter(widget)
        self.painter.setRenderHint(QtGui.QPainter.RenderHint.Antialiasing)
        self.drawn: list[Drawn] = []

    def __enter__(self) -> Pen:
        """Draw."""
        return self

    def __exit__(self, *error: object) -> None:
        """Draw no more, whatever has happened."""
        self.painter.end()

    def box(
        self,
        room: QtCore.QRect,
        fill: str = '',
        frame: str = '',
        width: float = 1.0,
        radius: float = RADIUS,
    ) -> None:
        """Draw a rounded box."""
        thick = max(1.0, width * look.by)
        pen = QtGui.QPen(QtGui.QColor(frame), thick) if frame else QtCore.Qt.PenStyle.NoPen
        self.painter.setPen(pen)
        self.painter.setBrush(QtGui.QColor(fill) if fill else QtCore.Qt.BrushStyle.NoBrush)
        half = thick / 2 if frame else 0.0
        inner = QtCore.QRectF(room).adjusted(half, half, -half, -half)
        self.painter.drawRoundedRect(inner, look.px(radius), look.px(radius))

    def stripes(self, room: QtCore.QRect) -> None:
        """Draw stripes over a box: it is not so yet."""
        path = QtGui.QPainterPath()
        path.addRoundedRect(QtCore.QRectF(room), look.px(RADIUS), look.px(RADIUS))
        self.painter.save()
        self.painter.setClipPath(path)
        self.painter.setPen(QtGui.QPen(QtGui.QColor(255, 255, 255, 60), look.px(6)))
        step = look.px(16)
        for x in range(room.left() - room.height(), room.right() + step, step):
            self.painter.drawLine(x, room.bottom(), x + room.height(), room.top())
        self.painter.restore()

    def text(
        self,
        room: QtCore.QRect,
        text: str,
        colour: str,
        size: float = TEXT,
        bold: bool = False,
        align: QtCore.Qt.AlignmentFlag = LEFT,
        least: float = LEAST,
        wrap: bool = False,
    ) -> None:
        """Draw a text where it fits."""
        if not text:
            return
        shown, pixels = fitted(
            text,
            room.width(),
            room.height(),
            look.px(size),
            look.px(min(size, least)),
            bold,
            wrap,
        )
        self.painter.setFont(font(pixels, bold))
        self.painter.setPen(QtGui.QColor(colour))
        flags = align.value | (_WRAP if wrap else 0)
        used = self.painter.boundingRect(room, flags, shown)
        self.painter.drawText(room, flags, shown)
        self.drawn.append(Drawn(text, shown, room, used))


class Area(QtWidgets.QWidget):
    """A widget whose parts keep their distances from its edges."""

    def __init__(self, name: str = '') -> None:
        super().__init__()
        self.setObjectName(name)
        self._parts: dict[QtWidgets.QWidget, tuple[float, float, float, float]] = {}

    def put(self, part: Part, left: float, top: float, right: float, bottom: float) -> Part:
        """
        Put a part somewhere, or somewhere else, and return it.

        Each number is where an edge of it is, on a 1366 by 768 screen: in pixels from the left or
        the top; if it is negative, or 0 for the last two, from the right or the bottom.
        """
        if part not in self._parts:
            part.setParent(self)
        self._parts[part] = left, top, right, bottom
        self._lay(part)
        return part

    def _lay(self, part: QtWidgets.QWidget) -> None:
        left, top, right, bottom = self._parts[part]
        x = look.px(left) + self.width() * (left < 0)
        y = look.px(top) + self.height() * (top < 0)
        wide = look.px(right) + self.width() * (right <= 0) - x
        part.setGeometry(x, y, wide, look.px(bottom) + self.height() * (bottom <= 0) - y)

    def resizeEvent(self, event: QtGui.QResizeEvent) -> None:  # noqa: N802 - Qt's name
        """Put every part where it belongs."""
        self.lay_parts()

    def lay_parts(self) -> None:
        """Put every part where it belongs."""
        for part in self._parts:
            self._lay(part)


class Painted(Area):
    """
    A widget that draws itself.

    :ivar drawn: its texts, as they were drawn last.
    """

    def __init__(self, name: str = '') -> None:
        super().__init__(name)
        self.drawn: list[Drawn] = []
        self._shown: object = None

    @property
    def whole(self) -> str:
        """Return all that it says, also what is cut."""
        return '\n'.join(each.whole for each in self.drawn)

    @property
    def cut(self) -> bool:
        """Return whether not all of it is shown."""
        return any(each.whole != each.shown for each in self.drawn)

    def show_it(self, *shown: object) -> None:
        """Draw it again if what it is to show has changed."""
        if shown != self._shown:
            self._shown = shown
            self.update()

    def paint(self, pen: Pen) -> None:
        """Draw it."""

    def paintEvent(self, event: QtGui.QPaintEvent) -> None:  # noqa: N802 - Qt's name
        """Draw it."""
        with Pen(self) as pen:
            self.paint(pen)
        self.drawn = pen.drawn


class Text(Painted):
    """
    A text that takes the room it is given: no text moves what is beside it.

    If it does not fit, it ends with dots, and the bottom line shows all of it when it is pointed
    at.

    :param fills: its tone colours its ground, too.
    """

    def __init__(
        self,
        name: str,
        size: float = TEXT,
        bold: bool = False,
        align: QtCore.Qt.AlignmentFlag = LEFT,
        wrap: bool = False,
        fills: bool = False,
        colour: Callable[[], str] | None = None,
    ) -> None:
        super().__init__(name)
        self.cell = Cell('')
        self._size = size
        self.bold = bold
        self._align = align
        self._wrap = wrap
        self._fills = fills
        self._colour = colour

    @property
    def whole(self) -> str:
        """Return the text that is not cut."""
        return self.cell.text

    def resize_type(self, size: float) -> None:
        """Take another size of type."""
        if size != self._size:
            self._size = size
            self.update()

    def show_text(self, text: str) -> None:
        """Show a text."""
        self.show_cell(Cell(text))

    def show_cell(self, cell: Cell, stale: bool = False) -> None:
        """Show a text in its tone, or greyed."""
        self.cell = cell
        self.setProperty('tone', 'stale' if stale else cell.tone.value)
        self.setAccessibleName(cell.text)
        self.show_it(cell, stale)

    def paint(self, pen: Pen) -> None:
        """Draw it."""
        room, tone = self.rect(), self.cell.tone
        if self.property('tone') == 'stale':
            tone = Tone.FAINT
        colour = self._colour() if self._colour else look.text(tone)
        if self._fills and tone not in (Tone.PLAIN, Tone.FAINT, Tone.GOOD):
            colour, fill = look.fill(tone)
            pen.box(room, fill)
        if self._fills:
            room = room.adjusted(look.px(GAP), look.px(2), -look.px(GAP), -look.px(2))
        pen.text(room, self.cell.text, colour, self._size, self.bold, self._align, wrap=self._wrap)


class Card(Painted):
    """The ground of an area."""

    def paint(self, pen: Pen) -> None:
        """Draw it."""
        pen.box(self.rect(), look.palette.card, look.palette.line)


class Push(QtWidgets.QPushButton):
    """
    A button that draws itself.

    :ivar drawn: its texts, as they were drawn last.
    """

    def __init__(self, name: str = '', text: str = '', key: str = '') -> None:
        super().__init__()
        self.setObjectName(name)
        self.words = self.key = ''
        self.show_words(text, key)
        self.quiet = False
        self.drawn: list[Drawn] = []

    @property
    def whole(self) -> str:
        """Return all that it says."""
        return f'{self.words}  {self.key}'.strip()

    @property
    def barred(self) -> bool:
        """Return whether it does nothing now."""
        return self.property('barred') == 'true'

    def bar(self, barred: bool) -> None:
        """Take whether it does nothing now."""
        self.setProperty('barred', 'true' if barred else 'false')
        self.update()

    def show_words(self, text: str, key: str = '') -> None:
        """Show another text."""
        if (text, key) != (self.words, self.key):
            self.words, self.key = text, key
            self.setText(text.replace('&', '&&'))  # no letter of a name is a shortcut

    def paintEvent(self, event: QtGui.QPaintEvent) -> None:  # noqa: N802 - Qt's name
        """Draw it."""
        with Pen(self) as pen:
            self.paint(pen)
            if self.hasFocus():
                pen.box(self.rect(), '', look.palette.chosen, 3)
        self.drawn = pen.drawn

    def colours(self) -> tuple[str, str, str]:
        """Return the colours of its text, its ground and its frame; empty: it has none."""
        colours = look.palette
        if self.barred or not self.isEnabled():
            return colours.faint, '', ''
        if self.property('tone') == Tone.WAIT.value and not self.isDown():
            return *look.fill(Tone.WAIT), look.fill(Tone.WAIT)[1]
        ground = colours.raised if self.isDown() else colours.card
        return colours.ink, ground, colours.line if self.quiet else colours.ink

    def paint(self, pen: Pen) -> None:
        """Draw it: the text in the middle, the key after it."""
        ink, ground, frame = self.colours()
        if ground:
            pen.box(self.rect(), ground, frame, 1.5)
        margin = look.px(UNDER_TEXT if self.height() < look.px(36) else GAP + UNDER_TEXT)
        room = self.rect().adjusted(margin, look.px(2), -margin, -look.px(2))
        size = TEXT if self.height() > look.px(36) else SMALL
        if self.key and not self.barred:
            key = QtGui.QFontMetrics(font(look.px(SMALL))).horizontalAdvance(self.key)
            wide = min(room.width() // 2, key + look.px(2))
            beside = room.adjusted(room.width() - wide, 0, 0, 0)
            pen.text(beside, self.key, look.palette.faint, SMALL, align=RIGHT)
            room.setRight(beside.left() - look.px(3))
        bold = not self.barred and self.isEnabled()
        pen.text(room, self.words, ink, size, bold, CENTER, wrap=self.height() > look.px(38))


UNDER_TEXT = 5
"""Room between a button's frame and its text, at least."""


class CommandButton(Push):
    """
    A command. One that is not allowed looks and is disabled, but can still be focused and tapped.

    Then it says why: a keyboard and a touch screen know no hovering.

    A stop acts when the button goes down: whatever stands there when the hand goes up, or whether
    the button is still there then, is no matter. Anything else acts when the button is let go.
    """

    def __init__(self, pressed: Pressed) -> None:
        super().__init__()
        self.button: Button | None = None
        self.setFocusPolicy(QtCore.Qt.FocusPolicy.StrongFocus)
        self._give = pressed
        self._down: Button | None = None
        self.pressed.connect(self._go_down)
        self.clicked.connect(self._let_go)

    def show_button(self, button: Button) -> None:
        """Show a command and whether it is allowed."""
        if button == self.button:
            return
        self.button = button
        name = button.command.name.lower()
        self.setObjectName(f'{name}_{button.kart}' if button.kart else name)
        label = CATALOGUE[button.command].short or button.label
        self.show_words(label if button.kart else button.label, button.key)
        self.setToolTip(button.explanation)
        self.setAccessibleDescription(button.explanation)
        self.bar(not button.enabled)

    def colours(self) -> tuple[str, str, str]:
        """Return the colours of its text, its ground and its frame; empty: it has none."""
        ink, ground, frame = super().colours()
        if self.button is None or not self.button.is_stop:
            recedes = self.button is not None and self.button.recedes and not self.isDown()
            return (ink, '', '') if recedes else (ink, ground, frame)
        if self.button.kart and not self.isDown():
            flag = self.button.command is CommandKind.KART_RED_FLAG
            ink, fill = look.fill(Tone.FLAG if flag else Tone.RED)
            return ink, fill, fill
        return look.palette.bad, ground, look.palette.bad

    def _go_down(self) -> None:
        self._down = self.button
        if self.button is not None and self.button.is_instant:
            self._give(self.button, self.button)

    def _let_go(self) -> None:
        down, self._down = self._down, None
        if down is not None and self.button is not None and not down.is_instant:
            self._give(down, self.button)


class StepButton(CommandButton):
    """A command to the race, with a phrase below it: since when, what it does, what it awaits."""

    def paint(self, pen: Pen) -> None:
        """Draw it."""
        button = self.button
        if button is None:
            return
        ink, ground, frame = self.colours()
        if button.current and isinstance(button.command, CommandKind):
            tone = STATE_CELLS[STEP_STATES[button.command]].tone
            frame = look.palette.faint if tone is Tone.GARAGE else look.fill(tone)[1]
            ink = look.palette.ink if not button.is_stop else ink
            pen.box(self.rect(), ground or look.palette.card, frame, 3)
        elif ground:
            pen.box(self.rect(), ground, frame, 2)
        room = self.rect().adjusted(look.px(10), look.px(6), -look.px(8), -look.px(3))
        high = look.px(21)
        upper = QtCore.QRect(room.left(), room.top(), room.width(), high)
        wide = look.px(22)
        strong = button.current or not self.barred
        name = upper.adjusted(0, 0, -wide - look.px(4), 0)
        pen.text(name, self.words, ink, TEXT, strong)
        key = upper.adjusted(upper.width() - wide, 0, 0, 0)
        pen.text(key, self.key, look.palette.faint, SMALL, align=RIGHT)
        below = room.adjusted(0, high, 0, 0)
        pen.text(below, button.phrase, look.palette.faint, SMALL, align=TOP, wrap=True)
