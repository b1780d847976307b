# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What the recorded events of one run say: races, what each kart was sent, alerts, commands.

Pure. Everything here follows from the fields of the events alone; no sentence is read. Where the
events cannot say what a kart was sent, that is `NOT_KNOWN`. All times are seconds since the first
event of the run, by the clock of the rules: nobody sets that clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
import dataclasses
from dataclasses import dataclass, field
import enum
from itertools import pairwise
from typing import NamedTuple, TypeVar

from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState
from evgp_rcs.catalogue import CATALOGUE, CommandKind
from evgp_rcs.race import EventKind
from evgp_rcs.record import RecordedEvent

IN_GARAGE = RaceState.IN_GARAGE.name
GRID_ACTIVE = RaceState.GRID_ACTIVE.name
GREEN_GREEN = RaceState.GREEN_GREEN.name
RED_FLAG = RaceState.RED_FLAG.name
RED_RED = RaceState.RED_RED.name

NOT_CONNECTED = 'NOT_CONNECTED'
"""In the place of a state: race control sends the kart nothing, since it is not connected."""

NOT_KNOWN = 'NOT_KNOWN'
"""In the place of a state: the record does not say what the kart was sent."""

NO_GRADE = Grade.UNKNOWN.name

STOPS = frozenset(kind.name for kind, entry in CATALOGUE.items() if entry.stop)
SENDS_RED = STOPS | {
    kind.name for kind, entry in CATALOGUE.items() if entry.result.race == (RaceState.RED_RED,)
}

OF_LAPS = frozenset(kind.name for kind, entry in CATALOGUE.items() if entry.of_laps)

OF_THE_SERVER = frozenset(
    kind.name
    for kind in (
        EventKind.MALFORMED,
        EventKind.REFUSED_CONNECTION,
        EventKind.ENDED,
    )
)
"""Events that no input of the rules makes; they say nothing of holds."""


@dataclass
class Band:
    """
    A time in which something was sent: a state, `NOT_CONNECTED` or `NOT_KNOWN`.

    Or in which a link had a grade: a name of ``Grade``.
    """

    start: float
    end: float
    what: str
    acknowledged: float | None = None
    """When the kart first acknowledged it; None: not in this time."""
    delivered: float | None = None
    """When the kart's kernel had answered it; None: that was not seen in this time."""


@dataclass
class Hold:
    """A time in which a kart was certainly held; `command`: the stop it began with, or empty."""

    start: float
    end: float
    command: str


@dataclass
class Lane:
    """
    One kart: what it was sent, when it was held, and how good its link was.

    :param links: each a name of ``Grade``; `NO_GRADE`: nothing is known.
    """

    kart: int
    team: str
    bands: list[Band]
    links: list[Band]
    holds: list[Hold] = field(default_factory=list)

    @property
    def sent(self) -> str:
        """Return what it was sent last."""
        return self.bands[-1].what


@dataclass
class Alert:
    """
    An alert, and how long it stood.

    :param raised: None: in a gap of the record.
    :param ended: None: it had not, or in a gap.
    :param lost_sight: events are missing after it was raised, which may have ended it.
    """

    kart: int
    raised: float | None
    text: str
    sequence: int
    ended: float | None = None
    lost_sight: bool = False

    @property
    def stands(self) -> bool:
        """Return whether it certainly stood at the end of the record."""
        return self.ended is None and not self.lost_sight


class Why(enum.Enum):
    """Why a kart has no place."""

    LOST = 'it lost its connection'
    STOPPED_ALONE = 'an official stopped it alone'
    STOPPED = 'it was stopped'
    FINISH_UNDONE = 'its finish was undone after it had been stopped'
    RACE_STOPPED = 'the race was stopped first'
    RACE_CONTROL_ENDED = 'race control ended first'
    STILL_RACING = 'it was still racing at the end of the record'
    NOT_KNOWN = 'not known: events are missing, and it may have finished'


class Out(NamedTuple):
    """Why a kart did not finish, since when, and by which event; 0: none."""

    why: Why
    at: float
    sequence: int = 0


class Result(NamedTuple):
    """What became of a starter: its place and when it was marked as finished, or why not."""

    kart: int
    place: int = 0
    finished: float | None = None
    out: Out | None = None


class Silence(enum.Enum):
    """Why the record has no acknowledgement of a stop, as far as it says, and since when."""

    LOST = 'not acknowledged: it lost its connection at {}'
    TOLD_ELSE = 'not acknowledged before it was sent another state, at {}'
    NOT_KNOWN = 'not known: events are missing from {} on'
    RECORD_ENDS = 'not acknowledged'


