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

"""How the window looks: colours and sizes. Sizes are those of a 1366 by 768 screen."""

from __future__ import annotations

from evgp_rcs_console.view import Tone

# Dark text on light ground reads best in the sun; fills differ in brightness as well as in hue.
TONES = {
    Tone.PLAIN: ('#000000', 'transparent'),
    Tone.FAINT: ('#4A4A4A', 'transparent'),
    Tone.GOOD: ('#00472B', 'transparent'),
    Tone.WAIT: ('#000000', '#FFE08A'),
    Tone.BAD: ('#FFFFFF', '#A0001C'),
    Tone.GARAGE: ('#000000', '#DADADA'),
    Tone.GRID: ('#000000', '#FFD200'),
    Tone.GREEN: ('#FFFFFF', '#006B38'),
    Tone.FLAG: ('#000000', '#FF9A1F'),
    Tone.RED: ('#FFFFFF', '#A0001C'),
}
"""Foreground and background of each tone."""

STALE = ('#5A5A5A', '#CFCFCF')
"""Of everything that is no longer known to be true."""


def scale(width: int, height: int) -> float:
    """
    Return how much larger than on a 1366 by 768 screen everything is.

    A little smaller is possible, too: a desktop's bars take their share of a small screen.
    """
    return max(0.8, min(width / 1366, height / 768))


