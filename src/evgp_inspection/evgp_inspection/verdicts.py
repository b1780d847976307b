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

"""What a check ends with: a verdict, the time that was measured, why, and what led to it."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
import enum

from evgp_inspection.clauses import Clause
from evgp_inspection.traces import Event


class Verdict(enum.Enum):
    """The verdict on a clause; the value is how reports name it."""

    PASS = 'pass'  # noqa: S105 - a verdict, not a password
    FAIL = 'fail'
    NOT_JUDGED = 'not judged'


@dataclasses.dataclass(frozen=True)
class Finding:
    """
    What a judge says about a trace.

    :ivar why: a sentence: what was seen, or why nothing could be.
    :ivar measured: the time that counts, in seconds; None: this clause measures none.
    :ivar evidence: the events that led to it.
    """

    verdict: Verdict
    why: str
    measured: float | None = None
    evidence: tuple[Event, ...] = ()


@dataclasses.dataclass(frozen=True)
class Result:
    """
    A clause and what was found.

    :ivar limit: the limit that was used, in seconds; None: the clause has none.
    """

    clause: Clause
    finding: Finding
    limit: float | None = None

    @property
    def verdict(self) -> Verdict:
        """Return the verdict."""
        return self.finding.verdict


def verdict_on(results: Sequence[Result]) -> Verdict:
    """
    Return the verdict on the whole.

    It is no pass if a starred clause was not judged: nobody knows whether the wheels stood.
    """
    found = {each.verdict for each in results}
    if Verdict.FAIL in found:
        return Verdict.FAIL
    unseen = any(each.clause.starred and each.verdict is Verdict.NOT_JUDGED for each in results)
    return Verdict.NOT_JUDGED if unseen or Verdict.PASS not in found else Verdict.PASS
