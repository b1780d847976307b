# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Writes the ``~/race``, ``~/events`` and ``/diagnostics`` of a recorded run as a bag."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
import math
import pathlib
import sys
from typing import Any

from evgp_rcs.record.plain import plain
from evgp_rcs.record.replay import Replay
from evgp_rcs.record.runs import FAILED, open_runs, PARTLY, say, UNREADABLE
from evgp_rcs.rules.inputs import Shown
from evgp_rcs.rules.race import StampedEvent
from evgp_rcs.rules.snapshot import snapshot_of

NS = 1_000_000_000

NODE = 'rcs'
"""The node's name in the bag. It may differ from its name during the run."""

DIAGNOSTICS_EVERY = 1.0
"""Time between two messages of diagnostics, in seconds."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options and the help of `rcs_record mcap` to a parser."""
    parser.description = (
        'Write a run, the newest by default, as a bag of ROS messages in the MCAP '
        'format: the race, its events and the diagnostics, at the times at which they were '
        'published.'
    )
    parser.add_argument('out', type=pathlib.Path, help='the bag, a new file (race.mcap)')


def main(wanted: argparse.Namespace) -> int:
    try:
        # This import needs ROS and mcap. mcap may be missing, because it has no rosdep key.
        from evgp_rcs.ros.bag import write_bag
    except ModuleNotFoundError as error:
        if (error.name or '').split('.')[0] != 'mcap':
            raise
        say(
            'bags need the Python package mcap. Install it with '
            f"'{sys.executable} -m pip install mcap'"
        )
        return UNREADABLE
    with open_runs(wanted.file) as runs:
        replay = Replay(runs.read(runs.choose(wanted.run)))
    try:
        written = write_bag(wanted.out, _messages(replay))
    except OSError as error:
        say(f'{wanted.out} cannot be written: {error.strerror}')
        return FAILED
    print(f'{plain(str(wanted.out))}: {written} messages')
    if lacks := replay.lacks:
        print(plain(f'After some point, the bag contains only events, not the race: {lacks}.'))
        return PARTLY
    return runs.code


Message = tuple[str, int, Any]
"""A topic, the message's time in the bag (in ns since the epoch), and the message."""


def _messages(replay: Replay) -> Iterator[Message]:
    """
    Yield a run as messages, including the race as far as the rules can replay it.

    Readers sort messages by their times in the bag. Those times are therefore by the rules'
    clock, which nobody can set. The messages themselves contain the wall time.
    """
    from evgp_node.codec import message_of
    from evgp_rcs.ros.messages import diagnostics_message, events_message
    from evgp_rcs_msgs import msg

    first = next((each for each in replay.kept.events() if isinstance(each, StampedEvent)), None)
    if first is None:
        return
    last, diagnosed = first, -math.inf
    for step in replay.steps():
        for last in step.events:
            told = events_message([last], replay.kept.run.id)
            yield f'/{NODE}/events', _wall_ns(last.monotonic, first), told
        if step.race is not None and isinstance(step.entry, Shown):
            race, at = snapshot_of(step.race, step.entry.at), step.entry.at
            # Someone may have set the wall clock since the first event, but hardly since the last.
            in_bag, wall_ns = _wall_ns(at, first), _wall_ns(at, last)
            yield f'/{NODE}/race', in_bag, message_of(race, msg.Race, wall_ns - round(at * NS))
            if at - diagnosed >= DIAGNOSTICS_EVERY:
                diagnosed = at
                yield '/diagnostics', in_bag, diagnostics_message(race, wall_ns, NODE)


def _wall_ns(at: float, event: StampedEvent) -> int:
    """Return the wall time (ns since the epoch) at a time of the rules, counted from an event."""
    return event.wall_ns + round((at - event.monotonic) * NS)
