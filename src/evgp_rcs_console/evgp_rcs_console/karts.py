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

"""The karts: a row for each, with its commands, and an overview of them when there are many."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

from evgp_rcs_console import style, words
from evgp_rcs_console.qt import QtCore, QtGui, QtWidgets, Signal
from evgp_rcs_console.view import Cell, Row, Tone
from evgp_rcs_console.widgets import (
    column,
    CommandButton,
    Fitted,
    Label,
    pair,
    Pressed,
    set_property,
)

Scrolling = Callable[[QtWidgets.QScrollBar], AbstractContextManager[None]]
"""Is entered while the window itself scrolls, with the bar that moves."""

OVERVIEW_FROM = 9
"""Minimum number of karts for which there is an overview."""

WIDTHS = {
    'number': 58,
    'race': 104,
    'sent': 138,
    'acknowledged': 148,
    'place': 46,
    'button': 80,
}
ROW_HEIGHT = 46
"""Height of a row where there are many karts."""
FEW_KARTS = (44, 60)
"""Minimum and maximum height of a row where there are few karts."""


class KartRow(QtWidgets.QFrame):
    """A kart, with its commands beside it."""

    chosen = Signal(int)

    def __init__(self, pressed: Pressed) -> None:
        """Wait to be told the kart."""
        super().__init__()
        self.number = 0
        self._upper = 0
        self.setProperty('row', 'true')
        self._number = Label(cell='number')
        self._number.setAlignment(QtCore.Qt.AlignmentFlag.AlignCenter)
        self._team = Fitted('', (15, 13, 12), cell='team')
        self._note = Fitted('', (12, 11), cell='note')
        self._names = pair(self._team, self._note)
        self._race = Label()
        self._link = Label(fill='true')
        self._sent = Label(fill='true')
        self._since = Label(cell='since')
        self._acknowledged = Label(fill='true')
        self._says = Label(cell='says')
        self._place = Label(cell='place')
        self._place.setAlignment(QtCore.Qt.AlignmentFlag.AlignCenter)
        self._buttons = [CommandButton(pressed) for _ in range(5)]
        self._pairs = {
            'race': pair(self._race, self._link),
            'sent': pair(self._sent, self._since),
            'acknowledged': pair(self._acknowledged, self._says),
        }
        layout = QtWidgets.QHBoxLayout(self)
        layout.addWidget(self._number)
        layout.addWidget(self._names, 1)
        for both in self._pairs.values():
            layout.addWidget(both)
        layout.addWidget(self._place)
        for button in self._buttons:
            layout.addWidget(button)

    def fit(self, by: float, height: int) -> None:
        """Take the size of a scale, and a height in pixels."""
        self.setFixedHeight(height)
        # Of a low row the note has two small lines, and the team the rest.
        self._upper = min(height // 2, height - round(27 * by))
        self._share_height()
        for label in (self._team, self._note):
            label.fit(by)
        layout = self.layout()
        assert layout is not None
        layout.setContentsMargins(round(3 * by), 0, round(3 * by), 0)
        layout.setSpacing(round(4 * by))
        self._number.setFixedWidth(round(WIDTHS['number'] * by))
        self._place.setFixedWidth(round(WIDTHS['place'] * by))
        for name, both in self._pairs.items():
            both.setFixedWidth(round(WIDTHS[name] * by))
        for button in self._buttons:
            button.setFixedSize(round(WIDTHS['button'] * by), height - round(8 * by))

    def show_row(self, row: Row, chosen: bool, stale: bool) -> None:
        """Show a kart."""
        if row.number != self.number:
            self.number = row.number
            self.setObjectName(f'kart_{row.number}')
        set_property(self, 'racing', 'true' if row.in_race else 'false')
        set_property(self, 'chosen', 'true' if chosen else 'false')
        faint = Tone.PLAIN if row.in_race else Tone.FAINT
        self._number.show_cell(Cell(str(row.number), faint), stale)
        self._team.show_cell(Cell(row.team), stale)
        self._note.show_cell(Cell(row.note), stale)
        self._share_height()
        self._race.show_cell(row.race, stale)
        self._link.show_cell(row.link, stale)
        self._sent.show_cell(row.sent, stale)
        self._since.show_cell(Cell(row.since, Tone.FAINT), stale)
        self._acknowledged.show_cell(row.acknowledged, stale)
        says = f'says {row.says.text}' if row.says.text else ''
        self._says.show_cell(Cell(says, row.says.tone), stale)
        self._place.show_cell(Cell(row.place), stale)
        for widget, button in zip(self._buttons, row.buttons, strict=True):
            widget.show_button(button)

    def _share_height(self) -> None:
        """Give the team all the room while there is no note."""
        height = self._upper if self._note.whole else self.height() - 1
        if self._team.height() != height:
            self._team.setFixedHeight(height)

    def mousePressEvent(self, event: QtGui.QMouseEvent) -> None:  # noqa: N802 - Qt's name
        """Choose this kart."""
        self.chosen.emit(self.number)
        super().mousePressEvent(event)


class Heading(QtWidgets.QFrame):
    """What stands above the columns of the karts."""

    def __init__(self) -> None:
        """Name the columns."""
        super().__init__()
        self._labels = {name: Label(heading='true') for name in words.HEADINGS}
        layout = QtWidgets.QHBoxLayout(self)
        for name, label in self._labels.items():
            label.setText(words.HEADINGS[name])
            layout.addWidget(label, 1 if name == 'team' else 0)

    def fit(self, by: float, bar: int = 0) -> None:
        """Take the size of a scale, and leave room for the scroll bar below (pixels)."""
        layout = self.layout()
        assert layout is not None
        layout.setContentsMargins(round(3 * by), 0, round(3 * by) + bar, 0)
        layout.setSpacing(round(4 * by))
        for name, label in self._labels.items():
            if name == 'buttons':
                label.setFixedWidth(round((5 * WIDTHS['button'] + 16) * by))
            elif name != 'team':
                label.setFixedWidth(round(WIDTHS[name] * by))


class Overview(QtWidgets.QWidget):
    """Every kart as a tile, for when there are more than fit: number, state, and what is amiss."""

    chosen = Signal(int)

    def __init__(self) -> None:
        """Be empty."""
        super().__init__()
        self.setObjectName('overview')
        self._rows: tuple[Row, ...] = ()
        self._chosen = 0
        self._stale = False
        self._by = 1.0

    def fit(self, by: float) -> None:
        """Take the size of a scale."""
        self._by = by
        self.setFixedHeight(round(36 * by))
        self.update()

    def show_rows(self, rows: tuple[Row, ...], chosen: int, stale: bool) -> None:
        """Show the karts."""
        if (rows, chosen, stale) != (self._rows, self._chosen, self._stale):
            self._rows, self._chosen, self._stale = rows, chosen, stale
            self.update()

    def mousePressEvent(self, event: QtGui.QMouseEvent) -> None:  # noqa: N802 - Qt's name
        """Choose the kart that was clicked."""
        if self._rows:
            place = int(event.position().x() / (self.width() / len(self._rows)))
            self.chosen.emit(self._rows[min(place, len(self._rows) - 1)].number)

    def paintEvent(self, event: QtGui.QPaintEvent) -> None:  # noqa: N802 - Qt's name
        """Paint the tiles: the number above, the state's symbol and a mark below."""
        painter = QtGui.QPainter(self)
        count = max(1, len(self._rows))
        width = self.width() / count
        for place, row in enumerate(self._rows):
            box = QtCore.QRectF(place * width, 0, width - 2, self.height() - 1)
            tone = row.link.tone if row.link.tone is Tone.BAD else row.sent.tone
            fore, back = style.STALE if self._stale else style.TONES[tone]
            if not row.in_race and row.sent.tone is Tone.GARAGE and not self._stale:
                fore, back = style.TONES[Tone.FAINT][0], '#FFFFFF'
            painter.fillRect(box, QtGui.QColor(back))
            thick = row.number == self._chosen
            pen = QtGui.QPen(QtGui.QColor('#0047C2' if thick else '#333333'))
            pen.setWidthF(3 * self._by if thick else 1)
            painter.setPen(pen)
            painter.drawRect(box)
            painter.setPen(QtGui.QColor(fore))
            font = painter.font()
            font.setBold(True)
            font.setPixelSize(round(min(15 * self._by, width * 0.48)))
            painter.setFont(font)
            top = QtCore.Qt.AlignmentFlag.AlignHCenter | QtCore.Qt.AlignmentFlag.AlignTop
            painter.drawText(box, top, str(row.number))
            marks = row.sent.text[:1]
            if row.link.tone is Tone.BAD:
                marks += words.MARK_LOST
            elif row.acknowledged.tone is Tone.GOOD:
                marks += words.MARK_YES
            elif row.acknowledged.tone is Tone.WAIT:
                marks += words.MARK_WAIT
            font.setPixelSize(round(min(13 * self._by, width * 0.42)))
            painter.setFont(font)
            low = QtCore.Qt.AlignmentFlag.AlignHCenter | QtCore.Qt.AlignmentFlag.AlignBottom
            painter.drawText(box, low, marks)
        painter.end()


