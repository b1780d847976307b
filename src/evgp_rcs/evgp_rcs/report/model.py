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


STOPS = frozenset(kind.name for kind, entry in CATALOGUE.items() if entry.stop)
SENDS_RED = STOPS | {
    kind.name for kind, entry in CATALOGUE.items() if entry.result.race == (RaceState.RED_RED,)
}


@dataclass
class Band:
    """
    A time in which something stayed the same.

    :param what: the name of a ``RaceState``, `NOT_CONNECTED` or `NOT_KNOWN`.
    :param acknowledged: when the kart first acknowledged it; None: not in this time.
    :param sequence: the event it begins with; 0: none.
    """

    start: float
    end: float
    what: str
    acknowledged: float | None = None
    sequence: int = 0


@dataclass
class Hold:
    """
    A time in which a kart was held on its own account, as far as the events say.

    :param command: the name of the stop that it began with; empty: it began with none.
    """

    start: float
    end: float
    command: str


@dataclass(frozen=True)
class Mark:
    """A moment on a kart's lane: the name of an ``EventKind``."""

    at: float
    kind: str
    sequence: int


@dataclass
class Lane:
    """
    One kart: what it was sent, when it was known to be held, and what it said or lost.

    :param team: the name of its team; empty: not recorded.
    """

    kart: int
    team: str = ''
    bands: list[Band] = field(default_factory=list)
    holds: list[Hold] = field(default_factory=list)
    marks: list[Mark] = field(default_factory=list)


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


@dataclass(frozen=True)
class Finish:
    """A kart in its place, and when it was marked as finished."""

    kart: int
    at: float


class Why(enum.Enum):
    """Why a kart has no place."""

    LOST = 'LOST'
    STOPPED_ALONE = 'STOPPED_ALONE'
    STOPPED = 'STOPPED'
    FINISH_UNDONE = 'FINISH_UNDONE'
    RACE_STOPPED = 'RACE_STOPPED'
    RACE_CONTROL_ENDED = 'RACE_CONTROL_ENDED'
    STILL_RACING = 'STILL_RACING'
    NOT_KNOWN = 'NOT_KNOWN'


@dataclass(frozen=True)
class Out:
    """
    Why a kart did not finish, and since when.

    :param sequence: the event that says so; 0: none.
    """

    why: Why
    at: float
    sequence: int = 0


@dataclass(frozen=True)
class Result:
    """
    What became of a starter.

    :param place: from 1; 0: it did not finish.
    :param seconds: the time from GREEN_GREEN to its finish; None: not finished, or not known.
    :param finished: when it was marked as finished; None: it was not.
    :param out: why it did not finish; None: it did.
    """

    kart: int
    place: int = 0
    seconds: float | None = None
    finished: float | None = None
    out: Out | None = None


class Silence(enum.Enum):
    """Why the record has no acknowledgement of what a kart was told, as far as it says."""

    LOST = 'LOST'
    """It lost its connection first."""
    TOLD_ELSE = 'TOLD_ELSE'
    """It was sent another state first."""
    NOT_KNOWN = 'NOT_KNOWN'
    """Events are missing: it may have acknowledged there."""
    RECORD_ENDS = 'RECORD_ENDS'
    """Until the record ends it had not."""


@dataclass(frozen=True)
class Told:
    """
    What a kart was sent at a stop, and when it acknowledged that.

    :param what: `NOT_CONNECTED`: it was sent nothing. `NOT_KNOWN`: the record does not say.
    :param since: when it was first sent that: before the stop, if it was being sent it already.
    :param acknowledged: when it first acknowledged it; None: not before `until`.
    :param until: when something else followed.
    :param silence: why there is no acknowledgement; None: there is one, or nothing was sent.
    """

    kart: int
    what: str
    since: float
    acknowledged: float | None
    until: float
    silence: Silence | None = None

    @property
    def sent(self) -> bool:
        """Return whether the record has it that it was sent anything."""
        return self.what not in (NOT_CONNECTED, NOT_KNOWN)


