# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The demonstration: what it shows, and that it says so when anything is missing."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
import os
import pathlib
import signal
import subprocess
import sys

from evgp_rcs.rcs_record import main as rcs_record
from evgp_rcs.record import RecordedEvent
from evgp_rehearsal.demo import judge_wire
from evgp_rehearsal.findings import (
    judge_domains,
    judge_end,
    judge_events,
    judge_killed,
    judge_whole,
    Race,
)
from evgp_testing.judge import Judge
import pytest

DEMO = (sys.executable, '-m', 'evgp_rehearsal.demo')


def run_demo(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the demonstration, with its output in a pipe."""
    return subprocess.run(
        [*DEMO, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=110,
    )


# ----- the whole demonstration ------------------------------------------------------------


def test_both_races_are_driven_and_nothing_is_missing(tmp_path: pathlib.Path) -> None:
    record = tmp_path / 'demo.sqlite3'

    done = run_demo('--record', str(record))

    assert done.returncode == 0, done.stdout
    assert rcs_record(['replay', str(record)]) == 0
    assert 'MISSING' not in done.stdout
    for line in (
        'GREEN_GREEN refused: waiting for kart 2 (REHEARSAL 2): no GRID_ACTIVE yet.',
        'kart 4 saw GRID_ACTIVE > GREEN_GREEN > RED_FLAG > RED_RED > IN_GARAGE',
        'kart 3 saw nothing but IN_GARAGE',
        'the race went over by itself',
        'the score sheet says that the official passed',
        'kart 3 saw RED_RED > IN_GARAGE',
        'judged: none was against the rules',
        '4 ROS domains, none with a node of another',
        'all 7 processes ended in good order; none is left',
        'Nothing is missing',
    ):
        assert line in done.stdout
    # In a pipe, plain lines that fit a page.
    assert '\x1b' not in done.stdout
    assert max(len(line) for line in done.stdout.splitlines()) <= 100


@pytest.mark.long
def test_a_kart_that_never_acknowledges_holds_the_race_and_is_named() -> None:
    done = run_demo('--mute', '1')

    assert done.returncode == 1, done.stdout
    assert 'not within 15 s: kart 1: GRID_ACTIVE' in done.stdout
    assert 'kart 1 (REHEARSAL 1): no GRID_ACTIVE yet' in done.stdout
    assert 'race 2' not in done.stdout
    assert 'processes ended in good order; none is left' in done.stdout


@pytest.mark.long
@pytest.mark.parametrize(
    ('number', 'send', 'code'),
    [(signal.SIGINT, os.killpg, 130), (signal.SIGTERM, os.kill, 143)],
    ids=['ctrl-c', 'terminate'],
)
def test_a_signal_in_mid_race_ends_every_process(
    number: signal.Signals, send: Callable[[int, int], None], code: int
) -> None:
    # Its group has all of its processes, and nothing else.
    with subprocess.Popen(
        DEMO, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, process_group=0
    ) as demo:
        assert demo.stdout is not None
        printed = []
        for line in demo.stdout:
            printed.append(line)
            if 'The race is in GREEN_GREEN' in line:
                send(demo.pid, number)
        assert demo.wait() == code, ''.join(printed)
    with pytest.raises(ProcessLookupError):
        os.killpg(demo.pid, 0)


# ----- the checks, on doctored records ----------------------------------------------------

TEXT = 'what happened'


class Author:
    """Writes the record of a race of karts 5 and 7, with 64 outside; all times are small."""

    def __init__(self) -> None:
        """Begin an empty record."""
        self.now = 100.0
        self.seen: dict[int, list[tuple[float, str]]] = {5: [], 7: [], 64: []}
        self.race = Race({5: True, 7: True, 64: False}, [], self.seen)
        self.command('GREEN_GREEN', success=False)

    def event(self, kind: str, state: str | None = None, kart: int = 0) -> None:
        """Write an event."""
        self._write(kind, kart, None, True, state)

    def command(self, name: str, kart: int = 0, success: bool = True) -> None:
        """Write an official's command."""
        self._write('COMMAND', kart, name, success, None)

    def _write(
        self, kind: str, kart: int, command: str | None, success: bool, state: str | None
    ) -> None:
        event = (0, 0, self.now, kind, kart, command, success, state, TEXT, '', None)
        self.race.events.append(RecordedEvent(*event))

    def order(self, state: str, *karts: int) -> None:
        """Write that karts are sent a state, see it and acknowledge it."""
        for kart in karts:
            self.event('KART_STATE', state, kart)
            self.seen[kart].append((self.now + 0.01, state))
        self.now += 0.125
        for kart in karts:
            if state != 'IN_GARAGE':
                self.event('ACKNOWLEDGED', state, kart)

    def start(self) -> None:
        """Write how a race begins."""
        self.order('GRID_ACTIVE', 5, 7)
        self.command('GREEN_GREEN')
        self.order('GREEN_GREEN', 5, 7)
        self.now = 110.0

    def end(self, *karts: int) -> Race:
        """Write how a race ends, and return what was heard of it."""
        self.event('RACE_STATE', 'RED_RED')
        self.order('RED_RED', *karts)
        self.event('RACE_STATE', 'IN_GARAGE')
        self.order('IN_GARAGE', *karts)
        return self.race


def whole() -> Race:
    """Return a race over the finish in which all is as it must be."""
    author = Author()
    author.start()
    author.command('KART_FINISH', kart=7)
    author.now = 110.5
    author.command('KART_FINISH', kart=5)
    author.now = 111.5
    author.order('RED_FLAG', 5)
    author.now = 112.0
    author.order('RED_FLAG', 7)
    return author.end(5, 7)


def killed() -> Race:
    """Return a race that ALL_KILL ends, in which all is as it must be."""
    author = Author()
    author.start()
    author.race.called = 109.99
    author.command('ALL_KILL')
    return author.end(5, 7, 64)


def missing_of_whole(race: Race) -> list[str]:
    """Return what is missing in a race over the finish."""
    return [each.text for each in judge_whole(race, (2.0, 1.0)) if not each.good]


def missing_of_killed(race: Race) -> list[str]:
    """Return what is missing in a race that ALL_KILL ends."""
    return [each.text for each in judge_killed(race) if not each.good]


def test_nothing_is_missing_in_a_good_race() -> None:
    assert missing_of_whole(whole()) == []


def test_nothing_is_missing_in_a_good_incident() -> None:
    assert missing_of_killed(killed()) == []


def place(race: Race, kind: str, kart: int, state: str | None) -> int:
    """Return where the one event of this kind, kart and state is."""
    wanted = (kind, kart, state)
    (index,) = (n for n, e in enumerate(race.events) if (e.kind, e.kart, e.state) == wanted)
    return index


def drop(kind: str, kart: int, state: str | None) -> Callable[[Race], object]:
    """Return what takes an event out of a record."""
    return lambda race: race.events.pop(place(race, kind, kart, state))


def finish_later(race: Race) -> None:
    """Let the winner's finish come half a second later: its RED_FLAG then came too soon."""
    index = place(race, 'COMMAND', 7, None)
    race.events[index] = dataclasses.replace(race.events[index], monotonic=110.5)


def add(kind: str, **more: object) -> Callable[[Race], object]:
    """Return what adds an event to the end of a record."""
    return lambda race: race.events.append(
        dataclasses.replace(race.events[-1], kind=kind, **more)  # type: ignore[arg-type]
    )


@pytest.mark.parametrize(
    ('doctor', 'said'),
    [
        (lambda r: setattr(r, 'failure', 'it rained'), 'the race went no further: it rained'),
        (lambda r: r.events.clear(), 'not acknowledged: there was no order'),
        (drop('KART_STATE', 5, 'RED_FLAG'), 'kart 5 had to be told'),
        (lambda r: r.seen[7].pop(2), 'kart 7 had to see'),
        (lambda r: r.seen[7].reverse(), 'kart 7 had to see'),
        (lambda r: r.seen[64].append((111.0, 'GREEN_GREEN')), 'kart 64 had to see'),
        (drop('ACKNOWLEDGED', 5, 'RED_FLAG'), 'not acknowledged: RED_FLAG by kart 5'),
        (lambda r: r.events.pop(0), 'GREEN_GREEN had to be refused'),
        (add('COMMAND', command='GREEN_GREEN'), 'accepted 2 times'),
        (finish_later, 'kart 7 finished in place 1: its RED_FLAG had to come 2 s later'),
        (drop('COMMAND', 5, None), '1 of 2 karts finished'),
        (drop('RACE_STATE', 0, 'RED_RED'), 'did not go over by itself'),
        (add('COMMAND', command='RACE_OVER'), 'did not go over by itself'),
        (drop('RACE_STATE', 0, 'IN_GARAGE'), 'at the end the race is in RED_RED'),
        (add('DISCONNECTED', kart=64), 'karts lost their connection: 64'),
    ],
)
def test_what_is_missing_in_a_race_is_said(doctor: Callable[[Race], object], said: str) -> None:
    race = whole()
    doctor(race)
    assert any(said in text for text in missing_of_whole(race))


@pytest.mark.parametrize(
    ('doctor', 'said'),
    [
        (lambda r: setattr(r, 'called', None), 'ALL_KILL was not called'),
        (lambda r: r.seen[64].clear(), 'RED_RED not seen or acknowledged by kart 64'),
        (drop('ACKNOWLEDGED', 7, 'RED_RED'), 'RED_RED not seen or acknowledged by kart 7'),
        (lambda r: r.seen[5].append((120.0, 'GREEN_GREEN')), 'kart 5 had to see'),
    ],
)
def test_what_is_missing_in_an_incident_is_said(
    doctor: Callable[[Race], object], said: str
) -> None:
    race = killed()
    doctor(race)
    assert any(said in text for text in missing_of_killed(race))


def test_an_event_that_officials_did_not_hear_is_missed() -> None:
    recorded = [dataclasses.replace(each, sequence=n) for n, each in enumerate(whole().events, 1)]
    heard = [each.sequence for each in recorded]
    assert judge_events(heard, recorded).good
    assert judge_events(heard[:-1], recorded).good  # of the end of race control
    for wrong in (heard[1:], [*heard[:3], *heard[4:]], []):
        assert not judge_events(wrong, recorded).good


def test_a_node_on_the_domain_of_another_is_named() -> None:
    nodes = {0: {'rcs'}, 7: {'kart_bridge'}}
    assert judge_domains(nodes, nodes).good
    found = judge_domains({**nodes, 7: {'kart_bridge', 'rcs'}}, nodes)
    assert not found.good
    assert 'rcs' in found.text


def test_what_was_wrong_on_the_wire_is_said() -> None:
    judge = Judge({5}, {64}, 0.0)
    assert judge_wire(judge).good
    judge.rubbish(5, b'$GO;', 1.0)
    assert "kart 5 was sent b'$GO;'" in judge_wire(judge).text
    assert not judge_wire(judge).good


def test_a_process_that_failed_or_is_left_is_named() -> None:
    assert judge_end({'bridge': 0}, []).good
    assert 'bridge ended with 1' in judge_end({'bridge': 1}, []).text
    assert 'process 123 is still there' in judge_end({'bridge': 0}, [123]).text
