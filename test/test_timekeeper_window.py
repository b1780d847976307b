# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The timekeeper's window without a screen, before a timekeeper's desk on paper.

Its client is before what a node of this test says, over real DDS.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
import contextlib
import importlib
import os
import re
import signal
import subprocess
import sys
import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from evgp_node.codec import message_of
from evgp_node.entries import Entry
from evgp_node.qos import latched
from evgp_node.results import (
    Act,
    Corrected,
    Judged,
    KartResult,
    Mark,
    Passing,
    RaceOfEvent,
    Standings,
    Status,
)
from evgp_node.roster import Heat
from evgp_node.stamps import stamp_of
from evgp_rcs_msgs import msg, srv
from evgp_testing.part import PATIENCE
from evgp_testing.process import Program
from evgp_testing.ros_side import joined, RosSide
from evgp_timing import window
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

LEFT = QtCore.Qt.MouseButton.LeftButton

HEAT = 'Heat 1'
TEAMS = {3: 'Georgia Tech', 7: 'Purdue'}

KART = KartResult(7, 0, Status.RUNNING, 0, None, (), ())
RESULTS = Standings(
    1.0, 'run', 1, HEAT, karts=(KART,), races=(RaceOfEvent(1, HEAT, 1.0, 0, False),)
)


class Paper(test_desk.Event):
    """A timekeeper on paper, before whose window an official sits."""

    def __init__(self) -> None:
        super().__init__()
        heats = (Heat(HEAT, (*TEAMS,), laps=3),)
        self.desk = Desk(Roster((*TEAMS,), heats=heats), LapSettings(min_lap_time=1.0))
        self.start(HEAT, *TEAMS)

    def give(
        self,
        entry: Entry,
        official: str,
        fields: Mapping[str, Any],
        answered: Callable[[Answer], None],
    ) -> None:
        """Answer a request as the timekeeper's service does."""
        request = getattr(srv, entry.service_type).Request(official=official, **fields)
        act = next(act for act, row in CORRECTIONS.items() if row is entry)
        answer = self.desk.feed(Corrected(self.now, asked_for(act, request)))
        assert answer is not None
        answered(answer)

    def take(self, window: window_widgets.TimekeeperWindow) -> None:
        """Say how the race is now."""
        window.on_race('GREEN GREEN', 252.0, TEAMS, '')
        window.on_results(self.desk.standings(self.now))


class Event(RosSide):
    """What race control, a timing line and a timekeeper say."""

    def __init__(self, domain: int) -> None:
        super().__init__('event', domain)
        publisher = self.node.create_publisher
        self._race = publisher(msg.Race, '/rcs/race', latched(1))
        self._diagnostics = publisher(DiagnosticArray, '/diagnostics', 10)
        self._results = publisher(msg.Results, '/rcs/timekeeper/results', latched(1))

    def state(self, banner: str = '') -> None:
        """Say that the race has been in GREEN_GREEN for 252 s."""
        karts = [msg.KartStatus(number=each, team=team) for each, team in TEAMS.items()]
        green, now = msg.RaceState(state=msg.RaceState.GREEN_GREEN), time.time_ns()
        race = msg.Race(state=green, karts=karts, stamp=stamp_of(now), banner=banner)
        race.state_since = stamp_of(now - 252 * 10**9)
        self._race.publish(race)

    def line_says(self, level: bytes, said: str) -> None:
        """Publish what a timing line says of itself."""
        status = DiagnosticStatus(level=level, name='timing: line', message=said)
        status.hardware_id, status.values = '10.1.0.20:5403', [KeyValue(key='kind', value='p3')]
        self._diagnostics.publish(DiagnosticArray(status=[status]))

    def publish(self) -> None:
        """Publish results in the timekeeper's place."""
        self._results.publish(message_of(RESULTS, msg.Results))

    def refuse_laps(self) -> threading.Event:
        """Refuse each lap in the timekeeper's place, but wait while the result is not set."""
        answering = threading.Event()
        answering.set()

        def refuse(_: object, answer: Any) -> object:
            answering.wait()
            answer.message = 'it was refused'
            return answer

        entry = CORRECTIONS[Act.COUNT]
        kind = getattr(srv, entry.service_type)
        self.node.create_service(kind, f'/rcs/{entry.service}', refuse)
        return answering


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

    def until(self, found: Callable[[], object], meanwhile: Callable[[], object] = int) -> None:
        """
        Have Qt run until something is so.

        :param meanwhile: is done again and again.
        """
        ends = time.monotonic() + PATIENCE
        while not found():
            shown = {name: self.text(name) for name in ('title', 'about', 'warning', 'said')}
            assert time.monotonic() < ends, (shown, self.rows(0), self.rows(1))
            meanwhile()
            self.settle()

    def until_said(self, *parts: str, meanwhile: Callable[[], object] = int) -> None:
        """Have Qt run until the bottom line has these words."""
        self.until(lambda: all(each in self.text('said') for each in parts), meanwhile)

    def status(self, kart: str) -> str:
        """Return the status of a kart; empty: it is not there."""
        return next((row[-1] for row in self.rows(0) if row[1] == kart), '')

    def crossing(self, kart: str) -> str:
        """Return what the newest crossing of a kart says, and its button; empty: there is none."""
        return next((f'{row[2]} [{row[3]}]' for row in self.rows(1) if row[1] == kart), '')

    def counting(self) -> list[bool]:
        """Return which of the races a dialog says to count, newest first."""
        self.press('Which run counts…')
        races = self.find('race')
        counts = [', counts' in races.itemText(each) for each in range(races.count())]
        self.press('Cancel')
        while self.widget.findChildren(QtWidgets.QDialog):
            self.settle()
        return counts

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
def event(parts: contextlib.ExitStack, domain: int) -> Event:
    """Return an event before its first race."""
    return parts.enter_context(Event(domain))