@dataclass(frozen=True)
class Stop:
    """
    A stop, and what each kart was sent that it concerned.

    :param sequence: the event that says so: of a command, or of the race's state if no official's
        command stopped it.
    """

    sequence: int
    at: float
    told: tuple[Told, ...]

    def slowest(self) -> Told | None:
        """Return who took longest of those that it told something new, and acknowledged."""
        return max(
            (
                each
                for each in self.told
                if each.since == self.at and each.acknowledged is not None
            ),
            key=lambda each: (each.acknowledged or 0.0) - each.since,
            default=None,
        )


@dataclass(frozen=True)
class Change:
    """
    A race went to another state.

    :param state: the name of a ``RaceState``, or `NOT_KNOWN`.
    :param sequence: the event that says so, and why.
    :param by: the number of the command's event that brought it about; 0: none did.
    """

    at: float
    state: str
    sequence: int
    by: int = 0


@dataclass
class Race:
    """
    One race, from GRID_ACTIVE to IN_GARAGE.

    :param began: the first time that is known of it.
    :param heat: the name of the heat that an official had put into the race; empty: none.
    :param changes: of its state, in order.
    :param starters: who was sent GREEN_GREEN.
    :param finished: in the order of their places.
    :param out: why each starter that dropped out did so, before it finished.
    :param results: race control's own sentence; empty: none was recorded.
    :param incidents: the numbers of the events that a jury asks about first.
    :param stops: the numbers of the events that are stops, of all or of one kart.
    :param refused: the numbers of the commands that race control refused in it.
    :param taken_up: it was under way when the run began.
    :param incomplete: events are missing in it.
    """

    number: int
    began: float
    heat: str
    changes: list[Change] = field(default_factory=list)
    starters: list[int] = field(default_factory=list)
    finished: list[Finish] = field(default_factory=list)
    out: dict[int, Out] = field(default_factory=dict)
    results: str = ''
    incidents: list[int] = field(default_factory=list)
    stops: list[int] = field(default_factory=list)
    refused: list[int] = field(default_factory=list)
    taken_up: bool = False
    incomplete: bool = False

    def first(self, *states: str) -> Change | None:
        """Return its first change to one of these states; None: the record has none."""
        return next((change for change in self.changes if change.state in states), None)

    @property
    def green(self) -> float | None:
        """Return when it was started; None: never, or the record does not say."""
        change = self.first(GREEN_GREEN)
        return change.at if change is not None else None

    @property
    def stop(self) -> Change | None:
        """Return what stopped it as a whole; None: nothing did."""
        return self.first(RED_FLAG, RED_RED)

    @property
    def garage(self) -> float | None:
        """Return when it went back to IN_GARAGE; None: it had not."""
        change = self.first(IN_GARAGE)
        return change.at if change is not None else None


@dataclass(frozen=True)
class Gap:
    """Events that the record does not have, between two that it has."""

    start: float
    end: float
    missing: int


