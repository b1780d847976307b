# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Turns a snapshot of the race into what the pages show: words, tones and rows, as plain data.

A board may err only on the side of caution. It never says that humans may enter the track, and
shows a kart as stopped only if race control considers it to be at a standstill. It uses the words
of the officials' window (docs/console.md), and shows no official's name and no address. This
module is pure and contains none of the rules.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
import math
import time
from typing import Any, NamedTuple

from evgp_node.results import KartResult, lap_time, Standings, Status
from evgp_node.roster import Format
from evgp_protocol.states import RaceState
from evgp_rcs.rules.race import AlertKind, EventKind, StampedEvent
from evgp_rcs.rules.snapshot import KartSnapshot, NOTHING, Snapshot
from evgp_rcs.words import (
    Cell,
    does,
    headline,
    LINKS,
    milliseconds,
    numbered,
    STATE_CELLS,
    STATES,
    time_of_day,
    Tone,
)

Shown = dict[str, Any]
"""The content of a page, ready for JSON."""

DANGERS = {
    AlertKind.PART_FAILED: 'RACE CONTROL HAS FAILED',
    AlertKind.TWO_RACE_CONTROLS: 'TWO RACE CONTROLS',
}
"""Alerts that pages show instead of the state, because race control is then unreliable."""

NO_STANDINGS = Standings()
NO_RESULT = KartResult(0, 0, Status.RUNNING, 0, None, (), ())

MOST_KARTS_NAMED = 8
"""Maximum number of karts that a line names."""


class Line(NamedTuple):
    """An event of a kart, and its time by race control's wall clock."""

    text: str
    clock: str


@dataclass(frozen=True)
class Heard:
    """
    The last messages from race control and the timekeeper.

    :param gone: whether race control is silent.
    :param no_timing: whether the timekeeper is silent.
    :param log: the events of each kart, oldest first.
    :param came: when race control's last message came, in seconds.
    """

    race: Snapshot | None = None
    results: Standings = NO_STANDINGS
    gone: bool = False
    no_timing: bool = False
    log: Mapping[int, tuple[Line, ...]] = field(default_factory=dict)
    came: float = 0.0


def board(heard: Heard) -> Shown:
    """Return the content of ``/`` and ``/overlay``: the race's state, and the karts in order."""
    race, results = heard.race or NOTHING, _of_this_race(heard)
    found = {each.kart: each for each in results.karts}
    karts = {each.number: each for each in race.karts if each.in_race or each.number in found}
    order = [number for number in dict.fromkeys((*found, *karts)) if number in karts]
    counted = _has_laps(results)
    if not counted:
        order = sorted(karts, key=lambda number: (karts[number].place or math.inf, number))
    rows = []
    for number in order:
        kart, result = karts[number], found.get(number, NO_RESULT)
        sent = STATE_CELLS[kart.sent]
        symbol, tone = (sent.text[0], sent.tone.value) if kart.connected else ('✗', 'lost')
        rows.append(
            {
                'place': (result.place if counted else kart.place) or '',
                'kart': number,
                'team': kart.team,
                'cells': [result.laps, _gap(result, results), lap_time(result.best)],
                'note': '; '.join(filter(None, [_does(kart, result, results), *_taken(result)])),
                'symbol': symbol,
                'tone': tone,
            }
        )
    heats, heat, kind = [*race.heats], race.heat_in_race, results.about.capitalize()
    done = sum(kart.place > 0 for kart in karts.values())
    following = heats.index(heat) + 1 if heat else len(heats)
    sub = [f'{done} of {len(karts)} finished'] if done else []
    if done and not counted:
        sub.append('order of FINISH')
    if counted and race.over:
        sub.append('official results' if results.published else 'provisional')
    return {
        **_frame(heard),
        'title': f'{heat.name} · {kind}' if heat else kind,
        'sub': ' · '.join(
            [*sub, *(f'next: {each.name}, {_karts(each.karts)}' for each in heats[following:][:1])]
        ),
        'columns': ['Laps', 'Last lap' if results.format is Format.PRACTICE else 'Time', 'Best'],
        'rows': rows,
    }


