# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The judge of the wire, which judges the frames to and from karts, and the answers to calls.

Principles of this module:

- The judge uses only race control's catalogue of commands, and none of its rules. It knows the
  frames that arrived, the frames that karts sent, when connections began and ended, and the calls
  of officials.
- It uses no clock, socket or ROS. Every input carries its time in seconds, by one monotonic clock.
  Inputs may come from any thread.
- It never raises a false alarm. Seen from outside, an event happens in an interval rather than at
  an instant: a call took effect between its beginning and its answer, and a frame was written
  between the last moment at which the socket was seen empty and the moment at which it was read. A
  rule counts as broken only if every order of events within those intervals breaks it.

Inputs wait in a heap until no earlier call is unanswered, and are then judged in the order of
time. A stop sets a *floor*, which is in force from the stop's answer on. A command that may loosen
the stop removes the floor from the beginning of its own call on. A frame therefore breaks a floor
only if it arrived after the stop's answer and was read before the loosening call began.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
import heapq
import itertools
import math
import threading

from evgp_node.entries import Entry
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind

STRICTNESS = {state.value: state.strictness for state in RaceState}
REDS = ('RED_FLAG', 'RED_RED')

MEMBERSHIP = (CommandKind.SET_HEAT, CommandKind.JOIN_RACE, CommandKind.LEAVE_RACE)
RELEASES = (CommandKind.IN_GARAGE, CommandKind.KART_IN_GARAGE)
EXPLAINS: dict[tuple[str, str], tuple[CommandKind, ...]] = {
    ('IN_GARAGE', 'GRID_ACTIVE'): (CommandKind.GRID_ACTIVE,),
    ('GRID_ACTIVE', 'GREEN_GREEN'): (CommandKind.GREEN_GREEN,),
    ('GRID_ACTIVE', 'IN_GARAGE'): (CommandKind.IN_GARAGE,),
    ('RED_FLAG', 'IN_GARAGE'): RELEASES,
    ('RED_RED', 'IN_GARAGE'): RELEASES,
}
"""Changes that loosen what a kart is sent, and the commands of which one must explain the change.
No other command may loosen anything."""

SETTLE = 0.5
"""Maximum delay of an input, and maximum time until a kart that reads has read a frame, in
seconds."""

MARGIN = 0.05
"""Maximum time that a written frame may be on its way, in seconds."""

NOTICE = 2.0
"""Maximum time until race control knows that a connection was closed, in seconds."""

KEPT = 4096
"""Maximum number of a kart's frames remembered per state and connection."""


@dataclass(frozen=True)
class Violation:
    """A broken rule: its name, the time in seconds, and a sentence that says what happened."""

    rule: str
    at: float
    text: str


@dataclass
class Call:
    """
    An official's call.

    :param statement: whether the official made the statement that the command asks for.
    :param ended: the time of the answer, in seconds; None until there is one.
    """

    command: CommandKind
    kart: int | None
    statement: bool
    began: float
    ended: float | None = None
    success: bool = False
    message: str = ''

    def __str__(self) -> str:
        """Return the command's name for officials, with its kart."""
        name = self.command.value
        return name if self.kart is None else f'{name} {self.kart}'


@dataclass
class _Floor:
    """A rule that no looser state than this may arrive from `since` on."""

    state: str
    since: float
    cause: str


@dataclass
class _Link:
    """A connection of a kart, as the kart sees it."""

    kart: int
    opened: float
    ended: float | None = None
    paused: float | None = None
    state: str | None = None
    run_began: float = 0.0
    former: deque[tuple[str, float, float]] = field(default_factory=lambda: deque(maxlen=8))
    said: dict[str, deque[tuple[float, float]]] = field(default_factory=dict)

    def may_have_acknowledged(self, state: str, judged: float, until: float) -> bool:
        """
        Return whether the kart may have acknowledged this state in time.

        :param judged: states sent from this time on may matter.
        :param until: reports sent until this time count.
        """
        began = [
            run_began
            for sent, run_began, ended in self.former
            if sent == state and ended >= judged - MARGIN
        ]
        if self.state == state:
            began.append(self.run_began)
        elif self.paused is not None:
            began.append(self.paused)
        began.append(until - SETTLE)  # what it is sent may not have been read yet
        since = min(began) - MARGIN
        return any(first >= since and last <= until for first, last in self.said.get(state, ()))


