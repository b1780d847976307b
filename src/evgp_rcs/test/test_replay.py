# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A replay finds no difference with the same rules, and names the first one with others."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
import itertools
import math
import pathlib
import random
import sqlite3
from typing import Any

from evgp_protocol.states import RaceState
from evgp_rcs import inputs
from evgp_rcs import race as rules
from evgp_rcs.catalogue import CATALOGUE
from evgp_rcs.inputs import Block, Entrant, Log, Setup
from evgp_rcs.laps import Passing
from evgp_rcs.race import (
    Attendance,
    Command,
    Event,
    EventKind,
    Heat,
    Outcome,
    RaceTimes,
    StampedEvent,
    StartPhase,
)
from evgp_rcs.rcs_record import main
from evgp_rcs.record import Record, RecordedEvent, rules_version
from evgp_rcs.replay import Replay, Replayed
import pytest
from rig.faults import module_with

PATIENCE = 20.0
KARTS = range(1, 5)
BEGAN = 1_780_135_500_000_000_000
SETUP = Setup(
    tuple(Entrant(number, f'Team {number}', number < 4) for number in KARTS),
    RaceTimes(
        min_lap_time=0.5,
        auto_finish=True,
        finish_delays=(0.5,),
        finish_stop=2.0,
        pause=0.3,
        pause_after_held_up=0.5,
        nobody_there=1.0,
    ),
    (Heat('first', (1, 2), laps=2), Heat('second', (3, 4))),
    now=1000.1,
)


class Running:
    """
    A race that is fed at random, logged as the kart server does it, and what it told.

    :param recovered: what an earlier run has left behind.
    """

    def __init__(self, seed: int, recovered: rules.RaceMemory | None = None) -> None:
        self.chance = random.Random(seed)
        self.race = SETUP.race()
        self.now = SETUP.now
        self.log = Log()
        self.stamped: list[StampedEvent] = []
        self.handed_over: list[tuple[list[StampedEvent], Block]] = []
        if recovered is not None:
            self.feed(inputs.Recovered(self.now, recovered, rules.LastRun.UNKNOWN))
        for number in KARTS:
            self.feed(inputs.Connected(self.now, number))

    def run(self, steps: int) -> Running:
        for _ in range(steps):
            self.now += self.chance.choice((0.0, 1e-6, 0.05, 0.05, 0.3, 1.0))
            self.feed(self.anything())
            if self.chance.random() < 0.3:
                self.show()
        self.handed_over.append(([], self.log.take()))
        return self

    def feed(self, given: inputs.Input) -> None:
        self.log.add(given)
        outcome = inputs.feed(given, self.race)
        if outcome.orders:
            self.log.add(inputs.Ordered(outcome.orders))
        self.tell(outcome, given.at)

    def tell(self, outcome: Outcome, at: float) -> None:
        told = [each for each in outcome.events if not each.chatter or self.chance.random() < 0.5]
        if told:
            first = len(self.stamped) + 1
            self.log.add(inputs.Told(first, first + len(told) - 1))
            self.hand_over(told, at)
        if self.chance.random() < 0.05:
            own = self.chance.choice((EventKind.MALFORMED, EventKind.REFUSED_CONNECTION))
            self.hand_over([Event(own, 'rubbish', success=False)], self.now)

    def hand_over(self, events: list[Event], at: float) -> None:
        first = len(self.stamped) + 1
        stamped = [
            StampedEvent(number, BEGAN + round(at * 1e9), at, event)
            for number, event in enumerate(events, first)
        ]
        self.stamped += stamped
        self.handed_over.append((stamped, self.log.take()))

    def show(self) -> None:
        self.log.add(inputs.Shown(self.now))

    def anything(self) -> inputs.Input:
        kart = self.race.karts[self.chance.choice(KARTS)]
        what = self.chance.random()
        if what < 0.25:
            state = kart.sent if self.chance.random() < 0.8 else self.chance.choice([*RaceState])
            serial = kart.serial if self.chance.random() < 0.9 else 0
            return inputs.Heard(self.now, kart.number, serial, state)
        if what < 0.45:
            return inputs.Tick(self.now)
        if what < 0.5:
            return inputs.Connected(self.now, kart.number)
        if what < 0.53:
            return inputs.Disconnected(self.now, kart.number, 'it was closed')
        if what < 0.54:
            number = self.chance.randrange(40)
            passing = Passing('line', 'today', number, self.chance.randrange(6), stamp_ns=number)
            return inputs.Passed(self.now, (passing,), 0)
        if what < 0.56:
            rare: tuple[inputs.Input, ...] = (
                inputs.HeldUp(self.now, 1.5),
                inputs.Rival(self.now, not self.race.has_rival),
                inputs.Attended(self.now, Attendance(self.chance.randrange(3), 'Anna (window)')),
                inputs.RecordTrouble(self.now, '' if self.race.record_fails else 'it fails'),
                inputs.StartBecame(self.now, StartPhase.WITHDRAWN, self.race.starts),
            )
            return self.chance.choice(rare)
        if self.race.start is not None:
            phase = StartPhase.WRITTEN if self.chance.random() < 0.9 else StartPhase.FAILED
            number = self.race.starts - (self.chance.random() < 0.1)
            return inputs.StartBecame(self.now, phase, number)
        return self.command(kart.number)

    def command(self, kart: int) -> inputs.Input:
        """Return a command, mostly one that would be accepted."""
        offers = [
            self.race.availability(kind, kart if entry.to_one_kart else 0, self.now)
            for kind, entry in CATALOGUE.items()
        ]
        offered = [each for each in offers if each.available or self.chance.random() < 0.2]
        each = self.chance.choice(offered)
        one = CATALOGUE[each.command].to_one_kart
        command = Command(
            each.command,
            kart if one else 0,
            self.chance.random() < 0.9,
            frozenset(each.karts),
            self.race.karts[kart].hold if one else None,
            self.chance.choice(('first', 'second', 'none')),
            self.chance.choice(('', 'Anna', '<b>')),
            'line',
            'today',
            self.chance.randrange(40),
            transponder='4711',
            seconds=5,
            disqualified=self.chance.random() < 0.1,
            reason='a short cut',
        )
        return inputs.Commanded(self.now, command, self.now - self.chance.choice((0.0, 0.1)))

    def end(self) -> Running:
        """Say that it has ended in good order, as the kart server does."""
        self.hand_over([Event(EventKind.ENDED, 'Race control ends')], self.now)
        return self

    # ----- what the record has of it ------------------------------------------------------

    def blocks(self) -> list[Block]:
        return [block for _, block in self.handed_over]

    def recorded(self) -> list[RecordedEvent]:
        return [RecordedEvent.of(each) for each in self.stamped]


