# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The timekeeper's window, made of Qt's own tables, dialogs and buttons.

:raises ImportError: if there is no Qt for Python.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
import math
from typing import Any, TypeAlias

from evgp_node.entries import Entry
from evgp_node.official import MOST, MOST_OF_NAME
from evgp_node.qt import QtCore, QtGui, QtWidgets
from evgp_node.results import Act, lap_time, Standings, TIMING_GONE
from evgp_protocol import clock
from evgp_timing import window_view as view
from evgp_timing.corrections import CORRECTIONS
from evgp_timing.desk import Answer

NO_ANSWER = 5.0
"""Time after which the window reports a correction as unanswered, in seconds."""

TITLE = 'EVGP timekeeper'
STOPS_NOTHING = 'This window cannot stop a race. To stop, use the race window or the stop button'
NO_WORD = 'The timekeeper has been silent for {age}: this window is out of date'
NOT_SENT = '{label} was not sent: the timekeeper has been silent for {age}'
NOT_ANSWERED = '{label}: no answer for {age}. Check the results before you press it again'
NEWEST_FIRST, ACTION = 'CROSSINGS, NEWEST FIRST', 'CORRECT'

Give: TypeAlias = Callable[[Entry, str, Mapping[str, Any], Callable[[Answer], None]], None]
"""A function that sends a correction without waiting. Its arguments are the correction, the
official's name, the fields of the request, and a function to call with the answer, in the window's
thread."""

REFRESH = 50
"""Time between two updates of the window, in milliseconds."""

ROW = 39
"""Minimum height of a row, in pixels."""

_BUTTONS = {
    Act.PENALISE: 'Penalty…',
    Act.UNDO_PENALTY: 'Undo penalty…',
    Act.CHOOSE: 'Which run counts…',
    Act.PUBLISH: 'Publish results…',
}
_MOST = {'seconds': 3600, 'laps': 100}
_WIDE = ('about', 'said', 'warning', 'text')  # labels that take all available room
_NUMBERS = ('LAPS', 'TIME', 'GAP', 'BEST', 'LAST')
_LEFT = QtCore.Qt.AlignmentFlag.AlignLeft | QtCore.Qt.AlignmentFlag.AlignVCenter
_RIGHT = QtCore.Qt.AlignmentFlag.AlignRight | QtCore.Qt.AlignmentFlag.AlignVCenter
_BLACK, _RED = map(QtGui.QColor, ('#14171A', '#B3001B'))

_STYLE = """
QWidget { font-family: Inter, 'Noto Sans', 'DejaVu Sans'; font-size: 14px; color: #14171A; }
QWidget#window { background: #EEF0F2; }
QDialog, QHeaderView, QLineEdit, QTableWidget { background: #FFFFFF; }
QFrame#card { background: #FFFFFF; border: 1px solid #D5D9DE; border-radius: 6px; }
QLabel#banner { background: #6A1B9A; color: #FFFFFF; font-weight: bold; border-radius: 6px;
  padding: 3px; }
QLabel#title { font-size: 22px; font-weight: bold; }
QLabel#about, QLabel#stops { color: #5E676F; }
QLabel[bad=true], QLabel#warning { color: #B3001B; font-weight: bold; }
QTableWidget { border: none; font-size: 15px; selection-background-color: #E2E6EA;
  selection-color: #14171A; }
QTableWidget::item { border-bottom: 1px solid #E2E6EA; padding: 0 6px; }
QHeaderView::section { background: #FFFFFF; color: #5E676F; font-size: 11px; font-weight: bold;
  border: none; border-bottom: 1px solid #D5D9DE; padding: 6px; }
QLineEdit { padding: 4px; }
QPushButton { background: #FFFFFF; border: 1px solid #14171A; border-radius: 6px;
  padding: 6px 12px; font-weight: bold; }
QLabel#badge { background: #14171A; color: #FFFFFF; border-radius: 5px; font-weight: bold;
  margin: 7px 6px; padding: 2px 7px; }
QPushButton#small { font-size: 12px; margin: 7px 6px; padding: 2px 7px; }
QPushButton#PUBLISH { background: #1F6FEB; border-color: #1F6FEB; color: #FFFFFF; }
QPushButton:focus { border: 2px solid #1F6FEB; }
QPushButton:disabled, QTableWidget:disabled { background: #FFFFFF; color: #A3ADB6; }
"""


