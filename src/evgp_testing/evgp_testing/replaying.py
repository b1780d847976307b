"""Replays of what race control has recorded: with the same rules nothing may differ."""

from __future__ import annotations

import pathlib

from evgp_rcs.replay import Kept, Replayed
from evgp_rcs.runs import open_runs


def replay_without_difference(record: pathlib.Path) -> list[Replayed]:
    """
    Replay every run of a record, also one that goes on, and return what was compared.

    :raises AssertionError: if anything differs, or inputs are missing.
    :raises UnreadableError: if it cannot be read.
    """
    with open_runs(record) as runs:
        present = runs.present
        kept = [(Kept.read(runs.database, run.number), run is present) for run in runs.listed]
    replayed = [each.replay(goes_on) for each, goes_on in kept]
    for number, each in enumerate(replayed, 1):
        assert each.difference is None, f'run {number} of {record}: {each.difference}'
        assert not each.missing, f'run {number} of {record}: {each.missing}'
    return replayed
