# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The timekeeper's window without a screen, before a timekeeper's desk on paper.

`test_timekeeper.py` has its client before a real timekeeper.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
import contextlib
from functools import partial
import importlib
import os
import re
import signal
import subprocess
import sys
import time
from typing import Any

from evgp_node.entries import Entry
from evgp_node.results import Act, Corrected, Mark
from evgp_node.roster import Format, Heat
from evgp_rcs_msgs import srv
from evgp_testing.part import PATIENCE
from evgp_testing.process import Program
from evgp_testing.ros_side import RosSide
from evgp_timing.corrections import CORRECTIONS
from evgp_timing.desk import Answer, Desk, Roster, What
from evgp_timing.laps import LapSettings
from evgp_timing.timekeeper import asked_for
import pytest
from rig.needs import cannot_run
import test_desk

try:
    from evgp_timing import window_widgets
except ImportError as error:
    cannot_run(f'Qt cannot be loaded: {error}', whole_file=True)

QtCore, QtWidgets = window_widgets.QtCore, window_widgets.QtWidgets
QtTest = importlib.import_module(QtCore.__name__.replace('QtCore', 'QtTest'))

OFFSCREEN = {'QT_QPA_PLATFORM': 'offscreen'}
LEFT = QtCore.Qt.MouseButton.LeftButton

HEAT = 'Heat 1'
TEAMS = {3: 'Georgia Tech', 7: 'Purdue'}


class Paper(test_desk.Event):
    """A timekeeper on paper, before whose window an official sits."""

    def __init__(self) -> None:
        super().__init__()
        self.is_silent = False
        self.answers: list[Callable[[], None]] | None = None  # those that are held back
        heats = Heat(HEAT, (*TEAMS,), laps=3), Heat('Practice', (*TEAMS,), Format.PRACTICE)
        owners = {f't{kart}': kart for kart in TEAMS}
        self.desk = Desk(Roster((*TEAMS, 9), owners, heats), LapSettings(min_lap_time=1.0))
        self.start(HEAT, *TEAMS)

    def give(
        self,
        entry: Entry,
        official: str,
        fields: Mapping[str, Any],
        answered: Callable[[Answer], None],
    ) -> None:
        """Answer a request as the timekeeper's service does, unless answers are held back."""
        request = getattr(srv, entry.service_type).Request(official=official, **fields)
        act = next(act for act, row in CORRECTIONS.items() if row is entry)
        answer = self.desk.feed(Corrected(self.now, asked_for(act, request)))
        assert answer is not None
        if self.answers is None:
            answered(answer)
        else:
            self.answers.append(partial(answered, answer))

    def take(self, window: window_widgets.TimekeeperWindow) -> None:
        """Say how the race is now."""
        if not self.is_silent:
            window.on_race('GREEN GREEN', 252.0, TEAMS, '')
            window.on_results(self.desk.standings(self.now))