class TimekeeperWindow:
    """
    The timekeeper's window. Its methods `on_...` receive the news, in the window's thread.

    :param give: a function that sends a correction.
    :param take: a function that passes the news since its last call to a window.
    :param official: name of the official; empty if it is not known at the start.
    """

    def __init__(
        self, give: Give, take: Callable[[TimekeeperWindow], None], official: str
    ) -> None:
        self._give, self._take = give, take
        self._results = Standings()
        self._heard = self._race_heard = clock.now()
        self._teams: dict[int, str] = {}
        self._state, self._since = '', math.inf
        self._lines: dict[str, tuple[str, str, float]] = {}
        self._rows: list[view.Row] = []
        self._crossings: list[view.Crossing] = []
        self._waiting: dict[object, tuple[str, float]] = {}
        self.widget = QtWidgets.QWidget(objectName='window', windowTitle=TITLE)
        self.widget.setStyleSheet(_STYLE)
        self._banner, self._title, self._about, self._warning, self._said = map(
            _label, ('banner', 'title', 'about', 'warning', 'said')
        )
        self._banner.setAlignment(QtCore.Qt.AlignmentFlag.AlignCenter)
        self._banner.hide()
        self._said.setAlignment(_RIGHT)
        self._lap = _line('lap', 'Kart', 5, 60)
        self._lap.returnPressed.connect(self._count)
        self._official = _line('official', 'Your name', MOST_OF_NAME, 140, official)
        self._buttons = [_button('COUNT', 'Lap by hand', self._count)]
        for act, text in _BUTTONS.items():
            self._buttons.append(_button(act.name, text, partial(self._ask, act)))
        self._table = _table(view.HEADINGS, stretched='TEAM')
        self._passings = _table(('TIME', 'KART', NEWEST_FIRST, ACTION), stretched=NEWEST_FIRST)
        self._warnings = _card(self._warning)
        layout = QtWidgets.QVBoxLayout(self.widget)
        layout.addWidget(self._banner)
        layout.addWidget(_card(self._title, self._about, self._lap, *self._buttons))
        layout.addWidget(self._warnings)
        tables = QtWidgets.QHBoxLayout()
        tables.addWidget(_card(self._table), 2)
        tables.addWidget(_card(self._passings), 1)
        layout.addLayout(tables, 1)
        layout.addWidget(_card(_label('stops', STOPS_NOTHING), self._said, self._official))
        timer = QtCore.QTimer(self.widget)
        timer.timeout.connect(self._refresh)
        timer.start(REFRESH)
        self._refresh()
        self._lap.setFocus()

    # ----- the news -----------------------------------------------------------------------

    def on_results(self, results: Standings) -> None:
        self._results, self._heard = results, clock.now()
        self._show_results()
        self._show_crossings([*view.crossings(results)])

    def on_race(self, state: str, seconds: float, teams: Mapping[int, str], banner: str) -> None:
        """Show the state of the race and its duration (s), the teams and the banner."""
        self._race_heard, self._state = clock.now(), state
        self._since = self._race_heard - seconds
        self._banner.setText(banner)
        self._banner.setVisible(bool(banner))
        self.widget.setWindowTitle(f'{banner}: {TITLE}' if banner else TITLE)
        if teams != self._teams:
            self._teams = dict(teams)
            self._show_results()

    def on_line(self, name: str, where: str, trouble: str) -> None:
        """Update a timing source's condition. An empty ``trouble`` means that it works."""
        self._lines[name] = where, trouble, clock.now()

    # ----- what is shown ------------------------------------------------------------------

    def _refresh(self) -> None:
        """Process the news and show what is out of date and what was not answered."""
        self._take(self)
        now, state = clock.now(), 'no contact with race control'
        if now - self._race_heard <= TIMING_GONE and self._since < math.inf:
            state = f'{self._state} {lap_time(now - self._since, 0)}'
        wrong, well = list(self._results.questions), []
        for name, (where, trouble, heard) in self._lines.items():
            if now - heard > TIMING_GONE:
                trouble = f'silent for {_age(heard)}'
            if trouble:
                wrong.append(f'Timing line {name} ({where}): {trouble}')
            else:
                well.append(f'{name}: {where}')
        if now - self._heard > TIMING_GONE:
            wrong.insert(0, NO_WORD.format(age=_age(self._heard)))
        self._title.setText(view.title(self._results))
        self._about.setText(' · '.join((view.about(self._results, state), *well)))
        self._warning.setText('\n'.join(wrong))
        self._warnings.setVisible(bool(wrong))
        for each in (self._table, self._passings, *self._buttons):
            each.setEnabled(self._is_fresh())
        for call, (label, asked) in [*self._waiting.items()]:
            if now - asked > NO_ANSWER:
                del self._waiting[call]
                self._say(NOT_ANSWERED.format(label=label, age=_age(asked)), bad=True)

    def _is_fresh(self) -> bool:
        return self._results.stamp > 0.0 and clock.now() - self._heard <= TIMING_GONE

    def _say(self, text: str, bad: bool = False) -> None:
        self._said.setText(text)
        self._said.setProperty('bad', bad)
        self._said.style().polish(self._said)

    def _show_results(self) -> None:
        rows = view.rows(self._results, self._teams)
        if rows == self._rows:
            return
        chosen, self._rows = self._chosen(), rows
        self._table.setRowCount(len(rows))
        for place, row in enumerate(rows):
            _write(self._table, place, row.cells, red='STATUS' * row.penalised)
        # The kart that the official has clicked stays chosen, wherever it is now.
        places = [place for place, row in enumerate(rows) if row.kart == chosen]
        self._table.setCurrentCell(places[0] if places else -1, 0)

    def _chosen(self) -> int:
        """Return the kart whose row the official has clicked, or 0."""
        place = self._table.currentRow()
        return self._rows[place].kart if 0 <= place < len(self._rows) else 0

    def _show_crossings(self, seen: list[view.Crossing]) -> None:
        """Show the crossings. New rows are inserted above the old ones, which do not change."""
        if seen == self._crossings:
            return
        new = [each.passing for each in seen]
        old = [each.passing for each in self._crossings]
        fresh = next(n for n in range(len(new) + 1) if new[n:] == old[: len(new) - n])
        shown = [*[None] * fresh, *self._crossings]
        self._crossings = seen
        # Qt takes a click for none if its button has meanwhile moved, or is another.
        for _ in range(fresh):
            self._passings.insertRow(0)
        self._passings.setRowCount(len(new))
        for place, each in enumerate(seen):
            if each != shown[place]:
                cells = (each.at, each.kart, each.text)
                _write(self._passings, place, cells, NEWEST_FIRST * (each.act is Act.RESTORE))
                button = _button('small', each.button, partial(self._correct, each))
                button.setFocusPolicy(QtCore.Qt.FocusPolicy.NoFocus)
                self._passings.setCellWidget(place, len(cells), button)
        self._passings.resizeRowsToContents()

    # ----- what is corrected --------------------------------------------------------------

    def _count(self) -> None:
        """Count a crossing by the kart whose number the official has typed."""
        typed = self._lap.text().strip()
        self._lap.clear()
        self._lap.setFocus()
        if typed in {str(number) for _, number in view.karts(self._results, self._teams)}:
            self._send(Act.COUNT, kart=int(typed))
        else:
            said = f'There is no kart {typed}' if typed else 'Type the number of the kart first'
            self._say(said, bad=True)

    def _correct(self, seen: view.Crossing) -> None:
        """Strike out a passing, restore it, or give its transponder to a kart."""
        this = {**seen.passing.identity._asdict(), 'race': self._results.races[-1].number}
        if seen.act is Act.GIVE:
            self._ask(seen.act, str(seen), transponder=seen.passing.transponder)
        elif seen.act is Act.STRIKE:
            self._ask(seen.act, str(seen), **this)
        else:
            self._send(seen.act, reason='', **this)

    def _ask(self, act: Act, text: str = '', **given: Any) -> None:
        """
        Open a dialog for a correction, and send the correction once the official confirms it.

        :param act: the kind of correction.
        :param text: what the correction is about; if empty, the dialog shows what it does.
        :param given: the fields of the request that are already known.
        """
        entry = CORRECTIONS[act]
        dialog = QtWidgets.QDialog(self.widget, objectName='dialog', windowTitle=entry.label)
        dialog.setAttribute(QtCore.Qt.WidgetAttribute.WA_DeleteOnClose)
        form = QtWidgets.QFormLayout(dialog)
        form.addRow(_label('text', text or f'{entry.meaning[:1].upper()}{entry.meaning[1:]}.'))
        readers: dict[str, Callable[[], Any]] = {}
        changes = []
        for name in (*('kart',) * entry.to_one_kart, *entry.takes):
            if name not in given:
                field, changed, readers[name] = self._field(name)
                field.setObjectName(name)
                form.addRow(name.capitalize(), field)
                changes.append(changed)
        standard = QtWidgets.QDialogButtonBox.StandardButton
        yes, no = standard.Ok, standard.Cancel
        box = QtWidgets.QDialogButtonBox(yes | no)
        box.button(yes).setText(entry.label.capitalize())
        form.addRow(box)

        def check() -> None:
            told = {name: read() for name, read in readers.items()}
            costs = act is not Act.PENALISE or any(told[each] for each in (*_MOST, 'disqualified'))
            # None means that the official has not chosen a kart.
            box.button(yes).setEnabled(bool(costs and not {None, ''} & {*told.values()}))

        for changed in changes:
            changed.connect(check)
        check()
        box.accepted.connect(
            lambda: self._send(act, **given, **{name: read() for name, read in readers.items()})
        )
        box.accepted.connect(dialog.accept)
        box.rejected.connect(dialog.reject)
        dialog.finished.connect(lambda _: self._lap.setFocus())
        dialog.open()

    def _field(self, name: str) -> tuple[Any, Any, Callable[[], Any]]:
        """Return the widget for a field of a request, the signal of a change, and the getter."""
        if name in _MOST:
            number = QtWidgets.QSpinBox(maximum=_MOST[name])
            return number, number.valueChanged, number.value
        if name == 'disqualified':
            box = QtWidgets.QCheckBox()
            return box, box.toggled, box.isChecked
        if name not in ('kart', 'race'):
            line = QtWidgets.QLineEdit(maxLength=MOST)
            return line, line.textChanged, lambda: line.text().strip()
        if name == 'kart':
            choice = _choice(view.karts(self._results, self._teams), self._chosen())
        else:
            newest = view.newest_with_results(self._results)
            choice = _choice(view.races(self._results), newest)
        return choice, choice.currentIndexChanged, choice.currentData

    def _send(self, act: Act, **fields: Any) -> None:
        entry, call = CORRECTIONS[act], object()
        if not self._is_fresh():
            self._say(NOT_SENT.format(label=entry.label, age=_age(self._heard)), bad=True)
            return
        self._waiting[call] = entry.label, clock.now()
        self._say(f'{entry.label}: sent')

        def answered(answer: Answer) -> None:
            self._waiting.pop(call, None)
            refused = '' if answer.success else ' refused'
            self._say(f'{entry.label}{refused}: {answer.text}', bad=not answer.success)

        self._give(entry, self._official.text(), {**entry.fixed, **fields}, answered)