@dataclass(frozen=True)
class ClockStep:
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
    races: list[Race]
    alerts: list[Alert]
    commands: list[RecordedEvent]
    gaps: list[Gap]
    clock_steps: list[ClockStep]
    outside: list[int]
    ended: RecordedEvent | None

    @property
    def in_order(self) -> bool:
        """Return whether the run has ended in good order, by its own events."""
        return self.ended is not None and self.ended.success

    def at(self, event: RecordedEvent) -> float:
        """Return when an event happened."""
        assert self.first is not None
        return event.monotonic - self.first.monotonic

    def results(self, race: Race) -> list[Result]:
        """Return what became of each starter of a race: in the order of places, then the rest."""
        green = race.green
        finished = [
            Result(each.kart, place, None if green is None else each.at - green, each.at)
            for place, each in enumerate(race.finished, 1)
        ]
        rest = sorted(set(race.starters) - {each.kart for each in finished})
        return finished + [Result(kart, out=self._out(race, kart)) for kart in rest]

    def stops(self, race: Race) -> list[Stop]:
        """Return the stops of a race, and what they told to whom; of the account of all karts."""
        events = {event.sequence: event for event in self.events}
        return [self._stop(race, events[number]) for number in race.stops if number in events]

    def _stop(self, race: Race, event: RecordedEvent) -> Stop:
        at = self.at(event)
        told = []
        for lane in self.lanes:
            if event.kart not in (0, lane.kart):
                continue
            number = next((n for n, band in enumerate(lane.bands) if band.end > at), -1)
            band, *after = lane.bands[number:] if number >= 0 else lane.bands[-1:]
            concerned = band.what in (RED_FLAG, RED_RED) or (
                # It should have been told.
                band.what in (NOT_CONNECTED, NOT_KNOWN)
                and lane.kart in (event.kart, *race.starters)
            )
            if concerned:
                ends = self.ended is not None and band.end >= self.at(self.ended)
                then = after[0].what if after and not ends else ''
                told.append(
                    Told(
                        lane.kart,
                        band.what,
                        band.start,
                        band.acknowledged,
                        band.end,
                        None
                        if band.what in (NOT_CONNECTED, NOT_KNOWN) or band.acknowledged is not None
                        else _SILENCE.get(then, Silence.TOLD_ELSE),
                    )
                )
        return Stop(event.sequence, at, tuple(told))

    def _out(self, race: Race, kart: int) -> Out:
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


class _Kart:
    """What is known of one kart while the events go by."""

    def __init__(self, lane: Lane) -> None:
        self.lane = lane
        self.hold: Hold | None = None

    @property
    def sent(self) -> str:
        """Return what it is sent now, `NOT_CONNECTED` or `NOT_KNOWN`."""
        return self.lane.bands[-1].what


