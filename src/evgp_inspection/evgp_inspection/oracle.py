# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The oracle judges how a kart moves and what it replies, at each moment of a trace.

It is pure: events go in, and findings come out, while the trace is written or later. The states
that were sent, with their times and connections, divide the trace into spells. In one kind of
spell the kart may drive; in every other kind it must stand still, or brake and then stand still.
The oracle judges every speed, every reply and every answer from the inspector by the spell in
which it arrives. Each finding names a sentence of `evgp_inspection.kart_sentences`. Three rules
apply:

1. A kart fails only for something in the trace. What was not seen is not judged.
2. What was not seen is not passed either: a kart that reports nothing wrong may still drive.
3. Only the first breach of a spell counts. Later ones in the same spell are the same fault.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
import dataclasses
import enum
import itertools
import math
import statistics

from evgp_inspection.limits import Limits
from evgp_inspection.traces import Event, Kind, Said, SentState, Trace
from evgp_inspection.verdicts import EARLY, Finding, Verdict
from evgp_protocol.hearing import FLOOD_BYTES
from evgp_protocol.states import RaceState

IN_GARAGE, GRID_ACTIVE = RaceState.IN_GARAGE, RaceState.GRID_ACTIVE
GREEN_GREEN = RaceState.GREEN_GREEN
RED_FLAG, RED_RED = RaceState.RED_FLAG, RaceState.RED_RED

VARIES = 0.15
"""Maximum growth of odometry's delay since the beginning of the same stop, in seconds."""

GENTLY = 0.1
"""Fraction of a RED_FLAG stop's duration by which the kart may begin to brake late, because it may
brake gently."""

ROLLING = 0.1
"""Fraction of its top speed above which a kart rolls, however it measures its standstill."""

WEAK = 0.6
"""Fraction of the deceleration in RED_RED stops below which a stop is too weak for RED_RED."""

COMPARED = 0.5
"""Fraction of the speed of the fastest RED_RED stop above which other stops are compared with
RED_RED stops."""

FASTER = 1.02
"""Factor by which the speed of a kart that must brake has to grow to count as getting faster."""

REGAINED = 0.2
"""Fraction of its top speed by which a kart that brakes has to get faster again to count as
getting faster, because odometry is not smooth."""

FAST = 10
"""Multiple of the standstill speed from which on a deceleration can be measured."""

SOONER = 0.95
"""Fraction of the time until the RED_FLAG report within which an unseen kart must report
RED_RED."""

MOST_BYTES_A_SECOND = 12 * FLOOD_BYTES
"""Maximum number of bytes per second that is not a flood."""

AROUND = 2.0
"""Time before and after a breach that the evidence for it covers, in seconds."""

STANDS, TURNS = 'the wheels stand still', 'the wheels turn'
"""The two questions to the inspector, as the trace names them."""

# ----- the sentences' names -------------------------------------------------------------------

STAYS = {
    IN_GARAGE: 'K-3A-01',
    GRID_ACTIVE: 'K-3A-03',
    RED_FLAG: 'K-3A-08',
    RED_RED: 'K-3A-15',
}
"""Clauses that a kart breaks if its wheels turn again in a state, by that state."""

BRAKES = {RED_FLAG: 'K-3A-16', RED_RED: 'K-3A-14'}
"""Clauses that a driving kart breaks by beginning to brake too late, or stopping too late."""

ACKNOWLEDGES = {
    GRID_ACTIVE: ('K-3A-02', 'grid'),
    GREEN_GREEN: ('K-3A-04', 'green'),
    RED_FLAG: ('K-3A-06', 'red_flag'),
    RED_RED: ('K-3A-09', 'red_red'),
}
"""Clauses that a kart breaks by not acknowledging a state in time, and the names of the limits."""

LOSSES = {
    'closed': 'K-3C-01',
    'silent': 'K-3E-01',
    'reset': 'K-3E-03',
    'half-closed': 'K-3E-04',
    'away': 'K-3E-06',
    'malformed': 'K-3E-07',
    'bridge': 'K-3E-09',
    'stack': 'K-3E-10',
}
"""Clauses that a kart breaks if its wheels turn after a loss, by the kind of loss."""

