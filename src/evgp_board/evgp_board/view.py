# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
From what race control says to what pages show: words, tones and rows, as plain data.

Pure, and without any rule of the race. The words are the window's (docs/console.md). A board may
be wrong in one way only: too careful. So it never says that humans may enter, and a kart has
stopped only if race control counts it as standing. It shows no official's name and no address.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
import math
import time
from typing import Any, NamedTuple

from evgp_protocol.link import Grade
from evgp_rcs_msgs import msg

Shown = dict[str, Any]
"""What a page shows, ready for JSON."""

S = msg.RaceState
STATE_WORDS = {
    S.UNKNOWN: ('?', 'faint'),
    S.IN_GARAGE: ('⌂ IN GARAGE', 'garage'),
    S.GRID_ACTIVE: ('▦ GRID ACTIVE', 'grid'),
    S.GREEN_GREEN: ('▶ GREEN GREEN', 'green'),
    S.RED_FLAG: ('⚑ RED FLAG', 'flag'),
    S.RED_RED: ('■ RED RED', 'red'),
}
"""The symbol and the words of each state, and its tone: a colour of the style sheet."""

OTHERWISE = {
    S.IN_GARAGE: '… ALL KARTS HELD',
    S.GRID_ACTIVE: '… NO KART ON THE GRID',
    S.GREEN_GREEN: '… NO KART IS RACING',
    S.RED_FLAG: '… NO KART IN RED FLAG',
    S.RED_RED: '… NO KART IN RED RED',
    S.UNKNOWN: '?',
}
"""What is said instead of the state of the race, if no kart of the race is sent it."""

REDS = (S.RED_FLAG, S.RED_RED)

DANGERS = {
    msg.Alert.PART_FAILED: 'RACE CONTROL HAS FAILED',
    msg.Alert.TWO_RACE_CONTROLS: 'TWO RACE CONTROLS',
}
"""Alerts that are said instead of the state: what race control says must not be relied on."""

STATUS_WORDS = {
    msg.KartResult.CLASSIFIED: 'classified',
    msg.KartResult.DNF: 'did not finish',
    msg.KartResult.NOT_CLASSIFIED: 'no lap',
    msg.KartResult.DISQUALIFIED: 'disqualified',
}
GRADE_WORDS = {getattr(msg.LinkQuality, each.name): each.value for each in Grade}

MOST_KARTS_NAMED = 8
"""Maximum number of karts that a line names."""


class Line(NamedTuple):
    """Something that happened to a kart: what, and when by race control's wall clock."""

    text: str
    clock: str


@dataclass(frozen=True)
class Heard:
    """
    What race control said last.

    :param gone: race control is silent.
    :param log: of each kart what happened to it, the newest last.
    """

    race: msg.Race | None = None
    results: msg.Results = field(default_factory=msg.Results)
    gone: bool = False
    log: Mapping[int, tuple[Line, ...]] = field(default_factory=dict)


def board(heard: Heard) -> Shown:
    """Return the state of the race and the order of its karts, of ``/`` and ``/overlay``."""
    race, results = heard.race or msg.Race(), _of_this_race(heard)
    found = {each.kart: each for each in results.karts}
    karts = {each.number: each for each in race.karts if each.in_race or each.number in found}
    order = [number for number in (*found, *(karts.keys() - found.keys())) if number in karts]
    counted = any(each.place for each in results.karts)
    if not counted:  # nobody counts laps: the places are those of FINISH
        order = sorted(karts, key=lambda number: (karts[number].place or math.inf, number))
    rows = []
    for number in order:
        kart, result = karts[number], found.get(number, msg.KartResult(best=math.nan))
        symbol, tone = STATE_WORDS[_state(kart.sent)] if kart.connected else ('✗', 'lost')
        rows.append(
            {
                'place': (result.place if counted else kart.place) or '',
                'kart': number,
                'team': kart.team,
                'cells': [result.laps, _gap(result, results), _time(result.best)],
                'note': '; '.join(filter(None, [_does(kart, race), *_taken(result)])),
                'symbol': symbol[0],
                'tone': tone,
            }
        )
    heats = [*race.heats]
    heat = next((each for each in heats if each.name == race.heat), None)
    kind, laps = (heat.format, heat.laps) if heat else (results.format, results.laps)
    about = f'{kind.replace("_", " ").capitalize()}{f" to {laps} laps" if laps else ""}'
    done = sum(kart.place > 0 for kart in karts.values())
    following = heats.index(heat) + 1 if heat else len(heats)
    sub = [f'{done} of {len(karts)} finished'] if done else []
    return {
        **_frame(heard),
        'title': ' · '.join(filter(None, [heat.name if heat else '', about])) or 'EVGP race',
        'sub': ' · '.join(
            [*sub, *(f'next: {each.name}, {_karts(each.karts)}' for each in heats[following:][:1])]
        ),
        'columns': ['Laps', 'Last lap' if results.format == 'practice' else 'Time', 'Best'],
        'rows': rows,
    }