class _Reading:
    """One pass over the events."""

    def __init__(self, events: list[RecordedEvent], teams: Mapping[int, str]) -> None:
        self._first = events[0].monotonic if events else 0.0
        self._length = events[-1].monotonic - self._first if events else 0.0
        whole = not events or events[0].sequence == 1
        # No kart is connected when a run begins.
        before = NOT_CONNECTED if whole else NOT_KNOWN
        # What a refused command names need not be a kart of the roster.
        numbers = {event.kart for event in events if event.kart and not _refused(event)}
        numbers.update(teams)
        self._karts = {
            number: _Kart(Lane(number, teams.get(number, ''), [Band(0.0, self._length, before)]))
            for number in sorted(numbers)
        }
        # Every run begins in IN_GARAGE; one that takes up a race says so with its first event.
        state = IN_GARAGE if whole else NOT_KNOWN
        self._race_bands = [Band(0.0, self._length, state)]
        self._race: Race | None = None
        self._alerts = _Alerts()
        self._before: RecordedEvent | None = None
        self._command: RecordedEvent | None = None  # the last that was accepted
        self.account = Account(
            events,
            events[0] if events else None,
            self._length,
            lanes=[],
            race_bands=[],
            races=[],
            alerts=[],
            commands=[],
            gaps=[],
            clock_steps=clock_steps(events),
            outside=[],
            ended=None,
        )
        if not whole:
            self.account.gaps.append(Gap(0.0, 0.0, events[0].sequence - 1))
        for event in events:
            self._take(event)
        for kart in self._karts.values():
            kart.lane.bands = _lasting(kart.lane.bands)
            kart.lane.holds = [hold for hold in kart.lane.holds if hold.end > hold.start]
            self.account.lanes.append(kart.lane)
        self.account.race_bands = _lasting(self._race_bands)
        self.account.alerts = self._alerts.told

    @property
    def _state(self) -> str:
        return self._race_bands[-1].what

    def _take(self, event: RecordedEvent) -> None:
        at = event.monotonic - self._first
        if self._before is not None:
            self._compare(self._before, event, at)
        self._before = event
        self._race = self._race_of(event, at)
        take: Callable[[_Reading, RecordedEvent, float], object] | None = _TAKES.get(event.kind)
        if take is None and event.kart in self._karts:
            take = _TAKES_OF_A_KART.get(event.kind)
        if take is not None:
            take(self, event, at)
        if event.kind not in _OF_THE_SERVER:
            self._see_holds(event, at)

    def _compare(self, before: RecordedEvent, event: RecordedEvent, at: float) -> None:
        """Look for missing events."""
        missing = event.sequence - before.sequence - 1
        if not missing:
            return
        since = before.monotonic - self._first
        self.account.gaps.append(Gap(since, at, missing))
        _change(self._race_bands, since, NOT_KNOWN)
        for kart in self._karts.values():
            _change(kart.lane.bands, since, NOT_KNOWN)
            self._release(kart, since)
        self._alerts.lose_sight()
        self._command = None
        for race in self.account.races[-1:]:
            race.incomplete |= race.garage is None

    # ----- karts --------------------------------------------------------------------------

    def _mark(self, event: RecordedEvent, at: float) -> _Kart:
        kart = self._karts[event.kart]
        kart.lane.marks.append(Mark(at, event.kind, event.sequence))
        return kart

    def _connected(self, event: RecordedEvent, at: float) -> None:
        # What it is sent follows, in an event of its own.
        _change(self._mark(event, at).lane.bands, at, NOT_KNOWN, event.sequence)

    def _disconnected(self, event: RecordedEvent, at: float) -> None:
        _change(self._mark(event, at).lane.bands, at, NOT_CONNECTED, event.sequence)
        if self.account.ended is None:
            if self._race is not None:
                self._incident(event)
            self._drops_out(event, at, Why.LOST)

    def _kart_state(self, event: RecordedEvent, at: float) -> None:
        kart = self._karts[event.kart]
        state = _state_of(event)
        if kart.sent == NOT_CONNECTED:
            return  # what it would be sent
        _change(kart.lane.bands, at, state, event.sequence)
        if state == GREEN_GREEN and self._race is not None:
            if event.kart not in self._race.starters:
                self._race.starters.append(event.kart)
        elif self._state == GREEN_GREEN:
            self._drops_out(event, at, Why.STOPPED)

    def _acknowledged(self, event: RecordedEvent, at: float) -> None:
        kart = self._mark(event, at)
        state = _state_of(event)
        if kart.sent == NOT_KNOWN:
            # Only what a kart is being sent can be acknowledged.
            _change(kart.lane.bands, at, state)
        band = kart.lane.bands[-1]
        if band.what == state and band.acknowledged is None:
            band.acknowledged = at

    def _withdrawn(self, event: RecordedEvent, at: float) -> None:
        kart = self._mark(event, at)
        if kart.sent in (RED_FLAG, RED_RED):
            self._incident(event)  # it had stopped, by its own word

    def _see_holds(self, event: RecordedEvent, at: float) -> None:
        """Take note of how the event says that its kart is held, or every kart."""
        command = event.command if event.success and event.command in STOPS else ''
        for number, kart in self._karts.items():
            if event.hold and event.kart in (0, number) and kart.hold is None:
                kart.hold = Hold(at, self._length, command or '')
                kart.lane.holds.append(kart.hold)
            elif event.hold is None and event.kart == number:
                self._release(kart, at)

    def _release(self, kart: _Kart, at: float) -> None:
        if kart.hold is not None:
            kart.hold.end = at
            kart.hold = None

    # ----- the race -----------------------------------------------------------------------

    def _race_state(self, event: RecordedEvent, at: float) -> None:
        before = self._state
        state = _state_of(event)
        _change(self._race_bands, at, state, event.sequence)
        cause = self._cause(event)
        by = cause.sequence if cause is not None else 0
        change = Change(at, state, event.sequence, by)
        race = self._race
        if race is not None:
            race.changes.append(change)
            if change is race.stop and change.by:
                # Who was stopped with all others was not stopped alone.
                race.out = {
                    kart: out for kart, out in race.out.items() if out.sequence != change.by
                }
            goes_on = event.sequence != 1 and before != NOT_KNOWN
            if state in (RED_FLAG, RED_RED) and goes_on and by not in race.stops:
                race.stops.append(event.sequence)

    def _race_of(self, event: RecordedEvent, at: float) -> Race | None:
        """Return the race that was under way; None: none was."""
        if not event.race:
            return None
        if not self.account.races or self.account.races[-1].number != event.race:
            race = Race(event.race, at, event.heat)
            race.taken_up = event.command != CommandKind.GRID_ACTIVE.name
            race.incomplete = race.taken_up and event.sequence != 1
            self.account.races.append(race)
        return self.account.races[-1]

    def _cause(self, event: RecordedEvent) -> RecordedEvent | None:
        """Return the event of the command that caused this one: it stands before its effects."""
        return self._command if event.command else None

    def _commanded(self, event: RecordedEvent, at: float) -> None:
        self.account.commands.append(event)
        if not event.success and self._race is not None:
            self._race.refused.append(event.sequence)
        if not event.success or event.command is None:
            return
        self._command = event
        if event.command in SENDS_RED and self._race is not None:
            self._race.stops.append(event.sequence)
        if event.command in STOPS:
            self._incident(event)
        if self._race is None or event.kart not in self._karts:
            return
        if event.command == CommandKind.KART_FINISH.name:
            self._race.finished.append(Finish(event.kart, at))
        elif event.command == CommandKind.KART_UNDO_FINISH.name:
            # Later places move up.
            self._race.finished = [each for each in self._race.finished if each.kart != event.kart]
            if self._karts[event.kart].sent != GREEN_GREEN:
                self._drops_out(event, at, Why.FINISH_UNDONE)

    def _drops_out(self, event: RecordedEvent, at: float, why: Why) -> None:
        race = self._race
        if race is None or race.green is None or race.stop is not None:
            return
        if event.kart not in race.starters or event.kart in race.out:
            return
        if all(each.kart != event.kart for each in race.finished):
            cause = self._cause(event)
            if why is Why.STOPPED and cause is not None and cause.kart:
                why = Why.STOPPED_ALONE
            race.out[event.kart] = Out(why, at, (cause or event).sequence)
            self._incident(cause or event)

    def _incident(self, event: RecordedEvent) -> None:
        race = self._race
        incidents = self.account.outside if race is None else race.incidents
        if event.sequence not in incidents[-1:]:
            incidents.append(event.sequence)

    def _results(self, event: RecordedEvent, at: float) -> None:
        if self._race is not None:
            self._race.results = event.text

    # ----- the rest -----------------------------------------------------------------------

    def _alert_raised(self, event: RecordedEvent, at: float) -> None:
        self._alerts.raised(event, at)

    def _alert_cleared(self, event: RecordedEvent, at: float) -> None:
        self._alerts.cleared(event, at)

    def _race_control_ends(self, event: RecordedEvent, at: float) -> None:
        self.account.ended = event
        for kart in self._karts.values():
            if kart.sent not in (NOT_CONNECTED, NOT_KNOWN):
                # The last that every connected kart hears.
                _change(kart.lane.bands, at, RED_RED, event.sequence)


