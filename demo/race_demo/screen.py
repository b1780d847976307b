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
What the reader sees: events as they come, a live table, and at the end timeline and findings.

On a terminal the table stays below the events and is kept up to date. Anywhere else (a file, CI)
only lines are printed that stay true.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
import contextlib
import itertools
import threading

from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.official import Official
from race_demo.checks import Finding
from race_demo.record import Entrant, Order, RaceRecord, time_of
from rich.console import Console
from rich.live import Live
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

WIDTH = 100

COLOURS: dict[RaceState | None, str] = {
    RaceState.IN_GARAGE: 'cyan',
    RaceState.GRID_ACTIVE: 'blue',
    RaceState.GREEN_GREEN: 'green',
    RaceState.RED_FLAG: 'yellow',
    RaceState.RED_RED: 'red',
}

# The timeline shows each order and what became of it; as they come, these are enough.
_NOT_TOLD_LIVE = (
    msg.RaceEvent.KART_STATE,
    msg.RaceEvent.ACKNOWLEDGED,
    msg.RaceEvent.REPORTED,
)


class Screen:
    """
    Prints what an official hears.

    :param began: the zero of all times that are shown (monotonic, s).
    :param sees: returns the state that a kart sees, None while it sees none.
    """

    def __init__(
        self,
        console: Console,
        began: float,
        official: Official,
        entrants: Sequence[Entrant],
        sees: Callable[[int], RaceState | None],
    ) -> None:
        """Print nothing yet."""
        self._console = console
        self._began = began
        self._official = official
        self._entrants = {entrant.number: entrant for entrant in entrants}
        self._sees = sees
        self._printed = 0
        self._closing = False

    @contextlib.contextmanager
    def watching(self, title: str) -> Iterator[None]:
        """Print the events as they come and, on a terminal, keep a table below them."""
        self._console.rule(title, style='bold')
        self._closing = False
        teller = threading.Thread(target=self._tell_events, name='screen', daemon=True)
        live = (
            Live(
                get_renderable=lambda: self._table(title),
                console=self._console,
                refresh_per_second=8,
                transient=True,
            )
            if self._console.is_terminal
            else contextlib.nullcontext()
        )
        with live:
            teller.start()
            try:
                yield
            finally:
                with self._official.news:
                    self._closing = True
                    self._official.news.notify_all()
                teller.join()

    def show_karts(self, title: str) -> None:
        """Print the table of the karts as it is now."""
        self._console.print(Padding(self._table(title), (1, 0)))

    def show_timeline(self, record: RaceRecord) -> None:
        """Print who was told what, when each kart saw it, and when it was acknowledged."""
        grid = Table.grid(padding=(0, 2))
        grid.add_column(justify='right', no_wrap=True)
        grid.add_column()
        grid.add_row(
            Text('time', style='bold'),
            Text(_order_line('kart', 'told', 'seen after', 'acknowledged after'), style='bold'),
        )
        happened: list[tuple[float, Text]] = [
            (time_of(event), _event_text(event))
            for event in record.events
            if event.kind not in _NOT_TOLD_LIVE
        ]
        happened += [(order.at, self._order_text(order)) for order in record.orders()]
        # Stable: of what race control did at once, the cause stands before its effects.
        for at, text in sorted(happened, key=lambda each: each[0]):
            grid.add_row(f'{at - self._began:.3f}', text)
        self._console.rule(f'{record.title}: timeline, seconds', style='bold')
        self._console.print(grid)

    def show_findings(self, title: str, findings: Iterable[Finding]) -> None:
        """Print what was found, and what is missing."""
        grid = Table.grid(padding=(0, 2))
        for finding in findings:
            word = Text('ok', style='green') if finding.ok else Text('MISSING', style='bold red')
            grid.add_row(word, Text(finding.text))
        self._console.rule(title, style='bold')
        self._console.print(grid)

    def _tell_events(self) -> None:
        official = self._official
        closing = False
        while not closing:
            with official.news:
                official.news.wait_for(
                    lambda: self._closing or len(official.events) > self._printed
                )
                closing = self._closing
                events = list(itertools.islice(official.events, self._printed, None))
                self._printed += len(events)
            for event in events:
                if event.kind not in _NOT_TOLD_LIVE:
                    grid = Table.grid(padding=(0, 2))
                    grid.add_column(justify='right', width=7)
                    grid.add_row(f'{time_of(event) - self._began:.3f}', _event_text(event))
                    self._console.print(grid)

    def _table(self, title: str) -> Table:
        race = self._official.race
        table = Table(title=title, title_justify='left', title_style='bold')
        for heading in ('Kart', 'Team', 'Kind', 'Told', 'Acknowledged', 'Sees', 'Race'):
            # As wide as the longest state, so that the table keeps its shape.
            width = len(RaceState.GREEN_GREEN.value) if heading in ('Told', 'Sees') else None
            table.add_column(heading, no_wrap=heading != 'Kind', min_width=width)
        for kart in race.karts if race is not None else ():
            entrant = self._entrants[kart.number]
            told = state_of(kart.sent)
            if not kart.connected:
                acknowledged = Text('not there', style='bold red')
            elif kart.acknowledged:
                acknowledged = Text('yes', style='green')
            else:
                # No kart has to acknowledge IN_GARAGE.
                acknowledged = Text('' if told is RaceState.IN_GARAGE else 'not yet')
            part = f'place {kart.place}' if kart.place else 'in it' if kart.in_race else ''
            table.add_row(
                str(kart.number),
                kart.team,
                entrant.kind,
                _state_text(told),
                acknowledged,
                _state_text(self._sees(kart.number)),
                part,
            )
        if race is not None:
            track = 'open to' if race.track.open else 'closed to'
            table.caption = (
                f'The race is in {_name(state_of(race.state))}{", over" if race.over else ""}; '
                f'the track is {track} humans; alerts: {len(race.alerts)}'
            )
            table.caption_justify = 'left'
        return table

    def _order_text(self, order: Order) -> Text:
        entrant = self._entrants[order.kart]
        state = order.state
        acknowledged = _after(order.at, order.acknowledged)
        if order.acknowledged is None:
            acknowledged = '' if state is RaceState.IN_GARAGE else 'never'
        line = _order_line(
            f'{order.kart:>3} {entrant.team}',
            state.value,
            _after(order.at, order.seen) or 'never',
            acknowledged,
        )
        text = Text(line)
        text.highlight_words([state.value], COLOURS[state])
        text.highlight_words(['never'], 'bold red')
        return text


def make_console() -> Console:
    """Return a console that is never wider than a page, and as wide where width is not known."""
    console = Console(highlight=False)
    width = min(WIDTH, console.width) if console.is_terminal else WIDTH
    return Console(highlight=False, width=width)


def _order_line(kart: str, told: str, seen: str, acknowledged: str) -> str:
    return f'    {kart:<22}{told:<14}{seen:>12}{acknowledged:>22}'


def _after(begin: float, end: float | None) -> str:
    # A kart can be quicker than race control's look at the clock.
    return f'{max(0.0, end - begin):.3f}' if end is not None else ''


def _event_text(event: msg.RaceEvent) -> Text:
    if event.kind == msg.RaceEvent.ALERT_RAISED or not event.success:
        return Text(event.text, style='bold red')
    return Text(event.text, style='bold' if event.kind == msg.RaceEvent.COMMAND else '')


def _state_text(state: RaceState | None) -> Text:
    return Text(_name(state), style=COLOURS.get(state, ''))


def _name(state: RaceState | None) -> str:
    return state.value if state is not None else 'nothing'
