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
import os
import pathlib
import signal
import subprocess
import sys

from evgp_node.states import state_message
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.judge import Judge
from evgp_testing.official import Answer
import pytest
from race_demo.checks import (
    check_domains,
    check_end,
    check_incident,
    check_race,
    check_wire,
    Finding,
    RACE_CONTROL_NODES,
)
from race_demo.record import Entrant, RaceRecord

ROOT = pathlib.Path(__file__).resolve().parents[1]
DEMO = (sys.executable, str(ROOT / 'demo' / 'run.py'))

GREEN_GREEN = RaceState.GREEN_GREEN
GRID_ACTIVE = RaceState.GRID_ACTIVE
IN_GARAGE = RaceState.IN_GARAGE
RED_FLAG = RaceState.RED_FLAG
RED_RED = RaceState.RED_RED


def run_demo(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the demonstration, with its output in a pipe."""
    return subprocess.run(
        [*DEMO, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=60,
    )


# ----- the whole demonstration ------------------------------------------------------------


def test_both_races_are_driven_and_nothing_is_missing() -> None:
    done = run_demo()

    assert done.returncode == 0, done.stdout
    assert 'MISSING' not in done.stdout
    for line in (
        'GREEN_GREEN refused: waiting for kart 23 (Michigan): no GRID_ACTIVE yet.',
        'kart 7 (Purdue) saw GRID_ACTIVE > GREEN_GREEN > RED_FLAG > RED_RED > IN_GARAGE',
        'kart 64 (Kettering) saw nothing but IN_GARAGE',
        'the race went over by itself',
        'kart 64 (Kettering) saw RED_RED > IN_GARAGE',
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
    done = run_demo('--mute', '42')

    assert done.returncode == 1, done.stdout
    assert 'not within 10 s: kart 42: GRID_ACTIVE acknowledged' in done.stdout
    assert 'kart 42 (UC Berkeley): no GRID_ACTIVE yet' in done.stdout
    assert 'Race 2' not in done.stdout
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
    # In a session of its own: its group has all of its processes, and nothing else.
    with subprocess.Popen(
        DEMO, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
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

KART_FINISH = msg.CommandAvailability.KART_FINISH


class Author:
    """Writes the record of a race of karts 7 and 5, with 64 outside; all times are small."""

    def __init__(self) -> None:
        """Begin an empty record."""
        self.now = 100.0
        self.record = RaceRecord(
            title='a race',
            began=100.0,
            first_event=41,
            entrants=[
                Entrant(7, 'Purdue', ''),
                Entrant(5, 'Kennesaw State', ''),
                Entrant(64, 'Kettering', '', in_race=False),
            ],
            finish_delays=(2.0, 1.0),
            seen={7: [], 5: [], 64: []},
            refused=[Answer(False, 'GREEN_GREEN refused: the reason.')],
        )

    def event(self, kind: int, state: RaceState | None = None, kart: int = 0, **more: int) -> None:
        """Write an event."""
        event = msg.RaceEvent(
            sequence=self.record.first_event + len(self.record.events),
            kind=kind,
            kart=kart,
            state=state_message(state),
            success=True,
            text='what happened',
            **more,
        )
        event.monotonic.sec = int(self.now)
        event.monotonic.nanosec = round((self.now % 1.0) * 1e9)
        self.record.events.append(event)

    def order(self, state: RaceState, *karts: int) -> None:
        """Write that karts are sent a state, see it and acknowledge it."""
        for kart in karts:
            self.event(msg.RaceEvent.KART_STATE, state, kart)
            self.record.seen[kart].append((self.now + 0.01, state))
        self.now += 0.125
        for kart in karts:
            if state is not IN_GARAGE:
                self.event(msg.RaceEvent.ACKNOWLEDGED, state, kart)

    def end(self) -> RaceRecord:
        """Write that all are in the garage, and return the record."""
        garage = state_message(IN_GARAGE)
        self.record.final = msg.Race(
            state=garage,
            karts=[
                msg.KartStatus(number=entrant.number, connected=True, sent=garage)
                for entrant in self.record.entrants
            ],
        )
        return self.record


def race() -> RaceRecord:
    """Return the record of a race in which all is as it must be."""
    author = Author()
    author.order(GRID_ACTIVE, 7, 5)
    author.order(GREEN_GREEN, 7, 5)
    author.now = 110.0
    author.event(msg.RaceEvent.COMMAND, kart=7, command=KART_FINISH)
    author.now = 110.5
    author.event(msg.RaceEvent.COMMAND, kart=5, command=KART_FINISH)
    author.now = 111.5
    author.order(RED_FLAG, 5)
    author.now = 112.0
    author.order(RED_FLAG, 7)
    author.event(msg.RaceEvent.RACE_STATE, RED_RED)
    author.order(RED_RED, 7, 5)
    author.order(IN_GARAGE, 7, 5)
    author.record.over = True
    return author.end()


def incident() -> RaceRecord:
    """Return the record of a race that ALL_KILL ends, in which all is as it must be."""
    author = Author()
    author.order(GRID_ACTIVE, 7, 5)
    author.order(GREEN_GREEN, 7, 5)
    author.now = 110.0
    author.record.all_kill_called = 109.99
    author.order(RED_RED, 7, 5, 64)
    author.order(IN_GARAGE, 7, 5, 64)
    return author.end()


def missing(findings: list[Finding]) -> list[str]:
    """Return what the findings say is missing."""
    return [finding.text for finding in findings if not finding.ok]


def test_nothing_is_missing_in_a_good_race() -> None:
    assert missing(check_race(race())) == []


def test_nothing_is_missing_in_a_good_incident() -> None:
    assert missing(check_incident(incident())) == []


def drop_event(kind: int, kart: int, state: RaceState) -> Callable[[RaceRecord], None]:
    """Return what takes an event out of a record, and leaves no gap in the numbers."""

    def drop(record: RaceRecord) -> None:
        wanted = (kind, kart, state_message(state))
        kept = [each for each in record.events if (each.kind, each.kart, each.state) != wanted]
        assert len(kept) == len(record.events) - 1
        for sequence, event in enumerate(kept, start=record.first_event):
            event.sequence = sequence
        record.events = kept

    return drop


def set_final(record: RaceRecord, state: RaceState) -> None:
    """Let the race end in another state."""
    assert record.final is not None
    record.final.state = state_message(state)


def set_kart_final(record: RaceRecord, state: RaceState) -> None:
    """Let the last kart end in another state."""
    assert record.final is not None
    record.final.karts[-1].sent = state_message(state)


def finish_later(record: RaceRecord) -> None:
    """Let the winner's finish come half a second later: its RED_FLAG then came too soon."""
    finish = next(event for event in record.events if event.command == KART_FINISH)
    finish.monotonic.nanosec = 500_000_000


def command_race_over(record: RaceRecord) -> None:
    """Let an official command the end of the race."""
    record.events.append(
        msg.RaceEvent(
            sequence=record.events[-1].sequence + 1,
            kind=msg.RaceEvent.COMMAND,
            command=msg.CommandAvailability.RACE_OVER,
            success=True,
        )
    )


KART_STATE = msg.RaceEvent.KART_STATE
ACKNOWLEDGED = msg.RaceEvent.ACKNOWLEDGED


@pytest.mark.parametrize(
    ('doctor', 'said'),
    [
        (lambda r: setattr(r, 'failure', 'it rained'), 'the race went no further: it rained'),
        (lambda r: r.events.pop(0), '/rcs/events has gaps'),
        (lambda r: r.events.clear(), '/rcs/events has gaps'),
        (drop_event(KART_STATE, 5, RED_FLAG), 'kart 5 (Kennesaw State) had to be told'),
        (lambda r: r.seen[7].pop(2), 'kart 7 (Purdue) had to see'),
        (lambda r: r.seen[7].reverse(), 'kart 7 (Purdue) had to see'),
        (lambda r: r.seen[64].append((111.0, GREEN_GREEN)), 'kart 64 (Kettering) had to see'),
        (drop_event(ACKNOWLEDGED, 5, RED_FLAG), 'not acknowledged: RED_FLAG by kart 5'),
        (lambda r: r.refused.clear(), 'no GREEN_GREEN was refused'),
        (lambda r: r.refused.insert(0, Answer(True, 'Go.')), 'had to be refused, and was not'),
        (finish_later, 'kart 7 finished in place 1: its RED_FLAG had to come 2 s later'),
        (lambda r: setattr(r, 'over', False), 'did not go over by itself'),
        (command_race_over, 'did not go over by itself'),
        (lambda r: set_final(r, RED_RED), 'at the end the race is in RED_RED'),
        (lambda r: set_kart_final(r, RED_RED), 'kart 64 is sent RED_RED'),
    ],
)
def test_what_is_missing_in_a_race_is_said(
    doctor: Callable[[RaceRecord], object], said: str
) -> None:
    record = race()
    doctor(record)
    assert any(said in text for text in missing(check_race(record)))


@pytest.mark.parametrize(
    ('doctor', 'said'),
    [
        (lambda r: setattr(r, 'all_kill_called', None), 'ALL_KILL was not called'),
        (lambda r: r.seen[64].clear(), 'kart 64 (Kettering) did not see or acknowledge RED_RED'),
        (drop_event(ACKNOWLEDGED, 7, RED_RED), 'kart 7 (Purdue) did not see or acknowledge'),
        (
            lambda r: r.seen[5].append((120.0, GREEN_GREEN)),
            'kart 5 (Kennesaw State) had to see',
        ),
    ],
)
def test_what_is_missing_in_an_incident_is_said(
    doctor: Callable[[RaceRecord], object], said: str
) -> None:
    record = incident()
    doctor(record)
    assert any(said in text for text in missing(check_incident(record)))


def test_a_node_on_the_domain_of_another_is_named() -> None:
    own = {0: set(RACE_CONTROL_NODES), 7: {'kart_bridge', 'example_stack', 'team_7'}}
    assert check_domains(own).ok
    own[7].add('rcs')
    assert not check_domains(own).ok
    assert 'rcs' in check_domains(own).text


def test_what_was_wrong_on_the_wire_is_said() -> None:
    judge = Judge({5}, {64}, 0.0)
    assert check_wire(judge).ok
    judge.rubbish(5, b'$GO;', 1.0)
    assert "kart 5 was sent b'$GO;'" in check_wire(judge).text
    assert not check_wire(judge).ok


def test_a_process_that_failed_or_is_left_is_named() -> None:
    assert check_end({'bridge 7': 0}, []).ok
    assert 'bridge 7 ended with 1' in check_end({'bridge 7': 1}, []).text
    assert 'still there: 123 rcs_node' in check_end({'bridge 7': 0}, ['123 rcs_node']).text
