# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The officials' window: it shows the race in its areas, and passes what an official does on.

Everything here runs in the Qt thread. News from ROS arrives through the signals of ``Inbox``,
which Qt queues. Commands go out through ``give``, which returns at once.
"""

from __future__ import annotations

import time

from evgp_node.qt import QtCore, QtGui, QtWidgets
from evgp_node.results import Standings
from evgp_protocol import clock
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import Answer, StampedEvent
from evgp_rcs.rules.snapshot import KartSnapshot, Snapshot
from evgp_rcs.words import Cell, time_of_day, Tone
from evgp_rcs_console import panels, settings, style, texts
from evgp_rcs_console.alerts import AlertsArea
from evgp_rcs_console.catalogue import CATALOGUE
from evgp_rcs_console.commands import Given, Standing, Unanswered
from evgp_rcs_console.display import BottomLine, ChosenKart, Inbox, SeenCommands
from evgp_rcs_console.input import CommandInput, Give, Keyboard, LateInput, Mouse
from evgp_rcs_console.karts import KartList
from evgp_rcs_console.settings import Signature
from evgp_rcs_console.sheets import Heats, Help, Officials, Question, Sheet
from evgp_rcs_console.style import DAY, GAP, look, NIGHT
from evgp_rcs_console.view import Latest, RACE_COMMANDS, Screen
from evgp_rcs_console.widgets import (
    CENTER,
    CommandButton,
    fixed,
    font,
    lay,
    mark,
    Panel,
    Push,
    rescale,
    Text,
)

LOOK = 100
"""Time between two updates of everything that changes with time, in milliseconds."""


class ConsoleWindow(QtWidgets.QWidget):
    """
    The window of one official, which shows the newest snapshot of the race in every area.

    :ivar seen: what the official has seen on the screen in the last few moments.
    :ivar unanswered: this official's commands that race control has not answered yet, and the
        stops that it has not accepted yet.
    """

    def __init__(self, inbox: Inbox, give: Give, signature: Signature, looking: str) -> None:
        super().__init__()
        look.palette = NIGHT if settings.kept(settings.NIGHT) else DAY
        self.setObjectName('window')
        self.setWindowTitle(texts.TITLE)
        self.setAttribute(QtCore.Qt.WidgetAttribute.WA_StyledBackground)
        self.setFocusPolicy(QtCore.Qt.FocusPolicy.StrongFocus)
        self.seen, self.unanswered = SeenCommands(self), Unanswered()
        self._latest = Latest(clock.now(), looking)
        self._waiting = inbox.waiting
        self._style, self._second = (0.0, DAY), 0
        self._names = inbox.names
        self._arrange()
        self.bottom = BottomLine(self._status, self.unanswered)
        self.chosen = ChosenKart(self)
        self._late = LateInput(LOOK / 1000, self)
        self.presses = presses = CommandInput(give, signature, self, self._late)
        self._mouse, self._keyboard = Mouse(presses), Keyboard(presses)
        # It acts on the press, so that a press also counts if the pointer then slips off.
        self.kill.pressed.connect(presses.kill)
        self.events.filter.clicked.connect(presses.toggle_events)
        self._official.clicked.connect(
            lambda: self.open_sheet(self.officials, self.officials.first)
        )
        # The signals come from other threads, so they are always queued.
        queued = QtCore.Qt.ConnectionType.QueuedConnection
        inbox.came.connect(self.take_races, queued)
        inbox.event.connect(self.take_event, queued)
        inbox.results.connect(self.take_results, queued)
        inbox.answer.connect(self.take_answer, queued)
        inbox.pressing.connect(self.take_pressing, queued)
        inbox.dropped.connect(presses.take_dropped, queued)
        inbox.battery.connect(self.take_battery, queued)
        self._timer = QtCore.QTimer(self)
        self._timer.timeout.connect(self.look)
        self._timer.start(LOOK)
        self.winId()  # makes the native window, which gets every key and click first
        self.windowHandle().installEventFilter(self)
        application = QtWidgets.QApplication.instance()
        assert isinstance(application, QtWidgets.QApplication)
        application.focusChanged.connect(self.bottom.move)
        self.show_name(signature.name)
        self.fit()
        self.setFocus()
        self.look()

    # ----- the layout ---------------------------------------------------------------------

    def _arrange(self) -> None:
        """Lay out the areas, and the sheets that open over them."""
        self._banner = fixed(Text('top_line', 'bold', CENTER, fills=True), height=24)
        self._banner.hide()
        track, heat = CommandButton(tall=True), CommandButton(kind='quiet')
        steps = [CommandButton(tall=True) for _ in range(len(RACE_COMMANDS) + 1)]
        self._buttons = *steps, track, heat
        race, self._race_or_danger = QtWidgets.QWidget(), QtWidgets.QStackedWidget()
        of_race = fixed(panels.state_panel(), 316), panels.track_panel(track)
        for either in (lay(race, of_race, gap=GAP, columns=(0, 1)), panels.danger_panel()):
            self._race_or_danger.addWidget(either)
        top, clock_panel = fixed(QtWidgets.QWidget(), height=78), fixed(panels.clock_panel(), 138)
        lay(top, (self._race_or_danger, clock_panel), gap=GAP, columns=(1, 0))

        self.kill = Push('all_kill', CATALOGUE[CommandKind.ALL_KILL].label)
        self._kill_hint = fixed(Text('kill_hint', 'bold', CENTER, True), height=40)
        # The hint lies over the button, which still gets every click.
        self._kill_hint.setAttribute(QtCore.Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        kill_box = fixed(Panel('kill_box', ''), 272)
        lay(kill_box, [self.kill], [self.kill], margins=(3, 3, 3, 3), heights=(1, 0))
        kill_box.layout().addWidget(self._kill_hint, 1, 0)

        self.karts, self.alerts = KartList(), fixed(AlertsArea(), height=198)
        how = '\n\n'.join(texts.HOW_TO_BEGIN)
        self.how_to_begin = Text('how_to_begin', 'large', wrap=True, text=how)
        self._number_field = fixed(panels.number_field(), height=48)
        self.events = panels.EventPanel(self._names)
        side = QtWidgets.QWidget()
        lay(side, [self._number_field], [self.alerts], [self.events], gap=GAP, heights=(0, 0, 1))

        self._status = Text('status', 'bold', wrap=True, fills=True, smaller='small')
        self._battery = fixed(Text('battery', 'bold', CENTER, fills=True, flows=True), 250)
        self._battery.hide()
        self._official = fixed(Push('official', kind='quiet'), 272)
        foot = fixed(QtWidgets.QWidget(), height=32)
        lay(foot, (self._status, self._battery, self._official), gap=8, columns=(1, 0, 0))

        race_line = fixed(QtWidgets.QWidget(), height=60)
        lay(race_line, steps, gap=8, columns=[1] * len(steps))
        rows = (
            (self._banner, self._banner),
            (top, kill_box),
            (race_line, kill_box),
            (fixed(panels.strip(heat), height=28), side),
            (self.how_to_begin, side),
            (foot, foot),
        )
        margins, heights = (10, 10, 10, 6), (0, 0, 0, 0, 1)
        lay(self, *rows, gap=GAP, margins=margins, columns=(1, 0), heights=heights)
        self.layout().addWidget(self.karts, 4, 0)
        self.how_to_begin.raise_()
        self.question, self.help = Question(self), Help(self)
        self.heats, self.officials = Heats(self), Officials(self)
        self._sheets = self.question, self.heats, self.officials
        self._texts = {each.objectName(): each for each in self.findChildren(Text)}

    def fit(self) -> None:
        """Adapt all areas and sheets to the size of the window and to the palette."""
        look.by = max(0.6, min(self.width() / 1366, self.height() / 768))
        if self._style != (look.by, look.palette):
            self._style = look.by, look.palette
            QtWidgets.QApplication.setFont(font(look.px(style.TEXT)))
            self.setStyleSheet(style.sheet())
            rescale(self)
            self.events.restyle()
        self.layout().activate()
        self.karts.fit()
        self.place_sheets()

    def toggle_night(self) -> None:
        look.palette = DAY if look.palette is NIGHT else NIGHT
        settings.keep_soon(settings.NIGHT, 'on' if look.palette is NIGHT else '')
        self.fit()

    def open_sheet(self, sheet: Sheet, focus: QtWidgets.QWidget) -> None:
        """Show a sheet with the focus on one of its parts and close the other sheets."""
        self.close_sheets()
        sheet.show()
        self.place_sheets()
        focus.setFocus()

    def close_sheets(self) -> None:
        """Close every sheet except the question, which only an answer can close."""
        for sheet in self.findChildren(Sheet):
            if sheet is not self.question:
                sheet.close_sheet()

    def place_sheets(self) -> None:
        """Place the open sheets so that they cover neither a kart's number nor its stops."""
        for sheet in self.findChildren(Sheet):
            if not sheet.isHidden():
                room = self.karts.room_of_sheets
                sheet.lay_out(room.translated(self.karts.mapTo(self, QtCore.QPoint(0, 0))))

    def is_stop(self, widget: QtWidgets.QWidget | None) -> bool:
        if isinstance(widget, CommandButton) and widget.button is not None:
            return widget.button.is_stop
        return widget is self.kill

    # ----- what arrives -------------------------------------------------------------------

    def take_races(self) -> None:
        """Process every waiting snapshot, so that no alert is missed, and show the newest."""
        changed = False
        while self._waiting:
            race, at, two = self._waiting.popleft()
            self._latest.take_race(race, at, two)
            self.alerts.take_race(race, two)
            shown = _without_figures(self.seen.screen.snapshot, self.seen.screen.heard)
            changed = changed or _without_figures(race, self._latest.results) != shown
        if changed:
            self.refresh()  # if only figures have changed, they can wait for `look`

    def take_event(self, stamped: StampedEvent) -> None:
        self._latest.take_event(stamped.event)
        self.events.add(stamped)

    def take_results(self, results: Standings) -> None:
        self._latest.results = results

    def take_answer(self, given: Given, answer: Answer) -> None:
        self.unanswered.answered(given)
        self.bottom.say_answer(given, answer)
        self.refresh()

    def take_pressing(self, stops: tuple[Standing, ...]) -> None:
        self.unanswered.stops = stops
        self.refresh()

    def take_battery(self, percent: int | None) -> None:
        """Show the charge of a low battery, in percent; None means that the charge is not low."""
        said = '' if percent is None else f'BATTERY {percent} %: plug it in'
        self._battery.show_cell(Cell(said, Tone.BAD))

    # ----- what is shown ------------------------------------------------------------------

    def look(self) -> None:
        """Show what has arrived or depends on the time, and sound the alarm if it is due."""
        self.take_races()
        now, shown = clock.now(), self.seen.screen
        danger = self._latest.danger(now)
        # With the time of day, which changes every second, all ages are brought up to date.
        is_due = self.unanswered or self._second != int(time.time())
        if danger.title or is_due or shown.danger.title:
            self.refresh()
        warned = bool(danger.title) and self._latest.race is not None
        self.alerts.alarm.look(now, warned or bool(self.alerts.unseen))
        if self.question.isVisible():
            self.question.look()
        self._late.beat(clock.now())

    def refresh(self) -> None:
        """Show the newest snapshot, with all ages up to date."""
        now = clock.now()
        shown, screen = self.seen.screen, self._latest.screen(now, self.unanswered.ages(now))
        self._second = int(time.time())
        self._texts['time_of_day'].show_text(time_of_day(self._second))
        if screen.danger.title != shown.danger.title:
            self.alerts.alarm.sound_soon()
        self.seen.change_to(screen, now)
        self._show_banner(screen.snapshot.banner)
        self.how_to_begin.setVisible(not screen.rows)
        self._race_or_danger.setCurrentIndex(bool(screen.danger.title))
        for name, cell in screen.texts(self._names.names).items():
            self._texts[name].show_cell(cell)
        for name, tone in (('state_panel', screen.state.tone), ('track_edge', screen.humans.tone)):
            mark(self.findChild(Panel, name), ground=tone.value)
        buttons = *screen.race, screen.msr_button, screen.track_button, screen.heat_button
        for place, button in zip(self._buttons, buttons, strict=True):
            place.show_button(button)
        for area in (self.karts, self.events, self.alerts, *self._sheets):
            area.show_screen(screen)
        self.chosen.show_roster(screen.teams)
        self._show_kill(screen, now)
        self.bottom.take_screen(screen, self._latest.heard_at)
        self.bottom.show()

    @property
    def unheard(self) -> str:
        """Return why stops may not reach race control; empty if race control is not silent."""
        danger = self._latest.danger(clock.now())
        return danger.barred if danger.stale else ''

    def show_name(self, name: str) -> None:
        """Show the name of the official here; empty if it is not known."""
        self._official.show_words(f'Name: {name}' if name else 'Your name?')

    def show_number(self, title: Cell, detail: Cell) -> None:
        """Show the kart that a command by key acts on, or that the keys do not work."""
        ground = title.tone.value if title.tone is Tone.BAD else 'chosen' if title.text else ''
        if not self.isActiveWindow():
            detail = Cell('Click here, not on ALL KILL')
            title, ground = Cell(texts.KEYS_OFF_LARGE), 'off'
        if ground:  # on a coloured background, the style sheet sets the colour of the text
            detail = detail._replace(tone=Tone.PLAIN)
        mark(self._number_field, ground=ground)
        self._texts['number'].show_text(title.text)
        self._texts['number_detail'].show_cell(detail)

    def _show_banner(self, banner: str) -> None:
        if banner != self._banner.text():
            self._banner.show_cell(Cell(banner, Tone.BANNER))
            self._banner.setVisible(bool(banner))
            self.setWindowTitle(f'{banner}: {texts.TITLE}' if banner else texts.TITLE)
            self.fit()

    def _show_kill(self, screen: Screen, now: float) -> None:
        """Show the keys of ALL KILL, or the time that ALL KILL has had no answer."""
        late = self.unanswered.late_stops(now)
        stop = next((each for each in late if each.given.command is CommandKind.ALL_KILL), None)
        if stop is not None:
            age = clock.duration(now - stop.since)
            hint = Cell(f'SENT {stop.presses} times in {age}: no answer', Tone.BAD)
        elif self.isActiveWindow():
            karts = texts.count(screen.rows) if screen.rows else 'karts'
            hint = Cell(f'all {karts} · SPACE BAR or F12')
        else:
            hint = Cell(texts.KEYS_OFF_LARGE, Tone.BAD)
        mark(self.kill, pressing='false' if stop is None else 'true')
        self._kill_hint.show_cell(hint)

    # ----- Qt's events --------------------------------------------------------------------

    def resizeEvent(self, event: QtGui.QResizeEvent) -> None:  # noqa: N802 - Qt's name
        self.fit()

    def changeEvent(self, event: QtCore.QEvent) -> None:  # noqa: N802 - Qt's name
        super().changeEvent(event)
        if event.type() == QtCore.QEvent.Type.ActivationChange and hasattr(self, '_mouse'):
            self._mouse.take_activation(self.isActiveWindow())
            self.refresh()

    def eventFilter(  # noqa: N802 - Qt's name
        self, watched: QtCore.QObject, event: QtCore.QEvent
    ) -> bool:
        """Handle keys and the mouse before any widget gets them."""
        kind = event.type()
        if kind == QtCore.QEvent.Type.KeyPress:
            assert isinstance(event, QtGui.QKeyEvent)
            return self._keyboard.take(event)
        if isinstance(event, QtGui.QMouseEvent):
            return self._mouse.take(event)
        # An open menu would take clicks and keys, even those of stops.
        return bool(kind == QtCore.QEvent.Type.ContextMenu)

    def closeEvent(self, event: QtGui.QCloseEvent) -> None:  # noqa: N802 - Qt's name
        self._timer.stop()
        super().closeEvent(event)


def _without_figures(race: Snapshot, results: Standings | None) -> object:
    """Return what a screen shows of a race, apart from times and the figures of links."""
    link = KartSnapshot._fields.index('link')
    rest = link + 1
    karts = [(kart[:link], kart.link.grade, kart[rest:]) for kart in race.karts]
    return race._replace(stamp=0.0, karts=()), karts, results and results._replace(stamp=0.0)
