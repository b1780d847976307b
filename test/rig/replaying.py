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
