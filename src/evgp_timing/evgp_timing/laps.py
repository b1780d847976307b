# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Turns the passings at the timing line into laps, results and places.

A passing is a report, by a source or an official, that something crossed the line. A source is a
timing device. This module keeps each passing as it arrived, and judges it by the rules of
docs/timing.md#laps (``Mark``). If officials strike out a passing, restore it, or assign a
transponder to a kart, this module judges all passings again. The laps do not depend on what a kart
is sent.

An official's passing *claims* a crossing that a beam saw, or one that a source that knows the kart
sees just after it. The crossing then counts in place of the official's passing, until either is
struck out. Nothing is claimed if the crossing would not count for that kart.

The first passing of a source in a session, its *anchor*, is timed by its arrival, and later ones
by the source's clock while it agrees with the arrivals. A passing whose time does not agree is the
new anchor. There is one exception: if the first passing of a source in this race was before
GREEN_GREEN by the source's previous clock, that passing is late and never counts. Passings that
arrive at once with it are late too. If the clock then keeps step with the arrivals, it was the
clock that jumped. Passings that arrive after the timekeeper has been away may be late by the
length of its absence.

This module is pure, and its objects are immutable. Each change returns a new ``Laps``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
import dataclasses
from dataclasses import dataclass, field
import functools
import itertools
import math
from typing import Any, NamedTuple

from evgp_node.results import (
    BY_HAND,
    Identity,
    Judged,
    KartResult,
    Mark,
    Passing,
    Penalty,
    Status,
)
from evgp_node.roster import Format, Heat
from evgp_timing.passings import CLOCK_TOLERANCE, MAX_RATE

MOST_A_RACE = 4_000
"""Maximum number of passings accepted from one source per race."""

MOST_SOURCES = 3
"""Maximum number of sources per race, besides officials. After a correction, the timekeeper judges
all their passings again. This takes about 2 ms per thousand, and a stop may wait as long."""

FURTHER_SOURCES = 'further sources'
"""Name for all sources beyond the first ``MOST_SOURCES``, whose passings are surplus."""

BEAM_PRESS = 3.0
"""Maximum time from a beam's report until an official says which kart crossed, in seconds."""


class Crossing(NamedTuple):
    """
    A passing on the time scale of the race, in seconds since GREEN_GREEN.

    :param came: when the passing arrived or, if the timekeeper was away then, when the kart
        crossed, in seconds.
    :param at: when the kart crossed, in seconds.
    :param kart: number of the kart that crossed; 0 if it is unknown.
    :param mark: how the passing was judged.
    """

    passing: Passing
    came: float
    at: float
    kart: int = 0
    mark: Mark = Mark.UNKNOWN


@dataclass(frozen=True)
class LapSettings:
    """The settings for counting laps, which ``timekeeper.read_settings`` explains."""

    min_lap_time: float = 5.0
    first_crossing: str = 'starts'
    clock_tolerance: float = CLOCK_TOLERANCE

    @property
    def from_green(self) -> bool:
        """Return whether lap 1 begins at GREEN_GREEN, so that the first crossing ends it."""
        return self.first_crossing == 'ends'


