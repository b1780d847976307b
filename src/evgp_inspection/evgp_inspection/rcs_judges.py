# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The judges of a race control: a trace in, a finding out.

Pure, and by the rules of `evgp_inspection.kart_judges`: what is not in the trace is not judged.
In this trace, what was SAID is race control's, and what was SENT is the karts'.
"""

from __future__ import annotations

from collections.abc import Iterator, Set
import itertools

from evgp_inspection.limits import RcsLimits
from evgp_inspection.traces import Event, Kind, Said, Section, STRANGER, Trace
from evgp_inspection.verdicts import (
    EARLY,
    failed,
    Finding,
    Judge,
    judge_of,
    NOT_DONE,
    not_judged,
    passed,
    Verdict,
    worst,
)
from evgp_protocol.states import RaceState

IN_GARAGE, GRID_ACTIVE = RaceState.IN_GARAGE, RaceState.GRID_ACTIVE
GREEN_GREEN, RED_FLAG, RED_RED = RaceState.GREEN_GREEN, RaceState.RED_FLAG, RaceState.RED_RED

LEAST_RATE = 9.8
"""Frames a second: 10, but for what timers and the ends of a connection take away."""

ONE, TWO, OUT = 0, 1, 2
"""The places of the karts in the inspection: two of the race, one outside it."""


# ----- what several judges look at ------------------------------------------------------------


def owners(trace: Trace) -> dict[int, str]:
    """Return whose each connection is."""
    return {event.link: event.text for event in trace.events if event.kind is Kind.OPENED}


def names(trace: Trace) -> list[str]:
    """Return the names of the karts, in the order in which they first connected."""
    return [name for name in dict.fromkeys(owners(trace).values()) if name != STRANGER]


def kart(trace: Trace, place: int) -> str:
    """Return the name of a kart by its place; empty: it never connected."""
    return dict(enumerate(names(trace))).get(place, '')


def said_to(trace: Trace, section: Section, name: str) -> list[tuple[Said, RaceState]]:
    """Return the states that race control said to a kart in a phase."""
    whose = owners(trace)
    return [(w, w.state) for w in section.said if w.state and whose.get(w.link) == name]


def before(trace: Trace, section: Section, name: str) -> RaceState | None:
    """Return what race control had said last to a kart when a phase began."""
    for earlier in reversed(trace.sections[: trace.sections.index(section)]):
        if said := said_to(trace, earlier, name):
            return said[-1][1]
    return None


def _first(
    trace: Trace, section: Section, place: int, state: RaceState, after: float = 0.0
) -> Said | None:
    said = said_to(trace, section, kart(trace, place))
    return next((said for said, each in said if each is state and said.at >= after), None)


def _stayed(section: Section, limits: RcsLimits) -> Finding:
    took = section.ended - section.began
    if took < limits.watch - EARLY:
        return not_judged('The watch was cut short.', section)
    if not any(said.state for said in section.said):
        return not_judged('Race control sent nothing.', section)
    return passed(f'Nothing of the kind came for {took:.1f} s.', section)


# ----- the kinds of judges --------------------------------------------------------------------


def reaches(
    phase: str, limit: str, state: RaceState, *places: int, not_to: int | None = None
) -> Judge:
    """
    Judge whether a command reaches these karts within a limit.

    :param not_to: a kart that goes on in GREEN_GREEN.
    """
    judged = 'Time from the command to the last kart.'
    if not_to is not None:
        judged += ' Fail also: the other kart is sent another state.'

    @judge_of(phase, judged=judged, limit=limit)
    def find(trace: Trace, limits: RcsLimits, section: Section) -> Finding:
        if not_to is not None:
            name = kart(trace, not_to)
            for _, other in said_to(trace, section, name):
                if other is not GREEN_GREEN:
                    return failed(f'{other.value} was sent to {name}, too.', section)
        commands = section.of(Kind.COMMAND)
        if not commands:
            return NOT_DONE
        seconds: float = getattr(limits, limit)
        came: list[float] = []
        for place in places:
            said = _first(trace, section, place, state, commands[0].at)
            if said is None:
                if section.ended - section.began < seconds - EARLY:
                    return not_judged('The wait was cut short.', section)
                waited = section.ended - commands[0].at
                name = kart(trace, place) or 'a kart'
                return failed(f'No {state.value} to {name} in {waited:.1f} s.', section)
            came.append(said.at)
        # Repeated commands were refused; the last one before the first frame counts.
        command = [each for each in commands if each.at <= min(came)][-1]
        took = max(came) - (command.at if command.value else min(came))
        what = 'the command' if command.value else 'the first kart'
        told = failed if took > seconds else passed
        return told(f'{state.value} came {took:.3f} s after {what}.', section, measured=took)

    return find


def no_green(phase: str) -> Judge:
    """Judge whether no kart is sent GREEN_GREEN in a phase in which it is commanded."""

    @judge_of(phase, judged='Fail: a kart is sent GREEN_GREEN.')
    def find(trace: Trace, limits: RcsLimits, section: Section) -> Finding:
        if not section.of(Kind.COMMAND):
            return NOT_DONE
        for place, name in enumerate(names(trace)):
            if before(trace, section, name) is GREEN_GREEN:
                return not_judged('The race was in GREEN_GREEN before.', section)
            said = _first(trace, section, place, GREEN_GREEN)
            if said is not None:
                after = said.at - section.began
                return failed(f'GREEN_GREEN was sent to {name} after {after:.2f} s.', section)
        return _stayed(section, limits)

    return find


def unchanged(*phases: str) -> Judge:
    """Judge whether every kart is sent the same as before in these phases."""

    def one(trace: Trace, section: Section, limits: RcsLimits) -> Finding:
        for name in names(trace):
            state = before(trace, section, name)
            for _, said in said_to(trace, section, name):
                if said is not state:
                    was = state.value if state is not None else 'nothing'
                    return failed(f'{name} was sent {was}, then {said.value}.', section)
        return _stayed(section, limits)

    def find(trace: Trace, limits: RcsLimits) -> Finding:
        sections = [each for name in phases if (each := trace.called(name)) is not None]
        missing = [NOT_DONE] if len(sections) < len(phases) else []
        return worst([*missing, *(one(trace, each, limits) for each in sections)])

    return Judge(find, 'Fail: a kart is sent another state than before.', phases)


def is_sent_only(phase: str, allowed: Set[RaceState], *places: int, let_in: bool = False) -> Judge:
    """
    Judge what is sent on a new connection of a kart.

    :param let_in: it fails where nothing is sent at all.
    """
    states = ' or '.join(state.value for state in RaceState if state in allowed)

    @judge_of(phase, judged=f'Fail: the kart is sent anything but {states}.')
    def find(trace: Trace, limits: RcsLimits, section: Section) -> Finding:
        for place in places:
            name = kart(trace, place)
            links = [e.link for e in section.of(Kind.OPENED) if e.text == name]
            said = [w.state for w in section.said if w.link in links and w.state]
            if not said:
                waited = section.ended - section.began
                told = failed if let_in and waited >= limits.connect - EARLY else not_judged
                return told(f'{name or "A kart"} was sent nothing for {waited:.1f} s.', section)
            for state in said:
                if state not in allowed:
                    return failed(f'{state.value} was sent to {name}.', section)
        return passed('Only what was expected was sent.', section)

    return find


def stays_red(phase: str, place: int) -> Judge:
    """Judge whether a kart that is sent RED_RED is sent nothing else in a phase."""

    @judge_of(phase, judged='Fail: that kart is sent anything but RED_RED.')
    def find(trace: Trace, limits: RcsLimits, section: Section) -> Finding:
        if not section.of(Kind.COMMAND):
            return NOT_DONE
        name = kart(trace, place)
        if before(trace, section, name) is not RED_RED:
            return not_judged(f'{name or "The kart"} was not in RED_RED before.', section)
        for _, state in said_to(trace, section, name):
            if state is not RED_RED:
                return failed(f'{state.value} was sent to {name}.', section)
        return _stayed(section, limits)

    return find


# ----- judges of one clause -------------------------------------------------------------------


@judge_of('connect/first', judged='Time from the connection to the first frame.', limit='connect')
def connects(trace: Trace, limits: RcsLimits, section: Section) -> Finding:
    """Judge whether race control takes the connection of every kart."""
    longest = 0.0
    opened = section.of(Kind.OPENED)
    for event in opened:
        said = next((each for each in section.said if each.link == event.link), None)
        if said is None:
            return failed(f'Nothing was sent to {event.text}.', section)
        longest = max(longest, said.at - event.at)
    if len(opened) < len((ONE, TWO, OUT)):
        return failed('A connection was refused.', section)
    if longest > limits.connect:
        return failed(f'The first frame came after {longest:.2f} s.', section, measured=longest)
    return passed('Every kart was sent a frame.', section, measured=longest)


@judge_of('connect/stranger', judged='Fail: a byte comes, or the connection stays open (slack).')
def refuses_strangers(trace: Trace, limits: RcsLimits, section: Section) -> Finding:
    """Judge whether an address that is no kart's is sent nothing."""
    links = {e.link for e in section.of(Kind.OPENED) if e.text == STRANGER}
    if not links:
        return passed('The connection was refused.', section)
    if any(event.link in links for event in section.of(Kind.SAID)):
        return failed('A frame was sent to an unknown address.', section)
    if not any(event.link in links for event in section.of(Kind.CLOSED)):
        return failed(f'The connection stayed open for {limits.slack:g} s.', section)
    return passed('The connection was closed without a byte.', section)


