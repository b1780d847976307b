# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
How the window looks: one palette for the day and one for the night, one unit, three sizes of type.

All sizes are those of a 1366 by 768 screen, in pixels; ``look.px`` makes them those of this one.
No Qt: a test computes contrasts from here.
"""

from __future__ import annotations

from dataclasses import dataclass

from evgp_rcs.words import Tone

FAMILIES = ('Inter', 'Noto Sans', 'DejaVu Sans')
"""Fonts, the preferred one first; the last one has every sign, and is wide."""

UNIT = 4
"""Margins and gaps are multiples of it."""

GAP = 2 * UNIT
RADIUS = 6
SMALL = 12
TEXT = 14
LARGE = 22
HUGE = 38
"""Sizes of type; the last one is for the state of the race, ALL KILL and what is as urgent."""

LEAST = 10
"""Minimum size of type; a text that does not fit in it ends with dots."""


@dataclass(frozen=True)
class Palette:
    """
    The colours of the window.

    :param ground: behind the cards.
    :param card: behind what is read.
    :param raised: a card's part that is pressed or chosen; also the fill of IN GARAGE.
    :param line: between rows, and around cards.
    :param ink: text.
    :param faint: text that matters less, and commands that are not possible.
    :param good: text of what is as it should be.
    :param bad: text of what is wrong, and of stops.
    :param chosen: around what has the focus or is chosen.
    """

    ground: str
    card: str
    raised: str
    line: str
    ink: str
    faint: str
    good: str
    bad: str
    chosen: str


DAY = Palette(
    ground='#EEF0F2',
    card='#FFFFFF',
    raised='#E2E6EA',
    line='#D5D9DE',
    ink='#14171A',
    faint='#5E676F',
    good='#0A7D3E',
    bad='#B3001B',
    chosen='#1F6FEB',
)
NIGHT = Palette(
    ground='#0F1215',
    card='#191D22',
    raised='#2C333B',
    line='#333B43',
    ink='#F1F4F6',
    faint='#A3ADB6',
    good='#3DDC84',
    bad='#FF7B8A',
    chosen='#5C9DFF',
)

BLACK, WHITE, YELLOW = '#14171A', '#FFFFFF', '#FFCF00'

FILLS = {
    Tone.WAIT: (BLACK, '#F2C200'),
    Tone.BAD: (WHITE, '#B3001B'),
    Tone.GRID: (BLACK, '#F2C200'),
    Tone.GREEN: (WHITE, '#0A7D3E'),
    Tone.FLAG: (BLACK, '#F08A00'),
    Tone.RED: (WHITE, '#B3001B'),
    Tone.BANNER: (WHITE, '#6A1B9A'),
}
"""Text and ground of what a colour means: the same by day and by night."""


class Look:
    """
    What is in use now; a window draws by it.

    :ivar by: how much larger than on a 1366 by 768 screen everything is.
    """

    def __init__(self) -> None:
        self.palette = DAY
        self.by = 1.0

    def px(self, size: float) -> int:
        """Return a size on this screen, in pixels."""
        return round(size * self.by)

    def text(self, tone: Tone) -> str:
        """Return the colour of a text on a card."""
        by_name = {Tone.FAINT: self.palette.faint, Tone.GOOD: self.palette.good}
        return {**by_name, Tone.BAD: self.palette.bad}.get(tone, self.palette.ink)

    def fill(self, tone: Tone) -> tuple[str, str]:
        """Return the colours of a text and its own ground."""
        return FILLS.get(tone, (self.text(tone), self.palette.raised))


look = Look()
"""Of this process: it has one window."""


def scale(width: int, height: int) -> float:
    """
    Return how much larger than on a 1366 by 768 screen everything is.

    A little smaller is possible, too: a desktop's bars take their share of a small screen.
    """
    return max(0.8, min(width / 1366, height / 768))


def sheet() -> str:
    """Return the style sheet of what Qt draws itself: the events, and what scrolls."""
    colours = look.palette
    return f"""
QWidget#window {{ background: {colours.ground}; }}
QScrollArea, QWidget#rows {{ border: none; background: {colours.card}; }}
QTextEdit {{ border: none; background: {colours.card}; color: {colours.ink}; }}
QScrollBar:vertical {{ width: {look.px(16)}px; background: {colours.raised}; }}
QScrollBar::handle:vertical {{
  background: {colours.faint}; min-height: {look.px(40)}px; border-radius: {look.px(4)}px;
}}
QTextEdit QScrollBar:vertical {{ width: {look.px(10)}px; }}
QScrollBar::add-line, QScrollBar::sub-line {{ height: 0; }}
"""
