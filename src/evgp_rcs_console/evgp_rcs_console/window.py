"""
The officials' window.

Everything here runs in the Qt thread. What ROS hears comes in through the signals of ``Inbox``,
which Qt queues; commands go out through ``give``, which returns at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
from dataclasses import dataclass
import time

from evgp_protocol import clock
from evgp_rcs.catalogue import CATALOGUE, CommandKind
from evgp_rcs_console import keys, style, words
from evgp_rcs_console.alerts import AlertsArea
from evgp_rcs_console.commands import Order
from evgp_rcs_console.freshness import Aim, Beat, InputClock, Repeats, STALE
from evgp_rcs_console.karts import chooses, KartList
from evgp_rcs_console.keys import Act
from evgp_rcs_console.notices import AlertBook
from evgp_rcs_console.outcome import Outcome
from evgp_rcs_console.panels import EventPanel, KillBox, NowPanel, SidePanel, TOP_HEIGHT
from evgp_rcs_console.qt import QtCore, QtGui, QtWidgets, Signal
from evgp_rcs_console.sheets import Heats, Help, Question
from evgp_rcs_console.snapshot import Answer, Event, Race
from evgp_rcs_console.sound import Sound
from evgp_rcs_console.standing import Standing
from evgp_rcs_console.view import (
    ANSWER_KEYS,
    Button,
    Cell,
    Danger,
    danger,
    KILL_NOTES,
    NOTHING,
    ReasonTimes,
    Screen,
    show,
    silence,
    Tone,
)
from evgp_rcs_console.widgets import CommandButton, DangerPanel, Fitted

Give = Callable[[Order], None]

LOOK = 100
"""How often the window looks whether race control is still heard, and what waits, ms."""

LATE = 0.3
"""Time after which a stop that is not answered is worth a word, in seconds."""

AGES = 1.0
"""How often ages are shown anew, seconds."""

SOUND_AGAIN = 4.0
"""How often the sound comes again while an alert is not seen, seconds."""


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


@dataclass(frozen=True)
class Shown:
    """What an official had in front of them: the screen, and where each command's button was."""

    screen: Screen
    buttons: tuple[tuple[CommandButton, QtGui.QRegion, Button], ...]

    def at(self, point: QtCore.QPoint) -> Button | None:
        """Return the command at a point of the screen."""
        return next((each for _, place, each in self.buttons if place.contains(point)), None)

    def of(self, widget: QtWidgets.QWidget) -> Button | None:
        """Return the command that a button had."""
        return next((each for button, _, each in self.buttons if button is widget), None)