class StopAnswer(NamedTuple):
    """
    What a kart was sent at a stop, when that arrived, and when the kart acknowledged it.

    :param what: `NOT_CONNECTED`: it was sent nothing. `NOT_KNOWN`: the record does not say.
    :param since: when it was first sent that: before the stop, if it was being sent it already.
    :param until: when something else followed.
    :param silence: why there is no acknowledgement; None: there is one, or nothing was sent.
    """

    kart: int
    what: str
    since: float
    delivered: float | None
    acknowledged: float | None
    until: float
    silence: Silence | None


class Stop(NamedTuple):
    """
    A stop, and what each kart was sent that it concerned.

    :param sequence: the event that says so: of a command, or of the race's state if no official's
        command stopped it.
    """

    sequence: int
    at: float
    told: tuple[StopAnswer, ...]

    def slowest(self) -> StopAnswer | None:
        """Return who took longest of those that it told something new, and acknowledged."""
        new = (each for each in self.told if each.since == self.at and each.acknowledged)
        return max(new, key=lambda each: each.acknowledged or 0.0, default=None)


class Change(NamedTuple):
    """A race went to a state, by the command of the event `by`; 0: by none."""

    at: float
    state: str
    sequence: int
    by: int


@dataclass
class RaceAccount:
    """
    One race, from GRID_ACTIVE to IN_GARAGE.

    :param began: the first time that is known of it.
    :param heat: the name of the heat that an official had put into the race; empty: none.
    :param starters: who was sent GREEN_GREEN.
    :param finished: who was marked as finished when, in the order of their places.
    :param out: why each starter that dropped out did so, before it finished.
    :param results: race control's own sentence; empty: none was recorded.
    :param incidents: the numbers of the events that a jury asks about first; ``stops``: of those
        that are stops, of all or of one kart; ``refused``: of the commands that were refused.
    :param taken_up: it was under way when the run began.
    :param incomplete: events are missing in it.
    """

    number: int
    began: float
    heat: str
    taken_up: bool
    incomplete: bool
    changes: list[Change] = field(default_factory=list)
    starters: list[int] = field(default_factory=list)
    finished: dict[int, float] = field(default_factory=dict)
    out: dict[int, Out] = field(default_factory=dict)
    results: str = ''
    incidents: list[int] = field(default_factory=list)
    stops: list[int] = field(default_factory=list)
    refused: list[int] = field(default_factory=list)

    def _first(self, *states: str) -> Change | None:
        return next((change for change in self.changes if change.state in states), None)

    @property
    def green(self) -> float | None:
        """Return when it was started; None: never, or the record does not say."""
        change = self._first(GREEN_GREEN)
        return change.at if change is not None else None

    @property
    def stop(self) -> Change | None:
        """Return what stopped it as a whole; None: nothing did."""
        return self._first(RED_FLAG, RED_RED)

    @property
    def garage(self) -> float | None:
        """Return when it went back to IN_GARAGE; None: it had not."""
        change = self._first(IN_GARAGE)
        return change.at if change is not None else None


class Gap(NamedTuple):
    """Events that the record does not have, between two that it has."""

    start: float
    end: float
    missing: int


class ClockStep(NamedTuple):
    """
    The wall time goes on by so many seconds more, since the event before, than time did.

    Somebody set the computer's clock, or changed the record: no rule can tell.
    """

    at: float
    by: float
    sequence: int


