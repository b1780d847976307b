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

"""
The report as one HTML page that needs no network.

Words and tables are HTML and need no JavaScript. Whatever comes from the record goes through
``_safe``, or into JSON that cannot end its element; the page's own style and script are the only
ones that its policy lets in.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import hashlib
from html import escape
from importlib.resources import files
import json
from string import Template

from evgp_rcs.inputs import CLOSED_BY_KART
from evgp_rcs.plain import plain
from evgp_rcs.race import EventKind
from evgp_rcs.record import RecordedEvent, Session
from evgp_rcs.report import words
from evgp_rcs.report.model import (
    Account,
    Alert,
    GREEN_GREEN,
    NOT_CONNECTED,
    Part,
    Race,
    STOPS,
    Why,
)
from evgp_rcs.report.words import Clock

PAPER_ROWS = 1000
"""Maximum number of events in the table that is printed and needs no JavaScript."""

MOST_INCIDENTS = 100
"""Maximum number of incidents that are listed for one race; the table has all of them."""

MOST_ALERTS = 200
"""Maximum number of alerts that are listed; the table has all of them."""

LESSER = frozenset(
    kind.name
    for kind in (
        EventKind.KART_STATE,
        EventKind.ACKNOWLEDGED,
        EventKind.REPORTED,
        EventKind.CONNECTED,
        EventKind.MALFORMED,
        EventKind.REFUSED_CONNECTION,
    )
)
"""The kinds of events that are left out first where there is no room for all."""


@dataclass(frozen=True)
class Source:
    """
    Where a report comes from.

    :param run: the run that it is about.
    :param present: race control was still writing this run.
    :param others: the other runs of that day.
    :param replay: what a replay of it found, or why there was none, in sentences.
    :param is_replayed: it was replayed to its end, and nothing differs.
    :param sums: what was summed, and its SHA-256.
    :param rules: the version of the rules; empty: not recorded.
    :param program: the version of the program that makes the report.
    :param made_ns: when it is made, ns since the epoch.
    :param damage: why not all of the run could be read; empty: all of it was.
    """

    file: str
    run: Session
    present: bool
    others: Sequence[Session]
    replay: Sequence[str]
    is_replayed: bool
    sums: Sequence[tuple[str, str]]
    rules: str
    program: str
    made_ns: int
    damage: str = ''


def page(whole: Account, part: Part, source: Source) -> str:
    """Return the report of a run, or of a part of it."""
    return _Page(whole, part, source).html()


def _safe(text: str) -> str:
    """Return a text of the record as HTML: as text, with a direction of its own."""
    return f'<bdi>{escape(plain(text))}</bdi>'


def _json(data: object) -> str:
    # Inside of a script element nothing but its end is markup.
    return json.dumps(data, ensure_ascii=True, separators=(',', ':')).replace('<', '\\u003c')


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _count(number: int, one: str, more: str = '') -> str:
    return f'{number:,} {one if number == 1 else more or one + "s"}'


def _table(kind: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table; the cells are HTML already."""
    lines = ''.join(
        '<tr>' + ''.join(f'<td>{cell}</td>' for cell in row) + '</tr>\n' for row in rows
    )
    names = ''.join(f'<th scope="col">{escape(name)}</th>' for name in head)
    return f'<table class="{kind}"><thead><tr>{names}</tr></thead><tbody>\n{lines}</tbody></table>'