@dataclass
class _Kart:
    """
    The certain facts about a kart.

    :ivar member: whether the kart is in the race; None while that is uncertain.
    :ivar alone: whether it was held individually.
    :ivar lost: whether it was lost in a race under way.
    """

    number: int
    member: bool | None
    member_since: float
    links: list[int] = field(default_factory=list)
    hold: _Floor | None = None
    suspended: _Floor | None = None
    alone: bool = False
    lost: bool = False
    red: bool = False
    freed: float = 0.0
    in_garage: float = 0.0


class Judge:
    """
    Receives observations, in any order within ``SETTLE``, and collects the violations.

    :param in_race: the karts that are in the race at the start.
    :param others: the other karts in the roster.
    :param now: the time, in seconds.
    :raises LookupError: if nothing here judges a command that sends karts a state or brings them
        into the race, or if the catalogue does not say which red a stop brings.
    """

    def __init__(self, in_race: Iterable[int], others: Iterable[int], now: float) -> None:
        self._stops = {kind: _least_red(kind) for kind in CATALOGUE if CATALOGUE[kind].overtakes}
        matters = {kind for kind, entry in CATALOGUE.items() if entry.sends or _joins(entry)}
        unknown = matters - self._stops.keys() - SEEN.keys()
        if unknown:
            raise LookupError(f'what do karts see of {", ".join(each.value for each in unknown)}?')
        self.violations: list[Violation] = []
        self.judged: Counter[str] = Counter()
        self._karts = {number: _Kart(number, True, now) for number in in_race}
        self._karts |= {number: _Kart(number, False, now) for number in others}
        self._links: dict[int, _Link] = {}
        self._inputs: list[tuple[float, int, str, tuple[object, ...]]] = []
        self._order = itertools.count()
        self._unanswered: list[Call] = []
        self._accepted: dict[CommandKind, deque[Call]] = {}
        self._race_floor: _Floor | None = None
        self._under_way: float | None = None
        self._grid: Call | None = None
        self._judged_until = now
        self._lock = threading.Lock()

    # ----- inputs -------------------------------------------------------------------------

    def opened(self, link: int, kart: int, began: float) -> None:
        """Record a new connection. `began` is a time before it was requested."""
        self._put(began, 'opened', link, kart)

    def closed(self, link: int, earliest: float, seen: float) -> None:
        """Record that a connection ended, at `earliest` or later."""
        self._put(seen, 'closed', link, earliest)

    def paused(self, link: int, at: float) -> None:
        """Record that the kart stops reading, so from now on, what it is sent is unknown."""
        self._put(at, 'paused', link)

    def frame(self, link: int, state: str, after: float, read: float) -> None:
        """Record a frame that a kart read, and that arrived after `after`."""
        self._put(read, 'frame', link, state, after)

    def said(self, link: int, state: str, first: float, last: float) -> None:
        """Record a kart's frame. Its first byte was sent by `first`, its last one after `last`."""
        self._put(last, 'said', link, state, first)

    def stranger(self, address: str, data: bytes, at: float) -> None:
        """Record data sent to an address outside the roster."""
        self._put(at, 'stranger', address, data)

    def rubbish(self, kart: int, data: bytes, at: float) -> None:
        """Record bytes that were sent to a kart and are not a frame."""
        self._put(at, 'rubbish', kart, data)

    def called(self, call: Call) -> None:
        """Record the beginning of a call, before it is sent."""
        with self._lock:
            self._unanswered.append(call)

    def answered(self, call: Call) -> None:
        """Record the answer, which is in the call."""
        assert call.ended is not None
        self._put(call.began, 'call_began', call)
        self._put(call.ended, 'call_ended', call)
        with self._lock:
            self._unanswered.remove(call)

    def judge(self, now: float) -> None:
        """Judge everything that can be judged by now."""
        with self._lock:
            horizon = min([now - SETTLE, *(call.began for call in self._unanswered)])
            while self._inputs and self._inputs[0][0] < horizon:
                at, _, kind, arguments = heapq.heappop(self._inputs)
                self._judged_until = at
                self.judged[kind] += 1
                getattr(self, f'_{kind}')(at, *arguments)

    def finish(self) -> None:
        """Judge everything that is left. A stop without an answer is a violation."""
        with self._lock:
            unanswered, self._unanswered = self._unanswered, []
        for call in unanswered:
            if CATALOGUE[call.command].stop:
                self._violated('stop not answered', call.began, str(call))
            call.success, call.ended = True, math.inf  # it may take effect at any time
            self._put(call.began, 'call_began', call)
        self.judge(math.inf)

    def _put(self, at: float, kind: str, *arguments: object) -> None:
        with self._lock:
            heapq.heappush(self._inputs, (at, next(self._order), kind, arguments))

    # ----- connections --------------------------------------------------------------------

    def _opened(self, at: float, link: int, kart: int) -> None:
        self._links[link] = _Link(kart, at)
        self._karts[kart].links.append(link)

    def _closed(self, at: float, link: int, earliest: float) -> None:
        self._links[link].ended = earliest

    def _paused(self, at: float, link: int) -> None:
        # A link that has ended may be forgotten by now, and its pause no longer excuses anything.
        known = self._links.get(link)
        if known is not None and known.paused is None:
            known.paused = at

    def _said(self, at: float, link: int, state: str, first: float) -> None:
        said = self._links[link].said.setdefault(state, deque(maxlen=KEPT))
        said.append((first, at))

    def _stranger(self, at: float, address: str, data: bytes) -> None:
        self._violated('stranger', at, f'{address} is not in the roster and was sent {data!r}')

    def _rubbish(self, at: float, kart: int, data: bytes) -> None:
        self._violated('rubbish', at, f'kart {kart} was sent {data!r}')

    # ----- frames -------------------------------------------------------------------------

    def _frame(self, at: float, number: int, state: str, after: float) -> None:
        link = self._links[number]
        kart = self._karts[link.kart]
        arrived = after - MARGIN
        floors = [kart.hold]
        if kart.member is True and kart.member_since < arrived:
            floors.append(self._race_floor)
        for floor in floors:
            if floor and floor.since < arrived and STRICTNESS[state] < STRICTNESS[floor.state]:
                self._violated(
                    'looser than a stop',
                    at,
                    f'kart {kart.number} is sent {state} after {floor.cause}',
                )
        if (
            kart.member is False
            and kart.member_since < arrived
            and state in ('GRID_ACTIVE', 'GREEN_GREEN')
        ):
            self._violated('outside the race', at, f'kart {kart.number} is sent {state}')
        if link.state is None:
            self._first_frame(at, number, link, kart, state)
        elif state != link.state:
            self._change(at, link, kart, state)
        if state != link.state:
            if link.state is not None:
                link.former.append((link.state, link.run_began, at))
            link.state = state
            link.run_began = arrived
        link.paused = None
        if state in REDS:
            kart.red = kart.red or arrived > max(kart.freed, kart.in_garage)
        elif state == 'IN_GARAGE':
            kart.red = False
            kart.in_garage = at

    def _change(self, at: float, link: _Link, kart: _Kart, state: str) -> None:
        """Judge a change on one connection. If it loosens, a command must explain it."""
        assert link.state is not None
        change = f'kart {kart.number}: {link.state}, then {state}'
        if state in REDS and STRICTNESS[state] > STRICTNESS[link.state]:
            return
        commands = EXPLAINS.get((link.state, state))
        if commands is None:
            rule = 'unexplained GREEN_GREEN' if state == 'GREEN_GREEN' else 'impossible change'
            self._violated(rule, at, change)
            return
        explaining = [
            call
            for command in commands
            for call in self._accepted.get(command, ())
            if call.kart in (None, kart.number)
            and call.ended is not None
            and call.began <= at
            and call.ended >= link.run_began
        ]
        if not explaining:
            rule = 'unexplained GREEN_GREEN' if state == 'GREEN_GREEN' else 'unexplained change'
            names = ' or '.join(command.value for command in commands)
            self._violated(rule, at, f'{change}, and no {names} was accepted')
            return
        if state == 'GREEN_GREEN':
            if kart.red:
                self._violated('red, then green', at, f'{change}, without an IN_GARAGE since red')
            if not any(
                link.may_have_acknowledged('GRID_ACTIVE', at, call.ended or 0.0)
                for call in explaining
            ):
                self._violated(
                    'not acknowledged', at, f'{change}, and it never said GRID_ACTIVE in between'
                )

    def _first_frame(self, at: float, number: int, link: _Link, kart: _Kart, state: str) -> None:
        """Judge the first state sent on a connection (§3.E)."""
        if state == 'GREEN_GREEN':
            self._violated(
                'unexplained GREEN_GREEN', at, f'kart {kart.number} is sent it as it connects'
            )
        if state == 'GRID_ACTIVE' and kart.red:
            self._violated(
                'red, then green',
                at,
                f'kart {kart.number} connects into GRID_ACTIVE, without an IN_GARAGE since red',
            )
        lost = self._lost_at(kart, number)
        if lost is not None and self._was_lost_under_way(kart, lost):
            if state != 'RED_RED':
                self._violated(
                    'lost in the race',
                    at,
                    f'kart {kart.number} dropped in a race under way and comes back to {state}',
                )
            kart.lost = True
            self._hold(kart, 'RED_RED', at, 'it was lost in a race under way')

    def _lost_at(self, kart: _Kart, present: int | None) -> float | None:
        """Return the earliest time at which it was lost before this connection; None if never."""
        times: list[float] = []
        for number in reversed(kart.links):
            link = self._links[number]
            if link.ended is not None:
                times.append(link.ended)
            if link.paused is not None:
                times.append(link.paused)
            if number != present and link.state is not None:
                return min(times, default=None)
            # If an earlier connection had not ended on its own, this one replaced it.
            times = [link.opened]
        return None

    def _was_lost_under_way(self, kart: _Kart, lost: float) -> bool:
        return (
            self._under_way is not None
            and kart.member is True
            and max(self._under_way, kart.member_since, kart.freed) < lost - SETTLE
        )

    # ----- calls --------------------------------------------------------------------------

    def _call_began(self, at: float, call: Call) -> None:
        """Note that the call may take effect from now on, so what it loosens is uncertain."""
        if not call.success:
            return
        self._accepted.setdefault(call.command, deque(maxlen=500)).append(call)
        if call.command is CommandKind.IN_GARAGE:
            for kart in self._karts.values():
                self._settle_loss(kart, at)
                if kart.hold is not None:
                    kart.suspended, kart.hold = kart.hold, None
                kart.red = False
                kart.freed = at
            self._race_floor = None
            self._under_way = None
        elif call.command is CommandKind.KART_IN_GARAGE:
            kart = self._karts[self._number(call)]
            kart.hold = kart.suspended = None
            kart.red = kart.alone = kart.lost = False
            kart.freed = at
            if 'out of the race' in call.message:
                kart.member = None
        elif call.command in MEMBERSHIP:
            for kart in self._karts.values():
                if call.kart in (None, kart.number):
                    kart.member = None

    def _call_ended(self, at: float, call: Call) -> None:
        """Note that the call has certainly taken effect by now."""
        if CATALOGUE[call.command].stop and not call.success:
            self._violated('stop refused', at, f'{call}: {call.message}')
        if not call.success:
            return
        if call.command in self._stops:
            self._stopped(at, call)
        elif call.command in SEEN:
            SEEN[call.command](self, at, call)

    def _stopped(self, at: float, call: Call) -> None:
        """Record a stop with the karts and the loosest red that the catalogue defines for it."""
        entry = CATALOGUE[call.command]
        state = self._stops[call.command]
        if not entry.to_one_kart:
            self._race_red(at, call, state)
        if entry.to_one_kart or (entry.stop and state == 'RED_RED'):
            for kart in self._karts.values():
                if call.kart in (None, kart.number):
                    self._tighten(kart, at, call, state)

    def _accepted_grid_active(self, at: float, call: Call) -> None:
        self._grid = call
        if not call.statement:
            self._violated('not stated', at, f'{call} without "the track is clear"')
        if self._under_way is not None and self._under_way < call.began:
            self._violated('not from the garage', at, f'{call} while a race is under way')
        for kart in self._karts.values():
            if (
                kart.hold is not None
                and kart.hold.since < call.began
                and kart.member is True
                and kart.member_since < call.began
            ):
                self._violated(
                    'held on the grid', at, f'{call} with kart {kart.number}: {kart.hold.cause}'
                )

    def _accepted_green_green(self, at: float, call: Call) -> None:
        if not self._overlapped(call, (CommandKind.GRID_ACTIVE,)) and (
            self._grid is None or self._commanded_between(self._grid, call)
        ):
            self._violated(
                'GRID_ACTIVE not last', at, f'{call}: another command came after GRID_ACTIVE'
            )
        if all(
            kart.member is False and kart.member_since < call.began
            for kart in self._karts.values()
        ):
            self._violated('nobody in the race', at, str(call))
        for kart in self._karts.values():
            if kart.member is not True or kart.member_since > call.began:
                continue
            candidates = [link for link in self._there(kart, call) if link.opened <= at]
            if not candidates:
                self._violated(
                    'not connected', at, f'{call} while kart {kart.number} is not connected'
                )
            elif not any(
                link.may_have_acknowledged('GRID_ACTIVE', call.began, at) for link in candidates
            ):
                self._violated(
                    'not acknowledged',
                    at,
                    f'{call}, and kart {kart.number} has not said GRID_ACTIVE since it was sent',
                )
        if not self._overlapped(call, (CommandKind.IN_GARAGE,)):
            self._under_way = at

    def _accepted_in_garage(self, at: float, call: Call) -> None:
        if not call.statement:
            self._violated('not stated', at, f'{call} without "the track is safe"')
        for kart in self._karts.values():
            floor, kart.suspended = kart.suspended, None
            if kart.hold is not None or (floor is not None and floor.since > call.began):
                continue
            if floor is None or self._may_stand(kart, call, at) or self._may_be_away(kart):
                kart.alone = kart.lost = False
            else:
                # The kart is lost or silent, so it stays held until it is released individually.
                kart.hold = _Floor(floor.state, at, f'{floor.cause}, which it never acknowledged')
        for kart in self._karts.values():
            for number in kart.links[:-1]:
                if self._links[number].ended is not None:
                    self._forget(kart, number)

    def _accepted_kart_in_garage(self, at: float, call: Call) -> None:
        kart = self._karts[self._number(call)]
        if kart.member is None:
            kart.member = False
            kart.member_since = at
        if not call.statement and not self._may_stand(kart, call, at):
            self._violated(
                'not stated', at, f'{call}, neither acknowledged nor "made safe by hand"'
            )

    def _accepted_membership(self, at: float, call: Call) -> None:
        kart = self._karts[self._number(call)]
        kart.member = call.command is CommandKind.JOIN_RACE
        kart.member_since = at
        if kart.member and self._under_way is not None and self._under_way < call.began:
            self._violated('not from the garage', at, f'{call} joins a race under way')

    # ----- what calls have in common ------------------------------------------------------

    def _there(self, kart: _Kart, call: Call) -> list[_Link]:
        """Return the connections that race control may have considered open at a call."""
        links = (self._links[number] for number in kart.links)
        return [link for link in links if link.ended is None or link.ended > call.began - NOTICE]

    def _may_stand(self, kart: _Kart, call: Call, at: float) -> bool:
        """Return whether a kart may have acknowledged a red on an existing connection."""
        return any(
            link.may_have_acknowledged(state, call.began, at)
            for link in self._there(kart, call)
            for state in REDS
        )

    def _may_be_away(self, kart: _Kart) -> bool:
        """Return whether a kart is gone and may have been at rest when it left."""
        links = [self._links[number] for number in kart.links]
        if kart.alone or any(link.ended is None for link in links):
            return False
        return not kart.lost or any(
            link.may_have_acknowledged(state, link.opened, link.ended or 0.0)
            for link in links[-1:]
            for state in REDS
        )

    def _race_red(self, at: float, call: Call, state: str) -> None:
        if self._overlapped(call, (CommandKind.IN_GARAGE,)):
            return
        if self._under_way is None:
            self._under_way = at
        if self._race_floor is None or STRICTNESS[self._race_floor.state] < STRICTNESS[state]:
            self._race_floor = _Floor(state, at, str(call))

    def _tighten(self, kart: _Kart, at: float, call: Call, state: str) -> None:
        if not self._overlapped(call, RELEASES, kart.number):
            kart.alone = kart.alone or CATALOGUE[call.command].to_one_kart
            self._hold(kart, state, at, str(call))

    def _hold(self, kart: _Kart, state: str, at: float, cause: str) -> None:
        if kart.hold is None or STRICTNESS[kart.hold.state] < STRICTNESS[state]:
            kart.hold = _Floor(state, at, cause)

    def _settle_loss(self, kart: _Kart, at: float) -> None:
        """Hold a certainly lost kart before a command that releases others."""
        if any(self._links[number].ended is None for number in kart.links):
            return
        lost = self._lost_at(kart, None)
        if lost is not None and lost + NOTICE < at and self._was_lost_under_way(kart, lost):
            kart.lost = True
            self._hold(kart, 'RED_RED', lost + NOTICE, 'it was lost in a race under way')

    def _overlapped(
        self, call: Call, commands: tuple[CommandKind, ...], kart: int | None = None
    ) -> bool:
        """Return whether such a call, even if it began earlier, may have come after this one."""
        return any(
            (other.ended or 0.0) > call.began
            for command in commands
            for other in self._accepted.get(command, ())
            if other is not call and other.kart in (None, kart)
        )

    def _commanded_between(self, first: Call, second: Call) -> bool:
        """Return whether a command to karts certainly came between these two calls."""
        return any(
            other.began > (first.ended or 0.0) and (other.ended or 0.0) <= second.began
            for command, calls in self._accepted.items()
            if not CATALOGUE[command].bookkeeping and command is not CommandKind.GRID_ACTIVE
            for other in calls
            if other is not second
        )

    def _forget(self, kart: _Kart, number: int) -> None:
        link = self._links[number]
        if link.ended is not None and link.ended < self._judged_until - 10 * NOTICE:
            kart.links.remove(number)
            del self._links[number]

    def _number(self, call: Call) -> int:
        assert call.kart is not None
        return call.kart

    def _violated(self, rule: str, at: float, text: str) -> None:
        self.violations.append(Violation(rule, at, text))


SEEN: dict[CommandKind, Callable[[Judge, float, Call], None]] = {
    CommandKind.GRID_ACTIVE: Judge._accepted_grid_active,
    CommandKind.GREEN_GREEN: Judge._accepted_green_green,
    CommandKind.IN_GARAGE: Judge._accepted_in_garage,
    CommandKind.KART_IN_GARAGE: Judge._accepted_kart_in_garage,
    CommandKind.JOIN_RACE: Judge._accepted_membership,
    CommandKind.LEAVE_RACE: Judge._accepted_membership,
}
"""
The function that judges each accepted command that is not a stop. By the catalogue, any other
command sends nothing to karts at once, or the judge cannot know to which.
"""


def _joins(entry: Entry) -> bool:
    return entry.result.in_race is not None


def _least_red(stop: CommandKind) -> str:
    """Return the loosest red in force after a stop, by the catalogue."""
    result = CATALOGUE[stop].result
    after = [state.value for state in (*result.race, *result.hold) if state is not None]
    if not after or not {*after} <= {*REDS}:
        raise LookupError(f'the catalogue does not say which red {stop.value} brings')
    return min(after, key=STRICTNESS.__getitem__)
