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
The judges of a race control: a trace in, a finding out.

Pure, and by the rules of `evgp_inspection.kart_judges`: what is not in the trace is not judged.
In this trace, what was SAID is race control's, and what was SENT is the karts'.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
import itertools
from typing import TypeAlias

from evgp_inspection.clauses import Clause
from evgp_inspection.judging import failed, judge_by, NOT_DONE, not_judged, passed
from evgp_inspection.limits import RcsLimits
from evgp_inspection.traces import Event, Kind, Section, STRANGER, Trace, Word
from evgp_inspection.verdicts import Finding, Result, Verdict
from evgp_protocol.states import RaceState

IN_GARAGE, GRID_ACTIVE = RaceState.IN_GARAGE, RaceState.GRID_ACTIVE
GREEN_GREEN, RED_FLAG, RED_RED = RaceState.GREEN_GREEN, RaceState.RED_FLAG, RaceState.RED_RED

EARLY = 0.05
"""A wait that ended this much before its limit was not cut short, s."""

LEAST_RATE = 9.8
"""Frames a second: 10, but for what timers and the ends of a connection take away."""

Judge: TypeAlias = Callable[[Trace, RcsLimits], Finding]

ONE, TWO, OUT = 0, 1, 2
"""The places of the karts in the inspection: two of the race, one outside it."""


def judge(clause: Clause, trace: Trace, limits: RcsLimits) -> Result:
    """Judge a clause of a race control."""
    return judge_by(RCS_JUDGES, clause, trace, limits)


# ----- what several judges look at ------------------------------------------------------------


def names(trace: Trace) -> list[str]:
    """Return the names of the karts, in the order in which they first connected."""
    found: dict[str, None] = {}
    for event in trace.events:
        if event.kind is Kind.OPENED and event.text != STRANGER:
            found[event.text] = None
    return list(found)


def owners(trace: Trace) -> dict[int, str]:
    """Return whose each connection is."""
    return {event.link: event.text for event in trace.events if event.kind is Kind.OPENED}


def kart(trace: Trace, place: int) -> str:
    """Return the name of a kart by its place; empty: it never connected."""
    return dict(enumerate(names(trace))).get(place, '')


def said_to(trace: Trace, section: Section, name: str) -> list[Word]:
    """Return the states that race control said to a kart in a phase."""
    links = {link for link, owner in owners(trace).items() if owner == name}
    return [w for w in section.words if w.link in links and w.state is not None]


def before(trace: Trace, section: Section, name: str) -> RaceState | None:
    """Return what race control had said last to a kart when a phase began."""
    for earlier in reversed(trace.sections[: trace.sections.index(section)]):
        words = said_to(trace, earlier, name)
        if words:
            return words[-1].state
    return None


def _first(words: Iterable[Word], state: RaceState, after: float = 0.0) -> Word | None:
    return next((each for each in words if each.state is state and each.at >= after), None)


def _taken(trace: Trace, section: Section, state: RaceState, places: Iterable[int]) -> Finding:
    """Return how long a command took to the last of these karts, without a limit."""
    commands = section.of(Kind.COMMAND)
    if not commands:
        return NOT_DONE
    came: list[float] = []
    for place in places:
        name = kart(trace, place)
        word = _first(said_to(trace, section, name), state, commands[0].at)
        if not name or word is None:
            waited = section.ended - commands[0].at
            return failed(f'No {state.value} to {name or "a kart"} in {waited:.1f} s.', section)
        came.append(word.at)
    # Repeated commands were refused; the last one before the first frame counts.
    command = [each for each in commands if each.at <= min(came)][-1]
    began = command.at if command.value else min(came)
    took = max(came) - began
    what = 'the command' if command.value else 'the first kart'
    return passed(f'{state.value} came {took:.3f} s after {what}.', section, measured=took)


# ----- the kinds of judges --------------------------------------------------------------------


