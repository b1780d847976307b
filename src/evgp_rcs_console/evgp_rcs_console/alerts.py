# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The alerts, in an area that is always there, and the sound that comes until they are seen.

The sound is a short two-tone wave, played by what the machine has to play it.
"""

from __future__ import annotations

import array
from collections.abc import Sequence
import math
import pathlib
import shutil
import sys
import tempfile
import wave

from evgp_protocol import clock
from evgp_protocol.states import RaceState
from evgp_rcs.rules.snapshot import Snapshot
from evgp_rcs.words import Cell, Tone
from evgp_rcs_console import texts
from evgp_rcs_console.freshness import Aim
from evgp_rcs_console.notices import AlertBook, Notice, summary
from evgp_rcs_console.qt import QtCore, QtWidgets, Signal
from evgp_rcs_console.style import look, SMALL, TEXT
from evgp_rcs_console.widgets import Card, Painted, Pen, Push, Text, TOP

PLACES = 3
"""Number of alerts that are shown at once; of the others, the number and the karts are shown."""

HEAD, EACH = 30, 62
"""Heights of the heading and of each alert."""

SOUND_AGAIN = 4.0
"""Time between two sounds while an alert is not seen, in seconds."""

PLAYERS = ('pw-play', 'paplay', 'aplay')
"""Programs that play a file, the preferred one first."""

RATE = 22050
TONES = ((880.0, 0.18), (660.0, 0.18), (880.0, 0.18))
"""Frequency (Hz) and length (s) of each tone."""


class AlertPlace(Painted):
    """One alert: what to do, the kart, the sentence, and SEEN."""

    def __init__(self, number: int) -> None:
        super().__init__(f'alert_{number}')
        self._notice: Notice | None = None
        self.seen = self.put(Push(f'seen_{number}'), -82, 4, -4, 26)
        self.seen.hide()

    @property
    def whole(self) -> str:
        """Return all that it says."""
        notice = self._notice
        return '\n'.join((notice.heading, self._kart, notice.text)) if notice else ''

    @property
    def _kart(self) -> str:
        kart = self._notice.kart if self._notice else 0
        return texts.FIELD_KART.format(number=kart) if kart else ''

    def show_notice(self, notice: Notice | None, key: str) -> None:
        """Show an alert, or none, and the key that presses its SEEN."""
        self._notice = notice
        self.seen.setVisible(notice is not None and not notice.seen)
        self.seen.show_words(texts.SEEN, key)
        self.show_it(notice)

    def paint(self, pen: Pen) -> None:
        """Draw it: filled until it is seen, then framed; of one that has ended the text only."""
        notice = self._notice
        if notice is None:
            return
        ink, fill = look.fill(Tone.BAD if notice.use_msr else Tone.WAIT)
        if not notice.standing:
            line = QtCore.QRect(0, 0, self.width(), look.px(34))
            pen.box(line, look.palette.raised)
            line.setRight(self.seen.geometry().left() - look.px(4))
            text = texts.ENDED_LINE.format(heading=notice.heading, text=notice.text)
            pen.text(line.adjusted(look.px(10), 0, 0, 0), text, look.palette.ink, SMALL, wrap=True)
            return
        if notice.seen:
            pen.box(self.rect(), '', fill, 2)
            ink = look.palette.ink
        else:
            pen.box(self.rect(), fill)
        inner = self.rect().adjusted(look.px(10), look.px(4), -look.px(8), -look.px(2))
        upper = inner.adjusted(0, 0, 0, look.px(22) - inner.height())
        if not notice.seen:
            upper.setRight(self.seen.geometry().left() - look.px(4))
        heading = ' · '.join(filter(None, (notice.heading, self._kart)))
        size = TEXT + 2 if notice.use_msr else TEXT
        pen.text(upper, heading, ink, size, True)
        lower = inner.adjusted(0, upper.height() + look.px(1), 0, 0)
        pen.text(lower, notice.text, ink, SMALL, align=TOP, wrap=True)


class AlertsArea(Card):
    """
    The alerts that are not marked as seen, and those whose cause still exists.

    If SEEN is pressed just after another alert has come to its line, it marks nothing.
    """

    seen = Signal(int)
    all_seen = Signal()
    changed = Signal()
    """SEEN was pressed just after the alerts had changed: nothing was marked."""
    mute = Signal()

    def __init__(self) -> None:
        super().__init__('banner')
        self._notices: list[Notice] = []
        self._aim: Aim[list[int]] = Aim()
        self._down = 0
        self._summary = self.put(Text('standing', SMALL, True, wrap=True), 12, 2, -164, 28)
        self._see_all = self.put(Push('seen_all', texts.SEEN_ALL), -162, 4, -86, 27)
        self._mute = self.put(Push('mute'), -82, 4, -6, 27)
        for button, pressed in ((self._see_all, self._press_all), (self._mute, self.mute.emit)):
            button.quiet = True
            button.clicked.connect(pressed)
        tops = [HEAD + number * EACH for number in range(PLACES)]
        self._places = [
            self.put(AlertPlace(number), 6, top, -6, top + EACH - 4)
            for number, top in enumerate(tops)
        ]
        for number, each in enumerate(self._places):
            each.seen.pressed.connect(lambda number=number: self._go_down(number))
            each.seen.clicked.connect(lambda _=False, number=number: self._let_go(number))

    @property
    def whole(self) -> str:
        """Return all alerts that are shown."""
        return '\n'.join(each.whole for each in self._places)

    def show_sound(self, muted: bool) -> None:
        """Show whether the sound is off."""
        self._mute.show_words(texts.SOUND_OFF if muted else texts.SOUND_ON, 'F11')

    def show_notices(
        self, notices: Sequence[Notice], own: bool = False, known: bool = True
    ) -> None:
        """
        Show alerts, the most important first.

        :param own: the official has just marked some as seen, so nothing moved by itself.
        :param known: race control is heard; otherwise no alerts does not mean that all is well.
        """
        before = self._unseen()
        self._notices = list(notices)
        if before != self._unseen() and before and not own:
            self._aim.change(before, clock.now())
        first = next((notice.number for notice in notices if not notice.seen), 0)
        for number, each in enumerate(self._places):
            notice = notices[number] if number < len(notices) else None
            f10 = notice is not None and notice.number == first
            each.show_notice(notice, 'F10' if f10 else '')
            each.setVisible(notice is not None)
            # Below the last one its text has all the room that there is.
            last = number + 1 in (len(notices), PLACES)
            end = EACH * (PLACES if last else number + 1)
            self.put(each, 6, HEAD + number * EACH, -6, HEAD + end - 4)
        tone = Tone.GOOD
        if notices:
            unseen = any(not each.seen and each.standing for each in notices)
            tone = Tone.BAD if unseen else Tone.PLAIN
        told = summary(notices, PLACES)
        if not notices and not known:
            told, tone = texts.ALERTS_UNKNOWN, Tone.FAINT
        self._summary.show_cell(Cell(told, tone))
        self._see_all.bar(not first)

    def press_first(self) -> None:
        """Mark the first alert that is not seen as seen, if it could be read long enough."""
        unseen = next((n for n, each in enumerate(self._notices) if not each.seen), None)
        if unseen is not None:
            self._press(unseen)

    def _unseen(self) -> list[int]:
        """Return the number of the unseen notice in each line, 0 for a line without one."""
        return [0 if notice.seen else notice.number for notice in self._notices]

    def _go_down(self, line: int) -> None:
        numbers = self._unseen()
        self._down = numbers[line] if line < len(numbers) else 0

    def _let_go(self, line: int) -> None:
        numbers = self._unseen()
        if line < len(numbers) and numbers[line] == self._down:
            self._press(line)
        else:
            self.changed.emit()

    def _press(self, line: int) -> None:
        stood = self._aim.seen(clock.now())
        numbers = self._unseen()
        number = numbers[line] if line < len(numbers) else 0
        if stood is not None and (line >= len(stood) or stood[line] != number):
            self.changed.emit()
        elif number:
            self.seen.emit(number)

    def _press_all(self) -> None:
        stood = self._aim.seen(clock.now())
        if stood is not None and set(self._unseen()) - set(stood) - {0}:
            self.changed.emit()
        else:
            self.all_seen.emit()


class Alarm:
    """
    Has the alerts shown, and sounds.

    :param area: where the alerts are shown.
    """

    def __init__(self, area: AlertsArea) -> None:
        self._area = area
        self._book = AlertBook()
        self._known = False
        self._sound = Sound()
        self._muted = False
        self._sounded_at = 0.0
        self._state: RaceState | None = None
        area.show_sound(muted=False)

    def take_race(self, race: Snapshot, two: bool) -> None:
        """Take the alerts of a snapshot; a new one sounds soon."""
        if race.state is RaceState.GRID_ACTIVE and self._state is not RaceState.GRID_ACTIVE:
            self._book.begin_race()
        self._state = race.state
        if self._book.update(race.alerts, two):
            self.sound_soon()

    def take_own(self, text: str) -> None:
        """Take an alert of this window, which stays until it is seen; it sounds soon."""
        self._book.add_own(text)
        self.sound_soon()

    def show(self, known: bool) -> None:
        """
        Show the alerts.

        :param known: race control is heard; if it is not, it may have alerts of which we do not
            know.
        """
        self._known = known
        self._area.show_notices(self._book.shown, known=known)

    def see(self, number: int) -> None:
        """Mark an alert as seen."""
        self._book.see(number)
        self._show_own()

    def see_all(self) -> None:
        """Mark every alert as seen."""
        self._book.see_all()
        self._show_own()

    def _show_own(self) -> None:
        self._area.show_notices(self._book.shown, own=True, known=self._known)

    def toggle_sound(self) -> None:
        """Turn the sound off or on."""
        self._muted = not self._muted
        self.sound_soon()
        self._area.show_sound(self._muted)

    def sound_soon(self) -> None:
        """Sound at the next look, if there is a reason to."""
        self._sounded_at = 0.0

    def look(self, now: float, alarming: bool) -> None:
        """
        Sound if it is time.

        :param now: the time, in seconds.
        :param alarming: race control is gone or must not be relied on.
        """
        due = now - self._sounded_at >= SOUND_AGAIN
        if due and (alarming or self._book.unseen) and not self._muted:
            self._sounded_at = now
            self._sound.play()

    def sound_now(self) -> None:
        """Sound once: a stop was not sent."""
        if not self._muted:
            self._sound.play()

    def close(self) -> None:
        """Tidy up."""
        self._sound.close()


def alarm() -> bytes:
    """Return the samples of the alarm: 16 bit, mono."""
    samples = array.array('h')
    for frequency, length in TONES:
        count = int(RATE * length)
        samples.extend(
            int(24000 * math.sin(2 * math.pi * frequency * n / RATE)) for n in range(count)
        )
    if sys.byteorder == 'big':
        samples.byteswap()
    return samples.tobytes()


class Sound:
    """
    Plays the alarm without waiting for it.

    Where no player is found it is the system's bell, which many machines have turned off.
    """

    def __init__(self) -> None:
        """Look for a player, and write the file for it."""
        found = [path for path in map(shutil.which, PLAYERS) if path]
        self._player = found[0] if found else None
        self._folder = tempfile.TemporaryDirectory(prefix='rcs_gui-')
        self._file = pathlib.Path(self._folder.name, 'alarm.wav')
        with wave.open(str(self._file), 'wb') as out:
            out.setnchannels(1)
            out.setsampwidth(2)
            out.setframerate(RATE)
            out.writeframes(alarm())

    def play(self) -> None:
        """Play it once."""
        if self._player is None:
            QtWidgets.QApplication.beep()
        else:
            QtCore.QProcess.startDetached(self._player, [str(self._file)])

    def close(self) -> None:
        """Remove the file."""
        self._folder.cleanup()