def results(heard: Heard) -> Shown:
    """Return the content of ``/results``: the results of the race that was started last."""
    results, race = heard.results, heard.race or NOTHING
    teams = {each.number: each.team for each in race.karts}
    title = ' · '.join(filter(None, [results.heat, results.about]))
    sub = 'Provisional: they can change until the timekeeper publishes them'
    if results.published:
        sub = 'Official results'
    if heard.no_timing:
        sub += ' · the timekeeper is silent, so they may be out of date'
    return {
        **_frame(heard),
        'title': title if results.karts else 'No results yet',
        'sub': sub if results.karts else '',
        'columns': ['Laps', 'Total', 'Best'],
        'rows': [
            {
                'place': each.place or '',
                'kart': each.kart,
                'team': teams.get(each.kart, ''),
                'cells': [each.laps, lap_time(each.total), lap_time(each.best)],
                'note': '; '.join(filter(None, [each.status.value, *_taken(each)])),
                'more': '  '.join(map(lap_time, each.lap_times)),
            }
            for each in results.karts
        ],
    }


def kart(heard: Heard, number: int) -> Shown:
    """Return the content of ``/kart/7``: what a team wants to know about its kart."""
    race = heard.race or NOTHING
    shown = {**_frame(heard), 'number': str(number), 'title': '', 'sub': ''}
    found = race.kart(number)
    if found is None:
        return {**shown, 'sub': 'Race control does not have this kart' if heard.race else ''}
    if not heard.gone and shown['head'] not in DANGERS.values():
        shown['race'] = f'Race: {shown["head"]}'
        sent = STATE_CELLS[found.sent]
        shown['head'], shown['tone'] = sent.text, sent.tone.value
        shown['detail'] = _answered(found)
        if not found.connected:
            shown['head'], shown['tone'] = '✗ NO LINK', 'bad' if found.in_race else 'garage'
    own = _of_this_race(heard)
    result = own.kart(number) or NO_RESULT
    place = result.place if _has_laps(own) else found.place
    laps = len(result.lap_times)
    quality = [LINKS[found.link.grade], milliseconds(found.link.round_trip)]
    cells = {
        'Place': str(place) if place else '',
        'Laps': f'{laps} of {own.laps}' if own.laps else str(laps),
        'Last lap': lap_time(result.last),
        'Best': lap_time(result.best),
        'Link': ', '.join(filter(None, quality)) if found.connected else 'none',
        'Slowest answer': milliseconds(found.link.worst_answer),
    }
    return {
        **shown,
        'title': found.team,
        'sub': 'in the race' if found.in_race else 'not in the race',
        'cells': [[name, value or '-'] for name, value in cells.items()],
        'list': [*reversed(heard.log.get(number, ()))],
    }


def line_of(stamped: StampedEvent) -> Line | None:
    """Return the line that an event adds to its kart's page, or None."""
    event = stamped.event
    said = {
        EventKind.KART_STATE: f'{STATES[event.state]} sent',
        EventKind.ACKNOWLEDGED: f'{STATES[event.state]} answered',
        EventKind.WITHDRAWN: 'Answer withdrawn',
        EventKind.CONNECTED: 'Connected',
        EventKind.DISCONNECTED: 'Connection lost',
    }.get(event.kind)
    return Line(said, _clock(stamped.wall_ns / 1e9)) if said and event.kart else None


def green_for(race: Snapshot | None) -> float | None:
    """Return the time since GREEN GREEN at the snapshot, in seconds, or None in another state."""
    if race is None or race.state is not RaceState.GREEN_GREEN:
        return None
    return max(0.0, race.stamp - race.state_since)


