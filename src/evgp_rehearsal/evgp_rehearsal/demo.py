# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
``demo``, or ``make demo``: a rehearsal that needs no people and checks its own results.

It runs two races: one from the garage to the finish and back to the garage, and one that ALL_KILL
ends when a kart spins. All karts but one are simulated and use only TCP. That one has the real
bridge and the example stack.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
import contextlib
import os
import pathlib
import signal
import sys
import tempfile
import textwrap
import time
from typing import NamedTuple

from evgp_node.stamps import seconds_of
from evgp_protocol import clock
from evgp_protocol.states import RaceState
from evgp_rcs.record.replay import Replay
from evgp_rcs.record.runs import open_runs
from evgp_rcs.rules.race import StampedEvent
from evgp_rcs_msgs import msg
from evgp_rehearsal.event import BANNER, Rehearsal
from evgp_rehearsal.field import Fault
from evgp_rehearsal.plan import Ability, Plan, Track
from evgp_testing.process import started
from evgp_testing.usage import family
from evgp_testing.witness import Witness

PLAN = Plan(
    Track(((0.0, 0.0), (16.0, 0.0), (16.0, 9.0), (0.0, 9.0))),
    Ability(acceleration=4.0, flag_braking=3.0),
    laps=2,
)
"""A plan with two short laps."""

BRIDGED = PLAN.karts
"""The kart with the real bridge and the example stack. The others are simulated."""

OUTSIDE, LATE = 3, 2
"""The kart outside the race, and the kart whose team is late for GREEN_GREEN."""

STARTERS = tuple(kart for kart in PLAN.numbers if kart != OUTSIDE)

TIMEOUT = 60.0
"""Maximum time to wait for anything, far longer than a busy machine needs, in seconds."""

WIDTH = 100
"""Maximum width of the output, in characters."""


class Finding(NamedTuple):
    """The result of a check, as a sentence."""

    good: bool
    text: str


def put(text: str, indent: int = 0) -> None:
    """Print a line, wrapped; its further lines are indented."""
    print(textwrap.fill(text, WIDTH, subsequent_indent=' ' * indent), flush=True)


def put_title(text: str) -> None:
    print(f'--- {text} '.ljust(WIDTH, '-'), flush=True)


