# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Which motion a kart may show, at any moment of a whole trace.

Pure: a trace in, breaches out. What was sent, since when and on which connection divides the trace
into times in which the kart may drive, and times in which it must halt. Every speed of odometry in
the second is asked: may the kart still roll, has it begun to brake, does it brake as hard as for
RED_RED, has it stood already?
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
import dataclasses
import enum
import math
import statistics

from evgp_inspection.limits import Limits
from evgp_inspection.traces import Event, Kind, Said, Trace
from evgp_protocol.frames import FrameDecoder, StateFrame
from evgp_protocol.states import RaceState

VARIES = 0.15
"""How much later than `slack` the measured begin of a brake may be, s."""

WEAK = 0.6
"""Part of the median deceleration of RED_RED stops that is too little for any stop as RED_RED."""

FAST = 10
"""Times the speed of a kart that stands: from there on a deceleration can be measured."""

AROUND = 2.0
"""Time before and after a breach whose events are its evidence, s."""


class Law(enum.Enum):
    """What is asked of the wheels; the value says what the kart was told, for people."""

    STAND = 'it had to stand'
    FLAG = 'RED_FLAG'
    RED = 'RED_RED'
    LOST = 'the loss of its connection'


@dataclasses.dataclass(frozen=True)
class Breach:
    """
    A moment in which a kart moved otherwise than it may.

    :ivar at: when, s.
    :ivar why: a sentence.
    """

    law: Law
    at: float
    why: str


@dataclasses.dataclass(frozen=True)
class Told:
    """
    What a kart that must halt is told, from one moment on.

    :ivar at: since when, s.
    :ivar grace: time after that in which it need not know it yet, s.
    :ivar killed: a part of its program is gone: the base brakes as it can.
    """

    law: Law
    at: float
    grace: float = 0.0
    killed: bool = False

    def limit(self, limits: Limits) -> float:
        """Return when the kart must stand, s."""
        return self.at + self.grace + (limits.red_flag if self.law is Law.FLAG else limits.red_red)


@dataclasses.dataclass
class Halt:
    """
    A time in which the kart must come to stand, and stand.

    :ivar driven: it was allowed to drive before, so that it may have to brake first.
    :ivar told: why, the first reason first.
    :ivar said: when it first said that it stands, for each time it was told, s.
    """

    driven: bool
    told: list[Told]
    speeds: list[tuple[float, float]] = dataclasses.field(default_factory=list)
    said: list[float] = dataclasses.field(default_factory=list)

    def first_stop(self) -> Told | None:
        """Return when it was first told to stop as for RED_RED."""
        return next((each for each in self.told if each.law in (Law.RED, Law.LOST)), None)


def halts(trace: Trace, limits: Limits) -> list[Halt]:
    """Return all times in which the kart had to halt, with what odometry said meanwhile."""
    return list(_Reader(limits).read(trace))


