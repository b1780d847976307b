# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The debrief of an incident: what happened, what officials pressed, and what the karts then did.

It uses the events of the record, the officials' corrections of the results, and the truth, which
is what really happened to the simulated karts. It compares these facts with what the rule book
orders, but grades nobody. This module is
pure.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
import dataclasses
from dataclasses import dataclass
import itertools
from typing import NamedTuple

from evgp_node.results import Act, Corrected
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.race import EventKind, StampedEvent
from evgp_rcs.words import numbered
from evgp_rehearsal.field import LINE, TICK_LENGTH, Truth
from evgp_rehearsal.incidents import INCIDENTS
from evgp_timing.corrections import CORRECTIONS


@dataclass(frozen=True)
class Occurrence:
    """
    An incident that took place.

    :param kart: the kart concerned, or 0.
    :param began: the first tick that its debrief covers.
    :param ended: the last tick that its debrief covers.
    """

    incident: str
    kart: int
    began: int
    ended: int


class _Line(NamedTuple):
    """A line of the debrief. It has an event kind if several karts may share the line."""

    at: float
    text: str
    kart: int = 0
    kind: EventKind | None = None


def debrief(
    took: Occurrence,
    events: Sequence[StampedEvent],
    truth: Truth,
    corrections: Iterable[Corrected] = (),
) -> list[str]:
    """
    Return the debrief of an incident, line by line, with times since the incident's start.

    :param events: the events of the record, in order, with the field's times, in seconds.
    :param corrections: the corrections in the timekeeper's book, with the field's times.
    """
    row = INCIDENTS[took.incident]
    began, ended = took.began * TICK_LENGTH, took.ended * TICK_LENGTH
    kart = f' (kart {took.kart})' if took.kart else ''
    during = [each for each in events if began <= each.monotonic <= ended]
    # Before the incident, everything was repaired, so an earlier use of the MSR stops nothing.
    truth = dataclasses.replace(truth, msr=[at for at in truth.msr if at >= took.began])
    beside = [*_seen(truth), *(_asked(each, truth) for each in corrections)]
    seen = [line for line in beside if began <= line.at <= ended]
    lines = sorted([*seen, *_told(during, truth)], key=lambda line: line.at)
    return [
        f'{took.incident}{kart}: {row.meaning}',
        f'  began at {began:.1f} s of the rehearsal and lasted {ended - began:.1f} s',
        *(f'  {line.at - began:6.1f} s  {line.text}' for line in _folded(lines)),
        *(f'  {text}' for text in _motion(events, truth, began, ended)),
        f'  the rule book: {row.order}',
    ]


def _told(events: Sequence[StampedEvent], truth: Truth) -> Iterator[_Line]:
    """Yield lines about commands, connections, alerts and race control itself, from the record."""
    for stamped in events:
        at, event = stamped.monotonic, stamped.event
        if event.kind is EventKind.COMMAND:
            assert event.command is not None
            name, command = event.official or 'someone', event.command.value
            text = event.text.rstrip('.')
            if not event.success:
                text = text.removeprefix(f'{command} ')
            remarks = ''.join(f' - {each}' for each in _remarks(stamped, truth))
            yield _Line(at, f'{name} sent {command}: {text}{remarks}')
        elif event.kind in (EventKind.CONNECTED, EventKind.DISCONNECTED):
            word = 'connected' if event.kind is EventKind.CONNECTED else 'connection lost'
            yield _Line(at, word, event.kart, event.kind)
        elif event.kind is EventKind.ALERT_RAISED:
            yield _Line(at, f'alert: {event.text}')
        elif event.kind is EventKind.RACE_STATE and event.command is None:
            yield _Line(at, event.text)


