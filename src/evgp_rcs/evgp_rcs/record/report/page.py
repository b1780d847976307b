# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Fills ``page.html.j2``, which makes the report one HTML page without network or JavaScript.

Jinja escapes everything that comes from the record, and the page's policy allows only its own
style.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
import functools
import hashlib
from importlib import metadata
from importlib.resources import files
import itertools
import math
import time

from evgp_node.results import Mark, MOST_PASSINGS, Standings
from evgp_node.roster import Format
from evgp_protocol.clock import duration
from evgp_rcs import words
from evgp_rcs.record.plain import plain
from evgp_rcs.record.replay import Replay
from evgp_rcs.record.report import wording
from evgp_rcs.record.report.drawing import Drawing, drawing, WIDTH
from evgp_rcs.record.report.model import Account, Alert, STOPS
from evgp_rcs.record.report.wording import Clock
from evgp_rcs.record.runs import DONE, Runs, UnreadableError
from evgp_rcs.record.timing import Timing
from evgp_rcs.rules.race import EventKind
from jinja2 import Environment, StrictUndefined, Template

PAPER_ROWS = 1000
"""Maximum number of events in the table. ``rcs_record show`` lists all of them."""

MOST = 100
"""Maximum number of incidents, stops, refusals or alerts in a list."""

LESSER = frozenset(
    {
        EventKind.KART_STATE,
        EventKind.DELIVERED,
        EventKind.ACKNOWLEDGED,
        EventKind.LINK_GRADE,
        EventKind.REPORTED,
        EventKind.CONNECTED,
        EventKind.MALFORMED,
        EventKind.REFUSED_CONNECTION,
    }
)
"""Kinds of events that are left out if there is no room for all."""

ASKED_ABOUT = Mark.STRUCK, Mark.DOUBTFUL, Mark.UNKNOWN
"""Marks of the passings that a jury asks about."""


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _count(number: int, what: str) -> str:
    return f'{number:,} {what}{"" if number == 1 else "s"}'


def _file(name: str) -> str:
    return (files('evgp_rcs.record.report') / name).read_text(encoding='utf-8')


@functools.cache  # Jinja takes 0.1 s to compile it
def _template() -> Template:
    environment = Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined
    )
    environment.filters.update(plain=plain, name=wording.name, hash=_hash, count=_count)
    environment.globals.update(duration=duration, numbered=words.numbered, wording=wording)
    return environment.from_string(_file('page.html.j2'))


def page(
    runs: Runs,
    account: Account,
    timing: Timing,
    sums: Sequence[tuple[str, str]],
    event_name: str,
) -> str:
    """
    Return the report of a run.

    :param sums: what each SHA-256 sum is of, and the sum.
    :param event_name: if empty, the report has a line to fill it in.
    """
    kept = account.kept
    clock = Clock(account.began_ns)
    title = f'Race report, {clock.moment(clock.began_ns):%Y-%m-%d %H:%M}'
    # The foot of every printed page, which contains no untrusted text.
    foot = f'{title} · run {kept.run.number}'
    day = runs.day_of(kept.run)
    on_paper = account.events
    if len(on_paper) > PAPER_ROWS:
        on_paper = [each for each in on_paper if each.event.kind not in LESSER][:PAPER_ROWS]

    return _template().render(
        account=account,
        timing=timing,
        runs=runs,
        kept=kept,
        event_name=event_name,
        others=[each for each in day if each is not kept.run],
        sums=sums,
        replay=_replay(account.replay),
        rules=account.replay.rules,
        program=f'evgp_rcs {metadata.version("evgp_rcs")}',
        made_ns=time.time_ns(),
        clock=clock,
        overall=_overall(timing.overall(day)),
        lap_chart=_lap_chart,
        asked_about=lambda timing: [each for each in timing.passings if each.mark in ASKED_ABOUT],
        crossed=lambda race, at: clock.at((race.green or 0.0) + at, 3),
        teams=account.teams,
        title=title,
        style=f'{_file("page.css")}@page {{ @bottom-left {{ content: "{foot}"; }} }}\n',
        stops=sum(each.event.success and each.event.command in STOPS for each in account.commands),
        stood=lambda alert: _stood(alert, account),
        on_paper=on_paper,
        drawings=_drawings(account, clock),
        WIDTH=WIDTH,
        MOST=MOST,
        MOST_PASSINGS=MOST_PASSINGS,
        PAPER_ROWS=PAPER_ROWS,
    )


def _replay(replay: Replay) -> tuple[bool, str]:
    """Return whether the replay found no difference up to the end, and its verdict as text."""
    try:
        code, said = replay.judge()
    except UnreadableError as error:
        return False, f'The run was not replayed: {error}.'
    words = '. '.join(line.strip().rstrip('.') for line in said)
    return code == DONE, f'The rules were run again on all recorded inputs. {words}'


def _drawings(account: Account, clock: Clock) -> list[Drawing]:
    """Return the timeline of the whole run, and of each race in it if there are several."""
    races, whole = account.races, (0.0, account.length)
    drawings = [drawing(account, whole, clock, 'Everything' if races else 'No race')]
    for race in races if len(races) > 1 else ():
        garage = math.inf if race.garage is None else race.garage
        span = max(0.0, race.began - 2.0), min(account.length, garage + 2.0)
        drawings.append(drawing(account, span, clock, f'Race {race.number}'))
    return drawings


def _overall(last: Mapping[Format, Standings]) -> list[Standings]:
    """Return the last results of each format that has results over several heats."""
    found = [last[each] for each in (Format.TIME_TRIAL, Format.PRACTICE) if each in last]
    return [each for each in found if each.overall not in ((), each.karts)]


def _lap_chart(timing: Standings) -> list[list[int]]:
    """Return a row for each lap: its number, and the karts in the order in which they ended it."""
    ended: dict[int, list[float]] = {}
    for each in timing.karts:
        if each.total is not None:
            added = sum(penalty.seconds for penalty in each.penalties)
            begun = each.total - added - sum(each.lap_times)
            ended[each.kart] = [*itertools.accumulate(each.lap_times, initial=begun)][1:]
    most = max(map(len, ended.values()), default=0)
    return [
        [lap + 1, *sorted((n for n in ended if len(ended[n]) > lap), key=lambda n: ended[n][lap])]
        for lap in range(most)
    ]


def _stood(alert: Alert, account: Account) -> str:
    if alert.ended is not None:
        return duration(alert.ended - alert.event.at)
    if account.known_until is not None:
        return 'not known'
    return f'until the end ({duration(account.length - alert.event.at)})'