UNARMED = {
    IN_GARAGE: 'K-3B-01',
    RED_RED: 'K-3B-02',
    GRID_ACTIVE: 'K-3B-03',
    RED_FLAG: 'K-3B-04',
    'silent': 'K-3E-02',
    'malformed': 'K-3E-02',
    'away': 'K-3E-06',
    'bridge': 'K-3E-09',
}
"""Clauses that a kart breaks by obeying GREEN_GREEN after one of these. After any other loss, it
breaks `K-3E-05`."""

BACK = {
    'closed': 'K-4D-01',
    'reset': 'K-4D-02',
    'half-closed': 'K-4D-03',
    'silent': 'K-4D-04',
    'back': 'K-4D-05',
}
"""Clauses that a kart breaks by not reconnecting in time, by the kind of loss. `back` is when race
control returns after it was away."""

SENT_SO = {
    'bytes': 'K-4C-02',
    'many': 'K-4C-03',
    'late': 'K-4C-04',
    'slow': 'K-4C-05',
    'backlog': 'K-4C-06',
    'malformed': 'K-4C-08',
}
"""Clauses that a kart breaks in these steps by not reporting RED_RED in time, or by dropping the
connection (except in `backlog`, where a kart may take so many frames at once for old ones)."""

Speeds = list[tuple[float, float]]
"""Times, in seconds, and speeds, in m/s."""


class Law(enum.Enum):
    """The requirement on the wheels."""

    DRIVE = 'drive'
    STAND = 'stand'
    FLAG = 'RED_FLAG'
    RED = 'RED_RED'
    LOST = 'lost'


@dataclasses.dataclass
class Spell:
    """
    A period with one requirement on the kart. Times are in seconds.

    :ivar what: what began the period, to follow "after" in a sentence.
    :ivar stays: the sentence that the kart breaks if its wheels turn again.
    :ivar stops: the sentence that the kart breaks by braking too late.
    :ivar true: the sentence that the kart breaks by reporting a standstill too early; empty if no
        report is due.
    :ivar grace: time during which the kart need not know the requirement yet.
    :ivar drove: whether the kart was to drive until the spell began.
    :ivar rolled: whether the kart could still roll when the spell began.
    :ivar moved: whether its wheels turned then, or it had reported that it was driving.
    :ivar until: the time by which the kart must stand still.
    :ivar began: the time at which the kart began to brake, if that was seen.
    :ivar said: the time at which it first reported what is required.
    :ivar answer: the event with the inspector's answer to `STANDS`, if that was asked.
    """

    law: Law
    at: float
    what: str
    stays: str
    stops: str
    true: str = ''
    grace: float = 0.0
    drove: bool = False
    rolled: bool = False
    moved: bool = False
    until: float = math.inf
    began: float | None = None
    said: float | None = None
    answer: Event | None = None
    broken: bool = False
    speeds: Speeds = dataclasses.field(default_factory=list)

    @property
    def top(self) -> float:
        return max((speed for _, speed in self.speeds), default=0.0)


@dataclasses.dataclass(frozen=True)
class Due:
    """Something that the kart must do within a limit, in seconds, and the order for it, if any."""

    name: str
    since: float
    limit: float
    what: str
    order: SentState | None = None

    def has_expired(self, now: float) -> bool:
        return now > self.since + self.limit + EARLY


