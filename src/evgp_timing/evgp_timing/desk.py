# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The desk: the timekeeper's data about all races of the event, with their laps and results.

Only inputs (`Input`) change the data: the roster and settings (`Terms`), events from race control
(`Told`, `Heard`), passings (`Passed`), and officials' corrections (`Corrected`). A
passing is a report that something crossed the timing line. The timekeeper writes every input to
its book, a file, in the order of arrival. After a restart, it replays the book.

This module sends nothing to karts. With `auto_finish`, `Desk.finishes` names the karts for which
the node requests FINISH from race control.

Times are in seconds since the machine started, by the clock that race control uses. This module
is pure.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
import enum
import math
from typing import NamedTuple

from evgp_node.results import (
    Act,
    BY_HAND,
    Corrected,
    Correction,
    HeatGrid,
    Identity,
    KartResult,
    MOST_PASSINGS,
    Passing,
    Penalty,
    RaceOfEvent,
    Standings,
)
from evgp_node.roster import Format, Heat
from evgp_timing.laps import Laps, LapSettings, overall

MOST_SEEN = 100_000
"""Maximum number of passings that the desk remembers to recognise repeats."""

MOST_GIVEN = 100
"""Maximum number of transponders that officials can assign, and of penalties in each race."""


class Roster(NamedTuple):
    """The part of the roster that timing uses, with the kart of each transponder."""

    karts: tuple[int, ...]
    transponders: Mapping[str, int] = {}
    heats: tuple[Heat, ...] = ()


# ----- inputs ---------------------------------------------------------------------------------


class What(enum.Enum):
    """What race control reports about a race, or about a kart in it."""

    GRID_ACTIVE = 'the grid forms'
    GREEN_GREEN = 'the race is started'
    SENT_GREEN = 'a kart is sent GREEN_GREEN'
    FINISH = 'a kart has finished'
    UNDO_FINISH = 'its finish is undone'
    LEFT = 'a kart leaves the race'
    OVER = 'the race is stopped or over'


class Terms(NamedTuple):
    """
    The roster and the settings. Races that were started earlier keep theirs.

    :param at: the time from which they apply, in seconds.
    """

    at: float
    roster: Roster
    settings: LapSettings


class Told(NamedTuple):
    """
    A report from race control.

    :param at: when it happened, in seconds.
    :param run: id of the run of race control.
    :param race: number of the race in that run.
    :param heat: name of the heat in the race; empty if there is none.
    :param kart: number of the kart; 0 if the report is not about a kart.
    :param sequence: number of the event.
    """

    at: float
    what: What
    run: str
    race: int
    heat: str = ''
    kart: int = 0
    sequence: int = 0


class Heard(NamedTuple):
    """
    Confirms that all events of a run have arrived up to this number, but for those that are lost.

    :param missed: number of events before it that were lost; their content is unknown.
    """

    at: float
    run: str
    sequence: int
    missed: int = 0


class Passed(NamedTuple):
    """
    Passings that sources saw.

    :param at: when they arrived, in seconds.
    :param away: how long the timekeeper had been away before this, in seconds. The passings may be
        late by up to this much.
    """

    at: float
    passings: tuple[Passing, ...]
    away: float = 0.0


Input = Terms | Told | Heard | Passed | Corrected


class Answer(NamedTuple):
    """The answer to a correction: whether it was accepted, and a sentence for the official."""

    success: bool
    text: str


class Finish(NamedTuple):
    """
    A FINISH that the node requests from race control, with the fields of `KartFinish.srv`.

    The request's `attempt` is always 0, so race control refuses the request if an official has
    undone the kart's finish in the meantime.
    """

    run: str
    race: int
    kart: int


# ----- the data -------------------------------------------------------------------------------


@dataclass
class Race:
    """
    A race of the event.

    :param run: id of the run of race control.
    :param number: number of the race in that run.
    :param began: when the grid formed, in seconds.
    :param started: whether race control has sent GREEN_GREEN.
    :param published: the results that an official has published; empty if there are none.
    :param missed: number of events from race control that were lost.
    :param by_finish: the passing made for each kart's FINISH that counts as a crossing.
    :param undone: the karts whose finish an official has undone.
    """

    run: str
    number: int
    began: float
    laps: Laps
    started: bool = False
    published: tuple[KartResult, ...] = ()
    missed: int = 0
    by_finish: dict[int, Identity] = field(default_factory=dict)
    undone: set[int] = field(default_factory=set)

    @property
    def heat(self) -> str:
        """Return the name of the race's heat, or an empty string."""
        return self.laps.heat.name