@dataclass
class Account:
    """
    Everything that the events of a run say.

    :param events: all of them, in order.
    :param first: the first event of the run; None: there is none.
    :param length: the time of the last event.
    :param race_bands: the state of the race.
    :param outside: the numbers of incidents outside any race.
    :param ended: the event that says that race control ends; None: there is none.
    """

    events: list[RecordedEvent]
    first: RecordedEvent | None
    length: float
    lanes: list[Lane]
    race_bands: list[Band]
    clock_steps: list[ClockStep]
    races: list[RaceAccount] = field(default_factory=list)
    alerts: list[Alert] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)
    outside: list[int] = field(default_factory=list)
    ended: RecordedEvent | None = None

    @property
    def commands(self) -> list[RecordedEvent]:
        """Return the events of officials' commands."""
        return [event for event in self.events if event.kind == EventKind.COMMAND.name]

    def at(self, event: RecordedEvent) -> float:
        """Return when an event happened."""
        assert self.first is not None
        return event.monotonic - self.first.monotonic

    def results(self, race: RaceAccount) -> list[Result]:
        """Return what became of each starter of a race: in the order of places, then the rest."""
        finished = enumerate(race.finished.items(), 1)
        rest = sorted(set(race.starters) - race.finished.keys())
        return [
            *(Result(kart, place, at) for place, (kart, at) in finished),
            *(Result(kart, out=self._out(race, kart)) for kart in rest),
        ]

    def stops(self, race: RaceAccount) -> list[Stop]:
        """Return the stops of a race, and what they told to whom; of the account of all karts."""
        events = {event.sequence: event for event in self.events}
        return [self._stop(race, events[number]) for number in race.stops if number in events]

    def corrections(self, race: int) -> list[RecordedEvent]:
        """Return what officials corrected of the laps of a race, until the next one began."""
        found, number = [], 0
        for event in self.events:
            number = event.race or number  # in the garage there is none
            is_correction = event.kind == EventKind.COMMAND.name and event.command in OF_LAPS
            if number == race and is_correction and event.success:
                found.append(event)
        return found

    def _stop(self, race: RaceAccount, event: RecordedEvent) -> Stop:
        at = self.at(event)
        told = []
        for lane in self.lanes:
            if event.kart not in (0, lane.kart):
                continue
            later = [band for band in lane.bands if band.end > at]
            band, *after = later or lane.bands[-1:]
            sent = band.what not in (NOT_CONNECTED, NOT_KNOWN)
            if sent and band.what not in (RED_FLAG, RED_RED):
                continue
            if not sent and lane.kart not in (event.kart, *race.starters):
                continue  # nobody had to tell it
            ends = self.ended is not None and band.end >= self.at(self.ended)
            then = after[0].what if after and not ends else ''
            silence = None
            if sent and band.acknowledged is None:
                silence = _SILENCE.get(then, Silence.TOLD_ELSE)
            arrived = band.delivered, band.acknowledged
            told.append(StopAnswer(lane.kart, band.what, band.start, *arrived, band.end, silence))
        return Stop(event.sequence, at, tuple(told))

    def _out(self, race: RaceAccount, kart: int) -> Out:
        known = race.out.get(kart)
        ends = race.stop.at if race.stop is not None else self.length
        began = race.green or 0.0
        gap = next((each for each in self.gaps if each.end >= began and each.start <= ends), None)
        if gap is not None and (known is None or known.at > gap.start):
            # It may even have finished there.
            return Out(Why.NOT_KNOWN, gap.start)
        if known is not None:
            return known
        if race.stop is not None:
            return Out(Why.RACE_STOPPED, race.stop.at, race.stop.by)
        if self.ended is not None:
            return Out(Why.RACE_CONTROL_ENDED, self.at(self.ended), self.ended.sequence)
        return Out(Why.STILL_RACING, self.length)


_SILENCE = {
    '': Silence.RECORD_ENDS,
    NOT_CONNECTED: Silence.LOST,
    NOT_KNOWN: Silence.NOT_KNOWN,
}
"""Why a kart did not acknowledge, by what it was sent then; of any other state, that one."""

MOST_CLOCK_STEP = 0.1
"""Maximum difference of the two clocks between two events that goes for none, in seconds."""


def clock_steps(events: Sequence[RecordedEvent]) -> list[ClockStep]:
    """Return where the wall times do not go on as the clock of the rules does."""
    steps = []
    for before, event in pairwise(events):
        by = (event.wall_ns - before.wall_ns) / 1e9 - (event.monotonic - before.monotonic)
        if abs(by) > MOST_CLOCK_STEP:
            steps.append(ClockStep(event.monotonic - events[0].monotonic, by, event.sequence))
    return steps


def read(events: Iterable[RecordedEvent], teams: Mapping[int, str] | None = None) -> Account:
    """
    Return what the events of one run, in order, say.

    :param teams: the teams of the roster, by the numbers of their karts, if they are recorded.
    """
    return _Reading(list(events), teams or {}).account


