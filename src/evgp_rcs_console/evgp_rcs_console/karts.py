# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The karts: a row for each, with its commands, and tiles of all when they do not all fit."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

from evgp_rcs.words import Cell, Tone
from evgp_rcs_console import texts
from evgp_rcs_console.qt import QtCore, QtGui, QtWidgets, Signal
from evgp_rcs_console.style import FILLS, GAP, LARGE, look, SMALL, TEXT
from evgp_rcs_console.view import COLUMNS, KART_COMMANDS, MOST_BARS, Row
from evgp_rcs_console.widgets import (
    CENTER,
    CommandButton,
    font,
    LEFT,
    Painted,
    Pen,
    Pressed,
    RIGHT,
)

Scrolling = Callable[[QtWidgets.QScrollBar], AbstractContextManager[None]]
"""Is entered while the window itself scrolls, with the bar that moves."""

BUTTONS = 320
"""Width of a kart's commands together; each has the same share."""

HEADING, TILES, BAR = 22, 36, 16
"""Heights of the heading and of the tiles, and width of the scroll bar."""

LOWEST, HIGHEST, SCROLLED = 28, 60, 34
"""Minimum and maximum height of a row while all fit, and its height if they do not."""


def columns(width: int, bar: int) -> list[QtCore.QRect]:
    """
    Return where each column and then each command is, in a row of a width (pixels).

    :param bar: width of a scroll bar beside it.
    """
    gap, margin = look.px(GAP), look.px(10)
    fixed = [look.px(column.width) for column in COLUMNS]
    buttons = [look.px(BUTTONS / len(KART_COMMANDS)) for _ in KART_COMMANDS]
    used = sum(fixed) + sum(buttons) + gap * (len(fixed) + len(buttons) - 1)
    left = margin
    found = []
    for wide in (*fixed, *buttons):
        wide = wide or max(0, width - bar - 2 * margin - used)
        found.append(QtCore.QRect(left, 0, wide, 0))
        left += wide + gap
    return found


