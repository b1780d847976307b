# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A replay finds no difference with the same rules, and names the first one with others."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
import contextlib
import math
import pathlib
import random
import sqlite3
from typing import Any, cast

from evgp_protocol.states import RaceState
from evgp_rcs.rcs_record import main
from evgp_rcs.record.replay import OF_THE_SERVER, Replay
from evgp_rcs.record.runs import DONE, FAILED, PARTLY, UNREADABLE
from evgp_rcs.record.store import rules_version
from evgp_rcs.rules import inputs
from evgp_rcs.rules import race as rules
from evgp_rcs.rules.catalogue import CATALOGUE
from evgp_rcs.rules.inputs import Entrant, Entry, Ordered, Rules, Setup
from evgp_rcs.rules.race import (
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
import pytest
from recorded_races import change_event, edit, kept, PaperRace
from rig.faults import faults_in, module_with

KARTS = range(1, 5)
SETUP = Setup(
    tuple(Entrant(number, f'Team {number}', number < 4) for number in KARTS),
    RaceTimes(
        finish_delays=(0.5,),
        finish_stop=2.0,
        pause=0.3,
        pause_after_held_up=0.5,
        nobody_there=1.0,
    ),
    (Heat('first', (1, 2)), Heat('second', (3, 4))),
    now=1000.1,
)


class Running(PaperRace):
    """
    A race that is fed at random.

    :param recovered: what an earlier run has left behind.
    """

    def __init__(self, seed: int, recovered: rules.RaceMemory | None = None) -> None:
        super().__init__({}, setup=SETUP)
        self.chance = random.Random(seed)
        if recovered is not None:
            self.feed(inputs.Recovered(self.now, recovered, rules.LastRun.UNKNOWN))
        self.connect(*KARTS)

    def run(self, steps: int) -> Running:
        for _ in range(steps):
            self.now += self.chance.choice((0.0, 1e-6, 0.05, 0.05, 0.3, 1.0))
            self.feed(self.anything())
            if self.chance.random() < 0.3:
                self.log.add(inputs.Shown(self.now))
        return self

    def take(self, outcome: Outcome) -> Outcome:
        """Leave open what becomes of a start."""
        super().take(outcome._replace(start=None))
        return outcome

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
        if what < 0.45:
            return inputs.Tick(self.now)
        if what < 0.5:
            return inputs.Connected(self.now, kart.number)
        if what < 0.53:
            return inputs.Disconnected(self.now, kart.number, 'it was closed')
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
        return self.any_command(kart.number)

    def any_command(self, kart: int) -> inputs.Input:
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
        )
        return inputs.Commanded(self.now, command, self.now - self.chance.choice((0.0, 0.1)))


def replayed(entries: Sequence[Entry]) -> Replay:
    return Replay(kept(entries)).run()


Capture = pytest.CaptureFixture[str]


@pytest.fixture
def path(tmp_path: pathlib.Path) -> pathlib.Path:
    return tmp_path / 'record.sqlite3'


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
    found = replayed(Running(seed, recovered).run(800).stream())
    assert (found.difference, found.missing) == (None, '')
    assert found.inputs > 800
    assert found.orders > 20
    assert found.events > 100


@pytest.mark.parametrize('seed', range(20))
def test_a_race_with_restarts_is_replayed_without_a_difference(
    seed: int, path: pathlib.Path
) -> None:
    left: rules.RaceMemory | None = None
    for part in range(3):
        running = Running(100 * seed + part, left).run(200)
        left = running.race.memory()
        if part == 2:
            running.end()
        running.write(path)
    codes = [main(['replay', str(path), '--run', str(run)]) for run in (1, 2, 3)]
    assert codes == [DONE] * 3


def a_run(seed: int = 1) -> Running:
    return Running(seed).run(600)


def an_ended_run(seed: int = 1, steps: int = 600) -> Running:
    running = Running(seed).run(steps)
    running.end()
    return running


# ----- what somebody changed ------------------------------------------------------------------


def places(entries: Sequence[Entry], fits: Callable[[Any], bool]) -> list[int]:
    return [place for place, entry in enumerate(entries) if fits(entry)]


def of_the_rules(entry: Entry) -> bool:
    return isinstance(entry, StampedEvent) and entry.event.kind not in OF_THE_SERVER


def with_effect(entries: Sequence[Entry]) -> list[int]:
    """Return the places of inputs after which there is something that they have made."""
    return [
        place
        for place, entry in enumerate(entries[:-1])
        if isinstance(entry, inputs.Input)
        and (of_the_rules(after := entries[place + 1]) or isinstance(after, Ordered))
    ]