def replayed(
    blocks: list[Block], happened: list[RecordedEvent], goes_on: bool = False
) -> Replayed:
    packed = [(number, block.compressed()) for number, block in enumerate(blocks, 1)]
    return Replay(SETUP, packed, happened, goes_on).run()


LEFT_BEHIND = rules.RaceMemory(
    RaceState.GREEN_GREEN,
    {
        1: rules.KartMemory(True, False, 1, rules.Doubt.MOVING, False),
        9: rules.KartMemory(True, True, 0, rules.Doubt.NONE, True),
    },
)


@pytest.mark.parametrize('recovered', [None, LEFT_BEHIND], ids=['anew', 'after a crash'])
@pytest.mark.parametrize('seed', range(20))
def test_a_race_that_is_replayed_with_its_own_rules_does_not_differ(
    seed: int, recovered: rules.RaceMemory | None
) -> None:
    running = Running(seed, recovered).run(800)
    found = replayed(running.blocks(), running.recorded())
    assert (found.difference, found.missing) == (None, '')
    assert found.inputs > 800
    assert found.orders > 20
    assert found.events > 100


def a_run(seed: int = 1) -> Running:
    return Running(seed).run(600)


def entries_of(running: Running) -> list[Any]:
    return [entry for block in running.blocks() for entry in inputs.decode(block.data)]


def replay_of(entries: list[Any], happened: list[RecordedEvent]) -> Replayed:
    return replayed([Block(0, b''.join(map(inputs.encode, entries)))], happened)


def last(kind: Any, things: list[Any]) -> int:
    """Return the place of the last entry of a type, or of the last event of a kind."""
    return max(
        n for n, each in enumerate(things) if kind in (type(each), getattr(each, 'kind', 0))
    )


Harm = Callable[[list[Any], list[RecordedEvent]], str]
"""Changes entries or events, and returns what must be named as different."""


def an_order_is_other(entries: list[Any], happened: list[RecordedEvent]) -> str:
    place = last(inputs.Ordered, entries)
    first, *rest = entries[place].orders
    entries[place] = inputs.Ordered((first._replace(serial=first.serial + 1), *rest))
    return 'an order'


def an_order_is_missing(entries: list[Any], happened: list[RecordedEvent]) -> str:
    del entries[last(inputs.Ordered, entries)]
    return 'an order'


