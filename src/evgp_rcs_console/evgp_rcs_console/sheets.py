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

"""The panels that lie over the karts: a question, the heats, and the keys."""

from __future__ import annotations

from collections.abc import Sequence

from evgp_protocol import clock
from evgp_rcs.catalogue import CATALOGUE
from evgp_rcs.official import MOST_OF_NAME
from evgp_rcs_console import words
from evgp_rcs_console.freshness import SEEN
from evgp_rcs_console.qt import QtCore, QtWidgets, Signal
from evgp_rcs_console.view import Button, Cell, Tone
from evgp_rcs_console.widgets import (
    column,
    CommandButton,
    Fitted,
    Label,
    Pressed,
    set_property,
    set_text,
)


class Sheet(QtWidgets.QFrame):
    """
    A panel over the karts: a question, the heats, or the keys.

    It is not a window of its own, so it blocks nothing beside it.
    """

    def __init__(self, parent: QtWidgets.QWidget, name: str) -> None:
        """Be hidden."""
        super().__init__(parent)
        self.setObjectName(name)
        self.setProperty('sheet', 'true')
        self.hide()

    def buttons(self) -> list[QtWidgets.QPushButton]:
        """Return the buttons, in the order in which Tab goes through them."""
        return self.findChildren(QtWidgets.QPushButton)

    def fit_height(self, width: int) -> None:
        """Take a width, and the height that all texts need then."""
        layout = self.layout()
        assert layout is not None
        self.ensurePolished()
        frame = self.contentsMargins()
        inside = width - frame.left() - frame.right()
        layout.activate()
        height = max(layout.totalHeightForWidth(inside), layout.totalMinimumSize().height())
        self.setFixedSize(width, height + frame.top() + frame.bottom())

    def close_sheet(self) -> None:
        """Hide it."""
        self.hide()


class Question(Sheet):
    """Asks an official to confirm a command that loosens something, or the use of the MSR."""

    answered = Signal(bool)

    def __init__(self, parent: QtWidgets.QWidget) -> None:
        """Ask nothing yet."""
        super().__init__(parent, 'question')
        self.button: Button | None = None
        self.shown_at = 0.0
        self._spoilt = False
        self._problem_text = ''
        self._settling = QtCore.QTimer(self)
        self._settling.setSingleShot(True)
        self._settling.timeout.connect(self._show_problem)
        self._title = Label('question_title', sheet_title='true')
        self._consequence = Label('question_consequence', sheet_text='true')
        self._warning = Label('question_warning', sheet_text='true', tone='bad')
        self._statement = Label('question_statement', sheet_text='true')
        # It always keeps its room, so that YES and NO never move.
        self._problem = Fitted('question_problem', (20, 17, 15, 13))
        for label in (self._consequence, self._warning, self._statement):
            label.setWordWrap(True)
        self.yes = QtWidgets.QPushButton()
        self.yes.setObjectName('yes')
        self.no = QtWidgets.QPushButton(words.ASK_NO)
        self.no.setObjectName('no')
        self.no.clicked.connect(lambda: self.answered.emit(False))
        self.yes.clicked.connect(lambda: self.answered.emit(True))
        layout = column(
            self,
            self._title,
            self._consequence,
            self._warning,
            self._statement,
            self._problem,
            self.no,
            self.yes,
        )
        layout.setContentsMargins(24, 16, 24, 20)
        layout.setSpacing(12)

    def fit(self, by: float) -> None:
        """Take the size of a scale."""
        self._problem.setFixedHeight(round(50 * by))
        self._problem.fit(by)
        for button in self.buttons():
            button.setFixedHeight(round(39 * by))

    def ask(self, button: Button) -> None:
        """Ask for the confirmation of a command; NO has the focus."""
        self.button = button
        self.shown_at = clock.now()
        self._spoilt = False
        self.yes.setDown(False)  # held down since another question
        # A click on YES does not count at first: it may be the second one of a double click.
        self._settling.start(round(SEEN * 1000))
        set_text(
            self._title,
            words.ASK_TITLE.format(command=words.command_name(button.command, button.kart)),
        )
        condition = button.condition[:1].upper() + button.condition[1:]
        set_text(self._statement, words.ASK_STATE.format(condition=button.condition))
        self._show_texts(button)
        set_text(self.yes, words.ASK_YES.format(condition=condition))
        self.update_button(button)
        self.show()
        self.raise_()
        self.no.setFocus()

    def update_button(self, button: Button | None) -> None:
        """
        Take the command as race control offers it now; None: it no longer does.

        Once it differs from what was asked, YES stays off, also if it becomes the same again.
        """
        assert self.button is not None
        if CATALOGUE[self.button.command].stop:
            self._problem_text = ''
            if button is not None:
                self._show_texts(button)
        elif button is not None and button.reason:
            self._spoilt = True
            self._problem_text = words.ASK_AGAIN.format(reason=button.reason)
        elif self._spoilt or button is None or not button.asks_the_same(self.button):
            self._spoilt = True
            self._problem_text = words.ASK_CHANGED
        else:
            self._problem_text = ''
        self._show_problem()

    def _show_texts(self, button: Button) -> None:
        set_text(self._consequence, button.consequence)
        warning = words.ASK_WARNING.format(warning=button.warning) if button.warning else ''
        set_text(self._warning, warning)
        for label in (self._consequence, self._warning, self._statement):
            # A text that is hidden later keeps its room, for the same reason.
            policy = label.sizePolicy()
            policy.setRetainSizeWhenHidden(bool(label.text()))
            label.setSizePolicy(policy)

    @property
    def settled(self) -> bool:
        """Return whether it has been there long enough for a click on YES to count."""
        return not self._settling.isActive()

    def _show_problem(self) -> None:
        problem = self._problem_text
        # The texts of the question are no longer true.
        for label in (self._consequence, self._warning, self._statement):
            label.setVisible(bool(label.text()) and not problem)
        self._problem.show_cell(Cell(problem, Tone.BAD if problem else Tone.PLAIN))
        self.yes.setEnabled(not problem)
        set_property(self.yes, 'barred', 'true' if problem or not self.settled else 'false')


