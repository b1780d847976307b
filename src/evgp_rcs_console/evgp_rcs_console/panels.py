# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The areas of the window around the karts: the race now, the commands to it, the events."""

from __future__ import annotations

import time

from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import StampedEvent
from evgp_rcs.words import Cell, Tone
from evgp_rcs_console import texts
from evgp_rcs_console.catalogue import CATALOGUE
from evgp_rcs_console.notices import concerns, EventLog, Line
from evgp_rcs_console.qt import QtCore, QtGui, QtWidgets, Signal
from evgp_rcs_console.style import BLACK, FILLS, GAP, HUGE, LARGE, look, SMALL, TEXT, WHITE, YELLOW
from evgp_rcs_console.view import Danger, Row, Screen
from evgp_rcs_console.widgets import (
    Area,
    Card,
    CENTER,
    CommandButton,
    font,
    LEFT,
    Painted,
    Pen,
    Pressed,
    Push,
    RIGHT,
    StepButton,
    Text,
)

EVENTS = 500
"""Maximum number of events in the window: to draw more again takes it too long."""

TOP, STEPS = 78, 60
"""Heights of the state of the race, and of the commands to it."""


class StatePanel(Painted):
    """The state of the race in its colour: since when, and by whom."""

    def __init__(self) -> None:
        super().__init__('state_panel')
        self._tone = Tone.PLAIN
        title = Text('state', HUGE, True, colour=self._ink)
        since = Text('state_since', TEXT, wrap=True, colour=self._ink)
        self._title = self.put(title, 14, 4, -10, 46)
        self._since = self.put(since, 14, 46, -10, -5)

    def _ink(self) -> str:
        return look.fill(self._tone)[0]

    def show_screen(self, screen: Screen, stale: bool) -> None:
        """Show the race as it is now."""
        self._tone = Tone.FAINT if stale else screen.state.tone
        self._title.show_cell(screen.state, stale)
        self._since.show_text(screen.since)
        self.show_it(self._tone)

    def paint(self, pen: Pen) -> None:
        """Draw its ground."""
        pen.box(self.rect(), look.fill(self._tone)[1])


class TrackPanel(Painted):
    """Whether humans may be on the track, and the command that opens or closes it."""

    def __init__(self, pressed: Pressed) -> None:
        super().__init__('track_panel')
        self._humans = self.put(Text('humans', LARGE, True), 20, 7, -176, 35)
        self._reason = self.put(Text('humans_reason', TEXT, wrap=True), 20, 35, -176, -7)
        self.button = self.put(StepButton(pressed), -168, 7, -12, -7)

    def show_screen(self, screen: Screen, stale: bool) -> None:
        """Show the track as it is now."""
        self._humans.show_cell(screen.humans, stale)
        self._reason.show_text(screen.humans_reason[:1].upper() + screen.humans_reason[1:])
        if screen.track_button is not None:
            self.button.show_button(screen.track_button)
        self.show_it(screen.humans.tone, stale)

    def paint(self, pen: Pen) -> None:
        """Draw its ground, and an edge: green if humans are allowed, red if something is wrong."""
        pen.box(self.rect(), look.palette.card, look.palette.line)
        tone = self._humans.cell.tone
        edge = look.palette.good if tone is Tone.GOOD else look.palette.line
        edge = look.fill(tone)[1] if tone in (Tone.BAD, Tone.WAIT) else edge
        if self._humans.property('tone') == 'stale':
            edge = look.palette.faint
        pen.box(QtCore.QRect(0, 0, look.px(8), self.height()), edge, radius=4)


class ClockPanel(Painted):
    """The time of day, the time since GREEN GREEN, and what is in the race."""

    def __init__(self) -> None:
        super().__init__('clock')
        self._now = self.put(Text('', LARGE + 4, True, RIGHT), 0, 4, -4, 38)
        self._race = self.put(Text('', TEXT, True, RIGHT), 0, 38, -4, 58)
        self._heat = self.put(Text('', TEXT, False, RIGHT), 0, 58, -4, -3)

    def show_screen(self, screen: Screen, stale: bool) -> None:
        """Take the race as it is now; a race that is not heard has no clock."""
        age = screen.clock * (not stale)
        self._race.show_text(texts.RACE_CLOCK.format(age=age) if age else '')
        self._heat.show_cell(Cell(screen.heat, Tone.FAINT))
        self.look()

    def look(self) -> None:
        """Show what time it is."""
        self._now.show_text(time.strftime('%H:%M:%S'))


