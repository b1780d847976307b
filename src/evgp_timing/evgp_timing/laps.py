# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Laps: from passings of the timing line to laps, results and places.

A passing is evidence. It is kept as it came, and each is judged by the rule below (``Mark``).
An official may strike one out and put it back, and give a transponder to a kart; then all are
judged again. Nothing here knows what a kart is sent.

A beam sees that somebody crosses, and officials say who: a passing of officials gives the kart
the oldest crossing of the last `BEAM_PRESS` seconds of which nobody has said who it was. An
official may be quicker than the beam: what the beam sees within `clock_tolerance` after a passing
of officials takes its place. Both happen only if the crossing counts for that kart.

A passing counts for a kart that started the race, if it comes after GREEN_GREEN and before the
kart's finish, its leaving or the end of the race, before the kart has all its laps, and no nearer
to the last one that counted than `min_lap_time`. What comes within `clock_tolerance` after the
finish still counts: an official who sees the kart cross may be quicker than the source.

When it crossed: the first passing of a source and session crossed when it came. From there on
the source's clock counts, as long as it agrees with the times of arrival to `clock_tolerance`.
What waited while the timekeeper was away may be older by that time.
A passing that does not agree crossed when it came, and its source is counted from it again. But if
it is the first of its source in this race, and crossed before GREEN_GREEN by that clock, it is
late and never counts. So the difference between two crossings of one source has its precision,
and no clock that is set or runs away can make a lap that the times of arrival do not.

Pure, and immutable: each change is another ``Laps``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
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
from evgp_node.roster import Format

MOST_A_SECOND = 200
"""Maximum number of passings taken of one source in a second."""

MOST_A_RACE = 4_000
"""Maximum number of passings taken of one source in a race."""

MOST_SOURCES = 3
"""Maximum number of sources of which passings are taken in a race, besides officials: a correction
judges all of them again, for which a stop waits (some 2 ms for a thousand)."""

ALL_SOURCES, FURTHER_SOURCES = 'all sources', 'further sources'
"""Of whom too many passings came, if it is not one source."""

BEAM_PRESS = 3.0
"""Time after a beam's crossing within which an official says whose it was, in seconds."""

MOST_SEEN = 100_000
"""Number of identities that are known again, over all races."""


class Crossing(NamedTuple):
    """
    A passing in its place in the race, in seconds since GREEN_GREEN.

    :param came: when it came.
    :param at: when it crossed.
    """

    passing: Passing
    came: float
    at: float


class Taken(NamedTuple):
    """
    What became of a passing that came.

    :param lap: the number of the lap that it ended; 0: none.
    :param seconds: the time of that lap.
    """

    passing: Passing
    kart: int
    mark: Mark
    lap: int = 0
    seconds: float = 0.0


@dataclass(frozen=True)
class LapSettings:
    """
    How laps are counted.

    :param min_lap_time: a passing nearer to the last one that counted is doubtful, s.
    :param first_crossing: the first crossing `starts` lap 1, or `ends` it.
    :param clock_tolerance: how far a source's clock may be from the times of arrival, s.
    """

    min_lap_time: float = 5.0
    first_crossing: str = 'starts'
    clock_tolerance: float = 0.5


class _Rate(NamedTuple):
    """How many passings of a source were taken: since the beginning of a second, and in all."""

    since: float = -math.inf
    lately: int = 0
    taken: int = 0