def _asked(given: Corrected, truth: Truth) -> _Line:
    """Return the line of an official's correction, with whether the kart really crossed."""
    asked, remark = given.correction, ''
    about = f' for kart {asked.kart}' if asked.kart else ''
    if asked.act in (Act.STRIKE, Act.RESTORE):
        about = f' for {asked.passing}'
        for number, each in enumerate(truth.crossings, 1):
            if f'{LINE} {number}' == str(asked.passing):
                word = 'crossed' if each.real else 'did not cross'
                remark = f' - kart {each.kart} {word} the line there'
    name = asked.official or 'someone'
    text = f'{name} sent the timekeeper {CORRECTIONS[asked.act].label}{about}{remark}'
    return _Line(given.at, text)


def _seen(truth: Truth) -> Iterator[_Line]:
    """Yield the lines about what race control cannot know."""
    for tick, there in truth.people:
        yield _Line(tick * TICK_LENGTH, f'a person is {"on" if there else "off"} the track')
    for tick in truth.msr:
        yield _Line(tick * TICK_LENGTH, 'the MSR is used')
    for tick, text in truth.messages:
        yield _Line(tick * TICK_LENGTH, f'radio: {text}')
    for tick, kart in truth.crossed:
        yield _Line(tick * TICK_LENGTH, f'kart {kart} completes its last lap')


def _remarks(stamped: StampedEvent, truth: Truth) -> Iterator[str]:
    """Yield what officials should know about the field at the time of an accepted command."""
    at, event = stamped.monotonic, stamped.event
    if event.command is None or not event.success:
        return
    starts = event.command in (CommandKind.GRID_ACTIVE, CommandKind.GREEN_GREEN)
    if starts and truth.has_person(at):  # §3.A
        yield 'WITH A PERSON ON THE TRACK'
    movers = [kart for kart in truth.movers(at) if event.kart in (0, kart)]
    if CATALOGUE[event.command].loosens and movers:
        yield f'WHILE {numbered(movers).upper()} MOVED'
    used = any(tick * TICK_LENGTH <= at for tick in truth.msr)
    if event.command is CommandKind.RECORD_MSR and not used:
        yield 'the MSR had not been used yet'


def _folded(lines: Iterable[_Line]) -> Iterator[_Line]:
    """Yield the lines, joining those of karts to which the same thing happened within 1 s."""
    group: list[_Line] = []
    for line in (*lines, None):
        first = group[0] if group else None
        same = first and line and line.kind is not None and line.kind is first.kind
        if first and line and same and line.at - first.at <= 1.0:
            group.append(line)
            continue
        if first:
            who = numbered(sorted({each.kart for each in group}))
            yield first._replace(text=f'{who}: {first.text}') if first.kind else first
        group = [line] if line else []


def _motion(
    events: Sequence[StampedEvent], truth: Truth, began: float, ended: float
) -> Iterator[str]:
    """Yield for each order to stop which karts moved after it, and for how long."""
    karts = sorted({kart for _, kart, _ in truth.moving})
    found: list[tuple[float, str, str]] = []
    for kart in karts:
        orders: list[tuple[float, str]] = []
        for stamped in events:
            event = stamped.event
            if event.kart != kart:
                continue
            if event.kind is EventKind.DISCONNECTED:
                orders.append((stamped.monotonic, 'the loss of its connection'))  # §3.E
            elif event.kind is EventKind.KART_STATE and event.state is not None:
                goes = event.state is RaceState.GREEN_GREEN
                orders.append((stamped.monotonic, '' if goes else event.state.value))
        for (at, order), (until, _) in itertools.pairwise([*orders, (ended, '')]):
            start, end = max(at, began), min(until, ended)
            moved, still = truth.moved(kart, start, end) if order and start < end else (0.0, False)
            if moved:
                still = still and end == ended
                how = f'kart {kart} for {moved:.1f} s{" and is still moving" if still else ""}'
                found.append((round(at - began, 1), order, how))
    found.sort(key=lambda each: each[:2])
    for (at, order), each in itertools.groupby(found, key=lambda one: one[:2]):
        yield f'moved after {order} at {at:.1f} s: {", ".join(how for _, _, how in each)}'
