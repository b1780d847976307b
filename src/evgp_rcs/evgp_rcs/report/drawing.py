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

"""
The timeline as a picture that needs no JavaScript: for paper, and for whoever has none.

The page draws its own, which can be enlarged, from the same account (``page.js``).
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from itertools import islice
import math

from evgp_rcs.plain import plain
from evgp_rcs.record import RecordedEvent
from evgp_rcs.report import words
from evgp_rcs.report.model import Account, Band, Lane
from evgp_rcs.report.words import Clock

WIDTH = 1000
LABELS = 80
"""Width of what is left of the times, in units of the picture."""

ROWS = (24, 19)
"""Height of a kart's line, in units of the picture: of few karts, and of many."""

FEW = 14
MOST_LANES = 20
"""Maximum number of karts in one picture; more do not fit on a page."""

MOST_OF_A_TEAM = 15
"""Maximum length of a team's name beside its line, in characters."""

COMMAND_ROWS = 5
ALERT_ROWS = 3
ALERT_HEIGHT = 12
"""Height of a row of alerts, in units of the picture."""

STEPS = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 43200, 86400)
"""Possible distances of two times on the axis, in seconds."""

SMALLEST = 0.7
"""Minimum width of a band; below it, several are drawn as the strictest of them."""

_STRICTNESS = {
    each: rank
    for rank, each in enumerate(
        (
            'IN_GARAGE',
            'GRID_ACTIVE',
            'GREEN_GREEN',
            'NOT_CONNECTED',
            'RED_FLAG',
            'RED_RED',
            'NOT_KNOWN',
        )
    )
}
"""What is shown where there is no room for all: what matters most to a jury."""


def pictures(account: Account, start: float, end: float, clock: Clock) -> list[str]:
    """Return the pictures of a time, each with as many karts as fit on a page."""
    lanes = account.lanes
    starts = range(0, len(lanes), MOST_LANES)
    groups = [list(islice(lanes, first, first + MOST_LANES)) for first in starts]
    return [_Picture(account, group, start, end, clock).draw() for group in groups or [[]]]


def _cut(team: str) -> str:
    name = plain(team)
    return name if len(name) <= MOST_OF_A_TEAM else f'{name[:MOST_OF_A_TEAM]}…'


def _command_kind(event: RecordedEvent) -> str:
    return 'command' if event.success else 'command refused'