def an_input_is_other(entries: list[Any], happened: list[RecordedEvent]) -> str:
    place, told = max(
        (place, after)
        for place, (each, after) in enumerate(itertools.pairwise(entries))
        if isinstance(each, inputs.Disconnected) and isinstance(after, inputs.Told)
    )
    entries[place] = entries[place]._replace(reason='another one')
    return f'event {told.first}'


def an_event_with(**change: Any) -> Harm:
    def harm(entries: list[Any], happened: list[RecordedEvent]) -> str:
        place = last('COMMAND', happened)
        happened[place] = dataclasses.replace(happened[place], **change)
        return f'event {place + 1}'

    return harm


def an_event_is_later_by_the_least_of_its_clock(
    entries: list[Any], happened: list[RecordedEvent]
) -> str:
    place, moved = max(
        (n, later)
        for n, (each, after) in enumerate(itertools.pairwise(happened))
        if (later := math.nextafter(each.monotonic, math.inf)) <= after.monotonic
        if each.kind == 'COMMAND'
    )
    happened[place] = dataclasses.replace(happened[place], monotonic=moved)
    return f'event {place + 1}'


def an_event_of_the_server_is_before_the_one_before_it(
    entries: list[Any], happened: list[RecordedEvent]
) -> str:
    place = last('MALFORMED', happened)
    earlier = happened[place - 1].monotonic - 1e-6
    happened[place] = dataclasses.replace(happened[place], monotonic=earlier)
    return f'event {place + 1}'


def an_event_is_missing(entries: list[Any], happened: list[RecordedEvent]) -> str:
    place = last('COMMAND', happened)
    del happened[place]
    return f'event {place + 1}'


def an_event_is_new(entries: list[Any], happened: list[RecordedEvent]) -> str:
    number = len(happened) + 1
    happened.append(dataclasses.replace(happened[-1], kind='COMMAND', sequence=number))
    return f'event {number}'


CHANGES = (
    *({'text': 'nothing happened'}, {'kart': 99}, {'official': 'somebody else'}),
    *({'command': 'RED_FLAG'}, {'success': 'neither'}, {'state': 'GREEN_GREEN?'}),
    *({'kind': 'RESULTS'}, {'alert': 'NONE'}, {'hold': 'RED_RED?'}, {'race': 99}, {'heat': '?'}),
)


@pytest.mark.parametrize(
    'harm',
    [
        an_order_is_other,
        an_order_is_missing,
        an_input_is_other,
        *(pytest.param(an_event_with(**each), id=next(iter(each))) for each in CHANGES),
        an_event_is_later_by_the_least_of_its_clock,
        an_event_of_the_server_is_before_the_one_before_it,
        an_event_is_missing,
        an_event_is_new,
    ],
)
def test_what_was_changed_is_named_with_its_time(harm: Harm) -> None:
    running = a_run()
    entries, happened = entries_of(running), running.recorded()
    what = harm(entries, happened)
    difference = replay_of(entries, happened).difference
    assert difference is not None
    assert difference.what == what
    assert difference.recorded != difference.replayed
    given = [each for each in entries if isinstance(each, inputs.Input)][difference.number - 1]
    assert difference.at == given.at - SETUP.now


FAULTS = {
    'an old acknowledgement counts': (
        'counts = state is kart.sent and serial == kart.serial',
        'counts = state is kart.sent',
    ),
    'a reason is other': ("f'{kart} is in the race already'", "f'the race has {kart} already'"),
    'the pause is longer': (
        "self._pause(now + self.times.pause, 'a stop was",
        "self._pause(now + 1.0, 'a stop was",
    ),
}