class ConsoleWindow(QtWidgets.QWidget):
    """
    The window of one official.

    :param inbox: where what is heard comes from.
    :param give: gives a command.
    :param looking: where race control is looked for, as a sentence says it.
    """

    def __init__(self, inbox: Inbox, give: Give, looking: str) -> None:
        """Show that race control is being looked for."""
        super().__init__()
        self.setObjectName('window')
        self.setWindowTitle(words.TITLE)
        self._give = give
        self._looking = looking
        self._began = clock.now()
        self._race: Race | None = None
        self._two = False
        self._heard_at = 0.0
        self._shown_at = 0.0
        self._screen: Screen | None = None
        self._danger_title = ''
        self._orders: dict[tuple[CommandKind, int], Order] = {}
        self._stops: tuple[Standing, ...] = ()
        self._input_clock = InputClock()
        self._beat = Beat(LOOK / 1000, clock.now())
        self._repeats = Repeats()
        self._dropped: list[str] = []
        self._book = AlertBook()
        self._field = keys.KartField()
        self._marked = 0
        self._aim: Aim[Shown] = Aim()
        self._message = Cell(words.READY)
        self._outcome: Outcome | None = None
        self._changed: tuple[Order, str] | None = None
        self._reasons = ReasonTimes()
        self._pointed: CommandButton | Fitted | None = None
        self._sound = Sound()
        self._muted = False
        self._sounded = 0.0
        self._by = 0.0
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
            order = self._outcome.order
            self._say(words.CHANGED.format(clock=_clock(), what=words.now_so(order, race)))
            self._changed = order, words.now_so(order, race)
        elif self._changed is not None:
            order, said = self._changed
            what = words.now_so(order, race)
            if what != said:
                self._changed = order, what
                self._message = Cell(words.CHANGED.format(clock=_clock(), what=what))
        self._refresh()

    def _take_event(self, event: Event) -> None:
        self._events.add(event)

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
        self._show_kill()
        if self._stops:
            self._show_status()
        alarming = danger_now is not None and self._race is not None
        due = now - self._sounded >= SOUND_AGAIN
        if (self._book.unseen or alarming) and due and not self._muted:
            self._sounded = now
            self._sound.play()
        # What was typed while the window hung is taken before it is too old.
        if not self._beat.held_up(now):
            self._field.expire(now)
            self._follow_field()

    def _danger(self, now: float) -> Danger | None:
        race = self._race or NOTHING
        silent_for = now - self._heard_at if self._race is not None else None
        looking_for = now - self._began
        said = silence(silent_for, looking_for, self._looking, race.state, KILL_NOTES)
        return said or danger(race, self._two)

    # ----- what is shown ------------------------------------------------------------------

    def _refresh(self) -> None:
        now = clock.now()
        self._shown_at = now
        danger_now = self._danger(now)
        title = danger_now.title if danger_now else ''
        if title != self._danger_title:
            self._danger_title = title
            self._sounded = 0.0
        pending = {key: now - order.at for key, order in self._orders.items()}
        race = self._race or NOTHING
        reasons = self._reasons.update(race.commands, now)
        screen = show(race, now - self._heard_at, pending, danger_now, reasons)
        before = self._screen
        if before is not None and before.rows and _commands(before) != _commands(screen):
            self._aim.change(self._shown(before), now)
        self._screen = screen
        if self._heats.isVisible() and before is not None and _heats(before) != _heats(screen):
            # What was chosen from is gone; and a click on its way must not hit what is below.
            self._aim.change(self._shown(before), now)
            self._heats.close_sheet()
            self._say(words.HEATS_CHANGED, Tone.BAD)
        self._danger_panel.setVisible(danger_now is not None)
        self._now_panel.setVisible(danger_now is None)
        if danger_now is not None:
            self._danger_panel.show_danger(danger_now)
        stale = danger_now is not None and danger_now.stale
        self._now_panel.show_screen(screen, stale)
        self._side.show_screen(screen)
        self._heats.show_heats(screen.heats)
        self._field.show_roster({row.number: row.team for row in screen.rows})
        self._show_field()
        self._marked = self._field.kart
        self._karts.show_rows(screen.rows, self._marked, stale)
        self._events.show_karts(screen.rows)
        self._show_alerts()
        if self._question.isVisible() and self._question.button is not None:
            asked = self._question.button
            self._question.update_button(screen.button(asked.command, asked.kart))
        self._show_kill()
        self._show_status()

    def _shown(self, screen: Screen) -> Shown:
        """Return what is in front of the official."""
        buttons = []
        sheets = [each for each in (self._question, self._help, self._heats) if each.isVisible()]
        for button in self.findChildren(CommandButton):
            if button.button is not None and button.isVisible():
                corner = button.mapToGlobal(QtCore.QPoint(0, 0))
                seen = button.visibleRegion().translated(corner)
                for sheet in sheets:
                    if not sheet.isAncestorOf(button):
                        above = sheet.rect().translated(sheet.mapToGlobal(QtCore.QPoint(0, 0)))
                        seen = seen.subtracted(QtGui.QRegion(above))
                buttons.append((button, seen, button.button))
        return Shown(screen, tuple(buttons))

    @contextlib.contextmanager
    def _scrolling(self) -> Iterator[None]:
        """Take that the window scrolls the karts by itself: other buttons come below the hand."""
        before = self._shown(self._screen) if self._screen is not None else None
        bar = self._karts.scroll.verticalScrollBar()
        value = bar.value()
        yield
        if before is not None and bar.value() != value:
            self._aim.change(before, clock.now())

    def _show_field(self) -> None:
        self._side.number_field.show_cells(*self._field.cells())

    def _show_alerts(self, own: bool = False) -> None:
        known = self._screen is not None and not (
            self._screen.danger is not None and self._screen.danger.stale
        )
        self._alerts.show_notices(self._book.shown, own, known)

    def _show_kill(self) -> None:
        stop = next((s for s in self._stops if s.order.command is CommandKind.ALL_KILL), None)
        late = clock.now() - stop.since if stop else 0.0
        # The first moment of a press that is about to be answered is not worth a word.
        pressing = stop is not None and late > LATE
        reached = self.isActiveWindow()
        if stop is not None and pressing:
            detail = words.KILL_PRESSING.format(count=stop.presses, age=words.short_age(late))
            hint = Cell(detail, Tone.BAD)
        else:
            hint = Cell(words.KILL_HINT) if reached else Cell(words.KEYS_OFF, Tone.BAD)
        self._kill.show_hint(hint, pressing)

    def _show_status(self) -> None:
        pressing = self._pressing()
        if pressing:
            self._status.show_cell(Cell(pressing, Tone.BAD))
            return
        pointed = self._pointed
        whole = ''
        if isinstance(pointed, Fitted):
            whole = pointed.whole if pointed.cut else ''
        elif pointed is not None and pointed.button is not None:
            whole = pointed.button.explanation
        if whole:
            self._status.show_cell(Cell(whole, Tone.WAIT))
            return
        now = clock.now()
        waiting = [(now - order.at, words.order_name(order)) for order in self._orders.values()]
        if waiting and max(waiting)[0] > 0.3:
            late, name = max(waiting)
            text = words.PENDING.format(command=name, age=words.short_age(late))
            self._status.show_cell(Cell(text, Tone.WAIT))
            return
        self._status.show_cell(self._message)

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
            if stop.order.command is not CommandKind.ALL_KILL and now - stop.since > LATE
        )

    def _say(self, text: str, tone: Tone = Tone.PLAIN) -> None:
        self._message = Cell(text, tone)
        self._outcome = None
        self._changed = None
        self._pointed = None
        self._show_status()

    # ----- what the official does ---------------------------------------------------------

    def _press_kill(self) -> None:
        self._give(Order(CommandKind.ALL_KILL))
        self._clear_field()

    def _let_go_of(self, down: Button, button: Button) -> None:
        """Take a press, if what stands on the button is still what stood there."""
        if down.is_same_command(button):
            self._pressed(button)
        else:
            self._refuse_changed(down)

    def _pressed(self, button: Button) -> None:
        """Give the command of a button, ask for its confirmation, or say why it is not allowed."""
        if not button.enabled:
            self._say(button.explanation, Tone.WAIT)
        elif button.command is CommandKind.SET_HEAT and not button.heat:
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
        self._clear_field()

    def _send(self, button: Button) -> None:
        order = button.order()
        self._give(order)
        if not CATALOGUE[order.command].stop:  # of the stops the client tells what waits
            self._orders[order.command, order.kart] = order
        self._say(words.GIVEN.format(clock=_clock(), command=words.order_name(order)))
        self._refresh()

    def _answer_question(self, yes: bool) -> None:
        asked = self._question.button
        # Hidden first: a second press of the same key must find nothing to answer.
        self._question.close_sheet()
        self.setFocus()
        self._clear_field()
        if yes and asked is not None:
            self._send(asked)

    def _choose(self, number: int) -> None:
        """Have a kart stand in the field that was chosen in the list."""
        self._field.choose(number)
        self._follow_field()

    def _choose_in_sight(self, number: int) -> None:
        """Have a kart stand in the field whose row was clicked: nothing moves below the hand."""
        self._field.choose(number)
        self._follow_field(scroll=False)

    def _clear_field(self) -> None:
        self._field.clear()
        self._follow_field()

    def _follow_field(self, scroll: bool = True) -> None:
        """Show what stands in the field, there and in the list."""
        self._show_field()
        kart = self._field.kart
        if self._screen is not None and kart != self._marked:
            self._marked = kart
            stale = self._screen.danger is not None and self._screen.danger.stale
            self._karts.show_rows(self._screen.rows, kart, stale)
            if scroll:
                self._karts.bring_into_view(kart)

    def _choose_next(self, step: int) -> None:
        numbers = self._karts.numbers
        if numbers:
            kart = self._field.kart
            place = numbers.index(kart) + step if kart else 0
            self._choose(numbers[max(0, min(place, len(numbers) - 1))])

    def _see(self, number: int) -> None:
        self._book.see(number)
        self._show_alerts(own=True)

    def _see_all(self) -> None:
        self._book.see_all()
        self._show_alerts(own=True)

    def _toggle_events(self) -> None:
        """Show the events of the chosen kart alone, or of all karts."""
        if not self._events.toggle(self._field.kart):
            self._say(words.WHOSE_EVENTS, Tone.WAIT)

    def _toggle_sound(self) -> None:
        self._muted = not self._muted
        self._sounded = 0.0
        self._alerts.show_sound(self._muted)

    # ----- keys and clicks ----------------------------------------------------------------

    def eventFilter(  # noqa: N802 - Qt's name
        self, watched: QtCore.QObject, event: QtCore.QEvent
    ) -> bool:
        """Take keys and clicks before any widget does, and see what is pointed at."""
        kind = event.type()
        # Nothing may ever take a click or a key from a stop: a menu does, and so does a tip. What
        # a tip would say stands in the bottom line.
        if kind in (QtCore.QEvent.Type.ContextMenu, QtCore.QEvent.Type.ToolTip):
            return True
        if isinstance(watched, QtGui.QWindow):
            if kind == QtCore.QEvent.Type.KeyPress:
                assert isinstance(event, QtGui.QKeyEvent)
                return self._take_key(event)
            if isinstance(event, QtGui.QMouseEvent):
                return self._take_mouse(event)
        if isinstance(watched, (CommandButton, Fitted)):
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
        # It would have ended the number: what is typed after it is another one.
        self._clear_field()
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
        point = event.globalPosition().toPoint()
        shown = self._aim.seen(clock.now() - age)
        if (
            shown is not None
            and not self._on_sheet(target)
            and (self._missed(target, shown.at(point)))
        ):
            return True
        if self._is_stop(target) or chooses(target):
            return False
        if age >= STALE:
            return self._drop(_name(target), age)
        self._dropped.clear()
        if target is self._question.yes and not self._question.settled:
            return True
        # The second press of a double click is not meant for what stands there by now.
        return double and isinstance(target, QtWidgets.QAbstractButton)

    def _on_sheet(self, target: QtWidgets.QWidget | None) -> bool:
        """Return whether a widget is part of a sheet, which lies over what was there before."""
        return target is not None and any(
            sheet.isAncestorOf(target) for sheet in (self._question, self._help, self._heats)
        )

    def _missed(self, target: QtWidgets.QWidget | None, aimed: Button | None) -> bool:
        """
        Return whether a press is not for the command that is there now, and deal with it.

        A stop goes to the kart that stood there. Anything else is not sent, with a word.

        :param aimed: what stood there when the official aimed.
        """
        there = target.button if isinstance(target, CommandButton) else None
        if aimed is None and (there is None or CATALOGUE[there.command].stop):
            return False  # no kart stood there that it could have been meant for
        if aimed is not None and there is not None and aimed.is_same_command(there):
            return False
        if aimed is not None and aimed.is_instant:
            self._pressed(aimed)
        elif there is not None and not there.is_instant:
            self._refuse_changed(there)
        else:
            return False
        return True

    def _refuse_changed(self, button: Button) -> None:
        name = words.command_name(button.command, button.kart)
        self._say(words.ROWS_CHANGED.format(name=name), Tone.BAD)
        self._clear_field()

    def _let_go(self, age: float) -> None:
        """Have a button that was pressed in time, and released too late, do nothing."""
        for button in self.findChildren(QtWidgets.QAbstractButton):
            if button.isDown() and not self._is_stop(button):
                button.setDown(False)
                self._drop(_name(button), age)

    def _is_stop(self, widget: QtWidgets.QWidget | None) -> bool:
        if isinstance(widget, CommandButton) and widget.button is not None:
            return CATALOGUE[widget.button.command].stop
        return widget is self._kill.button

    def _take_key(self, event: QtGui.QKeyEvent) -> bool:
        """Return whether the key is used up."""
        age = self._age(event)
        plain = QtGui.QKeySequence(event.key()).toString()
        if plain in keys.KILL_KEYS:
            if not event.isAutoRepeat():
                self._press_kill()
            return True
        name = QtGui.QKeySequence(event.keyCombination()).toString()
        modifiers = QtCore.Qt.KeyboardModifier
        if event.modifiers() & modifiers.KeypadModifier:
            name = plain
        commanding = modifiers.ControlModifier | modifiers.AltModifier | modifiers.MetaModifier
        text = '' if event.modifiers() & commanding else event.text()
        name = keys.key_name(name, text, event.nativeScanCode())
        stroke = keys.meaning(name)
        if age >= STALE and not self._acts_late(stroke):
            # What means nothing here, as Shift alone, is not worth a word.
            named = stroke is not None or self._question.isVisible()
            return self._drop(name, age) if named and not event.isAutoRepeat() else True
        self._dropped.clear()
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
            return self._do(stroke.act, at)
        if stroke.digit:
            self._type(stroke.digit, at)
        elif stroke.to_chosen and twice and not self._field.kart and not self._field.digits:
            pass  # the same press once more: the first one has taken the kart
        elif stroke.stop or not twice:
            self._press_by_key(stroke, at)
        return True

    def _acts_late(self, stroke: keys.Stroke | None) -> bool:
        """Return whether a key acts however old it is: a stop, and choosing a kart for one."""
        if stroke is None:
            return False
        if stroke.act is Act.PRESS:
            return self._is_stop(QtWidgets.QApplication.focusWidget())
        chooses_kart = stroke.act in (Act.UP, Act.DOWN, Act.ERASE, Act.CANCEL)
        return stroke.stop or bool(stroke.digit) or chooses_kart

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
        elif stroke is not None and stroke.act in (Act.PRESS, Act.ERASE):
            self._do(stroke.act, at)
        elif stroke is not None and stroke.digit:
            self._type(stroke.digit, at)
        elif stroke is not None and stroke.stop and not stroke.asks:
            self._press_by_key(stroke, at)  # a stop never waits for an answer
        elif stroke is not None:
            self._clear_field()
            self._say(words.ANSWER_FIRST, Tone.WAIT)
        return True

    def _press_by_key(self, stroke: keys.Stroke, at: float) -> None:
        assert self._screen is not None
        kart = 0
        if stroke.finish is not None:
            kart = _kart_at(self._screen, stroke.finish)
            if not kart:
                self._clear_field()
                return
        elif stroke.to_chosen:
            name = CATALOGUE[stroke.commands[0]].label
            kart, why = self._field.take(name, at)
            if not kart:
                self._follow_field()
                self._say(why, Tone.BAD)
                if stroke.stop and not self._muted:
                    self._sound.play()
                return
        button = _meant(self._screen, stroke, kart)
        shown = self._aim.seen(at)
        if button is not None and shown is not None and not button.is_instant:
            stood = kart if stroke.finish is None else _kart_at(shown.screen, stroke.finish)
            seen = _meant(shown.screen, stroke, stood)
            if seen is None or not seen.is_same_command(button):
                self._refuse_changed(button)
                return
        if button is not None:
            self._pressed(button)
        elif stroke.commands and stroke.commands[0] is CommandKind.OPEN_TRACK:
            self._say(words.TRACK_OPEN)
        elif stroke.commands and stroke.commands[0] is CommandKind.CLOSE_TRACK:
            self._say(words.TRACK_CLOSED)

    def _type(self, digit: str, at: float) -> None:
        self._field.add(digit, at)
        self._follow_field()

    def _do(self, act: Act, at: float) -> bool:
        focused = QtWidgets.QApplication.focusWidget()
        if act is Act.HELP:
            self._help.setVisible(not self._help.isVisible())
            self._place_sheets()
        elif act is Act.SEEN:
            self._alerts.press_first()
        elif act is Act.SOUND:
            self._toggle_sound()
        elif act is Act.UP:
            self._choose_next(-1)
        elif act is Act.DOWN:
            self._choose_next(1)
        elif act is Act.LOG:
            self._toggle_events()
        elif act is Act.ERASE:
            self._field.erase(at)
            self._follow_field()
        elif act is Act.PRESS:
            shown = self._aim.seen(at)
            if (
                isinstance(focused, CommandButton)
                and shown is not None
                and not self._on_sheet(focused)
            ):
                if not self._missed(focused, shown.of(focused)):
                    focused.click()
            elif isinstance(focused, QtWidgets.QAbstractButton):
                focused.click()
        elif act is Act.CANCEL:
            if self._field.digits:
                self._clear_field()
                return True
            self._help.close_sheet()
            self._heats.close_sheet()
            self.setFocus()
        return True

    # ----- how it is laid out -------------------------------------------------------------

    def _build(self) -> None:
        self.setFocusPolicy(QtCore.Qt.FocusPolicy.StrongFocus)
        self._danger_panel = DangerPanel()
        self._now_panel = NowPanel(self._let_go_of)
        self._kill = KillBox()
        # On the press, not on the release: a hand that slips off has pressed it all the same.
        self._kill.button.pressed.connect(self._press_kill)
        top = QtWidgets.QHBoxLayout()
        top.addWidget(self._danger_panel, 1)
        top.addWidget(self._now_panel, 1)
        top.addWidget(self._kill)
        self._alerts = AlertsArea()
        self._alerts.show_sound(muted=False)
        self._alerts.seen.connect(self._see)
        self._alerts.all_seen.connect(self._see_all)
        self._alerts.changed.connect(lambda: self._say(words.ALERTS_CHANGED, Tone.WAIT))
        self._alerts.mute.connect(self._toggle_sound)
        self._karts = KartList(self._let_go_of, self._scrolling)
        self._karts.chosen.connect(self._choose_in_sight)
        self._karts.wanted.connect(self._choose)
        left = QtWidgets.QVBoxLayout()
        left.addWidget(self._alerts)
        left.addWidget(self._karts, 1)
        middle = QtWidgets.QHBoxLayout()
        middle.addLayout(left, 1)
        self._side = SidePanel(self._let_go_of)
        middle.addWidget(self._side)
        self._status = Fitted('status', (15, 13, 12, 11))
        self._layout = QtWidgets.QVBoxLayout(self)
        # The window never grows beyond the screen to make room for a text.
        self._layout.setSizeConstraint(QtWidgets.QLayout.SizeConstraint.SetNoConstraint)
        self._layout.addLayout(top)
        self._layout.addLayout(middle, 1)
        self._events = EventPanel()
        self._events.toggled.connect(self._toggle_events)
        self._layout.addWidget(self._events)
        self._layout.addWidget(self._status)
        self._question = Question(self)
        self._question.answered.connect(self._answer_question)
        self._help = Help(self)
        self._heats = Heats(self, self._let_go_of)

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
        self._danger_panel.setFixedHeight(round(TOP_HEIGHT * by))
        self._status.setFixedHeight(round(32 * by))
        self._events.fit(by, self.height())
        areas = (self._danger_panel, self._now_panel, self._kill, self._alerts, self._karts)
        for area in (*areas, self._side, self._status, self._question):
            area.fit(by)

    def _place_sheets(self) -> None:
        for sheet in (self._question, self._help, self._heats):
            if sheet.isVisible():
                # Over the karts, clear of ALL KILL above and of the stops at the side.
                room = self._karts.scroll.width()
                sheet.fit_height(min(room, round(900 * self._by)))
                corner = self._karts.scroll.mapTo(self, QtCore.QPoint(0, 0))
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