class _Picture:
    """One picture, while it is drawn from above."""

    def __init__(
        self, account: Account, lanes: Sequence[Lane], start: float, end: float, clock: Clock
    ) -> None:
        self._account = account
        self._lanes = lanes
        self._row = ROWS[len(lanes) > FEW]
        self._start = start
        self._end = max(end, start + 0.1)
        self._clock = clock
        self._parts: list[str] = []

    def _x(self, at: float) -> float:
        inside = min(max(at, self._start), self._end)
        share = (inside - self._start) / (self._end - self._start)
        return LABELS + share * (WIDTH - LABELS - 2)

    def draw(self) -> str:
        y = self._axis(0)
        alerts = self._alerts_in_rows()
        above = COMMAND_ROWS * 12 + 6 + ALERT_HEIGHT * len(alerts)
        self._gaps(y, y + above + self._row * (len(self._lanes) + 1))
        y = self._commands(y)
        y = self._alerts(alerts, y)
        self._label(y, 'Race')
        self._bands(self._account.race_bands, y)
        y += self._row
        for lane in self._lanes:
            self._label(y, f'Kart {lane.kart}')
            self._text(LABELS - 6, y + 18, _cut(lane.team), 'team', 'end')
            self._bands(lane.bands, y)
            self._marks(lane, y)
            y += self._row
        numbers = [lane.kart for lane in self._lanes]
        title = (
            f'Timeline from {self._clock.at(self._start)} to {self._clock.at(self._end)}: '
            f'what {words.karts(numbers)} {"was" if len(numbers) == 1 else "were"} sent'
        )
        return (
            f'<svg class="picture" viewBox="0 0 {WIDTH} {y + 2}" role="img" '
            f'aria-label="{escape(title)}">{"".join(self._parts)}</svg>'
        )

    def _text(self, x: float, y: float, text: str, kind: str, anchor: str = 'start') -> None:
        self._parts.append(
            f'<text x="{x:.1f}" y="{y:.1f}" class="{kind}" text-anchor="{anchor}">'
            f'{escape(text)}</text>'
        )

    def _rect(self, x: float, y: float, width: float, height: float, kind: str) -> None:
        self._parts.append(
            f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" '
            f'class="{kind}"/>'
        )

    def _label(self, y: float, text: str) -> None:
        self._text(LABELS - 6, y + 10.5, text, 'lane', 'end')

    def _axis(self, y: float) -> float:
        step = next((each for each in STEPS if (self._end - self._start) / each <= 12), STEPS[-1])
        # Full seconds and minutes of the wall clock, which is what people noted.
        offset = self._clock.began_ns / 1e9 + self._clock.offset
        at = math.ceil((self._start + offset) / step) * step - offset
        while at <= self._end:
            x = self._x(at)
            self._parts.append(
                f'<line x1="{x:.1f}" y1="{y + 14}" x2="{x:.1f}" y2="10000" class="tick"/>'
            )
            if x < WIDTH - 24:
                self._text(max(x, LABELS + 20), y + 10, self._clock.at(at), 'time', 'middle')
            at += step
        return y + 18

    def _gaps(self, top: float, bottom: float) -> None:
        for gap in self._account.gaps:
            if gap.end >= self._start and gap.start <= self._end:
                x = self._x(gap.start)
                self._rect(x, top, max(2.0, self._x(gap.end) - x), bottom - top, 'gap')

    def _commands(self, y: float) -> float:
        self._label(y, 'Commands')
        bottom = y + COMMAND_ROWS * 12 + 4
        rows: list[list[tuple[float, float]]] = [[] for _ in range(COMMAND_ROWS)]
        seen = [
            event
            for event in self._account.commands
            if self._start <= self._account.at(event) <= self._end
        ]
        drawn = -1.0
        for event in seen:
            x = self._x(self._account.at(event))
            if x - drawn >= SMALLEST:
                drawn = x
                self._line(x, bottom - 4, bottom, event)
        # Those to the whole race find room first.
        for event in sorted(seen, key=lambda event: not event.success or event.kart != 0):
            text = ('' if event.success else '✗ ') + words.command(event.command, event.kart)
            if event.official:
                text += f' · {words.name(event.official)[:24]}'
            width = 5.4 * len(text) + 8
            x = self._x(self._account.at(event))
            left = min(x + 2, WIDTH - width)
            row = next(
                (
                    number
                    for number, taken in enumerate(rows)
                    if all(left + width < a or left > b for a, b in taken)
                ),
                None,
            )
            if row is not None:
                rows[row].append((left, left + width))
                self._line(x, y + row * 12 + 1, bottom, event)
                self._text(left, y + 9 + row * 12, text, _command_kind(event))
        return bottom + 2

    def _alerts_in_rows(self) -> list[list[tuple[float, float, str]]]:
        """Return the left, right and name of each alert for which there is room."""
        rows: list[list[tuple[float, float, str]]] = []
        for alert in self._account.alerts:
            begins = alert.raised if alert.raised is not None else alert.ended or 0.0
            ends = self._end if alert.ended is None else alert.ended
            if ends < self._start or begins > self._end:
                continue
            left = self._x(begins)
            right = max(self._x(ends), left + 2)
            name = f'! kart {alert.kart}' if alert.kart else '!'
            row = next((row for row in rows if row[-1][1] < left), None)
            if row is not None:
                row.append((left, right, name))
            elif len(rows) < ALERT_ROWS:
                rows.append([(left, right, name)])
        return rows

    def _alerts(self, rows: list[list[tuple[float, float, str]]], y: float) -> float:
        if rows:
            self._label(y - 1, 'Alerts')
        for row in rows:
            for left, right, name in row:
                self._rect(left, y + 1, right - left, ALERT_HEIGHT - 2, 'alert')
                if 5 * len(name) + 4 <= right - left:
                    self._text(left + 3, y + ALERT_HEIGHT - 3.5, name, 'alert-word')
            y += ALERT_HEIGHT
        return y

    def _line(self, x: float, top: float, bottom: float, event: RecordedEvent) -> None:
        self._parts.append(
            f'<line x1="{x:.1f}" y1="{top}" x2="{x:.1f}" y2="{bottom}" '
            f'class="{_command_kind(event)}"/>'
        )

    def _bands(self, bands: Sequence[Band], y: float) -> None:
        waiting: tuple[float, float, str] | None = None
        for band in bands:
            if band.end < self._start or band.start > self._end:
                continue
            left, right = self._x(band.start), self._x(band.end)
            if waiting is not None and right - waiting[0] < SMALLEST:
                worst = max(waiting[2], band.what, key=_STRICTNESS.__getitem__)
                waiting = (waiting[0], right, worst)
                continue
            if waiting is not None:
                self._band(*waiting, y)
                waiting = None
            if right - left < SMALLEST:
                waiting = (left, right, band.what)
            else:
                self._band(left, right, band.what, y)
        if waiting is not None:
            self._band(*waiting, y)

    def _band(self, left: float, right: float, what: str, y: float) -> None:
        width = max(SMALLEST, right - left)
        self._rect(left, y + 1, width, self._row - 2, f'band {what}')
        for text in (words.STATES[what], words.SHORT[what]):
            if 6.2 * len(text) + 4 <= width:
                self._text(left + 3, y + 11.5, text, f'word {what}')
                break

    def _marks(self, lane: Lane, y: float) -> None:
        for hold in lane.holds:
            if hold.end >= self._start and hold.start <= self._end:
                left = self._x(hold.start)
                width = self._x(hold.end) - left
                self._rect(left, y + 0.5, max(0.7, width), 2.5, 'hold')
                # The word stands where it covers no other: in the widest of the bands.
                room, end = max(
                    (
                        self._x(min(band.end, hold.end)) - self._x(max(band.start, hold.start)),
                        self._x(min(band.end, hold.end)),
                    )
                    for band in lane.bands
                    if band.start < hold.end and band.end > hold.start
                )
                if room > 110:
                    self._text(end - 3, y + 11.5, 'HELD', 'held', 'end')
        free = -9.0
        for mark in lane.marks:
            if mark.kind not in MARKS or not self._start <= mark.at <= self._end:
                continue
            x = self._x(mark.at)
            if x >= free or mark.kind == 'DISCONNECTED':
                base = y + self._row - 1.5
                self._text(x, base, MARKS[mark.kind], f'mark {mark.kind}', 'middle')
                free = x + 8


MARKS = {'ACKNOWLEDGED': '✓', 'DISCONNECTED': '✗', 'WITHDRAWN': '↺'}
"""What is marked on a kart's lane."""
