# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Runs the rules again on the inputs of a stream, and compares the outputs with the stream.

With the rules that made the record, nothing may differ: no order to a kart, no event, and no time
of an event. The replay names the first difference. `Replay.steps` is also the only account of what
happened in a run: iterate over it and inspect the race.

An event has exactly the time of the input that caused it. The events `OF_THE_SERVER` are not
caused by inputs, so only their number and order can be checked. Inputs contain no wall times: the
replay reports steps of the wall clock, but cannot know whether somebody set the clock or changed
the record.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import NamedTuple, NoReturn

from evgp_node.stream import Began, Gap
from evgp_rcs.record.plain import plain
from evgp_rcs.record.runs import (
    DONE,
    FAILED,
    Kept,
    open_runs,
    PARTLY,
    UnreadableError,
)
from evgp_rcs.record.store import rules_version
from evgp_rcs.rules import inputs
from evgp_rcs.rules.inputs import Entry, Input, Ordered, Rules
from evgp_rcs.rules.race import Event, EventKind, Order, Outcome, Race, StampedEvent

OF_THE_SERVER = frozenset({EventKind.MALFORMED, EventKind.REFUSED_CONNECTION, EventKind.ENDED})
"""Kinds of events that the rules do not produce."""

LONGEST = 400
"""Maximum length of a value as text, in characters."""

MOST_CLOCK_STEP = 0.1
"""Maximum difference between the two clocks, from one event to the next, that does not count as a
step, in seconds."""


class Difference(NamedTuple):
    """A difference between a record and its replay, in the value that ``what`` names."""

    what: str
    recorded: str
    replayed: str


class ClockStep(NamedTuple):
    """A step of the wall clock against the rules' clock since the previous event, by seconds."""

    event: StampedEvent
    by: float


@dataclass
class Step:
    """
    An entry of a stream that is not itself a result, with its results.

    :param entry: an input, an event of the server, a snapshot that was shown, a gap or, at the
        beginning, the setup.
    :param events: the events in the stream that the entry caused, and the entry itself if it is
        an event.
    :param race: the race after the entry; None if only the stream is known from here on.
    :param outcome: what the rules make of the entry, if it is an input that they confirm.
    """

    entry: Entry | Gap | None
    events: list[StampedEvent] = field(default_factory=list)
    orders: list[Order] = field(default_factory=list)
    race: Race | None = None
    outcome: Outcome | None = None


def _with_results(entries: Iterator[Entry | Gap]) -> Iterator[Step]:
    """Yield the entries of a stream, each with the results that follow it there."""
    step = Step(None)
    for entry in entries:
        if isinstance(entry, Ordered):
            step.orders += entry.orders
        elif isinstance(entry, StampedEvent) and entry.event.kind not in OF_THE_SERVER:
            step.events.append(entry)
        else:
            yield step
            step = Step(entry, [entry] if isinstance(entry, StampedEvent) else [])
    yield step


class _EndError(Exception):
    """The rest of the stream cannot be compared."""


