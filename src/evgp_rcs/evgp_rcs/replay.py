# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Runs the rules again on what went into them, and compares what comes out with the record.

With the rules that made the record nothing may differ, ever: not an order to a kart, not an event
nor its time. What differs first is named.

An event has the time of the input that made it, to the last bit. No input gives the wall times,
and none makes the events `OF_THE_SERVER`: of these, only the order can be checked. So a step of
the wall clock is told; whether somebody set the clock or changed the record, nothing here can say.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
import contextlib
import dataclasses
from dataclasses import dataclass
import itertools
from typing import NamedTuple

from evgp_rcs import inputs
from evgp_rcs.inputs import Entry, GapError, Input, InputsError, Setup
from evgp_rcs.plain import plain
from evgp_rcs.race import EventKind, Order, StampedEvent
from evgp_rcs.record import RecordedEvent, rules_version, Session
from evgp_rcs.report.model import Account, clock_steps, OF_THE_SERVER, read
from evgp_rcs.runs import (
    add_run_arguments,
    CALLED,
    DONE,
    FAILED,
    open_runs,
    PARTLY,
    Runs,
    UnreadableError,
    watched,
)

LONGEST = 400
"""Maximum length of a value in words, in characters."""


class Difference(NamedTuple):
    """
    What of the record and its replay differs, and after which input: its time (s), number, words.

    :param at: seconds since the run began.
    :param number: counts the inputs, from 1; 0: before the first.
    """

    at: float
    number: int
    given: str
    what: str
    recorded: str
    replayed: str

    def __str__(self) -> str:
        """Return it in three lines."""
        return (
            f'The first difference is {self.what}, {self.at:.6f} s after the run began, at input '
            f'{self.number} ({self.given})\n'
            f'  the record has:  {self.recorded}\n'
            f'  the rules give:  {self.replayed}'
        )


@dataclass
class Replayed:
    """
    What a replay has compared.

    :param seconds: up to when, since the run began.
    :param missing: why it could not go on to the end, as a sentence; empty: it could.
    """

    inputs: int = 0
    orders: int = 0
    events: int = 0
    seconds: float = 0.0
    difference: Difference | None = None
    missing: str = ''

    def __str__(self) -> str:
        """Return the counts."""
        return (
            f'{self.inputs} inputs in {self.seconds:.1f} s: {self.orders} orders and '
            f'{self.events} events compared'
        )


class _EndError(Exception):
    """The replay ends here: something differs, or an event cannot be read."""