class Oracle:
    """
    Judges a trace, event by event.

    :ivar trace: the trace so far.
    :param tell: called with the name of each sentence and its first breach, when that is found.
    :ivar moves: number of breaches by the wheels, each of which is a reason to stop the kart.
    :ivar still: number of speeds received since the wheels last turned.
    :ivar spell: the current spell.
    """

    def __init__(
        self,
        limits: Limits,
        tell: Callable[[str, Finding], object] = lambda name, finding: None,
    ) -> None:
        self.trace = Trace()
        self._tell = tell
        self._limits = limits
        self._found: dict[str, Finding] = {}  # the first breach, or the gravest finding
        self.spell = Spell(Law.STAND, 0.0, 'the start', 'K-4C-11', 'K-4C-11')
        self._stops: list[Spell] = []  # the spells in which a rolling kart had to stop
        self.moves = self.still = 0
        self._step = ''
        # The connections that are open, with the times at which they were opened.
        self._open: dict[int, float] = {}
        self._doubtful: dict[int, float] = {}  # those still open when another one was opened
        self._link = 0  # the newest connection
        self._order: SentState | None = None  # in force; None while race control is lost
        self._since: RaceState | str = IN_GARAGE  # what disarmed the kart
        self._silent, self._silent_at = 'silent', 0.0
        self._killed = False
        self._stood: float | None = 0.0  # when it came to a standstill; None if it may still roll
        self._freed = 0.0  # when it had to stop driving
        self._at_speed = False  # it had driven long enough before it had to stop
        self._drives_on = 0  # the connection on which it reported that it was driving
        self._speed = math.nan
        self._first_seen = math.inf  # when the first odometry came
        self._said_due: Due | None = None
        self._back_due: Due | None = Due('K-4A-01', 0.0, limits.connect, 'connect')
        self._recent: deque[Event] = deque()
        self._bytes = 0

    @classmethod
    def of(cls, events: Iterable[Event], limits: Limits) -> Oracle:
        oracle = cls(limits)
        for event in events:
            oracle.take(event)
        return oracle

    @property
    def stands(self) -> bool:
        """Return whether the kart was seen to stand since it last had to stop."""
        return self._stood is not None

    # ----- what was found -----------------------------------------------------------------------

    def findings(self) -> dict[str, Finding]:
        """End the trace and return the findings by the names of their sentences."""
        now = self.trace.events[-1].at if self.trace.events else 0.0
        self._end_spell(now)
        self._let_go(now)
        self._expire_link(now)
        if self.trace.said:
            self._pass('K-4C-10', 'It never flooded.', now)
        if self._link:
            self._pass('K-4A-02', 'It never had two connections.', now)
        self._compare()
        return {name: self._with_evidence(finding) for name, finding in self._found.items()}

    def _with_evidence(self, finding: Finding) -> Finding:
        if finding.verdict is Verdict.PASS:
            return finding
        since, until = finding.since - AROUND, finding.at + AROUND
        evidence = tuple(
            each
            for each in self.trace.events
            # A hang is noticed only when it is over.
            if since <= each.at <= until + (each.value if each.kind is Kind.HELD_UP else 0.0)
        )
        return finding._replace(evidence=evidence)

    def _fail(
        self, name: str, why: str, since: float, at: float, measured: float | None = None
    ) -> None:
        before = self._found.get(name)
        if before is None or before.verdict is not Verdict.FAIL:
            self._found[name] = Finding(Verdict.FAIL, why, measured, since=since, at=at)
            self._tell(name, self._found[name])

    def _break(self, name: str, why: str, at: float) -> None:
        """Record a breach by the wheels. Further motion in this spell is the same fault."""
        self.spell.broken = True
        self.moves += 1
        self._fail(name, f'After {self.spell.what}: {why}', self.spell.at, at)
        if self.spell.law is not Law.DRIVE:
            self._stood, self.spell.until = None, math.inf

    def _pass(self, name: str, why: str, at: float, measured: float | None = None) -> None:
        self._keep(name, Finding(Verdict.PASS, why, measured, since=at, at=at))

    def _keep(self, name: str, found: Finding) -> None:
        """Keep a finding that is not a breach, if it is the gravest one."""
        before = self._found.get(name)
        if before is None or found.rank > before.rank:
            self._found[name] = found

    # ----- events -------------------------------------------------------------------------------

    def take(self, event: Event) -> None:
        at, heard = event.at, len(self.trace.said)
        ordered = len(self.trace.wires[event.link].orders)
        self.trace.add(event)
        self._let_time_pass(at)
        if event.kind is Kind.SPEED and math.isfinite(event.value):
            self._take_speed(at, abs(event.value))
        elif event.kind is Kind.SAID:
            self._take_bytes(event)
        elif event.kind is Kind.SENT:
            self._take_sent(event, self.trace.wires[event.link].orders[ordered:])
        elif event.kind is Kind.STEP:
            self._step, self._silent = event.text, 'silent'
            if event.text == 'malformed' and self._state is GRID_ACTIVE:
                self._begin(Law.STAND, at, 'malformed frames', 'K-4C-07')
        elif event.kind is Kind.OPENED:
            self._take_opened(event)
        elif event.kind in (Kind.CLOSED, Kind.ENDED):
            self._take_end(event)
        elif event.kind is Kind.BACK:
            if self._since != 'bridge':  # a killed bridge need not be started again
                self._expect_link('back', at)
        elif event.kind is Kind.SILENT:
            self._silent, self._silent_at = event.text, at
            self._expect_link(event.text, at)
        elif event.kind is Kind.KILLED and (event.text == 'stack' or self._state is not None):
            self._lose(at, event.text, self._limits.silence)
            self._killed = event.text == 'stack'
        elif event.kind is Kind.ANSWER:
            self._take_answer(event)
        for said in self.trace.said[heard:]:
            self._take_word(said)

    @property
    def _state(self) -> RaceState | None:
        """Return the state that the kart is sent; None while race control is lost."""
        return None if self._order is None else self._order.state

    def _let_time_pass(self, now: float) -> None:
        limits = self._limits
        framed = self.trace.wires[self._link].framed_at
        if self._order is not None and now >= framed + limits.silence:
            self._lose(framed + limits.silence, self._silent)
        due = self._said_due
        if due is not None and due.has_expired(now):
            self._let_go(now)
        elif due is not None and due.order is not None and self.trace.has(due.order):
            self._acknowledged(due, due.order, now)
        if self._back_due is not None and self._back_due.has_expired(now):
            self._expire_link(now)
        spell, said = self.spell, self.spell.said
        if spell.law is Law.DRIVE and said is not None and now > said + limits.slack:
            seen = bool(spell.speeds) and spell.speeds[-1][0] > said
            if seen and not (spell.moved or spell.broken):
                why = 'it reported GREEN_GREEN, but its wheels stood still.'
                self._break('K-3A-05', why, now)
        for link, since in [*self._doubtful.items()]:
            if now > since + limits.slack:
                del self._doubtful[link]
                why = f'It kept connection {link} open after opening a new one.'
                self._fail('K-4A-02', why, since, now)

    # ----- wheels -------------------------------------------------------------------------------

    def _take_speed(self, at: float, speed: float) -> None:
        spell, limits = self.spell, self._limits
        spell.speeds.append((at, speed))
        self._speed, self._first_seen = speed, min(self._first_seen, at)
        turns = speed > limits.standstill
        self.still = 0 if turns else self.still + 1
        if spell.law is Law.DRIVE:
            if turns and not spell.moved:
                spell.moved = True
                self._pass('K-3A-05', 'The wheels turned.', at, at - spell.at)
        elif not turns:
            if self._stood is None and at > self._freed + limits.slack and not spell.broken:
                self._stood = at
        elif not spell.broken:
            if self._stood is not None and at > self._stood + limits.slack:
                why = f'it had stood still, but then moved at {speed:.2f} m/s.'
                self._break(spell.stays, why, at)
            elif spell.said is not None and at > spell.said + limits.slack:
                why = f'it had reported a standstill, but moved at {speed:.2f} m/s.'
                self._break(spell.true, why, at)
            elif at > spell.until:
                self._break(spell.stops, f'it still rolled, at {speed:.2f} m/s.', at)

    def _take_answer(self, event: Event) -> None:
        spell, limits = self.spell, self._limits
        if event.text == TURNS and spell.law is Law.DRIVE:
            if event.value == 0.0:
                self._break('K-3A-05', 'the inspector saw the wheels stand still.', event.at)
            elif event.value == 1.0:
                self._pass('K-3A-05', 'The inspector saw the wheels turn.', event.at)
        elif event.text == STANDS and spell.law is not Law.DRIVE and not spell.broken:
            if spell.answer is None or spell.answer.value != 1.0:
                spell.answer = event  # the first answer that they stand
            if event.value == 0.0:
                name = spell.stops if spell.rolled else spell.stays
                if spell.said is not None and spell.rolled:
                    name = spell.true
                self._break(name, 'the inspector saw the wheels turn.', event.at)
            elif (
                event.value == 1.0
                and self._stood is None
                and event.at > self._freed + limits.slack
            ):
                self._stood = event.at

    def _begin(
        self,
        law: Law,
        at: float,
        what: str,
        stays: str,
        stops: str = '',
        true: str = '',
        grace: float = 0.0,
    ) -> None:
        before, limits = self.spell, self._limits
        drove = before.law is Law.DRIVE
        self._end_spell(at)
        if drove:
            self._freed, self._stood = at, None
            self._at_speed = at - before.at >= min(limits.drive, 1.0)
        blind = self._drives_on > 0 and self._stood is None and math.isnan(self._speed)
        moved = self._at_speed and (self._speed > limits.standstill or blind)
        until = at + grace + (limits.red_flag if law is Law.FLAG else limits.red_red)
        rolled = self._stood is None
        if rolled and not drove and not before.broken:
            # An invalid GREEN_GREEN does not shorten a braking kart's time.
            until = before.until if self._state is GREEN_GREEN else min(until, before.until)
        self.spell = Spell(
            law, at, what, stays, stops or stays, true, grace, drove, rolled, moved, until
        )

    def _end_spell(self, at: float) -> None:
        """Judge a spell as a whole."""
        spell, limits = self.spell, self._limits
        if spell.law is Law.DRIVE or spell.broken:
            return
        breach = self._breach_of_stop(spell) if spell.rolled else None
        if breach is not None:
            self._break(*breach)
            return
        names = {spell.stays}
        if spell.said is not None and (spell.rolled or spell.true == 'K-3E-08'):
            names.add(spell.true)
        if spell.rolled:
            names.add(spell.stops)
        answer = math.nan if spell.answer is None else spell.answer.value
        times = [max(spell.at, self._first_seen), *(each for each, _ in spell.speeds), at]
        gaps = (then - each for each, then in itertools.pairwise(times))
        seen = bool(spell.speeds) and max(gaps) <= 2 * limits.slack
        asked = spell.answer is not None or not math.isnan(self._speed)
        if answer == 1.0 and spell.answer is not None and spell.rolled and not seen:
            # An answer says that the wheels stand, but not since when.
            seen = spell.answer.at <= spell.until + 2 * limits.slack
        elif answer == 1.0:
            seen = True
        for name in sorted(names):
            if seen and self._stood is not None:
                took = max(self._stood - spell.at, 0.0) if spell.rolled else None
                self._pass(name, f'It stood still after {spell.what}.', at, took)
            elif asked and not seen and at - spell.at > 2 * limits.slack:
                why = f'Nobody saw in time whether the wheels stood still after {spell.what}.'
                self._keep(name, Finding(Verdict.NOT_JUDGED, why, since=spell.at, at=at))

    def _breach_of_stop(self, spell: Spell) -> tuple[str, str, float] | None:
        """Return the breach of a rolling kart that brakes or reports badly: name, why and time."""
        limits, top = self._limits, spell.top
        measured = top >= FAST * limits.standstill
        due = spell.at + spell.grace + limits.slack + VARIES
        known = max((speed for at, speed in spell.speeds if at <= due), default=top)
        if top > FASTER * known + limits.standstill:
            at = next(at for at, speed in spell.speeds if speed == top)
            why = f'it got faster, up to {top:.2f} m/s after {at - spell.at:.2f} s.'
            return spell.stops, why, at
        slowest = math.inf
        for at, speed in spell.speeds if measured else ():
            slowest = min(slowest, speed) if at > due else slowest
            if speed > slowest + REGAINED * top:
                why = f'{at - spell.at:.2f} s later, it got faster again, up to {speed:.2f} m/s.'
                return spell.stops, why, at
        slower, slow = _fell(spell.speeds, 0.9 * top), _fell(spell.speeds, 0.7 * top)
        if measured and slower is not None and slow is not None:
            spell.began = began = slower - (slow - slower) * (0.1 / 0.2)
            stood = self._stood if self._stood is not None else spell.speeds[-1][0]
            if began > due + (GENTLY * (stood - spell.at) if spell.law is Law.FLAG else 0.0):
                why = f'it began to slow down only after {began - spell.at:.2f} s.'
                return spell.stops, why, began
        elif measured and slower is None and spell.law is not Law.FLAG:
            # A kart that stops in time has lost a tenth of its speed after a tenth of that time.
            at, speed = spell.speeds[-1]
            if at > due + limits.red_red / 10:
                why = f'it had not begun to slow down after {at - spell.at:.2f} s.'
                return spell.stops, why, at
        self._stops.append(spell)
        if spell.said is None:
            return None
        # A kart that was braking already does not show how late odometry is. Its other stops do.
        shows = [spell] if spell.drove else [each for each in self._stops if each.drove]
        delays = [max(each.began - each.at, 0.0) for each in shows if each.began is not None]
        lag = min(min(delays, default=limits.slack) + VARIES, limits.slack)
        rolls = max(ROLLING * top, limits.standstill)
        for at, speed in spell.speeds:
            late = at - spell.said
            if late > lag and speed > rolls:
                why = f'{late:.2f} s after reporting a standstill, it moved at {speed:.2f} m/s.'
                return spell.true, why, at
        if spell.moved and spell.said - self._freed < limits.fastest_stop:
            why = 'it reported a standstill sooner than a kart at speed can stop.'
            return spell.true, why, spell.said
        return None

    # ----- the connection -------------------------------------------------------------------

    def _take_opened(self, event: Event) -> None:
        due, self._back_due = self._back_due, None
        if due is not None:
            took = event.at - due.since
            self._pass(due.name, f'It connected after {took:.2f} s.', event.at, took)
        self._doubtful = {**dict.fromkeys(self._open, event.at), **self._doubtful}
        self._open[event.link] = event.at
        if self._order is not None:
            self._lose(event.at, 'kart')
        self._link = event.link

    def _take_end(self, event: Event) -> None:
        if event.text != 'half-closed':
            self._open.pop(event.link, None)
            self._doubtful.pop(event.link, None)
        if event.link != self._link or self._order is None:
            return
        at, how = event.at, event.text
        if event.kind is Kind.ENDED:
            self._expect_link(how, at)
            self._lose(at, how)
            return
        if self._step in SENT_SO and self._step != 'backlog':
            self._fail(SENT_SO[self._step], 'It dropped the connection.', self.spell.at, at)
        framed = self.trace.wires[event.link].framed_at
        if self._step == 'bridge':
            self._lose(at, 'bridge', self._limits.silence)
        elif self._silent_at >= framed:  # the kart treats a shorter silence as a loss
            self._lose(at, self._silent, max(framed + self._limits.silence - at, 0.0))
        else:
            self._lose(at, 'kart')

    def _expect_link(self, how: str, since: float) -> None:
        if how in BACK:
            self._back_due = Due(BACK[how], since, self._limits.reconnect, 'connect again')

    def _expire_link(self, now: float) -> None:
        due, self._back_due = self._back_due, None
        self._miss(due, now)

    def _miss(self, due: Due | None, at: float) -> None:
        """Record what the kart has not done, if it had enough time for it."""
        if due is not None and at >= due.since + due.limit - EARLY:
            waited = at - due.since
            why = f'It did not {due.what} within {waited:.1f} s.'
            self._fail(due.name, why, due.since, at, waited)

    def _lose(self, at: float, how: str, grace: float = 0.0) -> None:
        """Record the loss of race control: `how` is a key of `LOSSES`, or `kart` if it did it."""
        self._let_go(at)
        braked = self._state in (RED_FLAG, RED_RED) and self._stood is None
        name = 'K-3E-11' if braked else LOSSES.get(how, 'K-3E-11')
        self._order, self._since = None, how
        what = {'kart': 'it dropped its connection', 'away': 'race control went away'}.get(
            how, f'a loss ({how})'
        )
        self._begin(Law.LOST, at, what, name, grace=grace)

    # ----- orders -------------------------------------------------------------------------------

    def _take_sent(self, event: Event, fresh: list[SentState]) -> None:
        link, at = event.link, event.at
        if link != self._link:
            return
        framed = self.trace.wires[link].framed_at == at
        if framed:
            self._expire_link(at)  # the loss is over
        first = self.trace.wires[link].bytes_sent == len(event.data)
        if first and link > 1 and at - self._open.get(link, at) > self._limits.slack / 2:
            self._pass('K-4C-12', 'It sent nothing before it was sent anything.', at)
        if framed and not fresh and self._order is None:
            fresh = self.trace.wires[link].orders[-1:]  # the same order again after a silence
        for order in fresh:
            self._take_order(order, at)

    def _take_order(self, order: SentState, at: float) -> None:
        if self._killed:
            return
        earlier, before, state = self._order, self._state, order.state
        self._let_go(at)
        self._order = order
        armed = earlier is not None and before is GRID_ACTIVE and self.trace.has(earlier)
        if state is GREEN_GREEN and armed:
            self._free(order)
        elif state is GREEN_GREEN:
            if before is not None:
                self._since = before
            name = UNARMED.get(self._since, 'K-3E-05')
            self._begin(Law.RED, at, f'an invalid GREEN_GREEN ({name})', name)
        elif state in (RED_FLAG, RED_RED):
            law = Law.FLAG if state is RED_FLAG else Law.RED
            true = 'K-3A-07' if law is Law.FLAG else 'K-3A-10'
            if law is Law.RED and self.spell.law is Law.FLAG:
                true = 'K-3A-12'
            if law is Law.RED and self._drives_on not in (0, order.link):
                true = 'K-3E-08'
            self._begin(law, at, state.value, STAYS[state], BRAKES[state], true)
        else:
            malformed = state is GRID_ACTIVE and self._step == 'malformed'
            self._begin(Law.STAND, at, state.value, 'K-4C-07' if malformed else STAYS[state])
        if state in ACKNOWLEDGES and (state is not GREEN_GREEN or armed):
            name, limit = ACKNOWLEDGES[state]
            if state is GRID_ACTIVE:
                name = 'K-3A-11' if name in self._found else name
            elif state is RED_RED:
                name = SENT_SO.get(self._step, name)
                if self._since == 'closed' and before is None:
                    name = 'K-4D-06'
            what = f'acknowledge {state.value}'
            self._said_due = Due(name, at, getattr(self._limits, limit), what, order)

    def _free(self, order: SentState) -> None:
        self._begin(Law.DRIVE, order.at, 'GREEN_GREEN', 'K-3A-05')
        self._stood, self._drives_on = None, 0

    # ----- words --------------------------------------------------------------------------------

    def _acknowledged(self, due: Due, order: SentState, at: float) -> None:
        self._said_due = None
        took = at - due.since
        why = f'It acknowledged {order.state.value} after {took:.3f} s.'
        self._pass(due.name, why, at, took)
        self.spell.said = at
        if order.state is GREEN_GREEN:
            self._drives_on = self._link

    def _let_go(self, at: float) -> None:
        """Record a missing acknowledgement, unless the wheels are at fault already."""
        due, self._said_due = self._said_due, None
        rolls = self._stood is None and self._speed > self._limits.standstill
        if not self.spell.broken and (not rolls or self.spell.law is Law.DRIVE):
            self._miss(due, at)

    def _take_word(self, said: Said) -> None:
        at, sent = said.at, said.sent
        if said.state is None:
            self._fail('K-4C-01', f'It sent {said}', at, at)
            return
        self._pass('K-4C-01', 'It sent frames only.', at)
        if not self.trace.wires[said.link].bytes_sent:
            name = 'K-4C-11' if said.link == 1 else 'K-4C-12'
            why = f'It sent {said} before it was sent anything on this connection.'
            self._fail(name, why, at, at)
        if sent is None or said.link != self._link:
            return
        spell = self.spell
        if spell.law is not Law.DRIVE and not spell.broken and self._state is not None:
            if said.state is GRID_ACTIVE and spell.stays == 'K-3B-03':
                # GREEN_GREEN arrived with GRID_ACTIVE, which the kart acknowledged first.
                self._pass('K-3B-03', 'It acknowledged GRID_ACTIVE in between.', at)
                self._free(sent)
            elif said.state is GREEN_GREEN and (
                sent.state is GREEN_GREEN or spell.stays == 'K-4C-07'
            ):
                self._break(spell.stays, 'it reported GREEN_GREEN.', at)
        since = at - sent.at
        # To the kart, an invalid GREEN_GREEN is RED_RED. It may also stop itself.
        careful = sent.state in (GRID_ACTIVE, GREEN_GREEN) and said.state is RED_RED
        # A kart may report IN_GARAGE although another frame follows, even late if it was busy.
        garage = said.state is IN_GARAGE and since <= self._limits.silence
        if said.state is not sent.state and since > self._limits.slack and not (careful or garage):
            why = f'It reported {said} {since:.2f} s after it was sent {sent.state.value}.'
            self._fail('K-4C-09', why, sent.at, at, since)
        elif said.state is sent.state:
            self._pass('K-4C-09', 'It reported nothing but the state that it was being sent.', at)

    def _take_bytes(self, event: Event) -> None:
        self._recent.append(event)
        self._bytes += len(event.data)
        while self._recent[0].at < event.at - 1.0:
            self._bytes -= len(self._recent.popleft().data)
        if self._bytes > MOST_BYTES_A_SECOND:
            why = f'It sent {self._bytes} bytes in one second.'
            self._fail('K-4C-10', why, event.at - 1.0, event.at)
            self._recent.clear()
            self._bytes = 0

    # ----- how hard it brakes -------------------------------------------------------------------

    def _compare(self) -> None:
        """Compare the stops with each other, each pair over the same speed range."""
        seen = [each for each in self._stops if each.began is not None]
        took_to_say: dict[Law, float] = {}
        for each in self._stops:
            if each.drove and each.moved and each.said is not None:
                took_to_say.setdefault(each.law, each.said - each.at)
        if not seen and {Law.FLAG, Law.RED} <= took_to_say.keys():
            red, flag = took_to_say[Law.RED], took_to_say[Law.FLAG]
            why = (
                f'It reported a standstill {flag:.2f} s after RED_FLAG, {red:.2f} s after RED_RED.'
            )
            if red > SOONER * flag:
                self._fail('K-3A-13', why, 0.0, 0.0, red)
            else:
                self._pass('K-3A-13', why, 0.0, red)
        reds = [each for each in seen if each.stops == BRAKES[RED_RED]]
        stops = [
            each
            for each in seen
            if each.law in (Law.FLAG, Law.LOST) or each.stops == BRAKES[RED_RED]
            if each.stops != LOSSES['stack']
        ]
        hardest = [(each, _braking(each, self._limits)) for each in reds]
        fastest = max((speeds[0][1] for _, speeds in hardest), default=0.0)
        for stop in stops:
            speeds = _braking(stop, self._limits)
            top = min(max(speed for _, speed in speeds), fastest)
            took = _falling(speeds, top)
            # A weak stop does not count for the yardstick that it is measured by.
            others = [other for each, other in hardest if each is not stop]
            fell = [(_falling(each, top), _apart(each, 0.2 * top)) for each in others]
            hard = [(seconds, gap) for seconds, gap in fell if seconds is not None]
            gentle = stop.law is Law.FLAG
            if took is None or not hard or not (gentle or top >= COMPARED * fastest):
                continue
            median = statistics.median(seconds for seconds, _ in hard)
            # Odometry does not show what happened between two speeds.
            apart = _apart(speeds, 0.2 * top)
            unclear = apart + statistics.median(gap for _, gap in hard)
            if (gentle and median > self._limits.harder * took + unclear) or (
                not gentle and took > median / WEAK + 2 * apart
            ):
                why = f'After {stop.what}, it slowed down in {took:.2f} s; from the same speed, '
                why += f'it takes {median:.2f} s after RED_RED.'
                name = 'K-3E-11' if stop.law is Law.LOST else 'K-3A-13'
                self._fail(name, why, stop.at, stop.speeds[-1][0], took)
            elif gentle:
                why = f'From the same speed, RED_FLAG took {took:.2f} s, RED_RED {median:.2f} s.'
                self._pass('K-3A-13', why, stop.at, median)