class _Reading:
    """One pass over the events."""

    def __init__(self, events: list[RecordedEvent], teams: Mapping[int, str]) -> None:
        first = events[0] if events else None
        length = events[-1].monotonic - events[0].monotonic if events else 0.0
        missing = events[0].sequence - 1 if events else 0
        # No kart is connected when a run begins, in IN_GARAGE. One that takes up a race says so
        # with its first event. What a refused command names need not be a kart of the roster.
        refused = EventKind.COMMAND.name, False
        numbers = {event.kart for event in events if (event.kind, event.success) != refused}
        lanes = [
            Lane(
                number,
                teams.get(number, ''),
                [Band(0.0, length, NOT_KNOWN if missing else NOT_CONNECTED)],
                [Band(0.0, length, NO_GRADE)],
            )
            for number in sorted((numbers | teams.keys()) - {0})
        ]
        self._lanes = {lane.kart: lane for lane in lanes}
        self._holds: dict[int, Hold] = {}  # those that last
        self._standing: dict[tuple[int, str | None], Alert] = {}
        self._race: RaceAccount | None = None
        self._command: RecordedEvent | None = None  # the last that was accepted
        race_bands = [Band(0.0, length, NOT_KNOWN if missing else IN_GARAGE)]
        self.account = Account(events, first, length, lanes, race_bands, clock_steps(events))
        if missing:
            self.account.gaps.append(Gap(0.0, 0.0, missing))
        for before, event in pairwise([None, *events]):
            assert event is not None
            self._take(before, event)
        for lane in lanes:
            lane.bands = _lasting(lane.bands)
            lane.links = _lasting(lane.links)
            lane.holds = [hold for hold in lane.holds if hold.end > hold.start]
        self.account.race_bands = _lasting(race_bands)

    @property
    def _state(self) -> str:
        return self.account.race_bands[-1].what

    def _take(self, before: RecordedEvent | None, event: RecordedEvent) -> None:
        at = self.account.at(event)
        if before is not None and event.sequence > before.sequence + 1:
            self._lose_sight(self.account.at(before), at, event.sequence - before.sequence - 1)
        self._race = self._race_of(event, at)
        take = _TAKES.get(event.kind)
        lane = self._lanes.get(event.kart)
        if take is not None:
            take(self, event, at)
        elif lane is not None and event.kind in _TAKES_OF_A_KART:
            _TAKES_OF_A_KART[event.kind](self, lane, event, at)
        if event.kind not in OF_THE_SERVER:
            self._see_holds(event, at)

    def _lose_sight(self, since: float, at: float, missing: int) -> None:
        """Take note of missing events: what stands may have ended there."""
        self.account.gaps.append(Gap(since, at, missing))
        _change(self.account.race_bands, since, NOT_KNOWN)
        for kart, lane in self._lanes.items():
            _change(lane.bands, since, NOT_KNOWN)
            _change(lane.links, since, NO_GRADE)
            self._release(kart, since)
        for alert in self._standing.values():
            alert.lost_sight = True
        self._standing.clear()
        self._command = None
        for race in self.account.races[-1:]:
            race.incomplete |= race.garage is None

    # ----- karts --------------------------------------------------------------------------

    def _connected(self, lane: Lane, event: RecordedEvent, at: float) -> None:
        # What it is sent follows, in an event of its own.
        _change(lane.bands, at, NOT_KNOWN)

    def _disconnected(self, lane: Lane, event: RecordedEvent, at: float) -> None:
        _change(lane.bands, at, NOT_CONNECTED)
        _change(lane.links, at, NO_GRADE)
        if self.account.ended is None:
            if self._race is not None:
                self._incident(event)
            self._drops_out(event, at, Why.LOST)

    def _kart_state(self, lane: Lane, event: RecordedEvent, at: float) -> None:
        if lane.sent == NOT_CONNECTED:
            return  # what it would be sent
        state = event.state or NOT_KNOWN
        _change(lane.bands, at, state)
        if state == GREEN_GREEN and self._race is not None:
            if event.kart not in self._race.starters:
                self._race.starters.append(event.kart)
        elif self._state == GREEN_GREEN:
            self._drops_out(event, at, Why.STOPPED)

    def _delivered(self, lane: Lane, event: RecordedEvent, at: float) -> None:
        band = self._answered(lane, event, at)
        if band is not None and band.delivered is None:
            band.delivered = min(at, band.start + event.after)

    def _acknowledged(self, lane: Lane, event: RecordedEvent, at: float) -> None:
        band = self._answered(lane, event, at)
        if band is not None and band.acknowledged is None:
            band.acknowledged = at

    def _answered(self, lane: Lane, event: RecordedEvent, at: float) -> Band | None:
        """Return what the kart, or its kernel, answers; None: it is not being sent that."""
        state = event.state or NOT_KNOWN
        if lane.sent == NOT_KNOWN:
            # Only what a kart is being sent can be answered.
            _change(lane.bands, at, state)
        return lane.bands[-1] if lane.sent == state else None

    def _link_grade(self, lane: Lane, event: RecordedEvent, at: float) -> None:
        _change(lane.links, at, event.grade or NO_GRADE)

    def _withdrawn(self, lane: Lane, event: RecordedEvent, at: float) -> None:
        if lane.sent in (RED_FLAG, RED_RED):
            self._incident(event)  # it had stopped, by its own word

    def _see_holds(self, event: RecordedEvent, at: float) -> None:
        """Take note of how the event says that its kart is held, or every kart."""
        command = event.command if event.success and event.command in STOPS else ''
        if event.hold is None:
            self._release(event.kart, at)
            return
        for number in [event.kart] if event.kart else self._lanes:
            if number in self._lanes and number not in self._holds:
                self._holds[number] = Hold(at, self.account.length, command or '')
                self._lanes[number].holds.append(self._holds[number])

    def _release(self, kart: int, at: float) -> None:
        if kart in self._holds:
            self._holds.pop(kart).end = at

    # ----- the race -----------------------------------------------------------------------

    def _race_of(self, event: RecordedEvent, at: float) -> RaceAccount | None:
        """Return the race that was under way; None: none was."""
        races = self.account.races
        if not event.race:
            return None
        if not races or races[-1].number != event.race:
            taken_up = event.command != CommandKind.GRID_ACTIVE.name
            incomplete = taken_up and event.sequence != 1
            races.append(RaceAccount(event.race, at, event.heat, taken_up, incomplete))
        return races[-1]

    def _race_state(self, event: RecordedEvent, at: float) -> None:
        before, state = self._state, event.state or NOT_KNOWN
        _change(self.account.race_bands, at, state)
        race = self._race
        if race is None:
            return
        cause = self._cause(event)
        change = Change(at, state, event.sequence, cause.sequence if cause is not None else 0)
        race.changes.append(change)
        if change is race.stop and change.by:
            # Who was stopped with all others was not stopped alone.
            race.out = {kart: out for kart, out in race.out.items() if out.sequence != change.by}
        goes_on = event.sequence != 1 and before != NOT_KNOWN
        if state in (RED_FLAG, RED_RED) and goes_on and change.by not in race.stops:
            race.stops.append(event.sequence)

    def _cause(self, event: RecordedEvent) -> RecordedEvent | None:
        """Return the event of the command that caused this one: it stands before its effects."""
        return self._command if event.command else None

    def _commanded(self, event: RecordedEvent, at: float) -> None:
        race = self._race
        if not event.success:
            if race is not None:
                race.refused.append(event.sequence)
            return
        self._command = event
        if event.command in SENDS_RED and race is not None:
            race.stops.append(event.sequence)
        if event.command in STOPS:
            self._incident(event)
        if race is None or event.kart not in self._lanes:
            return
        if event.command == CommandKind.KART_FINISH.name:
            race.finished[event.kart] = at
        elif event.command == CommandKind.KART_UNDO_FINISH.name:
            race.finished.pop(event.kart, None)  # later places move up
            if self._lanes[event.kart].sent != GREEN_GREEN:
                self._drops_out(event, at, Why.FINISH_UNDONE)

    def _drops_out(self, event: RecordedEvent, at: float, why: Why) -> None:
        race, kart = self._race, event.kart
        if race is None or race.green is None or race.stop is not None:
            return
        if kart in race.starters and kart not in race.out and kart not in race.finished:
            cause = self._cause(event)
            if why is Why.STOPPED and cause is not None and cause.kart:
                why = Why.STOPPED_ALONE
            race.out[kart] = Out(why, at, (cause or event).sequence)
            self._incident(cause or event)

    def _incident(self, event: RecordedEvent) -> None:
        incidents = self.account.outside if self._race is None else self._race.incidents
        if event.sequence not in incidents[-1:]:
            incidents.append(event.sequence)

    def _results(self, event: RecordedEvent, at: float) -> None:
        if self._race is not None:
            self._race.results = event.text

    # ----- the rest -----------------------------------------------------------------------

    def _alert_raised(self, event: RecordedEvent, at: float) -> None:
        alert = Alert(event.kart, at, event.text, event.sequence)
        self.account.alerts.append(alert)
        self._standing[event.kart, event.alert] = alert

    def _alert_cleared(self, event: RecordedEvent, at: float) -> None:
        alert = self._standing.pop((event.kart, event.alert), None)
        if alert is None:
            alert = Alert(event.kart, None, event.text, event.sequence)
            self.account.alerts.append(alert)
        alert.ended = at

    def _race_control_ends(self, event: RecordedEvent, at: float) -> None:
        self.account.ended = event
        for lane in self._lanes.values():
            if lane.sent not in (NOT_CONNECTED, NOT_KNOWN):
                # The last that every connected kart hears.
                _change(lane.bands, at, RED_RED)


