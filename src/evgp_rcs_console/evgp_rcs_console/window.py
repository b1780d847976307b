"""
The officials' window.

Everything here runs in the Qt thread. What ROS hears comes in through the signals of ``Inbox``,
which Qt queues; commands go out through ``give``, which returns at once.
"""

from __future__ import annotations

from collections.abc import Callable
import time

from evgp_rcs_console import keys, style, words
from evgp_rcs_console.client import Order
from evgp_rcs_console.keys import Act
from evgp_rcs_console.notices import AlertBook, concerns, EventLog
from evgp_rcs_console.qt import QtCore, QtGui, QtWidgets, Signal
from evgp_rcs_console.snapshot import Answer, Command, Event, Race
from evgp_rcs_console.sound import Sound
from evgp_rcs_console.view import Button, Cell, NOTHING, Screen, show, Silence, silence, Tone
from evgp_rcs_console.widgets import (
    Banner,
    column,
    CommandButton,
    Elided,
    Heading,
    Help,
    KartRow,
    Label,
    Overview,
    Question,
    RaceButton,
    set_property,
    set_text,
    SilencePanel,
)

Give = Callable[[Command, int, bool], Order]

LOOK = 100
"""How often the window looks whether race control is still heard, and what waits, ms."""

AGES = 1.0
"""How often ages are shown anew, seconds."""

SOUND_AGAIN = 4.0
"""How often the sound comes again while an alert is not seen, seconds."""

REASON_LINES = (2, 4, 0, 2, 4)
"""How many lines the reason below each command to the race may have; a stop has none."""

OVERVIEW_FROM = 9
"""From so many karts on there is an overview of all of them."""


class Inbox(QtCore.QObject):
    """What the client's threads have for the Qt thread; a ``Listener`` of the client."""

    race = Signal(object, float)
    event = Signal(object)
    answer = Signal(object, object)
    pressing = Signal(int, float)

    def on_race(self, race: Race, at: float) -> None:
        """Hand over a snapshot."""
        self.race.emit(race, at)

    def on_event(self, event: Event) -> None:
        """Hand over an event."""
        self.event.emit(event)

    def on_answer(self, order: Order, answer: Answer) -> None:
        """Hand over an answer."""
        self.answer.emit(order, answer)

    def on_pressing(self, count: int, since: float) -> None:
        """Hand over how ALL KILL fares."""
        self.pressing.emit(count, since)