def _reaches(phase: str, limit: str, state: RaceState, *places: int) -> Judge:
    """Judge whether a command reaches these karts within a limit."""

    def judge_phase(trace: Trace, limits: RcsLimits) -> Finding:
        section = trace.called(phase)
        if section is None:
            return NOT_DONE
        finding = _taken(trace, section, state, places)
        seconds: float = getattr(limits, limit)
        if finding.measured is not None and finding.measured > seconds:
            why = f'{state.value} took {finding.measured:.2f} s.'
            return failed(why, section, measured=finding.measured)
        if finding.verdict is Verdict.FAIL and section.ended - section.began < seconds - EARLY:
            return not_judged('The wait was cut short.', section)
        return finding

    return judge_phase


def _alone(judge_one: Judge, phase: str, place: int, *states: RaceState) -> Judge:
    """Judge as another judge, and that a second kart is sent nothing but these states."""

    def judge_phase(trace: Trace, limits: RcsLimits) -> Finding:
        section = trace.called(phase)
        if section is not None:
            name = kart(trace, place)
            for word in said_to(trace, section, name):
                if word.state is not None and word.state not in states:
                    return failed(f'{word.state.value} was sent to {name}, too.', section)
        return judge_one(trace, limits)

    return judge_phase


def _no_green(phase: str) -> Judge:
    """Judge whether no kart is sent GREEN_GREEN in a phase in which it is commanded."""

    def judge_phase(trace: Trace, limits: RcsLimits) -> Finding:
        section = trace.called(phase)
        if section is None or not section.of(Kind.COMMAND):
            return NOT_DONE
        for name in names(trace):
            if before(trace, section, name) is GREEN_GREEN:
                return not_judged('The race was in GREEN_GREEN before.', section)
            word = _first(said_to(trace, section, name), GREEN_GREEN)
            if word is not None:
                after = word.at - section.began
                return failed(f'GREEN_GREEN was sent to {name} after {after:.2f} s.', section)
        return _stayed(section, limits)

    return judge_phase


def _stayed(section: Section, limits: RcsLimits) -> Finding:
    took = section.ended - section.began
    if took < limits.watch - EARLY:
        return not_judged('The watch was cut short.', section)
    if not any(word.state is not None for word in section.words):
        return not_judged('Race control sent nothing.', section)
    return passed(f'Nothing of the kind came for {took:.1f} s.', section)


def _unchanged(*phases: str) -> Judge:
    """Judge whether every kart is sent the same as before in these phases."""

    def one(trace: Trace, section: Section, limits: RcsLimits) -> Finding:
        for name in names(trace):
            state = before(trace, section, name)
            for word in said_to(trace, section, name):
                if word.state is not state and word.state is not None:
                    was = state.value if state is not None else 'nothing'
                    return failed(f'{name} was sent {was}, then {word.state.value}.', section)
        return _stayed(section, limits)

    def judge_phases(trace: Trace, limits: RcsLimits) -> Finding:
        sections = [each for name in phases if (each := trace.called(name)) is not None]
        findings = [one(trace, each, limits) for each in sections]
        failed = [each for each in findings if each.verdict is Verdict.FAIL]
        if failed:
            return failed[0]
        if len(findings) < len(phases):
            return NOT_DONE
        undecided = [each for each in findings if each.verdict is Verdict.NOT_JUDGED]
        return (undecided or findings)[0]

    return judge_phases


def _comes_back(phase: str, allowed: frozenset[RaceState], places: Iterable[int]) -> Judge:
    """Judge what is sent on a new connection of a kart."""

    def judge_phase(trace: Trace, limits: RcsLimits) -> Finding:
        section = trace.called(phase)
        if section is None:
            return NOT_DONE
        for place in places:
            name = kart(trace, place)
            links = [e.link for e in section.of(Kind.OPENED) if e.text == name]
            words = [w for w in section.words if w.link in links and w.state is not None]
            if not words:
                return not_judged(f'{name or "A kart"} was sent nothing.', section)
            for word in words:
                if word.state is not None and word.state not in allowed:
                    return failed(f'{word.state.value} was sent to {name}.', section)
        return passed('Only what was expected was sent.', section)

    return judge_phase


