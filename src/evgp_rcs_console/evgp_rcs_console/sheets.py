# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The sheets that open over the karts: the question, the heats, the officials, and the keys.

The sheets end to the left of the karts' stop buttons, so they never cover a stop.
"""

from __future__ import annotations

from collections.abc import Sequence
import functools
import itertools
import time

from evgp_node.qt import QtCore, QtWidgets
from evgp_protocol import clock
from evgp_rcs.words import Cell, time_of_day, Tone
from evgp_rcs_console import texts
from evgp_rcs_console.catalogue import CATALOGUE
from evgp_rcs_console.freshness import SEEN
from evgp_rcs_console.keys import key_help
from evgp_rcs_console.questions import also, Asked
from evgp_rcs_console.view import Button, Screen
from evgp_rcs_console.widgets import (
    CommandButton,
    fixed,
    lay,
    mark,
    Panel,
    Push,
    rescale,
    Text,
    TOP,
)


class Sheet(Panel):
    """
    A sheet over the karts.

    A sheet is a part of the window, not a dialog, so everything beside the sheet still works.
    """

    def __init__(self, parent: QtWidgets.QWidget, name: str, title: str = '') -> None:
        super().__init__(name, 'sheet')
        self.setParent(parent)
        self.hide()
        self._column = QtWidgets.QVBoxLayout(self)
        self._column.setProperty('design', [10, 18, 14, 18, 16])
        self.title = Text(f'{name}_title', 'large bold', text=title)
        self.add(self.title, 36)

    def add(self, part: QtWidgets.QWidget, height: int = 0) -> None:
        """Add a part at the bottom, with a height in pixels; 0 makes it as high as its text."""
        fixed(part, height=height)
        self._column.addWidget(part)

    def lay_out(self, room: QtCore.QRect) -> None:
        """Place the sheet at the top of a room, in smaller type if it is too high otherwise."""
        rescale(self)
        for kind in ('sheet', 'sheet tight'):
            mark(self, kind=kind)
            self._column.activate()
            high = self.heightForWidth(room.width())
            if high < 0:  # the height of the sheet does not depend on its width
                high = self._column.totalSizeHint().height()
            if high <= room.height():
                break
        self.setGeometry(room.left(), room.top(), room.width(), min(high, room.height()))
        self.raise_()

    def closing(self, text: str) -> Push:
        button = Push(f'close_{self.objectName()}', text, 'Esc')
        button.clicked.connect(self.close_sheet)
        return button

    def close_sheet(self) -> None:
        """Hide the sheet, and move the focus to the window, where Enter has no effect."""
        if not self.isHidden():
            self.hide()
            self.window().setFocus()


class Question(Sheet):
    """Asks the official to confirm a command, for example one that loosens the race."""

    def __init__(self, parent: QtWidgets.QWidget) -> None:
        super().__init__(parent, 'question')
        self.button: Button | None = None
        self.shown_at = 0.0
        self._texts = (
            Text('question_consequence', '', TOP, wrap=True, flows=True),
            Text('question_warning', 'bold', wrap=True, fills=True, flows=True),
            Text('question_caution', 'bold', wrap=True, fills=True, flows=True),
            Text('question_statement', 'bold', TOP, wrap=True, flows=True),
        )
        self.yes, self.no = Push('yes', tall=True), Push('no', 'NO', 'N')
        self.also = Push('yes_and_more', tall=True)
        self.no.clicked.connect(lambda: self.window().presses.answer(False))
        self.yes.clicked.connect(lambda: self.window().presses.answer(True))
        self.also.clicked.connect(lambda: self.window().presses.answer(True, also=True))
        for text in self._texts:
            self.add(text)
        answers = QtWidgets.QWidget()
        lay(answers, (self.no, self.also, self.yes), gap=10, columns=(2, 3, 3))
        self.add(answers, 74)

    def lay_out(self, room: QtCore.QRect) -> None:
        """
        Place the question at the bottom of a room, so that the first karts stay in sight.

        YES and NO are at its bottom, so they do not move when its height changes.
        """
        super().lay_out(room)
        self.move(room.left(), room.bottom() + 1 - self.height())

    def ask(self, button: Button) -> None:
        """Fill the question with a command, without showing the sheet."""
        self.button = button
        self.shown_at = clock.now()
        for yes in (self.yes, self.also):
            yes.setDown(False)  # the button may still be held down from an earlier question
            yes.setEnabled(True)
        self.title.show_text(f'{button.name}?')
        condition = button.question.condition
        self._ask(button.question)
        self.yes.show_words('YES', 'Y', condition[:1].upper() + condition[1:])
        self.also.setVisible(bool(button.also))
        if button.also:
            key = CATALOGUE[button.also[0].command].key
            self.also.show_words('YES, and also', key, also(button.also))
        self.look()

    def show_screen(self, screen: Screen) -> None:
        """
        Compare an open question with the command that race control offers now.

        Once the two differ, the question shows only that, and YES stays disabled, even if the
        difference goes away. A question about a stop is brought up to date instead.
        """
        asked = self.button
        if asked is None or not self.isVisible():
            return
        button = screen.button(asked.command, asked.kart)
        if asked.is_stop:
            if button is not None:
                self._ask(button.question)
        elif self.yes.isEnabled() and (
            button is None or button.reason or not button.asks_the_same(asked)
        ):
            if button is None:
                what = 'The command is no longer offered.'
            elif button.reason:
                what = f'{button.reason[:1].upper()}{button.reason[1:]}.'
            else:
                what = button.question.differs_from(asked.question)
            at = time_of_day(time.time())
            self._show('', f'Changed at {at}: {what} Press NO and start again.')
            for yes in (self.yes, self.also):
                yes.setEnabled(False)
            self.window().place_sheets()

    def _ask(self, asked: Asked) -> None:
        warning = asked.warning and texts.ASK_WARNING.format(warning=asked.warning)
        statement = texts.ASK_STATE.format(condition=asked.condition)
        self._show('\n'.join(asked.consequences), warning, asked.caution, statement)

    def _show(self, does: str, warning: str, caution: str = '', statement: str = '') -> None:
        said = Cell(does), Cell(warning, Tone.BAD), Cell(caution, Tone.WAIT), Cell(statement)
        for text, cell in zip(self._texts, said, strict=True):
            text.show_cell(cell)

    def settled(self, at: float) -> bool:
        """Return whether a click on YES at a time (s) counts; a double click's second does not."""
        return at - self.shown_at >= SEEN

    def look(self) -> None:
        """Show whether a click on YES counts by now."""
        for yes in (self.yes, self.also):
            yes.bar(not yes.isEnabled() or not self.settled(clock.now()))