class ConsoleWindow(QtWidgets.QWidget):
    """
    The window of one official.

    :param inbox: where what is heard comes from.
    :param give: gives a command, to a kart (0: none), with or without the official's statement.
    :param topic: the topic on which race control is looked for.
    :param domain: the ROS domain.
    """

    def __init__(self, inbox: Inbox, give: Give, topic: str, domain: int) -> None:
        """Show that race control is being looked for."""
        super().__init__()
        self.setObjectName('window')
        self.setWindowTitle(words.TITLE)
        self._give = give
        self._topic = topic
        self._domain = domain
        self._began = time.monotonic()
        self._race: Race | None = None
        self._heard_at = 0.0
        self._shown_at = 0.0
        self._screen: Screen | None = None
        self._silent = True
        self._orders: dict[tuple[Command, int], Order] = {}
        self._pressing = (0, 0.0)
        self._book = AlertBook()
        self._log = EventLog()
        self._log_kart = 0
        self._chosen = 0
        self._typed = keys.Typed()
        self._message = Cell(words.READY)
        self._pointed: CommandButton | None = None
        self._sound = Sound()
        self._muted = False
        self._sounded = 0.0
        self._by = 0.0
        self._rows: list[KartRow] = []
        self._build()
        self._fit()
        # Queued in any case: the signals come from other threads.
        queued = QtCore.Qt.ConnectionType.QueuedConnection
        inbox.race.connect(self._take_race, queued)
        inbox.event.connect(self._take_event, queued)
        inbox.answer.connect(self._take_answer, queued)
        inbox.pressing.connect(self._take_pressing, queued)
        self._timer = QtCore.QTimer(self)
        self._timer.timeout.connect(self._look)
        self._timer.start(LOOK)
        application = QtWidgets.QApplication.instance()
        assert application is not None
        application.installEventFilter(self)
        self.setFocus()
        self._look()

    # ----- what is heard ------------------------------------------------------------------

    def _take_race(self, race: Race, at: float) -> None:
        self._race = race
        self._heard_at = at
        if self._book.update(race.alerts):
            self._sounded = 0.0
        self._refresh()

    def _take_event(self, event: Event) -> None:
        for line in self._log.add(event):
            if concerns(line, self._log_kart):
                self._log_view.appendPlainText(str(line))

    def _take_answer(self, order: Order, answer: Answer) -> None:
        if self._orders.get((order.command, order.kart)) is order:
            del self._orders[order.command, order.kart]
        mark = words.DONE if answer.success else words.REFUSED
        tone = Tone.GOOD if answer.success else Tone.BAD
        self._say(f'{time.strftime("%H:%M:%S")}  {mark}{answer.message}', tone)
        self._refresh()

    def _take_pressing(self, count: int, since: float) -> None:
        self._pressing = (count, since)
        self._show_kill()

    # ----- what time does -----------------------------------------------------------------

    def _look(self) -> None:
        now = time.monotonic()
        silent = self._silence(now) is not None
        if silent or silent != self._silent or self._orders or now - self._shown_at >= AGES:
            self._refresh()
        if self._pressing[0]:
            self._show_kill()
        alarming = silent and self._race is not None
        due = now - self._sounded >= SOUND_AGAIN
        if (self._book.unseen or alarming) and due and not self._muted:
            self._sounded = now
            self._sound.play()
        self._show_keys_reach()

    def _silence(self, now: float) -> Silence | None:
        silent_for = now - self._heard_at if self._race is not None else None
        state = (self._race or NOTHING).state
        return silence(silent_for, now - self._began, self._topic, self._domain, state)

    # ----- what is shown ------------------------------------------------------------------

    def _refresh(self) -> None:
        now = time.monotonic()
        self._shown_at = now
        quiet = self._silence(now)
        if (quiet is not None) != self._silent:
            self._silent = quiet is not None
            self._sounded = 0.0
        self._silence_panel.setVisible(quiet is not None)
        self._now_panel.setVisible(quiet is None)
        if quiet is not None:
            self._silence_panel.show_silence(quiet)
        pending = {key: now - order.at for key, order in self._orders.items()}
        screen = show(self._race or NOTHING, now - self._heard_at, pending, quiet)
        self._screen = screen
        stale = quiet is not None
        self._state.show_cell(screen.state, stale)
        set_text(self._since, screen.since)
        self._humans.show_cell(screen.humans, stale)
        set_text(self._humans_reason, screen.humans_reason)
        set_text(self._track, screen.track)
        for widget, button in zip(self._race_buttons, screen.race, strict=True):
            widget.show_button(button)
        self._msr_button.show_button(screen.all_karts[0])
        if screen.track_button is not None:
            self._track_button.show_button(screen.track_button)
        self._show_rows(screen, stale)
        self._show_alerts()
        if self._question.isVisible() and self._question.button is not None:
            asked = screen.button(self._question.button.command, self._question.button.kart)
            if asked is not None:
                self._question.update_button(asked)
        self._show_kill()
        self._show_status()

    def _show_rows(self, screen: Screen, stale: bool) -> None:
        if [row.number for row in self._rows] != [row.number for row in screen.rows]:
            self._make_rows(len(screen.rows))
        for widget, row in zip(self._rows, screen.rows, strict=True):
            widget.show_row(row, row.number == self._chosen, stale)
        self._overview.setVisible(len(screen.rows) >= OVERVIEW_FROM)
        bar = self._scroll.verticalScrollBar()
        self._heading.fit(self._by, bar.width() if bar.isVisible() else 0)
        self._overview.show_rows(screen.rows, self._chosen, stale)
        choices = [words.EVERY_KART] + [
            words.ONE_KART.format(number=row.number, team=row.team) for row in screen.rows
        ]
        if [self._filter.itemText(n) for n in range(self._filter.count())] != choices:
            self._filter.blockSignals(True)
            self._filter.clear()
            self._filter.addItems(choices)
            self._filter.blockSignals(False)

    def _make_rows(self, count: int) -> None:
        for row in self._rows:
            self._rows_layout.removeWidget(row)
            row.deleteLater()
        self._rows = [KartRow(self._pressed) for _ in range(count)]
        for place, row in enumerate(self._rows):
            row.fit(self._by)
            row.chosen.connect(self._choose)
            self._rows_layout.insertWidget(place, row)

    def _show_alerts(self) -> None:
        unseen = self._book.unseen
        standing = self._book.seen_and_standing
        self._banner.show_notices(unseen)
        if not standing and unseen:
            self._quiet_alerts.show_text(words.UNSEEN.format(count=len(unseen)))
        elif standing:
            texts = '; '.join(notice.text for notice in standing)
            self._quiet_alerts.show_text(words.STILL_STANDING.format(texts=texts))
        else:
            self._quiet_alerts.show_text(words.NO_ALERT)
        tone = Tone.WAIT if standing else Tone.FAINT if unseen else Tone.GOOD
        set_property(self._quiet_alerts, 'tone', tone.value)

    def _show_kill(self) -> None:
        count, since = self._pressing
        late = time.monotonic() - since
        # The first moment of a press that is about to be answered is not worth a word.
        waits = count > 0 and late > 0.3
        set_property(self._kill, 'pressing', 'true' if waits else 'false')
        text = words.LABELS[Command.ALL_KILL]
        if waits:
            detail = words.KILL_PRESSING.format(count=count, age=words.short_age(late))
            self._kill_hint.show_cell(Cell(detail, Tone.BAD))
        set_text(self._kill, text)
        if not waits:
            self._show_keys_reach()

    def _show_keys_reach(self) -> None:
        if self._kill.property('pressing') == 'true':
            return
        reached = self.isActiveWindow() or QtWidgets.QApplication.activePopupWidget() is not None
        self._kill_hint.show_cell(
            Cell(words.KILL_HINT) if reached else Cell(words.KEYS_OFF, Tone.BAD)
        )

    def _show_status(self) -> None:
        pointed = self._pointed
        if pointed is not None and pointed.button is not None and pointed.button.reason:
            self._status.show_text(pointed.button.explanation)
            set_property(self._status, 'tone', 'wait')
            return
        now = time.monotonic()
        waiting = [
            (now - order.at, words.command_name(order.command, order.kart))
            for order in self._orders.values()
        ]
        if waiting and max(waiting)[0] > 0.3:
            late, name = max(waiting)
            text = words.PENDING.format(command=name, age=words.short_age(late))
            self._status.show_text(text)
            set_property(self._status, 'tone', 'wait')
            return
        self._status.show_text(self._message.text)
        set_property(self._status, 'tone', self._message.tone.value)

    def _say(self, text: str, tone: Tone = Tone.PLAIN) -> None:
        self._message = Cell(text, tone)
        self._pointed = None
        self._show_status()

    # ----- what the official does ---------------------------------------------------------

    def _press_kill(self) -> None:
        self._give(Command.ALL_KILL, 0, False)

    def _pressed(self, button: Button) -> None:
        """Give the command of a button, ask for its confirmation, or say why it is not allowed."""
        if not button.enabled:
            self._say(button.explanation, Tone.WAIT)
        elif button.condition:
            self._help.close_sheet()
            self._question.ask(button)
            self._place_sheets()
        else:
            self._send(button, stated=False)

    def _send(self, button: Button, stated: bool) -> None:
        order = self._give(button.command, button.kart, stated)
        self._orders[button.command, button.kart] = order
        name = words.command_name(button.command, button.kart)
        self._say(words.GIVEN.format(command=name))
        self._refresh()

    def _answer_question(self, yes: bool) -> None:
        asked = self._question.button
        # Hidden first: a second press of the same key must find nothing to answer.
        self._question.close_sheet()
        self.setFocus()
        if yes and asked is not None:
            self._send(asked, stated=True)

    def _choose(self, number: int) -> None:
        self._chosen = number
        for row in self._rows:
            set_property(row, 'chosen', 'true' if row.number == number else 'false')
            if row.number == number:
                self._scroll.ensureWidgetVisible(row, 0, 0)
        if self._race is not None:
            for kart in self._race.karts:
                if kart.number == number:
                    self._say(words.KART_CHOSEN.format(number=number, team=kart.team))
        self._refresh()

    def _choose_next(self, step: int) -> None:
        numbers = [row.number for row in self._rows]
        if numbers:
            place = numbers.index(self._chosen) + step if self._chosen in numbers else 0
            self._choose(numbers[max(0, min(place, len(numbers) - 1))])

    def _filter_log(self, place: int) -> None:
        self._log_kart = self._rows[place - 1].number if 0 < place <= len(self._rows) else 0
        lines = [str(line) for line in self._log.lines(self._log_kart)]
        self._log_view.setPlainText('\n'.join(lines))
        self._log_view.moveCursor(QtGui.QTextCursor.MoveOperation.End)

    def _see(self, number: int) -> None:
        self._book.see(number)
        self._show_alerts()

    def _see_all(self) -> None:
        self._book.see_all()
        self._show_alerts()

    def _toggle_sound(self) -> None:
        self._muted = not self._muted
        self._sounded = 0.0
        self._mute.setText(f'{words.SOUND_OFF if self._muted else words.SOUND_ON}  F11')

    # ----- keys ---------------------------------------------------------------------------

    def eventFilter(  # noqa: N802 - Qt's name
        self, watched: QtCore.QObject, event: QtCore.QEvent
    ) -> bool:
        """Take the keys before any widget does, and see what is pointed at."""
        kind = event.type()
        if kind == QtCore.QEvent.Type.KeyPress and isinstance(watched, QtGui.QWindow):
            assert isinstance(event, QtGui.QKeyEvent)
            return self._take_key(event)
        if isinstance(watched, CommandButton):
            if kind in (QtCore.QEvent.Type.Enter, QtCore.QEvent.Type.FocusIn):
                self._pointed = watched
                self._show_status()
            elif (
                kind in (QtCore.QEvent.Type.Leave, QtCore.QEvent.Type.FocusOut)
                and self._pointed is watched
            ):
                self._pointed = None
                self._show_status()
        return False

    def _take_key(self, event: QtGui.QKeyEvent) -> bool:
        """Return whether the key is used up."""
        plain = QtGui.QKeySequence(event.key()).toString()
        if plain in keys.KILL_KEYS:
            if not event.isAutoRepeat():
                self._press_kill()
            return True
        if QtWidgets.QApplication.activePopupWidget() is not None:
            return False
        name = QtGui.QKeySequence(event.keyCombination()).toString()
        if event.modifiers() & QtCore.Qt.KeyboardModifier.KeypadModifier:
            name = plain
        stroke = keys.meaning(name)
        if self._question.isVisible():
            return self._take_answer_key(name, stroke, event.isAutoRepeat())
        if stroke is None:
            return False
        if event.isAutoRepeat() and stroke.act not in (Act.UP, Act.DOWN):
            return True
        if stroke.act is not None:
            return self._do(stroke.act)
        if stroke.digit:
            self._type(stroke.digit)
        else:
            self._press_by_key(stroke)
        return True

    def _take_answer_key(self, name: str, stroke: keys.Stroke | None, again: bool) -> bool:
        if again:
            return True
        if name in ('N', 'Esc'):
            self._answer_question(False)
        elif name == 'Y' and self._question.yes.isEnabled():
            self._answer_question(True)
        elif name in ('Tab', 'Up', 'Down', 'Left', 'Right', 'Shift+Backtab'):
            other = self._question.yes if self._question.no.hasFocus() else self._question.no
            (other if other.isEnabled() else self._question.no).setFocus()
        elif stroke is not None and stroke.act is Act.PRESS:
            self._do(Act.PRESS)
        elif stroke is not None and stroke.commands == (Command.RED_FLAG,):
            self._press_by_key(stroke)  # a stop never waits for an answer
        return True

    def _press_by_key(self, stroke: keys.Stroke) -> None:
        assert self._screen is not None
        kart = 0
        if stroke.finish is not None:
            if stroke.finish >= len(self._rows):
                return
            kart = self._rows[stroke.finish].number
        elif stroke.to_chosen:
            kart = self._chosen
            if not kart:
                self._say(words.CHOOSE_FIRST, Tone.WAIT)
                return
        found = (self._screen.button(command, kart) for command in stroke.commands)
        button = next((each for each in found if each is not None), None)
        if button is not None:
            self._pressed(button)
        elif stroke.commands and stroke.commands[0] is Command.OPEN_TRACK:
            self._say(words.TRACK_OPEN)
        elif stroke.commands and stroke.commands[0] is Command.CLOSE_TRACK:
            self._say(words.TRACK_CLOSED)

    def _type(self, digit: str) -> None:
        numbers = [row.number for row in self._rows]
        number = self._typed.add(digit, time.monotonic())
        if number in numbers:
            self._choose(number)
        elif not any(str(each).startswith(str(number)) for each in numbers):
            self._say(words.NO_SUCH_KART.format(number=number), Tone.WAIT)

    def _do(self, act: Act) -> bool:
        focused = QtWidgets.QApplication.focusWidget()
        if act is Act.HELP:
            self._help.setVisible(not self._help.isVisible())
            self._place_sheets()
        elif act is Act.SEEN:
            if self._book.unseen:
                self._see(self._book.unseen[0].number)
        elif act is Act.SOUND:
            self._toggle_sound()
        elif act is Act.UP:
            self._choose_next(-1)
        elif act is Act.DOWN:
            self._choose_next(1)
        elif act is Act.LOG:
            numbers = [row.number for row in self._rows]
            chosen = numbers.index(self._chosen) + 1 if self._chosen in numbers else 0
            self._filter.setCurrentIndex(0 if self._filter.currentIndex() else chosen)
        elif act is Act.PRESS:
            if isinstance(focused, QtWidgets.QAbstractButton):
                focused.click()
            elif isinstance(focused, QtWidgets.QComboBox):
                focused.showPopup()
        elif act is Act.CANCEL:
            self._help.close_sheet()
            self.setFocus()
        return True

    # ----- how it is laid out -------------------------------------------------------------

    def _build(self) -> None:
        self.setFocusPolicy(QtCore.Qt.FocusPolicy.StrongFocus)
        self._silence_panel = SilencePanel()
        self._now_panel = self._build_now()
        self._kill_box = self._build_kill()
        top = QtWidgets.QHBoxLayout()
        top.addWidget(self._silence_panel, 1)
        top.addWidget(self._now_panel, 1)
        # It stays where it is when what is beside it grows.
        top.addWidget(self._kill_box, 0, QtCore.Qt.AlignmentFlag.AlignTop)
        self._banner = Banner()
        self._banner.hide()
        self._banner.seen.connect(self._see)
        self._banner.all_seen.connect(self._see_all)
        self._quiet_alerts = Elided('standing', fill='true')
        self._mute = QtWidgets.QPushButton(f'{words.SOUND_ON}  F11')
        self._mute.setObjectName('mute')
        self._mute.clicked.connect(self._toggle_sound)
        alerts = QtWidgets.QHBoxLayout()
        alerts.addWidget(self._quiet_alerts, 1)
        alerts.addWidget(self._mute)
        middle = QtWidgets.QHBoxLayout()
        middle.addLayout(self._build_karts(), 1)
        self._side = self._build_side()
        middle.addWidget(self._side)
        self._status = Elided('status')
        self._layout = QtWidgets.QVBoxLayout(self)
        # The window never grows beyond the screen to make room for a text.
        self._layout.setSizeConstraint(QtWidgets.QLayout.SizeConstraint.SetNoConstraint)
        self._layout.addLayout(top)
        self._layout.addLayout(alerts)
        self._layout.addLayout(middle, 1)
        self._layout.addLayout(self._build_log())
        self._layout.addWidget(self._status)
        self._question = Question(self)
        self._question.answered.connect(self._answer_question)
        self._help = Help(self)

    def _build_now(self) -> QtWidgets.QWidget:
        self._state = Label('state')
        self._state.setAlignment(QtCore.Qt.AlignmentFlag.AlignCenter)
        self._since = Label('state_since')
        self._since.setAlignment(QtCore.Qt.AlignmentFlag.AlignCenter)
        self._humans = Label('humans', fill='true')
        self._humans_reason = Label('humans_reason')
        self._humans_reason.setWordWrap(True)
        self._track = Label('track')
        self._track_button = CommandButton(self._pressed)
        panel = QtWidgets.QWidget()
        layout = QtWidgets.QHBoxLayout(panel)
        layout.setContentsMargins(0, 0, 0, 0)
        left = QtWidgets.QVBoxLayout()
        left.setSpacing(2)
        left.addWidget(self._state, 1)
        left.addWidget(self._since)
        layout.addLayout(left, 1)
        right = QtWidgets.QVBoxLayout()
        right.setSpacing(2)
        right.addWidget(self._humans)
        right.addWidget(self._humans_reason, 1)
        track = QtWidgets.QHBoxLayout()
        track.addWidget(self._track, 1)
        track.addWidget(self._track_button)
        right.addLayout(track)
        layout.addLayout(right, 1)
        return panel

    def _build_kill(self) -> QtWidgets.QWidget:
        self._kill = QtWidgets.QPushButton(words.LABELS[Command.ALL_KILL])
        self._kill.setObjectName('all_kill')
        # On the press, not on the release: a hand that slips off has pressed it all the same.
        self._kill.pressed.connect(self._press_kill)
        self._kill.setSizePolicy(
            QtWidgets.QSizePolicy.Policy.Preferred, QtWidgets.QSizePolicy.Policy.Expanding
        )
        self._kill_hint = Label('kill_hint', fill='true')
        self._kill_hint.setAlignment(QtCore.Qt.AlignmentFlag.AlignCenter)
        frame = QtWidgets.QFrame()
        frame.setObjectName('kill_frame')
        column(frame, self._kill).setContentsMargins(3, 3, 3, 3)
        box = QtWidgets.QWidget()
        column(box, frame, self._kill_hint).setSpacing(2)
        return box

    def _build_karts(self) -> QtWidgets.QLayout:
        self._heading = Heading()
        self._overview = Overview()
        self._overview.chosen.connect(self._choose)
        self._overview.hide()
        inside = QtWidgets.QWidget()
        inside.setObjectName('rows')
        self._rows_layout = QtWidgets.QVBoxLayout(inside)
        self._rows_layout.setContentsMargins(0, 0, 0, 0)
        self._rows_layout.setSpacing(0)
        self._rows_layout.addStretch(1)
        self._scroll = QtWidgets.QScrollArea()
        self._scroll.setWidgetResizable(True)
        self._scroll.setWidget(inside)
        self._scroll.setFocusPolicy(QtCore.Qt.FocusPolicy.NoFocus)
        self._scroll.setVerticalScrollBarPolicy(QtCore.Qt.ScrollBarPolicy.ScrollBarAsNeeded)
        self._scroll.setHorizontalScrollBarPolicy(QtCore.Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        layout = QtWidgets.QVBoxLayout()
        layout.setSpacing(1)
        layout.addWidget(self._banner)
        layout.addWidget(self._overview)
        layout.addWidget(self._heading)
        layout.addWidget(self._scroll, 1)
        return layout

    def _build_side(self) -> QtWidgets.QWidget:
        side = QtWidgets.QWidget()
        in_race = Label(section='true')
        in_race.setText(words.IN_RACE)
        all_karts = Label(section='true')
        all_karts.setText(words.ALL_KARTS)
        self._race_buttons = [RaceButton(self._pressed, lines) for lines in REASON_LINES]
        self._msr_button = RaceButton(self._pressed, 0)
        layout = QtWidgets.QVBoxLayout(side)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(2)
        layout.addWidget(in_race)
        for button, lines in zip(self._race_buttons, REASON_LINES, strict=True):
            layout.addWidget(button, 10 * lines)
        layout.addWidget(all_karts)
        layout.addWidget(self._msr_button)
        layout.addStretch(1)
        return side

    def _build_log(self) -> QtWidgets.QLayout:
        self._log_view = QtWidgets.QPlainTextEdit()
        self._log_view.setObjectName('log')
        self._log_view.setReadOnly(True)
        self._log_view.setTabChangesFocus(True)
        self._log_view.setMaximumBlockCount(2000)
        self._log_view.setLineWrapMode(QtWidgets.QPlainTextEdit.LineWrapMode.NoWrap)
        self._filter = QtWidgets.QComboBox()
        self._filter.setObjectName('filter')
        self._filter.addItem(words.EVERY_KART)
        self._filter.currentIndexChanged.connect(self._filter_log)
        title = Label(section='true')
        title.setText(words.LOG)
        left = QtWidgets.QVBoxLayout()
        left.setSpacing(2)
        left.addWidget(title)
        left.addWidget(self._filter)
        left.addStretch(1)
        layout = QtWidgets.QHBoxLayout()
        layout.addLayout(left)
        layout.addWidget(self._log_view, 1)
        return layout

    def resizeEvent(self, event: QtGui.QResizeEvent) -> None:  # noqa: N802 - Qt's name
        """Take the size of the window."""
        super().resizeEvent(event)
        self._fit()
        self._place_sheets()

    def _fit(self) -> None:
        by = style.scale(self.width(), self.height())
        if abs(by - self._by) < 0.02:
            return
        self._by = by
        self.setStyleSheet(style.sheet(by))
        self._layout.setContentsMargins(*[round(6 * by)] * 4)
        self._layout.setSpacing(round(4 * by))
        self._kill_box.setFixedSize(round(340 * by), round(128 * by))
        self._now_panel.setFixedHeight(round(128 * by))
        self._side.setFixedWidth(round(250 * by))
        self._filter.setFixedWidth(round(190 * by))
        self._log_view.setFixedHeight(round(max(76 * by, 0.12 * self.height() - 20)))
        self._status.setFixedHeight(round(28 * by))
        self._quiet_alerts.setFixedHeight(round(26 * by))
        self._track_button.setFixedHeight(round(36 * by))
        self._heading.fit(by)
        self._overview.fit(by)
        for button in [*self._race_buttons, self._msr_button]:
            button.fit(by)
        for row in self._rows:
            row.fit(by)

    def _place_sheets(self) -> None:
        for sheet in (self._question, self._help):
            if sheet.isVisible():
                # Over the karts, clear of ALL KILL above and of the stops at the side.
                room = self._scroll.width()
                sheet.setFixedWidth(min(room, round(900 * self._by)))
                sheet.adjustSize()
                corner = self._scroll.mapTo(self, QtCore.QPoint(0, 0))
                sheet.move(
                    corner.x() + (room - sheet.width()) // 2,
                    min(corner.y() + 8, max(0, self.height() - sheet.height() - 8)),
                )
                sheet.raise_()

    def closeEvent(self, event: QtGui.QCloseEvent) -> None:  # noqa: N802 - Qt's name
        """Tidy up."""
        self._timer.stop()
        self._sound.close()
        super().closeEvent(event)
