# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The look of the window: a palette for the day and one for the night, the type, the style sheet.

All sizes are in pixels on a 1366 by 768 screen; ``look.px`` converts them to this screen. The
module does not use Qt, so that a test can compute the contrasts.
"""

from __future__ import annotations

from dataclasses import dataclass

from evgp_rcs.words import Tone

FAMILIES = ('Inter', 'Noto Sans', 'DejaVu Sans')
"""The fonts, the preferred one first. The last one is wide, but has every symbol."""

GAP = 8
RADIUS = 6
SMALL = 12
TEXT = 14
LARGE = 22
NUMBER = 28
HUGE = 35
"""Sizes of type, in pixels. The largest is for the state of the race, warnings and ALL KILL."""


@dataclass(frozen=True)
class Palette:
    """
    The colours of the window.

    :param ground: background behind the cards.
    :param card: background of the cards.
    :param raised: background of pressed or chosen parts of a card, and of IN GARAGE.
    :param line: lines between rows and around cards.
    :param ink: ordinary text.
    :param faint: less important text, and commands that are not possible.
    :param good: text about something that is right.
    :param bad: text about something that is wrong, and the labels of stops.
    :param chosen: frame of focused and chosen parts.
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
    Tone.GOOD: (WHITE, '#0A7D3E'),
    Tone.WAIT: (BLACK, '#F2C200'),
    Tone.BAD: (WHITE, '#B3001B'),
    Tone.GRID: (BLACK, '#F2C200'),
    Tone.GREEN: (WHITE, '#0A7D3E'),
    Tone.FLAG: (BLACK, '#F08A00'),
    Tone.RED: (WHITE, '#B3001B'),
    Tone.BANNER: (WHITE, '#6A1B9A'),
}
"""The colours of a text and its ground for each tone, which are the same by day and by night."""


class Look:
    """
    The palette and the scale that the window uses now.

    :ivar by: the scale of everything, relative to a 1366 by 768 screen.
    """

    def __init__(self) -> None:
        self.palette = DAY
        self.by = 1.0

    def px(self, size: float) -> int:
        """Return a size in pixels of this screen, from one on a 1366 by 768 screen."""
        return round(size * self.by)

    def text(self, tone: Tone) -> str:
        """Return the colour of a text on a card."""
        colours = self.palette
        by_tone = {Tone.FAINT: colours.faint, Tone.GOOD: colours.good, Tone.BAD: colours.bad}
        return by_tone.get(tone, colours.ink)

    def fill(self, tone: Tone) -> tuple[str, str]:
        """Return the colours of a text and its ground."""
        return FILLS.get(tone, (self.text(tone), self.palette.raised))


look = Look()
"""The look of this process's only window."""


