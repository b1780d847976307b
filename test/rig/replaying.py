# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

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
        kept = {
            run.number: Kept.read(runs, run)
            for run in runs.listed
            if run.events  # otherwise it was killed before anything was written
        }
    replayed = []
    for number, each in kept.items():
        found = each.replay()
        assert found.difference is None, f'run {number} of {record}: {found.difference}'
        assert not found.missing, f'run {number} of {record}: {found.missing}'
        replayed.append(found)
    return replayed
