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

"""Tells the inspector each result as soon as the steps that show it are done."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from evgp_inspection.clauses import Clause
from evgp_inspection.judging import judged
from evgp_inspection.report import line
from evgp_inspection.verdicts import Result


class Telling:
    """
    The results of an inspection that goes on.

    :param chosen: the clauses that the report is to have.
    :param judge: judges a clause by what was seen so far.
    :param tell: takes each line.
    """

    def __init__(
        self,
        chosen: Sequence[Clause],
        judge: Callable[[Clause], Result],
        tell: Callable[[str], None],
    ) -> None:
        self._chosen = chosen
        self._judge = judge
        self._tell = tell
        self._done: set[str] = set()
        self._told: set[str] = set()

    def step_done(self, name: str) -> None:
        """Tell what can be judged now that this step is done."""
        self._done.add(name)
        for clause in self._chosen:
            if (
                clause.steps
                and clause.name not in self._told
                and self._done.issuperset(clause.steps)
            ):
                self._told.add(clause.name)
                self._tell(line(self._judge(clause)))

    def end(self, hindrance: str) -> list[Result]:
        """
        Tell the rest, and return every result.

        :param hindrance: why some steps were not done; empty: all were.
        """
        results = judged([self._judge(clause) for clause in self._chosen], hindrance)
        for result in results:
            if result.clause.name not in self._told:
                self._tell(line(result))
        return results