class KartRow(Painted):
    """A kart, with its commands beside it."""

    chosen = Signal(int)

    def __init__(self, pressed: Pressed) -> None:
        super().__init__()
        self.number = 0
        self._row: Row | None = None
        self._chosen = self._stale = False
        self._buttons = [CommandButton(pressed) for _ in KART_COMMANDS]
        for button in self._buttons:
            button.setParent(self)

    @property
    def whole(self) -> str:
        """Return all that it says."""
        cells = [each for column in COLUMNS for each in (column.cell, column.below)]
        row = self._row
        return '\n'.join(text for each in cells if row and (text := each(row).text))

    def show_row(self, row: Row, chosen: bool, stale: bool) -> None:
        """Show a kart."""
        if row.number != self.number:
            self.number = row.number
            self.setObjectName(f'kart_{row.number}')
        self._row, self._chosen, self._stale = row, chosen, stale
        self.setProperty('chosen', 'true' if chosen else 'false')
        self.setProperty('linked', 'true' if row.connected else 'false')
        self.show_it(row, chosen, stale)
        for widget, button in zip(self._buttons, row.buttons, strict=True):
            widget.show_button(button)

    def resizeEvent(self, event: QtGui.QResizeEvent) -> None:  # noqa: N802 - Qt's name
        """Put the commands where they belong."""
        super().resizeEvent(event)
        margin = look.px(3 if self.height() < look.px(40) else 8)
        first = len(COLUMNS)
        rooms = columns(self.width(), 0)[first:]
        for button, room in zip(self._buttons, rooms, strict=True):
            high = min(self.height() - 2 * margin, look.px(34))
            top = (self.height() - high) // 2
            button.setGeometry(room.left(), top, room.width(), high)

    def paint(self, pen: Pen) -> None:
        """Draw it."""
        row, colours = self._row, look.palette
        if row is None:
            return
        urgent = row.use_msr
        if self._chosen:
            pen.box(self.rect(), colours.raised, radius=0)
        edge = FILLS[Tone.BAD][1] if urgent else colours.chosen if self._chosen else ''
        if edge:
            pen.box(QtCore.QRect(0, 0, look.px(5), self.height()), edge, radius=0)
        line = self.rect().adjusted(0, self.height() - 1, 0, 0)
        pen.box(line, colours.line, radius=0)
        number, team, sent, answer, link, place = self._rooms()
        strong = row.in_race and not self._stale
        self._paint_number(pen, number, row, strong)
        tone = Tone.FAINT if self._stale else row.note.tone
        metrics = QtGui.QFontMetrics(font(look.px(SMALL), tone is Tone.BAD))
        long = urgent or metrics.horizontalAdvance(row.note.text) > team.width()
        upper, lower = _halves(team, bool(row.note.text), long)
        ink = colours.ink if strong else colours.faint
        pen.text(upper, row.team, ink, TEXT + 1, True, wrap=upper.height() > look.px(30))
        if urgent:
            pen.box(lower, FILLS[Tone.BAD][1], radius=3)
            lower = lower.adjusted(look.px(4), 0, -look.px(2), 0)
        note = FILLS[Tone.BAD][0] if urgent else look.text(tone)
        pen.text(lower, row.note.text, note, SMALL, tone is Tone.BAD, wrap=True)
        self._paint_sent(pen, sent, row)
        self._paint_cell(pen, answer, row.answer, row.says)
        self._paint_link(pen, link, row)
        upper, lower = _halves(place, bool(row.gap))
        pen.text(upper, row.place, ink, LARGE - 2, True, CENTER)
        pen.text(lower, row.gap, ink, SMALL, align=CENTER)

    def _rooms(self) -> list[QtCore.QRect]:
        rooms = columns(self.width(), 0)[: len(COLUMNS)]
        return [QtCore.QRect(each.left(), 0, each.width(), self.height() - 1) for each in rooms]

    def _paint_number(self, pen: Pen, room: QtCore.QRect, row: Row, strong: bool) -> None:
        colours = look.palette
        plate = _centred(room, min(room.height() - look.px(4), look.px(32)))
        pen.box(plate, colours.ink if strong else '', '' if strong else colours.faint, 1.5)
        ink = colours.card if strong else colours.faint
        room = plate.adjusted(look.px(3), 0, -look.px(3), 0)
        pen.text(room, str(row.number), ink, LARGE - 2, True, CENTER)

    def _paint_sent(self, pen: Pen, room: QtCore.QRect, row: Row) -> None:
        colours = look.palette
        chip = _centred(room, min(room.height() - look.px(4), look.px(30)))
        tone = row.sent.tone
        known = not self._stale and tone is not Tone.FAINT
        ink, fill = look.fill(tone) if known else (colours.faint, colours.raised)
        pen.box(chip, fill, '' if known else colours.line)
        if row.waits and known:
            pen.stripes(chip)
        inside = chip.adjusted(look.px(GAP), 0, -look.px(GAP), 0)
        wide = look.px(44 if len(row.since) > len('00:00') else 36)
        pen.text(inside.adjusted(0, 0, -wide - look.px(4), 0), row.sent.text, ink, TEXT, True)
        pen.text(
            inside.adjusted(inside.width() - wide, 0, 0, 0), row.since, ink, SMALL, align=RIGHT
        )

    def _paint_cell(
        self, pen: Pen, room: QtCore.QRect, cell: Cell, below: str, ink: str = ''
    ) -> None:
        """Draw a text in its tone, and a small one below it, or in its place."""
        upper, lower = _halves(room, bool(cell.text and below))
        tone = Tone.FAINT if self._stale else cell.tone
        bold = tone in (Tone.GOOD, Tone.WAIT, Tone.BAD)
        pen.text(upper, cell.text, ink or look.text(tone), TEXT, bold)
        pen.text(lower if cell.text else room, below, ink or look.palette.faint, SMALL)

    def _paint_link(self, pen: Pen, room: QtCore.QRect, row: Row) -> None:
        """Draw how good its link is: bars, a word and a time; a poor one on a ground."""
        ink = ''
        if row.link.tone is Tone.WAIT and not self._stale:
            ink, fill = look.fill(Tone.WAIT)
            pen.box(_centred(room, min(room.height() - look.px(4), look.px(38))), fill, radius=3)
        if row.bars:
            high, wide, gap = min(room.height() - look.px(10), look.px(18)), look.px(4), look.px(2)
            foot = room.top() + (room.height() + high) // 2
            colour = ink or look.text(Tone.FAINT if self._stale else Tone.PLAIN)
            left = room.left() + look.px(4)
            for bar in range(1, MOST_BARS + 1):
                tall = high * bar // MOST_BARS
                shade = colour if bar <= row.bars else f'#30{colour[1:]}'
                pen.box(QtCore.QRect(left, foot - tall, wide, tall), shade, radius=1)
                left += wide + gap
            room = room.adjusted(left + look.px(3) - room.left(), 0, -look.px(2), 0)
        self._paint_cell(pen, room, row.link, row.link_time, ink)

    def mousePressEvent(self, event: QtGui.QMouseEvent) -> None:  # noqa: N802 - Qt's name
        """Choose this kart."""
        self.chosen.emit(self.number)
        super().mousePressEvent(event)