def results(heard: Heard) -> Shown:
    """Return the results of the race that was started last, of ``/results``."""
    results = heard.results
    laps = f'{results.laps} laps' if results.laps else ''
    title = [results.heat, results.format.replace('_', ' '), laps]
    return {
        **_frame(heard),
        'title': ' · '.join(filter(None, title)) if results.karts else 'No results yet',
        'sub': 'As they stand: they can change until the officials publish them',
        'columns': ['Laps', 'Total', 'Best'],
        'rows': [
            {
                'place': each.place or '',
                'kart': each.kart,
                'team': each.team,
                'cells': [each.laps, _time(each.total), _time(each.best)],
                'note': '; '.join(filter(None, [STATUS_WORDS.get(each.status), *_taken(each)])),
                'more': '  '.join(map(_time, each.lap_times)),
            }
            for each in results.karts
        ],
    }


def kart(heard: Heard, number: int) -> Shown:
    """Return what a team wants to know of its kart, of ``/kart/7``."""
    race = heard.race or msg.Race()
    shown = {**_frame(heard), 'number': str(number), 'title': '', 'sub': ''}
    found = next((each for each in race.karts if each.number == number), None)
    if found is None:
        return {**shown, 'sub': 'Race control knows no such kart' if heard.race else ''}
    if not heard.gone and shown['head'] not in DANGERS.values():
        shown['race'] = f'Race: {shown["head"]}'
        shown['head'], shown['tone'] = STATE_WORDS[_state(found.sent)]
        shown['detail'] = _answered(found)
        if not found.connected:
            shown['head'], shown['tone'] = '✗ NO LINK', 'bad' if found.in_race else 'garage'
    result = next((each for each in _of_this_race(heard).karts if each.kart == number), None)
    place = found.place or (result.place if result else 0)
    quality = [GRADE_WORDS.get(found.link.grade, ''), _milliseconds(found.link.round_trip)]
    cells = {
        'Place': str(place) if place else '',
        'Laps': f'{found.laps} of {race.laps}' if race.laps else str(found.laps),
        'Last lap': _time(found.last_lap) if found.laps else '',
        'Best': _time(found.best_lap) if found.laps else '',
        'Link': ', '.join(filter(None, quality)) if found.connected else 'none',
        'Slowest answer': _milliseconds(found.link.worst_answer),
    }
    return {
        **shown,
        'title': found.team,
        'sub': 'in the race' if found.in_race else 'not in the race',
        'cells': [[name, value or '-'] for name, value in cells.items()],
        'list': [*reversed(heard.log.get(number, ()))],
    }


def line_of(event: msg.RaceEvent) -> Line | None:
    """Return what a team sees of an event; None: nothing."""
    said = {
        msg.RaceEvent.KART_STATE: f'{_words(event.state)} sent',
        msg.RaceEvent.ACKNOWLEDGED: f'{_words(event.state)} answered',
        msg.RaceEvent.WITHDRAWN: 'Answer taken back',
        msg.RaceEvent.CONNECTED: 'Connected',
        msg.RaceEvent.DISCONNECTED: 'Connection lost',
        msg.RaceEvent.LAP: f'Lap {event.lap}: {_time(event.after)}',
    }.get(event.kind)
    return Line(said, _clock(event.stamp)) if said and event.kart else None


def green_for(race: msg.Race | None) -> float | None:
    """Return for how long the race had been GREEN GREEN at its snapshot, s; None: it was not."""
    if race is None or race.state.state != S.GREEN_GREEN:
        return None
    return max(0.0, seconds_of(race.stamp) - seconds_of(race.state_since))


def time_of_day(race: msg.Race | None) -> float | None:
    """Return the wall time of a snapshot, in seconds since midnight; None: it is not known."""
    if race is None:
        return None
    local = time.localtime(race.stamp.sec)
    whole = local.tm_hour * 3600 + local.tm_min * 60 + local.tm_sec
    return whole + float(race.stamp.nanosec) / 1e9


def seconds_of(stamp: Any) -> float:
    """Return a time of a message, in seconds."""
    return float(stamp.sec) + float(stamp.nanosec) / 1e9


def _frame(heard: Heard) -> Shown:
    """Return what all pages have: the state of the race in the largest type, and about it."""
    race, tone, detail = heard.race, 'faint', ''
    if race is None:
        head, detail = 'NO RACE CONTROL YET', 'Waiting for race control: obey the marshals'
    elif heard.gone:
        head = 'RACE CONTROL IS GONE'
        detail = f'Last heard {{age}} ago, in {_words(race.state)}: obey the marshals'
    else:
        danger = next((DANGERS[each.kind] for each in race.alerts if each.kind in DANGERS), '')
        head, tone = (danger, 'bad') if danger else _headline(race)
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