class Replay:
    """
    One run of the rules on recorded inputs.

    :param setup: with what the rules began.
    :param blocks: what went into them, each block with its number and compressed.
    :param happened: the events of the record.
    :param goes_on: the record is being written, and may have newer events than inputs.
    :param damaged: the record is damaged: an event that is missing could not be read.
    """

    def __init__(
        self,
        setup: Setup,
        blocks: Sequence[tuple[int, bytes]],
        happened: Sequence[RecordedEvent],
        goes_on: bool = False,
        damaged: bool = False,
    ) -> None:
        """Begin as the race did."""
        self._race = setup.race()
        self._began = setup.now
        self._blocks = blocks
        self._in_order = happened
        self._recorded = {event.sequence: event for event in happened}
        self._goes_on = goes_on
        self._damaged = damaged
        # Of the last input: what it was, and what it made that was not compared yet.
        self._given: Input | None = None
        self._orders: Sequence[Order] = ()
        self._events: _Made = []
        self._told = 0
        self._replayed = Replayed()

    def run(self) -> Replayed:
        """Return what was compared, up to the first difference."""
        with contextlib.suppress(_EndError):
            for entry in self._entries():
                if isinstance(entry, inputs.Ordered):
                    self._compare_orders(entry)
                elif isinstance(entry, inputs.Told):
                    self._compare_events(entry)
                elif not isinstance(entry, inputs.Shown):
                    self._feed(entry)
            self._finish()
            self._compare_the_rest()
        return self._replayed

    def _entries(self) -> Iterator[Entry]:
        """Yield what is there without a gap."""
        try:
            yield from inputs.entries_of(watched(self._blocks, len(self._blocks), 'Replaying'))
        except GapError:
            self._stop_at('inputs are missing (the disk took none, or they were removed)')
        except InputsError as error:
            self._differ('an input', str(error), 'they cannot run on it')

    def _feed(self, given: Input) -> None:
        self._finish()
        self._given = given
        self._replayed.inputs += 1
        self._replayed.seconds = given.at - self._began
        try:
            outcome = inputs.feed(given, self._race)
            self._orders = outcome.orders
            # What the record should have: an event has the time of its input.
            stamped = (StampedEvent(0, 0, given.at, event) for event in outcome.events)
            self._events = [(RecordedEvent.of(each), each.event.chatter) for each in stamped]
        except Exception as error:  # noqa: BLE001 - whatever the rules raise is a difference
            self._differ('an error of the rules', 'it was taken', repr(error))

    def _finish(self) -> None:
        """Take it that the last input has brought about nothing more."""
        if self._orders:
            self._differ('an order', 'none', _order(self._orders[0]))
        self._compare_untold(self._events)
        self._events = []

    def _compare_orders(self, mark: inputs.Ordered) -> None:
        orders, self._orders = self._orders, ()
        for recorded, replayed in itertools.zip_longest(mark.orders, orders):
            if recorded != replayed:
                self._differ('an order', _order(recorded), _order(replayed))
            self._replayed.orders += 1

    def _compare_events(self, mark: inputs.Told) -> None:
        made, self._events = self._events, []
        left = list(made)
        for sequence in range(mark.first, mark.last + 1):
            name = f'event {sequence}'
            recorded = self._recorded.pop(sequence, None)
            if recorded is None and self._damaged:
                self._stop_at(f'{name} cannot be read')
                raise _EndError
            if recorded is None:
                self._differ(name, 'it is missing', _words(left))
                return
            what = dataclasses.replace(recorded, sequence=0, wall_ns=0)
            # What karts say too often is left out.
            while left and left[0][1] and left[0][0] != what:
                left.pop(0)
            if not left or left[0][0] != what:
                self._differ(name, _words([(what, False)]), _words(left or made))
            left.pop(0)
            self._replayed.events += 1
            self._told = sequence
        self._compare_untold(left)

    def _compare_untold(self, left: _Made) -> None:
        for event, chatter in left:
            if not chatter:
                self._differ('an event', 'none', _words([(event, False)]))

    def _stop_at(self, why: str) -> None:
        self._replayed.missing = (
            f'{why}: nothing can be compared from {self._replayed.seconds:.1f} s after the run '
            'began on'
        )

    def _compare_the_rest(self) -> None:
        """Look for events that no input has made, and for such as were removed or moved."""
        for before, event in itertools.pairwise(self._in_order):
            if event.monotonic < before.monotonic:
                what = f'its time is {event.monotonic!r}'
                least = f'not before event {before.sequence}, {before.monotonic!r}'
                self._differ(f'event {event.sequence}', what, least)
        partly = self._goes_on or self._damaged or self._replayed.missing
        for sequence, event in sorted(self._recorded.items()):
            if partly and sequence > self._told:
                return
            own = event.kind in OF_THE_SERVER or (
                event.kind == EventKind.ALERT_RAISED.name and not event.success
            )
            if not own:
                self._differ(f'event {sequence}', _words([(event, False)]), 'no input has made it')

    def _differ(self, what: str, recorded: str, replayed: str) -> None:
        self._replayed.difference = Difference(
            self._replayed.seconds,
            self._replayed.inputs,
            _input(self._given),
            what,
            _cut(recorded),
            _cut(replayed),
        )
        raise _EndError


_Made = list[tuple[RecordedEvent, bool]]
"""Events that the rules make, with neither number nor wall time; of each, if it is chatter."""


def _words(events: _Made) -> str:
    """Return the first of these events in words."""
    for event, _ in events:
        named = list(dataclasses.asdict(event).items())[2:]
        return ', '.join(f'{name} {value!r}' for name, value in named if value not in (None, ''))
    return 'no such event'


def _order(order: Order | None) -> str:
    if order is None:
        return 'none'
    return f'kart {order.kart} is sent {order.state.value}, order {order.serial}'


def _input(given: Input | None) -> str:
    if given is None:
        return 'the beginning'
    _, *fields = given._asdict().items()
    words = (f'{name} {getattr(value, "name", None) or repr(value)}' for name, value in fields)
    return _cut(', '.join([type(given).__name__, *words]))


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST else f'{text[:LONGEST]}...'


