# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What happened in a run: the races, what each kart was sent, the alerts and the commands.

An `Account` replays the run's stream once (``Replay.steps``), and looks at the race after each
step. The rules compute everything; this module parses no sentences. After a gap or a difference,
the rules cannot follow the stream. From there on, what karts were sent is `NOT_KNOWN`, and events
are only listed.

All times are in seconds since the first event of the run, by the rules' clock, which nobody can
set.
"""

from __future__ import annotations

from dataclasses import dataclass, field
import enum
import itertools
import math
from typing import NamedTuple

from evgp_node.results import Corrected
from evgp_node.stream import Gap
from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState
from evgp_rcs.record.replay import Replay, Step
from evgp_rcs.record.runs import Kept
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.inputs import Input, Recovered
from evgp_rcs.rules.race import Event, EventKind, Kart, Outcome, Race, StampedEvent

GREEN_GREEN = RaceState.GREEN_GREEN.name
REDS = frozenset({RaceState.RED_FLAG.name, RaceState.RED_RED.name})

NOT_CONNECTED = 'NOT_CONNECTED'
"""Used instead of a state while a kart is not connected, and is therefore sent nothing."""

NOT_KNOWN = 'NOT_KNOWN'
"""Used instead of a state from where the rules cannot follow the record."""

NO_GRADE = Grade.UNKNOWN.name

STOPS = frozenset(kind for kind, entry in CATALOGUE.items() if entry.stop)
SENDS_RED = frozenset(kind for kind, entry in CATALOGUE.items() if entry.overtakes)


class Happened(NamedTuple):
    """An event, with its time (s) and its number in the run."""

    at: float
    sequence: int
    event: Event

    @property
    def is_command(self) -> bool:
        """Return whether the event is an official's command, accepted or refused."""
        return self.event.kind is EventKind.COMMAND


@dataclass
class Band:
    """
    A time span in which a kart was sent one state, was held, or had a link of one grade (`Lane`).

    :param what: the state, `NOT_CONNECTED` or `NOT_KNOWN`; or the hold or the grade.
    :param acknowledged: when the kart first acknowledged the state; None if it did not do so then.
    :param delivered: when the kart's kernel had answered it; None if that was not seen.
    """

    start: float
    end: float
    what: str
    acknowledged: float | None = None
    delivered: float | None = None


class Bands(list[Band]):
    """Consecutive bands, of which the last one lasts until another begins."""

    def change(self, at: float, what: str) -> Band:
        """Begin a new band if something changes and return the last band."""
        if self and self[-1].what != what:
            self[-1].end = at
            if self[-1].start == at:
                self.pop()  # it had no duration
        if not self or self[-1].what != what:
            self.append(Band(at, math.inf, what))
        self[-1].end = math.inf
        return self[-1]


class Lane(NamedTuple):
    """One kart: what it was sent, the grades of its link, and its own holds ('' if not held)."""

    kart: int
    team: str
    bands: Bands
    links: Bands
    holds: Bands


@dataclass
class Alert:
    """
    An alert: the event that raised it, and when it ended (s).

    None means that it had not ended, as far as the rules can follow the record.
    """

    event: Happened
    ended: float | None = None


class Why(enum.Enum):
    """Why a kart has no place."""

    LOST = 'it lost its connection'
    STOPPED_ALONE = 'an official stopped it individually'
    FINISH_UNDONE = 'its finish was undone after it had been stopped'
    RACE_STOPPED = 'the race was stopped first'
    RACE_CONTROL_ENDED = 'race control ended first'
    STILL_RACING = 'it was still racing at the end of the record'
    NOT_KNOWN = 'not known: the rules cannot follow the record to its end'


class Out(NamedTuple):
    """Why a kart did not finish, from when on, and the event that caused this, if any."""

    why: Why
    at: float
    event: Happened | None = None


class Result(NamedTuple):
    """The result of a starter: its place, and when it was marked as finished or why it was not."""

    kart: int
    place: int = 0
    finished: float | None = None
    out: Out | None = None


class StopAnswer(NamedTuple):
    """
    A kart's answer to a stop.

    :param band: the state that it was sent, possibly since before the stop, and its answers.
    :param then: the state that it was sent next; empty if the record ends first.
    """

    kart: int
    band: Band
    then: str

    @property
    def is_silent(self) -> bool:
        """Return whether the kart certainly did not acknowledge the stop."""
        known = self.band.what in REDS and self.then != NOT_KNOWN
        return known and self.band.acknowledged is None