class Window:
    """The window, as an official sees and uses it."""

    def __init__(
        self,
        application: Any,
        give: window_widgets.Give = lambda *_: None,
        take: Callable[[Any], object] = lambda _: None,
    ) -> None:
        self._application = application
        self.window = window_widgets.TimekeeperWindow(give, take, 'Tina')
        self.widget = self.window.widget
        self.widget.resize(1366, 768)
        self.widget.show()

    def find(self, name: str) -> Any:
        found = self.widget.findChild(QtWidgets.QWidget, name)
        assert found is not None, name
        return found

    def text(self, name: str) -> str:
        return str(self.find(name).text())

    def table(self, number: int) -> Any:
        """Return a table: 0 is that of the results, 1 that of the crossings."""
        return self.widget.findChildren(QtWidgets.QTableWidget)[number]

    def rows(self, number: int) -> list[list[str]]:
        """Return what a table shows."""
        table = self.table(number)
        return [
            [
                (table.cellWidget(row, column) or table.item(row, column)).text()
                for column in range(table.columnCount())
            ]
            for row in range(table.rowCount())
        ]

    def choose(self, kart: str) -> None:
        """Click the row of a kart."""
        table, row = self.table(0), [each[1] for each in self.rows(0)].index(kart)
        name = table.visualItemRect(table.item(row, 2))
        QtTest.QTest.mouseClick(table.viewport(), LEFT, pos=name.center())

    def correct(self, text: str, kart: str) -> None:
        """Click the button with this text of the newest crossing of a kart."""
        row = [each[1::2] for each in self.rows(1)].index([kart, text])
        QtTest.QTest.mouseClick(self.table(1).cellWidget(row, 3), LEFT)

    def press(self, text: str) -> None:
        """Press a button by what it says."""
        buttons = self.widget.findChildren(QtWidgets.QPushButton)
        (button,) = (each for each in buttons if each.text() == text and each.isVisible())
        assert button.isEnabled(), text
        QtTest.QTest.mouseClick(button, LEFT)

    def fill(self, **fields: Any) -> None:
        """Fill in fields by their names."""
        for name, value in fields.items():
            field = self.find(name)
            if isinstance(field, QtWidgets.QComboBox):
                field.setCurrentIndex(field.findText(value, QtCore.Qt.MatchFlag.MatchStartsWith))
                assert field.currentText().startswith(value), value
            elif isinstance(field, QtWidgets.QLineEdit):
                QtTest.QTest.keyClicks(field, value)
            elif isinstance(field, QtWidgets.QCheckBox):
                field.setChecked(value)
            else:
                field.setValue(value)

    def confirm(self, text: str, said: str, **fields: Any) -> None:
        """Fill in the dialog, press a button of it, and wait for what the bottom line says."""
        self.fill(**fields)
        self.press(text)
        self.until_said(said)

    def count(self, kart: str) -> None:
        """Count a lap by hand, by keys."""
        self.fill(lap=kart)
        QtTest.QTest.keyClick(self.find('lap'), QtCore.Qt.Key.Key_Return)

    def settle(self) -> None:
        """Have Qt do what is to be done next; the window's own timer ends the wait."""
        self._application.processEvents(QtCore.QEventLoop.ProcessEventsFlag.WaitForMoreEvents)

    def until(self, found: Callable[[], object]) -> None:
        """Have Qt run until something is so."""
        ends = time.monotonic() + PATIENCE
        while not found():
            shown = {name: self.text(name) for name in ('title', 'about', 'warning', 'said')}
            assert time.monotonic() < ends, (shown, self.rows(0), self.rows(1))
            self.settle()

    def until_said(self, *parts: str) -> None:
        """Have Qt run until the bottom line has these words."""
        self.until(lambda: all(each in self.text('said') for each in parts))

    def status(self, kart: str) -> str:
        """Return the status of a kart; empty: it is not there."""
        return next((row[-1] for row in self.rows(0) if row[1] == kart), '')

    def crossing(self, kart: str) -> str:
        """Return what the newest crossing of a kart says, and its button; empty: there is none."""
        return next((f'{row[2]} [{row[3]}]' for row in self.rows(1) if row[1] == kart), '')

    def races(self) -> tuple[list[str], int]:
        """Return the races between which a dialog has to choose, and the one that it suggests."""
        self.press('Which run counts…')
        choice = self.find('race')
        listed = [choice.itemText(each) for each in range(choice.count())]
        suggested = choice.currentData()
        self.press('Cancel')
        while self.widget.findChildren(QtWidgets.QDialog):
            self.settle()
        return listed, suggested

    def close(self) -> None:
        self.widget.close()
        self.widget.deleteLater()
        self.settle()


@pytest.fixture(scope='module')
def application() -> Any:
    """Return Qt's application, without a screen."""
    words = ['timekeeper_window', '-platform', 'offscreen']
    return QtWidgets.QApplication.instance() or QtWidgets.QApplication(words)


@pytest.fixture
def paper() -> Paper:
    """Return a timekeeper on paper, with a race that was started."""
    return Paper()


@pytest.fixture
def racing(application: Any, paper: Paper) -> Iterator[Window]:
    """Return the window, which sees that race."""
    with contextlib.closing(Window(application, paper.give, paper.take)) as opened:
        opened.until(lambda: opened.find('PENALISE').isEnabled())
        yield opened


# ----- what it shows --------------------------------------------------------------------------


