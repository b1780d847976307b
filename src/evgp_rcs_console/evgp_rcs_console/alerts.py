# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Shows the alerts in an area that is always visible and repeats a sound until they are seen."""

from __future__ import annotations

from collections.abc import Sequence
import html
import pathlib
import shutil
import sys
import textwrap

from evgp_node.qt import QtCore, QtWidgets
from evgp_protocol import clock
from evgp_protocol.states import RaceState
from evgp_rcs import words
from evgp_rcs.rules.snapshot import Snapshot
from evgp_rcs.words import Cell, Tone
from evgp_rcs_console.freshness import Aim
from evgp_rcs_console.notices import AlertBook, Notice, summary
from evgp_rcs_console.style import LARGE, look, NUMBER, SMALL
from evgp_rcs_console.view import Screen
from evgp_rcs_console.widgets import fixed, lay, mark, Panel, Push, Text, TOP

PLACES = 5
"""Maximum number of alerts shown in full. The others are only counted, with their karts."""

SOUND_AGAIN = 4.0
"""Time after which the alarm sounds again while an alert is unseen, in seconds."""

PLAYERS = ('pw-play', 'paplay', 'aplay')
"""Programs that can play a sound file, the preferred one first."""

SOUND = pathlib.Path(__file__).with_name('alarm.wav')
"""The alarm: three tones of 880, 660 and 880 Hz, 0.18 s each."""


class Alarm:
    """
    Plays the alarm in the background, again and again while there is a reason.

    If there is no player, the system's bell rings instead. Many machines have it turned off.
    """

    def __init__(self) -> None:
        self.muted = False
        self._sounded_at = 0.0
        self._player = next(filter(None, map(shutil.which, PLAYERS)), None)

    def sound_soon(self) -> None:
        """Let the next ``look`` sound the alarm at once, if there is a reason to."""
        self._sounded_at = 0.0

    def look(self, now: float, alarming: bool) -> None:
        """Sound the alarm if there is a reason and it has not sounded too recently."""
        if alarming and now - self._sounded_at >= SOUND_AGAIN:
            self._sounded_at = now
            self.sound()

    def sound(self) -> None:
        if self.muted:
            return
        if self._player is None:
            QtWidgets.QApplication.beep()
        else:
            QtCore.QProcess.startDetached(self._player, [str(SOUND)])


def page(notices: Sequence[Notice], at: float, sentences: int, most: int = sys.maxsize) -> str:
    """
    Return alerts as HTML, on a coloured background until they are seen.

    :param at: race control's time now, in seconds.
    :param sentences: number of alerts to show with their sentence. An alert that is not about a
        kart always shows its sentence.
    :param most: maximum length of a sentence; the rest of a longer one becomes dots.
    """
    tables = []
    for number, notice in enumerate(notices):
        unseen = notice.lasts and not notice.seen
        tone = Tone.BAD if notice.use_msr else Tone.WAIT
        ink, fill = look.fill(tone if unseen else Tone.GARAGE)
        head, kart, age = notice.heading, '', ''
        if notice.alert is not None and notice.lasts:
            size = look.px(NUMBER if notice.use_msr else LARGE)
            kart = f'&nbsp;<span style="font-size:{size}px">{notice.kart or ""}</span>'
            age = words.clock(max(0.0, at - notice.alert.since))
        text = html.escape(textwrap.shorten(notice.text, most, placeholder=' …'))
        if number >= sentences and kart and notice.kart:
            text = ''
        tables.append(
            f'<table width="100%" cellpadding="{look.px(2)}" cellspacing="0" bgcolor="{fill}"'
            f' style="color:{ink}; margin-bottom:{look.px(3)}px"><tr>'
            f'<td style="white-space:nowrap; vertical-align:middle"><b>{head}{kart}</b></td>'
            f'<td align="right" style="vertical-align:middle"><b>{age}</b></td></tr>'
            + f'<tr><td colspan="2" style="font-size:{look.px(SMALL)}px">{text}</td></tr>'
            * bool(text)
            + '</table>'
        )
    return ''.join(tables)