class Replay:
    """
    One run of the rules on a stream. `steps` fills in the results.

    :ivar rules: the setup of the rules; None if it is missing.
    :ivar inputs: number of inputs up to the end of the replay, or up to the first difference.
    :ivar seconds: time since the run began, up to which the stream was compared, in seconds.
    :ivar missing: a clause that says why the replay ended early; empty if it did not.
    """

    def __init__(self, kept: Kept) -> None:
        self.kept = kept
        self.rules: Rules | None = None
        self.inputs = self.orders = self.events = 0
        self.seconds = 0.0
        self.difference: Difference | None = None
        self.missing = ''
        self.clock_steps: list[ClockStep] = []
        self._race: Race | None = None
        self._given: Input | None = None  # the last one that the rules got
        self._last: StampedEvent | None = None

    def __str__(self) -> str:
        return (
            f'{self.inputs} inputs in {self.seconds:.1f} s: {self.orders} orders and '
            f'{self.events} events compared'
        )

    @property
    def lacks(self) -> str:
        """Return a clause that says why the race becomes unknown; empty if it is known."""
        if self.difference is not None:
            return f'the rules do not confirm the record ({self.difference.what} differs)'
        return self.missing or ('' if self.rules else 'the setup of the rules is missing')

    def run(self) -> Replay:
        """Go through all steps."""
        for _ in self.steps():
            pass
        return self

    def steps(self) -> Iterator[Step]:
        """Yield the run step by step; once the race is unknown, only its events and gaps."""
        for step in _with_results(self.kept.entries()):
            try:
                outcome = self._follow(step.entry)
                self._compare(step, outcome or Outcome((), ()))
                step.race, step.outcome = self._race, outcome
            except _EndError:
                self._race = None
            if step.race is not None or step.events or isinstance(step.entry, Gap):
                yield step

    # ----- following the stream -----------------------------------------------------------

    def _follow(self, entry: Entry | Gap | None) -> Outcome | None:
        """Give an entry to the rules, and return what they make of it if it is an input."""
        if isinstance(entry, Gap):
            self._stop_at(entry)
        elif isinstance(entry, Rules) and self.rules is None and not self.missing:
            self.rules, self._race = entry, entry.setup.race(self.kept.run.id)
        elif self._race is None:
            return None
        elif isinstance(entry, Rules | Began):
            self._differ('an entry', type(entry).__name__, 'the run has begun already')
        elif isinstance(entry, Input):
            return self._feed(entry, self._race)
        return None

    def _stop_at(self, gap: Gap) -> NoReturn:
        if self._race is None:
            self.missing = self.missing or str(gap)
        elif gap.damaged:
            self._differ('an entry', gap.why, 'they cannot continue after it')
        else:
            self.missing = f'{gap}. Nothing after {self.seconds:.1f} s of the run can be compared'
        raise _EndError

    def _feed(self, given: Input, race: Race) -> Outcome:
        assert self.rules is not None
        self.inputs += 1
        seconds = given.at - self.rules.setup.now
        if seconds < self.seconds:
            self._differ('an input', f'its time is {given.at!r}', 'times do not go back')
        self._given, self.seconds = given, seconds
        try:
            return inputs.feed(given, race)
        except Exception as error:  # noqa: BLE001 - any error of the rules is a difference
            self._differ('the result of an input', 'no error', repr(error))

    # ----- comparing ----------------------------------------------------------------------

    def _compare(self, step: Step, outcome: Outcome) -> None:
        """Compare the results of an entry with what the rules make of it."""
        made = iter(outcome.events)
        for stamped in step.events:
            self._look_at_its_place(stamped)
            if self._race is not None and stamped is not step.entry:
                self._compare_event(stamped, made, step.entry)
        for event in made:
            if not event.chatter:
                self._differ('an event', 'none', _fields(event))
        if self._race is not None:
            for recorded, replayed in zip_longest(step.orders, outcome.orders):
                if recorded != replayed:
                    self._differ('an order', _order(recorded), _order(replayed))
                self.orders += 1

    def _look_at_its_place(self, entry: StampedEvent) -> None:
        """Compare the number and times of an event with those of the previous event."""
        before, self._last = self._last, entry
        number = 1 if before is None else before.sequence + 1
        before = before or entry
        by = (entry.wall_ns - before.wall_ns) / 1e9 - entry.monotonic + before.monotonic
        if abs(by) > MOST_CLOCK_STEP:
            self.clock_steps.append(ClockStep(entry, by))
        if self._race is not None and entry.sequence != number:
            what = f'event {entry.sequence} instead'
            self._differ(f'event {number}', what, f'event {number}')
        if self._race is not None and entry.monotonic < before.monotonic:
            what = f'its time is {entry.monotonic!r}'
            least = f'not before event {before.sequence}, {before.monotonic!r}'
            self._differ(f'event {number}', what, least)

    def _compare_event(
        self, entry: StampedEvent, made: Iterator[Event], cause: Entry | Gap | None
    ) -> None:
        name = f'event {entry.sequence}'
        # If karts cause too many events, the server omits some of them.
        event = next((each for each in made if not each.chatter or each == entry.event), None)
        if event is None or event != entry.event:
            self._differ(name, _fields(entry.event), _fields(event) if event else 'no such event')
        if isinstance(cause, Input) and entry.monotonic != cause.at:
            self._differ(name, f'time {entry.monotonic!r}', f'time {cause.at!r}')
        self.events += 1

    def _differ(self, what: str, recorded: str, replayed: str) -> NoReturn:
        self.difference = Difference(what, _cut(recorded), _cut(replayed))
        raise _EndError

    # ----- the verdict --------------------------------------------------------------------

    def judge(self) -> tuple[int, list[str]]:
        """
        Return the verdict after `steps` or `run`, as an exit code and lines of text.

        :return: `FAILED` if anything differs, `PARTLY` if the replay is incomplete, or `DONE`.
        :raises UnreadableError: if the stream lacks the setup of the rules.
        """
        run = self.kept.run
        if self.rules is None:
            raise UnreadableError(
                f'run {run.number} cannot be replayed, because the record lacks the setup of the '
                f'rules{f" ({self.missing})" if self.missing else ""}'
            )
        lines = []
        here, there = rules_version(), self.rules.version
        if there != here:
            lines.append(
                f'Run {run.number} was recorded with other rules (version {there or "unknown"}; '
                f'here {here or "unknown"}), which may explain a difference.'
            )
        found = 'no' if self.difference is None else 'a'
        lines.append(f'Run {run.number}: {self}: {found} difference')
        if self.difference is not None:
            what, recorded, replayed = self.difference
            return FAILED, [
                *lines,
                f'The first difference is {what}, {self.seconds:.6f} s after the run began, at '
                f'input {self.inputs} ({_input(self._given)})',
                f'  the record has:  {recorded}',
                f'  the rules give:  {replayed}',
            ]
        if self.clock_steps:
            steps = self.clock_steps
            lines.append(
                f'The wall clock was set {len(steps)} times, first by {steps[0].by:+.3f} s before '
                f'event {steps[0].event.sequence}, or somebody changed the wall times in the '
                'record. A replay cannot tell which.'
            )
        if self.missing:
            return PARTLY, [*lines, f'The replay is incomplete: {self.missing}']
        if run.goes_on:
            lines.append('Race control is still writing this run, which was replayed up to now.')
        elif run.ended_ns is None:
            lines.append('This run did not end normally. It was replayed up to its last entry.')
        return DONE, lines