class Rows(QtWidgets.QScrollArea):
    """
    What the rows are scrolled in.

    :param scrolling: is entered around every scrolling that the official's hand does not do.
    """

    def __init__(self, scrolling: Scrolling) -> None:
        """Have no rows."""
        super().__init__()
        self._scrolling = scrolling

    def focusNextPrevChild(self, following: bool) -> bool:  # noqa: N802 - Qt's name
        """Move the focus, and scroll to where it is."""
        with self._scrolling(self.verticalScrollBar()):
            return bool(super().focusNextPrevChild(following))

    def bring_into_view(self, row: QtWidgets.QWidget) -> None:
        """Scroll to a row."""
        with self._scrolling(self.verticalScrollBar()):
            self.ensureWidgetVisible(row, 0, 0)


class KartList(QtWidgets.QWidget):
    """
    Every kart of the roster, in the order of their numbers.

    Where a row stands depends on the size of the window and on the number of karts, on nothing
    else.
    """

    chosen = Signal(int)
    """By a click in its row."""
    wanted = Signal(int)
    """By a click on its tile: its row may be out of sight."""

    def __init__(self, pressed: Pressed, scrolling: Scrolling) -> None:
        """Have no kart."""
        super().__init__()
        self._pressed = pressed
        self._by = 1.0
        self.rows: list[KartRow] = []
        self._overview = Overview()
        self._overview.chosen.connect(self.wanted)
        self._overview.hide()
        self._heading = Heading()
        inside = QtWidgets.QWidget()
        inside.setObjectName('rows')
        self._inside = QtWidgets.QVBoxLayout(inside)
        self._inside.setContentsMargins(0, 0, 0, 0)
        self._inside.setSpacing(0)
        self._inside.addStretch(1)
        self.scroll = Rows(scrolling)
        self.scroll.setObjectName('karts')
        self.scroll.setWidgetResizable(True)
        self.scroll.setWidget(inside)
        self.scroll.setFocusPolicy(QtCore.Qt.FocusPolicy.NoFocus)
        self.scroll.setHorizontalScrollBarPolicy(QtCore.Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        layout = column(self, self._overview, self._heading, self.scroll)
        layout.setSpacing(1)
        layout.setStretch(2, 1)

    @property
    def numbers(self) -> list[int]:
        """Return the numbers of the karts, in their order."""
        return [row.number for row in self.rows]

    def fit(self, by: float) -> None:
        """Take the size of a scale."""
        self._by = by
        self._overview.fit(by)
        self._fit_rows()

    def show_rows(self, rows: tuple[Row, ...], chosen: int, stale: bool) -> None:
        """Show the karts."""
        if len(rows) != len(self.rows):
            self._have(len(rows))
        for widget, row in zip(self.rows, rows, strict=True):
            widget.show_row(row, row.number == chosen, stale)
        self._overview.show_rows(rows, chosen, stale)

    def bring_into_view(self, number: int) -> None:
        """Scroll to a kart."""
        for row in self.rows:
            if row.number == number:
                self.scroll.bring_into_view(row)

    def resizeEvent(self, event: QtGui.QResizeEvent) -> None:  # noqa: N802 - Qt's name
        """Have the rows use the room."""
        super().resizeEvent(event)
        self._fit_rows()

    def _have(self, count: int) -> None:
        for row in self.rows[count:]:
            self._inside.removeWidget(row)
            row.hide()
            row.deleteLater()
        del self.rows[count:]
        for place in range(len(self.rows), count):
            row = KartRow(self._pressed)
            row.chosen.connect(self.chosen)
            self._inside.insertWidget(place, row)
            self.rows.append(row)
        many = count >= OVERVIEW_FROM
        self._overview.setVisible(many)
        # A bar that comes and goes would shift every button.
        bar = QtCore.Qt.ScrollBarPolicy
        self.scroll.setVerticalScrollBarPolicy(
            bar.ScrollBarAlwaysOn if many else bar.ScrollBarAsNeeded
        )
        self._fit_rows()

    def _fit_rows(self) -> None:
        heading = round(17 * self._by)
        self._heading.setFixedHeight(heading)
        count = len(self.rows)
        height = round(ROW_HEIGHT * self._by)
        bar = count >= OVERVIEW_FROM
        if 0 < count < OVERVIEW_FROM:
            room = self.height() - heading - 2
            least, most = (round(each * self._by) for each in FEW_KARTS)
            height = max(least, min(most, room // count))
            bar = height * count > room
        for row in self.rows:
            row.fit(self._by, height)
        width = self.scroll.verticalScrollBar().sizeHint().width()
        self._heading.fit(self._by, width if bar else 0)


def chooses(widget: QtWidgets.QWidget | None) -> bool:
    """Return whether a press there only chooses a kart: a stop for it may be next."""
    while widget is not None and not isinstance(widget, QtWidgets.QAbstractButton):
        if isinstance(widget, (KartRow, Overview)):
            return True
        widget = widget.parentWidget()
    return False
