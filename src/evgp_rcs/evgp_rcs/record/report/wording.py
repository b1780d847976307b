# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The report's wording of times, names and states."""

from __future__ import annotations

import datetime

from evgp_protocol.clock import duration
from evgp_rcs import words
from evgp_rcs.record.plain import plain
from evgp_rcs.record.report.model import NOT_CONNECTED, NOT_KNOWN, Out, Stop, StopAnswer, Why
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind

STATES = {state.name: said for state, said in words.STATES.items() if state is not None} | {
    NOT_CONNECTED: 'not connected',
    NOT_KNOWN: 'not known',
}

SILENCES = {
    '': 'not acknowledged',
    NOT_CONNECTED: 'not acknowledged: it lost its connection at {}',
    NOT_KNOWN: 'not known: the rules cannot follow the record after {}',
}
"""Why there is no acknowledgement, by what the kart was sent next; otherwise `TOLD_ELSE`."""

TOLD_ELSE = 'not acknowledged before it was sent another state, at {}'

MOST_OF_A_NAME = 80
"""Maximum length of an official's or a team's name, in characters. The list of events has the full
name."""


def name(text: str) -> str:
    """Return an untrusted name, shortened to fit into a line."""
    seen = plain(text)
    return seen if len(seen) <= MOST_OF_A_NAME else f'{seen[:MOST_OF_A_NAME]}…'


def command(kind: CommandKind | None, kart: int = 0) -> str:
    label = CATALOGUE[kind].label if kind else 'a command'
    return f'{label}, kart {kart}' if kart else label


class Clock:
    """
    The wall clock of the report, in the time zone of the machine that makes it.

    :param began_ns: wall time of second 0, in ns since the epoch.
    """

    def __init__(self, began_ns: int) -> None:
        self.began_ns = began_ns
        offset = datetime.datetime.fromtimestamp(began_ns / 1e9).astimezone().utcoffset()
        self.zone = datetime.timezone(offset or datetime.timedelta(0))

    def moment(self, wall_ns: int) -> datetime.datetime:
        return datetime.datetime.fromtimestamp(wall_ns / 1e9, self.zone)

    def time(self, wall_ns: int, digits: int = 0) -> str:
        """Return the time of day."""
        # Round to the millisecond first, as everywhere, so that the same time looks the same.
        unit = 10 ** (3 - digits)
        second, rest = divmod((_milliseconds(wall_ns) + unit // 2) // unit, 10**digits)
        return f'{self.moment(second * 10**9):%H:%M:%S}' + (f'.{rest:0{digits}}' * bool(digits))

    def at(self, seconds: float, digits: int = 0) -> str:
        """Return the time of day, some seconds after the beginning."""
        return self.time(self.wall_ns(seconds), digits)

    def wall_ns(self, seconds: float) -> int:
        """Return the wall time some seconds after the beginning, in ns, to the millisecond."""
        return (_milliseconds(self.began_ns) + round(seconds * 1000)) * 1_000_000

    def day(self, wall_ns: int) -> str:
        moment = self.moment(wall_ns)
        return f'{moment:%A}, {moment.day} {moment:%B %Y}'


def answers(stop: Stop, told: StopAnswer, clock: Clock) -> tuple[str, str, str, str]:
    """
    Return what a kart was sent at a stop, and its answers, as four cells of a table.

    They say what it was sent, how long its kernel took to answer, when the kart acknowledged it,
    and how long that took.
    """
    band = told.band
    if band.what == NOT_CONNECTED:
        return 'nothing: it was not connected', '', '', ''
    if band.what == NOT_KNOWN:
        return STATES[NOT_KNOWN], '', '', ''
    what, arrived = STATES[band.what], 'not seen'
    if band.start < stop.event.at:
        what += f', already since {clock.at(band.start, 3)}'
    if band.delivered is not None:
        arrived = duration(band.delivered - band.start, 3)
    if band.acknowledged is not None:
        at = clock.at(band.acknowledged, 3)
        return what, arrived, at, duration(band.acknowledged - band.start, 3)
    silence = SILENCES.get(told.then, TOLD_ELSE)
    return what, arrived, silence.format(clock.at(band.end, 3)), ''


def _milliseconds(ns: int) -> int:
    return (ns + 500_000) // 1_000_000


def why_out(out: Out, clock: Clock) -> str:
    """Return why a kart has no place, and when that was."""
    when = '' if out.why in (Why.STILL_RACING, Why.NOT_KNOWN) else f' at {clock.at(out.at, 3)}'
    return f'{out.why.value}{when}'
