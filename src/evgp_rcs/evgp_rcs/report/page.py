# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The report as one HTML page that needs no network: ``page.html.j2``, and the data for its script.

Words and tables are HTML and need no JavaScript. Jinja escapes whatever comes from the record; the
page's own style and script are the only ones that its policy lets in.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
import dataclasses
import hashlib
from importlib import metadata
from importlib.resources import files
import itertools
import time
from typing import Any

from evgp_rcs.inputs import CLOSED_BY_KART
from evgp_rcs.laps import Format, Laps, Mark, overall
from evgp_rcs.plain import plain
from evgp_rcs.race import EventKind
from evgp_rcs.replay import Kept
from evgp_rcs.report import wording
from evgp_rcs.report.lap_times import standing
from evgp_rcs.report.model import Account, Alert, Part, STOPS
from evgp_rcs.report.wording import Clock
from evgp_rcs.runs import Runs
from jinja2 import Environment, StrictUndefined

PAPER_ROWS = 1000
"""Maximum number of events in the table that is printed and needs no JavaScript."""

MOST = 100
"""Maximum number of incidents, stops, refusals or alerts in a list; the table has all of them."""

LESSER = frozenset(
    kind.name
    for kind in (
        EventKind.KART_STATE,
        EventKind.DELIVERED,
        EventKind.ACKNOWLEDGED,
        EventKind.LINK_GRADE,
        EventKind.REPORTED,
        EventKind.PASSING,
        EventKind.LAP,
        EventKind.CONNECTED,
        EventKind.MALFORMED,
        EventKind.REFUSED_CONNECTION,
    )
)
"""The kinds of events that are left out first where there is no room for all."""


ASKED_ABOUT = Mark.STRUCK, Mark.DOUBTFUL, Mark.UNKNOWN
"""What became of passings that a jury asks about."""

COMMAND = EventKind.COMMAND.name


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _count(number: int, what: str) -> str:
    return f'{number:,} {what}{"" if number == 1 else "s"}'


def page(
    runs: Runs,
    kept: Kept,
    whole: Account,
    part: Part,
    sums: Sequence[tuple[str, str]],
    replay: tuple[bool, str],
    laps: tuple[Mapping[int, Laps], str],
) -> str:
    """
    Return the report of a run, or of a part of it.

    :param sums: what was summed, and its SHA-256.
    :param replay: whether it was replayed to its end, and nothing differs; and what there is to
        say of that.
    :param laps: of each race by its number; and why some are missing, empty: none is.
    """
    account = part.narrow(whole)
    clock = Clock(whole.first.wall_ns if whole.first is not None else kept.run.began_ns)
    events = {event.sequence: event for event in whole.events}
    shown = _part(part, whole, clock)
    title = f'Race report, {clock.moment(clock.began_ns):%Y-%m-%d %H:%M}'
    title += ' (a part only)' if shown else ''
    # The foot of every printed page; nothing of others is in it.
    foot = f'{title} · run {kept.run.number}' + (f' · shows only {shown}' if shown else '')
    incidents = [events[number] for race in whole.races for number in race.incidents]
    lost = [event for event in incidents if event.kind == EventKind.DISCONNECTED.name]
    # Only the sentence of an event says why a connection is gone.
    closed = sum(event.text.endswith(CLOSED_BY_KART) for event in lost)
    counts, uncounted = laps
    of_formats = {
        format_: [each.results for each in standing(counts.values()) if each.format is format_]
        for format_ in (Format.TIME_TRIAL, Format.PRACTICE)
    }
    on_paper = account.events
    if len(on_paper) > PAPER_ROWS:
        on_paper = [event for event in on_paper if event.kind not in LESSER][:PAPER_ROWS]

    environment = Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined
    )
    environment.policies['json.dumps_kwargs'] = {'separators': (',', ':')}
    environment.filters.update(plain=plain, name=wording.name, hash=_hash, count=_count)
    folder = files('evgp_rcs.report')
    style = (folder / 'page.css').read_text(encoding='utf-8')
    template = environment.from_string((folder / 'page.html.j2').read_text(encoding='utf-8'))
    return template.render(
        whole=whole,
        account=account,
        runs=runs,
        kept=kept,
        others=[each for each in runs.day_of(kept.run) if each is not kept.run],
        sums=sums,
        is_replayed=replay[0],
        replay=replay[1],
        program=f'evgp_rcs {_version()}',
        made_ns=time.time_ns(),
        part=shown,
        clock=clock,
        wording=wording,
        events=events,
        counts=counts,
        uncounted=uncounted,
        overall={
            format_: overall(format_, itertools.chain(*results))
            for format_, results in of_formats.items()
            if len(results) > 1
        },
        lap_chart=_lap_chart,
        asked_about=lambda laps: [
            each for each in laps.last_passings(len(laps.crossings)) if each.mark in ASKED_ABOUT
        ],
        crossed=lambda laps, at: clock.at(laps.green - whole.events[0].monotonic + at, 3),
        teams={lane.kart: lane.team for lane in whole.lanes},
        title=title,
        style=f'{style}@page {{ @bottom-left {{ content: "{foot}"; }} }}\n',
        script=(folder / 'page.js').read_text(encoding='utf-8'),
        stops=sum(event.success and event.command in STOPS for event in whole.commands),
        lost=len(lost) - closed,
        closed=closed,
        stood=lambda alert: _stood(alert, whole, clock),
        wall_ns=lambda event: clock.of(event.wall_ns, whole.at(event)),
        on_paper=on_paper,
        kinds=sorted({(wording.KINDS[event.kind], event.kind) for event in account.events}),
        MOST=MOST,
        PAPER_ROWS=PAPER_ROWS,
        data=_data(whole, account, part, clock),
    )