class AlertsArea(Panel):
    """
    Keeps and shows the alerts that are not marked as seen, and those whose cause still exists.

    SEEN marks the first unseen alert. If a different alert has just become the first one, SEEN
    marks nothing.

    :ivar alarm: sounds while an alert is not marked as seen.
    """

    def __init__(self) -> None:
        super().__init__('banner')
        self.alarm = Alarm()
        self._book = AlertBook()
        self._state: RaceState | None = None
        self._screen = Screen()
        self._notices: list[Notice] = []
        self._aim: Aim[list[int]] = Aim()
        self._summary = fixed(Text('standing', 'small bold', wrap=True), height=30)
        self._see = fixed(Push('seen', 'SEEN', 'F10', kind='quiet small'), height=24)
        self._see_all = fixed(Push('seen_all', 'ALL SEEN', kind='quiet small'), height=24)
        self._mute = fixed(Push('mute', '♪ ON', 'F11', kind='quiet small'), height=24)
        self._see.pressed.connect(lambda: self.press(1))
        self._see_all.clicked.connect(lambda: self.press(None))
        self._mute.clicked.connect(self.toggle_sound)
        self._body = QtWidgets.QLabel(objectName='alert_texts')
        self._body.setAlignment(TOP)
        self._body.setWordWrap(True)
        self._body.setSizePolicy(self.sizePolicy())
        buttons = self._see, self._see_all, self._mute
        rows = buttons, (self._summary,) * 3, (self._body,) * 3
        lay(self, *rows, gap=3, margins=(3, 3, 3, 3), columns=(1, 1, 1), heights=(0, 0, 1))
        self._shown, self._in_full = 0, True
        self._looks: object = None

    @property
    def cut(self) -> bool:
        return bool(self._body.heightForWidth(self._body.width()) > self._body.height())

    @property
    def explanation(self) -> str:
        """Return all the alerts if the area does not show them in full; otherwise ''."""
        return '' if self._in_full else '  '.join(map(str, self._notices))

    def take_race(self, race: Snapshot, two: bool) -> None:
        """Update the alerts from a snapshot and sound the alarm soon if one of them is new."""
        if race.state is RaceState.GRID_ACTIVE and self._state is not RaceState.GRID_ACTIVE:
            self._book.begin_race()
        self._state = race.state
        if self._book.update(race.alerts, two):
            self.alarm.sound_soon()

    def take_own(self, text: str) -> None:
        """Add an alert that this window raises itself and sound the alarm soon."""
        self._book.add_own(text)
        self.alarm.sound_soon()

    def toggle_sound(self) -> None:
        self.alarm.muted = not self.alarm.muted
        self.alarm.sound_soon()
        self._mute.show_words('♪ OFF' if self.alarm.muted else '♪ ON', 'F11')

    def show_screen(self, screen: Screen) -> None:
        before, self._screen = self.unseen, screen
        self._show()
        if before and before != self.unseen:
            self._aim.change(before, clock.now())

    def _show(self) -> None:
        at, self._notices = self._screen.now, self._book.shown
        looks = self._notices, int(at), self._body.size(), look.palette
        if looks != self._looks:
            self._looks, self._shown = looks, self._place(at)
        said = summary(self._notices, self._shown)
        # If no snapshots arrive, an empty list does not mean that all is well.
        is_known = self._notices or not self._screen.danger.stale
        self._summary.show_cell(said if is_known else Cell('? not known', Tone.FAINT))
        is_short = said.text.startswith('⚠') and said.text.count(',') < 4
        mark(self._summary, kind='large bold' if is_short else 'small bold')
        for button in (self._see, self._see_all):
            button.bar(not self.unseen)

    def _place(self, at: float) -> int:
        """
        Show as many alerts as fit, and return the number shown.

        If the sentences do not all fit, only the first alert and the alerts that are not about a
        kart keep their sentences. If even the first sentence does not fit, it ends with dots.
        """
        count = min(len(self._notices), PLACES)
        whole = [(count, count), *((each, 1) for each in range(count, 0, -1))]
        cut = [(1, 1, most) for most in (300, 200, 100)]
        for shown, sentences, *most in (*whole, *cut):
            self._body.setText(page(self._notices[:shown], at, sentences, *most))
            if not self.cut:
                break
        self._in_full = not most and sentences == len(self._notices)
        return shown

    @property
    def unseen(self) -> list[int]:
        """Return the numbers of the unseen notices, in the order shown."""
        return [notice.number for notice in self._notices if not notice.seen]

    def press(self, count: int | None) -> None:
        """Mark the first unseen alerts as seen (None: all), if shown for long enough to read."""
        before = self._aim.seen(clock.now())
        if before is not None and set(self.unseen[:count]) - set(before[:count]):
            changed = 'The alerts have just changed. Check them, then press SEEN again.'
            self.window().bottom.say(changed, Tone.WAIT)
        else:
            self._book.see(self.unseen[:count])
            self._show()
