"""
The officials' window.

Everything here runs in the Qt thread. What ROS hears comes in through the signals of ``Inbox``,
which Qt queues; commands go out through ``give``, which returns at once.
"""

from __future__ import annotations

from collections.abc import Callable
import time

from evgp_protocol import clock
from evgp_rcs_console import keys, style, words
from evgp_rcs_console.commands import FORMS, Order
from evgp_rcs_console.freshness import Beat, InputClock, Repeats, STALE
from evgp_rcs_console.keys import Act
from evgp_rcs_console.notices import AlertBook, concerns, EventLog
from evgp_rcs_console.outcome import Outcome
from evgp_rcs_console.qt import QtCore, QtGui, QtWidgets, Signal
from evgp_rcs_console.snapshot import Answer, Command, Event, Race
from evgp_rcs_console.sound import Sound
from evgp_rcs_console.standing import Standing
from evgp_rcs_console.view import (
    ANSWER_KEYS,
    Button,
    Cell,
    Danger,
    danger,
    NOTHING,
    Screen,
    show,
    silence,
    Tone,
)
from evgp_rcs_console.widgets import (
    Banner,
    column,
    CommandButton,
    DangerPanel,
    Elided,
    Heading,
    Heats,
    Help,
    KartRow,
    Label,
    Overview,
    Question,
    RaceButton,
    set_property,
    set_text,
)

Give = Callable[[Order], None]

LOOK = 100
"""How often the window looks whether race control is still heard, and what waits, ms."""

LATE = 0.3
"""Time after which a stop that is not answered is worth a word, in seconds."""

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

    race = Signal(object, float, bool)
    event = Signal(object)
    answer = Signal(object, object)
    pressing = Signal(object)

    def on_race(self, race: Race, at: float, two: bool) -> None:
        """Hand over a snapshot."""
        self.race.emit(race, at, two)

    def on_event(self, event: Event) -> None:
        """Hand over an event."""
        self.event.emit(event)

    def on_answer(self, order: Order, answer: Answer) -> None:
        """Hand over an answer."""
        self.answer.emit(order, answer)

    def on_pressing(self, stops: tuple[Standing, ...]) -> None:
        """Hand over the stops that are being pressed."""
        self.pressing.emit(stops)


