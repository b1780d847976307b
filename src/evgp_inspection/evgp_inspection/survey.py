# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The result of a network survey: figures, worst places and a verdict, as text. Pure.

Each kart has a `LinkSurvey`, which receives events with their times. All times here are in
seconds. All figures are about the kart's kernel, which answers before the kart's program does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
import datetime
import itertools
import math

from evgp_inspection.limits import SurveyLimits
from evgp_inspection.traces import BEAT
from evgp_inspection.verdicts import Verdict
from evgp_protocol.arbiter import Settings
from evgp_protocol.clock import duration
from evgp_protocol.link import Grade, grade, GRADE_WINDOW

LOST = Settings().frame_timeout
"""Age of an unanswered frame after which the survey gives up a connection, and silence after which
a kart does, in seconds."""


@dataclasses.dataclass(frozen=True)
class Mark:
    """A named place, to which later events refer until the next mark."""

    at: float
    name: str


@dataclasses.dataclass
class Second:
    """
    One second of a kart's link.

    :ivar at: the end of the second, measured from the start of the survey.
    :ivar round_trip: the round trip of the newest answered frame; None if none was answered.
    :ivar worst: the longest round trip in this second, or the age of an unanswered frame.
    :ivar silence: the longest time without an answer that lasted into this second.
    :ivar retransmitted: number of retransmitted segments.
    :ivar connected: whether the kart was connected at the end of the second.
    """

    at: float = 0.0
    round_trip: float | None = None
    worst: float = 0.0
    silence: float = 0.0
    retransmitted: int = 0
    connected: bool = False


@dataclasses.dataclass(frozen=True)
class Figure:
    """
    One line of the verdict on a kart.

    :ivar value: the measured value, in `unit`; None if nothing was measured.
    :ivar limit: the maximum that passes, or the minimum, in `unit`.
    :ivar at_least: whether the limit is a minimum.
    """

    name: str
    value: float | None
    limit: float
    unit: str
    verdict: Verdict
    at_least: bool = False

    def line(self) -> str:
        value = 'nothing' if self.value is None else f'{self.value:.3g} {self.unit}'.rstrip()
        most = 'at least' if self.at_least else 'at most'
        limit = f'{most} {self.limit:.3g} {self.unit}'.rstrip()
        return f'{self.verdict.value:11} {self.name:32} {value:>12}   {limit}'


class LinkSurvey:
    """
    The link of one kart, from its first connection on.

    :ivar seconds: the figures of each second.
    :ivar losses: the time of each lost connection, and how it was lost.
    """

    def __init__(self) -> None:
        self.seconds: list[Second] = []
        self.losses: list[tuple[float, str]] = []
        self._opened_at: float | None = None  # None while it is not connected
        self._time_on = 0.0  # of earlier connections
        self._trips: list[float] = []
        self._since: float | None = None  # when the kart last answered
        self._now = Second()  # the present second

    def opened(self, now: float) -> None:
        """Record a new connection, which does not end a silence."""
        self._opened_at = now
        if self._since is None:
            self._since = now

    def lost(self, why: str, now: float, never_answered: Sequence[float] = ()) -> None:
        """
        Record that the connection has ended.

        :param never_answered: the ages of unanswered frames, whose round trips would have been at
            least as long.
        """
        if self._opened_at is not None:
            self._time_on += now - self._opened_at
        self._opened_at = None
        self.losses.append((now, why))
        self._trips += never_answered
        self._now.worst = max(self._now.worst, 0.0, *never_answered)

    def answered(self, trips: Sequence[float], now: float) -> None:
        """Record the round trips of newly answered frames, the newest last."""
        if trips:
            self._silent(now)
            self._since = now
            self._trips += trips
            self._now.round_trip = trips[-1]
            self._now.worst = max(self._now.worst, *trips)

    def retransmitted(self, segments: int) -> None:
        """Record that this many more segments were retransmitted."""
        self._now.retransmitted += segments

    def second(self, now: float, age: float = 0.0) -> Second:
        """
        End a second.

        :param age: the age of the oldest unanswered frame.
        """
        self._silent(now)
        found, self._now = self._now, Second()
        found.at, found.worst = now, max(found.worst, age)
        found.connected = self._opened_at is not None
        self.seconds.append(found)
        return found

    def _silent(self, now: float) -> None:
        """Record how long the kart has been silent up to now."""
        if self._since is not None:
            self._now.silence = max(self._now.silence, now - self._since)

    @property
    def grade(self) -> Grade:
        """Return the grade of the link over the last `GRADE_WINDOW`. A lost link is poor."""
        since = self.seconds[-1].at - GRADE_WINDOW if self.seconds else 0.0
        recent = [each for each in self.seconds if each.at > since]
        if recent and not recent[-1].connected:
            return Grade.POOR
        return grade(max((each.worst for each in recent), default=None))

    @property
    def worst(self) -> float:
        """Return the longest round trip so far."""
        return max((each.worst for each in self.seconds), default=0.0)

    @property
    def percentile(self) -> float | None:
        """Return the 99th percentile of the round trips; None if there were none."""
        trips = sorted(self._trips)
        return trips[math.ceil(0.99 * len(trips)) - 1] if trips else None

    @property
    def worst_minute(self) -> int:
        """Return the number of retransmitted segments in the worst minute."""
        resent = [each.retransmitted for each in self.seconds]
        return max(
            (sum(itertools.islice(resent, at, at + 60)) for at in range(len(resent))), default=0
        )

    def figures(self, limits: SurveyLimits, held_up: float = 0.0) -> list[Figure]:
        """
        Return the figures, each compared with its limit.

        :param held_up: the maximum delay of the surveying computer itself. A time that this delay
            can explain is not judged, nor is a lost connection.
        """
        silenced = held_up + 2 * BEAT >= LOST  # the kart may have closed the connection, rightly

        def at_most(
            name: str, value: float | None, limit: float, unit: str = '', excused: bool = False
        ) -> Figure:
            if value is None:
                verdict = Verdict.NOT_JUDGED
            elif value <= limit:
                verdict = Verdict.PASS
            elif excused or (unit == 's' and value - held_up <= limit):
                verdict = Verdict.NOT_JUDGED
            else:
                verdict = Verdict.FAIL
            return Figure(name, value, limit, unit, verdict)

        on = self._time_on
        if self._opened_at is not None and self.seconds:
            on += max(self.seconds[-1].at - self._opened_at, 0.0)
        silence = max(each.silence for each in (*self.seconds, self._now))
        enough = Verdict.PASS if on >= limits.shortest else Verdict.NOT_JUDGED
        return [
            at_most('round trip, 99th percentile', self.percentile, limits.round_trip, 's'),
            at_most('longest silence', silence, limits.silence, 's'),
            at_most('retransmissions, worst minute', self.worst_minute, limits.retransmissions),
            at_most('lost connections', len(self.losses), 0, excused=silenced),
            Figure('time on the network', on, limits.shortest, 's', enough, at_least=True),
        ]

    def worst_places(self) -> list[Second]:
        """Return up to five of the worst seconds, worst first and at least 10 s apart."""
        places: list[Second] = []
        for each in sorted(self.seconds, key=badness, reverse=True):
            if all(abs(each.at - other.at) >= 10.0 for other in places):
                places.append(each)
                if len(places) == 5:
                    break
        return places


