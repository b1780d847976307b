# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The texts that the timekeeper's window shows.

This module computes no results, and is pure.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import time
from typing import NamedTuple

from evgp_node.results import (
    Act,
    BY_HAND,
    Judged,
    KartResult,
    lap_time,
    Mark,
    Passing,
    Standings,
    Status,
)

HEADINGS = ('POS', 'KART', 'TEAM', 'LAPS', 'TIME', 'GAP', 'BEST', 'LAST', 'STATUS')
"""The headings of the results."""

_MARKS = {
    Mark.DOUBTFUL: 'doubtful: too soon after the last crossing',
    Mark.NOT_COUNTED: 'not counted',
}
_BUTTONS = {Act.STRIKE: 'Strike', Act.RESTORE: 'Restore', Act.GIVE: 'Whose?'}


class Row(NamedTuple):
    """The result of one kart, with a text for each of the ``HEADINGS``."""

    kart: int
    cells: tuple[str, ...]
    penalised: bool


class Crossing(NamedTuple):
    """
    One passing at the timing line.

    :param at: time from GREEN_GREEN to the crossing, as text.
    :param kart: number of the kart; ``?`` if it is unknown.
    :param text: how the passing was judged.
    :param act: the correction that the row's button sends.
    """

    passing: Passing
    at: str
    kart: str
    text: str
    act: Act

    @property
    def button(self) -> str:
        return _BUTTONS[self.act]

    def __str__(self) -> str:
        """Return the passing's description in a dialog."""
        return f'Kart {self.kart} at {self.at}: {self.text} ({self.passing.identity})'


def title(results: Standings) -> str:
    """Return the name of the race that the window shows."""
    return results.heat or ('Race' if results.races else 'No race yet')


def about(results: Standings, state: str) -> str:
    """
    Return the format, time and state of the shown race as text.

    :param state: the state of the race, and how long it has lasted.
    """
    if not results.races:
        return state
    words = [results.about, f'run of {_hour(results.races[-1].stamp)}', state]
    return ' · '.join(filter(None, [*words, 'results published' * results.published]))


def _hour(stamp: float) -> str:
    return time.strftime('%H:%M', time.localtime(stamp))


def races(results: Standings) -> list[tuple[str, int]]:
    """Return a text and the number of every race of the event, newest first."""
    return [
        (
            f'{each.heat or "Race"}, run of {_hour(each.stamp)}: {each.classified} classified'
            + ', counts' * each.counts,
            each.number,
        )
        for each in reversed(results.races)
    ]


def newest_with_results(results: Standings) -> int:
    """Return the number of the race that an official probably wants to correct, or 0."""
    began = results.races[: len(results.races) - (not results.karts)]
    return began[-1].number if began else 0


def karts(results: Standings, teams: Mapping[int, str]) -> list[tuple[str, int]]:
    """Return a text and the number of every kart, for an official to choose from."""
    known = {**{each.kart: '' for each in results.karts}, **teams}
    return [(f'{number}  {team}'.rstrip(), number) for number, team in sorted(known.items())]


def rows(results: Standings, teams: Mapping[int, str]) -> list[Row]:
    """Return the results, best first, with the name of each kart's team."""
    return [
        Row(
            kart.kart,
            (
                str(kart.place or ''),
                str(kart.kart),
                teams.get(kart.kart, ''),
                str(kart.laps),
                lap_time(kart.total),
                results.behind(kart.kart),
                lap_time(kart.best),
                lap_time(kart.last),
                '; '.join((*_lap(kart), *kart.remarks)),
            ),
            bool(kart.penalties),
        )
        for kart in results.karts
    ]


def _lap(kart: KartResult) -> list[str]:
    return [f'lap {len(kart.lap_times) + 1}'] * (kart.status is Status.RUNNING)


def crossings(results: Standings) -> Iterator[Crossing]:
    """Yield the passings of the race, newest first."""
    # A kart's newest counted crossing ended its last lap, and so on backwards.
    laps = {each.kart: [*each.lap_times] for each in results.karts}
    for judged in reversed(results.passings):
        passing = judged.passing
        act = Act.STRIKE
        if judged.mark is Mark.STRUCK:
            act = Act.RESTORE
        elif judged.mark is Mark.UNKNOWN and passing.transponder:
            act = Act.GIVE
        text = _became(judged, laps.get(judged.kart, []), results.laps)
        if passing.source == BY_HAND:
            text = f'by hand, {text}'
        yield Crossing(passing, lap_time(judged.at, 1), str(judged.kart or '?'), text, act)


def _became(judged: Judged, laps: list[float], wanted: int) -> str:
    """Return how a passing was judged. ``laps`` are the times of the laps completed by then."""
    match judged.mark:
        case Mark.STRUCK:
            return f'struck: {judged.struck}'
        case Mark.UNKNOWN if judged.passing.transponder:
            return f'transponder {judged.passing.transponder}'
        case Mark.UNKNOWN:
            return 'kart unknown'
        case Mark.COUNTED if laps:
            number = len(laps)
            return f'lap {number}, {lap_time(laps.pop())}' + ': finish' * (number == wanted)
        case Mark.COUNTED:
            return 'starts lap 1'
        case _:
            return _MARKS[judged.mark]
