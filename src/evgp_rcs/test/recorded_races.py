# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Records of races that nobody drove: the real rules and the real record, karts on paper."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Sequence
import contextlib
import csv
import itertools
import pathlib
import random
import re
import secrets
import sqlite3
from typing import Any, cast

from evgp_node.results import Corrected, Standings
from evgp_node.stream import Began, Block, Gap, Stream
from evgp_node.stream_file import blocks_of, BOOK, open_for_writing, WRITE_BLOCK
from evgp_protocol.link import Grade, GRADES
from evgp_protocol.states import RaceState
from evgp_rcs.rcs_record import main as rcs_record
from evgp_rcs.record.report.model import Account, Happened
from evgp_rcs.record.runs import DONE, Kept, open_runs
from evgp_rcs.record.store import Record, rules_version, Session
from evgp_rcs.rules import inputs
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.inputs import Batch, encode, Entrant, entries_of, Entry, Log, Rules, Setup
from evgp_rcs.rules.link_quality import NOT_MEASURED
from evgp_rcs.rules.race import (
    Attendance,
    Command,
    Doubt,
    Event,
    EventKind,
    Heat,
    KartMemory,
    LastRun,
    Outcome,
    Race,
    RaceMemory,
    RaceTimes,
    Roster,
    StampedEvent,
)

BEGAN = 1_780_135_500_000_000_000
"""When each of these runs begins, ns since the epoch: an afternoon in May 2026."""


def as_seen(race: Race, kind: CommandKind, kart: int, now: float, /, **fields: Any) -> Command:
    """
    Return a command of an official who sees the race as it is, and states what it takes.

    :param fields: what the command has besides, or instead.
    """
    mine = race.karts.get(kart) if CATALOGUE[kind].to_one_kart else None
    is_known = mine is not None or not CATALOGUE[kind].to_one_kart
    karts = race.availability(kind, kart, now).karts if is_known else ()
    hold = None if mine is None else mine.hold
    seen = {'opening': race.opening, 'reading': race.reading}
    return Command(kind, kart, True, frozenset(karts), hold, **seen)._replace(**fields)


NO_PAUSE = RaceTimes(pause=0.0, settle_time=0.0)
"""So that a test can have a stop, its acknowledgement and a release at the same instant."""

NEWS: dict[str, inputs.Input] = {
    'rival': inputs.Rival(0.0, True),
    'two programs': inputs.Contested(0.0, 1, True),
    'full disk': inputs.RecordTrouble(0.0, 'The disk is full'),
    'no cable': inputs.CutOff(0.0, 'eth0 has no cable'),
    'anna': inputs.Attended(0.0, Attendance(1, 'Anna (window)')),
    'nobody': inputs.Attended(0.0, Attendance()),
    'late reader': inputs.Measured(
        0.0, 1, NOT_MEASURED._replace(grade=Grade.POOR, worst_answer=0.01, behind=1.2)
    ),
}
"""What may happen besides, in a story of `PaperRace`."""


