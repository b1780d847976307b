# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What karts and officials saw of race control, held against its record.

The record has what race control decided, and a replay shows that its rules decide so. This module
looks at what lies between them and the world: whether each kart was sent what was decided, in
order, in time, and nothing else; whether each report that counts was sent after the order that it
answers; whether each lost connection was noticed; and whether each call was judged as it was made,
and got the answer of the rules. Whether the rules are right is another question.
"""

from __future__ import annotations

import bisect
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
import math
import time
from typing import TYPE_CHECKING

from evgp_protocol import clock
from evgp_protocol.states import RaceState
from evgp_rcs.record.replay import Replay
from evgp_rcs.rules import inputs
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import Answer, Command, EventKind, StampedEvent

if TYPE_CHECKING:
    from evgp_testing.wire_kart import KartLink

LATE = 1.0
"""Maximum time until a kart that reads is sent what was decided, in seconds."""

NOTICE = 2.0
"""Maximum time until race control knows that a kart has closed its connection, in seconds."""

TOLERANCE = 0.01
"""Maximum error when a time of one clock is converted to the other, in seconds."""


@dataclass
class Call:
    """
    An official's call of a command, with times in seconds by the monotonic clock.

    :ivar kart: 0 if the command is not to one kart.
    :ivar statement: whether the official made the statement that the command asks for.
    :ivar ended: the time of the answer; infinite until there is one.
    """

    official: str
    command: CommandKind
    kart: int
    statement: bool
    began: float
    ended: float = math.inf
    success: bool = False

    def __str__(self) -> str:
        """Return who called what, and with which answer."""
        of = f' of kart {self.kart}' if self.kart else ''
        answer = 'without an answer' if self.ended == math.inf else f'success {self.success}'
        return f'{self.command.value}{of} by {self.official}, {answer}'


@dataclass
class _Connection:
    """
    A connection in the record, with times in seconds by the monotonic clock.

    :ivar states: what was ordered on it, each state once, with its time.
    :ivar ordered: the time of each order, by its serial.
    :ivar counted: the reports that counted, each with the time of its order and its own time.
    """

    opened: float
    ended: float = math.inf
    states: list[tuple[float, RaceState]] = field(default_factory=list)
    ordered: dict[int, float] = field(default_factory=dict)
    counted: list[tuple[RaceState, float, float]] = field(default_factory=list)

    def order(self, at: float, state: RaceState, serial: int = 0) -> None:
        """Note an order; without a serial, no report answers it."""
        if serial:
            self.ordered[serial] = at
        if not self.states or self.states[-1][1] is not state:
            self.states.append((at, state))


@dataclass
class _Judged:
    """A command in the record."""

    at: float
    command: Command
    answer: Answer | None


class Witness:
    """
    Collects what was seen. Each of its lists may be appended to from any thread.

    :ivar links: every connection of the karts that were watched.
    :ivar calls: every call of the officials who were watched.
    :ivar strangers: what was sent to addresses outside the roster, in words.
    """

    def __init__(self) -> None:
        self.links: list[KartLink] = []
        self.calls: list[Call] = []
        self.strangers: list[str] = []

    @property
    def frames(self) -> int:
        """Return the number of frames that the karts were sent so far."""
        return sum(link.frames for link in self.links)

    def compare(self, replay: Replay) -> list[str]:
        """Return everything in which what was seen differs from the record, in words."""
        connections, commands, ends = _recorded(replay)
        found = [f'in the replay, {replay.lacks}'] if replay.lacks else []
        found += self.strangers
        for link in self.links:
            found += [f'kart {link.kart} was sent {each!r}' for each in link.malformed]
            if not link.frames and link.closed_at > link.opened + LATE + NOTICE:
                found.append(f'kart {link.kart} was sent nothing')
        for kart in sorted({link.kart for link in self.links}):
            links = [link for link in self.links if link.kart == kart]
            found += _compare_links(kart, links, connections[kart], ends)
        for official in sorted({call.official for call in self.calls}):
            calls = [call for call in self.calls if call.official == official]
            found += _compare_calls(calls, [e for e in commands if e.command.official == official])
        return found


def _recorded(replay: Replay) -> tuple[dict[int, list[_Connection]], list[_Judged], float]:
    """Return the connections of each kart, the commands, and the time of the last input."""
    ahead = clock.now() - time.monotonic()
    connections: dict[int, list[_Connection]] = defaultdict(list)
    present: dict[int, _Connection] = {}
    commands: list[_Judged] = []
    at = -math.inf
    for step in replay.steps():
        entry, outcome = step.entry, step.outcome
        if isinstance(entry, StampedEvent) and entry.event.kind is EventKind.ENDED:
            for connection in present.values():
                connection.order(entry.monotonic - ahead, RaceState.RED_RED)
        if outcome is None:
            continue
        assert isinstance(entry, inputs.Input)
        at = entry.at - ahead
        if isinstance(entry, inputs.Connected | inputs.Disconnected) and entry.kart in present:
            present.pop(entry.kart).ended = at
        if isinstance(entry, inputs.Connected):
            present[entry.kart] = _Connection(at)
            connections[entry.kart].append(present[entry.kart])
        elif isinstance(entry, inputs.Heard) and entry.serial in present[entry.kart].ordered:
            ordered = present[entry.kart].ordered[entry.serial]
            present[entry.kart].counted.append((entry.state, ordered, at))
        elif isinstance(entry, inputs.Commanded):
            commands.append(_Judged(at, entry.command, outcome.answer))
        for order in outcome.orders:
            if order.kart in present:
                present[order.kart].order(at, order.state, order.serial)
    return connections, commands, at


def _compare_links(
    kart: int, links: list[KartLink], connections: list[_Connection], ends: float
) -> Iterator[str]:
    """
    Yield what is wrong with the connections of a kart.

    Race control refuses some, so that only their order is known: each one on which the kart was
    sent anything must be in the record, after those of earlier ones.
    """
    after = 0  # the place in the record from which the next one may be
    for link in sorted((link for link in links if link.frames), key=lambda link: link.opened):
        wrong = []
        for place, connection in enumerate(connections[after:], start=after):
            if link.opened - TOLERANCE <= connection.opened <= link.times[0] + TOLERANCE:
                reason = _difference(link, connection, ends)
                if not reason:
                    after = place + 1
                    break
                wrong.append(reason)
        else:
            yield f'kart {kart}: {" or ".join(wrong) or "a connection is not in the record"}'


def _difference(link: KartLink, connection: _Connection, ends: float) -> str:
    """Return how what a kart saw differs from a connection in the record; empty if it fits."""
    for (read, state), (ordered, recorded) in zip(link.changes, connection.states, strict=False):
        if state is not recorded:
            return f'it was sent {state.value} instead of {recorded.value}'
        if read < ordered - TOLERANCE:
            return f'it was sent {state.value} before that was decided'
    seen = len(link.changes)
    if seen > len(connection.states):
        return f'it was sent {link.changes[-1][1].value}, which nobody had decided'
    changed = [at for at, _ in link.changes[1:]] + [math.inf]
    for (ordered, state), change in zip(connection.states[1:], changed, strict=False):
        before = bisect.bisect_left(link.times, change)
        if before and link.times[before - 1] > ordered + LATE:
            return f'it was not sent {state.value} within {LATE:g} s'
    said = link.said
    for state, ordered, heard in connection.counted:
        if not any(
            each is state and before <= heard + TOLERANCE and after >= ordered - TOLERANCE
            for each, before, after in said
        ):
            return f'its {state.value} counted, which it had said before the order or never'
    if min(connection.ended, ends) > link.closed_at + NOTICE:
        return f'its end was not noticed within {NOTICE:g} s'
    return ''


def _compare_calls(calls: list[Call], commands: list[_Judged]) -> Iterator[str]:
    """Yield what is wrong with the calls of one official, who makes one after the other."""
    judged = iter(commands)
    for call in calls:
        each = next(judged, None)
        if each is None:
            yield f'{call}: it is not in the record'
            return
        command, answer = each.command, each.answer
        recorded = command.kind, command.kart, command.statement, answer and answer.success
        if recorded != (call.command, call.kart, call.statement, call.success):
            yield f'{call}: the record has {recorded}'
            return
        if not call.began - TOLERANCE <= each.at <= call.ended + TOLERANCE:
            yield f'{call}: it was judged before the call or after the answer'
    for each in judged:
        yield f'nobody called {each.command.kind.value}, which is in the record'