def _stays_red(phase: str, place: int) -> Judge:
    """Judge whether a kart that is sent RED_RED is sent nothing else in a phase."""

    def judge_phase(trace: Trace, limits: RcsLimits) -> Finding:
        section = trace.called(phase)
        if section is None or not section.of(Kind.COMMAND):
            return NOT_DONE
        name = kart(trace, place)
        if before(trace, section, name) is not RED_RED:
            return not_judged(f'{name or "The kart"} was not in RED_RED before.', section)
        for word in said_to(trace, section, name):
            if word.state is not None and word.state is not RED_RED:
                return failed(f'{word.state.value} was sent to {name}.', section)
        return _stayed(section, limits)

    return judge_phase


_JUST_RED = frozenset({RED_RED})

# ----- judges of one clause -------------------------------------------------------------------


def _connects(trace: Trace, limits: RcsLimits) -> Finding:
    section = trace.called('connect/first')
    if section is None:
        return NOT_DONE
    longest = 0.0
    opened = section.of(Kind.OPENED)
    for event in opened:
        word = next((w for w in section.words if w.link == event.link), None)
        if word is None:
            return failed(f'Nothing was sent to {event.text}.', section)
        longest = max(longest, word.at - event.at)
    if len(opened) < len((ONE, TWO, OUT)):
        return failed('A connection was refused.', section)
    if longest > limits.connect:
        return failed(f'The first frame came after {longest:.2f} s.', section, measured=longest)
    return passed('Every kart was sent a frame.', section, measured=longest)


def _refuses_strangers(trace: Trace, limits: RcsLimits) -> Finding:
    section = trace.called('connect/stranger')
    if section is None:
        return NOT_DONE
    links = {e.link for e in section.of(Kind.OPENED) if e.text == STRANGER}
    if not links:
        return passed('The connection was refused.', section)
    if any(event.link in links for event in section.of(Kind.SAID)):
        return failed('A frame was sent to an unknown address.', section)
    ended = [e for e in section.of(Kind.CLOSED) if e.link in links]
    if not ended:
        return failed(f'The connection stayed open for {limits.slack:g} s.', section)
    return passed('The connection was closed without a byte.', section)


def _lets_in_again(trace: Trace, limits: RcsLimits) -> Finding:
    section = trace.called('absent/back')
    if section is None:
        return NOT_DONE
    if not said_to(trace, section, kart(trace, ONE)):
        waited = section.ended - section.began
        if waited < limits.connect - EARLY:
            return not_judged('The wait was cut short.', section)
        return failed(f'It was sent nothing for {waited:.1f} s.', section)
    return _comes_back('absent/back', _JUST_RED, (ONE,))(trace, limits)


def _replaces(trace: Trace, limits: RcsLimits) -> Finding:
    section = trace.called('connect/second')
    if section is None:
        return NOT_DONE
    links = [event.link for event in section.of(Kind.OPENED)]
    if not links or not any(word.link == links[0] for word in section.words):
        return failed('Nothing was sent on the second connection.', section)
    if not [e for e in section.of(Kind.CLOSED) if e.link != links[0]]:
        return failed(f'The first connection stayed open for {limits.slack:g} s.', section)
    return passed('The first connection was closed.', section)


def _staggers(trace: Trace, limits: RcsLimits) -> Finding:
    sections = [trace.called('race/finish_one'), trace.called('race/finish_two')]
    delays: list[float] = []
    for place, section in zip((ONE, TWO), sections, strict=True):
        if section is None:
            return NOT_DONE
        word = _first(said_to(trace, section, kart(trace, place)), RED_FLAG)
        given = [
            event
            for event in section.of(Kind.COMMAND, Kind.ANSWERED)
            if word is not None and event.at <= word.at
        ]
        if word is None or not given:
            return not_judged('A finished kart was not sent RED_FLAG.', section)
        # A person has pressed by the time of the answer; what comes before it is not timed.
        exact = [event for event in given if event.kind is Kind.COMMAND and event.value]
        answered = [event for event in given if event.kind is Kind.ANSWERED]
        if not exact and not answered:
            return not_judged('RED_FLAG came before the key.', section)
        delays.append(word.at - (exact or answered)[-1].at)
    difference = abs(delays[0] - delays[1])
    why = f'The delays are {delays[0]:.2f} s and {delays[1]:.2f} s.'
    shown = [section for section in sections if section is not None]
    if difference < limits.stagger:
        return failed(why, *shown, measured=difference)
    return passed(why, *shown, measured=difference)