@pytest.fixture
def seen(application: Any, event: Event, parts: contextlib.ExitStack, domain: int) -> Window:
    """Return the window with its client; it need not see a timekeeper yet."""
    event.spin()
    context = parts.enter_context(joined(domain))
    client = window.Client(context=context, use_global_arguments=False)
    parts.callback(client.close)
    return parts.enter_context(contextlib.closing(Window(application, client.give, client.take)))


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


def test_it_shows_the_race_what_is_asked_badges_with_numbers_and_frames_of_corrections(
    racing: Window, paper: Paper
) -> None:
    assert racing.text('title') == HEAT
    assert 'GREEN GREEN 4:1' in racing.text('about')
    assert {row[2] for row in racing.rows(0)} == {*TEAMS.values()}
    assert 'cannot stop a race' in racing.text('stops')
    racing.count('7')
    racing.until(lambda: racing.crossing('7'))
    for table, column in ((racing.table(0), 1), (racing.table(1), 1), (racing.table(1), 3)):
        cell = table.cellWidget(0, column)
        assert cell.grab().toImage().pixelColor(6, cell.height() // 2).name() == '#14171a'
    paper.tell(What.FINISH, 7)
    racing.until(lambda: 'Kart 7 is marked as finished, but 3 laps' in racing.text('warning'))


def test_a_correction_that_is_not_sent_or_not_answered_is_told_and_a_late_answer_too(
    seen: Window,
    event: Event,
    parts: contextlib.ExitStack,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(window_widgets, 'NO_ANSWER', 0.5)
    seen.until(lambda: seen.rows(0), event.publish)
    seen.count('7')
    seen.until_said('LAP refused: the timekeeper was not found. Nothing was sent')
    answering = event.refuse_laps()
    parts.callback(answering.set)

    def again() -> None:
        event.publish()
        if 'not found' in seen.text('said'):
            seen.count('7')

    seen.until_said('LAP refused: it was refused', meanwhile=again)
    answering.clear()
    seen.count('7')
    seen.until_said('LAP: no answer for', 'Check the results before', meanwhile=event.publish)
    seen.until(lambda: 'The timekeeper has been silent for 4 s' in seen.text('warning'))
    assert not seen.find('PENALISE').isEnabled()
    seen.count('7')
    seen.until_said('LAP was not sent: the timekeeper has been silent for')
    answering.set()
    seen.until_said('LAP refused: it was refused')
    seen.until(lambda: seen.find('PENALISE').isEnabled(), event.publish)
    assert seen.text('warning') == ''


def test_what_is_not_heard_is_told_of_the_timekeeper_race_control_and_a_timing_line(
    seen: Window, event: Event
) -> None:
    assert seen.text('title') == 'No race yet'
    assert seen.text('about') == 'no contact with race control'
    seen.until(
        lambda: 'line: p3 at 10.1.0.20:5403' in seen.text('about'),
        lambda: event.line_says(DiagnosticStatus.OK, 'The device is connected'),
    )
    assert 'Timing line' not in seen.text('warning')
    event.line_says(DiagnosticStatus.ERROR, 'The device has been silent for 10 s')
    broken = 'Timing line line (p3 at 10.1.0.20:5403): The device has been silent for 10 s'
    seen.until(lambda: broken in seen.text('warning'))
    assert not seen.find('banner').isVisible()
    event.state(banner='REHEARSAL')
    seen.until(lambda: 'GREEN GREEN' in seen.text('about'))
    assert seen.find('banner').isVisible()
    assert seen.text('banner') == 'REHEARSAL'
    assert seen.find('banner').y() < seen.find('title').parent().y()
    assert seen.widget.windowTitle() == 'REHEARSAL: EVGP timekeeper'
    seen.until(lambda: '5403): silent for 4 s' in seen.text('warning'))
    assert 'The timekeeper has been silent' in seen.text('warning')
    seen.count('7')
    seen.until_said('was not sent')


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
    assert 'Kart 7 at 0:' in racing.text('text')
    yes = racing.find('dialog').findChildren(QtWidgets.QPushButton)[0]
    assert not yes.isEnabled()
    racing.confirm('Strike passing', 'is struck out', reason='seen twice')
    racing.until(lambda: racing.crossing('7') == 'by hand, struck: seen twice (Tina) [Restore]')
    racing.correct('Restore', '7')
    racing.until(lambda: racing.crossing('7') == 'by hand, starts lap 1 [Strike]')
    racing.until_said('RESTORE PASSING: passing official 1 is restored')

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
    assert racing.counting() == [True, False]
    racing.press('Which run counts…')
    racing.find('race').setCurrentIndex(1)
    racing.confirm('Count this race', 'race 1 now counts as Heat 1')
    racing.until(lambda: racing.counting() == [False, True])


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

    table, row = racing.table(0), [each[1] for each in racing.rows(0)].index('7')
    name = table.visualItemRect(table.item(row, 2))
    QtTest.QTest.mouseClick(table.viewport(), LEFT, pos=name.center())
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


# ----- without DDS ----------------------------------------------------------------------------


def test_a_click_is_of_the_crossing_that_was_pressed_or_of_none(application: Any) -> None:
    sent: list[Any] = []

    def judged(number: int, mark: Mark) -> Judged:
        return Judged(Passing('line', 'today', number, 7), 7, mark, 9.0 * number, 'twice')

    def tell(*passings: Judged) -> None:
        shown.window.on_results(RESULTS._replace(passings=passings))

    struck, counted = judged(1, Mark.STRUCK), judged(2, Mark.COUNTED)
    with contextlib.closing(Window(application, lambda *given: sent.append(given))) as shown:
        tell(struck, counted)
        shown.until(shown.table(1).isEnabled)  # once it has seen that the results are fresh
        shown.settle()
        button = shown.table(1).cellWidget(1, 3)
        pressed = button.mapToGlobal(button.rect().center())
        QtTest.QTest.mousePress(button, LEFT)
        tell(struck, counted, judged(3, Mark.COUNTED))
        shown.settle()
        QtTest.QTest.mouseRelease(button, LEFT, pos=button.mapFromGlobal(pressed))
        assert not sent
        shown.correct('Restore', '7')
        assert [fields['number'] for _, _, fields, _ in sent] == [1]
        # Another race: the rows are others.
        QtTest.QTest.mousePress(shown.table(1).cellWidget(2, 3), LEFT)
        tell(judged(9, Mark.STRUCK))
        assert len(shown.rows(1)) == 1
        shown.settle()
        assert len(sent) == 1
        shown.correct('Restore', '7')
        assert [fields['number'] for _, _, fields, _ in sent] == [1, 9]


def test_a_row_that_was_clicked_stays_that_of_its_kart_when_the_order_changes(
    application: Any,
) -> None:
    three, seven = (KartResult(number, 0, Status.RUNNING, 1, 9.0, (9.0,), ()) for number in (3, 7))
    with contextlib.closing(Window(application)) as shown:
        tell = lambda *karts: shown.window.on_results(RESULTS._replace(karts=karts))  # noqa: E731
        tell(three, seven)
        table = shown.table(0)
        table.setCurrentCell(1, 0)
        tell(seven, three)
        shown.window._ask(Act.PENALISE)
        assert shown.find('kart').currentData() == 7
        assert {each.row() for each in table.selectedItems()} == {0}
        # In a race without kart 7, no kart is chosen.
        tell(three)
        assert table.currentRow() == -1


# ----- the process ----------------------------------------------------------------------------


def test_the_process_takes_a_name_that_ros_takes_for_a_number_and_ends_in_order(
    event: Event, domain: int
) -> None:
    event.spin()
    words = '-m', 'evgp_timing.window', '--ros-args', '-p', 'official:=7'
    environment = {'QT_QPA_PLATFORM': 'offscreen'}
    with Program('window', [sys.executable, *words], domain, environment) as program:
        event.wait_until_polled(lambda: event.node.count_subscribers('/rcs/race'), 'the window')
        program.signal(signal.SIGTERM)
        assert program.wait() == 0


SCREENS = ('DISPLAY', 'WAYLAND_DISPLAY', 'QT_QPA_PLATFORM')


@pytest.mark.parametrize('package', ['evgp_timing.window', 'evgp_rcs_console.gui'])
@pytest.mark.parametrize(
    ('before', 'environment', 'why'),
    [
        ('sys.modules.update(PySide6=None, PyQt6=None)', {}, 'Qt for Python .* python3-pyqt6'),
        ('sys.modules.update(PyQt6=None)', {'QT_API': 'pyqt6'}, 'Qt for Python .* PyQt6'),
        ('', {}, 'no screen'),
        ('', {'QT_QPA_PLATFORM': 'offscreen', 'EVGP_GRAPH_INTERFACE': '192.0.2.77'}, '192.0.2.77'),
    ],
    ids=['no Qt', 'not the Qt that was chosen', 'no screen', 'no such interface'],
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