class Choice(Sheet):
    """A sheet that describes a choice in a sentence, and has a button for each option."""

    def __init__(self, parent: QtWidgets.QWidget, name: str, title: str, about: str) -> None:
        super().__init__(parent, name, title)
        self._offered: list[Push] = []
        self._close = self.closing('CANCEL')
        self.add(Text('', wrap=True, flows=True, text=about))
        self.add(self._close, 36)

    def _offer(self, buttons: Sequence[Push]) -> None:
        for each in self._offered:
            each.deleteLater()
        self._offered = [*buttons]
        for each in buttons:
            self.add(each, 34)
            each.show()
        self._column.addWidget(self._close)
        self.window().place_sheets()

    @property
    def first(self) -> QtWidgets.QWidget:
        """Return the first option's button, or the closing button if there are no options."""
        return self._offered[0] if self._offered else self._close


class Heats(Choice):
    """Lists the heats in the roster, with the buttons that read the roster again."""

    def __init__(self, parent: QtWidgets.QWidget) -> None:
        about = (
            "Adds the heat's karts to the race and removes all others. "
            'Enter takes the marked heat; to mark another, type its number first.'
        )
        super().__init__(parent, 'heats', 'Which heat?', about)

    @property
    def first(self) -> QtWidgets.QWidget:
        """Return the button of the next heat; if none is next, of the one in the race, or any."""
        wanted = self.window().seen.screen.next_heat or self.window().seen.screen.snapshot.heat
        found = (each for each in self._offered if wanted and each.button.gives.heat == wanted)
        return next(found, super().first)

    def show_screen(self, screen: Screen) -> None:
        """Show the buttons. All except the one that reads the roster close the sheet."""
        heats, buttons = screen.heats, (*screen.heats, *screen.rosters)
        if len(buttons) != len(self._offered):
            offered = [CommandButton() for _ in buttons]
            for number, each in enumerate(offered):
                if number != len(heats):  # the button that reads the roster keeps it open
                    each.clicked.connect(self.close_sheet)
            self._offer(offered)
        for number, (widget, button) in enumerate(zip(self._offered, buttons, strict=True), 1):
            assert isinstance(widget, CommandButton)
            widget.show_button(button)
            if number <= len(heats):
                widget.setObjectName(f'heat_{number}')

    def focus_on(self, number: str) -> None:
        """Focus the heat with a number, so that Enter presses it, or CANCEL if there is none."""
        if self.isVisible():
            heat = self.findChild(CommandButton, f'heat_{number}')
            (self._close if heat is None else heat).setFocus()


class Officials(Choice):
    """Lists the event's officials, for a click on the one who commands from this window."""

    def __init__(self, parent: QtWidgets.QWidget) -> None:
        about = (
            'Your name is sent with every command from this window and written to the record. If '
            'it is not listed, start with make console OFFICIAL="Anna Meier". The list is set in '
            'rcs.yaml.'
        )
        super().__init__(parent, 'officials', 'Who commands from here?', about)

    def show_screen(self, screen: Screen) -> None:
        names = screen.snapshot.officials
        if [each.words for each in self._offered] == [*names]:
            return
        self._offer([Push(f'official_{place}', name) for place, name in enumerate(names, 1)])
        for each in self._offered:
            each.clicked.connect(functools.partial(self.window().presses.sign, each.words))


class Help(Sheet):
    """Lists the keys and their effects."""

    def __init__(self, parent: QtWidgets.QWidget) -> None:
        super().__init__(parent, 'help', 'Keys')
        table, keys = QtWidgets.QWidget(), key_help()
        half = (len(keys) + 1) // 2
        parts = [
            [Text('', 'bold small', text=key), Text('', 'small', wrap=True, text=meaning)]
            for key, meaning in keys
        ]
        rows = [[*itertools.chain(*parts[row::half])] for row in range(half)]
        lay(table, *rows, gap=4, columns=(3, 4, 3, 4), heights=[1] * half)
        self.add(table, 320)
        self.add(self.closing('CLOSE'), 36)