@dataclass(frozen=True)
class Laps:
    """
    The laps of one race.

    :param heat: the race's heat; without a name if it had none.
    :param green: when race control sent GREEN_GREEN, in seconds on the rules' clock.
    :param karts: the karts that started.
    :param transponders: the kart of each transponder.
    :param grid: the starting order of the karts, if it is known.
    :param ended: when the race was stopped or ended, in seconds since GREEN_GREEN.
    :param finished: when each kart finished, in seconds since GREEN_GREEN.
    :param left: when each kart left the race, in seconds since GREEN_GREEN.
    :param crossings: every accepted passing, in order of arrival, and how it was judged.
    :param struck: the passings that were struck out, and why.
    :param claims: for each official's passing that claimed a crossing, the kart and the crossing.
    :param penalties: the penalties, in the order in which officials gave them.
    :param counted: the times of each kart's counted crossings, in seconds since GREEN_GREEN.
    :param clocks: sources whose clocks disagreed with the arrival times.
    :param over: number of surplus passings, by source.
    :param anchors: the crossing by which the clock of each source and session is set.
    :param arrivals: when each source's accepted passings arrived, in seconds since GREEN_GREEN.
    """

    settings: LapSettings
    heat: Heat
    green: float
    karts: tuple[int, ...]
    transponders: Mapping[str, int] = field(default_factory=dict)
    ended: float = math.inf
    finished: Mapping[int, float] = field(default_factory=dict)
    left: Mapping[int, float] = field(default_factory=dict)
    crossings: tuple[Crossing, ...] = ()
    struck: Mapping[Identity, str] = field(default_factory=dict)
    claims: Mapping[Identity, tuple[int, Identity]] = field(default_factory=dict)
    penalties: tuple[Penalty, ...] = ()
    counted: Mapping[int, tuple[float, ...]] = field(default_factory=dict)
    clocks: frozenset[str] = frozenset()
    over: Mapping[str, int] = field(default_factory=dict)
    anchors: Mapping[tuple[str, str], Crossing] = field(default_factory=dict)
    arrivals: Mapping[str, list[float]] = field(default_factory=dict)
    grid: tuple[int, ...] = ()

    # ----- changes ------------------------------------------------------------------------

    def take(self, passings: Iterable[Passing], now: float, away: float = 0.0) -> Laps:
        """
        Add passings that arrive now, and return the new laps.

        :param passings: the passings, none of which has arrived before.
        :param now: the time, in seconds on the rules' clock.
        :param away: how long the timekeeper had been away, in seconds, as in ``desk.Passed``.
        """
        came = now - self.green
        crossings: list[Crossing] = []
        over, anchors, clocks = dict(self.over), dict(self.anchors), set(self.clocks)
        arrivals = {source: [*times] for source, times in self.arrivals.items()}
        for passing in passings:
            source = passing.source
            if source != BY_HAND and len(arrivals.keys() - {source, BY_HAND}) >= MOST_SOURCES:
                over[FURTHER_SOURCES] = over.get(FURTHER_SOURCES, 0) + 1
                continue
            before = arrivals.setdefault(source, [])
            is_flood = len(before) >= MAX_RATE and came - before[-MAX_RATE] < 1.0
            if is_flood or len(before) >= MOST_A_RACE:
                over[source] = over.get(source, 0) + 1
                continue
            before.append(came)
            crossing = Crossing(passing, came, came)
            if source == BY_HAND:  # an official's passing has no clock of its own
                crossings.append(crossing)
                continue
            anchor = anchors.setdefault((source, passing.session), crossing)
            at = anchor.at + (passing.stamp_ns - anchor.passing.stamp_ns) / 1e9
            tolerance, timed = self.settings.clock_tolerance, crossing._replace(at=at)
            if -tolerance <= at - came <= tolerance:
                crossing = timed
            elif -tolerance - away <= at - came < 0.0:  # only the timekeeper was late
                crossing = timed._replace(came=at)
            elif at < 0.0 and not any(
                self._shows_jump(each, timed)
                for each in (*reversed(crossings), *reversed(self.crossings))
            ):
                crossing = timed
                clocks.add(source)
            else:
                anchors[source, passing.session] = crossing
                if came <= self.ended:
                    clocks.add(source)
            crossings.append(crossing)
        laps = dataclasses.replace(
            self, over=over, anchors=anchors, clocks=frozenset(clocks), arrivals=arrivals
        )
        laps, known = laps._judge(crossings), len(self.crossings)
        for each in laps.crossings[known:]:
            laps = laps._pair(each)
        return laps

    def _shows_jump(self, one: Crossing, later: Crossing) -> bool:
        """
        Return whether, after one crossing, a later one before GREEN_GREEN means a clock jumped.

        Sources report crossings in order. The clock therefore jumped if the source has already
        reported a crossing of this race, or if its clock has kept step with the arrivals since.
        """
        source, session, number = one.passing.identity
        if later.passing.identity[:2] != (source, session) or later.passing.number <= number:
            return False
        tolerance, since = self.settings.clock_tolerance, later.came - one.came
        in_step = since > tolerance and abs(later.at - one.at - since) <= tolerance
        return one.at >= 0.0 or in_step

    def _pair(self, new: Crossing) -> Laps:
        """Let officials' passings claim a crossing, if it or one of them is new."""
        for seen, presses in self._pairs(new):
            identity = seen.passing.identity
            claims = {each.passing.identity: (each.kart, identity) for each in presses}
            laps = self.again(claims={**self.claims, **claims})
            if laps.mark_of(identity) is Mark.COUNTED:
                return laps
        return self

    def _pairs(self, new: Crossing) -> Iterator[tuple[Crossing, list[Crossing]]]:
        """Yield each crossing that officials' passings may claim by the new one, with those."""
        if new.passing.source == BY_HAND:
            lately = (each for each in self._unnamed if new.came - each.came <= BEAM_PRESS)
            for seen in itertools.islice(lately, 1):
                yield seen, [new]
        elif new.mark is not Mark.COUNTED and (new.kart or not new.passing.transponder):
            # While the timekeeper was away, the kart may have crossed long before a press.
            since = -math.inf if new.kart else -BEAM_PRESS
            near = [
                each
                for each in self._presses
                if since <= new.came - each.came <= self.settings.clock_tolerance
            ]
            counted = dict.fromkeys(each.kart for each in near if each.mark is Mark.COUNTED)
            for kart in counted:
                if new.kart in (0, kart):  # two officials may have pressed
                    yield new, [each for each in near if each.kart == kart]

    def _judge(self, crossings: Sequence[Crossing]) -> Laps:
        """Judge more crossings, in the order in which they arrived, and add them."""
        counted = dict(self.counted)
        judged = [*self.crossings]
        for crossing in crossings:
            kart = self.kart_of(crossing.passing)
            mark = self._mark(crossing, kart, counted.get(kart, ()))
            if mark is Mark.COUNTED:
                counted[kart] = (*counted.get(kart, ()), crossing.at)
            judged.append(crossing._replace(kart=kart, mark=mark))
        return dataclasses.replace(self, crossings=tuple(judged), counted=counted)

    def _mark(self, crossing: Crossing, kart: int, times: tuple[float, ...]) -> Mark:
        identity = crossing.passing.identity
        if identity in self.struck:
            return Mark.STRUCK
        if self._claims_now(identity):
            return Mark.NOT_COUNTED
        if not kart and crossing.came <= self.ended:
            return Mark.UNKNOWN
        finish = self.finished.get(kart, math.inf) + self.settings.clock_tolerance
        if self.wanted and crossing.passing.source == BY_HAND:
            finish = math.inf  # officials may add a crossing that was missed or struck out
        until = min(self.ended, finish, self.left.get(kart, math.inf))
        too_late = crossing.came > until or (self.wanted and len(times) > self.wanted)
        if kart not in self.karts or too_late or crossing.at < 0.0:
            return Mark.NOT_COUNTED
        if times and crossing.at - times[-1] < self.settings.min_lap_time:
            return Mark.DOUBTFUL
        return Mark.COUNTED

    def kart_of(self, passing: Passing) -> int:
        """Return the number of the kart that a passing belongs to; 0 if it is unknown."""
        if passing.kart:
            return passing.kart
        if passing.transponder:
            # Find the kart by the whole name or, failing that, by the number or the label in it,
            # unless these belong to two different karts.
            names = passing.transponder.split(' ', 1)
            owners = {self.transponders.get(name, 0) for name in names} - {0}
            alone = owners.pop() if len(owners) == 1 else 0
            return self.transponders.get(passing.transponder, alone)
        # A beam cannot tell karts apart. If only one kart races, that kart has crossed.
        alone = self.karts[0] if len(self.karts) == 1 else 0
        return self._claimed.get(passing.identity, alone)

    def again(self, **changes: Any) -> Laps:
        """Return new laps with these fields changed and all passings judged again."""
        changed = dataclasses.replace(self, **changes)
        begun = dict.fromkeys(changed.karts, (0.0,) * self.settings.from_green)
        fresh = dataclasses.replace(changed, counted=begun, crossings=())
        return fresh._judge(self.crossings)

    def strike(self, identity: Identity, why: str) -> Laps:
        """Strike out a passing for this reason."""
        return self.again(struck={**self.struck, identity: why})

    def restore(self, identity: Identity) -> Laps:
        """Restore a passing that was struck out."""
        return self.again(struck={key: why for key, why in self.struck.items() if key != identity})

    def finish(self, kart: int, now: float) -> Laps:
        """Record that a kart has finished."""
        return self.again(finished={**self.finished, kart: now - self.green})

    def undo_finish(self, kart: int) -> Laps:
        """Undo a kart's finish, so that later passings may count."""
        return self.again(finished={key: at for key, at in self.finished.items() if key != kart})

    def leave(self, kart: int, now: float) -> Laps:
        """Record that a kart has left the race. It cannot come back, so its first time counts."""
        return self.again(left={kart: now - self.green, **self.left})

    def end(self, now: float) -> Laps:
        """Record that the race was stopped or is over. Later passings do not count."""
        ended = min(self.ended, now - self.green)
        return self if ended == self.ended else self.again(ended=ended)

    def penalise(self, penalty: Penalty) -> Laps:
        """Add a penalty to the result of its kart."""
        return dataclasses.replace(self, penalties=(*self.penalties, penalty))

    def undo_penalty(self, kart: int) -> Laps:
        """Remove the last penalty of a kart."""
        last = max(number for number, each in enumerate(self.penalties) if each.kart == kart)
        kept = (each for number, each in enumerate(self.penalties) if number != last)
        return dataclasses.replace(self, penalties=tuple(kept))

    # ----- results ------------------------------------------------------------------------

    def mark_of(self, identity: Identity) -> Mark | None:
        """Return the mark of a passing, or of the crossing that it claims; None without it."""
        if self._claims_now(identity):
            _, identity = self.claims[identity]
        marks = (each.mark for each in self.crossings if each.passing.identity == identity)
        return next(marks, None)

    def is_done(self, kart: int) -> bool:
        """Return whether a kart has completed all its laps."""
        return bool(self.wanted) and len(self.counted.get(kart, ())) > self.wanted

    @property
    def wanted(self) -> int:
        """Return the number of laps that each kart must drive; 0 if no number is set."""
        return self.heat.laps

    @functools.cached_property
    def _claimed(self) -> dict[Identity, int]:
        """Return the kart of each crossing that an official's passing claims."""
        held = (claim for press, claim in self.claims.items() if press not in self.struck)
        return {identity: kart for kart, identity in held}

    def _claims_now(self, press: Identity) -> bool:
        """Return whether a passing claims a crossing that counts for its kart instead."""
        if press not in self.claims:
            return False
        kart, identity = self.claims[press]
        return identity not in self.struck and self._claimed.get(identity) == kart

    @functools.cached_property
    def _presses(self) -> tuple[Crossing, ...]:
        """Return the officials' passings that claim nothing and are not struck out."""
        by_hand = (each for each in self.crossings if each.passing.source == BY_HAND)
        return tuple(each for each in by_hand if each.mark in (Mark.COUNTED, Mark.DOUBTFUL))

    @functools.cached_property
    def _unknown(self) -> tuple[Crossing, ...]:
        """Return the crossings of unknown karts, oldest first."""
        return tuple(each for each in self.crossings if each.mark is Mark.UNKNOWN)

    @functools.cached_property
    def _unnamed(self) -> tuple[Crossing, ...]:
        """Return the crossings that an official must identify, oldest first."""
        return tuple(each for each in self._unknown if not each.passing.transponder)

    def trouble(self, now: float) -> str:
        """Return a sentence about the problems with the passings, or an empty string."""
        phrases = []
        if self.clocks:
            who = _some(self.clocks)
            phrases.append(f'the clock of {who} jumped, or its passings arrived late')
        for source, count in sorted(self.over.items()):
            phrases.append(f'{count} passings from {source} were over the limit and do not count')
        if unknown := {each.passing.transponder for each in self._unknown} - {''}:
            phrases.append(f'no kart has the transponder {_some(unknown)}')
        if self._unnamed and now - self.green - self._unnamed[0].came > BEAM_PRESS:
            phrases.append('a kart crossed the line but was not identified')
        return f'Check the laps: {"; ".join(phrases)}' if phrases else ''

    @functools.cached_property
    def results(self) -> tuple[KartResult, ...]:
        """Return the result of every kart, best first."""
        return ranked(self.heat.format, [self.result(kart) for kart in self.karts])

    @property
    def is_result(self) -> bool:
        """Return whether the race has a heat, and at least one kart has a lap."""
        return bool(self.heat.name) and any(len(times) > 1 for times in self.counted.values())

    def last_passings(self, most: int) -> list[Judged]:
        """
        Return up to this many of the latest passings, oldest first.

        An official's passing that claims a crossing is not among them, but the crossing is.
        """
        listed = (
            Judged(each.passing, each.kart, each.mark, each.at, self.struck.get(identity, ''))
            for each in reversed(self.crossings)
            if (identity := each.passing.identity) in self.struck or not self._claims_now(identity)
        )
        return [*itertools.islice(listed, most)][::-1]

    def result(self, kart: int) -> KartResult:
        """Return the result of a kart that started, without its place."""
        times = self.counted.get(kart, ())
        lap_times = tuple(after - before for before, after in itertools.pairwise(times))
        penalties = tuple(each for each in self.penalties if each.kart == kart)
        laps = max(0, len(lap_times) - sum(each.laps for each in penalties))
        total = None
        if lap_times:
            begun = 0.0 if self.heat.format is Format.RACE else times[0]
            total = times[-1] - begun + sum(each.seconds for each in penalties)
        running = self.ended == math.inf and kart not in self.left
        done = kart in self.finished or self.is_done(kart)
        if any(each.disqualified for each in penalties):
            status = Status.DISQUALIFIED
        elif running and not done:
            status = Status.RUNNING
        elif not lap_times:
            status = Status.NOT_CLASSIFIED
        elif done or self.heat.format is Format.PRACTICE:
            status = Status.CLASSIFIED
        else:
            status = Status.DNF
        return KartResult(kart, 0, status, laps, total, lap_times, penalties)