_TAKES: Mapping[str, Callable[[_Reading, RecordedEvent, float], None]] = {
    EventKind.COMMAND.name: _Reading._commanded,
    EventKind.RACE_STATE.name: _Reading._race_state,
    EventKind.ALERT_RAISED.name: _Reading._alert_raised,
    EventKind.ALERT_CLEARED.name: _Reading._alert_cleared,
    EventKind.RESULTS.name: _Reading._results,
    EventKind.ENDED.name: _Reading._race_control_ends,
}

_TAKES_OF_A_KART: Mapping[str, Callable[[_Reading, Lane, RecordedEvent, float], None]] = {
    EventKind.KART_STATE.name: _Reading._kart_state,
    EventKind.DELIVERED.name: _Reading._delivered,
    EventKind.ACKNOWLEDGED.name: _Reading._acknowledged,
    EventKind.LINK_GRADE.name: _Reading._link_grade,
    EventKind.WITHDRAWN.name: _Reading._withdrawn,
    EventKind.CONNECTED.name: _Reading._connected,
    EventKind.DISCONNECTED.name: _Reading._disconnected,
}


def _change(bands: list[Band], at: float, what: str) -> None:
    """End the last band, and begin another that lasts to where the last one would have."""
    end, bands[-1].end = bands[-1].end, at
    bands.append(Band(at, end, what))