@pytest.mark.parametrize('name', FAULTS)
def test_a_change_of_the_rules_is_found_in_a_record_of_the_right_ones(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = [Running(seed).run(600) for seed in range(10)]
    faulty = module_with(rules, *FAULTS[name])
    monkeypatch.setattr(inputs, 'Race', faulty.Race)
    found = [replayed(run.blocks(), run.recorded()).difference for run in runs]
    assert any(found)


def test_rules_that_fail_are_a_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    running = a_run()

    def broken(*given: object) -> None:
        raise ZeroDivisionError('a fault put in by the test')

    monkeypatch.setattr(rules.Race, 'tick', broken)
    difference = replayed(running.blocks(), running.recorded()).difference
    assert difference is not None
    assert 'ZeroDivisionError' in difference.replayed


def test_where_inputs_are_missing_the_replay_ends_and_says_so() -> None:
    running = a_run()
    blocks = running.blocks()
    lost = len(blocks) // 2
    kept = [each for n, each in enumerate(blocks) if n != lost]
    found = replayed(kept, running.recorded())
    assert found.difference is None
    assert found.missing
    before = (entry for block in blocks[:lost] for entry in inputs.decode(block.data))
    assert found.inputs == sum(isinstance(entry, inputs.Input) for entry in before)


def test_a_record_that_goes_on_may_have_events_newer_than_its_inputs() -> None:
    running = a_run()
    blocks = running.blocks()[:-5]
    assert replayed(blocks, running.recorded(), goes_on=True).difference is None
    assert replayed(blocks, running.recorded()).difference is not None


# ----- on the disk ------------------------------------------------------------------------


@pytest.fixture
def path(tmp_path: pathlib.Path) -> pathlib.Path:
    return tmp_path / 'record.sqlite3'


Write = Callable[..., None]


@pytest.fixture
def write(path: pathlib.Path) -> Write:
    """Return a function that records a race."""

    def a_race(running: Running, rules: str = '', in_order: bool = True) -> None:
        record = Record(path)
        record.begin(rules or rules_version(), SETUP)
        if in_order:
            running.end()
        for events, block in running.handed_over:
            record.put(events, block)
        record.end()

    return a_race


Capture = pytest.CaptureFixture[str]


def test_a_record_is_replayed_without_a_difference(
    path: pathlib.Path, write: Write, capsys: Capture
) -> None:
    write(a_run())
    assert main(['replay', str(path)]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert line.endswith('no difference')


def test_any_run_of_a_record_can_be_replayed(path: pathlib.Path, write: Write) -> None:
    write(a_run(1))
    write(a_run(2))
    assert [main(['replay', str(path), '--run', run]) for run in ('1', '2')] == [0, 0]


def change(path: pathlib.Path, statement: str, *values: object) -> None:
    database = sqlite3.connect(path)
    database.execute(statement, values)
    database.commit()
    database.close()


def test_a_record_that_was_changed_is_not_replayed_without_a_word(
    path: pathlib.Path, write: Write, capsys: Capture
) -> None:
    write(a_run())
    change(path, "UPDATE event SET official = 'Eve' WHERE sequence = 3")
    assert main(['replay', str(path)]) == 1
    out = capsys.readouterr().out
    assert 'event 3' in out
    assert 'Eve' in out


def test_one_changed_byte_of_the_inputs_is_named(
    path: pathlib.Path, write: Write, capsys: Capture
) -> None:
    write(a_run())
    database = sqlite3.connect(path)
    ((data,),) = database.execute('SELECT data FROM input WHERE block = 1').fetchall()
    database.close()
    harmed = bytearray(data)
    harmed[len(harmed) // 2] ^= 1
    change(path, 'UPDATE input SET data = ? WHERE block = 1', bytes(harmed))
    assert main(['replay', str(path)]) == 1
    assert 'block 1' in capsys.readouterr().out


def test_a_record_of_other_rules_is_replayed_and_says_so(
    path: pathlib.Path, write: Write, capsys: Capture
) -> None:
    write(a_run(), rules='0123456789abcdef')
    assert main(['replay', str(path)]) == 0
    warning, _ = capsys.readouterr().out.splitlines()
    assert '0123456789abcdef' in warning


def test_a_record_that_was_cut_is_replayed_up_to_the_cut(
    path: pathlib.Path, write: Write, capsys: Capture
) -> None:
    running = a_run()
    half = len(running.handed_over) // 2
    del running.handed_over[half:]
    write(running, in_order=False)
    assert main(['replay', str(path)]) == 0
    counts, cut = capsys.readouterr().out.splitlines()
    assert counts.endswith('no difference')
    assert cut


def test_a_run_without_inputs_says_plainly_that_it_cannot_be_replayed(
    path: pathlib.Path, write: Write, capsys: Capture
) -> None:
    write(a_run())
    change(path, 'UPDATE session SET setup = NULL')
    assert main(['replay', str(path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert 'what went into the rules' in line
    assert main(['show', str(path)]) == 0


def test_wall_times_that_were_moved_are_told_and_are_no_difference(
    path: pathlib.Path, write: Write, capsys: Capture
) -> None:
    running = a_run()
    write(running)
    number = len(running.stamped) // 2
    change(path, 'UPDATE event SET wall_ns = wall_ns - 600000000 WHERE sequence = ?', number)
    assert main(['replay', str(path)]) == 0
    counts, told = capsys.readouterr().out.splitlines()
    assert counts.endswith('no difference')
    assert f'event {number};' in told


def test_the_version_of_the_rules_is_16_hexadecimal_digits_and_always_the_same() -> None:
    version = rules_version()
    assert len(version) == 16
    assert int(version, 16) >= 0
    assert version == rules_version()