@judge_of(
    'connect/second',
    judged='Fail: the first stays open (slack), or nothing is sent on the second.',
)
def replaces(trace: Trace, limits: RcsLimits, section: Section) -> Finding:
    """Judge whether a second connection takes the place of the first."""
    links = [event.link for event in section.of(Kind.OPENED)]
    if not links or not any(said.link == links[0] for said in section.said):
        return failed('Nothing was sent on the second connection.', section)
    if all(event.link == links[0] for event in section.of(Kind.CLOSED)):
        return failed(f'The first connection stayed open for {limits.slack:g} s.', section)
    return passed('The first connection was closed.', section)


@judge_of(
    'race/finish_one',
    'race/finish_two',
    judged='Fail: the two delays differ by less than stagger.',
    limit='stagger',
)
def staggers(trace: Trace, limits: RcsLimits, *sections: Section) -> Finding:
    """Judge whether two karts that finish are flagged after different times."""
    delays: list[float] = []
    for place, section in zip((ONE, TWO), sections, strict=True):
        said = _first(trace, section, place, RED_FLAG)
        given = [
            event
            for event in section.of(Kind.COMMAND, Kind.ANSWERED)
            if said is not None and event.at <= said.at
        ]
        if said is None or not given:
            return not_judged('A finished kart was not sent RED_FLAG.', section)
        # A person has pressed by the time of the answer; what comes before it is not timed.
        exact = [event for event in given if event.kind is Kind.COMMAND and event.value]
        answered = [event for event in given if event.kind is Kind.ANSWERED]
        if not exact and not answered:
            return not_judged('RED_FLAG came before the key.', section)
        delays.append(said.at - (exact or answered)[-1].at)
    difference = abs(delays[0] - delays[1])
    told = failed if difference < limits.stagger else passed
    why = f'The delays are {delays[0]:.2f} s and {delays[1]:.2f} s.'
    return told(why, *sections, measured=difference)