_GROUP = {Status.DNF: 1, Status.NOT_CLASSIFIED: 2, Status.DISQUALIFIED: 3}


def ranked(format_: Format, results: Iterable[KartResult]) -> tuple[KartResult, ...]:
    """
    Return results in order. Results that are equal to the millisecond share a place.

    A race is ordered by laps and then by total time; a time trial breaks ties by best lap.
    Practice is ordered by best lap. Karts that did not finish, were not classified or were
    disqualified come last.
    """
    key = functools.partial(_key, format_)
    placed: list[KartResult] = []
    for number, result in enumerate(sorted(results, key=key), 1):
        place = number if result.lap_times and result.status not in _GROUP else 0
        if place and placed and key(placed[-1]) == key(result):
            place = placed[-1].place
        placed.append(result._replace(place=place))
    return tuple(placed)


def _key(format_: Format, result: KartResult) -> tuple[float, ...]:
    """Return the key by which results are sorted; a better result has a smaller key."""
    group, best, total = _GROUP.get(result.status, 0), _ms(result.best), _ms(result.total)
    if format_ is Format.PRACTICE:
        return group, best
    return group, -result.laps, total, best if format_ is Format.TIME_TRIAL else 0.0


def overall(format_: Format, results: Iterable[KartResult]) -> tuple[KartResult, ...]:
    """Return each kart's best result over several races of a format, in order, with places."""
    best: dict[int, tuple[tuple[float, ...], KartResult]] = {}
    for result in results:
        # Of two equal results, take the one with more laps, so that their order does not matter.
        key = (*_key(format_, result), -result.laps, _ms(result.total))
        if result.kart not in best or key < best[result.kart][0]:
            best[result.kart] = key, result
    return ranked(format_, (result for _, result in best.values()))


def _ms(seconds: float | None) -> float:
    return math.inf if seconds is None else round(seconds * 1000)


def _some(names: Iterable[str]) -> str:
    shown = sorted(names)
    more = f' and {len(shown) - 3} more' if len(shown) > 3 else ''
    return ', '.join(shown[:3]) + more