@dataclass(frozen=True)
class Laps:
    """
    The laps of one race.

    :param wanted: how many laps each kart drives; 0: no number is set.
    :param green: when GREEN_GREEN was given, on the clock of the rules (s).
    :param karts: those that started.
    :param transponders: whose each is.
    :param heat: the name of the heat that was in the race; empty: none was.
    :param grid: the order in which the karts were to start; empty: nothing says one.
    :param ended: when the race was stopped or over, in seconds since GREEN_GREEN.
    :param finished: when each kart finished, likewise; ``left``: when it left the race.
    :param struck: the passings that were struck out, and why.
    :param given: of passings that do not say who it was, the kart that officials gave them to.
    :param counted: of each kart the times that counted, s since GREEN_GREEN.
    :param marks: what became of each crossing.
    :param unknown: the transponders that no kart has; ``clocks``: the sources whose clocks did
        not agree; ``over``: how many passings were too many, by source.
    """

    settings: LapSettings
    format: Format  # noqa: A003 - the field's name
    wanted: int
    green: float
    karts: tuple[int, ...]
    transponders: Mapping[str, int] = field(default_factory=dict)
    heat: str = ''
    ended: float = math.inf
    finished: Mapping[int, float] = field(default_factory=dict)
    left: Mapping[int, float] = field(default_factory=dict)
    crossings: tuple[Crossing, ...] = ()
    struck: Mapping[Identity, str] = field(default_factory=dict)
    given: Mapping[Identity, int] = field(default_factory=dict)
    penalties: tuple[Penalty, ...] = ()
    counted: Mapping[int, tuple[float, ...]] = field(default_factory=dict)
    marks: tuple[Mark, ...] = ()
    unknown: frozenset[str] = frozenset()
    clocks: frozenset[str] = frozenset()
    over: Mapping[str, int] = field(default_factory=dict)
    rates: Mapping[str, _Rate] = field(default_factory=dict)
    anchors: Mapping[tuple[str, str], Crossing] = field(default_factory=dict)
    grid: tuple[int, ...] = ()

    # ----- what happens -------------------------------------------------------------------

    def take(
        self, passings: Iterable[Passing], now: float, dropped: int = 0, away: float = 0.0
    ) -> tuple[Laps, list[Taken]]:
        """
        Take passings that come now, each for the first time, and say what became of them.

        :param dropped: how many more came, of whatever sources.
        :param away: time for which whoever takes them was away before: so late they may come, s.
        """
        came = now - self.green
        crossings: list[Crossing] = []
        rates, over, anchors = dict(self.rates), dict(self.over), dict(self.anchors)
        clocks = set(self.clocks)
        if dropped:
            over[ALL_SOURCES] = over.get(ALL_SOURCES, 0) + dropped
        for passing in passings:
            source = passing.source
            if source == BY_HAND and (beam := self._waiting(came)):
                laps, seen = self._give(beam, passing.kart)
                if seen.mark is Mark.COUNTED:
                    return laps, [seen]
            others = len(rates) - (BY_HAND in rates)
            is_taken = source == BY_HAND or others < MOST_SOURCES
            rate = rates.get(source, _Rate() if is_taken else _FULL)
            if came - rate.since >= 1.0:
                rate = rate._replace(since=came, lately=0)
            if rate.lately >= MOST_A_SECOND or rate.taken >= MOST_A_RACE:
                name = source if source in rates else FURTHER_SOURCES
                over[name] = over.get(name, 0) + 1
                continue
            rates[source] = rate._replace(lately=rate.lately + 1, taken=rate.taken + 1)
            crossing = Crossing(passing, came, came)
            anchor = anchors.setdefault((source, passing.session), crossing)
            at = anchor.at + (passing.stamp_ns - anchor.passing.stamp_ns) / 1e9
            tolerance = self.settings.clock_tolerance
            agrees = -tolerance - away <= at - came <= tolerance
            # Sources say what they see in its order: behind a crossing of this race, it is the
            # clock that jumped.
            is_late = at < 0.0 and not any(
                each.at >= 0.0 and _is_before(each.passing, passing)
                for each in (*reversed(crossings), *reversed(self.crossings))
            )
            if agrees or is_late:
                crossing = crossing._replace(at=at)
            if not agrees and is_late:
                clocks.add(source)
            elif not agrees:
                anchors[source, passing.session] = crossing
                if came <= self.ended:
                    clocks.add(source)
            crossings.append(crossing)
        laps = dataclasses.replace(
            self, rates=rates, over=over, anchors=anchors, clocks=frozenset(clocks)
        )
        laps, taken = laps._judge(crossings)
        for place, (each, crossing) in enumerate(zip(taken, crossings, strict=True)):
            if each.mark is Mark.UNKNOWN and (press := laps._press_before(crossing)):
                struck = {
                    **laps.struck,
                    press.passing.identity: f'seen by {each.passing.identity}',
                }
                laps, seen = laps._give(crossing, press.passing.kart, struck=struck)
                taken[place] = seen._replace(lap=0)  # told with the press
        return laps, taken

    def _waiting(self, came: float) -> Crossing | None:
        """Return the oldest crossing without a kart that an official may mean then."""
        lately = (each for each in self._nobody if came - each.came <= BEAM_PRESS)
        return next(lately, None)

    def _press_before(self, crossing: Crossing) -> Crossing | None:
        """Return the oldest passing of officials whose place a crossing by a beam takes."""
        found = None
        for each, mark in zip(reversed(self.crossings), reversed(self.marks), strict=True):
            if crossing.passing.transponder or (
                crossing.came - each.came > self.settings.clock_tolerance
            ):
                break
            if each.passing.source == BY_HAND and mark is Mark.COUNTED:
                kart = each.passing.kart
                others = tuple(at for at in self.counted[kart] if at != each.at)
                if self._mark(crossing, kart, others) is Mark.COUNTED:
                    found = each
        return found

    def _give(self, crossing: Crossing, kart: int, **changes: Any) -> tuple[Laps, Taken]:
        """Give a kart a crossing of which nobody has said who it was."""
        identity = crossing.passing.identity
        laps = self.again(given={**self.given, identity: kart}, **changes)
        before, times = len(self.counted.get(kart, ())), laps.counted.get(kart, ())
        mark = laps.marks[laps.crossings.index(crossing)]
        if len(times) <= max(before, 1):
            return laps, Taken(crossing.passing, kart, mark)
        return laps, Taken(crossing.passing, kart, mark, len(times) - 1, times[-1] - times[-2])

    def _judge(self, crossings: Sequence[Crossing]) -> tuple[Laps, list[Taken]]:
        """Judge further crossings, in the order in which they came."""
        counted = dict(self.counted)
        unknown = set(self.unknown)
        taken = []
        for crossing in crossings:
            passing = crossing.passing
            kart = self.kart_of(passing)
            mark = self._mark(crossing, kart, counted.get(kart, ()))
            lap, seconds = 0, 0.0
            if mark is Mark.COUNTED:
                times = counted[kart] = (*counted.get(kart, ()), crossing.at)
                lap = len(times) - 1
                seconds = times[-1] - times[-2] if lap else 0.0
            elif mark is Mark.UNKNOWN and passing.transponder:
                unknown.add(passing.transponder)
            taken.append(Taken(passing, kart, mark, lap, seconds))
        return (
            dataclasses.replace(
                self,
                crossings=(*self.crossings, *crossings),
                counted=counted,
                marks=(*self.marks, *(each.mark for each in taken)),
                unknown=frozenset(unknown),
            ),
            taken,
        )

    def _mark(self, crossing: Crossing, kart: int, times: tuple[float, ...]) -> Mark:
        if crossing.passing.identity in self.struck:
            return Mark.STRUCK
        if not kart and crossing.came <= self.ended:
            return Mark.UNKNOWN
        finish = self.finished.get(kart, math.inf) + self.settings.clock_tolerance
        if self.wanted and crossing.passing.source == BY_HAND:
            finish = math.inf  # an official counts what was missed, or struck out
        until = min(self.ended, finish, self.left.get(kart, math.inf))
        too_late = crossing.came > until or (self.wanted and len(times) > self.wanted)
        if kart not in self.karts or too_late or crossing.at < 0.0:
            return Mark.NOT_COUNTED
        if times and crossing.at - times[-1] < self.settings.min_lap_time:
            return Mark.DOUBTFUL
        return Mark.COUNTED

    def kart_of(self, passing: Passing) -> int:
        """Return whose passing it is; 0: nobody knows."""
        if passing.kart:
            return passing.kart
        if passing.transponder:
            # As it was said, or by the number or the label in it, if not two karts have them.
            names = passing.transponder.split(' ', 1)
            owners = {self.transponders.get(name, 0) for name in names} - {0}
            alone = owners.pop() if len(owners) == 1 else 0
            return self.transponders.get(passing.transponder, alone)
        # A beam sees only that somebody crosses: where one kart races, it is that one.
        alone = self.karts[0] if len(self.karts) == 1 else 0
        return self.given.get(passing.identity, alone)

    def again(self, **changes: Any) -> Laps:
        """Return what comes of all passings if these fields are others; so each race begins."""
        ends = self.settings.first_crossing == 'ends'
        begun = dict.fromkeys(self.karts, (0.0,) * ends)
        fresh = dataclasses.replace(
            self, counted=begun, crossings=(), marks=(), unknown=frozenset(), **changes
        )
        return fresh._judge(self.crossings)[0]

    def strike(self, identity: Identity, why: str) -> Laps:
        """Strike a passing out."""
        return self.again(struck={**self.struck, identity: why})

    def restore(self, identity: Identity) -> Laps:
        """Put a passing back."""
        return self.again(struck={key: why for key, why in self.struck.items() if key != identity})

    def finish(self, kart: int, now: float) -> Laps:
        """Take note that a kart has finished."""
        return dataclasses.replace(self, finished={**self.finished, kart: now - self.green})

    def undo_finish(self, kart: int) -> Laps:
        """Take note that it has not: what came since counts."""
        return self.again(finished={key: at for key, at in self.finished.items() if key != kart})

    def leave(self, kart: int, now: float) -> Laps:
        """Take note that a kart is out of the race."""
        return dataclasses.replace(self, left={**self.left, kart: now - self.green})

    def end(self, now: float) -> Laps:
        """Take note that the race was stopped, or is over; what comes now does not count."""
        return dataclasses.replace(self, ended=min(self.ended, now - self.green))

    def penalise(self, penalty: Penalty) -> Laps:
        """Add a penalty."""
        return dataclasses.replace(self, penalties=(*self.penalties, penalty))

    def undo_penalty(self, kart: int) -> Laps:
        """Take the last penalty of a kart back."""
        last = max(number for number, each in enumerate(self.penalties) if each.kart == kart)
        kept = (each for number, each in enumerate(self.penalties) if number != last)
        return dataclasses.replace(self, penalties=tuple(kept))

    # ----- what there is to see -----------------------------------------------------------

    def knows(self, identity: Identity) -> bool:
        """Return whether the passing is of this race."""
        return any(each.passing.identity == identity for each in self.crossings)

    def is_done(self, kart: int) -> bool:
        """Return whether a kart has all its laps."""
        return bool(self.wanted) and len(self.counted.get(kart, ())) > self.wanted

    @functools.cached_property
    def _nobody(self) -> tuple[Crossing, ...]:
        """Return the crossings of which nobody has said who it was, the first one first."""
        marked = zip(self.crossings, self.marks, strict=True)
        return tuple(
            each for each, mark in marked if mark is Mark.UNKNOWN and not each.passing.transponder
        )

    def trouble(self, now: float) -> str:
        """Return what an official should know of the sources, as a sentence; empty: nothing."""
        phrases = []
        if self.clocks:
            who = _some(self.clocks)
            phrases.append(f'the clock of {who} jumps, or its passings come late')
        for source, count in sorted(self.over.items()):
            phrases.append(f'{count} passings of {source} were too many and are not counted')
        if self.unknown:
            phrases.append(f'no kart has the transponder {_some(self.unknown)}')
        if self._nobody and now - self.green - self._nobody[0].came > BEAM_PRESS:
            phrases.append('somebody crossed the line, and nothing says who')
        return f'Look at the laps: {"; ".join(phrases)}' if phrases else ''

    @functools.cached_property
    def results(self) -> tuple[KartResult, ...]:
        """Return the result of every kart, best first."""
        return ranked(self.format, [self.result(kart) for kart in self.karts])

    @property
    def is_result(self) -> bool:
        """Return whether it is the result of a heat: a kart has a lap."""
        return bool(self.heat) and any(len(times) > 1 for times in self.counted.values())

    def last_passings(self, most: int) -> list[Judged]:
        """Return the last passings, oldest first."""
        shown = zip(self.crossings[-most:], self.marks[-most:], strict=True)
        return [
            Judged(
                each.passing,
                self.kart_of(each.passing),
                mark,
                each.at,
                self.struck.get(each.passing.identity, ''),
            )
            for each, mark in shown
        ]

    def lap_times(self, kart: int) -> tuple[float, ...]:
        """Return the times of the laps of a kart, in s."""
        times = self.counted.get(kart, ())
        return tuple(after - before for before, after in itertools.pairwise(times))

    def result(self, kart: int) -> KartResult:
        """Return the result of a kart that started, without its place."""
        times = self.counted.get(kart, ())
        lap_times = self.lap_times(kart)
        penalties = tuple(each for each in self.penalties if each.kart == kart)
        laps = max(0, len(lap_times) - sum(each.laps for each in penalties))
        total = None
        if lap_times:
            begun = 0.0 if self.format is Format.RACE else times[0]
            total = times[-1] - begun + sum(each.seconds for each in penalties)
        running = self.ended == math.inf and kart not in self.left
        if any(each.disqualified for each in penalties):
            status = Status.DISQUALIFIED
        elif running and not (kart in self.finished or self.is_done(kart)):
            status = Status.RUNNING
        elif not lap_times:
            status = Status.NOT_CLASSIFIED
        elif kart in self.finished or self.is_done(kart):
            status = Status.CLASSIFIED
        else:
            status = Status.CLASSIFIED if self.format is Format.PRACTICE else Status.DNF
        return KartResult(kart, 0, status, laps, total, lap_times, penalties)