def _outside(trace: Trace, limits: RcsLimits) -> Finding:
    name = kart(trace, OUT)
    links = {link for link, owner in owners(trace).items() if owner == name and name}
    killed = seen = False
    stops = ('ALL_KILL', f'KART_RED_RED {name.removeprefix("kart ")}')
    first = trace.called('connect/first')
    if first is None:
        return NOT_DONE
    # Before that, race control was brought to IN_GARAGE from wherever it was.
    place = trace.sections.index(first)
    for section in trace.sections[place:]:
        kills = [e.at for e in section.of(Kind.COMMAND) if e.text in stops]
        stopped = False
        for word in section.words:
            killed = killed or any(at <= word.at for at in kills)
            if word.link not in links or word.state is None:
                continue
            seen = True
            stopped = stopped or word.state is RED_RED
            if word.state is IN_GARAGE:
                # Until RED_RED comes, this is what was sent before ALL_KILL.
                killed = killed and not (stopped and not kills)
                continue
            if word.state is not RED_RED or not killed:
                return failed(f'{word.state.value} was sent to {name}.', section)
        killed = killed or bool(kills)
    if not seen:
        return NOT_DONE
    return passed('It was sent IN_GARAGE, and RED_RED once it was stopped.')


def _spans(trace: Trace) -> dict[int, list[Event]]:
    """Return the bytes of each connection of a kart while it was judged by time."""
    found: dict[int, list[Event]] = {}
    silent: set[int] = set()
    known = {link for link, name in owners(trace).items() if name != STRANGER}
    for event in trace.events:
        if event.kind is Kind.SILENT:
            silent.add(event.link)
        if event.kind is Kind.SAID and event.link not in silent and event.link in known:
            found.setdefault(event.link, []).append(event)
    return found


def _rate(trace: Trace, limits: RcsLimits) -> Finding:
    held_up = [event for event in trace.events if event.kind is Kind.HELD_UP]
    rates: list[tuple[float, list[Event], list[Event]]] = []
    for events in _spans(trace).values():
        began, ended = events[0].at, events[-1].at
        if ended - began >= 1.0:
            frames = sum(event.data.count(b';') for event in events[1:])
            late = [each for each in held_up if began <= each.at <= ended + each.value]
            rates.append((frames / (ended - began), events, late))
    if not rates:
        return NOT_DONE
    slow = [each for each in rates if each[0] < LEAST_RATE]
    # A connection during which this computer was never late says more than a slower one.
    rate, events, late = min(slow or rates, key=lambda each: (bool(slow and each[2]), each[0]))
    why = f'Connection {events[0].link} was sent {rate:.1f} frames a second.'
    if slow:
        return Finding(Verdict.FAIL, why, None, (*events[:200], *late))
    return passed(f'{why} It is the slowest.')


def _gap(trace: Trace, limits: RcsLimits) -> Finding:
    worst: tuple[float, int, float] | None = None
    for link, events in _spans(trace).items():
        for one, other in itertools.pairwise(events):
            worst = max(worst or (0.0, 0, 0.0), (other.at - one.at, link, one.at))
    if worst is None:
        return NOT_DONE
    gap, link, at = worst
    why = f'{gap:.3f} s on connection {link}, from {at:.3f} s on.'
    if gap > limits.gap:
        evidence = tuple(e for e in trace.events if at - 0.2 <= e.at <= at + gap + 0.2)
        return Finding(Verdict.FAIL, why, gap, evidence)
    return passed(why, measured=gap)