class KillButton(Push):
    """ALL KILL."""

    pressing = False

    def paintEvent(self, event: QtGui.QPaintEvent) -> None:  # noqa: N802 - Qt's name
        """Draw it: like nothing else on the screen."""
        with Pen(self) as pen:
            pen.box(self.rect(), BLACK, radius=10)
            yellow = self.rect().adjusted(look.px(3), look.px(3), -look.px(3), -look.px(3))
            pen.box(yellow, YELLOW, radius=8)
            inner = yellow.adjusted(look.px(6), look.px(6), -look.px(6), -look.px(6))
            fill = BLACK if self.pressing else '#6E0012' if self.isDown() else FILLS[Tone.RED][1]
            pen.box(inner, fill, radius=4)
            room = inner.adjusted(look.px(8), look.px(14), -look.px(8), -look.px(42))
            pen.text(room, self.words, YELLOW if self.pressing else WHITE, HUGE + 4, True, CENTER)
        self.drawn = pen.drawn


class KillBox(Area):
    """ALL KILL, and in it its keys, or for how long it has had no answer."""

    def __init__(self) -> None:
        super().__init__()
        kill = KillButton('all_kill', CATALOGUE[CommandKind.ALL_KILL].label)
        self.button = self.put(kill, 0, 0, 0, 0)
        hint = Text('kill_hint', TEXT, True, CENTER, True, colour=self._colour)
        self._hint = self.put(hint, 16, -56, -16, -12)
        # It lies over the button, which gets every click.
        self._hint.setAttribute(QtCore.Qt.WidgetAttribute.WA_TransparentForMouseEvents)

    def _colour(self) -> str:
        return YELLOW if self._hint.cell.tone is Tone.BAD else WHITE

    def show_hint(self, hint: Cell, pressing: bool) -> None:
        """Show a text below ALL KILL, and whether ALL KILL has no answer yet."""
        self.button.setProperty('pressing', 'true' if pressing else 'false')
        if pressing != self.button.pressing:
            self.button.pressing = pressing
            self.button.update()
        self._hint.show_cell(hint)


class Steps(QtWidgets.QWidget):
    """The commands to the race from left to right, as a race goes."""

    def __init__(self, pressed: Pressed) -> None:
        super().__init__()
        self._steps = [StepButton(pressed) for _ in range(6)]
        for step in self._steps:
            step.setParent(self)

    def resizeEvent(self, event: QtGui.QResizeEvent) -> None:  # noqa: N802 - Qt's name
        """Share the room."""
        gap = look.px(GAP)
        wide = (self.width() - gap * (len(self._steps) - 1)) // len(self._steps)
        for place, step in enumerate(self._steps):
            step.setGeometry(place * (wide + gap), 0, wide, self.height())

    def show_screen(self, screen: Screen) -> None:
        """Show which commands are possible, and why the others are not."""
        buttons = (*screen.race, *screen.all_karts)
        for step, button in zip(self._steps, buttons, strict=True):
            step.show_button(button)


