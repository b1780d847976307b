# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The timeline of the report, as shapes that the page's template writes as SVG."""

from __future__ import annotations

from collections.abc import Iterator
import math
from typing import NamedTuple

from evgp_rcs.record.plain import plain
from evgp_rcs.record.report import wording
from evgp_rcs.record.report.model import Account, Happened, Lane, NO_GRADE
from evgp_rcs.record.report.wording import Clock
from evgp_rcs.rules.race import EventKind

WIDTH, NAMES, LETTER = 1200.0, 120.0, 8.0
"""Widths of a timeline, of the names of its lines, and of a letter, in pixels."""

HEAD, ROW, LANE = 20.0, 14.0, 30.0
"""Heights of the times at the top, of a row of labels, and of a kart's line, in pixels."""

ROWS = 4
"""Number of rows for commands, and for alerts. A label that does not fit becomes a stroke."""

_STEPS = (1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600, 7200, 14400, 43200)
MARKS = {
    EventKind.DELIVERED: '→',
    EventKind.ACKNOWLEDGED: '✓',
    EventKind.DISCONNECTED: '✗',
    EventKind.WITHDRAWN: '↺',
}
RARE = EventKind.DISCONNECTED, EventKind.WITHDRAWN
"""Kinds of events whose marks are drawn even where they cover other marks."""


class Shape(NamedTuple):
    """A box with as many of its words as fit into it; if it has no width, only the words."""

    look: str
    x: float
    y: float
    width: float
    height: float
    words: str = ''
    hint: str = ''


Label = tuple[float, float, str, str]
"""A label: its start and end, its look, and its words."""


class Drawing(NamedTuple):
    """A timeline."""

    title: str
    height: float
    shapes: list[Shape]


def drawing(account: Account, span: tuple[float, float], clock: Clock, title: str) -> Drawing:
    """Return the timeline of a run from one time to another."""
    shapes = list(_Timeline(account, span, clock).shapes())
    return Drawing(title, max((each.y + each.height for each in shapes), default=0.0), shapes)


class _Timeline:
    """A timeline that is being drawn."""

    def __init__(self, account: Account, span: tuple[float, float], clock: Clock) -> None:
        self._account = account
        self._clock = clock
        self._start, self._end = span
        self._scale = (WIDTH - NAMES) / max(self._end - self._start, 0.001)

    def _x(self, at: float) -> float:
        return NAMES + (min(max(at, self._start), self._end) - self._start) * self._scale

    def shapes(self) -> Iterator[Shape]:
        lanes = self._account.lanes.values()
        events = [each for each in self._account.events if self._start <= each.at <= self._end]
        ends = self._account.ended
        # Connections that end with race control are not lost ones.
        last = math.inf if ends is None else ends.sequence
        marked = [each for each in events if each.event.kind in MARKS and each.sequence < last]
        y = HEAD + 2 * ROWS * ROW
        yield from self._axis(y + LANE * (1 + len(lanes)))
        yield Shape('name', 0, HEAD, 0, ROW, 'Commands')
        yield from self._rows(HEAD, self._commands(events))
        yield Shape('name', 0, HEAD + ROWS * ROW, 0, ROW, 'Alerts')
        yield from self._rows(HEAD + ROWS * ROW, self._alerts())
        yield Shape('name', 0, y, 0, LANE, 'The race')
        for band in self._account.race_bands:
            yield from self._box(band.start, band.end, f'band {band.what}', y, 20, band.what)
        for lane in lanes:
            y += LANE
            marks = [each for each in marked if each.event.kart == lane.kart]
            yield from self._lane(lane, marks, y)

    def _axis(self, height: float) -> Iterator[Shape]:
        span = self._end - self._start
        step = next((each for each in _STEPS if span / each <= 12), 86_400)
        at = -(-self._start // step) * step
        while at <= self._end:
            yield Shape('tick', self._x(at), 0, 1, height, self._clock.at(at))
            at += step

    def _commands(self, events: list[Happened]) -> Iterator[Label]:
        for each in events:
            event, at = each.event, each.at
            if each.is_command:
                words = wording.command(event.command, event.kart)
                if event.official:
                    words += f' ({wording.name(event.official)})'
                if event.success:
                    yield at, at, 'command', words
                else:
                    yield at, at, 'command refused', f'✗ {words}'

    def _alerts(self) -> Iterator[Label]:
        for each in self._account.alerts:
            end = self._account.length if each.ended is None else each.ended
            if each.event.at <= self._end and end >= self._start:
                yield each.event.at, end, 'alert', plain(each.event.event.text)

    def _rows(self, top: float, labels: Iterator[Label]) -> Iterator[Shape]:
        """Yield each label in the first row that has room for it or, without room, as a stroke."""
        free = [0.0] * ROWS
        for start, end, look, words in labels:
            x = self._x(start)
            row = next((row for row, until in enumerate(free) if until <= x), None)
            if row is None:
                yield Shape(f'{look} stroke', x, top + ROWS * ROW - 4, 1, 4, '', words)
                continue
            width = max(self._x(end) - x, min(len(words) * LETTER, 200.0, WIDTH - x), 1.0)
            free[row] = x + width + 2
            yield Shape(look, x, top + row * ROW, width, ROW - 2, words, words)

    def _box(
        self, start: float, end: float, look: str, y: float, height: float, what: str
    ) -> Iterator[Shape]:
        if end > self._start and start < self._end:
            x = self._x(start)
            words = wording.STATES.get(what, what.lower())
            hint = f'{words}: {self._clock.at(start, 3)} to {self._clock.at(end, 3)}'
            yield Shape(look, x, y, max(self._x(end) - x, 1.0), height, words, hint)

    def _lane(self, lane: Lane, marks: list[Happened], y: float) -> Iterator[Shape]:
        name = f'{lane.kart} {wording.name(lane.team)}'
        yield Shape('name', 0, y, 0, LANE, name[: int(NAMES / LETTER)], name)
        for band in lane.bands:
            yield from self._box(band.start, band.end, f'band {band.what}', y, 20, band.what)
        for link in lane.links:
            if link.what != NO_GRADE:
                height = {'FAIR': 4.0, 'POOR': 6.0}.get(link.what, 2.0)
                look = f'link {link.what}'
                yield from self._box(
                    link.start, link.end, look, y + 26 - height, height, link.what
                )
        for hold in lane.holds:
            if hold.what:
                yield from self._box(hold.start, hold.end, 'hold', y, 3, f'held in {hold.what}')
        free: dict[bool, float] = {}  # from where there is room for rare marks, and for others
        for mark in marks:
            at, is_rare = mark.at, mark.event.kind in RARE
            if self._x(at) >= free.get(is_rare, 0.0):
                free[is_rare] = self._x(at) + LETTER / (2 if is_rare else 1)
                hint = f'{self._clock.at(at, 3)} {plain(mark.event.text)}'
                look = f'mark {mark.event.kind.name}'
                yield Shape(look, self._x(at), y + 8, 0, 14, MARKS[mark.event.kind], hint)