def sheet() -> str:
    """Return the style sheet of the window, which selects the look of a widget by its marks."""
    colours, px = look.palette, look.px
    line, strong = px(1), px(2)
    tones = Tone.FAINT, Tone.GOOD, Tone.BAD
    rules = [f'[tone="{tone.value}"] {{ color: {look.text(tone)}; }}' for tone in tones]
    for tone in Tone:
        (ink, fill), ground = look.fill(tone), f'[ground="{tone.value}"]'
        rules.append(f'{ground}, {ground} QLabel {{ color: {ink}; border: 0; }}')
        rules.append(f'{ground} {{ background: {fill}; border-radius: {px(RADIUS)}px; }}')
        if tone is Tone.GARAGE:
            fill = colours.faint
        current = f'QPushButton[current="{tone.value}"]'
        rules.append(f'{current} {{ background: {colours.card}; border-color: {fill}; }}')
        rules.append(
            f'{current} QLabel[kind~="bold"] {{ color: {colours.ink}; font-weight: bold; }}'
        )
    for name, size in (('huge', HUGE), ('large', LARGE), ('small', SMALL)):
        rules.append(f'[kind~="{name}"] {{ font-size: {px(size)}px; }}')
    return f"""
QWidget#window {{ background: {colours.ground}; }}
QLabel, QPushButton, QListWidget {{ color: {colours.ink}; font-size: {px(TEXT)}px; }}
[kind~="bold"], QPushButton {{ font-weight: bold; }}
[kind~="tight"] QLabel {{ font-size: {px(SMALL)}px; }}
[kind~="card"] {{
  background: {colours.card}; border: {line}px solid {colours.line}; border-radius: {px(RADIUS)}px;
}}
[kind~="sheet"] {{
  background: {colours.card}; border: {px(3)}px solid {colours.ink}; border-radius: {px(10)}px;
}}
QPushButton {{
  background: {colours.card}; border: {strong}px solid {colours.ink};
  border-radius: {px(RADIUS)}px; padding: 0;
}}
QPushButton:pressed {{ background: {colours.raised}; }}
QPushButton[kind~="quiet"] {{ border: {line}px solid {colours.line}; }}
QTableView QPushButton {{ font-size: {px(SMALL - 1)}px; }}
QPushButton[look="stop"][ground=""], QPushButton[look="stop"] QLabel[kind~="bold"] {{
  color: {colours.bad}; border-color: {colours.bad};
}}
QPushButton[look="flag"][ground=""] {{ border: {px(3)}px solid {FILLS[Tone.FLAG][1]}; }}
QPushButton[look="recedes"] {{ background: transparent; border-color: transparent; }}
QPushButton[barred="true"], QPushButton:disabled {{
  background: transparent; border-color: transparent; font-weight: normal;
}}
QPushButton[barred="true"], QPushButton[barred="true"] QLabel, QPushButton:disabled,
[kind~="faint"] {{ color: {colours.faint}; }}
QPushButton[barred="true"] QLabel {{ font-weight: normal; }}
{''.join(rules)}
QPushButton[look="next"] {{ background: {colours.ink}; border-color: {colours.ink}; }}
QPushButton[look="next"], QPushButton[look="next"] QLabel {{ color: {colours.card}; }}
QPushButton[look="go"] {{ background: {FILLS[Tone.GREEN][1]}; border: 0; }}
QPushButton[look="go"] QLabel {{ color: {WHITE}; }}
QPushButton:focus {{ border: {px(3)}px solid {colours.chosen}; }}
[ground="off"] {{
  background: #000000; border: {px(4)}px solid {YELLOW}; border-radius: {px(RADIUS)}px;
}}
[ground="off"] QLabel {{ color: {YELLOW}; border: 0; }}
[ground="chosen"] {{ background: {colours.card}; border: {px(3)}px solid {colours.chosen}; }}
#reminder, #msr, #status {{ padding: 0 {px(6)}px; }}
#how_to_begin {{ padding: 0 {px(40)}px; }}
#danger {{
  background: #000000; border: {px(4)}px solid {FILLS[Tone.BAD][1]}; border-radius: {px(RADIUS)}px;
}}
#danger QLabel {{ color: {WHITE}; border: 0; }}
#danger QLabel#danger_advice {{ color: {YELLOW}; }}
#kill_box {{ background: {BLACK}; border-radius: {px(10)}px; }}
#kill_box QPushButton, #kill_box QLabel {{ color: {WHITE}; }}
#kill_box QPushButton {{
  background: {FILLS[Tone.RED][1]}; border: {px(6)}px solid {YELLOW}; border-radius: {px(8)}px;
  font-size: {px(HUGE + 4)}px; padding-bottom: {px(26)}px;
}}
#kill_box QPushButton:pressed {{ background: #6E0012; }}
#kill_box QPushButton[pressing="true"] {{ background: {BLACK}; color: {YELLOW}; }}
#kill_box QLabel[tone="bad"] {{ color: {YELLOW}; }}
QTableView, QListWidget {{ border: 0; background: transparent; font-size: {px(SMALL)}px; }}
QHeaderView::section {{
  border: 0; border-bottom: {line}px solid {colours.line}; background: {colours.card};
  color: {colours.faint}; font-size: {px(SMALL)}px; padding: 0;
}}
QScrollBar:vertical {{ width: {px(16)}px; background: {colours.raised}; }}
QScrollBar::handle:vertical {{
  background: {colours.faint}; min-height: {px(40)}px; border-radius: {px(4)}px;
}}
QListWidget QScrollBar:vertical {{ width: {px(10)}px; }}
QScrollBar::add-line, QScrollBar::sub-line {{ height: 0; }}
"""
