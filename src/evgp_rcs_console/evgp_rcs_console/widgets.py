# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Provides what the areas of the window are built from: texts, buttons, panels and grids."""

from __future__ import annotations

from collections.abc import Sequence
import functools
import itertools
from typing import TypeVar

from evgp_node.qt import QtCore, QtGui, QtWidgets
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.words import Cell, STATE_CELLS, Tone
from evgp_rcs_console.catalogue import CATALOGUE
from evgp_rcs_console.style import FAMILIES, look
from evgp_rcs_console.view import Button, STEP_STATES

_FLAGS = QtCore.Qt.AlignmentFlag
LEFT = _FLAGS.AlignLeft | _FLAGS.AlignVCenter
RIGHT = _FLAGS.AlignRight | _FLAGS.AlignVCenter
CENTER = _FLAGS.AlignHCenter | _FLAGS.AlignVCenter
TOP = _FLAGS.AlignLeft | _FLAGS.AlignTop
BOTTOM = _FLAGS.AlignLeft | _FLAGS.AlignBottom
_WRAP = QtCore.Qt.TextFlag.TextWordWrap.value

Policy = QtWidgets.QSizePolicy.Policy

_Part = TypeVar('_Part', bound=QtWidgets.QWidget)


@functools.lru_cache(maxsize=200)
def font(pixels: int, bold: bool = False) -> QtGui.QFont:
    """Return a font of a size in pixels, with digits of equal width."""
    there = QtGui.QFontDatabase.families()
    family = next((each for each in FAMILIES if each in there), FAMILIES[-1])
    made = QtGui.QFont([family, FAMILIES[-1]])
    made.setPixelSize(max(1, pixels))
    made.setBold(bold)
    if family == FAMILIES[-1]:
        made.setStretch(90)  # a wide font
    if hasattr(QtGui.QFont, 'Tag'):
        made.setFeature(QtGui.QFont.Tag('tnum'), 1)
    return made


def fits(text: str, room: QtCore.QRect, of: QtGui.QFont, wrap: bool) -> bool:
    metrics, endless = QtGui.QFontMetrics(of), QtCore.QRect(0, 0, room.width(), 10_000)
    needed = metrics.boundingRect(endless, _WRAP if wrap else 0, text)
    # The room under the base line of the last line may be cut off.
    high = needed.height() - metrics.height() + metrics.ascent()
    return needed.width() <= room.width() and high <= room.height() + 1


