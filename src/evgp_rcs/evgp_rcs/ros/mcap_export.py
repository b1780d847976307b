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

from evgp_node.stream import Gap
from evgp_rcs.record.plain import plain
from evgp_rcs.record.replay import Replay
from evgp_rcs.record.runs import (
    add_run_arguments,
    CALLED,
    FAILED,
    Kept,
    open_runs,
    PARTLY,
    say,
    UNREADABLE,
)
from evgp_rcs.rules.inputs import Shown
from evgp_rcs.rules.snapshot import snapshot_of

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
        from evgp_rcs.ros.bag import write_bag
    except ModuleNotFoundError as error:
        if (error.name or '').split('.')[0] != 'mcap':
            raise
        say(
            'bags need the Python package mcap: install it with '
            f"'{sys.executable} -m pip install mcap'"
        )
        return UNREADABLE
    with open_runs(wanted.file) as runs:
        bagged = _Bagged(runs.read(runs.choose(wanted.run)))
    try:
        written = write_bag(wanted.out, bagged.messages())
    except OSError as error:
        say(f'{wanted.out} cannot be written: {error.strerror}')
        return FAILED
    print(f'{plain(str(wanted.out))}: {written} messages')
    if lacks := bagged.replay.lacks:
        print(plain(f'The bag has the race up to there only, and then events: {lacks}.'))
        return PARTLY
    return runs.code


Message = tuple[str, int, Any]
"""A topic, the time in the bag (ns since the epoch), and a message."""


class _Bagged:
    """
    A run as messages.

    A reader puts messages in the order of their times in the bag. So these go by the clock of the
    rules, which nobody sets; the messages themselves have the wall time.
    """

    def __init__(self, kept: Kept) -> None:
        self._happened = [each for each in kept.events() if not isinstance(each, Gap)]
        self._clocks = [event.monotonic for event in self._happened]
        self.replay = Replay(kept)

    def messages(self) -> Iterator[Message]:
        """Yield the messages in order; what they lack, `replay` knows then."""
        both = self._events(), self._races()
        return heapq.merge(*both, key=lambda message: message[1])

    def _in_bag(self, at: float) -> int:
        return self._happened[0].wall_ns + round((at - self._clocks[0]) * NS)

    def _wall_ns(self, at: float) -> int:
        """Return the wall time by the last event before: the clock may have been set meanwhile."""
        place = max(0, bisect.bisect(self._clocks, at) - 1)
        return self._happened[place].wall_ns + round((at - self._clocks[place]) * NS)

    def _events(self) -> Iterator[Message]:
        from evgp_rcs.ros.messages import events_message

        for each in self._happened:
            yield f'/{NODE}/events', self._in_bag(each.monotonic), events_message([each])

    def _races(self) -> Iterator[Message]:
        """Yield the race as often as it was published, as far as rules can follow; diagnostics."""
        from evgp_node.codec import message_of
        from evgp_rcs.ros.messages import diagnostics_message
        from evgp_rcs_msgs import msg

        told = -math.inf
        for step in self.replay.steps() if self._happened else ():
            if step.race is None or not isinstance(step.entry, Shown):
                continue
            race = snapshot_of(step.race, step.entry.at)
            at, in_bag, wall_ns = race.stamp, self._in_bag(race.stamp), self._wall_ns(race.stamp)
            clock_ns = wall_ns - round(at * NS)
            yield f'/{NODE}/race', in_bag, message_of(race, msg.Race, clock_ns)
            if at - told >= DIAGNOSTICS_EVERY:
                told = at
                yield '/diagnostics', in_bag, diagnostics_message(race, wall_ns, NODE)