class Stop(NamedTuple):
    """A stop, with the event of its command or, without a command, of the race's new state."""

    event: Happened
    told: tuple[StopAnswer, ...]

    def slowest(self) -> StopAnswer | None:
        """Return the slowest answer of the karts that acknowledged a new state; None if none."""
        new = [each for each in self.told if each.band.start == self.event.at]
        answered = (each for each in new if each.band.acknowledged is not None)
        return max(answered, key=lambda each: each.band.acknowledged or 0.0, default=None)


@dataclass
class RaceAccount:
    """
    One race, from GRID_ACTIVE to IN_GARAGE, or what happened outside any race (number 0).

    :param events: its events, as far as the rules can follow the record.
    :param starters: the karts that were sent GREEN_GREEN.
    :param finished: when each kart was marked as finished, in the order of places; None if that
        was before the run began.
    :param out: why each starter that dropped out did not finish.
    :param incidents: the events that a jury asks about first.
    :param incomplete: whether the rules could not follow it to its end.
    """

    number: int
    events: list[Happened] = field(default_factory=list)
    starters: tuple[int, ...] = ()
    finished: dict[int, float | None] = field(default_factory=dict)
    out: dict[int, Out] = field(default_factory=dict)
    incidents: list[Happened] = field(default_factory=list)
    stops: list[Happened] = field(default_factory=list)
    incomplete: bool = False

    def add_incident(self, event: Happened) -> None:
        """Add an incident, unless it is the last one already."""
        if event not in self.incidents[-1:]:
            self.incidents.append(event)

    @property
    def began(self) -> float:
        """Return when the race began, as far as the run shows."""
        return self.events[0].at

    @property
    def heat(self) -> str:
        """Return the race's heat; empty if it is none."""
        return self.events[0].event.heat

    @property
    def taken_up(self) -> bool:
        """Return whether the race was under way when the run began."""
        return self.events[0].event.command is not CommandKind.GRID_ACTIVE

    @property
    def changes(self) -> list[Happened]:
        return [each for each in self.events if each.event.kind is EventKind.RACE_STATE]

    def _first(self, *states: RaceState) -> Happened | None:
        return next((each for each in self.changes if each.event.state in states), None)

    @property
    def green(self) -> float | None:
        """Return when the race was started; None if never, or before this run."""
        change = self._first(RaceState.GREEN_GREEN)
        return change.at if change is not None else None

    @property
    def stop(self) -> Happened | None:
        """Return the change that stopped the whole race; None if there was none."""
        return self._first(RaceState.RED_FLAG, RaceState.RED_RED)

    @property
    def garage(self) -> float | None:
        """Return when the race went back to IN_GARAGE; None if it did not."""
        change = self._first(RaceState.IN_GARAGE)
        return change.at if change is not None else None