def _braking(spell: Spell, limits: Limits) -> Speeds:
    """Return the speeds from the time on at which the kart had to know that it must brake."""
    begins = spell.at + spell.grace + min(limits.slack, VARIES)
    late = [each for each in spell.speeds if each[0] >= begins]
    return late or spell.speeds[-1:]


def _fell(speeds: Speeds, level: float) -> float | None:
    """Return the time at which the speed last fell below a level; None if it did not."""
    above = [place for place, (_, speed) in enumerate(speeds) if speed >= level]
    if not above or above[-1] + 1 == len(speeds):
        return None
    (at, speed), (then, lower) = speeds[above[-1]], speeds[above[-1] + 1]
    return at + (then - at) * (speed - level) / max(speed - lower, 1e-9)


def _falling(speeds: Speeds, top: float) -> float | None:
    """Return the time that it took to slow down from 80 % to 20 % of a speed, in seconds."""
    fast, slow = _fell(speeds, 0.8 * top), _fell(speeds, 0.2 * top)
    return None if fast is None or slow is None else slow - fast


def _apart(speeds: Speeds, level: float) -> float:
    """Return the longest time between two speeds of which the first is above a level."""
    pairs = itertools.pairwise(speeds)
    return max((then - at for (at, speed), (then, _) in pairs if speed >= level), default=0.0)