def _is_before(one: Passing, other: Passing) -> bool:
    """Return whether a source said one before the other."""
    return one.identity[:2] == other.identity[:2] and one.number < other.number


_FULL = _Rate(taken=MOST_A_RACE)

_GROUP = {Status.DNF: 1, Status.NOT_CLASSIFIED: 2, Status.DISQUALIFIED: 3}


def ranked(format_: Format, results: Iterable[KartResult]) -> tuple[KartResult, ...]:
    """
    Return results in their order, with places; to the millisecond equal ones share a place.

    Race: by laps, then by total time. Time trial: the same, then by the best lap. Practice: by
    the best lap. Whoever did not finish, was not classified or is disqualified comes last.
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
    """Return the key to sort results by: that of a better one is less."""
    group, best, total = _GROUP.get(result.status, 0), _ms(result.best), _ms(result.total)
    if format_ is Format.PRACTICE:
        return group, best
    return group, -result.laps, total, best if format_ is Format.TIME_TRIAL else 0.0


def overall(format_: Format, results: Iterable[KartResult]) -> tuple[KartResult, ...]:
    """Return the best result that each kart has in several races, in their order, with places."""
    best: dict[int, tuple[tuple[float, ...], KartResult]] = {}
    for result in results:
        # Of equals the one with more laps, whatever the order in which they come.
        key = (*_key(format_, result), -result.laps, _ms(result.total))
        if result.kart not in best or key < best[result.kart][0]:
            best[result.kart] = key, result
    return ranked(format_, (result for _, result in best.values()))


def _ms(seconds: float | None) -> float:
    return math.inf if seconds is None else round(seconds * 1000)


def _some(names: Iterable[str]) -> str:
    """Return a few names."""
    shown = sorted(names)
    more = f' and {len(shown) - 3} more' if len(shown) > 3 else ''
    return ', '.join(shown[:3]) + more
