# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A run of a record as a bag: what ``~/race``, ``~/events`` and ``/diagnostics`` said in it."""

from __future__ import annotations

import argparse
import bisect
from collections.abc import Iterator, Sequence
import heapq
import math
import pathlib
import sys
from typing import Any

from evgp_rcs.inputs import entries_of, feed, Input, InputsError, Shown
from evgp_rcs.plain import plain
from evgp_rcs.race import StampedEvent
from evgp_rcs.replay import Kept
from evgp_rcs.runs import (
    add_run_arguments,
    CALLED,
    FAILED,
    open_runs,
    PARTLY,
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
        prog=f'{CALLED} mcap',
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
        from evgp_rcs.bag import write_bag
    except ModuleNotFoundError as error:
        if (error.name or '').split('.')[0] != 'mcap':
            raise
        say(
            'bags need the Python package mcap: install it with '
            f"'{sys.executable} -m pip install mcap'"
        )
        return UNREADABLE
    with open_runs(wanted.file) as runs:
        bagged = _Bagged(Kept.read(runs, runs.choose(wanted.run)))
    try:
        written = write_bag(wanted.out, bagged.messages())
    except OSError as error:
        say(f'{wanted.out} cannot be written: {error.strerror}')
        return FAILED
    print(f'{plain(str(wanted.out))}: {written} messages')
    if bagged.lacks:
        print(plain(bagged.lacks))
    return PARTLY if bagged.is_cut else runs.code


Message = tuple[str, int, Any]
"""A topic, the time in the bag (ns since the epoch), and a message."""


class _Bagged:
    """
    A run as messages.

    A reader puts messages in the order of their times in the bag. So these go by the clock of the
    rules, which nobody sets; the messages themselves have the wall time.
    """

    def __init__(self, kept: Kept) -> None:
        self._kept = kept
        self._clocks = [event.monotonic for event in kept.happened]
        self.is_cut = False
        self.lacks = '' if kept.setup is not None else f'The bag has events only: {kept.lacks}.'

    def messages(self) -> Iterator[Message]:
        """Yield the messages in order; what they lack is known then."""
        both = self._events(), self._races()
        return heapq.merge(*both, key=lambda message: message[1])

    def _in_bag(self, at: float) -> int:
        return self._kept.happened[0].wall_ns + round((at - self._clocks[0]) * NS)

    def _wall_ns(self, at: float) -> int:
        """Return the wall time by the last event before: the clock may have been set meanwhile."""
        place = max(0, bisect.bisect(self._clocks, at) - 1)
        return self._kept.happened[place].wall_ns + round((at - self._clocks[place]) * NS)

    def _events(self) -> Iterator[Message]:
        from evgp_rcs.messages import events_message

        happened = self._kept.happened
        for each in watched(happened, len(happened), 'Writing the bag'):
            stamped = StampedEvent(each.sequence, each.wall_ns, each.monotonic, each.event())
            yield f'/{NODE}/events', self._in_bag(each.monotonic), events_message([stamped])

    def _races(self) -> Iterator[Message]:
        """Yield the race as often as it was published, and diagnostics."""
        from evgp_rcs.messages import diagnostics_message, message_of
        from evgp_rcs_msgs import msg

        told = -math.inf
        for race in self._shown():
            at, in_bag, wall_ns = race.stamp, self._in_bag(race.stamp), self._wall_ns(race.stamp)
            clock_ns = wall_ns - round(at * NS)
            yield f'/{NODE}/race', in_bag, message_of(race, msg.Race, clock_ns)
            if at - told >= DIAGNOSTICS_EVERY:
                told = at
                yield '/diagnostics', in_bag, diagnostics_message(race, wall_ns, NODE)

    def _shown(self) -> Iterator[Snapshot]:
        """Yield every snapshot that the ROS half was sent, up to the first gap or damage."""
        if self._kept.setup is None or not self._kept.happened:
            return
        race, at = self._kept.setup.race(), self._kept.setup.now
        try:
            for entry in entries_of(self._kept.blocks):
                if isinstance(entry, Shown):
                    yield snapshot_of(race, entry.at)
                elif isinstance(entry, Input):
                    at = entry.at
                    feed(entry, race)
        except InputsError as error:
            after = f'{at - self._kept.setup.now:.1f} s after the run began'
            self.is_cut = True
            self.lacks = f'The bag has events only from {after} on: {error}.'
        except Exception as error:
            raise UnreadableError(
                f'the rules do not take the inputs of run {self._kept.run.number} ({error!r}): '
                f'the record is damaged or was changed. {CALLED} replay says where'
            ) from error
