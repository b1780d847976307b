# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What race control has recorded, and its replay: with the same rules nothing may differ."""

from __future__ import annotations

import pathlib

from evgp_rcs.record.replay import Replay
from evgp_rcs.record.runs import open_runs
from evgp_rcs.rules.race import StampedEvent


def events_of(record: pathlib.Path, number: int | None = None) -> list[StampedEvent]:
    """Return the readable events of a run in a record, by default the newest."""
    with open_runs(record) as runs:
        events = runs.read(runs.choose(number)).events()
        return [each for each in events if isinstance(each, StampedEvent)]


def replay_without_difference(record: pathlib.Path) -> list[Replay]:
    """
    Replay every run of a record, also one that goes on, and return what was compared.

    :raises AssertionError: if anything differs, or inputs are missing.
    :raises UnreadableError: if it cannot be read.
    """
    with open_runs(record) as runs:
        # Without an event it was killed before anything was written.
        kept = [runs.read(run) for run in runs.listed if run.events]
    replayed = []
    for each in kept:
        found = Replay(each).run()
        where = f'run {each.run.number} of {record}'
        assert found.rules is not None, f'{where}: with what the rules began is missing'
        assert found.difference is None, f'{where}: {found.difference}'
        assert not found.missing, f'{where}: {found.missing}'
        replayed.append(found)
    return replayed
