# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The alerts, in an area that is always there, also while there are none."""

from __future__ import annotations

from collections.abc import Sequence

from evgp_protocol import clock
from evgp_rcs_console import words
from evgp_rcs_console.freshness import Aim
from evgp_rcs_console.notices import Notice, summary
from evgp_rcs_console.qt import QtCore, QtWidgets, Signal
from evgp_rcs_console.view import Cell, Tone
from evgp_rcs_console.widgets import column, Fitted, Label, set_property, set_text

PLACES = 3
"""Number of alerts that are shown at once; of the others, the number and the karts are shown."""


class AlertPlace(QtWidgets.QFrame):
    """One alert: what to do, the kart, the sentence, and SEEN."""

    def __init__(self, place: int) -> None:
        """Be empty."""
        super().__init__()
        self.setObjectName(f'alert_{place}')
        self.setProperty('alert', 'none')
        self._what = Label(alert_part='what')
        self._kart = Label(alert_part='kart')
        for label in (self._what, self._kart):
            label.setAlignment(QtCore.Qt.AlignmentFlag.AlignCenter)
        self._text = Fitted('', (17, 15, 13, 12, 11), alert_part='text')
        self.seen = QtWidgets.QPushButton()
        self.seen.setObjectName(f'seen_{place}')
        policy = self.seen.sizePolicy()
        policy.setRetainSizeWhenHidden(True)
        self.seen.setSizePolicy(policy)
        self.seen.hide()
        layout = QtWidgets.QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        for widget in (self._what, self._kart):
            layout.addWidget(widget)
        layout.addWidget(self._text, 1)
        layout.addWidget(self.seen)

    def fit(self, by: float) -> None:
        """Take the size of a scale."""
        self.setFixedHeight(round(30 * by))
        self._what.setFixedWidth(round(146 * by))
        self._kart.setFixedWidth(round(96 * by))
        self.seen.setFixedSize(round(94 * by), round(28 * by))
        self._text.fit(by)

    def show_notice(self, notice: Notice | None, key: str) -> None:
        """Show an alert, or none, and the key that presses its SEEN."""
        look = 'none'
        if notice is not None:
            look = 'msr' if notice.use_msr else 'other' if notice.standing else 'ended'
        set_property(self, 'alert', look)
        is_seen = 'true' if notice is not None and notice.seen else 'false'
        for label in (self._what, self._kart, self._text):
            set_property(label, 'look', look)
            set_property(label, 'seen', is_seen)
        set_text(self._what, notice.heading if notice is not None else '')
        kart = notice.alert.kart if notice is not None else 0
        set_text(self._kart, words.FIELD_KART.format(number=kart) if kart else '')
        self._text.show_text(notice.text if notice is not None else '')
        self.seen.setVisible(notice is not None and not notice.seen)
        set_text(self.seen, f'{words.SEEN}  {key}'.strip())


class AlertsArea(QtWidgets.QWidget):
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
        """Have no alert."""
        super().__init__()
        self._notices: list[Notice] = []
        self._aim: Aim[list[int]] = Aim()
        self._down = 0
        self._summary = Fitted('standing', (15, 13, 12, 11), fill='true')
        self._see_all = QtWidgets.QPushButton(words.SEEN_ALL)
        self._see_all.setObjectName('seen_all')
        self._see_all.clicked.connect(self._press_all)
        self._mute = QtWidgets.QPushButton()
        self._mute.setObjectName('mute')
        self._mute.clicked.connect(self.mute)
        head = QtWidgets.QWidget()
        top = QtWidgets.QHBoxLayout(head)
        top.setContentsMargins(0, 0, 0, 0)
        top.addWidget(self._summary, 1)
        top.addWidget(self._see_all)
        top.addWidget(self._mute)
        frame = QtWidgets.QFrame()
        frame.setObjectName('banner')
        self._frame = frame
        self._places = [AlertPlace(place) for place in range(PLACES)]
        for place, each in enumerate(self._places):
            each.seen.pressed.connect(lambda place=place: self._go_down(place))
            each.seen.clicked.connect(lambda _=False, place=place: self._let_go(place))
        inside = column(frame, *self._places)
        inside.setSpacing(0)
        column(self, head, frame).setSpacing(2)

    def fit(self, by: float) -> None:
        """Take the size of a scale."""
        self._summary.setFixedHeight(round(26 * by))
        self._summary.fit(by)
        self._see_all.setFixedSize(round(94 * by), round(26 * by))
        self._mute.setFixedSize(round(146 * by), round(26 * by))
        for place in self._places:
            place.fit(by)

    def show_sound(self, muted: bool) -> None:
        """Show whether the sound is off."""
        set_text(self._mute, f'{words.SOUND_OFF if muted else words.SOUND_ON}  F11')

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
        for place, each in enumerate(self._places):
            notice = notices[place] if place < len(notices) else None
            f10 = notice is not None and notice.number == first
            each.show_notice(notice, 'F10' if f10 else '')
        tone = Tone.GOOD
        if notices:
            unseen = any(not each.seen and each.standing for each in notices)
            tone = Tone.BAD if unseen else Tone.WAIT
        told = summary(notices, PLACES)
        if not notices and not known:
            told, tone = words.ALERTS_UNKNOWN, Tone.FAINT
        self._summary.show_cell(Cell(told, tone))
        set_property(self._see_all, 'barred', 'false' if first else 'true')

    def press_first(self) -> None:
        """Mark the first alert that is not seen as seen, if it could be read long enough."""
        unseen = next((n for n, each in enumerate(self._notices) if not each.seen), None)
        if unseen is not None:
            self._press(unseen)

    def _unseen(self) -> list[int]:
        """Return the number of the unseen notice in each line, 0 for a line without one."""
        return [0 if notice.seen else notice.number for notice in self._notices]

    def _go_down(self, place: int) -> None:
        numbers = self._unseen()
        self._down = numbers[place] if place < len(numbers) else 0

    def _let_go(self, place: int) -> None:
        numbers = self._unseen()
        if place < len(numbers) and numbers[place] == self._down:
            self._press(place)
        else:
            self.changed.emit()

    def _press(self, place: int) -> None:
        stood = self._aim.seen(clock.now())
        numbers = self._unseen()
        number = numbers[place] if place < len(numbers) else 0
        if stood is not None and (place >= len(stood) or stood[place] != number):
            self.changed.emit()
        elif number:
            self.seen.emit(number)

    def _press_all(self) -> None:
        stood = self._aim.seen(clock.now())
        if stood is not None and set(self._unseen()) - set(stood) - {0}:
            self.changed.emit()
        else:
            self.all_seen.emit()
