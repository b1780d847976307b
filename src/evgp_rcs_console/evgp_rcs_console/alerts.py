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
from evgp_rcs import words
from evgp_rcs.rules.snapshot import Snapshot
from evgp_rcs.words import Cell, Tone
from evgp_rcs_console import texts
from evgp_rcs_console.freshness import Aim
from evgp_rcs_console.notices import AlertBook, Notice, summary
from evgp_rcs_console.qt import QtCore, QtWidgets, Signal
from evgp_rcs_console.style import look
from evgp_rcs_console.widgets import (
    fixed,
    lay,
    mark,
    needed_height,
    Panel,
    Push,
    rescale,
    RIGHT,
    Text,
    TOP,
)

PLACES = 5
"""Maximum number of alerts that are shown at once; of the others, number and karts are shown."""

MANY = 4
"""Maximum number of karts beyond those that are named in the largest type."""

SOUND_AGAIN = 4.0
"""Time between two sounds while an alert is not seen, in seconds."""

PLAYERS = ('pw-play', 'paplay', 'aplay')
"""Programs that play a file, the preferred one first."""

RATE = 22050
TONES = ((880.0, 0.18), (660.0, 0.18), (880.0, 0.18))
"""Frequency (Hz) and length (s) of each tone."""


class AlertPlace(Panel):
    """One alert: what to do, the kart, since when, and the sentence."""

    def __init__(self, number: int) -> None:
        super().__init__(f'alert_{number}', '')
        self._heading = Text('', 'bold', flows=True)
        self._kart = Text('', 'number bold')
        self._since = Text('', 'bold', RIGHT, flows=True)
        self._text = Text('', 'small', TOP, wrap=True, flows=True)
        head = self._heading, self._kart, self._since
        grid = lay(self, head, gap=4, margins=(8, 3, 8, 5), columns=(0, 1, 0), heights=(0, 1))
        grid.addWidget(self._text, 1, 0, 1, 3)

    @property
    def whole(self) -> str:
        """Return all that it says."""
        said = self._heading.whole, self._kart.whole, self._text.whole
        return '\n'.join(filter(None, said)) if not self.isHidden() else ''

    @property
    def cut(self) -> bool:
        """Return whether not all of it is shown."""
        return any(each.cut for each in (self._heading, self._kart, self._since, self._text))

    def show_notice(self, notice: Notice, at: float, brief: bool) -> None:
        """
        Show an alert: filled until it is seen, then framed; of one that has ended its name.

        :param brief: there is no room for the sentence.
        """
        tone = (Tone.BAD if notice.use_msr else Tone.WAIT).value
        unseen = notice.standing and not notice.seen
        mark(self, ground=tone if unseen else '', frame=tone if notice.standing else '')
        large = bool(notice.kart and notice.standing)
        for part in (self._heading, self._kart, self._since):
            fixed(part, height=34 if large else 22)
        self._heading.show_text(notice.heading)
        self._kart.show_text(str(notice.kart) if large else '')
        age = at - notice.alert.since if notice.alert and notice.standing else None
        self._since.show_text(words.clock(max(0.0, age)) if age is not None else '')
        self._text.show_text(notice.text)
        self._text.setVisible(not (brief and large))
        rescale(self)