_OF_THE_SERVER = {
    kind.name for kind in (EventKind.MALFORMED, EventKind.REFUSED_CONNECTION, EventKind.ENDED)
}
"""Events that say nothing of holds: the rules do not make them."""

_TAKES = {
    EventKind.COMMAND.name: _Reading._commanded,
    EventKind.RACE_STATE.name: _Reading._race_state,
    EventKind.ALERT_RAISED.name: _Reading._alert_raised,
    EventKind.ALERT_CLEARED.name: _Reading._alert_cleared,
    EventKind.RESULTS.name: _Reading._results,
    EventKind.ENDED.name: _Reading._race_control_ends,
}

_TAKES_OF_A_KART = {
    EventKind.KART_STATE.name: _Reading._kart_state,
    EventKind.ACKNOWLEDGED.name: _Reading._acknowledged,
    EventKind.WITHDRAWN.name: _Reading._withdrawn,
    EventKind.REPORTED.name: _Reading._mark,
    EventKind.MALFORMED.name: _Reading._mark,
    EventKind.SLOW_LINK.name: _Reading._mark,
    EventKind.REFUSED_CONNECTION.name: _Reading._mark,
    EventKind.CONNECTED.name: _Reading._connected,
    EventKind.DISCONNECTED.name: _Reading._disconnected,
}