class Heats(Sheet):
    """Offers the heats of the roster."""

    def __init__(self, parent: QtWidgets.QWidget, pressed: Pressed) -> None:
        """Have none yet."""
        super().__init__(parent, 'heats')
        self._pressed = pressed
        self._heats: list[CommandButton] = []
        title = Label(sheet_title='true')
        title.setText(words.HEATS_TITLE)
        does = Label(sheet_text='true')
        does.setText(words.HEATS_CONSEQUENCE)
        close = QtWidgets.QPushButton(words.HEATS_CLOSE)
        close.setObjectName('close_heats')
        close.clicked.connect(self.close_sheet)
        self._column = column(self, title, does, close)
        self._column.setContentsMargins(24, 16, 24, 20)
        self._column.setSpacing(12)

    def show_heats(self, buttons: Sequence[Button]) -> None:
        """Show one button for each heat."""
        for place in range(len(self._heats), len(buttons)):
            button = CommandButton(self._choose, large=True)
            self._heats.append(button)
            self._column.insertWidget(2 + place, button)
        for place, (widget, heat) in enumerate(zip(self._heats, buttons, strict=False)):
            widget.show_button(heat)
            widget.setObjectName(f'heat_{place + 1}')
        for place, widget in enumerate(self._heats):
            widget.setVisible(place < len(buttons))

    def open_sheet(self) -> None:
        """Show it; the first heat has the focus."""
        self.show()
        self.raise_()
        self._heats[0].setFocus()

    def _choose(self, down: Button, button: Button) -> None:
        self.close_sheet()
        self._pressed(down, button)


class YourName(Sheet):
    """
    Asks for the official's name, when the official wants that.

    It has no text field of Qt's: that would take the space bar, digits and other keys, which may
    be a stop. The keyboard hands over the letters while the name has the focus.
    """

    signed = Signal(str)
    """The official has typed a name; empty: unnamed."""

    def __init__(self, parent: QtWidgets.QWidget) -> None:
        """Begin empty."""
        super().__init__(parent, 'your_name')
        self._name = ''
        title, about = Label(sheet_title='true'), Label(sheet_text='true')
        title.setText(words.NAME_TITLE)
        about.setText(words.NAME_ABOUT)
        about.setWordWrap(True)
        self._field = Label('name')
        self._field.setFocusPolicy(QtCore.Qt.FocusPolicy.StrongFocus)
        keep = QtWidgets.QPushButton(words.NAME_KEEP)
        keep.setObjectName('keep_name')
        keep.clicked.connect(self.save)
        cancel = QtWidgets.QPushButton(words.NAME_CANCEL)
        cancel.setObjectName('close_name')
        cancel.clicked.connect(self.close_sheet)
        layout = column(self, title, about, self._field, keep, cancel)
        layout.setContentsMargins(24, 16, 24, 20)
        layout.setSpacing(12)

    def open_sheet(self, name: str) -> None:
        """Show it with the name that there is."""
        self._show_name(name)
        self.show()
        self.raise_()
        self._field.setFocus()

    @property
    def is_typed_into(self) -> bool:
        """Return whether letters are part of the name now."""
        return self.isVisible() and self._field.hasFocus()

    def type_letter(self, letter: str) -> None:
        """Take a letter; one too many is left out."""
        if len(self._name) < MOST_OF_NAME:
            self._show_name(self._name + letter)

    def erase(self) -> None:
        """Delete the last letter."""
        self._show_name(self._name[:-1])

    def save(self) -> None:
        """Hand over the name."""
        self.signed.emit(self._name)

    def _show_name(self, name: str) -> None:
        self._name = name
        set_text(self._field, words.NAME_CARET.format(name=name))


class Help(Sheet):
    """Shows the keys."""

    def __init__(self, parent: QtWidgets.QWidget) -> None:
        """List them."""
        super().__init__(parent, 'help')
        title = Label(sheet_title='true')
        title.setText(words.HELP_TITLE)
        grid = QtWidgets.QGridLayout()
        half = (len(words.KEY_HELP) + 1) // 2
        for place, (key, meaning) in enumerate(words.KEY_HELP):
            for offset, text in ((0, key), (1, meaning)):
                label = Label(tone='good' if offset == 0 else 'plain')
                label.setText(text)
                grid.addWidget(label, place % half, 2 * (place // half) + offset)
        close = QtWidgets.QPushButton(words.HELP_CLOSE)
        close.setObjectName('close_help')
        close.clicked.connect(self.close_sheet)
        layout = column(self, title)
        layout.addLayout(grid)
        layout.addWidget(close)
        layout.setContentsMargins(24, 16, 24, 20)
        grid.setHorizontalSpacing(16)
        grid.setVerticalSpacing(4)
        layout.addStretch(1)