class AlertsArea(Panel):
    """
    The alerts that are not marked as seen, and those whose cause still exists.

    SEEN is for the first one. If it is pressed just after another alert has come there, it marks
    nothing.
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
        self._summary = Text('standing', 'small bold', wrap=True)
        self._see = Push('seen', texts.SEEN, 'F10', kind='quiet small')
        self._see_all = Push('seen_all', texts.SEEN_ALL, kind='quiet small')
        self._mute = Push('mute', kind='quiet small')
        self._see.pressed.connect(self._go_down)
        self._see.clicked.connect(self._let_go)
        self._see_all.clicked.connect(self._press_all)
        self._mute.clicked.connect(self.mute)
        fixed(self._summary, height=30)
        buttons = self._see, self._see_all, self._mute
        for button in buttons:
            fixed(button, height=24)
        self._body = QtWidgets.QWidget()
        grid = lay(
            self, buttons, gap=3, margins=(3, 3, 3, 3), columns=(1, 1, 1), heights=(0, 0, 1)
        )
        grid.addWidget(self._summary, 1, 0, 1, 3)
        grid.addWidget(self._body, 2, 0, 1, 3)
        self._places = [AlertPlace(number) for number in range(PLACES)]
        for place in self._places:
            place.setParent(self._body)

    @property
    def whole(self) -> str:
        """Return all alerts that are shown."""
        return '\n'.join(each.whole for each in self._places)

    def show_sound(self, muted: bool) -> None:
        """Show whether the sound is off."""
        self._mute.show_words(texts.SOUND_OFF if muted else texts.SOUND_ON, 'F11')

    def show_notices(
        self, notices: Sequence[Notice], at: float, own: bool = False, known: bool = True
    ) -> None:
        """
        Show alerts, the most important first.

        :param at: race control's time now.
        :param own: the official has just marked some as seen, so nothing moved by itself.
        :param known: race control is heard; otherwise no alerts does not mean that all is well.
        """
        before = self._unseen
        self._notices = list(notices)
        if before != self._unseen and before and not own:
            self._aim.change(before, clock.now())
        shown = self._place(at)
        tone = Tone.GOOD
        if notices:
            unseen = any(not each.seen and each.standing for each in notices)
            tone = Tone.BAD if unseen else Tone.PLAIN
        told = summary(notices, shown)
        if not notices and not known:
            told, tone = texts.ALERTS_UNKNOWN, Tone.FAINT
        others = sorted({each.kart for each in notices[shown:] if each.use_msr and each.kart})
        if others:
            told = texts.ALSO_MSR.format(karts=', '.join(map(str, others)))
        self._summary.show_cell(Cell(told, tone))
        mark(self._summary, kind='large bold' if 0 < len(others) <= MANY else 'small bold')
        for button in (self._see, self._see_all):
            button.bar(not self._unseen)

    def _place(self, at: float) -> int:
        """
        Put alerts below each other, as high as their texts; return how many there is room for.

        If there is no room for all sentences, the first alert has its own, and of the others each
        that names a kart does without.
        """
        room, gap = self._body.size(), look.px(4)
        notices = list(zip(self._places, self._notices, strict=False))
        for brief in (False, True):
            for number, (place, notice) in enumerate(notices):
                place.setVisible(True)  # what is hidden has no height
                place.show_notice(notice, at, brief and number > 0)
            heights = [needed_height(place, room.width()) for place, _ in notices]
            if sum(heights) + gap * len(heights) <= room.height():
                break
        top = shown = 0
        for place, high in zip(self._places, [*heights, *[0] * PLACES], strict=False):
            is_seen = high > 0 and (not shown or top + high <= room.height())
            place.setGeometry(0, top, room.width(), high)
            place.setVisible(is_seen)
            top += high + gap
            shown += is_seen
        return shown

    @property
    def _unseen(self) -> list[int]:
        """Return the numbers of the unseen notices, in their order."""
        return [notice.number for notice in self._notices if not notice.seen]

    @property
    def _first(self) -> int:
        return next(iter(self._unseen), 0)

    def _go_down(self) -> None:
        self._down = self._first

    def _let_go(self) -> None:
        if self._first == self._down:
            self.press_first()
        else:
            self.changed.emit()

    def press_first(self) -> None:
        """Mark the first alert that is not seen as seen, if it could be read long enough."""
        stood = self._aim.seen(clock.now())
        if stood is not None and self._first != next(iter(stood), 0):
            self.changed.emit()
        elif self._first:
            self.seen.emit(self._first)

    def _press_all(self) -> None:
        stood = self._aim.seen(clock.now())
        if stood is not None and set(self._unseen) - set(stood):
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
        self._at = 0.0
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

    def show(self, at: float, known: bool) -> None:
        """
        Show the alerts.

        :param at: race control's time now.
        :param known: race control is heard; if it is not, it may have alerts of which we do not
            know.
        """
        self._at, self._known = at, known
        self._area.show_notices(self._book.shown, at, known=known)

    def see(self, number: int) -> None:
        """Mark an alert as seen."""
        self._book.see(number)
        self._show_own()

    def see_all(self) -> None:
        """Mark every alert as seen."""
        self._book.see_all()
        self._show_own()

    def _show_own(self) -> None:
        self._area.show_notices(self._book.shown, self._at, own=True, known=self._known)

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