def _centred(room: QtCore.QRect, height: int) -> QtCore.QRect:
    return QtCore.QRect(
        room.left(), room.top() + (room.height() - height) // 2, room.width(), height
    )


def _halves(
    room: QtCore.QRect, both: bool, long: bool = False
) -> tuple[QtCore.QRect, QtCore.QRect]:
    """
    Return the room of a text and of a small one below it; all for the first if it is alone.

    :param long: the small one gets as much room as there is.
    """
    if not both:
        return room, QtCore.QRect()
    margin = max(0, (room.height() - look.px(56 if long else 38)) // 2)
    inner = room.adjusted(0, margin, 0, -margin)
    high = min(inner.height() * 11 // 20, look.px(21))
    return (
        QtCore.QRect(inner.left(), inner.top(), inner.width(), high),
        QtCore.QRect(inner.left(), inner.top() + high, inner.width(), inner.height() - high),
    )


class Heading(Painted):
    """What stands above the columns of the karts."""

    bar = 0

    def paint(self, pen: Pen) -> None:
        """Draw it."""
        names = [column.heading for column in COLUMNS]
        rooms = columns(self.width(), self.bar)
        rooms = [*rooms[: len(names)], rooms[len(names)].united(rooms[-1])]
        for room, name in zip(rooms, [*names, texts.COMMANDS_HEADING], strict=True):
            room = QtCore.QRect(room.left(), 0, room.width(), self.height())
            pen.text(room, name, look.palette.faint, SMALL, align=LEFT)
        pen.box(self.rect().adjusted(0, self.height() - 1, 0, 0), look.palette.line, radius=0)


class Tiles(Painted):
    """Every kart as a tile, for when there are more than fit: number, state, and what is amiss."""

    chosen = Signal(int)

    def __init__(self) -> None:
        super().__init__('overview')
        self._rows: tuple[Row, ...] = ()
        self._chosen = 0
        self._stale = False

    def show_rows(self, rows: tuple[Row, ...], chosen: int, stale: bool) -> None:
        """Show the karts."""
        self._rows, self._chosen, self._stale = rows, chosen, stale
        self.show_it([(row.number, row.sent, row.answer, row.link) for row in rows], chosen, stale)

    def mousePressEvent(self, event: QtGui.QMouseEvent) -> None:  # noqa: N802 - Qt's name
        """Choose the kart that was clicked."""
        if self._rows:
            place = int(event.position().x() / (self.width() / len(self._rows)))
            self.chosen.emit(self._rows[min(place, len(self._rows) - 1)].number)

    def paint(self, pen: Pen) -> None:
        """Draw the tiles: the number above, the state's symbol and a mark below."""
        wide = self.width() / max(1, len(self._rows))
        for place, row in enumerate(self._rows):
            left = round(place * wide)
            room = QtCore.QRect(left, 1, round((place + 1) * wide) - left - 2, self.height() - 3)
            tone = row.link.tone if row.link.tone is Tone.BAD else row.sent.tone
            ink, fill = look.fill(Tone.PLAIN if self._stale else tone)
            is_chosen = row.number == self._chosen
            frame = look.palette.chosen if is_chosen else look.palette.line
            pen.box(room, fill, frame, 3 if is_chosen else 1, 3)
            marks = row.sent.text[:1]
            if row.link.tone is Tone.BAD:
                marks += texts.MARK_LOST
            elif row.answer.tone is Tone.GOOD:
                marks += texts.MARK_YES
            elif row.answer.tone is Tone.WAIT:
                marks += texts.MARK_WAIT
            middle = room.top() + room.height() // 2
            upper, lower = room.adjusted(1, 1, -1, 0), room.adjusted(1, 0, -1, -1)
            upper.setBottom(middle)
            lower.setTop(middle)
            pen.text(upper, str(row.number), ink, SMALL, True, CENTER, 7)
            pen.text(lower, marks, ink, SMALL, False, CENTER, 7)


class Rows(QtWidgets.QScrollArea):
    """
    What the rows are scrolled in.

    :param scrolling: is entered around every scrolling that the official's hand does not do.
    """

    def __init__(self, scrolling: Scrolling) -> None:
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
        super().__init__()
        self._pressed = pressed
        self.rows: list[KartRow] = []
        self._tiles = Tiles()
        self._tiles.chosen.connect(self.wanted)
        self._tiles.hide()
        self._heading = Heading()
        self._inside = QtWidgets.QWidget()
        self._inside.setObjectName('rows')
        self.scroll = Rows(scrolling)
        self.scroll.setObjectName('karts')
        self.scroll.setWidget(self._inside)
        self.scroll.setFrameShape(QtWidgets.QFrame.Shape.NoFrame)
        self.scroll.setFocusPolicy(QtCore.Qt.FocusPolicy.NoFocus)
        self.scroll.setHorizontalScrollBarPolicy(QtCore.Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        for part in (self._tiles, self._heading, self.scroll):
            part.setParent(self)

    @property
    def numbers(self) -> list[int]:
        """Return the numbers of the karts, in their order."""
        return [row.number for row in self.rows]

    @property
    def stops_begin(self) -> int:
        """Return from where on the stops of the karts are, in pixels from the left."""
        return columns(self.width(), self._bar)[len(COLUMNS)].left()

    @property
    def _all_fit(self) -> bool:
        return len(self.rows) * look.px(LOWEST) <= self.height() - look.px(HEADING)

    @property
    def _bar(self) -> int:
        return 0 if self._all_fit else look.px(BAR)

    def show_rows(self, rows: tuple[Row, ...], chosen: int, stale: bool) -> None:
        """Show the karts."""
        if len(rows) != len(self.rows):
            self._have(len(rows))
        for widget, row in zip(self.rows, rows, strict=True):
            widget.show_row(row, row.number == chosen, stale)
        self._tiles.show_rows(rows, chosen, stale)

    def bring_into_view(self, number: int) -> None:
        """Scroll to a kart."""
        for row in self.rows:
            if row.number == number:
                self.scroll.bring_into_view(row)

    def resizeEvent(self, event: QtGui.QResizeEvent) -> None:  # noqa: N802 - Qt's name
        """Have the rows use the room."""
        super().resizeEvent(event)
        self.fit()

    def _have(self, count: int) -> None:
        for row in self.rows[count:]:
            row.hide()
            row.deleteLater()
        del self.rows[count:]
        for _ in range(len(self.rows), count):
            row = KartRow(self._pressed)
            row.setParent(self._inside)
            row.chosen.connect(self.chosen)
            row.show()
            self.rows.append(row)
        self.fit()

    def fit(self) -> None:
        """Take the size of the window: rows as high as there is room for, or tiles and a bar."""
        heading, count = look.px(HEADING), len(self.rows)
        top = 0 if self._all_fit else look.px(TILES)
        self._tiles.setVisible(not self._all_fit)
        self._tiles.setGeometry(0, 0, self.width(), top)
        self._heading.bar = self._bar
        self._heading.setGeometry(0, top, self.width(), heading)
        self._heading.update()
        room = self.height() - top - heading
        self.scroll.setGeometry(0, top + heading, self.width(), room)
        policy = QtCore.Qt.ScrollBarPolicy
        self.scroll.setVerticalScrollBarPolicy(
            policy.ScrollBarAlwaysOff if self._all_fit else policy.ScrollBarAlwaysOn
        )
        height = look.px(SCROLLED)
        if self._all_fit:
            height = min(look.px(HIGHEST), room // max(1, count))
        width = self.width() - self._bar
        self._inside.resize(width, height * count)
        for place, row in enumerate(self.rows):
            row.setGeometry(0, place * height, width, height)


def chooses(widget: QtWidgets.QWidget | None) -> bool:
    """Return whether a press there only chooses a kart: a stop for it may be next."""
    while widget is not None and not isinstance(widget, QtWidgets.QAbstractButton):
        if isinstance(widget, (KartRow, Tiles)):
            return True
        widget = widget.parentWidget()
    return False
