# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Shows a row for each kart, with the kart's commands.

If the rows do not all fit, a line of tiles above them keeps all karts in sight.
"""

from __future__ import annotations

from evgp_node.qt import QtCore, QtGui, QtWidgets
from evgp_rcs.words import Tone
from evgp_rcs_console.style import FILLS, GAP, LARGE, look, RADIUS, SMALL, TEXT
from evgp_rcs_console.view import COLUMNS, KART_COMMANDS, MOST_BARS, Row, Screen
from evgp_rcs_console.widgets import (
    CENTER,
    CommandButton,
    draw,
    fixed,
    font,
    lay,
    LEFT,
    Panel,
    RIGHT,
)

COMMAND, BESIDE = 72, 10
"""Width of a command's column, and the margin in the other columns, in pixels."""

NUMBER, TEAM, SENT, LINK = map([*COLUMNS].index, ('Kart', 'Team', 'Sent, for', 'Link'))

HEADING, TILES = 22, 36
"""Heights of the heading and of the tiles, in pixels."""

LOWEST, HIGHEST, SCROLLED = 28, 60, 34
"""Minimum and maximum height of a row if all rows fit, and its height if not, in pixels."""


class KartDelegate(QtWidgets.QStyledItemDelegate):
    """Draws the cells of the karts, except the columns that contain buttons."""

    def __init__(self, table: KartTable) -> None:
        super().__init__()
        self._table = table

    def paint(
        self,
        painter: QtGui.QPainter,
        option: QtWidgets.QStyleOptionViewItem,
        index: QtCore.QModelIndex,
    ) -> None:
        row, room, colours = self._table.rows[index.row()], option.rect, look.palette
        is_chosen = row.number == self._table.chosen
        painter.save()
        painter.setRenderHint(QtGui.QPainter.RenderHint.Antialiasing)
        if is_chosen:
            painter.fillRect(room, QtGui.QColor(colours.raised))
        painter.fillRect(room.adjusted(0, room.height() - 1, 0, 0), QtGui.QColor(colours.line))
        if not index.column() and (row.use_msr or is_chosen):
            edge = FILLS[Tone.BAD][1] if row.use_msr else colours.chosen
            painter.fillRect(room.adjusted(0, 0, look.px(5) - room.width(), 0), QtGui.QColor(edge))
        if index.column() < len(COLUMNS):
            self.draw_cell(painter, row, index.column(), room)
        painter.restore()

    def draw_cell(
        self, painter: QtGui.QPainter, row: Row, column: int, cell: QtCore.QRect
    ) -> bool:
        """Draw the content of a cell and return whether all of its text fits."""
        room = cell.adjusted(look.px(BESIDE if column == NUMBER else 0), 0, -look.px(BESIDE), -1)
        said, below = row.cells[column]
        if self._table.stale:
            said, below = (each._replace(tone=Tone.FAINT) for each in (said, below))
        strong, high = row.in_race and not self._table.stale, cell.height()
        ink = look.palette.ink if strong else look.palette.faint
        if column == NUMBER:
            plate = _centred(room, 32)
            _box(painter, plate, ink if strong else '', '' if strong else look.palette.line)
            fitting = plate.width() * 3 // (2 * len(said.text))
            of = font(min(look.px(LARGE - 2), high * 6 // 10, fitting), True)
            colour = look.palette.card if strong else ink
            return draw(painter, plate, said.text, of, colour, CENTER)
        small = font(
            min(look.px(SMALL - (column != TEAM)), high * 10 // 27), below.tone is Tone.BAD
        )
        if column == SENT:
            return self._draw_sent(painter, row, room, small)
        large = font(min(look.px(TEXT), high * 13 // 28), said.tone is not Tone.FAINT)
        if column == LINK:
            large = font(small.pixelSize() + look.px(1), said.tone is Tone.BAD)
        ink = ink if said.tone is Tone.PLAIN else look.text(said.tone)
        faint = look.palette.faint if below.tone is Tone.PLAIN else look.text(below.tone)
        if column == LINK and said.tone is Tone.WAIT:
            ink, fill = look.fill(Tone.WAIT)
            faint = ink
            _box(painter, _centred(room, 40), fill, radius=3)
        if column == LINK and row.bars:
            room = self._draw_bars(painter, row, room, ink)
        is_team = column == TEAM
        metrics, most = QtGui.QFontMetrics(small), room.width() - look.px(6)
        is_long = is_team and metrics.horizontalAdvance(below.text) > most
        inner = _centred(room, 56 if is_long else 38)
        half = min(inner.height() * 11 // 20, look.px(21))
        upper, lower = (
            inner.adjusted(0, 0, 0, half - inner.height()),
            inner.adjusted(0, half, 0, 0),
        )
        if is_team and below.text and row.use_msr:
            ground = lower if is_long else lower.adjusted(0, 0, 0, look.px(2))
            faint, fill = FILLS[Tone.BAD]
            _box(painter, ground, fill, radius=3)
            lower = lower.adjusted(look.px(4), 0, 0, 0)
        upper, lower = upper if below.text else room, lower if said.text else room
        fits = draw(painter, upper, said.text, large, ink, LEFT, is_team and high > 40)
        return draw(painter, lower, below.text, small, faint, LEFT, is_long) and fits

    def _draw_sent(
        self, painter: QtGui.QPainter, row: Row, room: QtCore.QRect, small: QtGui.QFont
    ) -> bool:
        """Draw the state that a kart is sent, and for how long, on stripes until it obeys."""
        chip, faint = _centred(room, 30), self._table.stale or row.sent.tone is Tone.FAINT
        ink, fill = look.fill(Tone.FAINT if faint else row.sent.tone)
        _box(painter, chip, fill)
        if row.waits and not faint:
            stripes = QtGui.QColor(255, 255, 255, 70)
            painter.fillRect(chip, QtGui.QBrush(stripes, QtCore.Qt.BrushStyle.BDiagPattern))
        inside = chip.adjusted(look.px(6), 0, -look.px(6), 0)
        since = QtGui.QFontMetrics(small).horizontalAdvance(row.since) + look.px(2)
        left = inside.adjusted(0, 0, -since - look.px(4), 0)
        right = inside.adjusted(inside.width() - since, 0, 0, 0)
        fits = draw(painter, left, row.sent.text, font(small.pixelSize(), True), ink)
        return draw(painter, right, row.since, small, ink, RIGHT) and fits

    @staticmethod
    def _draw_bars(
        painter: QtGui.QPainter, row: Row, room: QtCore.QRect, ink: str
    ) -> QtCore.QRect:
        """Draw the bars of a link and return the room to the right of them."""
        high, left = min(room.height() - look.px(10), look.px(18)), room.left() + look.px(3)
        foot, wide, radius = room.top() + (room.height() + high) // 2, look.px(4), look.px(1)
        painter.setPen(QtCore.Qt.PenStyle.NoPen)
        for bar in range(1, MOST_BARS + 1):
            tall = high * bar // MOST_BARS
            painter.setBrush(QtGui.QColor(ink if bar <= row.bars else f'#30{ink[1:]}'))
            painter.drawRoundedRect(left, foot - tall, wide, tall, radius, radius)
            left += look.px(6)
        return room.adjusted(left + look.px(3) - room.left(), 0, 0, 0)


def _box(
    painter: QtGui.QPainter,
    room: QtCore.QRect,
    fill: str,
    frame: str = '',
    radius: float = RADIUS,
) -> None:
    pen = QtGui.QPen(QtGui.QColor(frame), look.px(1.5)) if frame else QtCore.Qt.PenStyle.NoPen
    painter.setPen(pen)
    painter.setBrush(QtGui.QColor(fill) if fill else QtCore.Qt.BrushStyle.NoBrush)
    painter.drawRoundedRect(QtCore.QRectF(room), look.px(radius), look.px(radius))


def _centred(room: QtCore.QRect, height: int) -> QtCore.QRect:
    high = min(room.height() - look.px(4), look.px(height))
    return QtCore.QRect(room.left(), room.top() + (room.height() - high) // 2, room.width(), high)


ANSWERED = {Tone.GOOD: '✓', Tone.WAIT: '…', Tone.BAD: '!'}
"""The symbol of a kart's answer on its tile, by the tone of the answer."""


class Tiles(QtWidgets.QWidget):
    """Shows a tile for each kart: its number, and a symbol for its state and for its answer."""

    def __init__(self, table: KartTable) -> None:
        super().__init__()
        self.setObjectName('overview')
        self._table = table

    def mousePressEvent(self, event: QtGui.QMouseEvent) -> None:  # noqa: N802 - Qt's name
        rows = self._table.rows
        if rows:
            place = int(event.position().x() / (self.width() / len(rows)))
            self.window().chosen.choose(rows[min(place, len(rows) - 1)].number)

    def paintEvent(self, event: QtGui.QPaintEvent) -> None:  # noqa: N802 - Qt's name
        rows = self._table.rows
        wide = self.width() / max(1, len(rows))
        painter = QtGui.QPainter(self)
        for place, row in enumerate(rows):
            left = round(place * wide)
            room = QtCore.QRect(left, 1, round(wide) - 2, self.height() - 3)
            lost = row.link.tone is Tone.BAD
            tone = Tone.BAD if lost else row.sent.tone
            ink, fill = look.fill(Tone.PLAIN if self._table.stale else tone)
            is_chosen = row.number == self._table.chosen
            frame = look.palette.chosen if is_chosen else look.palette.line
            _box(painter, room, fill, frame, 3)
            answer = '✗' if lost else ANSWERED.get(row.answer.tone, '')
            small = font(min(look.px(SMALL), round(wide) * 3 // 10), True)
            upper = room.adjusted(0, 0, 0, -room.height() // 2)
            lower = room.adjusted(0, room.height() // 2, 0, 0)
            draw(painter, upper, str(row.number), small, ink, CENTER)
            draw(painter, lower, row.sent.text[:1] + answer, small, ink, CENTER)
        painter.end()


class KartTable(QtWidgets.QTableWidget):
    """
    Shows the rows of the karts.

    :ivar chosen: the number of the kart that commands by key act on; 0 for no kart.
    :ivar stale: whether the rows are out of date.
    """

    def __init__(self) -> None:
        super().__init__(0, len(COLUMNS) + len(KART_COMMANDS))
        self.rows: tuple[Row, ...] = ()
        self.chosen = 0
        self.stale = False
        self.setObjectName('karts')
        self.setShowGrid(False)
        self.setFocusPolicy(QtCore.Qt.FocusPolicy.NoFocus)
        self.setSelectionMode(self.SelectionMode.NoSelection)
        self.setEditTriggers(self.EditTrigger.NoEditTriggers)
        self.setAutoScroll(False)  # a click must not move anything
        self.setTabKeyNavigation(False)
        self.setMouseTracking(True)
        self.setVerticalScrollMode(self.ScrollMode.ScrollPerPixel)
        self.setHorizontalScrollBarPolicy(QtCore.Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        headings = [*COLUMNS, 'Commands', *[''] * 9]
        self.setHorizontalHeaderLabels(headings[: self.columnCount()])
        self.horizontalHeaderItem(0).setTextAlignment(CENTER)
        for header in (self.horizontalHeader(), self.verticalHeader()):
            header.setSectionResizeMode(QtWidgets.QHeaderView.ResizeMode.Fixed)
            header.setMinimumSectionSize(1)
            header.setHighlightSections(False)
        self.horizontalHeader().setDefaultAlignment(LEFT)
        self.verticalHeader().hide()

    def focusNextPrevChild(self, following: bool) -> bool:  # noqa: N802 - Qt's name
        """Move the focus and scroll to the row that gets the focus."""
        moved = bool(super().focusNextPrevChild(following))
        focused = QtWidgets.QApplication.focusWidget()
        if focused is not None and focused.parentWidget() is self.viewport():
            self.bring_into_view(self.indexAt(focused.geometry().center()).row())
        return moved

    def bring_into_view(self, place: int) -> None:
        with self.window().seen.scrolling(self.verticalScrollBar()):
            self.scrollTo(self.model().index(place, 0))


def _tiles(rows: tuple[Row, ...], stale: bool) -> object:
    """Return what the tiles show of the rows."""
    return stale, [(row.number, row.link.tone, row.sent, row.answer.tone) for row in rows]


class KartList(Panel):
    """
    Lists all karts on the roster, in the order of their numbers.

    The place of a row depends only on the size of the window and the number of karts.
    """

    def __init__(self) -> None:
        super().__init__()
        self.table = KartTable()
        self._delegate = KartDelegate(self.table)
        self._tiles = fixed(Tiles(self.table), height=TILES)
        self._tiles.hide()
        self.table.setItemDelegate(self._delegate)
        self.table.pressed.connect(self._choose)
        entered, left = self.table.entered, self.table.viewportEntered
        entered.connect(lambda index: self.window().bottom.point_at(self.whole(index.row())))
        left.connect(lambda: self.window().bottom.point_at(''))
        lay(self, [self._tiles], [self.table], margins=(1, 1, 1, 1), heights=(0, 1))

    @property
    def numbers(self) -> list[int]:
        return [row.number for row in self.table.rows]

    @property
    def room_of_sheets(self) -> QtCore.QRect:
        """Return the room in which a sheet covers no kart's number and no stop."""
        header, table = self.table.horizontalHeader(), self.table.geometry()
        first, last = (header.sectionViewportPosition(column) for column in (1, len(COLUMNS)))
        return table.adjusted(first, 0, last - look.px(GAP) - table.width(), 0)

    def _choose(self, index: QtCore.QModelIndex) -> None:
        self.window().chosen.choose_in_sight(self.numbers[index.row()])

    def whole(self, place: int) -> str:
        """Return the full text of a row; empty if none of the text is cut off."""
        said = [self.table.item(place, column).text() for column in range(len(COLUMNS))]
        return ', '.join(filter(None, said)) if self.cut(place) else ''

    def cut(self, place: int) -> list[int]:
        """Return the columns of a row in which text is cut off."""
        found, nowhere = [], QtGui.QPicture()
        painter = QtGui.QPainter(nowhere)
        for column in range(len(COLUMNS)):
            room = self.table.visualRect(self.table.model().index(place, column))
            if not self._delegate.draw_cell(painter, self.table.rows[place], column, room):
                found.append(column)
        painter.end()
        return found

    def mark(self, number: int) -> None:
        """Mark the kart that commands by key act on; 0 marks no kart."""
        self.table.chosen = number
        self.table.viewport().update()
        self._tiles.update()

    def show_screen(self, screen: Screen) -> None:
        """Show the karts and redraw only the cells that have changed."""
        table, rows = self.table, screen.rows
        before, stale = table.rows, table.stale
        table.rows, table.stale = rows, screen.danger.stale
        table.setRowCount(len(rows))
        for place, row in enumerate(rows):
            looked = before[place].looks if place < len(before) else [()] * len(COLUMNS)
            for number, (was, looks) in enumerate(zip(looked, row.looks, strict=True)):
                if was != looks:
                    said = filter(None, (cell.text for cell in row.cells[number]))
                    table.setItem(place, number, QtWidgets.QTableWidgetItem('\n'.join(said)))
            for number, command in enumerate(row.buttons, len(COLUMNS)):
                if (button := table.cellWidget(place, number)) is None:
                    button = CommandButton()
                    table.setCellWidget(place, number, button)
                button.show_button(command)
        if stale != screen.danger.stale:
            table.viewport().update()
        if _tiles(before, stale) != _tiles(rows, screen.danger.stale):
            self._tiles.update()
        if len(before) != len(rows):
            self.fit()
            self.window().place_sheets()  # a scroll bar moves the stops

    def bring_into_view(self, number: int) -> None:
        if number in self.numbers:
            self.table.bring_into_view(self.numbers.index(number))

    def resizeEvent(self, event: QtGui.QResizeEvent) -> None:  # noqa: N802 - Qt's name
        super().resizeEvent(event)
        self.fit()

    def fit(self) -> None:
        """Fit the rows to the window. If not all of them fit, add the tiles and a scroll bar."""
        count, table = len(self.table.rows), self.table
        room = self.contentsRect().height() - look.px(HEADING) - 4
        all_fit = count * look.px(LOWEST) <= room
        self._tiles.setVisible(not all_fit)
        policy = QtCore.Qt.ScrollBarPolicy
        table.setVerticalScrollBarPolicy(
            policy.ScrollBarAlwaysOff if all_fit else policy.ScrollBarAlwaysOn
        )
        self.layout().activate()
        high = min(look.px(HIGHEST), room // max(1, count)) if all_fit else look.px(SCROLLED)
        table.horizontalHeader().setFixedHeight(look.px(HEADING))
        table.verticalHeader().setDefaultSectionSize(high)
        widths = [look.px(width + BESIDE) * bool(width) for width in COLUMNS.values()]
        widths[0] += look.px(BESIDE)
        widths += [look.px(COMMAND)] * len(KART_COMMANDS)
        widths[widths.index(0)] = max(1, table.viewport().width() - sum(widths))
        for column, width in enumerate(widths):
            table.setColumnWidth(column, width)
        beside = max(look.px(2), (high - look.px(34)) // 2)
        margins = f'QPushButton {{ margin: {beside}px {look.px(3)}px; }}'
        if margins != table.styleSheet():  # Qt would style every button again
            table.setStyleSheet(margins)
        table.doItemsLayout()  # else Qt leaves the buttons where the rows were before


def chooses(widget: QtWidgets.QWidget | None) -> bool:
    """Return whether a press on a widget only chooses a kart, perhaps to stop it next."""
    is_table = widget is not None and isinstance(widget.parentWidget(), KartTable)
    return isinstance(widget, Tiles) or (
        is_table and not isinstance(widget, (QtWidgets.QScrollBar, QtWidgets.QHeaderView))
    )