@judge_of(
    judged='Fail: it is sent another state; RED_RED counts as one unless ALL_KILL was commanded, '
    'or RED_RED for it alone.'
)
def keeps_in_garage(trace: Trace, limits: RcsLimits) -> Finding:
    """Judge whether a kart outside the race is sent IN_GARAGE, or RED_RED once it is stopped."""
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
        for said in section.said:
            killed = killed or any(at <= said.at for at in kills)
            if said.link not in links or said.state is None:
                continue
            seen = True
            stopped = stopped or said.state is RED_RED
            if said.state is IN_GARAGE:
                # Until RED_RED comes, this is what was sent before ALL_KILL.
                killed = killed and not (stopped and not kills)
            elif said.state is not RED_RED or not killed:
                return failed(f'{said.state.value} was sent to {name}.', section)
        killed = killed or bool(kills)
    if not seen:
        return NOT_DONE
    return passed('It was sent IN_GARAGE, and RED_RED once it was stopped.')


def _spans(trace: Trace) -> Iterator[list[Event]]:
    """Return the bytes of each connection of a kart while it was judged by time."""
    found: dict[int, list[Event]] = {}
    silent: set[int] = set()
    known = {link for link, name in owners(trace).items() if name != STRANGER}
    for event in trace.events:
        if event.kind is Kind.SILENT:
            silent.add(event.link)
        if event.kind is Kind.SAID and event.link not in silent and event.link in known:
            found.setdefault(event.link, []).append(event)
    return iter(found.values())


@judge_of(judged='Fail: fewer than 10 a second (2 % are allowed for).')
def sends_often(trace: Trace, limits: RcsLimits) -> Finding:
    """Judge whether enough frames come on each connection of 1 s or more."""
    held_up = [event for event in trace.events if event.kind is Kind.HELD_UP]
    rates: list[tuple[float, list[Event], list[Event]]] = []
    for events in _spans(trace):
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


@judge_of(judged='The longest gap.', limit='gap')
def leaves_no_gap(trace: Trace, limits: RcsLimits) -> Finding:
    """Judge the longest time between two frames of a connection."""
    pairs = [pair for events in _spans(trace) for pair in itertools.pairwise(events)]
    if not pairs:
        return NOT_DONE
    one, other = max(pairs, key=lambda pair: pair[1].at - pair[0].at)
    at, gap = one.at, other.at - one.at
    why = f'{gap:.3f} s on connection {one.link}, from {at:.3f} s on.'
    if gap > limits.gap:
        evidence = tuple(e for e in trace.events if at - 0.2 <= e.at <= at + gap + 0.2)
        return Finding(Verdict.FAIL, why, gap, evidence)
    return passed(why, measured=gap)


@judge_of(
    'vanish/lost',
    judged='Fail: after half_open, the connection is still there.',
    limit='half_open',
)
def notices(trace: Trace, limits: RcsLimits, section: Section) -> Finding:
    """Judge whether race control gives up the connection of a kart that has vanished."""
    gone = section.of(Kind.SILENT)
    if not gone or not [each for each in section.of(Kind.SENT) if each.link == gone[0].link]:
        return not_judged('The wait was cut short.', section)
    if not [event for event in section.of(Kind.CLOSED) if event.link == gone[0].link]:
        return failed(f'It still had the connection after {limits.half_open:g} s.', section)
    return passed(f'It had given the connection up within {limits.half_open:g} s.', section)
