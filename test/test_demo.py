# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The demonstration: what it shows, and that it says so when anything is missing."""

from __future__ import annotations

from collections.abc import Callable
import os
import signal
import subprocess
import sys

from evgp_rcs.record.replay import Replay
from evgp_rcs.rules.race import Event, EventKind, StampedEvent
from evgp_rehearsal.demo import judge_end, judge_events, judge_wire
from evgp_testing.witness import Witness
import pytest
from recorded_races import kept, PaperRace

DEMO = (sys.executable, '-m', 'evgp_rehearsal.demo')


def run_demo(*command: str) -> subprocess.CompletedProcess[str]:
    """Run the demonstration, with its output in a pipe."""
    return subprocess.run(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=110,
    )


# ----- the whole demonstration ------------------------------------------------------------


@pytest.mark.early
def test_both_races_are_driven_and_nothing_is_missing() -> None:
    done = run_demo(*DEMO)

    assert done.returncode == 0, done.stdout
    assert 'MISSING' not in done.stdout
    for line in (
        'GREEN_GREEN refused: waiting for kart 2 (REHEARSAL 2): has not acknowledged GRID_ACTIVE.',
        'the race ended automatically',
        'ALL_KILL: the last simulated kart saw RED_RED',
        'the debrief shows ALL_KILL, and every kart stopped after it',
        'checked: all are as in the record',
        'all 4 processes ended normally, and none is left',
        'Nothing is missing',
    ):
        assert line in done.stdout
    # In a pipe, plain lines that fit a page.
    assert '\x1b' not in done.stdout
    assert max(len(line) for line in done.stdout.splitlines()) <= 100


NEVER_READY = """
import sys
from evgp_rehearsal import demo
demo.TIMEOUT = 15.0
demo.Rehearsal.mend = lambda rehearsal: None
sys.exit(demo.main())
"""
"""Nobody mends the kart that is late."""


@pytest.mark.long
def test_a_kart_that_never_acknowledges_holds_the_race_and_is_named() -> None:
    done = run_demo(sys.executable, '-c', NEVER_READY)

    assert done.returncode == 1, done.stdout
    assert 'not within 15 s: kart 2: GRID_ACTIVE' in done.stdout
    assert 'kart 2 (REHEARSAL 2): has not acknowledged GRID_ACTIVE' in done.stdout
    assert 'race 2' not in done.stdout
    assert 'processes ended normally, and none is left' in done.stdout


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


# ----- that what is missing is said ---------------------------------------------------------


def test_an_event_that_officials_did_not_hear_is_missed() -> None:
    heard = list(range(1, 9))
    recorded = [StampedEvent(n, 0, n, Event(EventKind.ENDED, '')) for n in heard]
    assert judge_events(heard, recorded).good
    assert judge_events(heard[:-1], recorded).good  # of the end of race control
    for wrong in (heard[1:], [*heard[:3], *heard[4:]], []):
        assert not judge_events(wrong, recorded).good


def test_what_was_wrong_on_the_wire_is_said() -> None:
    witness, paper = Witness(), PaperRace({5: 'Purdue'})
    assert judge_wire(witness, Replay(kept(paper.stream()))).good
    witness.strangers.append('somebody was sent something')
    found = judge_wire(witness, Replay(kept(paper.stream())))
    assert (found.good, 'somebody was sent something' in found.text) == (False, True)


def test_a_process_that_failed_or_is_left_is_named() -> None:
    assert judge_end({'bridge': 0}, []).good
    assert 'bridge ended with 1' in judge_end({'bridge': 1}, []).text
    assert 'process 123 is still there' in judge_end({'bridge': 0}, [123]).text