# ----- widgets --------------------------------------------------------------------------------


def _age(since: float) -> str:
    return clock.duration(clock.now() - since, 0)


def _label(name: str, text: str = '') -> Any:
    label = QtWidgets.QLabel(text, objectName=name, wordWrap=name in _WIDE)
    label.setTextFormat(QtCore.Qt.TextFormat.PlainText)
    return label


def _line(name: str, hint: str, most: int, width: int, text: str = '') -> Any:
    line = QtWidgets.QLineEdit(text, objectName=name, placeholderText=hint, maxLength=most)
    line.setFixedWidth(width)
    return line


def _button(name: str, text: str, act: Callable[[], None]) -> Any:
    button = QtWidgets.QPushButton(text, objectName=name)
    button.clicked.connect(lambda: act())
    return button


def _card(*widgets: Any) -> Any:
    """Return a frame that contains the widgets side by side."""
    card = QtWidgets.QFrame(objectName='card')
    layout = QtWidgets.QHBoxLayout(card)
    for each in widgets:
        layout.addWidget(each, int(each.objectName() in _WIDE))
    return card


def _table(headings: Sequence[str], stretched: str) -> Any:
    table = QtWidgets.QTableWidget(0, len(headings))
    table.setHorizontalHeaderLabels(headings)
    table.verticalHeader().hide()
    table.verticalHeader().setMinimumSectionSize(ROW)
    table.verticalHeader().setDefaultSectionSize(ROW)
    table.setShowGrid(False)
    table.setFocusPolicy(QtCore.Qt.FocusPolicy.NoFocus)
    table.setEditTriggers(table.EditTrigger.NoEditTriggers)
    table.setSelectionBehavior(table.SelectionBehavior.SelectRows)
    table.setSelectionMode(table.SelectionMode.SingleSelection)
    header = table.horizontalHeader()
    header.sectionResized.connect(table.resizeRowsToContents)
    for column, heading in enumerate(headings):
        mode = header.ResizeMode.ResizeToContents
        if heading == stretched:
            mode = header.ResizeMode.Stretch
        header.setSectionResizeMode(column, mode)
        table.horizontalHeaderItem(column).setTextAlignment(_side(heading))
    return table


def _side(heading: str) -> Any:
    return _RIGHT if heading in _NUMBERS else _LEFT


def _write(table: Any, row: int, cells: Sequence[str], red: str) -> None:
    """Write a row of a table, with the cell below the heading `red` in red."""
    for column, text in enumerate(cells):
        heading = table.horizontalHeaderItem(column).text()
        if heading == 'KART':
            table.setCellWidget(row, column, _label('badge', text))
            continue
        item = table.item(row, column)
        if item is None:
            item = QtWidgets.QTableWidgetItem()
            item.setTextAlignment(_side(heading))
            table.setItem(row, column, item)
        font = item.font()
        font.setBold(heading in ('POS', red))
        item.setFont(font)
        item.setForeground(_RED if heading == red else _BLACK)
        item.setText(text)


def _choice(entries: Sequence[tuple[str, int]], chosen: int) -> Any:
    choice = QtWidgets.QComboBox()
    for text, number in entries:
        choice.addItem(text, number)
    choice.setCurrentIndex(choice.findData(chosen))
    return choice