class PaperRace:
    """
    A race whose karts answer as they are told here, and its events.

    :param teams: the teams of the karts in the race, by number.
    :param heats: the heats of the roster.
    :param setup: in the place of these: with what the rules begin.
    """

    def __init__(
        self, teams: dict[int, str], heats: Sequence[Heat] = (), setup: Setup | None = None
    ) -> None:
        karts = tuple(Entrant(number, team, True) for number, team in teams.items())
        self.setup = setup or Setup(karts, RaceTimes(), tuple(heats), 100.0)
        self.race = self.setup.race(secrets.token_hex(8))
        self.now = self.setup.now
        self.wall_offset_ns = BEGAN - round(self.now * 1e9)
        self.stamped: list[StampedEvent] = []
        self.log = Log()
        self.batches: list[Batch] = []
        self._sequence = itertools.count(1)
        self.saves_at_once = True
        self._saved = 0

    def feed(self, given: inputs.Input) -> Outcome:
        """Feed and log an input, as the kart server does it."""
        self.log.add(given)
        outcome = inputs.feed(given, self.race)
        if outcome.orders:
            self.log.add(inputs.Ordered(outcome.orders))
        self.tell(outcome.events)
        if self.saves_at_once and self.race.state is RaceState.GRID_ACTIVE:
            gridded = self.race.memory().gridded
            if self._saved != gridded:
                self._saved = gridded
                self.feed(inputs.Saved(self.now, gridded))
        return outcome

    def tell(self, events: Iterable[Event]) -> None:
        wall = round(self.now * 1e9) + self.wall_offset_ns
        for event in events:
            self.stamped.append(StampedEvent(next(self._sequence), wall, self.now, event))
            self.log.add(self.stamped[-1])

    def wait(self, seconds: float) -> None:
        """Let time pass, with the ticks that an alert or a finish may come with."""
        until = self.now + seconds
        while self.now < until:
            self.now = min(until, self.now + 0.25)
            self.feed(inputs.Tick(self.now))

    def connect(self, *numbers: int) -> None:
        for number in numbers:
            self.feed(inputs.Connected(self.now, number))

    def lose(self, number: int) -> None:
        self.feed(inputs.Disconnected(self.now, number, 'the connection was reset'))

    def silence(self, number: int) -> None:
        self.feed(inputs.Disconnected(self.now, number, 'it stopped answering', True))

    def deliver(self, number: int, after: float) -> None:
        """Have a kart's kernel answer what it is being sent, so long after it was ordered (s)."""
        kart = self.race.karts[number]
        answered = kart.ordered_at + after
        self.now = max(self.now, answered)
        self.feed(inputs.Delivered(self.now, number, kart.serial, answered))

    def measure(self, number: int, grade: Grade) -> Outcome:
        """Have the link to a kart be as good as that."""
        worst = GRADES.get(grade, 0.0)
        link = NOT_MEASURED._replace(grade=grade, worst_answer=worst)
        return self.feed(inputs.Measured(self.now, number, link))

    def say(self, number: int, state: RaceState | None = None) -> Outcome:
        """Have a kart say a state: what it is being sent, if nothing else."""
        kart = self.race.karts[number]
        if state is None:
            self.deliver(number, min(0.02, self.now - kart.ordered_at))
        return self.feed(inputs.Heard(self.now, number, kart.serial, state or kart.sent))

    def acknowledge(self, *numbers: int) -> None:
        """Have karts acknowledge what they are being sent: these, or every connected one."""
        connected = [kart.number for kart in self.race.karts.values() if kart.connected]
        for number in numbers or connected:
            self.say(number)
        self.feed(inputs.Tick(self.now))

    def command(
        self,
        kind: CommandKind,
        kart: int = 0,
        official: str = 'Ada',
        heat: str = '',
        **fields: Any,
    ) -> Outcome:
        """Give a command, for what there is to see."""
        fields = {'official': official, 'heat': heat, **fields}
        command = as_seen(self.race, kind, kart, self.now, **fields)
        return self.feed(inputs.Commanded(self.now, command, self.now))

    def drive(self) -> None:
        """Go from the garage to GREEN_GREEN; every kart is connected and acknowledges."""
        self.command(CommandKind.GRID_ACTIVE)
        self.acknowledge()
        self.command(CommandKind.GREEN_GREEN)
        self.acknowledge()

    def go(self, story: str) -> None:
        """
        Go through a story: what officials, karts and time do, with commas between.

        A step is one of `NEWS`, a command, or a method of this class; then come numbers and names.
        """
        names = {**Grade.__members__, **RaceState.__members__, **LastRun.__members__}
        for step in filter(None, story.split(', ')):
            word, *rest = step.split()
            if step in NEWS:
                self.feed(NEWS[step]._replace(at=self.now))
                continue
            given: list[Any] = [
                names.get(each, each) if each[0].isalpha() else ast.literal_eval(each)
                for each in rest
            ]
            if word in CommandKind.__members__:
                self.command(CommandKind[word], *given)
            else:
                getattr(self, word)(*given)

    def go_home(self) -> None:
        """Go from RED_RED to the garage."""
        self.acknowledge()
        self.wait(self.race.times.settle_time + 0.5)
        self.command(CommandKind.IN_GARAGE)

    def end(self) -> None:
        """Have race control end as it does when it is told to."""
        self.tell([Event(EventKind.ENDED, 'Race control ends because it was told to (Ctrl-C)')])
        for kart in list(self.race.karts.values()):
            self.feed(inputs.Disconnected(self.now, kart.number, 'race control ends'))

    def write(self, path: pathlib.Path, version: str | None = None) -> pathlib.Path:
        """Write what happened as a run into a record."""
        self.batches.append(self.log.take())
        record = Record(path, self.race.run)
        version = rules_version() if version is None else version
        record.put(Batch(0, [Rules(version, self.setup)]))
        for batch in (each for each in self.batches if each.entries):
            record.put(batch)
            assert len(batch.entries) % 5 or record.write()
        record.end()
        return path

    def stream(self) -> list[Entry]:
        """Return what a record has of it, up to now."""
        self.batches.append(self.log.take())
        first = Began(self.race.run, BEGAN), Rules(rules_version(), self.setup)
        return [*first, *(entry for batch in self.batches for entry in batch.entries)]

    def account(self) -> Account:
        """Return what there is to say of it, up to now."""
        return Account(kept(self.stream()))