class Account:
    """
    Everything that is known about a run.

    :ivar length: time of the last event.
    :ivar known_until: time up to which the rules could follow the record; None for all of it.
    :ivar lost: number of connections to karts that were lost in races.
    :ivar outside: what happened outside any race.
    :ivar ended: the event of race control's end; None if there is none.
    """

    def __init__(self, kept: Kept) -> None:
        self.kept = kept
        self.replay = Replay(kept)
        self.events: list[Happened] = []
        self.gaps: list[tuple[float, Gap]] = []
        self.length = 0.0
        self.known_until: float | None = None
        self.lanes: dict[int, Lane] = {}
        self.race_bands = Bands()
        self.races: list[RaceAccount] = []
        self.alerts: list[Alert] = []
        self.outside = RaceAccount(0)
        self.ended: Happened | None = None
        self.lost = 0
        self._first: StampedEvent | None = None
        self._holds: list[RaceState | None] = []
        for step in self.replay.steps():
            self._take(step)
        self._close()

    # ----- the results --------------------------------------------------------------------

    @property
    def began_ns(self) -> int:
        """Return the wall time of the first event, or of the run's start if it has none, in ns."""
        return self.kept.run.began_ns if self._first is None else self._first.wall_ns

    @property
    def commands(self) -> list[Happened]:
        return [each for each in self.events if each.is_command]

    @property
    def teams(self) -> dict[int, str]:
        return {lane.kart: lane.team for lane in self.lanes.values()}

    @property
    def officials(self) -> list[str]:
        """Return the names under which commands were sent."""
        return sorted({each.event.official for each in self.commands} - {''})

    def at(self, monotonic: float) -> float:
        """Return a time of the rules' clock as one of the run."""
        # Round to the millisecond, as the report does, so that the times in it add up.
        began = monotonic if self._first is None else self._first.monotonic
        return round(max(0.0, monotonic - began), 3)

    def corrected_at(self, given: Corrected) -> float | None:
        """Return the time of a correction; None if the machine has been restarted before it."""
        known = self._first is not None and given.at >= self._first.monotonic
        return self.at(given.at) if known else None

    def results(self, race: RaceAccount) -> list[Result]:
        """Return the results of a race's starters, in the order of places, then the rest."""
        finished = enumerate(race.finished.items(), 1)
        rest = sorted(set(race.starters) - race.finished.keys())
        return [
            *(Result(kart, place, at) for place, (kart, at) in finished),
            *(Result(kart, out=self._out(race, kart)) for kart in rest),
        ]

    def stop(self, race: RaceAccount, event: Happened) -> Stop:
        """Return what each kart was sent at a stop, and its answer."""
        told = []
        for lane in self.lanes.values():
            if event.event.kart not in (0, lane.kart):
                continue
            later = [band for band in lane.bands if band.end > event.at]
            band, *after = later or lane.bands[-1:]
            sent = band.what not in (NOT_CONNECTED, NOT_KNOWN)
            if sent and band.what not in REDS:
                continue
            if not sent and lane.kart not in (event.event.kart, *race.starters):
                continue  # the stop did not concern this kart
            ends = self.ended is not None and band.end >= self.ended.at
            then = after[0].what if after and not ends else ''
            told.append(StopAnswer(lane.kart, band, then))
        return Stop(event, tuple(told))

    def _out(self, race: RaceAccount, kart: int) -> Out:
        if kart in race.out:
            return race.out[kart]
        if race.stop is not None:
            return Out(Why.RACE_STOPPED, race.stop.at, race.stop)
        if race.incomplete:
            return Out(Why.NOT_KNOWN, self.known_until or 0.0)
        if self.ended is not None:
            return Out(Why.RACE_CONTROL_ENDED, self.ended.at, self.ended)
        return Out(Why.STILL_RACING, self.length)

    # ----- one step -----------------------------------------------------------------------

    def _close(self) -> None:
        """End every band that is still going on, at the end of the record."""
        of_karts = [(*each.bands, *each.links, *each.holds) for each in self.lanes.values()]
        for band in itertools.chain(self.race_bands, *of_karts):
            band.end = min(band.end, self.length)

    def _take(self, step: Step) -> None:
        if isinstance(step.entry, Gap):
            self.gaps.append((self.length, step.entry))
        if step.race is None and self.known_until is None:
            self._lose_sight()
        new = []
        for stamped in step.events:
            self._first = self._first or stamped
            self.length = self.at(stamped.monotonic)
            new.append(Happened(self.length, stamped.sequence, stamped.event))
            if step.race is None and stamped.event.kind is EventKind.ENDED:
                self.ended = new[-1]
        self.events += new
        if step.race is None or self.ended is not None:
            return
        for each in new:
            self._look_at_event(step, each)
        made = step.outcome
        holds = [kart.hold for kart in step.race.karts.values()]
        # The RED_FLAG of a kart that has finished holds it silently if the race has been stopped.
        silent = holds == self._holds and made is not None and not (made.events or made.orders)
        if made is not None and not silent:
            self._holds = holds
            self._look_at_race(step, made, new, step.race)

    def _lose_sight(self) -> None:
        """Mark everything from here on as unknown."""
        self.known_until = at = self.length
        for lane in self.lanes.values():
            lane.bands.change(at, NOT_KNOWN)
            lane.links.change(at, NO_GRADE)
            lane.holds.change(at, '')
        self.race_bands.change(at, NOT_KNOWN)
        for race in self.races[-1:]:
            race.incomplete = race.garage is None

    def _look_at_event(self, step: Step, happened: Happened) -> None:
        event, race = happened.event, self.outside
        if event.race:
            if not self.races or self.races[-1].number != event.race:
                self.races.append(RaceAccount(event.race))
            race = self.races[-1]
        race.events.append(happened)
        if happened.is_command and event.success:
            if event.command in STOPS:
                race.add_incident(happened)
            if event.command in SENDS_RED:
                race.stops.append(happened)
        elif event.kind is EventKind.RACE_STATE:
            by_itself = event.command is None and not isinstance(step.entry, Recovered)
            if by_itself and event.state is not None and event.state.is_red:
                race.stops.append(happened)
        elif event.kind is EventKind.ALERT_RAISED:
            self.alerts.append(Alert(happened))
        elif event.kind is EventKind.ALERT_CLEARED:
            for alert in self.alerts:
                raised = alert.event.event
                is_it = (raised.kart, raised.alert) == (event.kart, event.alert)
                if is_it and alert.ended is None:
                    alert.ended = happened.at
        elif event.kind is EventKind.DISCONNECTED and event.race:
            race.add_incident(happened)
        elif event.kind is EventKind.WITHDRAWN and self._sent(event.kart) in REDS:
            race.add_incident(happened)  # the kart had reported that it had stopped
        elif event.kind is EventKind.ENDED:
            self.ended = happened
            for lane in self.lanes.values():
                if lane.bands[-1].what != NOT_CONNECTED:
                    # This is the last state that every connected kart is sent.
                    lane.bands.change(happened.at, RaceState.RED_RED.name)

    def _sent(self, kart: int) -> str:
        return self.lanes[kart].bands[-1].what if kart in self.lanes else NOT_CONNECTED

    # ----- the race as it is now ----------------------------------------------------------

    def _look_at_race(self, step: Step, made: Outcome, events: list[Happened], race: Race) -> None:
        assert isinstance(step.entry, Input)
        at = self.at(step.entry.at)
        self.race_bands.change(at, race.state.name)
        under_way = self.races[-1] if self.races and made.events and made.events[0].race else None
        self.lost += sum(
            each.kind is EventKind.DISCONNECTED and each.race > 0 for each in made.events
        )
        if self.races:
            before = self.races[-1].finished
            now = None if isinstance(step.entry, Recovered) else at
            placed = sorted((each.place, number) for number, each in race.karts.items())
            self.races[-1].finished = {n: before.get(n, now) for place, n in placed if place}
        if under_way is not None and not under_way.taken_up:
            under_way.starters = race.starters or under_way.starters
        for kart in race.karts.values():
            self._look_at_kart(kart, at)
            if under_way is not None and race.state is RaceState.GREEN_GREEN:
                self._look_who_drives(events, under_way, kart.number, at)

    def _look_at_kart(self, kart: Kart, at: float) -> None:
        lane = self.lanes.get(kart.number)
        if lane is None:
            lane = Lane(kart.number, kart.team, Bands(), Bands(), Bands())
            self.lanes = dict(sorted([*self.lanes.items(), (kart.number, lane)]))
            lane.bands.change(0.0, NOT_CONNECTED)
        band = lane.bands.change(at, kart.sent.name if kart.connected else NOT_CONNECTED)
        if kart.delivered_after is not None and band.delivered is None:
            band.delivered = self.at(kart.ordered_at + kart.delivered_after)
        if kart.acknowledged_after is not None and band.acknowledged is None:
            band.acknowledged = self.at(kart.ordered_at + kart.acknowledged_after)
        lane.links.change(at, kart.link.grade.name)
        lane.holds.change(at, '' if kart.hold is None else kart.hold.name)

    def _look_who_drives(
        self, events: list[Happened], race: RaceAccount, number: int, at: float
    ) -> None:
        """Record a starter that no longer drives and has no place."""
        left = number in race.out or number in race.finished
        if left or number not in race.starters or self._sent(number) == GREEN_GREEN:
            return
        # The command that has taken effect in this step.
        cause = next((each for each in events if each.is_command and each.event.success), None)
        why = Why.LOST  # or replaced by another connection
        if cause is not None and cause.event.command is CommandKind.KART_UNDO_FINISH:
            why = Why.FINISH_UNDONE
        elif cause is not None and cause.event.kart:
            why = Why.STOPPED_ALONE
        if cause is None:
            cause = next((each for each in events if each.event.kart == number), None)
        race.out[number] = Out(why, at, cause)
        if cause is not None:
            race.add_incident(cause)