def _headline(race: msg.Race) -> tuple[str, str]:
    """
    Return what is true of the karts of the race, and its tone, as the window says it.

    A kart without a link stops by itself: RED RED is true of it.
    """
    karts = [kart for kart in race.karts if kart.in_race] or race.karts
    state, sent = _state(race.state), {_state(kart.sent) for kart in karts if kart.connected}
    if state not in sent and len(sent) == 1 and state in REDS:
        (state,) = sent
    elif state not in sent and sent:
        return OTHERWISE[state], 'wait'
    elif not sent and state == S.GRID_ACTIVE:
        return '? NO KART CONNECTED', 'wait'
    elif not sent and state in (S.GREEN_GREEN, S.RED_FLAG):
        return '✗ ALL KARTS LOST', 'bad'
    return STATE_WORDS[state]


def _of_this_race(heard: Heard) -> msg.Results:
    """Return the results, unless another heat is in the race by now."""
    race = heard.race or msg.Race()
    return heard.results if race.heat == heard.results.heat else msg.Results()


def _gap(result: msg.KartResult, results: msg.Results) -> str:
    """Return the time of a kart, or how far it is behind the leader."""
    if not result.laps and not result.place:
        return ''
    if results.format == 'practice':
        return _time(result.last)
    leader = results.karts[0]
    gap = result.total - leader.total
    if results.format != 'race' or result is leader or not math.isfinite(gap):
        return _time(result.total)
    if result.laps < leader.laps:
        behind = leader.laps - result.laps
        return f'+{behind} lap{"s" * (behind > 1)}'
    return f'+{gap:.3f}' if gap < 60.0 else f'+{_time(gap)}'


def _taken(result: msg.KartResult) -> list[str]:
    """Return what officials took from a result, without their names."""
    taken = []
    for each in result.penalties:
        taken += [f'+{each.seconds} s'] if each.seconds else []
        taken += [f'-{each.laps} laps'] if each.laps else []
        taken += ['disqualified'] * (each.disqualified and result.status != result.DISQUALIFIED)
    return taken


def _does(kart: msg.KartStatus, race: msg.Race) -> str:
    """Return what a kart does, in a word or two."""
    sent = kart.sent.state
    if not kart.connected:
        return 'no link'
    if sent in REDS:
        stands = kart.acknowledged and not kart.may_be_moving
        return ('finished' if kart.place else 'stopped') if stands else 'stopping'
    if kart.place:
        return 'finished'
    if sent == S.GRID_ACTIVE:
        return 'ready' if kart.acknowledged else 'not ready yet'
    if kart.last_lap_done:
        return 'last lap done'
    return 'last lap' if sent == S.GREEN_GREEN and kart.laps + 1 == race.laps else ''


def _answered(kart: msg.KartStatus) -> str:
    """Return when a kart was sent its state, and how long its answers took."""
    if not kart.connected:
        return 'race control does not hear it'
    said = [f'sent {_clock(kart.sent_since)}']
    delivered, answered = kart.link.delivered_after, kart.link.acknowledged_after
    if math.isfinite(delivered):
        said.append(f'arrived after {_milliseconds(delivered)}')
    if kart.acknowledged:
        said.append(f'answered after {answered:.2f} s' if math.isfinite(answered) else 'answered')
    elif kart.sent.state != S.IN_GARAGE:
        said.append('… not answered yet')
    return ' · '.join(said)


def _karts(numbers: Iterable[int]) -> str:
    """Return karts by their numbers, not more than a line takes."""
    named = [*map(str, numbers)]
    more = [f'{len(named) - MOST_KARTS_NAMED} more'] if len(named) > MOST_KARTS_NAMED else []
    return f'kart{"s" * (len(named) > 1)} {", ".join([*named[:MOST_KARTS_NAMED], *more])}'


def _state(message: msg.RaceState) -> int:
    return int(message.state) if message.state in STATE_WORDS else S.UNKNOWN


def _words(message: msg.RaceState) -> str:
    return STATE_WORDS[_state(message)][0].removeprefix('?')[2:] or '?'


def _time(seconds: float) -> str:
    """Return a time as minutes:seconds and thousandths; empty if it is not known."""
    if not math.isfinite(1000 * seconds):
        return ''
    minutes, thousandths = divmod(round(1000 * seconds), 60_000)
    return f'{minutes}:{thousandths // 1000:02}.{thousandths % 1000:03}'


def _milliseconds(seconds: float) -> str:
    return f'{math.ceil(1000 * seconds)} ms' if math.isfinite(1000 * seconds) else ''


def _clock(stamp: Any) -> str:
    clock = time.strftime('%H:%M:%S', time.localtime(stamp.sec))
    return f'{clock}.{stamp.nanosec // 100_000_000}'