def test_it_shows_what_is_asked_badges_with_numbers_and_frames_of_corrections(
    racing: Window, paper: Paper
) -> None:
    assert racing.text('title') == HEAT
    assert 'cannot stop a race' in racing.text('stops')
    racing.count('7')
    racing.until(lambda: racing.crossing('7'))
    for table, column in ((racing.table(0), 1), (racing.table(1), 1), (racing.table(1), 3)):
        cell = table.cellWidget(0, column)
        assert cell.grab().toImage().pixelColor(6, cell.height() // 2).name() == '#14171a'
    paper.tell(What.FINISH, 7)
    racing.until(lambda: 'Kart 7 is marked as finished, but 3 laps' in racing.text('warning'))


def test_a_row_has_the_result_of_its_kart_and_the_header_and_the_dialog_the_race(
    racing: Window, paper: Paper
) -> None:
    def rows() -> list[str]:
        return [' | '.join(row) for row in racing.rows(0)]

    def now() -> str:
        return time.strftime('%H:%M', time.localtime(paper.now))

    at = now()
    paper.start(HEAT, 3, 7, 9)  # race control's roster does not have kart 9
    assert paper.correct(Act.GIVE, 9, transponder='t9')
    crossings = [(7, 10), (3, 2), (9, 1), (7, 38), (3, 1), (9, 3), (7, 37.25), (3, 1.5)]
    for kart, after in (*crossings, (7, 40), (3, 2)):
        paper.cross(kart, after)
    racing.until(lambda: len(racing.rows(1)) == 10)
    racing.press('Penalty…')
    racing.confirm('Penalise', 'kart 9: -1 lap', kart='9', laps=1, reason='short cut')
    first, second = (
        '1 | 7 | Purdue | 3 | 2:13.750 |  | 0:41.000 | 0:41.500 | classified',
        '2 | 3 | Georgia Tech | 3 | 2:15.750 | +2.000 | 0:40.000 | 0:42.000 | classified',
    )
    third = '3 | 9 |  | 0 | 0:55.000 | +3 laps | 0:42.000 | 0:42.000 | lap 2; -1 lap: short cut'
    racing.until(lambda: rows() == [first, second, third])
    red = [racing.table(0).item(place, 8).foreground().color().name() for place in range(3)]
    assert red == ['#14171a', '#14171a', '#b3001b']
    assert racing.text('about') == f'race to 3 laps · run of {at} · GREEN GREEN 4:12'
    paper.tell(What.OVER)
    out = ' | 9 |  | 0 | 0:55.000 |  | 0:42.000 | 0:42.000 | did not finish; -1 lap: short cut'
    racing.until(lambda: rows() == [first, second, out])

    later = now()
    paper.start('Practice', *TEAMS)
    for kart, after in ((7, 10), (3, 2), (7, 39), (3, 3)):
        paper.cross(kart, after)
    racing.until(lambda: racing.rows(0)[1][5] == '+1.000')  # between best laps
    assert racing.text('about').startswith(f'practice · run of {later} · ')
    # A correction is of the race that was run, not of the grid that forms.
    paper.race, paper.heat = 9, ''
    paper.tell(What.GRID_ACTIVE)
    racing.until(lambda: racing.text('title') == 'Race')
    listed, suggested = racing.races()
    assert (f'{HEAT}, run of {at}: 2 classified, counts', suggested) == (listed[2], 3)
    assert listed[0].endswith(': 0 classified')


def test_what_is_not_heard_sent_or_answered_is_told_and_a_late_answer_too(
    application: Any, paper: Paper, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(window_widgets, 'NO_ANSWER', 0.5)
    paper.is_silent = True
    with contextlib.closing(Window(application, paper.give, paper.take)) as shown:
        assert shown.text('title') == 'No race yet'
        assert shown.text('about') == 'no contact with race control'
        assert not shown.find('banner').isVisible()
        line, silent = ('north', 'p3 at 10.1.0.20:5403'), 'The device has been silent for 10 s'
        shown.window.on_line(*line, '')
        shown.until(lambda: 'north: p3 at 10.1.0.20:5403' in shown.text('about'))
        assert 'Timing line' not in shown.text('warning')
        shown.window.on_line(*line, silent)
        told = f'Timing line north (p3 at 10.1.0.20:5403): {silent}'
        shown.until(lambda: told in shown.text('warning'))
        shown.window.on_race('GREEN GREEN', 252.0, TEAMS, 'REHEARSAL')
        shown.until(lambda: 'GREEN GREEN 4:1' in shown.text('about'))
        assert shown.find('banner').isVisible()
        assert shown.text('banner') == 'REHEARSAL'
        assert shown.find('banner').y() < shown.find('title').parent().y()
        assert shown.widget.windowTitle() == 'REHEARSAL: EVGP timekeeper'
        shown.count('7')
        shown.until_said('LAP was not sent: the timekeeper has been silent for')

        paper.is_silent, paper.answers = False, []
        shown.until(lambda: shown.find('PENALISE').isEnabled())
        shown.count('7')
        shown.until_said('LAP: no answer for', 'Check the results before')
        paper.is_silent = True
        shown.until(lambda: 'The timekeeper has been silent for 4 s' in shown.text('warning'))
        assert '5403): silent for ' in shown.text('warning')
        assert not shown.find('PENALISE').isEnabled()
        shown.count('7')
        shown.until_said('was not sent')
        (answer,) = paper.answers
        answer()
        assert shown.text('said') == 'LAP: kart 7 crossed the line: counted'
        shown.window.on_line(*line, '')
        paper.is_silent = False
        shown.until(lambda: shown.text('warning') == '')
        assert shown.find('PENALISE').isEnabled()


# ----- corrections ----------------------------------------------------------------------------


def test_a_lap_is_counted_by_its_kart_and_enter_and_struck_with_a_reason_and_restored(
    racing: Window,
) -> None:
    assert racing.widget.focusWidget() is racing.find('lap')
    racing.count('7')
    racing.until_said('LAP: kart 7 crossed the line: counted')
    racing.until(lambda: racing.crossing('7') == 'by hand, starts lap 1 [Strike]')
    assert racing.text('lap') == ''

    said = racing.text('said')
    racing.correct('Strike', '7')
    racing.fill(reason='seen twice')
    racing.press('Cancel')
    racing.until(lambda: not racing.widget.findChildren(QtWidgets.QDialog))
    assert racing.text('said') == said

    racing.correct('Strike', '7')
    about = r'Kart 7 at 0:\d\d\.\d: by hand, starts lap 1 \(official 1\)'
    assert re.fullmatch(about, racing.text('text'))
    yes = racing.find('dialog').findChildren(QtWidgets.QPushButton)[0]
    assert not yes.isEnabled()
    racing.confirm('Strike passing', 'is struck out', reason='seen twice')
    racing.until(lambda: racing.crossing('7') == 'by hand, struck: seen twice (Tina) [Restore]')
    racing.correct('Restore', '7')
    racing.until(lambda: racing.crossing('7') == 'by hand, starts lap 1 [Strike]')
    racing.until_said('RESTORE PASSING: passing official 1 is restored')
    assert racing.widget.focusWidget() is racing.find('lap')

    racing.count('9')
    racing.until_said('There is no kart 9')


def test_a_transponder_is_given_to_its_kart_and_the_earlier_run_counts_once_it_is_chosen(
    racing: Window, paper: Paper
) -> None:
    paper.lap(1, 9)
    racing.until(lambda: len(racing.rows(1)) == 2)
    assert racing.crossing('?') == 'transponder t9 [Whose?]'
    racing.until(lambda: 'no kart has the transponder t9' in racing.text('warning'))
    racing.correct('Whose?', kart='?')
    racing.confirm('Give transponder', 't9 belongs to kart 3', kart='3  Georgia Tech')
    racing.until(lambda: racing.crossing('3') == 'lap 1, 0:10.000 [Strike]')
    assert racing.status('3') == 'lap 2'

    paper.tell(What.OVER)
    paper.start(HEAT, *TEAMS)
    racing.until(lambda: not racing.rows(1))
    paper.lap(1, 9)
    racing.until(lambda: racing.status('3') == 'lap 2')
    paper.tell(What.OVER)
    assert [', counts' in each for each in racing.races()[0]] == [True, False]
    racing.press('Which run counts…')
    racing.find('race').setCurrentIndex(1)
    racing.confirm('Count this race', 'race 1 now counts as Heat 1')
    racing.until(lambda: ', counts' not in racing.races()[0][0])
    assert ', counts' in racing.races()[0][1]


def test_a_penalty_needs_a_kart_a_cost_and_a_reason_and_a_row_that_was_clicked_is_its_kart(
    racing: Window,
) -> None:
    racing.press('Penalty…')
    yes = racing.find('dialog').findChildren(QtWidgets.QPushButton)[0]
    racing.fill(reason='short cut', kart='7  Purdue')
    assert not yes.isEnabled()
    racing.confirm('Penalise', 'PENALISE: kart 7: +5 s: short cut', seconds=5)
    racing.until(lambda: racing.status('7') == 'lap 1; +5 s: short cut')
    for said in ('the last penalty of kart 7 is undone', 'UNDO PENALTY refused: kart 7 has no'):
        racing.press('Undo penalty…')
        racing.confirm('Undo penalty', said, kart='7  Purdue')
        racing.until(lambda: racing.status('7') == 'lap 1')
    assert racing.find('said').property('bad')

    racing.choose('7')
    racing.press('Penalty…')
    racing.confirm('Penalise', 'disqualified', disqualified=True, reason='not fit to race')
    racing.until(lambda: racing.status('7') == 'disqualified: not fit to race')
    # The next number that is typed is that of a lap.
    assert racing.widget.focusWidget() is racing.find('lap')


def test_results_are_published_once_the_race_is_over(racing: Window, paper: Paper) -> None:
    racing.press('Publish results…')
    racing.confirm('Publish results', 'PUBLISH RESULTS refused: the race is still under way')
    paper.tell(What.OVER)
    racing.until(lambda: racing.status('7') == 'no lap')
    racing.press('Publish results…')
    racing.press('Publish results')
    racing.until(lambda: 'results published' in racing.text('about'))


def test_a_click_is_of_the_crossing_that_was_pressed_or_of_none(
    racing: Window, paper: Paper
) -> None:
    def mark() -> Mark:
        return paper.desk.standings().passings[0].mark

    racing.count('7')
    paper.cross(9)
    seen = paper.desk.standings().passings[0].passing
    assert paper.correct(Act.STRIKE, passing=seen.identity, reason='twice')
    racing.until(lambda: '[Restore]' in racing.crossing('7'))
    button = racing.table(1).cellWidget(1, 3)
    pressed = button.mapToGlobal(button.rect().center())
    QtTest.QTest.mousePress(button, LEFT)
    paper.cross(9)
    racing.until(lambda: len(racing.rows(1)) == 3)
    racing.settle()
    QtTest.QTest.mouseRelease(button, LEFT, pos=button.mapFromGlobal(pressed))
    assert mark() is Mark.STRUCK
    racing.correct('Restore', '7')
    assert mark() is Mark.COUNTED
    # In another race, the rows are others.
    QtTest.QTest.mousePress(racing.table(1).cellWidget(0, 3), LEFT)
    paper.start(HEAT, *TEAMS)
    paper.cross(9)
    racing.until(lambda: len(racing.rows(1)) == 1)
    QtTest.QTest.mouseRelease(racing.table(1).cellWidget(0, 3), LEFT)
    assert not racing.widget.findChildren(QtWidgets.QDialog)


def test_a_row_that_was_clicked_stays_that_of_its_kart_when_the_order_changes(
    racing: Window, paper: Paper
) -> None:
    racing.choose('7')
    for _ in range(2):
        assert paper.correct(Act.COUNT, 7)
        paper.now += 10.0
    racing.until(lambda: racing.rows(0)[0][1] == '7')
    racing.press('Penalty…')
    assert racing.find('kart').currentData() == 7
    assert {each.row() for each in racing.table(0).selectedItems()} == {0}
    # In a race without kart 7, no kart is chosen.
    paper.start('', 3)
    racing.until(lambda: len(racing.rows(0)) == 1)
    assert racing.table(0).currentRow() == -1


# ----- the process ----------------------------------------------------------------------------


def test_the_process_takes_a_name_that_ros_takes_for_a_number_and_ends_in_order(
    domain: int,
) -> None:
    words = '-m', 'evgp_timing.window', '--ros-args', '-p', 'official:=7'
    with (
        RosSide('beside', domain) as beside,
        Program('window', [sys.executable, *words], domain, OFFSCREEN) as program,
    ):
        beside.wait_until_polled(lambda: beside.node.count_subscribers('/rcs/race'), 'the window')
        program.signal(signal.SIGTERM)
        assert program.wait() == 0


SCREENS = ('DISPLAY', 'WAYLAND_DISPLAY', 'QT_QPA_PLATFORM')


TIMEKEEPER, RACE = 'evgp_timing.window', 'evgp_rcs_console.gui'
NO_QT = 'sys.modules.update(PySide6=None, PyQt6=None)'


@pytest.mark.parametrize(
    ('package', 'before', 'environment', 'why'),
    [
        (TIMEKEEPER, NO_QT, {}, 'Qt for Python .* python3-pyqt6'),
        (RACE, 'sys.modules.update(PyQt6=None)', {'QT_API': 'pyqt6'}, 'Qt for Python .* PyQt6'),
        (TIMEKEEPER, '', {}, 'no screen'),
        (RACE, '', {**OFFSCREEN, 'EVGP_GRAPH_INTERFACE': '192.0.2.77'}, '192.0.2.77'),
    ],
    ids=['no Qt', 'not the Qt that was chosen', 'no screen', 'no interface'],
)
def test_a_window_that_cannot_open_says_why_in_one_sentence(
    package: str, before: str, environment: dict[str, str], why: str
) -> None:
    kept = {name: value for name, value in os.environ.items() if name not in SCREENS}
    code = f'import sys; {before}\nfrom {package} import main\nsys.exit(main())'
    done = subprocess.run(
        [sys.executable, '-c', code],
        env={**kept, **environment},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert (done.returncode, done.stderr.count('\n')) == (2, 1)
    assert re.match(f'(timekeeper_window|rcs_gui): .*{why}', done.stderr)