def time_of_today(race: Snapshot | None) -> float | None:
    """Return a snapshot's time of day, in seconds since midnight, or None without a snapshot."""
    if race is None:
        return None
    local = time.localtime(race.stamp)
    return local.tm_hour * 3600 + local.tm_min * 60 + local.tm_sec + race.stamp % 1.0


def _frame(heard: Heard) -> Shown:
    """Return the content that all pages share: the race's state, its details and the alert."""
    race, tone, detail = heard.race, 'faint', ''
    if race is None:
        head, detail = 'NO RACE CONTROL YET', 'Waiting for race control: obey the marshals'
    elif heard.gone:
        head = 'RACE CONTROL IS GONE'
        detail = f'Last update {{age}} ago, in {STATES[race.state]}: obey the marshals'
    else:
        danger = next((DANGERS[each.kind] for each in race.alerts if each.kind in DANGERS), '')
        cell = Cell(danger, Tone.BAD) if danger else headline(race)
        head, tone = cell.text, cell.tone.value
    about = sorted({each.kart for each in race.alerts if each.kart}) if race else []
    alert = f'⚠ Alert at race control{f": {_karts(about)}" if about else ""}'
    return {
        'banner': race.banner if race else '',
        'head': head,
        'tone': tone,
        'detail': detail,
        'stale': race is None or heard.gone,
        'alert': alert if race and race.alerts else '',
    }


def _of_this_race(heard: Heard) -> Standings:
    """Return the results. Without timing, or once another race has begun, they are empty."""
    race = heard.race or NOTHING
    results = heard.results
    is_own = (race.run, race.heat) == (results.run, results.heat)
    is_own = is_own and race.number in (0, results.race) and not heard.no_timing
    return results if is_own else NO_STANDINGS


def _has_laps(results: Standings) -> bool:
    """Return whether laps are counted. If not, the order of FINISH is shown."""
    return any(each.place or each.laps for each in results.karts)


def _gap(result: KartResult, results: Standings) -> str:
    """Return a kart's time or its distance behind the leader."""
    if not result.laps and not result.place:
        return ''
    if results.format is Format.PRACTICE:
        return lap_time(result.last)
    gap = results.behind(result.kart) if results.format is Format.RACE else ''
    return gap or lap_time(result.total)


def _taken(result: KartResult) -> list[str]:
    """Return the penalties in a result, without reasons, names and what its status says."""
    costs = (cost for each in result.penalties for cost in each.costs)
    return [cost for cost in costs if cost != result.status.value]


def _does(kart: KartSnapshot, result: KartResult, results: Standings) -> str:
    """Return what a kart is doing, in a word or two, or an empty string if it simply drives."""
    if not kart.connected:
        return 'no link'  # spectators would read "lost" as "lost the race"
    if not kart.sent.is_red:
        if kart.place:
            return 'finished'
        left = results.laps - len(result.lap_times)
        if kart.sent is RaceState.GREEN_GREEN:
            return {0: 'last lap done', 1: 'last lap'}.get(left, '') if results.laps else ''
    return does(kart)


def _answered(kart: KartSnapshot) -> str:
    """Return how long a kart's answers to its current order took."""
    if not kart.connected:
        return 'not connected to race control'
    said = []
    if kart.delivered_after is not None:
        said.append(f'arrived after {milliseconds(kart.delivered_after)}')
    if kart.acknowledged:
        after = kart.acknowledged_after
        said.append('answered' if after is None else f'answered after {after:.2f} s')
    elif kart.sent is not RaceState.IN_GARAGE:
        said.append('… not answered yet')
    return ' · '.join(said)


def _karts(karts: Iterable[int]) -> str:
    """Return a list of karts as text, with as many numbers as fit into a line."""
    named = [*karts]
    more = len(named) - MOST_KARTS_NAMED
    return numbered(named[:MOST_KARTS_NAMED]) + (f', {more} more' if more > 0 else '')


def _clock(at: float) -> str:
    return f'{time_of_day(at)}.{int(at * 10) % 10}'