KARTS = range(1, 5)
SETUP = Setup(
    tuple(Entrant(number, f'Team {number}', number < 4) for number in KARTS),
    RaceTimes(
        finish_delays=(0.5,),
        finish_stop=2.0,
        pause=0.3,
        pause_after_stall=0.5,
        nobody_there=1.0,
    ),
    (Heat('first', (1, 2)), Heat('second', (3, 4)), Heat('final', (1, 2, 3, 4))),
    now=1000.1,
)


ROSTER = Roster((SETUP.karts[0]._replace(team='Another'), *SETUP.karts[1:]), SETUP.heats)
"""What the file of the roster says."""

NEXT = {
    RaceState.IN_GARAGE: CommandKind.GRID_ACTIVE,
    RaceState.GRID_ACTIVE: CommandKind.GREEN_GREEN,
    RaceState.GREEN_GREEN: CommandKind.KART_FINISH,
    RaceState.RED_FLAG: CommandKind.RACE_OVER,
    RaceState.RED_RED: CommandKind.IN_GARAGE,
}
"""What an official does next in a race."""


class Running(PaperRace):
    """
    A race that is fed at random.

    :param before: the run before, whose memory is found, unless it is another one or none.
    """

    def __init__(self, seed: int, before: Running | None = None) -> None:
        super().__init__({}, setup=SETUP)
        self.saves_at_once = False
        self.chance = random.Random(seed)
        memories = [None, self.left_behind()]
        if before is not None:
            self.now = before.now + 5.0
            memories.append(before.race.memory())
        memory = self.chance.choice(memories)
        last = LastRun.NONE if memory is None else self.chance.choice([*LastRun])
        self.feed(inputs.Recovered(self.now, memory, last))
        self.connect(*KARTS)

    def left_behind(self) -> RaceMemory:
        """Return what a race control that was killed may have left, perhaps of another roster."""

        def perhaps() -> bool:
            return self.chance.random() < 0.5

        karts = {
            number: KartMemory(
                *(perhaps(), perhaps(), self.chance.randrange(3)),
                *(self.chance.choice([*Doubt]), perhaps()),
            )
            for number in (*KARTS, 9)
            if perhaps()
        }
        return RaceMemory(self.chance.choice([*RaceState]), karts, perhaps(), perhaps())

    def run(self, steps: int) -> Running:
        for _ in range(steps):
            self.now += self.chance.choice((0.0, 1e-6, 0.05, 0.05, 0.3, 1.0))
            self.feed(self.anything())
            if self.chance.random() < 0.05:
                self.log.add(inputs.Shown(self.now))
            if self.chance.random() < 0.1:
                self.calm_down()
        return self

    def calm_down(self) -> None:
        """Have nothing be wrong for a moment, and the official do what comes next."""
        self.feed(inputs.Rival(self.now, False))
        self.feed(inputs.RecordTrouble(self.now, ''))
        self.connect(*(kart.number for kart in self.race.karts.values() if not kart.connected))
        self.acknowledge()
        self.feed(inputs.Saved(self.now, self.race.memory().gridded))
        self.wait(self.race.times.settle_time)
        self.command(NEXT[self.race.state], self.chance.choice(KARTS))

    def tell(self, events: Iterable[Event]) -> None:
        super().tell(each for each in events if not each.chatter or self.chance.random() < 0.5)
        if self.chance.random() < 0.05:
            own = self.chance.choice((EventKind.MALFORMED, EventKind.REFUSED_CONNECTION))
            super().tell([Event(own, 'rubbish', success=False)])
        if self.chance.random() < 0.5:
            self.batches.append(self.log.take())

    def anything(self) -> inputs.Input:
        kart = self.race.karts[self.chance.choice(KARTS)]
        what = self.chance.random()
        if what < 0.25:
            state = kart.sent if self.chance.random() < 0.8 else self.chance.choice([*RaceState])
            serial = kart.serial if self.chance.random() < 0.9 else 0
            return inputs.Heard(self.now, kart.number, serial, state)
        if what < 0.28:
            answered = self.chance.uniform(kart.ordered_at, self.now)
            return inputs.Delivered(self.now, kart.number, kart.serial, answered)
        if what < 0.31:
            grade = self.chance.choice([*GRADES])
            return inputs.Measured(self.now, kart.number, NOT_MEASURED._replace(grade=grade))
        if what < 0.45:
            return inputs.Tick(self.now)
        if what < 0.5:
            return inputs.Connected(self.now, kart.number)
        if what < 0.53:
            return inputs.Disconnected(self.now, kart.number, 'it was closed')
        if what < 0.56:
            rare: tuple[inputs.Input, ...] = (
                inputs.Stalled(self.now, 1.5),
                inputs.Rival(self.now, not self.race.has_rival),
                inputs.Attended(self.now, Attendance(self.chance.randrange(3), 'Anna (window)')),
                inputs.RecordTrouble(self.now, '' if self.race.record_fails else 'it fails'),
                inputs.Saved(self.now, max(self.race.memory().gridded - 1, 0)),
            )
            return self.chance.choice(rare)
        if self.race.state is RaceState.GRID_ACTIVE and what < 0.65:
            return inputs.Saved(self.now, self.race.memory().gridded)
        return self.any_command(kart.number)

    def any_command(self, kart: int) -> inputs.Input:
        """Return a command, mostly one that would be accepted, or what comes next in a race."""
        likely = [NEXT[self.race.state]] * (self.chance.random() < 0.8)
        for kind in (*likely, *self.chance.sample([*CATALOGUE], len(CATALOGUE))):
            number = kart if CATALOGUE[kind].to_one_kart else 0
            each = self.race.availability(kind, number, self.now)
            if each.available or self.chance.random() < 0.2:
                break
        command = as_seen(
            self.race,
            kind,
            number,
            self.now,
            statement=self.chance.random() < 0.9,
            heat=self.chance.choice(('first', 'second', 'final', 'none')),
            official=self.chance.choice(('', 'Anna', '<b>')),
            roster=ROSTER,
        )
        return inputs.Commanded(self.now, command, self.now - self.chance.choice((0.0, 0.1)))