Harm = Callable[[list[Entry], random.Random], object]
"""Changes entries."""


def an_order_is_other(entries: list[Entry], chance: random.Random) -> None:
    place = chance.choice(places(entries, lambda each: isinstance(each, Ordered)))
    first, *rest = cast(Ordered, entries[place]).orders
    entries[place] = Ordered((first._replace(serial=first.serial + 1), *rest))


def an_order_is_missing(entries: list[Entry], chance: random.Random) -> None:
    del entries[chance.choice(places(entries, lambda each: isinstance(each, Ordered)))]


def an_order_is_new(entries: list[Entry], chance: random.Random) -> None:
    place = chance.choice(places(entries, lambda each: isinstance(each, inputs.Tick)))
    entries.insert(place + 1, Ordered((rules.Order(1, RaceState.GREEN_GREEN, 99),)))


def an_input_is_missing(entries: list[Entry], chance: random.Random) -> None:
    del entries[chance.choice(with_effect(entries))]


def an_input_is_later(entries: list[Entry], chance: random.Random) -> None:
    place = chance.choice([n for n in with_effect(entries) if of_the_rules(entries[n + 1])])
    given: Any = entries[place]
    entries[place] = given._replace(at=given.at + 1e-6)


def a_reason_is_other(entries: list[Entry], chance: random.Random) -> None:
    place = chance.choice(
        [n for n in with_effect(entries) if isinstance(entries[n], inputs.Disconnected)]
    )
    given: Any = entries[place]
    entries[place] = given._replace(reason='another one')


def two_inputs_change_places(entries: list[Entry], chance: random.Random) -> None:
    one, other = chance.sample(with_effect(entries), 2)
    entries[one], entries[other] = entries[other], entries[one]


def an_event_with(**to: Any) -> Harm:
    def harm(entries: list[Entry], chance: random.Random) -> None:
        found = [
            place
            for place in places(entries, of_the_rules)
            if cast(StampedEvent, entries[place]).event._replace(**to)
            != cast(StampedEvent, entries[place]).event
        ]
        place = chance.choice(found)
        stamped = cast(StampedEvent, entries[place])
        entries[place] = stamped._replace(event=stamped.event._replace(**to))

    return harm


def an_event_is_later_by_the_least_of_its_clock(
    entries: list[Entry], chance: random.Random
) -> None:
    place = chance.choice(places(entries, of_the_rules))
    stamped = cast(StampedEvent, entries[place])
    entries[place] = stamped._replace(monotonic=math.nextafter(stamped.monotonic, math.inf))


def an_event_of_the_server_is_before_the_one_before_it(
    entries: list[Entry], chance: random.Random
) -> None:
    own = places(entries, lambda each: isinstance(each, StampedEvent) and not of_the_rules(each))
    stamped = cast(StampedEvent, entries[own[-1]])
    entries[own[-1]] = stamped._replace(monotonic=SETUP.now - 1.0)


def an_event_of_the_server_is_missing(entries: list[Entry], chance: random.Random) -> None:
    del entries[
        places(entries, lambda each: isinstance(each, StampedEvent) and not of_the_rules(each))[0]
    ]


def an_event_is_missing(entries: list[Entry], chance: random.Random) -> None:
    del entries[chance.choice(places(entries, of_the_rules))]


def an_event_is_there_twice(entries: list[Entry], chance: random.Random) -> None:
    place = chance.choice(places(entries, of_the_rules))
    entries.insert(place, entries[place])


def an_event_is_new(entries: list[Entry], chance: random.Random) -> None:
    last = cast(StampedEvent, entries[places(entries, of_the_rules)[-1]])
    number = sum(isinstance(each, StampedEvent) for each in entries) + 1
    event = last.event._replace(kind=EventKind.COMMAND)
    entries.append(StampedEvent(number, last.wall_ns, SETUP.now + 9e6, event))


def two_events_change_places(entries: list[Entry], chance: random.Random) -> None:
    one, other = chance.sample(places(entries, of_the_rules), 2)
    entries[one], entries[other] = entries[other], entries[one]


def the_roster_is_other(entries: list[Entry], chance: random.Random) -> None:
    entrants = (SETUP.karts[0]._replace(team='Another'), *SETUP.karts[1:])
    entries[1] = Rules(rules_version(), Setup(entrants, SETUP.times, SETUP.heats, SETUP.now))


