"""The parts of the window. Each is told what to show, and touches only what that changes."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from evgp_protocol import clock
from evgp_rcs_console import style, words
from evgp_rcs_console.commands import FORMS
from evgp_rcs_console.freshness import SEEN
from evgp_rcs_console.notices import Notice
from evgp_rcs_console.qt import QtCore, QtGui, QtWidgets, Signal
from evgp_rcs_console.view import Button, Cell, Danger, Row, Tone

Pressed = Callable[[Button], None]

BANNER_ALERTS = 3
"""So many alerts are shown at once; the others are counted."""


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


class Elided(Label):
    """A text of one line that is cut with dots where there is no room; the whole is its tip."""

    def __init__(self, name: str = '', **properties: str) -> None:
        """Take whatever room there is."""
        super().__init__(name, **properties)
        self.setSizePolicy(
            QtWidgets.QSizePolicy.Policy.Ignored, QtWidgets.QSizePolicy.Policy.Preferred
        )
        self._whole = ''

    def show_text(self, text: str) -> None:
        """Show a text."""
        if text != self._whole:
            self._whole = text
            self.setToolTip(text)
            self.setAccessibleName(text)
            self._cut()

    @property
    def whole(self) -> str:
        """Return the text that is not cut."""
        return self._whole

    def resizeEvent(self, event: QtGui.QResizeEvent) -> None:  # noqa: N802 - Qt's name
        """Cut the text anew."""
        super().resizeEvent(event)
        self._cut()

    def _cut(self) -> None:
        room = max(0, self.contentsRect().width() - 2)
        metrics = self.fontMetrics()
        set_text(self, metrics.elidedText(self._whole, QtCore.Qt.TextElideMode.ElideRight, room))


class CommandButton(QtWidgets.QPushButton):
    """
    A command. One that is not allowed looks and is disabled, but can still be focused and tapped.

    Then it says why: a keyboard and a touch screen know no hovering.
    """

    def __init__(self, pressed: Pressed, large: bool = False) -> None:
        """Wait to be told the command."""
        super().__init__()
        self.button: Button | None = None
        self.setFocusPolicy(QtCore.Qt.FocusPolicy.StrongFocus)
        self.setProperty('large', 'true' if large else 'false')
        self.clicked.connect(lambda: self.button and pressed(self.button))

    def show_button(self, button: Button) -> None:
        """Show a command and whether it is allowed."""
        if button == self.button:
            return
        self.button = button
        name = button.command.value.lower()
        self.setObjectName(f'{name}_{button.kart}' if button.kart else name)
        set_text(self, f'{button.label}  {button.key}' if button.key else button.label)
        set_property(self, 'stop', 'true' if FORMS[button.command].stop else 'false')
        set_property(self, 'barred', 'false' if button.enabled else 'true')
        tip = button.explanation
        self.setToolTip(tip)
        self.setAccessibleDescription(tip)


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
        self._reason = Label(reason='true')
        self._reason.setWordWrap(True)
        self._reason.setAlignment(QtCore.Qt.AlignmentFlag.AlignTop)
        # It gives way first where there is little room; its tip has it whole.
        self._reason.setMinimumHeight(0)
        self._reason.setSizePolicy(
            QtWidgets.QSizePolicy.Policy.Preferred, QtWidgets.QSizePolicy.Policy.Ignored
        )
        layout = column(self, self.press, self._reason)
        layout.setSpacing(0)

    def show_button(self, button: Button) -> None:
        """Show a command and whether it is allowed."""
        self.press.show_button(button)
        set_text(self._reason, button.reason)
        self._reason.setToolTip(button.reason)

    def fit(self, by: float) -> None:
        """Take the size of a scale."""
        self.press.setFixedHeight(round(38 * by))
        self._reason.setMaximumHeight(round(15 * self._lines * by))
        self.setMaximumHeight(round((38 + 15 * self._lines) * by))


WIDTHS = {
    'number': 58,
    'race': 92,
    'sent': 142,
    'acknowledged': 130,
    'place': 40,
    'button': 80,
}
ROW_HEIGHT = 46


class KartRow(QtWidgets.QFrame):
    """A kart, with its commands beside it."""

    chosen = Signal(int)

    def __init__(self, pressed: Pressed) -> None:
        """Wait to be told the kart."""
        super().__init__()
        self.number = 0
        self.setProperty('row', 'true')
        self._number = Label(cell='number')
        self._number.setAlignment(QtCore.Qt.AlignmentFlag.AlignCenter)
        self._team = Elided(cell='team')
        self._note = Elided(cell='note')
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
            'race': _pair(self._race, self._link),
            'sent': _pair(self._sent, self._since),
            'acknowledged': _pair(self._acknowledged, self._says),
        }
        layout = QtWidgets.QHBoxLayout(self)
        layout.addWidget(self._number)
        layout.addWidget(_pair(self._team, self._note), 1)
        for pair in self._pairs.values():
            layout.addWidget(pair)
        layout.addWidget(self._place)
        for button in self._buttons:
            layout.addWidget(button)

    def fit(self, by: float) -> None:
        """Take the size of a scale."""
        self.setFixedHeight(round(ROW_HEIGHT * by))
        layout = self.layout()
        assert layout is not None
        layout.setContentsMargins(round(3 * by), round(2 * by), round(3 * by), round(2 * by))
        layout.setSpacing(round(4 * by))
        self._number.setFixedWidth(round(WIDTHS['number'] * by))
        self._place.setFixedWidth(round(WIDTHS['place'] * by))
        for name, pair in self._pairs.items():
            pair.setFixedWidth(round(WIDTHS[name] * by))
        for button in self._buttons:
            button.setFixedSize(round(WIDTHS['button'] * by), round((ROW_HEIGHT - 8) * by))

    def show_row(self, row: Row, chosen: bool, stale: bool) -> None:
        """Show a kart."""
        if row.number != self.number:
            self.number = row.number
            self.setObjectName(f'kart_{row.number}')
        set_property(self, 'racing', 'true' if row.in_race else 'false')
        set_property(self, 'chosen', 'true' if chosen else 'false')
        faint = Tone.PLAIN if row.in_race else Tone.FAINT
        self._number.show_cell(Cell(str(row.number), faint), stale)
        for elided, text in ((self._team, row.team), (self._note, row.note)):
            elided.show_text(text)
            set_property(elided, 'tone', 'stale' if stale else 'plain')
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
            fore, back = style.STALE if self._stale else style.TONES[row.sent.tone]
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


class Banner(QtWidgets.QFrame):
    """The alerts that are not seen yet, newest first; they stay until they are."""

    seen = Signal(int)
    all_seen = Signal()

    def __init__(self) -> None:
        """Have no alert."""
        super().__init__()
        self.setObjectName('banner')
        self._lines: list[tuple[QtWidgets.QWidget, Label, QtWidgets.QPushButton]] = []
        self._numbers = [0] * BANNER_ALERTS
        for place in range(BANNER_ALERTS):
            text = Elided(alert='true')
            button = QtWidgets.QPushButton(words.SEEN + ('  F10' if place == 0 else ''))
            button.setObjectName(f'seen_{place}')
            button.clicked.connect(lambda _=False, place=place: self._see(place))
            line = QtWidgets.QWidget()
            layout = QtWidgets.QHBoxLayout(line)
            layout.setContentsMargins(0, 0, 0, 0)
            layout.addWidget(text, 1)
            layout.addWidget(button)
            self._lines.append((line, text, button))
        self._more = Label()
        self._see_all = QtWidgets.QPushButton(words.SEEN_ALL)
        self._see_all.setObjectName('seen_all')
        self._see_all.clicked.connect(self.all_seen)
        self._rest = QtWidgets.QWidget()
        rest = QtWidgets.QHBoxLayout(self._rest)
        rest.setContentsMargins(0, 0, 0, 0)
        rest.addWidget(self._more, 1)
        rest.addWidget(self._see_all)
        layout = column(self, *(line for line, _, _ in self._lines), self._rest)
        layout.setContentsMargins(6, 3, 6, 3)
        layout.setSpacing(2)

    def show_notices(self, notices: Sequence[Notice]) -> None:
        """Show the alerts that are not seen, newest first."""
        self.setVisible(bool(notices))
        for place, (line, text, _) in enumerate(self._lines):
            line.setVisible(place < len(notices))
            if place < len(notices):
                notice = notices[place]
                self._numbers[place] = notice.number
                mark = words.MARK_MSR if notice.alert.use_msr else words.MARK_ALERT
                set_property(text, 'msr', 'true' if notice.alert.use_msr else 'false')
                text.show_text(f'{mark} {notice.text}')
        more = len(notices) - len(self._lines)
        self._rest.setVisible(more > 0)
        set_text(self._more, words.MORE_ALERTS.format(count=more))

    def _see(self, place: int) -> None:
        self.seen.emit(self._numbers[place])


class DangerPanel(QtWidgets.QFrame):
    """Race control is gone, or must not be relied on: in the largest type."""

    def __init__(self) -> None:
        """Say nothing yet."""
        super().__init__()
        self.setObjectName('danger')
        self._title = Label('danger_title')
        self._advice = Label('danger_advice')
        self._detail = Label('danger_detail')
        layout = column(self, self._title, self._advice, self._detail)
        layout.setSpacing(0)
        for label in (self._title, self._advice, self._detail):
            label.setAlignment(QtCore.Qt.AlignmentFlag.AlignCenter)
            # No sentence, however long, may push ALL KILL off the screen.
            label.setSizePolicy(
                QtWidgets.QSizePolicy.Policy.Ignored, QtWidgets.QSizePolicy.Policy.Preferred
            )
        self._detail.setWordWrap(True)

    def show_danger(self, danger: Danger) -> None:
        """Say it."""
        set_text(self._title, danger.title)
        set_text(self._advice, danger.advice)
        set_text(self._detail, danger.detail)


class Sheet(QtWidgets.QFrame):
    """
    A panel over the karts: a question, or the keys.

    It is no window of its own, so nothing that it lies beside is ever blocked by it.
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

    def close_sheet(self) -> None:
        """Hide it."""
        self.hide()


