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

"""What an inspection has come to, and the exit codes."""

from __future__ import annotations

import dataclasses
import enum

from evgp_inspection.verdicts import Result, Verdict, verdict_on


class Exit(enum.IntEnum):
    """The exit codes, for scripts: those two that `make` hands on as they are."""

    PASSED = 0
    NOT_PASSED = 2  # a check failed, or not all was judged, or wrong usage: see the report


@dataclasses.dataclass
class Inspection:
    """
    What an inspection has come to.

    :ivar results: of the clauses that were asked for.
    :ivar seconds: how long it took, s.
    :ivar remarks: sentences on the whole.
    :ivar finished: every step was done.
    :ivar came: there was something to inspect.
    """

    results: list[Result]
    seconds: float = 0.0
    remarks: list[str] = dataclasses.field(default_factory=list)
    finished: bool = False
    came: bool = True

    @property
    def exit_code(self) -> Exit:
        """Return the exit code."""
        good = self.came and self.finished and verdict_on(self.results) is Verdict.PASS
        return Exit.PASSED if good else Exit.NOT_PASSED