def draw(
    painter: QtGui.QPainter,
    room: QtCore.QRect,
    text: str,
    of: QtGui.QFont,
    colour: QtGui.QColor | str,
    align: QtCore.Qt.AlignmentFlag = LEFT,
    wrap: bool = False,
) -> bool:
    """
    Draw a text, and return whether it fits.

    If it does not fit, draw only the lines that do, and end the last with dots.
    """
    if fits(text, room, of, wrap):
        painter.setFont(of)
        painter.setPen(QtGui.QColor(colour))
        painter.drawText(room, align.value | (_WRAP if wrap else 0), text)
        return True
    metrics = QtGui.QFontMetrics(of)
    if wrap and room.height() > metrics.height():
        over = room.height() % metrics.lineSpacing()
        room = room.adjusted(0, 0 if align & _FLAGS.AlignTop else over // 2, 0, 0)
        room.setHeight(room.height() - (over if align & _FLAGS.AlignTop else over - over // 2))
    item = QtWidgets.QStyleOptionViewItem()
    style = QtWidgets.QApplication.style()
    margin = style.pixelMetric(QtWidgets.QStyle.PixelMetric.PM_FocusFrameHMargin) + 1
    item.rect = room.adjusted(-margin, 0, margin, 0)
    item.text = text.replace('\n', '\u2028')
    item.textElideMode = QtCore.Qt.TextElideMode.ElideRight
    item.font = of
    item.fontMetrics = metrics
    item.displayAlignment = align
    item.palette.setColor(QtGui.QPalette.ColorRole.Text, QtGui.QColor(colour))
    item.state = QtWidgets.QStyle.StateFlag.State_Enabled
    feature = QtWidgets.QStyleOptionViewItem.ViewItemFeature
    item.features = feature.HasDisplay | (feature.WrapText if wrap else feature.HasDisplay)
    style.drawControl(QtWidgets.QStyle.ControlElement.CE_ItemViewItem, item, painter, None)
    return False


def mark(widget: QtWidgets.QWidget, **marks: str) -> None:
    """Set the properties by which the style sheet selects the look of a widget."""
    changed = [name for name, value in marks.items() if widget.property(name) != value]
    for name in changed:
        widget.setProperty(name, marks[name])
    if changed:
        for each in (widget, *widget.findChildren(QtWidgets.QLabel)):
            each.style().unpolish(each)
            each.style().polish(each)
            each.update()


def lay(
    owner: _Part,
    *rows: Sequence[QtWidgets.QWidget],
    gap: int = 0,
    margins: Sequence[int] = (0, 0, 0, 0),
    columns: Sequence[int] = (1,),
    heights: Sequence[int] = (),
) -> _Part:
    """
    Arrange parts of an owner in a grid; lengths are in pixels on a 1366 by 768 screen.

    :param rows: the parts in each row, from the top. A part in several cells fills all of them.
    :param margins: left, top, right, bottom.
    :param columns: each column's share of the remaining width; 0: only the width it needs.
    :param heights: each row's share of the remaining height; 0: only the height it needs.
    """
    grid = QtWidgets.QGridLayout(owner)
    grid.setProperty('design', [gap, *margins])
    for part in dict.fromkeys(itertools.chain(*rows)):
        cells = [
            (y, x) for y, row in enumerate(rows) for x, each in enumerate(row) if each is part
        ]
        (top, left), (bottom, right) = cells[0], cells[-1]
        grid.addWidget(part, top, left, bottom - top + 1, right - left + 1)
    for column, share in enumerate(columns):
        grid.setColumnStretch(column, share)
    for place, share in enumerate(heights):
        grid.setRowStretch(place, share)
    return owner


def fixed(part: _Part, width: int = 0, height: int = 0) -> _Part:
    """Return a part whose size is fixed, in pixels on a 1366 by 768 screen; 0: as it needs."""
    part.setProperty('design', [width, height])
    policy = part.sizePolicy()
    if width:
        policy.setHorizontalPolicy(Policy.Fixed)
    if height:
        policy.setVerticalPolicy(Policy.Fixed)
    part.setSizePolicy(policy)
    return part


def rescale(owner: QtWidgets.QWidget) -> None:
    """Scale the fixed sizes, gaps and margins of all parts to this screen."""
    for layout in owner.findChildren(QtWidgets.QLayout):
        if layout.property('design'):
            gap, *margins = map(look.px, layout.property('design'))
            layout.setSpacing(gap)
            layout.setContentsMargins(*margins)
    for part in owner.findChildren(QtWidgets.QWidget):
        width, height = map(look.px, part.property('design') or (0, 0))
        if width:
            part.setFixedWidth(width)
        if height:
            part.setFixedHeight(height)


class Text(QtWidgets.QLabel):
    """
    A text that stays within its room, and so never moves the widgets beside it.

    A text that does not fit ends with dots. While the pointer is on such a text, the bottom line
    shows the full text.

    :param kind: the names that the style sheet uses: a size, ``bold``, ``faint``.
    :param fills: whether the tone of the text also colours the background.
    :param flows: whether the text takes all the height (with ``wrap``) or width that it needs, and
        no room if it is empty. If it also ``fills``, the texts beside it give way.
    :param smaller: the kind to use instead if the text does not fit; empty: always use ``kind``.
    """

    def __init__(
        self,
        name: str = '',
        kind: str = '',
        align: QtCore.Qt.AlignmentFlag = LEFT,
        wrap: bool = False,
        fills: bool = False,
        flows: bool = False,
        text: str = '',
        smaller: str = '',
    ) -> None:
        self._flows, self._fills = flows, fills
        self._kind, self._smaller = kind, smaller
        self._cell: Cell | None = None
        super().__init__(text)
        self.setObjectName(name)
        self.setProperty('kind', kind)
        self.setAlignment(align)
        self.setTextFormat(QtCore.Qt.TextFormat.PlainText)
        self.setWordWrap(wrap)
        self.setMinimumSize(1, 1)
        policy = self.sizePolicy()
        policy.setHorizontalPolicy(Policy.Maximum if flows and not wrap else Policy.Ignored)
        policy.setVerticalPolicy(Policy.Minimum if flows and wrap else Policy.Ignored)
        if flows and fills and not wrap:
            self.setMinimumWidth(0)
            policy.setHorizontalPolicy(Policy.Fixed)
        self.setSizePolicy(policy)

    @property
    def explanation(self) -> str:
        """Return the whole text if it is visible but cut off; otherwise an empty text."""
        return self.text().replace('\n', ', ') if self.isVisible() and self.cut else ''

    @property
    def cut(self) -> bool:
        text, room = self.text(), self.contentsRect()
        return bool(text) and not fits(text, room, self.font(), self.wordWrap())

    def hasHeightForWidth(self) -> bool:  # noqa: N802 - Qt's name
        return self._flows and self.wordWrap()

    def show_text(self, text: str) -> None:
        self.show_cell(Cell(text))

    def show_cell(self, cell: Cell) -> None:
        """Show a text in its tone."""
        if cell == self._cell:
            return
        self._cell = cell
        self.setText(cell.text)
        self._fit()
        if self._flows:
            self.setVisible(bool(cell.text))
        is_filled = self._fills and cell.tone in (Tone.WAIT, Tone.BAD, Tone.BANNER)
        mark(self, tone=cell.tone.value, ground=cell.tone.value if is_filled else '')

    def _fit(self) -> None:
        if self._smaller:
            mark(self, kind=self._kind)
            if self.cut:
                mark(self, kind=self._smaller)

    def resizeEvent(self, event: QtGui.QResizeEvent) -> None:  # noqa: N802 - Qt's name
        super().resizeEvent(event)
        self._fit()

    def paintEvent(self, event: QtGui.QPaintEvent) -> None:  # noqa: N802 - Qt's name
        QtWidgets.QFrame.paintEvent(self, event)
        if self.text():
            painter, ink = QtGui.QPainter(self), self.palette().color(self.foregroundRole())
            align, wrap = self.alignment(), self.wordWrap()
            draw(painter, self.contentsRect(), self.text(), self.font(), ink, align, wrap)
            painter.end()


class Panel(QtWidgets.QFrame):
    """An area of the window with a frame."""

    def __init__(self, name: str = '', kind: str = 'card') -> None:
        super().__init__()
        self.setObjectName(name)
        self.setProperty('kind', kind)
        self.setSizePolicy(Policy.Ignored, Policy.Ignored)


class Push(QtWidgets.QPushButton):
    """
    A button.

    :param tall: whether the button shows its key at the right edge, and a phrase under its text.
    """

    def __init__(
        self, name: str = '', text: str = '', key: str = '', kind: str = '', tall: bool = False
    ) -> None:
        super().__init__()
        self.setObjectName(name)
        self.setProperty('kind', kind)
        self.setSizePolicy(Policy.Ignored, Policy.Ignored)
        self.setMinimumSize(1, 1)
        self._labels: tuple[Text, ...] = ()
        self.words = self.key = ''
        if tall:
            name_, phrase = Text('', 'bold'), Text('', 'faint small', TOP, wrap=True)
            key_ = Text('', 'faint small', RIGHT, flows=True)
            self._labels = fixed(name_, height=20), key_, phrase
            rows = (name_, key_), (phrase, phrase)
            lay(self, *rows, margins=(10, 5, 8, 3), columns=(1, 0), heights=(0, 1))
            for label in self._labels:  # the button gets every click
                label.setAttribute(QtCore.Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.show_words(text, key)

    def bar(self, barred: bool) -> None:
        """Set whether the button looks disabled. It can still be pressed."""
        mark(self, barred='true' if barred else 'false')

    def show_words(self, text: str, key: str = '', phrase: str = '') -> None:
        self.words, self.key = text, key
        for label, said in zip(self._labels, (text, key, phrase), strict=False):
            label.show_text(said)
        if self._labels:
            self.setAccessibleName(text)
            return
        self.setText(f'{text}  {key}'.strip().replace('&', '&&'))  # no letter is a shortcut


class CommandButton(Push):
    """
    The button of a command.

    If the command is not possible, the button looks disabled, but an official can still focus or
    tap it to see the reason. With a keyboard or a touch screen, nobody can hover over a button.

    An instant stop acts when the button goes down. Any other command acts when the button is
    released. Either way, the window's ``presses`` learn of it.
    """

    def __init__(self, tall: bool = False, kind: str = '') -> None:
        super().__init__(kind=kind, tall=tall)
        self.button: Button | None = None
        self.setFocusPolicy(QtCore.Qt.FocusPolicy.StrongFocus)
        self._down: Button | None = None
        self.pressed.connect(self._go_down)
        self.clicked.connect(self._let_go)

    @property
    def explanation(self) -> str:
        return self.button.explanation if self.button is not None else ''

    def show_button(self, button: Button) -> None:
        """Show a command, and whether that command is possible."""
        before, self.button = self.button, button  # an equal one asks about an older race
        if button == before:
            return
        name = button.command.name.lower()
        self.setObjectName(f'{name}_{button.kart}' if button.kart else name)
        entry = CATALOGUE[button.command]
        label = entry.short or button.label
        key = button.key if self._labels or button.enabled else ''
        self.show_words(label if button.kart else button.label, key, button.phrase)
        self.setAccessibleDescription(button.explanation)
        is_flag = RaceState.RED_FLAG in (*entry.result.race, *entry.result.hold)
        # Recording the use of the MSR, which asks first, must not look like a stop to reach for.
        looks = ('flag' if is_flag else 'stop') if button.is_instant else ''
        if button.is_next:
            looks = 'go' if button.command is CommandKind.GREEN_GREEN else 'next'
        ground = current = ''
        if button.is_stop and button.kart:
            ground = (Tone.FLAG if is_flag else Tone.RED).value
        if button.current and isinstance(button.command, CommandKind):
            current = STATE_CELLS[STEP_STATES[button.command]].tone.value
        if button.recedes:
            looks = 'recedes'
        barred = 'false' if button.enabled else 'true'
        mark(self, barred=barred, look=looks, ground=ground, current=current)

    def _go_down(self) -> None:
        self._down = self.button
        if self.button is not None and self.button.is_instant:
            self.window().presses.let_go(self.button, self.button)

    def _let_go(self) -> None:
        down, self._down = self._down, None
        if down is not None and self.button is not None and not down.is_instant:
            self.window().presses.let_go(down, self.button)