class _Page:
    """One page, while it is put together."""

    def __init__(self, whole: Account, part: Part, source: Source) -> None:
        self._whole = whole
        self._part = part
        self._source = source
        self._account = part.narrow(whole)
        self._start, self._end = part.span(whole)
        first = whole.first
        self._clock = Clock(first.wall_ns if first is not None else source.run.began_ns)
        self._teams = {lane.kart: lane.team for lane in whole.lanes if lane.team}
        self._events = {event.sequence: event for event in whole.events}

    def html(self) -> str:
        folder = files('evgp_rcs.report')
        style = (folder / 'page.css').read_text(encoding='utf-8') + self._on_every_sheet()
        script = (folder / 'page.js').read_text(encoding='utf-8')
        policy = (
            f"default-src 'none'; style-src {_hash(style)}; script-src {_hash(script)}; "
            "base-uri 'none'; form-action 'none'"
        )
        body = [
            self._head(),
            '<main>',
            self._in_short(),
            self._glossary(),
            self._races(),
            self._alerts(),
            self._timeline(),
            self._table_of_events(),
            self._origin(),
            '</main>',
        ]
        return Template((folder / 'page.html').read_text(encoding='utf-8')).substitute(
            policy=policy,
            title=escape(self._title()),
            style=style,
            script=script,
            body='\n'.join(body),
            data=_json(self._data()),
        )

    # ----- the words ----------------------------------------------------------------------

    def _title(self) -> str:
        day = self._clock.moment(self._clock.began_ns)
        part = '' if self._part.whole else ' (a part only)'
        return f'Race report, {day:%Y-%m-%d %H:%M}{part}'

    def _on_every_sheet(self) -> str:
        """Return what stands at the foot of every printed page; nothing of others is in it."""
        what = f'{self._title()} · run {self._source.run.number}'
        if not self._part.whole:
            what = f'{what} · shows only {self._what_part()}'
        return f'@page {{ @bottom-left {{ content: "{what}"; }} }}\n'

    def _what_part(self) -> str:
        clock = self._clock
        phrases = []
        if self._part.start is not None or self._part.end is not None:
            phrases.append(f'{clock.at(self._start, 1)} to {clock.at(self._end, 1)}')
        if self._part.kart is not None:
            phrases.append(f'kart {self._part.kart} and what concerns no single kart')
        return ', '.join(phrases)

    def _part_note(self) -> str:
        if self._part.whole:
            return ''
        left_out = len(self._whole.events) - len(self._account.events)
        return (
            '<p class="part"><strong>This report shows only a part of the run:</strong> '
            f'{self._what_part()}. It leaves out {left_out:,} of '
            f'{_count(len(self._whole.events), "event")}.</p>'
        )

    def _head(self) -> str:
        clock, length = self._clock, self._whole.length
        began = clock.began_ns
        ended = began + round(length * 1e9)
        when = f'{clock.day(began)}, {clock.time(began, 1)} to '
        if clock.day(began) != clock.day(ended):
            when += f'{clock.day(ended)}, '
        when += f'{clock.time(ended, 1)} ({words.duration(length)})'
        return (
            f'<header><h1>Race report</h1><p class="when">{when}</p>{self._part_note()}</header>'
        )

    def _in_short(self) -> str:
        whole, source, clock = self._whole, self._source, self._clock
        said: list[tuple[str, str]] = []
        if not whole.events:
            said.append(('bad', 'This run has no events: race control did not start.'))
        if source.damage:
            said.append(
                (
                    'bad',
                    f'The record is damaged ({_safe(source.damage)}): this is what can be read of '
                    'it. What came after the last event here may be missing.',
                )
            )
        races = len(whole.races)
        started = sum(race.green is not None for race in whole.races)
        said.append(
            (
                '',
                f'The record has {_count(races, "race")}'
                + (f', {started} of them started.' if races != started else '.'),
            )
        )
        refused = sum(not event.success for event in whole.commands)
        said.append(
            (
                '',
                f'Officials sent {_count(len(whole.commands), "command")}; '
                f'race control refused {refused or "none"}.',
            )
        )
        stops = [event for event in whole.commands if event.success and event.command in STOPS]
        lost = [number for race in whole.races for number in race.incidents]
        lost = [n for n in lost if self._events[n].kind == EventKind.DISCONNECTED.name]
        # Only the sentence of an event says why a connection is gone.
        closed = sum(self._events[n].text.endswith(CLOSED_BY_KART) for n in lost)
        by_karts = f'; karts closed {_count(closed, "connection")} in a race' if closed else ''
        said.append(
            (
                '',
                f'Incidents: {_count(len(stops), "stop")} by officials; '
                f'{_count(len(lost) - closed, "lost connection")} during a race{by_karts}.',
            )
        )
        standing = sum(alert.stands for alert in whole.alerts)
        alerts = f'Race control raised {_count(len(whole.alerts), "alert")}'
        if standing:
            alerts += f'; <strong>{standing} still stood at the end</strong>'
        said.append(('bad' if standing else '', f'{alerts}.' if whole.alerts else 'No alerts.'))
        first = whole.first
        if first is not None and first.kind == EventKind.RACE_STATE.name:
            # Only then is it the first event.
            said.append(('bad', f'This run did not begin in the garage: {_safe(first.text)}.'))
        if whole.events:
            said.append(self._how_it_ended())
        for gap in whole.gaps:
            where = (
                'at the beginning'
                if not gap.start and not gap.end
                else f'between {clock.at(gap.start, 1)} and {clock.at(gap.end, 1)}'
            )
            are = 'is' if gap.missing == 1 else 'are'
            said.append(
                (
                    'bad',
                    f'{_count(gap.missing, "event")} {are} missing {where}. What karts were sent '
                    'from then on is not known until the record says it again.',
                )
            )
        for step in whole.clock_steps:
            way = 'forward' if step.by > 0 else 'back'
            said.append(
                (
                    'bad',
                    f"The computer's clock was set {way} by {words.duration(abs(step.by))}, "
                    f'{words.elapsed(step.at)} after the beginning, or the times of day in the '
                    'record were changed. Durations and the timeline go by a clock that nobody '
                    'sets; the times of day on the timeline are counted from the first event.',
                )
            )
        said.append(('' if source.is_replayed else 'bad', _safe(' '.join(source.replay))))
        if source.others:
            runs = ', '.join(
                f'{each.number}'
                + (' (not ended in good order)' if each.events and not each.ended_ns else '')
                for each in source.others
            )
            said.append(('', f'Not in this report: other runs of this day, {runs}.'))
        items = ''.join(
            f'<li{f" class={kind}" if kind else ""}>{text}</li>\n' for kind, text in said
        )
        return f'<section><h2>In short</h2><ul class="short">\n{items}</ul></section>'

    def _glossary(self) -> str:
        lines = ''.join(
            f'<tr><th scope="row">{escape(word)}</th><td>{escape(meaning)}</td></tr>'
            for word, meaning in words.GLOSSARY
        )
        return f"""<section class="glossary"><h2>What the words mean</h2>
<table class="facts">{lines}</table>
<p>Race control's own sentences write the states as karts hear them: GREEN_GREEN. An official's
name is what they typed: a claim, not a proof. A command that was refused did nothing. An
acknowledgement is what the kart said, not what it did.</p></section>"""

    def _how_it_ended(self) -> tuple[str, str]:
        ended = self._whole.ended
        last = f'The last event is of {self._clock.at(self._whole.length, 1)}.'
        if self._source.present:
            return 'bad', f'Race control was still running when this report was made. {last}'
        if ended is None:
            return (
                'bad',
                'Race control did not end in good order: it was killed, or its computer stopped. '
                f'{last} What happened after it is not recorded.',
            )
        if not self._whole.in_order:
            return 'bad', f'Race control did not end in good order: {_safe(ended.text)}.'
        at = self._clock.time(self._clock.of(ended.wall_ns, self._whole.at(ended)), 1)
        return '', f'Race control ended in good order at {at}.'

    def _wall_ns(self, event: RecordedEvent) -> int:
        return self._clock.of(event.wall_ns, self._account.at(event))

    def _kart(self, number: int) -> str:
        if not number:
            return 'All'
        team = self._teams.get(number)
        return f'Kart {number} ({_safe(words.name(team))})' if team else f'Kart {number}'

    def _official(self, event: RecordedEvent) -> str:
        return _safe(words.name(event.official)) if event.official else 'an unnamed official'

    def _races(self) -> str:
        races = [self._one_race(race) for race in self._account.races]
        title = 'Races' if len(races) != 1 else 'The race'
        rest = ''
        if self._account.outside:
            rest = (
                '<article><h3>Outside a race</h3>'
                f'{self._incidents(self._account.outside, None)}</article>'
            )
        none = '' if races else '<p>There was no race.</p>'
        return f'<section><h2>{title}</h2>{none}{"".join(races)}{rest}</section>'

    def _one_race(self, race: Race) -> str:
        clock = self._clock
        ends = self._whole.length if race.garage is None else race.garage
        heading = (
            f'Race {race.number}{self._heat(race)}: {clock.at(race.began, 3)} to '
            f'{clock.at(ends, 3)} <small>({words.exact(race.began, ends)})</small>'
        )
        said = []
        if race.taken_up:
            said.append('It had begun before what the record shows.')
        if race.incomplete:
            said.append(
                '<strong>Events of this race are missing, so this may not be all.</strong>'
            )
        if race.green is None and not race.taken_up:
            said.append('It was never started.')
        if race.garage is None:
            said.append('<strong>It was still under way at the end of the record.</strong>')
        return (
            f'<article><h3>{heading}</h3>{self._changes(race)}<p>{" ".join(said)}</p>'
            f'{self._order(race)}{self._stops(race)}{self._incidents(race.incidents, race)}'
            f'{self._refused(race)}</article>'
        )

    def _stops(self, race: Race) -> str:
        stops = self._whole.stops(race)
        parts = []
        for stop in stops[:MOST_INCIDENTS]:
            event = self._events[stop.sequence]
            by = 'Race control itself'
            if event.kind == EventKind.COMMAND.name:
                label = escape(words.command(event.command, event.kart))
                by = f'<strong>{label}</strong> from {self._official(event)}'
            told = [each for each in stop.told if self._part.kart in (None, each.kart)]
            rows = [
                (self._kart(each.kart), *words.acknowledged(stop, each, self._clock))
                for each in told
            ]
            slowest = stop.slowest()
            said = f'{by} at {self._clock.at(stop.at, 3)}.'
            if slowest is not None and slowest.acknowledged is not None:
                took = words.exact(slowest.since, slowest.acknowledged)
                said += f' Slowest to acknowledge: {self._kart(slowest.kart)}, after {took}.'
            silent = [each.kart for each in told if each.silence in words.SILENT]
            if silent:
                said += f' <strong>Not acknowledged: {words.karts(silent)}.</strong>'
            absent = [each.kart for each in told if each.what == NOT_CONNECTED]
            if absent:
                said += f' <strong>Not connected then: {words.karts(absent)}.</strong>'
            head = ('Kart', 'Was sent', 'Acknowledged at', 'After')
            parts.append(f'<p>{said}</p>' + (_table('stops', head, rows) if rows else ''))
        if not parts:
            return ''
        more = len(stops) - len(parts)
        rest = f'<p>{more:,} more are in the table of events.</p>' if more else ''
        return f'<h4>The stop{"s" if len(stops) > 1 else ""}</h4>{"".join(parts)}{rest}'

    def _refused(self, race: Race) -> str:
        if not race.refused:
            return ''
        rows = []
        for number in race.refused[:MOST_INCIDENTS]:
            event = self._events[number]
            at = self._clock.at(self._account.at(event), 3)
            label = escape(words.command(event.command, event.kart))
            rows.append(
                (at, f'<strong>{label}</strong>', self._official(event), _safe(event.text))
            )
        more = len(race.refused) - len(rows)
        rest = f'<p>{more:,} more are in the table of events.</p>' if more else ''
        head = ('Time', 'Command', 'From', 'Why it was refused')
        return f'<h4>Refused commands</h4>{_table("refusals", head, rows)}{rest}'

    def _heat(self, race: Race) -> str:
        return f' ({_safe(words.name(race.heat))})' if race.heat else ''

    def _changes(self, race: Race) -> str:
        """Return each state that it went to: who brought it there, with what, and when."""
        lines = []
        for change in race.changes:
            state = words.STATES[change.state]
            if change is race.stop:
                state = f'Stopped: {state}'
            event = self._events[change.sequence]
            by = f'by race control itself ({_safe(event.text)})'
            if event.command:
                by = f'by {self._official(event)}, {escape(words.command(event.command, 0))}'
            when = self._clock.at(change.at, 3)
            if race.green is not None and change.at > race.green:
                when += f' ({words.exact(race.green, change.at)} after the start)'
            if change.state == GREEN_GREEN:
                when += f', sent to {words.karts(race.starters)}'
            lines.append(f'<li><strong>{state}</strong> {by}, {when}</li>\n')
        return f'<ul class="changes">\n{"".join(lines)}</ul>'

    def _order(self, race: Race) -> str:
        rows = []
        for result in self._whole.results(race):
            if result.out is not None:
                out = result.out
                what = 'not known' if out.why is Why.NOT_KNOWN else 'did not finish'
                why = words.why_out(out, self._clock).removeprefix('not known: ')
                rows.append(('-', self._kart(result.kart), f'{what}: {why}', ''))
            else:
                finished = result.finished or 0.0
                since = words.exact(race.green, finished) if race.green is not None else ''
                at = self._clock.at(finished, 3)
                rows.append((f'{result.place}.', self._kart(result.kart), since, at))
        text = ''
        if rows:
            head = ('Place', 'Kart', 'Time from GREEN GREEN', 'Marked as finished')
            text = _table('order', head, rows)
        if race.results:
            text += f"<p>In race control's own words: {_safe(race.results)}.</p>"
        return text

    def _incidents(self, numbers: Sequence[int], race: Race | None) -> str:
        if not numbers:
            return '<p>No incident: no stop by an official, no lost connection.</p>'
        rows = []
        for number in numbers[:MOST_INCIDENTS]:
            event = self._events[number]
            at = self._account.at(event)
            since = ''
            if race is not None and race.green is not None and at >= race.green:
                since = words.elapsed(words.between(race.green, at), 3)
            what = _safe(event.text)
            if event.kind == EventKind.COMMAND.name:
                label = escape(words.command(event.command, 0))
                what = f'<strong>{label}</strong> from {self._official(event)}: {what}'
            rows.append((self._clock.at(at, 3), since, self._kart(event.kart), what))
        more = len(numbers) - len(rows)
        rest = f'<p>{more:,} more are in the table of events.</p>' if more else ''
        head = (
            'Time',
            'Since the start',
            'Kart',
            'Stops, lost connections, acknowledgements withdrawn',
        )
        return _table('incidents', head, rows) + rest

    def _alerts(self) -> str:
        if not self._account.alerts:
            return '<section><h2>Alerts</h2><p>There was no alert.</p></section>'
        rows = []
        for alert in self._account.alerts[:MOST_ALERTS]:
            raised = (
                self._clock.at(alert.raised, 1) if alert.raised is not None else 'not recorded'
            )
            rows.append((raised, self._stood(alert), self._kart(alert.kart), _safe(alert.text)))
        head = ('Raised', 'How long it stood', 'Kart', 'What it said when it was raised')
        more = len(self._account.alerts) - len(rows)
        rest = f'<p>{more:,} more are in the table of events.</p>' if more else ''
        return f'<section><h2>Alerts</h2>{_table("alerts", head, rows)}{rest}</section>'

    def _stood(self, alert: Alert) -> str:
        if alert.raised is None:
            return f'ended at {self._clock.at(alert.ended or 0.0, 1)}'
        if alert.stands:
            standing = words.duration(self._whole.length - alert.raised)
            return f'<strong>still standing at the end</strong> ({standing})'
        if alert.ended is None:
            return 'not known: events are missing'
        return words.duration(alert.ended - alert.raised)

    # ----- the timeline -------------------------------------------------------------------

    def _timeline(self) -> str:
        buttons = ''.join(
            f'<button type="button" data-do="{do}"{extra}>{text}</button>'
            for do, text, extra in (
                ('in', 'Zoom in', ''),
                ('out', 'Zoom out', ''),
                ('left', '◀ Earlier', ''),
                ('right', 'Later ▶', ''),
                ('whole', 'Show all', ''),
                *(
                    ('race', f'Race {race.number}', f' data-race="{number}"')
                    for number, race in enumerate(self._account.races[:12])
                ),
            )
        )
        legend = ''.join(
            f'<li><span class="swatch {state}">{escape(word)}</span></li>'
            for state, word in words.STATES.items()
        )
        return f"""<section class="timeline"><h2>Timeline</h2>
{self._part_note()}
<p>Each kart has a line. It shows what race control sent to the kart. Above are the officials'
commands, with their names; those that race control refused are marked ✗. Where there is no room
for all, some have only a stroke: zoom in to read them. A kart that is <b>held</b> is stopped on
its own account, whatever the race does. A hold is shown where it is certain.</p>
<ul class="legend">{legend}<li>no link: not connected, where there is little
room</li><li>✓ acknowledged</li><li>✗ connection lost</li>
<li>↺ acknowledgement withdrawn</li><li><span class="swatch hold">held</span></li></ul>
<div id="view" hidden>
<div class="controls">{buttons}</div>
<p class="hint">Point at anything to read what it is. Drag to move. To zoom, turn the wheel with
Ctrl held down, or without Ctrl once you have clicked the timeline. Keys: + and - to zoom, ← and →
for the events of a line, ↑ and ↓ for the line, Home to show all. The strip at the bottom is the
whole {'run' if self._part.whole else 'part'}; its frame is what you see above.</p>
<div id="plot"><canvas id="lines" tabindex="0" role="application"
aria-label="Timeline; the arrow keys go from event to event"></canvas>
<div id="tip" hidden></div></div>
<p id="detail" role="status"></p>
</div>
<div id="pictures"></div>
<noscript><p>The timeline is drawn by a script, and scripts are switched off.</p></noscript>
</section>"""

    # ----- the table ----------------------------------------------------------------------

    def _table_of_events(self) -> str:
        events = self._account.events
        shown: Sequence[RecordedEvent] = events
        note = ''
        if len(events) > PAPER_ROWS:
            main = [event for event in events if event.kind not in LESSER]
            shown = main[:PAPER_ROWS]
            note = (
                f'<p class="paper"><strong>This table has {len(shown):,} of {len(events):,} '
                'events:</strong> commands, states of the race, lost connections, alerts, results'
            )
            if len(main) > len(shown):
                note += f', the first {len(shown):,} of them'
            note += (
                '. The page on a screen, with JavaScript, has all of them. To print all events of '
                'a short time or of one kart, make a report with --from and --to, or --kart.</p>'
            )
        rows = (
            (
                str(event.sequence),
                self._clock.time(self._wall_ns(event), 3),
                words.elapsed(self._account.at(event), 3),
                f'{event.kart}' if event.kart else '',
                escape(words.KINDS.get(event.kind, plain(event.kind)))
                + ('' if event.success else ' <b>✗</b>'),
                self._label(event)
                + _safe(event.text)
                + (f' <i>[{_safe(words.name(event.official))}]</i>' if event.official else ''),
            )
            for event in shown
        )
        head = ('No.', 'Time of day', 'Elapsed', 'Kart', 'Kind', 'What happened')
        numbers = sorted({event.kart for event in events if event.kart})
        kinds = sorted(
            {event.kind for event in events}, key=lambda kind: words.KINDS.get(kind, kind)
        )
        kart_options = ''.join(f'<option value="{n}">Kart {n}</option>' for n in numbers)
        kind_options = ''.join(
            f'<option value="{escape(kind)}">{escape(words.KINDS.get(kind, plain(kind)))}</option>'
            for kind in kinds
        )
        return f"""<section class="events"><h2>Events</h2>
{self._part_note()}
<div id="browse" hidden>
<div class="controls">
<label>Kart <select id="kart"><option value="">all</option>{kart_options}</select></label>
<label>Kind <select id="kind"><option value="">all</option>
<option value="!">all but the smallest</option><option value="refused">refused commands</option>
{kind_options}</select></label>
<label>With the words <input id="find" type="search" autocomplete="off"></label>
<span id="found" role="status"></span></div>
<div id="scroll" tabindex="0" role="region" aria-label="Events"><table class="all">
<thead><tr>{''.join(f'<th scope="col">{escape(each)}</th>' for each in head)}</tr></thead>
<tbody id="rows"></tbody></table></div></div>
<div id="paper">{note}{_table('all', head, rows)}</div></section>"""

    def _label(self, event: RecordedEvent) -> str:
        if event.kind != EventKind.COMMAND.name:
            return ''
        return f'<b>{escape(words.command(event.command, 0))}</b>: '

    def _origin(self) -> str:
        source, clock = self._source, self._clock
        zone = f'{clock.moment(clock.began_ns):%z}'
        rows: list[tuple[str, str]] = [
            ('Record', _safe(source.file)),
            ('Run', f'{source.run.number}, {_count(len(self._whole.events), "event")}'),
            *((_safe(what), f'<code>{digest}</code>') for what, digest in source.sums),
            ('Version of the rules', _safe(source.rules) if source.rules else 'not recorded'),
            ('Version of this program', _safe(source.program)),
            ('Report made', f'{clock.day(source.made_ns)}, {clock.time(source.made_ns)}'),
            ('Times of day', f'UTC{zone[:3]}:{zone[3:]}, as on the computer that made the report'),
        ]
        if not self._part.whole:
            rows.insert(2, ('Shows only', escape(self._what_part())))
        lines = ''.join(
            f'<tr><th scope="row">{name}</th><td>{text}</td></tr>' for name, text in rows
        )
        return f"""<section class="origin"><h2>Where this comes from</h2>
<table class="facts">{lines}</table>
</section>"""

    # ----- for the script -----------------------------------------------------------------

    def _data(self) -> dict[str, object]:
        account = self._account

        def short(at: float | None) -> float | None:
            return None if at is None else round(at, 3)

        return {
            'start': short(self._start),
            'end': short(self._end),
            'began': self._clock.wall_ns(0.0) // 1_000_000,
            'offset': self._clock.offset,
            'isWhole': self._part.whole,
            'states': words.STATES,
            'short': words.SHORT,
            'kinds': words.KINDS,
            'lesser': sorted(LESSER),
            'race': [[short(b.start), short(b.end), b.what] for b in account.race_bands],
            'races': [
                [
                    short(race.began),
                    short(self._whole.length if race.garage is None else race.garage),
                    race.number,
                ]
                for race in account.races
            ],
            'lanes': [
                {
                    'kart': lane.kart,
                    'team': words.name(lane.team),
                    'bands': [
                        [short(b.start), short(b.end), b.what, short(b.acknowledged)]
                        for b in lane.bands
                    ],
                    'holds': [
                        [
                            short(hold.start),
                            short(hold.end),
                            words.command(hold.command, 0) if hold.command else '',
                        ]
                        for hold in lane.holds
                    ],
                    'marks': [[short(m.at), m.kind, m.sequence] for m in lane.marks],
                }
                for lane in account.lanes
            ],
            'commands': [
                [
                    short(account.at(event)),
                    words.command(event.command, event.kart),
                    int(event.success),
                    words.name(event.official),
                    event.sequence,
                    int(event.success and not event.kart),
                ]
                for event in account.commands
            ],
            'alerts': [
                [
                    short(alert.raised if alert.raised is not None else alert.ended),
                    short(alert.ended if alert.ended is not None else self._end),
                    alert.kart,
                    alert.sequence,
                    _words_of(self._stood(alert)),
                ]
                for alert in account.alerts
            ],
            'gaps': [[short(gap.start), short(gap.end), gap.missing] for gap in account.gaps],
            'events': [
                [
                    event.sequence,
                    (self._wall_ns(event) + 500_000) // 1_000_000,
                    short(account.at(event)),
                    event.kart,
                    event.kind,
                    int(event.success),
                    plain(event.text),
                    words.name(event.official),
                ]
                for event in account.events
            ],
        }


def _words_of(own: str) -> str:
    """Return a sentence of ours without its emphasis."""
    return own.replace('<strong>', '').replace('</strong>', '')