class _Reader:
    """Goes through a trace; knows what the kart is told on which connection."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._decoders: defaultdict[int, FrameDecoder] = defaultdict(FrameDecoder)
        self._link = 0
        self._state: RaceState | None = None
        self._frame_at = 0.0
        self._ready = self._armed = False
        self._killed = False
        self._halt: Halt | None = Halt(False, [Told(Law.STAND, 0.0)])

    def read(self, trace: Trace) -> Iterator[Halt]:
        """Yield each halt once it is over."""
        words = iter([said for section in trace.sections for said in section.said])
        word = next(words, None)
        for event in trace.events:
            before = self._halt
            self._silence(event.at)
            if event.kind is Kind.SPEED and math.isfinite(event.value) and self._halt:
                self._halt.speeds.append((event.at, abs(event.value)))
            elif event.kind in (Kind.CLOSED, Kind.ENDED) and event.link == self._link:
                self._lose(event.at)
            elif event.kind is Kind.OPENED:
                self._lose(event.at)
                self._link = event.link
            elif event.kind is Kind.KILLED and event.text == 'stack':
                self._killed = True
                self._tell(Told(Law.LOST, event.at, self._limits.silence, killed=True))
            elif event.kind is Kind.SENT:
                self._take_sent(event)
            while event.kind is Kind.SAID and word is not None and word.at <= event.at:
                self._take_said(word)
                word = next(words, None)
            if before is not None and self._halt is not before:
                yield before
        if self._halt is not None:
            yield self._halt

    def _silence(self, now: float) -> None:
        """Notice that nothing whole was sent for so long that it is a lost connection."""
        since = self._frame_at + self._limits.silence
        if self._state is not None and now >= since:
            self._lose(since)

    def _lose(self, at: float) -> None:
        if self._state is not None:
            self._tell(Told(Law.LOST, at))
        self._state, self._ready, self._armed = None, False, False

    def _tell(self, told: Told) -> None:
        if self._halt is None:
            self._halt = Halt(True, [told])
        elif self._halt.told[-1].law is not told.law or told.killed:
            self._halt.told.append(told)

    def _take_sent(self, event: Event) -> None:
        for frame in self._decoders[event.link].feed(event.data):
            if event.link != self._link or not isinstance(frame, StateFrame):
                continue
            before, self._state, self._frame_at = self._state, frame.state, event.at
            if frame.state is before:
                continue
            green = frame.state is RaceState.GREEN_GREEN
            self._armed = green and self._ready and before is RaceState.GRID_ACTIVE
            self._ready = False
            if self._armed and not self._killed:
                self._halt = None
            elif frame.state is RaceState.RED_FLAG:
                self._tell(Told(Law.FLAG, event.at))
            elif frame.state is RaceState.RED_RED or green:
                self._tell(Told(Law.RED, event.at))
            else:
                self._tell(Told(Law.STAND, event.at))

    def _take_said(self, said: Said) -> None:
        if said.answers is None or said.answers.state is not self._state:
            return
        if said.answers.state is RaceState.GRID_ACTIVE:
            self._ready = True
        elif self._halt is not None and said.answers.state.is_red:
            self._halt.said.append(said.at)


def breaches(trace: Trace, limits: Limits) -> list[Breach]:
    """Return all moments in which the kart moved otherwise than it may, the first one first."""
    found: list[Breach] = []
    stops: list[tuple[Told, float]] = []
    for halt in halts(trace, limits):
        found += _stands(halt, limits)
        if halt.driven and halt.speeds:
            found += _begins(halt, limits)
            stop = halt.first_stop()
            braking = None if stop is None else _deceleration(halt, stop, limits)
            if stop is not None and braking is not None and not any(t.killed for t in halt.told):
                stops.append((stop, braking))
    red = [braking for told, braking in stops if told.law is Law.RED]
    if red:
        hard = statistics.median(red)
        found += [
            Breach(
                told.law,
                told.at,
                f'After {told.law.value} it slows down by {braking:.1f} m/s² only, '
                f'else by {hard:.1f} m/s².',
            )
            for told, braking in stops
            if braking < WEAK * hard
        ]
    return sorted(found, key=lambda breach: breach.at)


def _stands(halt: Halt, limits: Limits) -> Iterator[Breach]:
    """Yield the first moment in which a kart moves that has to stand by now."""
    must = halt.told[0].at + limits.slack
    why = 'It had to stand'
    if halt.driven:
        must = min(told.limit(limits) for told in halt.told)
        stood = next((at for at, speed in halt.speeds if speed <= limits.standstill), math.inf)
        since, why = min(
            (must, 'It still turned, too late'),
            (stood + limits.slack, 'It had stood'),
            *((said + limits.slack, 'It had said that it stands') for said in halt.said[:1]),
        )
        must = since
    for at, speed in halt.speeds:
        if at > must and speed > limits.standstill:
            told = max((t for t in halt.told if t.at <= at), key=lambda t: t.at)
            yield Breach(told.law, at, f'{why}; after {told.law.value}: {speed:.2f} m/s.')
            return


def _fell(speeds: list[tuple[float, float]], level: float) -> float | None:
    """Return when the speed fell below a level for the last time, s; None: it did not."""
    above = [place for place, (_, speed) in enumerate(speeds) if speed >= level]
    if not above or above[-1] + 1 == len(speeds):
        return None
    (at, speed), (then, lower) = speeds[above[-1]], speeds[above[-1] + 1]
    return at + (then - at) * (speed - level) / max(speed - lower, 1e-9)


def _begins(halt: Halt, limits: Limits) -> Iterator[Breach]:
    """Yield where a kart begins to brake too late: the line through 0.8 and 0.5 of its speed."""
    told = halt.told[0]
    until = next((later.at for later in halt.told[1:] if later.at > told.at), math.inf)
    speeds = [each for each in halt.speeds if each[0] <= until]
    due = told.at + told.grace + limits.slack + VARIES
    top = max((speed for _, speed in speeds), default=0.0)
    slower, half = _fell(speeds, 0.8 * top), _fell(speeds, 0.5 * top)
    if top < FAST * limits.standstill or slower is None or half is None:
        return
    began = slower - (half - slower) * (0.2 / 0.3)
    if began > due:
        yield Breach(
            told.law,
            due,
            f'After {told.law.value} it began to slow down after {began - told.at:.2f} s only, '
            f'not within {due - told.at:.2f} s.',
        )


def _deceleration(halt: Halt, stop: Told, limits: Limits) -> float | None:
    """Return how much a kart slows down once it must stop as for RED_RED, m/s²; None: unknown."""
    begins = stop.at + stop.grace + min(limits.slack, VARIES)
    speeds = [each for each in halt.speeds if each[0] >= begins]
    top = max((speed for _, speed in speeds), default=0.0)
    fast, slow = _fell(speeds, 0.8 * top), _fell(speeds, 0.2 * top)
    if top < FAST * limits.standstill or fast is None or slow is None:
        return None
    return 0.6 * top / max(slow - fast, 1e-9)