@dataclass(frozen=True)
class Kept:
    """
    What a record has of a run.

    :param goes_on: race control still writes it.
    :param rules: the version of the rules that made it; empty: unknown.
    :param setup: with what the rules began; None: that cannot be read.
    :param lacks: why it cannot be replayed, as the rest of a sentence; empty: it can.
    :param blocks: what went into the rules.
    """

    run: Session
    goes_on: bool
    rules: str
    setup: Setup | None
    lacks: str
    blocks: Sequence[tuple[int, bytes]]
    happened: Sequence[RecordedEvent]
    damaged: bool

    @staticmethod
    def read(runs: Runs, run: Session, inputs_too: bool = True) -> Kept:
        """Read a run; what is damaged of it, it has not."""
        rules, text = runs.setup(run)
        # Inputs first: what is written meanwhile are events that no input here has made.
        blocks = runs.inputs(run) if text and inputs_too else []
        happened = runs.events(run)
        setup, lacks = None, 'the record does not have what went into the rules'
        if text:
            try:
                setup, lacks = Setup.read(text), ''
            except InputsError as error:
                lacks = str(error)
        elif runs.damage:
            lacks = f'the record is damaged ({runs.damage})'
        goes_on = run is runs.present
        return Kept(run, goes_on, rules, setup, lacks, blocks, happened, bool(runs.damage))

    def account(self) -> Account:
        """Return what its events say."""
        if self.setup is None:
            return read(self.happened)
        return read(self.happened, {kart.number: kart.team for kart in self.setup.karts})

    def replay(self) -> Replayed:
        """
        Replay it.

        :raises UnreadableError: if its inputs are not there.
        """
        if self.setup is None:
            raise UnreadableError(f'run {self.run.number} cannot be replayed: {self.lacks}')
        return Replay(self.setup, self.blocks, self.happened, self.goes_on, self.damaged).run()

    def judge(self) -> tuple[int, list[str]]:
        """
        Replay it.

        :return: `DONE`, `FAILED` if anything differs, or `PARTLY`; and what there is to say, line
            by line.
        :raises UnreadableError: if its inputs are not there.
        """
        lines = []
        here = rules_version()
        if self.rules != here:
            lines.append(
                f'Run {self.run.number} was recorded with other rules (version '
                f'{self.rules or "unknown"}; here {here or "unknown"}): a difference may come '
                'from that.'
            )
        replayed = self.replay()
        difference = replayed.difference
        found = 'no' if difference is None else 'a'
        lines.append(f'Run {self.run.number}: {replayed}: {found} difference')
        if difference is not None:
            return FAILED, [*lines, *str(difference).split('\n')]
        steps = clock_steps(self.happened)
        if steps:
            lines.append(
                f'The wall clock was set {len(steps)} times, first by {steps[0].by:+.3f} s before '
                f'event {steps[0].sequence}; or somebody changed the wall times in the record, '
                'which a replay cannot tell.'
            )
        if replayed.missing:
            return PARTLY, [*lines, f'Not all of it: {replayed.missing}']
        if self.goes_on:
            lines.append('Race control still writes this run; it was replayed up to now.')
        elif self.run.ended_ns is None:
            lines.append(
                'This run was not ended in good order; it was replayed up to its last entry.'
            )
        return DONE, lines


def options() -> argparse.ArgumentParser:
    """Return what reads the command line of `rcs_record replay`."""
    parser = argparse.ArgumentParser(
        prog=f'{CALLED} replay',
        description='Run the rules again on what went into them in a run, the newest by default, '
        'and compare every order to a kart and every event with the record, each event with its '
        'time. A run that goes on is replayed up to now, one that '
        'crashed up to its end.',
        epilog='No input gives the wall times, and none makes the events of the server itself '
        '(refused connections, messages that mean nothing, the end): of these, only the order is '
        'checked. Exit code 0: no difference; 1: the first difference is printed; 2: the run '
        'cannot be read, or was recorded without its inputs; 3: no difference, but not all of the '
        'run could be replayed.',
    )
    add_run_arguments(parser)
    return parser


def main(arguments: Sequence[str]) -> int:
    """
    Replay a run, and print what was compared and what differs first.

    :return: the exit code.
    :raises UnreadableError: if the record or the run cannot be read, or has no inputs.
    """
    wanted = options().parse_args(arguments)
    with open_runs(wanted.file) as runs:
        kept = Kept.read(runs, runs.choose(wanted.run))
    # With the record closed: this may take long, and race control must not wait.
    code, lines = kept.judge()
    print('\n'.join(map(plain, lines)))
    return code or runs.code