def _order(order: Order | None) -> str:
    if order is None:
        return 'none'
    return f'kart {order.kart} is sent {order.state.value}, order {order.serial}'


def _input(given: Input | None) -> str:
    return 'the beginning' if given is None else f'{type(given).__name__}, {_fields(given)}'


def _fields(value: Input | Event) -> str:
    named = ((name, each) for name, each in value._asdict().items() if name != 'at')
    said = [
        f'{name} {getattr(each, "name", None) or repr(each)}'
        for name, each in named
        if each is not None and each != ''
    ]
    return _cut(', '.join(said))


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST else f'{text[:LONGEST]}...'


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options and the help of `rcs_record replay` to a parser."""
    parser.description = (
        'Run the rules again on the inputs of a run (default: the newest), and '
        'compare every order to a kart, and every event with its time, with the record. A run '
        'that is still going on is replayed up to now, and one that crashed up to its last entry.'
    )
    parser.epilog = (
        'Wall times are not checked. Of the events that the server itself causes (refused '
        'connections, malformed messages, the end), only number and order are checked. The exit '
        'codes are those of rcs_record.'
    )


def main(wanted: argparse.Namespace) -> int:
    """Replay a run, and print what was compared and the first difference."""
    with open_runs(wanted.file) as runs:
        kept = runs.read(runs.choose(wanted.run))
    code, lines = Replay(kept).run().judge()
    print('\n'.join(map(plain, lines)))
    return code or runs.code