class _Alerts:
    """Which alert ended when."""

    def __init__(self) -> None:
        self.told: list[Alert] = []
        self._standing: dict[tuple[int, str | None], Alert] = {}

    def raised(self, event: RecordedEvent, at: float) -> None:
        alert = Alert(event.kart, at, event.text, event.sequence)
        self.told.append(alert)
        self._standing[event.kart, event.alert] = alert

    def cleared(self, event: RecordedEvent, at: float) -> None:
        alert = self._standing.pop((event.kart, event.alert), None)
        if alert is None:
            alert = Alert(event.kart, None, event.text, event.sequence)
            self.told.append(alert)
        alert.ended = at

    def lose_sight(self) -> None:
        """Take note that events are missing: what stands may have ended there."""
        for alert in self._standing.values():
            alert.lost_sight = True
        self._standing.clear()


def _refused(event: RecordedEvent) -> bool:
    return event.kind == EventKind.COMMAND.name and not event.success


def _state_of(event: RecordedEvent) -> str:
    """Return the state that an event names; `NOT_KNOWN` if this version does not know it."""
    state = event.state or NOT_KNOWN
    return state if state in RaceState.__members__ else NOT_KNOWN


def _change(bands: list[Band], at: float, what: str, sequence: int = 0) -> None:
    """End the last band, and begin another that lasts to where the last one would have."""
    end, bands[-1].end = bands[-1].end, at
    bands.append(Band(at, end, what, sequence=sequence))


def _lasting(bands: Sequence[Band]) -> list[Band]:
    """Return the bands that last, and the last one, however short it is."""
    return [band for band in bands[:-1] if band.end > band.start] + list(bands[-1:])


# ----- a part of a run ------------------------------------------------------------------------


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

        def has(event: RecordedEvent) -> bool:
            mine = self.kart is None or event.kart in (0, self.kart)
            return mine and start <= account.at(event) <= end

        def touches(begins: float, ends: float) -> bool:
            return begins <= end and ends >= start

        events = [event for event in account.events if has(event)]
        kept = {event.sequence for event in events}
        lanes = [
            Lane(
                lane.kart,
                lane.team,
                [
                    dataclasses.replace(
                        band,
                        start=max(band.start, start),
                        end=min(band.end, end),
                        acknowledged=(
                            band.acknowledged
                            if band.acknowledged is not None and band.acknowledged <= end
                            else None
                        ),
                    )
                    for band in lane.bands
                    if touches(band.start, band.end)
                ],
                [
                    dataclasses.replace(hold, start=max(hold.start, start), end=min(hold.end, end))
                    for hold in lane.holds
                    if touches(hold.start, hold.end)
                ],
                [mark for mark in lane.marks if mark.sequence in kept],
            )
            for lane in account.lanes
            if self.kart in (None, lane.kart)
        ]
        return dataclasses.replace(
            account,
            events=events,
            lanes=lanes,
            race_bands=[
                dataclasses.replace(band, start=max(band.start, start), end=min(band.end, end))
                for band in account.race_bands
                if touches(band.start, band.end)
            ],
            races=[
                dataclasses.replace(
                    race,
                    incidents=[n for n in race.incidents if n in kept],
                    stops=[n for n in race.stops if n in kept],
                    refused=[n for n in race.refused if n in kept],
                )
                for race in account.races
                if touches(race.began, account.length if race.garage is None else race.garage)
            ],
            alerts=[
                alert
                for alert in account.alerts
                if self.kart is None or alert.kart in (0, self.kart)
                if touches(
                    alert.raised or 0.0,
                    account.length if alert.ended is None else alert.ended,
                )
            ],
            commands=[event for event in account.commands if event.sequence in kept],
            gaps=[gap for gap in account.gaps if touches(gap.start, gap.end)],
            clock_steps=[step for step in account.clock_steps if start <= step.at <= end],
            outside=[n for n in account.outside if n in kept],
        )
