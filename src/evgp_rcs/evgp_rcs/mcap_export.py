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

"""A run of a record as a bag: what ``~/race``, ``~/events`` and ``/diagnostics`` said in it."""

from __future__ import annotations

import argparse
import bisect
from collections.abc import Iterator, Sequence
import contextlib
import heapq
import math
import pathlib
import sys
from typing import Any

from evgp_protocol.states import RaceState
from evgp_rcs.catalogue import CommandKind
from evgp_rcs.inputs import (
    entries_of,
    Entry,
    feed,
    Input,
    InputsError,
    Setup,
    Shown,
)
from evgp_rcs.plain import plain
from evgp_rcs.race import AlertKind, Event, EventKind, StampedEvent
from evgp_rcs.record import RecordedEvent
from evgp_rcs.replay import Kept
from evgp_rcs.runs import (
    add_run_arguments,
    FAILED,
    open_runs,
    Runs,
    say,
    UNREADABLE,
    UnreadableError,
    watched,
)
from evgp_rcs.snapshot import Snapshot, snapshot_of

NS = 1_000_000_000

NODE = 'rcs'
"""The node's name in the bag, whatever it was when the record was made."""

DIAGNOSTICS_EVERY = 1.0
"""Time between two messages of diagnostics, in seconds."""


def options() -> argparse.ArgumentParser:
    """Return what reads the command line of `rcs_record mcap`."""
    parser = argparse.ArgumentParser(
        prog='rcs_record mcap',
        description='Write a run, the newest by default, as a bag of ROS messages in the MCAP '
        'format: the race, its events and the diagnostics, at the times at which they were '
        'published.',
    )
    add_run_arguments(parser)
    parser.add_argument('out', type=pathlib.Path, help='the bag, a new file (race.mcap)')
    return parser


def main(arguments: Sequence[str]) -> int:
    """
    Write a run into a bag.

    :return: the exit code.
    :raises UnreadableError: if the record or the run cannot be read.
    """
    wanted = options().parse_args(arguments)
    try:
        # With the rest of ROS; and mcap has no rosdep key.
        from evgp_rcs.bag import open_bag
    except ModuleNotFoundError as error:
        if (error.name or '').split('.')[0] != 'mcap':
            raise
        say(
            'bags need the Python package mcap: install it with '
            f"'{sys.executable} -m pip install mcap'"
        )
        return UNREADABLE
    with open_runs(wanted.file) as runs:
        messages, lacks = _read(runs, wanted.run)
    written = 0
    try:
        with open_bag(wanted.out) as bag:
            for topic, wall_ns, message in messages:
                bag.write(topic, wall_ns, message)
                written += 1
    except OSError as error:
        say(f'{wanted.out} cannot be written: {error.strerror}')
        return FAILED
    print(f'{plain(str(wanted.out))}: {written} messages')
    if lacks:
        print(plain(lacks))
    return runs.code


Message = tuple[str, int, Any]
"""A topic, the time in the bag (ns since the epoch), and a message."""


def _read(runs: Runs, number: int | None) -> tuple[Iterator[Message], str]:
    """Return the messages of a run in order, and a sentence on what they lack; empty: nothing."""
    kept = Kept.read(runs, runs.choose(number))
    shifts = _shifts(kept.happened)
    events = _events(kept.happened, shifts)
    if kept.setup is None:
        return events, f'The bag has events only: {kept.lacks}.'
    both = events, _races(kept, kept.setup, shifts)
    return heapq.merge(*both, key=lambda message: message[1]), _end_of_race(runs, kept, kept.setup)


def _end_of_race(runs: Runs, kept: Kept, setup: Setup) -> str:
    """Say where the race ends in the bag; empty: it goes to the end of the run."""
    at = setup.now
    try:
        for entry in entries_of(kept.blocks):
            if isinstance(entry, Input):
                at = entry.at
    except InputsError as error:
        runs.damage = runs.damage or str(error)
        after = f'{at - setup.now:.1f} s after the run began'
        return f'The bag has events only from {after} on: {error}.'
    return ''


def _shifts(happened: Sequence[RecordedEvent]) -> list[int]:
    """
    Return for each event by how much its time in the bag is later than its wall time, in ns.

    A reader puts messages in the order of their times in the bag. Where the wall clock was set
    back, those go on as time did; the messages themselves have the wall time.
    """
    shifts: list[int] = []
    shift = 0
    for place, event in enumerate(happened):
        if place:
            before = happened[place - 1]
            if event.wall_ns < before.wall_ns:
                passed = max(0, round((event.monotonic - before.monotonic) * NS))
                shift += before.wall_ns + passed - event.wall_ns
        shifts.append(shift)
    return shifts


def _events(happened: Sequence[RecordedEvent], shifts: Sequence[int]) -> Iterator[Message]:
    from evgp_rcs.messages import events_message

    both = list(zip(happened, shifts, strict=True))
    for each, shift in watched(both, len(both), 'Writing the bag'):
        event = Event(
            EventKind[each.kind],
            each.text,
            each.kart,
            RaceState[each.state] if each.state else None,
            CommandKind[each.command] if each.command else None,
            each.success,
            official=each.official,
            alert=AlertKind[each.alert] if each.alert else None,
        )
        stamped = StampedEvent(each.sequence, each.wall_ns, each.monotonic, event)
        yield f'/{NODE}/events', each.wall_ns + shift, events_message([stamped])


def _races(kept: Kept, setup: Setup, shifts: Sequence[int]) -> Iterator[Message]:
    """Yield the race as often as it was published, and diagnostics."""
    from evgp_rcs.messages import diagnostics_message, race_message

    clocks = [event.monotonic for event in kept.happened]
    told = -math.inf
    for race in _shown(kept, setup):
        # By the last event before: the wall clock may have been set in the meantime.
        place = max(0, bisect.bisect(clocks, race.at) - 1)
        wall_ns = kept.happened[place].wall_ns + round((race.at - clocks[place]) * NS)
        in_bag = wall_ns + shifts[place]
        yield f'/{NODE}/race', in_bag, race_message(race, wall_ns, {})
        if race.at - told >= DIAGNOSTICS_EVERY:
            told = race.at
            yield '/diagnostics', in_bag, diagnostics_message(race, wall_ns, NODE, {})


def _shown(kept: Kept, setup: Setup) -> Iterator[Snapshot]:
    """Yield every snapshot that the ROS half was sent."""
    race = setup.race()
    for entry in _entries(kept):
        if isinstance(entry, Shown):
            if kept.happened:
                yield snapshot_of(race, entry.at)
        elif isinstance(entry, Input):
            try:
                feed(entry, race)
            except Exception as error:
                raise UnreadableError(
                    f'the rules do not take the inputs of run {kept.run.number} ({error!r}): the '
                    'record is damaged or was changed. rcs_record replay says where'
                ) from error


def _entries(kept: Kept) -> Iterator[Entry]:
    """Yield what went into the rules, up to the first gap or damage."""
    with contextlib.suppress(InputsError):
        yield from entries_of(kept.blocks)