def _part(part: Part, whole: Account, clock: Clock) -> str:
    """Return what a report of a part shows; empty: it shows all."""
    start, end = part.span(whole)
    phrases = []
    if part.start is not None or part.end is not None:
        phrases.append(f'{clock.at(start, 1)} to {clock.at(end, 1)}')
    if part.kart is not None:
        phrases.append(f'kart {part.kart} and what concerns no single kart')
    return ', '.join(phrases)


def _version() -> str:
    try:
        return metadata.version('evgp_rcs')
    except metadata.PackageNotFoundError:
        return 'of which the version is not known'


def _lap_chart(laps: Laps) -> list[list[int]]:
    """Return the karts in the order in which they ended lap 1, lap 2, and so on."""
    most = max(map(len, laps.counted.values()), default=0)
    return [
        sorted(
            (kart for kart, times in laps.counted.items() if len(times) > lap),
            key=lambda kart: laps.counted[kart][lap],
        )
        for lap in range(1, most)
    ]


def _stood(alert: Alert, whole: Account, clock: Clock) -> str:
    """Return how long an alert stood."""
    if alert.raised is None:
        return f'ended at {clock.at(alert.ended or 0.0, 1)}'
    if alert.stands:
        return f'still standing at the end ({wording.duration(whole.length - alert.raised)})'
    if alert.ended is None:
        return 'not known: events are missing'
    return wording.duration(alert.ended - alert.raised)


def _data(whole: Account, account: Account, part: Part, clock: Clock) -> Any:
    """Return what the script draws and lists; `page.js` knows the places in the lists."""
    start, end = part.span(whole)
    data = {
        'start': start,
        'end': end,
        'began': clock.wall_ns(0.0) // 1_000_000,
        'offset': clock.offset,
        'states': wording.STATES,
        'kinds': wording.KINDS,
        'lesser': sorted(LESSER),
        'race': [dataclasses.astuple(band) for band in account.race_bands],
        'races': [
            (race.began, whole.length if race.garage is None else race.garage, race.number)
            for race in account.races
        ],
        'lanes': [
            {
                'kart': lane.kart,
                'team': wording.name(lane.team),
                'bands': [dataclasses.astuple(band) for band in lane.bands],
                'links': [dataclasses.astuple(band)[:3] for band in lane.links],
                'holds': [
                    (hold.start, hold.end, hold.command and wording.command(hold.command, 0))
                    for hold in lane.holds
                ],
            }
            for lane in account.lanes
        ],
        'alerts': [
            (
                alert.ended if alert.raised is None else alert.raised,
                end if alert.ended is None else alert.ended,
                alert.kart,
                alert.sequence,
                _stood(alert, whole, clock),
            )
            for alert in account.alerts
        ],
        'gaps': account.gaps,
        'events': [
            (
                event.sequence,
                (clock.of(event.wall_ns, account.at(event)) + 500_000) // 1_000_000,
                account.at(event),
                event.kart,
                event.kind,
                int(event.success),
                plain(event.text),
                wording.name(event.official),
                wording.command(event.command, event.kart) if event.kind == COMMAND else '',
            )
            for event in account.events
        ],
    }
    return _rounded(data)


def _rounded(value: Any) -> Any:
    """Return data with times to the millisecond."""
    if isinstance(value, dict):
        return {name: _rounded(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in value]
    return round(value, 3) if isinstance(value, float) else value