def it_begins_twice(entries: list[Entry], chance: random.Random) -> None:
    entries.insert(len(entries) // 2, entries[1])


HARMS: dict[str, Harm] = {
    **{
        each.__name__: each
        for each in (
            an_order_is_other,
            an_order_is_missing,
            an_order_is_new,
            an_input_is_missing,
            an_input_is_later,
            a_reason_is_other,
            two_inputs_change_places,
            an_event_is_later_by_the_least_of_its_clock,
            an_event_of_the_server_is_before_the_one_before_it,
            an_event_of_the_server_is_missing,
            an_event_is_missing,
            an_event_is_there_twice,
            an_event_is_new,
            two_events_change_places,
            the_roster_is_other,
            it_begins_twice,
        )
    },
    **{
        f'an_event_with_another_{name}': an_event_with(**{name: value})
        for name, value in {
            'text': 'nothing happened',
            'kart': 99,
            'official': 'somebody else',
            'success': False,
            'command': rules.CommandKind.KART_UNDO_FINISH,
            'state': RaceState.GREEN_GREEN,
            'kind': EventKind.ORDER_OF_FINISH,
            'alert': rules.AlertKind.NOT_READY,
            'hold': RaceState.RED_FLAG,
            'race': 99,
            'heat': '?',
        }.items()
    },
}


@pytest.mark.parametrize('seed', range(2))
@pytest.mark.parametrize('harm', HARMS)
def test_what_was_changed_is_found_and_named_with_its_time(
    harm: str, seed: int, path: pathlib.Path, capsys: Capture
) -> None:
    entries = an_ended_run(seed).stream()
    HARMS[harm](entries, random.Random(seed))
    difference = replayed(entries).difference
    assert difference is not None
    assert difference.recorded != difference.replayed
    given = [each for each in entries if isinstance(each, inputs.Input)][difference.number - 1]
    if harm not in ('an_input_is_later', 'two_inputs_change_places'):
        assert difference.at == given.at - SETUP.now
    assert 0 <= difference.at < SETUP.now + 9e6


FAULTS = faults_in(
    """
an old acknowledgement counts: heard: without serial
a reason is other: _no_join: already f => f'the race has {kart} already'
the pause is longer: command: pause times => 1.0
"""
)


@pytest.mark.parametrize('name', FAULTS)
def test_a_change_of_the_rules_is_found_in_a_record_of_the_right_ones(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = [Running(seed).run(600) for seed in range(10)]
    faulty = module_with(rules, FAULTS[name])
    monkeypatch.setattr(inputs, 'Race', faulty.Race)
    assert any(replayed(run.stream()).difference for run in runs)


def test_rules_that_fail_are_a_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    running = a_run()

    def broken(*given: object) -> None:
        raise ZeroDivisionError('a fault put in by the test')

    monkeypatch.setattr(rules.Race, 'tick', broken)
    difference = replayed(running.stream()).difference
    assert difference is not None
    assert 'ZeroDivisionError' in difference.replayed


# ----- on the disk ------------------------------------------------------------------------


def test_a_record_is_replayed_without_a_difference(path: pathlib.Path, capsys: Capture) -> None:
    an_ended_run().write(path)
    assert main(['replay', str(path)]) == DONE
    (line,) = capsys.readouterr().out.splitlines()
    assert line.endswith('no difference')


def test_a_record_that_was_changed_is_not_replayed_without_a_word(
    path: pathlib.Path, capsys: Capture
) -> None:
    an_ended_run().write(path)
    change_event(path, lambda each: each.sequence == 3, official='Eve')
    assert main(['replay', str(path)]) == FAILED
    out = capsys.readouterr().out
    assert 'event 3' in out
    assert 'Eve' in out


def test_where_entries_are_missing_the_replay_ends_and_says_so(
    path: pathlib.Path, capsys: Capture
) -> None:
    running = an_ended_run()
    lost = running.batches.pop(len(running.batches) // 2)
    running.write(path)
    assert main(['replay', str(path)]) == PARTLY
    counts, missing = capsys.readouterr().out.splitlines()
    assert counts.endswith('no difference')
    assert f'{len(lost.entries)} entries are missing' in missing or len(lost.entries) == 1
    assert main(['show', str(path)]) == PARTLY
    assert 'missing' in capsys.readouterr().out


def test_a_record_of_other_rules_is_replayed_and_says_so(
    path: pathlib.Path, capsys: Capture
) -> None:
    an_ended_run().write(path, '0123456789abcdef')
    assert main(['replay', str(path)]) == DONE
    warning, _ = capsys.readouterr().out.splitlines()
    assert '0123456789abcdef' in warning


def test_a_record_that_was_cut_is_replayed_up_to_the_cut(
    path: pathlib.Path, capsys: Capture
) -> None:
    running = a_run()
    half = len(running.batches) // 2
    running.batches = running.batches[:half]
    running.log.take()  # lost too
    running.write(path)
    assert main(['replay', str(path)]) == DONE
    counts, cut = capsys.readouterr().out.splitlines()
    assert counts.endswith('no difference')
    assert cut


def test_a_run_without_its_beginning_says_plainly_that_it_cannot_be_replayed(
    path: pathlib.Path, capsys: Capture
) -> None:
    a_run().write(path)
    edit(path, lambda entries: entries.pop(1))
    assert main(['replay', str(path)]) == UNREADABLE
    (line,) = capsys.readouterr().err.splitlines()
    assert 'with what the rules began' in line
    assert main(['show', str(path)]) == DONE


def test_wall_times_that_were_moved_are_told_and_are_no_difference(
    path: pathlib.Path, capsys: Capture
) -> None:
    running = an_ended_run()
    running.write(path)
    moved = running.stamped[len(running.stamped) // 2]
    back = moved.wall_ns - 600_000_000
    number = change_event(path, lambda each: each.sequence == moved.sequence, wall_ns=back)
    assert main(['replay', str(path)]) == DONE
    counts, told = capsys.readouterr().out.splitlines()
    assert counts.endswith('no difference')
    assert f'event {number};' in told


# ----- 50 records that were harmed as a whole -----------------------------------------------


def blocks_moved(path: pathlib.Path, chance: random.Random) -> None:
    """Remove a block, or swap two, or have one twice; not the last one, which nobody misses."""
    with contextlib.closing(sqlite3.connect(path)) as database, database:
        numbers = [n for (n,) in database.execute('SELECT number FROM block ORDER BY number')]
        one, other = chance.sample(numbers[:-1], 2)
        what = chance.randrange(3)
        if what == 0:
            database.execute('DELETE FROM block WHERE number = ?', (one,))
        elif what == 1:
            query = 'UPDATE block SET number = ? WHERE number = ?'
            for given in ((-1, one), (one, other), (other, -1)):
                database.execute(query, given)
        else:
            query = 'INSERT INTO block SELECT run, ?, data FROM block WHERE number = ?'
            database.execute(query, (numbers[-1] + 1, one))


def block_garbled(path: pathlib.Path, chance: random.Random) -> None:
    """Change one bit of a block."""
    with contextlib.closing(sqlite3.connect(path)) as database, database:
        blocks = database.execute('SELECT number, data FROM block').fetchall()
        number, data = chance.choice(blocks)
        garbled = bytearray(data)
        garbled[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        database.execute('UPDATE block SET data = ? WHERE number = ?', (bytes(garbled), number))


def bits_flipped(path: pathlib.Path, chance: random.Random) -> None:
    data = bytearray(path.read_bytes())
    for _ in range(chance.choice((1, 20, 1000))):
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    path.write_bytes(data)


def truncated(path: pathlib.Path, chance: random.Random) -> None:
    with path.open('r+b') as file:
        file.truncate(chance.randrange(1, path.stat().st_size))


def stream_of(path: pathlib.Path, capsys: Capture) -> str:
    capsys.readouterr()
    main(['show', str(path), '--stream'])
    return str(capsys.readouterr().out)


WHOLE = (blocks_moved, block_garbled, bits_flipped, truncated)


@pytest.mark.parametrize('seed', range(50))
def test_whatever_was_done_to_a_record_it_is_read_or_refused_and_a_change_is_found(
    seed: int, path: pathlib.Path, capsys: Capture
) -> None:
    chance = random.Random(seed)
    an_ended_run(seed, 200).write(path)
    before = stream_of(path, capsys)
    WHOLE[seed % len(WHOLE)](path, chance)
    page = str(path.with_name('report.html'))
    ways = [
        ['replay'],
        ['show'],
        ['results'],
        ['report', '-o', page],
        ['show', '--list'],
    ]
    codes = [main([way, str(path), *more]) for way, *more in ways]
    assert set(codes) <= {DONE, FAILED, UNREADABLE, PARTLY}
    assert codes[0] != DONE or stream_of(path, capsys) == before


def test_the_version_of_the_rules_is_16_hexadecimal_digits_and_always_the_same() -> None:
    version = rules_version()
    assert len(version) == 16
    assert int(version, 16) >= 0
    assert version == rules_version()