def kept(entries: Sequence[Entry]) -> Kept:
    """Return a run with these entries, as it is read from a record."""
    began = entries[0]
    assert isinstance(began, Began)
    block = Block(0, b''.join(map(encode, entries))).compressed()
    return Kept(Session(1, BEGAN, None, 0, BEGAN, began.run), [(1, block)])


def named(event: Happened | None) -> str:
    """Return what an event is about: its command, or its kind."""
    assert event is not None
    return (event.event.command or event.event.kind).name


def report(record: pathlib.Path, *arguments: str, code: int = DONE) -> str:
    """Return the report of a record; empty if there is none."""
    page = record.with_name('report.html')
    assert rcs_record(['report', str(record), '-o', str(page), *arguments]) == code
    return page.read_text(encoding='utf-8') if page.exists() else ''


def rows_of(record: pathlib.Path, *arguments: str) -> list[dict[str, str]]:
    """Return the rows of the results of a record."""
    table = record.with_name('results.csv')
    assert rcs_record(['results', str(record), '-o', str(table), *arguments]) == DONE
    with table.open(encoding='utf-8', newline='') as stream:
        return [*csv.DictReader(stream)]


def tables(page: str, kind: str) -> list[list[list[str]]]:
    """Return the tables of a kind in a report, with what is in their cells."""
    found = re.findall(rf'<table class="{kind}">.*?<tbody>(.*?)</table>', page, re.DOTALL)

    def cells(row: str) -> list[str]:
        each = re.split('</t[dh]>', row)[:-1]
        return [' '.join(re.sub('<[^>]*>', '', cell).split()) for cell in each]

    return [[*map(cells, each.split('</tr>')[:-1])] for each in found]


def timed(record: pathlib.Path, *results: Standings | Corrected) -> pathlib.Path:
    """Write the timekeeper's book beside a record, about its newest run unless it names one."""
    with open_runs(record) as runs:
        run = runs.choose(None)
    stream: Stream[Standings | Corrected | Began] = Stream([Standings, Corrected, Began])
    entries = Began('boot', 0), *(each._replace(run=each.run or run.id) for each in results)
    block = Block(0, b''.join(map(stream.encode, entries))).compressed()
    book, _ = open_for_writing(record.with_name(BOOK))
    with contextlib.closing(book):
        book.execute(WRITE_BLOCK, (run.number, 1, block))
    return record


def edit(path: pathlib.Path, change: Callable[[list[Entry]], object], run: int = 1) -> None:
    """Have somebody change the stream of a run in a record, with all that belongs to it."""
    with contextlib.closing(sqlite3.connect(path)) as database, database:
        entries = list(entries_of(blocks_of(database, run)))
        assert not any(isinstance(each, Gap) for each in entries)
        stream = cast(list[Entry], entries)
        change(stream)
        database.execute('DELETE FROM block WHERE run = ?', (run,))
        block = Block(0, b''.join(map(encode, stream)))
        database.execute('INSERT INTO block VALUES (?, 1, ?)', (run, block.compressed()))


def change_event(path: pathlib.Path, which: Callable[[StampedEvent], bool], **to: Any) -> None:
    """Have somebody change the only such event of a record."""

    def change(entries: list[Entry]) -> None:
        (place,) = [n for n, e in enumerate(entries) if isinstance(e, StampedEvent) and which(e)]
        stamped = entries[place]
        assert isinstance(stamped, StampedEvent)
        of_event = {name: value for name, value in to.items() if name in Event._fields}
        of_stamp = {name: value for name, value in to.items() if name not in Event._fields}
        entries[place] = stamped._replace(event=stamped.event._replace(**of_event), **of_stamp)

    edit(path, change)
