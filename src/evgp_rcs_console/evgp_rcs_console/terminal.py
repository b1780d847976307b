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

"""The race as lines of a terminal."""

from __future__ import annotations

from collections.abc import Iterable

from evgp_rcs_console import words
from evgp_rcs_console.notices import Notice
from evgp_rcs_console.snapshot import Alert
from evgp_rcs_console.view import Button, Screen


def table(screen: Screen, alerts: Iterable[Alert]) -> list[str]:
    """Return the race as lines: state, track, alerts, karts, and which commands are possible."""
    lines = [
        *([words.BANNER.format(banner=screen.banner)] if screen.banner else []),
        f'Race: {screen.state.text}  ({screen.since})',
        *([f'Karts: {screen.tally}'] if screen.tally else []),
        f'{screen.humans.text}: {screen.humans_reason}.  {screen.track.text}.',
        *(str(Notice(0, alert)) for alert in alerts),
        *([f'{words.RESULTS}: {screen.places}'] if screen.places else []),
        '',
    ]
    columns = [
        list(words.COLUMNS[:-1]),
        *(
            [
                str(row.number),
                row.team,
                row.race.text,
                row.link.text,
                row.sent.text,
                row.since,
                row.acknowledged.text,
                row.says.text,
                row.place,
            ]
            for row in screen.rows
        ),
    ]
    widths = [max(map(len, column)) for column in zip(*columns, strict=True)]
    notes = ['', *(row.note for row in screen.rows)]
    for cells, note in zip(columns, notes, strict=True):
        line = '  '.join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True))
        lines.append(f'{line}  {note}'.rstrip())
    lines.append('')
    lines += [_line(button) for button in screen.race]
    if screen.heat_button is not None:
        lines += [_line(screen.heat_button), *(f'  {button.label}' for button in screen.heats)]
    return lines


def _line(button: Button) -> str:
    return f'{button.label:12} {"possible" if button.enabled else button.reason}'
