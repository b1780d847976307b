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

"""A run of a record, as the report and the results need it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from evgp_rcs.inputs import InputsError, Setup
from evgp_rcs.record import RecordedEvent, Session
from evgp_rcs.report.model import Account, read
from evgp_rcs.runs import Runs


@dataclass(frozen=True)
class OfRun:
    """
    What a record has of a run.

    :param rules: the version of the rules; empty: not recorded.
    :param setup: with what the rules began; None: not recorded, or of another version.
    """

    happened: Sequence[RecordedEvent]
    rules: str
    setup: Setup | None

    def account(self) -> Account:
        """Return what it says."""
        if self.setup is None:
            return read(self.happened)
        teams = {kart.number: kart.team for kart in self.setup.karts}
        return read(self.happened, teams, self.setup.heats)


def read_run(runs: Runs, run: Session) -> OfRun:
    """Read a run; what is damaged of it, it has not."""
    happened = runs.events(run)
    rules, text = runs.setup(run) or ('', '')
    try:
        return OfRun(happened, rules, Setup.from_json(text))
    except InputsError:
        return OfRun(happened, rules, None)