def _commands(screen: Screen) -> list[tuple[CommandKind, int]]:
    """Return which command each button of a screen gives, place by place."""
    buttons = [button for row in screen.rows for button in row.buttons]
    buttons += [screen.track_button] if screen.track_button else []
    return [(button.command, button.kart) for button in buttons]


def _kart_at(screen: Screen, place: int) -> int:
    """Return the kart at a place of the roster, 0 if there is none."""
    return screen.rows[place].number if place < len(screen.rows) else 0


def _heats(screen: Screen) -> list[tuple[str, tuple[int, ...]]]:
    """Return the heats that a screen offers."""
    return [(button.heat, button.karts) for button in screen.heats]


def _meant(screen: Screen, stroke: keys.Stroke, kart: int) -> Button | None:
    """Return the command that a key gives to a kart (0: to none), as a screen has it."""
    found = (screen.button(command, kart) for command in stroke.commands)
    return next((each for each in found if each is not None), None)


def _clock() -> str:
    """Return the wall time, as an official reads it."""
    return time.strftime('%H:%M:%S')


def _name(widget: QtWidgets.QWidget | None) -> str:
    """Return what is said of a click on a widget."""
    if isinstance(widget, CommandButton) and widget.button is not None:
        return words.command_name(widget.button.command, widget.button.kart)
    if isinstance(widget, QtWidgets.QAbstractButton):
        return widget.text()
    return words.CLICK