def _well_formed(trace: Trace, limits: RcsLimits) -> Finding:
    heard = False
    for section in trace.sections:
        for word in section.words:
            heard = True
            if word.state is None:
                return failed(f'It sent bytes that are no frame: {word.reason}.', section)
    return passed('All bytes were frames.') if heard else NOT_DONE


def _notices(trace: Trace, limits: RcsLimits) -> Finding:
    section = trace.called('vanish/lost')
    if section is None:
        return NOT_DONE
    gone = section.of(Kind.SILENT)
    words = section.of(Kind.SENT)
    if not gone or not [event for event in words if event.link == gone[0].link]:
        return not_judged('The wait was cut short.', section)
    link = gone[0].link
    if not [event for event in section.of(Kind.CLOSED) if event.link == link]:
        return failed(f'It still had the connection after {limits.half_open:g} s.', section)
    return passed(f'It had given the connection up within {limits.half_open:g} s.', section)


RCS_JUDGES: dict[str, Judge] = {
    'R-3A-01': _comes_back('connect/first', frozenset({IN_GARAGE}), (ONE, TWO, OUT)),
    'R-3A-02': _unchanged('stop/flag'),
    'R-3A-03': _stays_red('held/flag', ONE),
    'R-3B-01': _no_green('grid/silent'),
    'R-3B-02': _no_green('grid/early'),
    'R-3B-03': _no_green('lost/green'),
    'R-3B-04': _no_green('lost/back'),
    'R-3B-05': _no_green('again/silent'),
    'R-3B-06': _reaches('race/order', 'reach', GRID_ACTIVE, ONE, TWO),
    'R-3B-07': _reaches('race/started', 'reach', GREEN_GREEN, ONE, TWO),
    'R-3B-08': _no_green('halves/green'),
    'R-3C-01': _alone(
        _reaches('race/finish_one', 'finish', RED_FLAG, ONE), 'race/finish_one', TWO, GREEN_GREEN
    ),
    'R-3C-02': _staggers,
    'R-3C-03': _reaches('race/over', 'reach', RED_RED, ONE, TWO),
    'R-3C-04': _unchanged('race/unacknowledged'),
    'R-3C-05': _reaches('race/released', 'reach', IN_GARAGE, ONE, TWO),
    'R-3E-01': _comes_back('connect/back', frozenset({IN_GARAGE}), (TWO,)),
    'R-3E-02': _comes_back('lost/returned', frozenset(RaceState) - {GREEN_GREEN}, (ONE,)),
    'R-3E-03': _comes_back('again/back', _JUST_RED, (TWO,)),
    'R-3E-04': _comes_back('flag/back', _JUST_RED, (ONE,)),
    'R-3E-05': _comes_back('stop/back', _JUST_RED, (ONE,)),
    'R-3E-06': _comes_back('vanish/back', _JUST_RED, (ONE,)),
    'R-3E-07': _lets_in_again,
    'R-3F-01': _outside,
    'R-4A-01': _connects,
    'R-4A-02': _refuses_strangers,
    'R-4A-03': _replaces,
    'R-4B-01': _reaches('stop/all_kill', 'all_kill', RED_RED, ONE, TWO, OUT),
    'R-4B-02': _reaches('flag/flag', 'reach', RED_FLAG, ONE, TWO),
    'R-4B-03': _alone(_reaches('again/one', 'reach', RED_RED, ONE), 'again/one', TWO, GREEN_GREEN),
    'R-4B-04': _unchanged(
        'connect/green', 'race/grid_again', 'race/garage_in_race', 'stop/grid', 'stop/green'
    ),
    'R-4B-05': _comes_back('absent/back', _JUST_RED, (OUT,)),
    'R-4B-06': _no_green('last/green'),
    'R-4C-01': _rate,
    'R-4C-02': _gap,
    'R-4C-03': _well_formed,
    'R-4D-01': _notices,
}
"""The judge of each clause."""