class Question(Sheet):
    """Asks an official to confirm what loosens, in the words of the condition."""

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
        self._statement = Label('question_statement', sheet_text='true')
        self._warning = Label('question_warning', sheet_text='true', tone='bad')
        self._problem = Label('question_problem', sheet_text='true')
        for label in (self._consequence, self._warning, self._statement, self._problem):
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

    def ask(self, button: Button) -> None:
        """Ask whether a command is meant; the keyboard is on NO."""
        self.button = button
        self.shown_at = clock.now()
        self._spoilt = False
        # A click on YES counts once it can have been meant: not the second one of a double click.
        self._settling.start(round(SEEN * 1000))
        set_text(
            self._title,
            words.ASK_TITLE.format(command=words.command_name(button.command, button.kart)),
        )
        self._show_texts(button)
        condition = button.condition[:1].upper() + button.condition[1:]
        set_text(self._statement, words.ASK_STATE.format(condition=button.condition))
        set_text(self.yes, words.ASK_YES.format(condition=condition))
        self.update_button(button)
        self.show()
        self.raise_()
        self.no.setFocus()

    def update_button(self, button: Button | None) -> None:
        """
        Take what race control says of the command meanwhile; None: it no longer offers it.

        Once that is not what was asked, YES is off, also if it is the same again later.
        """
        assert self.button is not None
        if FORMS[self.button.command].stop:
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

    @property
    def settled(self) -> bool:
        """Return whether it has been there long enough for a click on YES to be meant."""
        return not self._settling.isActive()

    def _show_problem(self) -> None:
        problem = self._problem_text
        # What it said before is not so any more.
        self._consequence.setVisible(not problem)
        self._statement.setVisible(not problem)
        self._warning.setVisible(not problem and bool(self._warning.text()))
        self._problem.show_cell(Cell(problem, Tone.BAD if problem else Tone.PLAIN))
        self._problem.setVisible(bool(problem))
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
        """Be there; the keyboard is on the first heat."""
        self.show()
        self.raise_()
        self._heats[0].setFocus()

    def _choose(self, button: Button) -> None:
        self.close_sheet()
        self._pressed(button)


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


def column(parent: QtWidgets.QWidget, *children: QtWidgets.QWidget) -> QtWidgets.QVBoxLayout:
    """Put widgets below each other, without margins."""
    layout = QtWidgets.QVBoxLayout(parent)
    layout.setContentsMargins(0, 0, 0, 0)
    for child in children:
        layout.addWidget(child)
    return layout


def _pair(above: QtWidgets.QWidget, below: QtWidgets.QWidget) -> QtWidgets.QWidget:
    pair = QtWidgets.QWidget()
    column(pair, above, below).setSpacing(0)
    return pair
