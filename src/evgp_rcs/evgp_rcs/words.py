# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The wording of the race for people, shared by window, terminal, board and report.

Pure.
"""

from __future__ import annotations

from collections.abc import Iterable
import enum
import math
import time
from typing import NamedTuple

from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState
from evgp_rcs.rules.snapshot import KartSnapshot, Snapshot

IN_GARAGE, GRID_ACTIVE = RaceState.IN_GARAGE, RaceState.GRID_ACTIVE
GREEN_GREEN, RED_FLAG, RED_RED = RaceState.GREEN_GREEN, RaceState.RED_FLAG, RaceState.RED_RED

GONE_AFTER = 0.9
"""
Time without a snapshot after which race control counts as gone, in seconds.

Race control publishes a snapshot at least every 0.5 s. When race control is gone, officials must
know within 1 s.
"""


class Tone(enum.Enum):
    """How a text stands out: by a colour, and always by a word or a symbol as well."""

    PLAIN = 'plain'
    FAINT = 'faint'
    GOOD = 'good'
    WAIT = 'wait'
    BAD = 'bad'
    GARAGE = 'garage'
    GRID = 'grid'
    GREEN = 'green'
    FLAG = 'flag'
    RED = 'red'
    BANNER = 'banner'


class Cell(NamedTuple):
    """A text with its tone."""

    text: str
    tone: Tone = Tone.PLAIN


STATES: dict[RaceState | None, str] = {
    None: '',
    **{state: state.name.replace('_', ' ') for state in RaceState},
}
STATE_CELLS: dict[RaceState | None, Cell] = {
    None: Cell('?', Tone.FAINT),
    IN_GARAGE: Cell('⌂ IN GARAGE', Tone.GARAGE),
    GRID_ACTIVE: Cell('▦ GRID ACTIVE', Tone.GRID),
    GREEN_GREEN: Cell('▶ GREEN GREEN', Tone.GREEN),
    RED_FLAG: Cell('⚑ RED FLAG', Tone.FLAG),
    RED_RED: Cell('■ RED RED', Tone.RED),
}
"""Each state with its symbol, so that no state is shown by its colour alone."""

OTHERWISE: dict[RaceState | None, str] = {
    None: '',
    IN_GARAGE: '… ALL KARTS HELD',
    GRID_ACTIVE: '… NO KART ON THE GRID',
    GREEN_GREEN: '… NO KART IS RACING',
    RED_FLAG: '… NO KART IN RED FLAG',
    RED_RED: '… NO KART IN RED RED',
}
"""Texts shown instead of the race's state if no kart in the race is sent that state."""

ALL_FINISHED = Cell('✓ ALL KARTS FINISHED', Tone.GARAGE)
ALL_LOST = Cell('✗ ALL KARTS LOST', Tone.BAD)
NONE_CONNECTED = Cell('? NO KART CONNECTED', Tone.WAIT)

LINKS = {each: each.value for each in Grade} | {Grade.UNKNOWN: '✓ linked'}


def headline(race: Snapshot) -> Cell:
    """
    Return the headline of a screen: what is true of the karts in the race.

    A kart without a link stops automatically, so RED RED is true of it.
    """
    karts = [kart for kart in race.karts if kart.in_race] or race.karts
    sent = {kart.sent for kart in karts if kart.connected}
    if race.state in sent:
        return STATE_CELLS[race.state]
    if sent:
        if len(sent) == 1 and race.state in (RED_FLAG, RED_RED):
            return STATE_CELLS[sent.pop()]
        if race.state is GREEN_GREEN and all(kart.place for kart in karts):
            return ALL_FINISHED  # a normal end, until the race is over
        return Cell(OTHERWISE[race.state], Tone.WAIT)
    if race.state is GRID_ACTIVE:
        return NONE_CONNECTED
    return ALL_LOST if race.state in (GREEN_GREEN, RED_FLAG) else STATE_CELLS[race.state]


def does(kart: KartSnapshot) -> str:
    """Return what a kart is doing; *stopped* only if humans may rely on it."""
    if not kart.connected:
        return 'lost' if kart.in_doubt else 'not connected'
    if kart.sent.is_red:
        stopped = 'finished' if kart.place else 'stopped'
        return stopped if kart.stands else 'not stopped'
    done, not_yet = _DOES[kart.sent]
    return done if kart.acknowledged and not kart.in_doubt else not_yet


_DOES = {
    IN_GARAGE: ('in the garage',) * 2,
    GRID_ACTIVE: ('ready', 'not ready yet'),
    GREEN_GREEN: ('driving', 'not driving yet'),
}


def tally(race: Snapshot) -> str:
    """Return how many karts in the race are driving, stopped and so on; empty if none is in it."""
    found = [does(kart) for kart in race.karts if kart.in_race]
    return ', '.join(f'{found.count(each)} {each}' for each in _IN_ORDER if each in found)


_IN_ORDER = dict.fromkeys(each for pair in _DOES.values() for each in pair)
_IN_ORDER |= dict.fromkeys(('stopped', 'not stopped', 'finished', 'not connected', 'lost'))


def numbered(karts: Iterable[KartSnapshot | int]) -> str:
    """Return a list of kart numbers as text; empty if there are none."""
    numbers = [str(each.number if isinstance(each, KartSnapshot) else each) for each in karts]
    return f'kart{"s" * (len(numbers) > 1)} {", ".join(numbers)}' if numbers else ''


def clock(seconds: float) -> str:
    """Return a time as minutes:seconds, or hours:minutes:seconds."""
    minutes, second = divmod(int(max(0.0, seconds)), 60)
    hours, minute = divmod(minutes, 60)
    return f'{hours}:{minute:02}:{second:02}' if hours else f'{minute}:{second:02}'


def milliseconds(seconds: float | None) -> str:
    """Return a time (s) in milliseconds as text, rounded up; empty if there is none."""
    if seconds is None or not math.isfinite(1000 * seconds):
        return ''
    return f'{math.ceil(1000 * seconds)} ms'


def time_of_day(at: float) -> str:
    """Return a wall time (s) as hours:minutes:seconds."""
    return time.strftime('%H:%M:%S', time.localtime(at))