def _lasting(bands: Sequence[Band]) -> list[Band]:
    """Return the bands that last, and the last one, however short it is."""
    return [band for band in bands[:-1] if band.end > band.start] + list(bands[-1:])


# ----- a part of a run ------------------------------------------------------------------------

_Span = TypeVar('_Span', Band, Hold)


@dataclass(frozen=True)
class Part:
    """
    What a report shows of a run; the rest is left out, and the report says so.

    :param start: from this time on; None: from the beginning.
    :param end: up to this time; None: to the end.
    :param kart: this kart, and what concerns no single kart; None: every kart.
    """

    start: float | None = None
    end: float | None = None
    kart: int | None = None

    @property
    def whole(self) -> bool:
        """Return whether nothing is left out."""
        return self.start is None and self.end is None and self.kart is None

    def span(self, account: Account) -> tuple[float, float]:
        """Return the times between which it shows what happened."""
        start = 0.0 if self.start is None else max(0.0, self.start)
        end = account.length if self.end is None else min(account.length, self.end)
        return start, max(start, end)

    def narrow(self, account: Account) -> Account:
        """Return the account of this part; what a kart was sent before it is not forgotten."""
        if self.whole:
            return account
        start, end = self.span(account)

        def concerns(kart: int) -> bool:
            return self.kart is None or kart in (0, self.kart)

        def touches(begins: float | None, ends: float | None) -> bool:
            last = account.length if ends is None else ends
            return (begins or 0.0) <= end and last >= start

        def cut(spans: list[_Span]) -> list[_Span]:
            return [
                dataclasses.replace(each, start=max(each.start, start), end=min(each.end, end))
                for each in spans
                if touches(each.start, each.end)
            ]

        events = [
            event
            for event in account.events
            if concerns(event.kart) and start <= account.at(event) <= end
        ]
        kept = {event.sequence for event in events}

        def in_part(numbers: list[int]) -> list[int]:
            return [number for number in numbers if number in kept]

        return dataclasses.replace(
            account,
            events=events,
            lanes=[
                dataclasses.replace(
                    lane,
                    bands=cut(lane.bands),
                    links=cut(lane.links),
                    holds=cut(lane.holds),
                )
                for lane in account.lanes
                if concerns(lane.kart)
            ],
            race_bands=cut(account.race_bands),
            races=[
                dataclasses.replace(
                    race,
                    incidents=in_part(race.incidents),
                    stops=in_part(race.stops),
                    refused=in_part(race.refused),
                )
                for race in account.races
                if touches(race.began, race.garage)
            ],
            alerts=[
                alert
                for alert in account.alerts
                if concerns(alert.kart) and touches(alert.raised, alert.ended)
            ],
            gaps=[gap for gap in account.gaps if touches(gap.start, gap.end)],
            clock_steps=[step for step in account.clock_steps if start <= step.at <= end],
            outside=in_part(account.outside),
        )