class ConsoleWindow(QtWidgets.QWidget):
    """
    The window of one official.

    :param inbox: where what is heard comes from.
    :param give: gives a command.
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
        self._began = clock.now()
        self._race: Race | None = None
        self._two = False
        self._heard_at = 0.0
        self._shown_at = 0.0
        self._screen: Screen | None = None
        self._danger_title = ''
        self._orders: dict[tuple[Command, int], Order] = {}
        self._stops: tuple[Standing, ...] = ()
        self._input_clock = InputClock()
        self._beat = Beat(LOOK / 1000, clock.now())
        self._repeats = Repeats()
        self._dropped: list[str] = []
        self._book = AlertBook()
        self._log = EventLog()
        self._log_kart = 0
        self._chosen = 0
        self._typed = keys.Typed()
        self._message = Cell(words.READY)
        self._outcome: Outcome | None = None
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

    def _take_race(self, race: Race, at: float, two: bool) -> None:
        self._race = race
        self._heard_at = at
        self._two = two
        if self._book.update(race.alerts, two):
            self._sounded = 0.0
        if self._outcome is not None and not self._outcome.stands(race, at):
            what = words.now_so(self._outcome.order, race)
            self._say(words.NOW.format(clock=_clock(), what=what))
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
        said = words.ANSWERED.format(clock=_clock(), mark=mark, answer=answer.message)
        self._say(said, tone)
        if answer.success:
            self._outcome = Outcome(order, clock.now())
        self._refresh()

    def _take_pressing(self, stops: tuple[Standing, ...]) -> None:
        self._stops = stops
        self._show_kill()
        self._show_status()

    # ----- what time does -----------------------------------------------------------------

    def _look(self) -> None:
        now = clock.now()
        self._beat.beat(now)
        danger_now = self._danger(now)
        title = danger_now.title if danger_now else ''
        changed = title != self._danger_title
        if title or changed or self._orders or now - self._shown_at >= AGES:
            self._refresh()
        if self._stops:
            self._show_kill()
            self._show_status()
        alarming = danger_now is not None and self._race is not None
        due = now - self._sounded >= SOUND_AGAIN
        if (self._book.unseen or alarming) and due and not self._muted:
            self._sounded = now
            self._sound.play()
        self._show_keys_reach()

    def _danger(self, now: float) -> Danger | None:
        race = self._race or NOTHING
        silent_for = now - self._heard_at if self._race is not None else None
        looking_for = now - self._began
        return silence(silent_for, looking_for, self._topic, self._domain, race.state) or danger(
            race, self._two
        )

    # ----- what is shown ------------------------------------------------------------------

    def _refresh(self) -> None:
        now = clock.now()
        self._shown_at = now
        danger_now = self._danger(now)
        title = danger_now.title if danger_now else ''
        if title != self._danger_title:
            self._danger_title = title
            self._sounded = 0.0
        self._danger_panel.setVisible(danger_now is not None)
        self._now_panel.setVisible(danger_now is None)
        if danger_now is not None:
            self._danger_panel.show_danger(danger_now)
        pending = {key: now - order.at for key, order in self._orders.items()}
        screen = show(self._race or NOTHING, now - self._heard_at, pending, danger_now)
        self._screen = screen
        stale = danger_now is not None and danger_now.stale
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
        self._heat_button.setVisible(screen.heat_button is not None)
        if screen.heat_button is not None:
            self._heat_button.show_button(screen.heat_button)
        self._heats.show_heats(screen.heats)
        self._show_rows(screen, stale)
        self._show_alerts()
        if self._question.isVisible() and self._question.button is not None:
            asked = self._question.button
            self._question.update_button(screen.button(asked.command, asked.kart))
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
        stop = next((s for s in self._stops if s.order.command is Command.ALL_KILL), None)
        late = clock.now() - stop.since if stop else 0.0
        # The first moment of a press that is about to be answered is not worth a word.
        waits = late > LATE
        set_property(self._kill, 'pressing', 'true' if waits else 'false')
        if stop is not None and waits:
            detail = words.KILL_PRESSING.format(count=stop.presses, age=words.short_age(late))
            self._kill_hint.show_cell(Cell(detail, Tone.BAD))
        else:
            self._show_keys_reach()

    def _show_keys_reach(self) -> None:
        if self._kill.property('pressing') == 'true':
            return
        reached = self.isActiveWindow() or QtWidgets.QApplication.activePopupWidget() is not None
        self._kill_hint.show_cell(
            Cell(words.KILL_HINT) if reached else Cell(words.KEYS_OFF, Tone.BAD)
        )

    def _show_status(self) -> None:
        pressing = self._pressing()
        if pressing:
            self._status.show_text(pressing)
            set_property(self._status, 'tone', 'bad')
            return
        pointed = self._pointed
        if pointed is not None and pointed.button is not None and pointed.button.reason:
            self._status.show_text(pointed.button.explanation)
            set_property(self._status, 'tone', 'wait')
            return
        now = clock.now()
        waiting = [(now - order.at, words.order_name(order)) for order in self._orders.values()]
        if waiting and max(waiting)[0] > 0.3:
            late, name = max(waiting)
            text = words.PENDING.format(command=name, age=words.short_age(late))
            self._status.show_text(text)
            set_property(self._status, 'tone', 'wait')
            return
        self._status.show_text(self._message.text)
        set_property(self._status, 'tone', self._message.tone.value)

    def _pressing(self) -> str:
        """Return what is to be said of the stops that are pressed again, but for ALL KILL."""
        now = clock.now()
        return '  '.join(
            words.STOP_PRESSING.format(
                command=words.command_name(stop.order.command, stop.order.kart),
                count=stop.presses,
                age=words.short_age(now - stop.since),
                why=stop.said or words.NO_ANSWER,
            )
            for stop in self._stops
            if stop.order.command is not Command.ALL_KILL and now - stop.since > LATE
        )

    def _say(self, text: str, tone: Tone = Tone.PLAIN) -> None:
        self._message = Cell(text, tone)
        self._outcome = None
        self._pointed = None
        self._show_status()

    # ----- what the official does ---------------------------------------------------------

    def _press_kill(self) -> None:
        self._give(Order(Command.ALL_KILL))

    def _pressed(self, button: Button) -> None:
        """Give the command of a button, ask for its confirmation, or say why it is not allowed."""
        if not button.enabled:
            self._say(button.explanation, Tone.WAIT)
        elif button.command is Command.SET_HEAT and not button.heat:
            self._help.close_sheet()
            self._heats.open_sheet()
            self._place_sheets()
        elif button.condition:
            self._help.close_sheet()
            self._heats.close_sheet()
            self._question.ask(button)
            self._place_sheets()
        else:
            self._send(button)

    def _send(self, button: Button) -> None:
        order = button.order()
        self._give(order)
        if not FORMS[order.command].stop:  # of the stops the client tells what waits
            self._orders[order.command, order.kart] = order
        self._say(words.GIVEN.format(clock=_clock(), command=words.order_name(order)))
        self._refresh()

    def _answer_question(self, yes: bool) -> None:
        asked = self._question.button
        # Hidden first: a second press of the same key must find nothing to answer.
        self._question.close_sheet()
        self.setFocus()
        if yes and asked is not None:
            self._send(asked)

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

    # ----- keys and clicks ----------------------------------------------------------------

    def eventFilter(  # noqa: N802 - Qt's name
        self, watched: QtCore.QObject, event: QtCore.QEvent
    ) -> bool:
        """Take keys and clicks before any widget does, and see what is pointed at."""
        kind = event.type()
        if isinstance(watched, QtGui.QWindow):
            if kind == QtCore.QEvent.Type.KeyPress:
                assert isinstance(event, QtGui.QKeyEvent)
                return self._take_key(event)
            if isinstance(event, QtGui.QMouseEvent):
                return self._take_mouse(event)
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

    def _age(self, event: QtGui.QInputEvent) -> float:
        """Return for how long a key or click has waited, at least, in seconds."""
        waited = self._input_clock.age(event.timestamp(), time.monotonic())
        return max(waited, self._beat.held_up(clock.now()))

    def _drop(self, name: str, age: float) -> bool:
        """Say that a key or click was too old; return that it is used up."""
        self._dropped = [*self._dropped[-4:], name]
        names = ', '.join(self._dropped)
        self._say(words.TOO_OLD.format(name=names, age=words.age(age)), Tone.BAD)
        return True

    def _take_mouse(self, event: QtGui.QMouseEvent) -> bool:
        """Return whether a movement or a click is used up."""
        age = self._age(event)
        kind = event.type()
        if kind == QtCore.QEvent.Type.MouseButtonRelease:
            if age >= STALE:
                self._let_go(age)
            return False
        double = kind == QtCore.QEvent.Type.MouseButtonDblClick
        if not double and kind != QtCore.QEvent.Type.MouseButtonPress:
            return False
        target = QtWidgets.QApplication.widgetAt(event.globalPosition().toPoint())
        if self._is_stop(target) or _chooses(target):
            return False
        if age >= STALE:
            return self._drop(_name(target), age)
        self._dropped.clear()
        if target is self._question.yes and not self._question.settled:
            return True
        # The second press of a double click is not meant for what stands there by now.
        return double and isinstance(target, QtWidgets.QAbstractButton)

    def _let_go(self, age: float) -> None:
        """Have a button that was pressed in time, and released too late, do nothing."""
        for button in self.findChildren(QtWidgets.QAbstractButton):
            if button.isDown() and not self._is_stop(button):
                button.setDown(False)
                self._drop(_name(button), age)

    def _is_stop(self, widget: QtWidgets.QWidget | None) -> bool:
        if isinstance(widget, CommandButton) and widget.button is not None:
            return FORMS[widget.button.command].stop
        return widget is self._kill

    def _take_key(self, event: QtGui.QKeyEvent) -> bool:
        """Return whether the key is used up."""
        age = self._age(event)
        plain = QtGui.QKeySequence(event.key()).toString()
        if plain in keys.KILL_KEYS:
            if not event.isAutoRepeat():
                self._press_kill()
            return True
        name = QtGui.QKeySequence(event.keyCombination()).toString()
        if event.modifiers() & QtCore.Qt.KeyboardModifier.KeypadModifier:
            name = plain
        stroke = keys.meaning(name)
        if age >= STALE and not self._acts_late(stroke):
            # What means nothing here, as Shift alone, is not worth a word.
            named = stroke is not None or self._question.isVisible()
            return self._drop(name, age) if named and not event.isAutoRepeat() else True
        self._dropped.clear()
        if QtWidgets.QApplication.activePopupWidget() is not None:
            return False
        at = clock.now() - age
        means = stroke is not None or name in ANSWER_KEYS
        twice = means and not event.isAutoRepeat() and self._repeats.same_press(name, at)
        if self._question.isVisible():
            return event.isAutoRepeat() or self._take_answer_key(name, stroke, at)
        if stroke is None:
            return name in ANSWER_KEYS
        if event.isAutoRepeat() and stroke.act not in (Act.UP, Act.DOWN):
            return True
        if stroke.act is not None:
            return self._do(stroke.act)
        if stroke.digit:
            self._type(stroke.digit)
        elif stroke.stop or not twice:
            self._press_by_key(stroke)
        return True

    def _acts_late(self, stroke: keys.Stroke | None) -> bool:
        """Return whether a key acts however old it is: a stop, and choosing a kart for one."""
        if stroke is None:
            return False
        if stroke.act is Act.PRESS:
            return self._is_stop(QtWidgets.QApplication.focusWidget())
        return stroke.stop or bool(stroke.digit) or stroke.act in (Act.UP, Act.DOWN)

    def _take_answer_key(self, name: str, stroke: keys.Stroke | None, at: float) -> bool:
        question = self._question
        yes_by_enter = stroke is not None and stroke.act is Act.PRESS and question.yes.hasFocus()
        if name in ('N', 'Esc'):
            self._answer_question(False)
        elif name == 'Y' or yes_by_enter:
            if at < question.shown_at:
                self._say(words.TOO_EARLY.format(name=name), Tone.BAD)
            elif question.yes.isEnabled():
                self._answer_question(True)
        elif name in ('Tab', 'Up', 'Down', 'Left', 'Right', 'Shift+Backtab'):
            other = question.yes if question.no.hasFocus() else question.no
            (other if other.isEnabled() else question.no).setFocus()
        elif stroke is not None and stroke.act is Act.PRESS:
            self._do(Act.PRESS)
        elif stroke is not None and stroke.digit:
            self._type(stroke.digit)
        elif stroke is not None and stroke.stop and not stroke.asks:
            self._press_by_key(stroke)  # a stop never waits for an answer
        elif stroke is not None:
            self._say(words.ANSWER_FIRST, Tone.WAIT)
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
        number = self._typed.add(digit, clock.now())
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
            self._heats.close_sheet()
            self.setFocus()
        return True

    # ----- how it is laid out -------------------------------------------------------------

    def _build(self) -> None:
        self.setFocusPolicy(QtCore.Qt.FocusPolicy.StrongFocus)
        self._danger_panel = DangerPanel()
        self._now_panel = self._build_now()
        self._kill_box = self._build_kill()
        top = QtWidgets.QHBoxLayout()
        top.addWidget(self._danger_panel, 1)
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
        self._heats = Heats(self, self._pressed)

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
        heading = QtWidgets.QHBoxLayout()
        heading.addWidget(in_race, 1)
        self._heat_button = CommandButton(self._pressed)
        self._heat_button.hide()
        heading.addWidget(self._heat_button)
        layout.addLayout(heading)
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
        self._heat_button.setFixedHeight(round(26 * by))
        self._heading.fit(by)
        self._overview.fit(by)
        for button in [*self._race_buttons, self._msr_button]:
            button.fit(by)
        for row in self._rows:
            row.fit(by)

    def _place_sheets(self) -> None:
        for sheet in (self._question, self._help, self._heats):
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


def _clock() -> str:
    """Return the wall time, as an official reads it."""
    return time.strftime('%H:%M:%S')


def _chooses(widget: QtWidgets.QWidget | None) -> bool:
    """Return whether a press there only chooses a kart: a stop for it may be next."""
    while widget is not None and not isinstance(widget, QtWidgets.QAbstractButton):
        if isinstance(widget, (KartRow, Overview)):
            return True
        widget = widget.parentWidget()
    return False


def _name(widget: QtWidgets.QWidget | None) -> str:
    """Return what is said of a click on a widget."""
    if isinstance(widget, CommandButton) and widget.button is not None:
        return words.command_name(widget.button.command, widget.button.kart)
    if isinstance(widget, QtWidgets.QAbstractButton):
        return widget.text()
    return words.CLICK