def sheet(by: float) -> str:
    """Return the style sheet of the window at a scale."""

    def px(size: float) -> str:
        return f'{round(size * by)}px'

    tones = ''.join(
        f'QLabel[tone="{tone.value}"] {{ color: {fore}; background: {back}; }}\n'
        for tone, (fore, back) in TONES.items()
    )
    return f"""
* {{ font-size: {px(14)}; color: #000; }}
QWidget#window {{ background: #FFF; }}
QLabel {{ background: transparent; }}
{tones}
QLabel[tone="stale"] {{ color: {STALE[0]}; background: {STALE[1]}; }}
QLabel[tone="good"], QLabel[tone="bad"], QLabel[tone="wait"], QLabel[tone="red"],
QLabel[tone="flag"], QLabel[tone="grid"], QLabel[tone="green"] {{ font-weight: bold; }}
QLabel[fill="true"] {{ border-radius: {px(3)}; padding: 0 {px(4)}; }}

QLabel#top_line {{ color: #FFFFFF; background: #6A1B9A; font-size: {px(17)}; font-weight: 900; }}
QLabel#state {{ font-size: {px(46)}; font-weight: 900; border-radius: {px(6)}; }}
QLabel#state_since {{ font-size: {px(17)}; font-weight: bold; }}
QLabel#humans {{ font-size: {px(21)}; font-weight: bold; padding: {px(2)} {px(6)}; }}
QLabel#track {{ font-size: {px(17)}; font-weight: bold; }}
QFrame#danger {{ background: #000; border: {px(5)} solid #A0001C; border-radius: {px(6)}; }}
QFrame#danger QLabel {{ color: #FFF; }}
QLabel#danger_title {{ font-size: {px(50)}; font-weight: 900; }}
QLabel#danger_advice {{ font-size: {px(60)}; font-weight: 900; }}
QFrame#danger QLabel#danger_advice {{ color: #FFD200; }}
QLabel#danger_detail {{ font-size: {px(16)}; font-weight: bold; }}

QPushButton {{
  background: #F2F2F2; border: {px(2)} solid #333; border-radius: {px(4)};
  padding: {px(1)} {px(3)}; font-weight: bold;
}}
QPushButton:hover {{ background: #FFF; }}
QPushButton:pressed {{ background: #B8B8B8; }}
QPushButton:focus {{ border: {px(3)} solid #0047C2; background: #DCE8FF; }}
QPushButton[barred="true"] {{
  color: #767676; background: #FFF; border: {px(2)} dashed #8A8A8A; font-weight: normal;
}}
QPushButton[barred="true"]:focus {{ border: {px(3)} dashed #0047C2; }}
QPushButton[stop="true"] {{ border: {px(2)} solid #A0001C; color: #A0001C; background: #FFF; }}
QPushButton[stop="true"]:focus {{ border: {px(3)} solid #0047C2; background: #DCE8FF; }}
QPushButton[large="true"] {{ font-size: {px(18)}; }}
QFrame[row="true"] QPushButton {{ font-size: {px(13)}; padding: 0; }}
QFrame#kill_frame {{ background: #000; border-radius: {px(12)}; }}
QPushButton#all_kill {{
  background: #A0001C; color: #FFF; border: {px(8)} solid #FFD200; border-radius: {px(10)};
  font-size: {px(42)}; font-weight: 900;
}}
QPushButton#all_kill:hover {{ background: #C00022; }}
QPushButton#all_kill:pressed {{ background: #5A0010; }}
QPushButton#all_kill:focus {{ border: {px(8)} solid #FFD200; }}
QPushButton#all_kill[pressing="true"] {{ background: #000; color: #FFD200; font-size: {px(34)}; }}
QLabel#kill_hint {{ font-weight: bold; font-size: {px(15)}; }}
QLabel#kill_hint[tone="bad"] {{ font-size: {px(15)}; }}

QLabel[section="true"] {{
  font-weight: bold; font-size: {px(15)}; border-bottom: {px(2)} solid #000;
}}
QLabel[reason="true"] {{ font-size: {px(12)}; color: #333; }}
QFrame#banner {{ border-top: {px(1)} solid #9A9A9A; border-bottom: {px(1)} solid #9A9A9A; }}
QFrame[alert="msr"], QFrame[alert="other"] {{ background: #FFF2D0; }}
QLabel[alert_part] {{ padding: 0 {px(4)}; font-weight: bold; }}
QLabel[alert_part="what"], QLabel[alert_part="kart"] {{ font-size: {px(17)}; font-weight: 900; }}
QLabel[alert_part="what"] {{ border-radius: {px(3)}; font-size: {px(15)}; }}
QLabel[alert_part="what"][look="msr"] {{ color: #FFF; background: #A0001C; }}
QLabel[alert_part="what"][look="other"] {{ background: #FFE08A; }}
QLabel[alert_part="what"][look="msr"][seen="true"] {{
  color: #A0001C; background: #FFF; border: {px(2)} solid #A0001C;
}}
QLabel[alert_part="text"][seen="true"] {{ font-weight: normal; }}
QLabel[look="ended"] {{ color: #5A5A5A; font-weight: normal; }}
QLabel[alert_part="text"][look="ended"], QLabel[alert_part="kart"][look="ended"] {{
  text-decoration: line-through; font-weight: normal;
}}
QFrame#number_field {{ border: {px(3)} solid #0047C2; border-radius: {px(4)}; background: #FFF; }}
QFrame#number_field[tone="faint"] {{ border: {px(2)} dashed #8A8A8A; }}
QFrame#number_field[tone="bad"] {{ border: {px(3)} solid #A0001C; }}
QLabel#number {{ font-weight: 900; }}
QLabel#number_detail {{ font-weight: bold; }}

QLabel[heading="true"] {{ font-size: {px(12)}; color: #333; }}
QFrame[row="true"] {{ border-bottom: 1px solid #9A9A9A; background: #FFF; }}
QFrame[row="true"][racing="false"] {{ background: #EFEFEF; }}
QFrame[row="true"][chosen="true"] {{
  border: {px(3)} solid #0047C2; border-radius: {px(3)};
}}
QFrame[row="true"] QLabel {{ padding: 0 {px(4)}; }}
QFrame[row="true"] QLabel[cell="number"], QFrame[row="true"] QLabel[cell="place"] {{ padding: 0; }}
QLabel[cell="number"] {{ font-size: {px(28)}; font-weight: 900; }}
QLabel[cell="team"] {{ font-size: {px(15)}; font-weight: bold; }}
QLabel[cell="note"] {{ font-size: {px(12)}; color: #333; }}
QLabel[cell="since"] {{ font-size: {px(12)}; }}
QLabel[cell="says"] {{ font-size: {px(12)}; }}
QLabel[cell="place"] {{ font-size: {px(20)}; font-weight: 900; }}
QScrollArea {{ border: none; background: #FFF; }}
QWidget#rows {{ background: #FFF; }}
QScrollBar:vertical {{ width: {px(24)}; background: #DDD; }}
QScrollBar::handle:vertical {{ background: #555; min-height: {px(40)}; border-radius: {px(4)}; }}
QScrollBar::add-line, QScrollBar::sub-line {{ height: 0; }}

QPlainTextEdit#log {{ border: 1px solid #333; background: #FFF; font-size: {px(13)}; }}
QPushButton#filter, QPushButton#official {{ text-align: left; font-size: {px(14)}; }}
QPushButton#official[tone="wait"] {{ background: #FFE08A; }}
QPushButton#official[tone="wait"]:focus {{ background: #DCE8FF; }}
QLabel#name {{
  font-size: {px(28)}; font-weight: bold; border: {px(2)} solid #333; padding: {px(4)} {px(8)};
}}
QLabel#name:focus {{ border: {px(3)} solid #0047C2; }}
QPlainTextEdit#log:focus {{ border: {px(2)} solid #0047C2; }}
QLabel#status {{
  font-size: {px(15)}; font-weight: bold; border: 1px solid #333; padding: {px(1)} {px(6)};
}}
QFrame[sheet="true"] {{ background: #FFF; border: {px(6)} solid #000; border-radius: {px(8)}; }}
QLabel[sheet_title="true"] {{ font-size: {px(36)}; font-weight: 900; }}
QLabel[sheet_text="true"] {{ font-size: {px(20)}; }}
QFrame[sheet="true"] QPushButton {{ font-size: {px(20)}; padding: {px(5)} {px(14)}; }}
"""