class Show:
    """
    The rehearsal, its official, and the printed output.

    The show waits for everything that must happen in a race.

    :ivar found: what happened, and what did not.
    """

    def __init__(self, rehearsal: Rehearsal) -> None:
        self.rehearsal, self.official = rehearsal, rehearsal.official
        self.official.timeout = TIMEOUT
        self.found: list[Finding] = []
        self._began = clock.now()

    def gather(self) -> None:
        """
        Wait until every kart is connected, then bring the race to IN_GARAGE.

        :raises AssertionError: if any of this does not happen in time.
        """
        self.rehearsal.gather()
        self.official.command('set_in_race', kart=OUTSIDE, in_race=False)
        self._wait_for(RaceState.IN_GARAGE, PLAN.numbers)

    def race(self) -> None:
        """Drive a race from the garage to the finish and back to the garage."""
        official, rehearsal = self.official, self.rehearsal
        with rehearsal.lock:
            rehearsal.field.karts[LATE].faults.add(Fault.NEVER_READY)
        ready = [kart for kart in STARTERS if kart != LATE]
        official.bring_to(RaceState.GRID_ACTIVE, *ready)
        self._wait_for(RaceState.GRID_ACTIVE, ready)
        refused = official.call('green_green')
        assert not refused.success, f'GREEN_GREEN does not wait for kart {LATE}'
        self.found.append(Finding(True, f'race control answered: {refused.message}'))
        rehearsal.mend()
        self._green()
        for kart in (*self._laps(), BRIDGED):
            official.command('kart/finish', kart=kart)
        official.wait_for_race(lambda race: race.over, 'the race ends automatically')
        self.found.append(Finding(True, 'the race ended automatically'))
        self._to_garage(STARTERS)

    def _laps(self) -> list[int]:
        """Wait until the laps of the simulated karts are counted; return these karts, in order."""
        timed = [kart for kart in STARTERS if kart != BRIDGED]
        results = self.official.wait_for_results(
            lambda seen: {*timed} <= {kart.kart for kart in seen.karts if kart.laps == PLAN.laps},
            f'{PLAN.laps} laps of karts {timed} are counted',
        )
        placed = [each for each in results.karts if each.kart in timed]
        best = min(min(each.lap_times) for each in placed)
        text = f'{PLAN.laps} laps of karts {timed} were counted, the best in {best:.3f} s'
        self.found.append(Finding(True, text))
        return [each.kart for each in placed]

    def kill(self) -> None:
        """Drive a race in which a kart spins, and the official presses ALL_KILL."""
        rehearsal = self.rehearsal
        self._green()
        self.official.wait_until_polled(lambda: rehearsal.can_begin('spin'), 'every kart races')
        rehearsal.inject('spin')
        called = time.monotonic()
        self.official.command('all_kill', official='demo')
        assert not self.official.call('green_green').success, 'GREEN_GREEN came after ALL_KILL'
        self._wait_for(RaceState.RED_RED, PLAN.numbers)
        took = (max(link.changes[-1][0] for link in rehearsal.links.values()) - called) * 1000
        text = f'ALL_KILL: the last simulated kart saw RED_RED {took:.0f} ms after the call'
        self.found.append(Finding(True, text))
        self._to_garage(PLAN.numbers)

    def play(self, title: str, drive: Callable[[], None]) -> bool:
        """Show a race and return whether it reached its end."""
        put_title(f'{BANNER}: {title}')
        try:
            drive()
        except AssertionError as error:
            # The error says what did not happen and, after a semicolon, what happened instead.
            why = f'{title.split(",")[0]} stopped early: {str(error).split(";")[0]}'
            self.found.append(Finding(False, why))
            return False
        return True

    def judge(self, around: Sequence[Finding]) -> list[Finding]:
        """Print all findings and return them."""
        lines = [line for each in self.rehearsal.debriefs() for line in each]
        put_title('debrief')
        for line in lines:
            put(line, 14)
        text = '\n'.join(lines)
        stood = 'sent ALL_KILL' in text and 'is still moving' not in text
        ends = Finding(stood, 'the debrief shows ALL_KILL, and every kart stopped after it')
        found = [*self.found, ends, *around]
        put_title('findings')
        for each in found:
            put(f'{"ok" if each.good else "MISSING":9}{each.text}', 9)
        return found

    def _wait_for(self, state: RaceState, karts: Sequence[int]) -> None:
        """Wait until these karts have acknowledged, and each simulated one has seen the state."""
        garage = state is RaceState.IN_GARAGE
        self.official.wait_for_acks(state, *karts, needs_ack=not garage)
        for kart in karts:
            if kart != BRIDGED:
                link = self.rehearsal.links.get(kart)
                assert link is not None, f'kart {kart} has lost its connection'
                link.wait_for_state(state)

    def _green(self) -> None:
        self.official.bring_to(RaceState.GREEN_GREEN, *STARTERS)
        self._wait_for(RaceState.GREEN_GREEN, STARTERS)

    def _to_garage(self, stopped: Sequence[int]) -> None:
        """Wait until these karts have stopped, then send all karts to the garage."""
        self._wait_for(RaceState.RED_RED, stopped)
        self.rehearsal.mend()
        self.official.command('in_garage', track_safe=True)
        self._wait_for(RaceState.IN_GARAGE, PLAN.numbers)

    def tell(self, event: msg.RaceEvent) -> None:
        """Print an event."""
        at = seconds_of(event.monotonic) - self._began
        bad = event.kind == msg.RaceEvent.ALERT_RAISED or not event.success
        put(f'{at:7.3f} {"!" if bad else " "} {event.text}', 10)


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Show two races.

    :return: 0 if everything happened as it must, 1 if anything is missing, 130 after Ctrl-C.
    """
    parser = argparse.ArgumentParser(
        prog='demo',
        description='Show a complete race, and one that ALL_KILL ends. Exit code 1 if anything is '
        'missing.',
    )
    parser.parse_args(arguments)
    # Signals must also end the demonstration's processes. A program that a shell starts in the
    # background would ignore SIGINT.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    began = clock.now()
    try:
        found = _show()
    except KeyboardInterrupt:
        print('Interrupted')
        return 130
    missing = sum(not each.good for each in found)
    verdict = f'{missing} of {len(found)} findings MISSING' if missing else 'Nothing is missing'
    put_title(f'{verdict}; {clock.now() - began:.1f} s')
    return 1 if missing else 0


def _show() -> list[Finding]:
    wire = Witness()
    with contextlib.ExitStack() as stack:
        folder = pathlib.Path(stack.enter_context(tempfile.TemporaryDirectory()))
        with contextlib.ExitStack() as running:
            rehearsal = running.enter_context(Rehearsal(PLAN, folder, bridged=1, witness=wire))
            show = Show(rehearsal)
            rehearsal.official.tell_each(show.tell)
            for title, drive in (
                ('the karts connect', show.gather),
                ('race 1, from the garage to the garage', show.race),
                ('race 2, ALL_KILL in mid-race', show.kill),
            ):
                if not show.play(title, drive):
                    break
            pids = family(os.getpid())[1:]
        with open_runs(folder / 'record.sqlite3') as runs:
            replay = Replay(runs.read(runs.choose(None)))
        heard = [event.sequence for event in rehearsal.official.events]
        found = show.judge(
            [
                judge_events(heard, rehearsal.events()),
                judge_wire(wire, replay),
                judge_end(
                    {f'{each.name} {each.pid}': each.wait() for each in started},
                    [pid for pid in pids if pathlib.Path(f'/proc/{pid}').exists()],
                ),
            ]
        )
        for each in started:
            if each.wait():
                print(f'{each.name} said last:', *each.lines[-8:], sep='\n')
        return found


def judge_wire(witness: Witness, replay: Replay) -> Finding:
    """Return whether the simulated karts were sent, and commands got, what the record has."""
    for each in witness.compare(replay):
        return Finding(False, f'on the wire: {each}')
    return Finding(
        True,
        f'{witness.frames} frames to the karts without ROS and {len(witness.calls)} commands '
        'checked: all are as in the record',
    )


def judge_events(heard: Sequence[int], recorded: Sequence[StampedEvent]) -> Finding:
    """Return whether officials received every event of the record up to their last one."""
    if not heard or list(heard) != [each.sequence for each in recorded[: len(heard)]]:
        return Finding(False, f'/rcs/events has gaps or is empty: {len(heard)} events')
    return Finding(True, f'/rcs/events matches the record: {len(heard)} events without a gap')


def judge_end(codes: Mapping[str, int], left: Sequence[int]) -> Finding:
    """Return whether every process ended normally and none is left."""
    wrong = [f'{name} ended with {code}' for name, code in codes.items() if code]
    wrong += [f'process {pid} is still there' for pid in left]
    if wrong:
        return Finding(False, f'not every process ended normally: {"; ".join(wrong)}')
    return Finding(True, f'all {len(codes)} processes ended normally, and none is left')


if __name__ == '__main__':
    sys.exit(main())