def badness(second: Second) -> float:
    """Return the longest round trip or silence of a second."""
    return max(second.worst, second.silence)


@dataclasses.dataclass(frozen=True)
class Report:
    """
    A whole survey.

    :ivar began: the date and time of the start.
    :ivar seconds: the duration.
    :ivar karts: the surveys, by the karts' IPv4 addresses.
    :ivar held_up: the maximum delay of the surveying computer itself.
    """

    began: datetime.datetime
    seconds: float
    karts: Mapping[str, LinkSurvey]
    marks: Sequence[Mark]
    held_up: float
    limits: SurveyLimits

    @property
    def verdict(self) -> Verdict:
        """Return the verdict, in which a failure outweighs a figure that was not judged."""
        found = {
            figure.verdict
            for kart in self.karts.values()
            for figure in kart.figures(self.limits, self.held_up)
        } or {Verdict.NOT_JUDGED}
        return next(
            each for each in (Verdict.FAIL, Verdict.NOT_JUDGED, Verdict.PASS) if each in found
        )

    def place(self, at: float) -> str:
        """Return the time of an event and the mark before it, as text for people."""
        before = [mark for mark in self.marks if mark.at <= at]
        where = f', {at - before[-1].at:.0f} s after "{before[-1].name}"' if before else ''
        return f'at {self.began + datetime.timedelta(seconds=at):%H:%M:%S}{where}'

    def text(self) -> str:
        lines = [
            f'Survey of the network, {self.began:%Y-%m-%d %H:%M:%S}, {duration(self.seconds, 0)}',
            '',
        ]
        for address, kart in self.karts.items():
            lines += [f'Kart {address}']
            lines += [f'  {each.line()}' for each in kart.figures(self.limits, self.held_up)]
            lines += ['  Worst places:']
            for each in kart.worst_places():
                lost = '' if each.connected else ', not connected'
                lines += [f'    {badness(each):7.3f} s  {self.place(each.at)}{lost}']
            lines += [f'  Lost {self.place(at)}: {why}' for at, why in kart.losses]
            lines += ['']
        if not self.karts:
            lines += ['No kart connected.', '']
        if self.held_up > self.limits.round_trip / 2:
            lines += [
                f'This computer itself was late by up to {self.held_up:.2f} s. Figures that this '
                'can explain are not judged. Survey again with no other program running.',
                '',
            ]
        return '\n'.join([*lines, self.verdict.value.upper(), ''])