class Strip(Painted):
    """What is true of the race in a line: which karts do what, who is missing, who commands."""

    def __init__(self, pressed: Pressed) -> None:
        super().__init__('strip')
        self._texts = ('', '', '', '')
        self._msr = Cell('')
        self._stale = False
        self.heat = self.put(CommandButton(pressed), -136, 0, 0, 0)
        self.heat.quiet = True
        self.heat.hide()

    def show_screen(self, screen: Screen, officials: list[str], stale: bool) -> None:
        """Show the race as it is now, and who has commanded it."""
        by = texts.COMMANDED_BY.format(names=', '.join(officials)) * bool(officials)
        by = ' · '.join(filter(None, (screen.can_stop.partition(':')[0], by)))
        rest = ' · '.join(
            filter(None, (screen.missing, screen.timing, screen.order, screen.places))
        )
        self._texts = screen.tally or texts.NOBODY_RACES, screen.reminder, rest, by
        self._stale, self._msr = stale, screen.msr
        # There are heats or there are none, as long as the roster is the same.
        self.heat.setVisible(screen.heat_button is not None)
        if screen.heat_button is not None:
            self.heat.show_button(screen.heat_button)
        self.show_it(self._texts, self._msr, stale)

    def paint(self, pen: Pen) -> None:
        """Draw it."""
        pen.box(self.rect(), look.palette.card, look.palette.line)
        room = self.rect().adjusted(look.px(12), 0, -look.px(12), 0)
        if not self.heat.isHidden():
            room.setRight(self.heat.geometry().left() - look.px(GAP))
        tally, reminder, rest, officials = self._texts
        strong = look.palette.faint if self._stale else look.palette.ink
        first, last = QtCore.QRect(room), QtCore.QRect(room)
        first.setWidth(min(room.width() // 2, _advance(tally, True) + look.px(4)))
        last.setLeft(room.right() - min(room.width() // 4, _advance(officials) + look.px(4)))
        room.setLeft(first.right() + look.px(14))
        room.setRight(last.left() - look.px(14))
        pen.text(first, tally, strong, TEXT, True)
        for text, tone in (self._msr, Cell(reminder, Tone.WAIT)):
            if not text:
                continue
            shown = room.adjusted(0, look.px(3), 0, -look.px(3))
            size = TEXT + 4 if tone is Tone.BAD else TEXT
            shown.setWidth(min(room.width(), _advance(text, True, size) + 2 * look.px(GAP)))
            ink, fill = look.fill(tone)
            pen.box(shown, fill, radius=3)
            inside = shown.adjusted(look.px(GAP), 0, -look.px(GAP), 0)
            pen.text(inside, text, ink, size, True)
            room.setLeft(shown.right() + look.px(14))
        if rest:
            pen.text(room, rest, strong, TEXT)
        pen.text(last, officials, look.palette.faint, TEXT, align=RIGHT)


def _advance(text: str, bold: bool = False, size: int = TEXT) -> int:
    return QtGui.QFontMetrics(font(look.px(size), bold)).horizontalAdvance(text)


class DangerPanel(Painted):
    """Race control is gone, or must not be relied on: in the largest type."""

    def __init__(self) -> None:
        super().__init__('danger')
        white, yellow = (lambda: WHITE), (lambda: YELLOW)
        self._title = self.put(
            Text('danger_title', LARGE + 2, True, colour=white), 14, 5, -372, 31
        )
        detail = Text('danger_detail', TEXT, wrap=True, colour=white)
        self._detail = self.put(detail, 14, 31, -372, -5)
        advice = Text('danger_advice', HUGE + 8, True, CENTER, True, colour=yellow)
        self._advice = self.put(advice, -360, 5, -10, -5)

    def show_danger(self, danger: Danger) -> None:
        """Say it."""
        self._title.show_text(danger.title)
        self._advice.show_text(danger.advice)
        self._detail.show_text(danger.detail)

    def paint(self, pen: Pen) -> None:
        """Draw its ground."""
        pen.box(self.rect(), '#000000', FILLS[Tone.BAD][1], 4)


class NumberField(Painted):
    """The kart that a command by key acts on; or that no key acts at all."""

    def __init__(self) -> None:
        super().__init__('number_field')
        self._off = False
        title = Text('number', LARGE + 6, True, colour=self._colour)
        self._title = self.put(title, 12, 4, 150, -4)
        self._detail = self.put(
            Text('number_detail', wrap=True, colour=self._colour), 12, 4, -8, -4
        )

    def _colour(self) -> str:
        if self._off:
            return YELLOW
        return WHITE if self._title.cell.tone is Tone.BAD else look.text(self._title.cell.tone)

    def show_cells(self, title: Cell, detail: Cell, keys_work: bool) -> None:
        """Show a kart's number and team, or why there is none; or that the keys do not work."""
        self._off = not keys_work
        if self._off:
            title = Cell(texts.KEYS_OFF_LARGE, Tone.BAD)
            detail = Cell(texts.KEYS_OFF_DETAIL, Tone.BAD)
        self._title.show_cell(title)
        self._detail.show_cell(detail)
        edge = 150 if title.text else 12
        self.put(self._title, 12, 4, edge, -4)
        self.put(self._detail, edge + 4 * bool(title.text), 4, -8, -4)
        self.show_it(self._off, title, detail, look.palette)

    def paint(self, pen: Pen) -> None:
        """Draw its ground."""
        if self._off:
            pen.box(self.rect(), '#000000', YELLOW, 4)
        elif self._title.cell.tone is Tone.BAD:
            pen.box(self.rect(), FILLS[Tone.BAD][1])
        elif self._title.cell.text:
            pen.box(self.rect(), look.palette.card, look.palette.chosen, 3)
        else:
            pen.box(self.rect(), look.palette.card, look.palette.line)


class EventPanel(Card):
    """What happened, of all karts or of one: commands in bold, with who gave them."""

    toggled = Signal()
    """The official wants the events of one kart only, or of all again."""

    def __init__(self) -> None:
        super().__init__('events')
        self.log = EventLog()
        self._kart = 0
        self._teams: dict[int, str] = {}
        self._view = self.put(QtWidgets.QTextEdit(), 8, 32, -2, -6)
        self._view.setObjectName('log')
        self._view.setReadOnly(True)
        self._view.setFrameShape(QtWidgets.QFrame.Shape.NoFrame)
        # No text can be selected, and so none dragged: a drag takes every key and click.
        self._view.setTextInteractionFlags(QtCore.Qt.TextInteractionFlag.NoTextInteraction)
        self._view.setFocusPolicy(QtCore.Qt.FocusPolicy.StrongFocus)
        self._view.setTabChangesFocus(True)
        # Lines are wrapped, as they are by default: a bar below them would hide the newest one.
        self._view.document().setMaximumBlockCount(EVENTS)
        # No list that opens: while one is open, it takes every key and click, also those of stops.
        self._filter = self.put(Push('filter'), -156, 4, -6, 28)
        self._filter.quiet = True
        self._filter.clicked.connect(self.toggled)
        title = Text('', SMALL, True, colour=lambda: look.palette.faint)
        self.put(title, 12, 4, 92, 28).show_text(texts.LOG)
        self._show_one(0)

    def restyle(self) -> None:
        """Take another size or palette."""
        self._view.setFont(font(look.px(SMALL)))
        self._view.document().setDocumentMargin(look.px(3))
        self._show_one(self._kart)

    def add(self, event: StampedEvent) -> None:
        """Take an event."""
        lines, replaces = self.log.add(event)
        if replaces and self._kart:
            self._show_one(self._kart)  # perhaps the line before was not one of this kart
            return
        if replaces:
            cursor = QtGui.QTextCursor(self._view.document())
            cursor.movePosition(QtGui.QTextCursor.MoveOperation.End)
            cursor.select(QtGui.QTextCursor.SelectionType.BlockUnderCursor)
            cursor.removeSelectedText()
        for line in lines:
            if concerns(line, self._kart):
                self._append(line)

    def _append(self, line: Line) -> None:
        bar = self._view.verticalScrollBar()
        at_end = bar.value() == bar.maximum()
        cursor = QtGui.QTextCursor(self._view.document())
        cursor.movePosition(QtGui.QTextCursor.MoveOperation.End)
        if not self._view.document().isEmpty():
            cursor.insertBlock()
        indent = look.px(56)
        block = QtGui.QTextBlockFormat()
        block.setLeftMargin(indent)
        block.setTextIndent(-indent)
        block.setTabPositions([QtGui.QTextOption.Tab(indent, QtGui.QTextOption.TabType.LeftTab)])
        cursor.setBlockFormat(block)
        ink = look.palette.ink if line.success else look.palette.bad
        parts = ((f'{line.clock}\t', look.palette.faint, False), (line.text, ink, line.is_command))
        for text, colour, bold in parts:
            style = QtGui.QTextCharFormat()
            style.setFont(font(look.px(SMALL), bold))
            style.setForeground(QtGui.QColor(colour))
            cursor.insertText(text, style)
        if at_end:
            bar.setValue(bar.maximum())

    def show_karts(self, rows: tuple[Row, ...]) -> None:
        """Take the karts of the roster; if the kart that is shown is gone, all are shown."""
        teams = {row.number: row.team for row in rows}
        if teams != self._teams:
            self._teams = teams
            self._show_one(self._kart)

    def toggle(self, kart: int) -> bool:
        """Show the events of one kart only, or of all again; return False without such a kart."""
        if not self._kart and kart not in self._teams:
            return False
        self._show_one(0 if self._kart else kart)
        return True

    def _show_one(self, kart: int) -> None:
        self._kart = kart if kart in self._teams else 0
        shown = texts.EVERY_KART
        if self._kart:
            shown = texts.ONE_KART.format(number=self._kart, team=self._teams[self._kart])
        self._filter.show_words(shown)
        self._view.clear()
        cursor = QtGui.QTextCursor(self._view.document())
        cursor.beginEditBlock()
        for line in self.log.lines(self._kart)[-EVENTS:]:
            self._append(line)
        cursor.endEditBlock()
        self._view.verticalScrollBar().setValue(self._view.verticalScrollBar().maximum())


class Foot(Area):
    """The bottom line, a low battery, and in whose name this window sends commands."""

    name_wanted = Signal()
    """The official wants to say who they are."""

    def __init__(self) -> None:
        super().__init__()
        status = Text('status', TEXT + 1, True, LEFT, True, fills=True)
        self.status = self.put(status, 0, 0, -280, 0)
        self._battery = self.put(Text('battery', TEXT, True, CENTER, fills=True), -530, 0, -280, 0)
        self._battery.hide()
        self._official = self.put(Push('official'), -272, 0, 0, 0)
        self._official.quiet = True
        self._official.clicked.connect(self.name_wanted)

    def show_battery(self, percent: int | None) -> None:
        """Show that the battery is low, in percent; None: it is not."""
        if percent is not None:
            self._battery.show_cell(Cell(texts.BATTERY.format(percent=percent), Tone.BAD))
        self._battery.setVisible(percent is not None)
        self.put(self.status, 0, 0, -280 if percent is None else -538, 0)

    def show_name(self, name: str) -> None:
        """Show the official's name; empty: it is not known."""
        text = texts.NAME_IS.format(name=name) if name else texts.NAME_UNKNOWN
        self._official.setProperty('tone', 'plain' if name else 'wait')
        self._official.show_words(text)