class Desk:
    """
    The timekeeper's data. Only `feed` changes it; the other methods return parts of it.

    :ivar races: every race of the event, oldest first.
    """

    def __init__(self, roster: Roster, settings: LapSettings) -> None:
        self.roster = roster
        self.settings = settings
        self.races: list[Race] = []
        self._given: dict[str, int] = {}
        self._chosen: dict[str, Race] = {}
        self._seen: dict[Identity, None] = {}

    def feed(self, given: Input) -> Answer | None:
        """Process an input and return the answer if the input is a correction."""
        match given:
            case Terms():
                self.roster, self.settings = given.roster, given.settings
            case Told():
                self._told(given)
            case Heard(_, run, _, missed) if self.races and self.races[-1].run == run:
                self.races[-1].missed += missed
            case Passed():
                self._passed(given)
            case Corrected():
                return self._correct(self.about(given))
        return None

    # ----- what race control says ---------------------------------------------------------

    def _told(self, told: Told) -> None:
        race = self._race_of(told)
        if race is None:
            return
        laps, kart = race.laps, told.kart
        match told.what:
            case What.GREEN_GREEN:
                race.started = True
                race.laps = self._laps(told.heat, told.at, laps)
            case What.SENT_GREEN if race.started and kart not in laps.karts:
                karts = (*laps.karts, kart)
                race.laps = laps.again(karts=karts, grid=self._grid(karts, laps.heat))
            case What.FINISH:
                self._finish(race, kart, told.at)
            case What.UNDO_FINISH:
                self._undo_finish(race, kart)
            case What.LEFT:
                race.laps = laps.leave(kart, told.at)
            case What.OVER if race.started:
                race.laps = laps.end(told.at)
            case _:
                pass

    def _race_of(self, told: Told) -> Race | None:
        """Return a report's race, or None if its grid formed before the first known input."""
        newest = self.races[-1] if self.races else None
        if newest is not None and (newest.run, newest.number) == (told.run, told.race):
            return newest
        if newest is not None:
            newest.laps = newest.laps.end(told.at)  # race control was restarted
        if told.what is not What.GRID_ACTIVE:
            return None
        laps = self._laps(told.heat, told.at, newest.laps if newest is not None else None)
        self.races.append(Race(told.run, told.race, told.at, laps))
        return self.races[-1]

    def _laps(self, heat: str, begins: float, before: Laps | None) -> Laps:
        """Return the laps of a new race, with the sources' clocks as in the previous race."""
        owners = {**self.roster.transponders, **self._given}
        anchors = {}
        if before is not None:
            sooner = begins - before.green
            anchors = {
                source: each._replace(came=each.came - sooner, at=each.at - sooner)
                for source, each in before.anchors.items()
            }
        return Laps(self.settings, self._heat(heat), begins, (), owners, anchors=anchors)

    def _finish(self, race: Race, kart: int, at: float) -> None:
        """Record a FINISH. If only one lap is missing, FINISH counts as the last crossing."""
        laps = race.laps
        lacks_one = laps.wanted and len(laps.counted.get(kart, ())) == laps.wanted
        if lacks_one:
            press = self._count(race, kart, at)
            if race.laps.mark_of(press) is not None:
                race.by_finish[kart] = press
        race.laps = race.laps.finish(kart, at)

    def _undo_finish(self, race: Race, kart: int) -> None:
        race.undone.add(kart)
        race.laps = race.laps.undo_finish(kart)
        if kart in race.by_finish:
            race.laps = race.laps.strike(race.by_finish.pop(kart), 'its FINISH was undone')

    # ----- the timing line ----------------------------------------------------------------

    def _passed(self, given: Passed) -> None:
        came = given.passings
        fresh = {each.identity: each for each in came if each.identity not in self._seen}
        self._seen |= dict.fromkeys(fresh)
        while len(self._seen) > MOST_SEEN:
            del self._seen[next(iter(self._seen))]
        if self.races:
            race = self.races[-1]
            race.laps = race.laps.take(fresh.values(), given.at, given.away)

    @staticmethod
    def _count(race: Race, kart: int, at: float) -> Identity:
        """Take an official's passing, unless too many arrive, and return its identity."""
        number = 1 + sum(each.passing.source == BY_HAND for each in race.laps.crossings)
        press = Passing(BY_HAND, f'{race.run} {race.number}', number, kart)
        race.laps = race.laps.take([press], at)
        return press.identity

    def finishes(self) -> Iterator[Finish]:
        """
        Yield a FINISH for each kart of the newest race that has all its laps but no FINISH.

        They are in the order of the last crossings, as the place decides when the RED_FLAG comes.
        """
        race = self.races[-1] if self.races else None
        if race is None or not race.laps.heat.auto_finish or race.laps.ended < math.inf:
            return
        counted = race.laps.counted
        done = filter(race.laps.is_done, race.laps.karts)
        for kart in sorted(done, key=lambda kart: counted[kart][-1]):
            out = kart in race.laps.finished or kart in race.laps.left
            # Once an official has undone a finish, only an official may send FINISH again.
            if not out and kart not in race.undone:
                yield Finish(race.run, race.number, kart)

    # ----- corrections --------------------------------------------------------------------

    def about(self, given: Corrected) -> Corrected:
        """Return a correction with the run and number of its race filled in, if known."""
        number = given.correction.race
        if given.run or not self.races or number > len(self.races):
            return given
        race = self.races[number - 1]
        return given._replace(run=race.run, race=race.number)

    def _correct(self, given: Corrected) -> Answer:
        asked = given.correction
        if asked.act is Act.GIVE:
            return self._give(asked)
        # After a restart, the event may have fewer races, so that their places say nothing.
        its = (each for each in self.races if (each.run, each.number) == (given.run, given.race))
        race = next(its, None)
        if asked.race and race is None:
            return Answer(False, f'this event has no race {asked.race}')
        if race is None or not race.started:
            return Answer(False, 'no race has been started')
        if why_not := self._refusal(asked, race.laps):
            return Answer(False, why_not)
        return self._put_in_force(asked, race, given.at)

    def _give(self, asked: Correction) -> Answer:
        name, kart = asked.transponder, asked.kart
        if not name:
            return Answer(False, 'name the transponder')
        if kart not in self.roster.karts:
            return Answer(False, f'there is no kart {kart}')
        if name not in self._given and len(self._given) >= MOST_GIVEN:
            full = f'officials have already assigned {MOST_GIVEN} transponders, the maximum'
            return Answer(False, f'{full}. List any others in the roster')
        self._given[name] = kart
        for race in self.races[-1:]:
            race.laps = race.laps.again(transponders={**race.laps.transponders, name: kart})
        return Answer(True, f'transponder {name} belongs to kart {kart}')

    @staticmethod
    def _refusal(asked: Correction, laps: Laps) -> str:
        """Return why the desk refuses a correction of a race, or an empty string."""
        act = asked.act
        if act in (Act.STRIKE, Act.RESTORE):
            if laps.mark_of(asked.passing) is None:
                return f'this race has no passing {asked.passing}'
            if (asked.passing in laps.struck) is (act is Act.STRIKE):
                return (
                    f'passing {asked.passing} is {"" if act is Act.STRIKE else "not "}struck out'
                )
        if act in (Act.COUNT, Act.PENALISE, Act.UNDO_PENALTY) and asked.kart not in laps.karts:
            return f'kart {asked.kart} did not start this race'
        if act in (Act.STRIKE, Act.PENALISE) and not asked.reason:
            return 'give a reason'
        if act is Act.PENALISE:
            if not (asked.seconds or asked.laps or asked.disqualified):
                return 'give the penalty: seconds, laps, or disqualification'
            if len(laps.penalties) >= MOST_GIVEN:
                return f'this race already has {MOST_GIVEN} penalties, the maximum'
        if act is Act.UNDO_PENALTY and asked.kart not in {each.kart for each in laps.penalties}:
            return f'kart {asked.kart} has no penalty'
        if act is Act.PUBLISH and laps.ended == math.inf:
            return 'the race is still under way'
        if act is Act.CHOOSE and not laps.is_result:
            return 'that race had no heat, or none of its laps counted'
        return ''

    def _put_in_force(self, asked: Correction, race: Race, now: float) -> Answer:
        laps, kart = race.laps, asked.kart
        published: tuple[KartResult, ...] = ()  # those published before are out of date
        match asked.act:
            case Act.COUNT:
                press = self._count(race, kart, now)
                mark = race.laps.mark_of(press)
                if mark is None:
                    return Answer(False, 'too many passings are arriving')
                text = f'kart {kart} crossed the line: {mark.value}'
            case Act.STRIKE:
                race.laps = laps.strike(asked.passing, f'{asked.reason} ({asked.official})')
                text = f'passing {asked.passing} is struck out'
            case Act.RESTORE:
                race.laps = laps.restore(asked.passing)
                text = f'passing {asked.passing} is restored, and counts if the rules allow it'
            case Act.PENALISE:
                terms = kart, asked.seconds, asked.laps, asked.disqualified
                penalty = Penalty(*terms, asked.reason, asked.official)
                race.laps = laps.penalise(penalty)
                text = f'kart {kart}: {penalty}'
            case Act.UNDO_PENALTY:
                race.laps = laps.undo_penalty(kart)
                text = f'the last penalty of kart {kart} is undone'
            case Act.PUBLISH:
                published = laps.results
                text = f'the results of race {self.races.index(race) + 1} are published'
            case _:
                self._chosen[race.heat] = race
                text = f'race {self.races.index(race) + 1} now counts as {race.heat}'
        race.published = published
        return Answer(True, text)

    # ----- results ------------------------------------------------------------------------

    def _heat(self, name: str) -> Heat:
        return next((heat for heat in self.roster.heats if heat.name == name), Heat(name))

    def counting(self) -> dict[str, Race]:
        """
        Return the race that counts for each heat.

        This is the race that an official chose. If none was chosen, it is the last one with a lap.
        """
        last = {each.heat: each for each in self.races if each.laps.is_result}
        return {heat: self._chosen.get(heat, race) for heat, race in last.items()}

    def best(self, format_: Format) -> tuple[KartResult, ...]:
        """Return each kart's best result in the races that count for the heats of a format."""
        counting = (race.laps for race in self.counting().values())
        races = (laps for laps in counting if laps.heat.format is format_)
        return overall(format_, (each for laps in races for each in laps.results))

    def _order(self, source: str) -> dict[int, int]:
        """Return the place in the results of a heat, or of all heats of a format, by kart."""
        if any(heat.name == source for heat in self.roster.heats):
            race = self.counting().get(source)
            results = race.laps.results if race is not None else ()
        else:
            of_format = (self.best(each) for each in Format if each.value == source)
            results = next(of_format, ())  # the heat may have left the roster
        return {each.kart: place for place, each in enumerate(results)}

    def _grid(self, karts: tuple[int, ...], heat: Heat) -> tuple[int, ...]:
        order = self._order(heat.grid_from)
        if not order:
            return ()
        return tuple(sorted(karts, key=lambda kart: (order.get(kart, math.inf), kart)))

    def grids(self) -> dict[str, tuple[int, ...]]:
        """Return the starting order of each heat, which is empty until the order is known."""
        return {heat.name: self._grid(heat.karts, heat) for heat in self.roster.heats}

    def standings(self, now: float = 0.0, race: Race | None = None) -> Standings:
        """Return the results of a race, by default of the newest, at `now`, in seconds."""
        grids = self.grids()
        seen = Standings(
            stamp=now,
            grids=tuple(HeatGrid(*each) for each in grids.items()),
            next_heat=self._next_heat(grids),
            races=tuple(self._listed()),
            questions=tuple(self.questions(now, race)),
        )
        if not self.races:
            return seen
        race = race or self.races[-1]
        laps = race.laps
        return seen._replace(
            run=race.run,
            race=race.number,
            heat=race.heat,
            format=laps.heat.format,
            laps=laps.wanted,
            grid=laps.grid,
            karts=laps.results,
            overall=self.best(laps.heat.format),
            passings=tuple(laps.last_passings(MOST_PASSINGS)),
            published=bool(race.published) and race.published == laps.results,
            from_green=laps.settings.from_green,
        )

    def _listed(self) -> Iterator[RaceOfEvent]:
        counting = [id(each) for each in self.counting().values()]
        for number, race in enumerate(self.races, 1):
            classified = sum(each.place > 0 for each in race.laps.results)
            counts = id(race) in counting
            yield RaceOfEvent(number, race.heat, race.began, classified, counts)

    def _next_heat(self, grids: Mapping[str, tuple[int, ...]]) -> str:
        """Return the next single-kart heat that has no result and is not in the race."""
        raced = {*self.counting(), *(race.heat for race in self.races[-1:])}
        turns = [
            (self._order(heat.grid_from).get(kart, math.inf), kart, heat.name)
            for heat in self.roster.heats
            for kart in grids[heat.name]
            if len(heat.karts) == 1 and heat.name not in raced
        ]
        return min(turns, default=(0, 0, ''))[2]

    def questions(self, now: float = 0.0, race: Race | None = None) -> list[str]:
        """Return a sentence for each thing to check in a race, by default in the newest."""
        if not self.races:
            return []
        race = race or self.races[-1]
        laps, missed = race.laps, race.missed
        asked = [f'{missed} events from race control were lost. Check the laps'] if missed else []
        others = {race.heat} - {'', *(heat.name for heat in self.roster.heats)}
        others |= {f'kart {kart}' for kart in laps.karts if kart not in self.roster.karts}
        if others:
            asked.append(
                f'Race control has {", ".join(sorted(others))}, but the roster here does not. '
                'Start both with the same roster'
            )
        for kart in laps.karts:
            missing = laps.wanted - max(0, len(laps.counted.get(kart, ())) - 1)
            if laps.wanted and kart in laps.finished and missing > 0:
                many = f'{missing} laps are' if missing > 1 else '1 lap is'
                asked.append(f'Kart {kart} is marked as finished, but {many} missing')
        if trouble := laps.trouble(now):
            asked.append(trouble)
        # Best laps and penalties do not follow the order on the track, nor do lapped karts.
        placed = [
            each for each in laps.results if each.kart in laps.finished and not each.penalties
        ]
        in_order = sorted(placed, key=lambda each: (-each.laps, laps.finished[each.kart]))
        if laps.heat.format is Format.RACE and placed != in_order:
            asked.append('The order of FINISH differs from the order of the results')
        return asked
