# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Clauses, findings and verdicts: what an inspection checks, and how each check ends. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
import enum
from typing import NamedTuple

from evgp_inspection.limits import Limits
from evgp_inspection.traces import Event, Kind

EARLY = 0.05
"""Maximum time by which a wait may end before its limit and still be complete, in seconds."""


class Verdict(enum.Enum):
    """The verdict on a clause. The value is its name in reports."""

    PASS = 'pass'  # noqa: S105 - a verdict, not a password
    FAIL = 'fail'
    NOT_JUDGED = 'not judged'

    @property
    def exit_code(self) -> int:
        """Return the exit code of a program; `make` passes on these two unchanged."""
        return 0 if self is Verdict.PASS else 2


class Finding(NamedTuple):
    """
    The finding of an inspection about a clause. Times are in seconds.

    :ivar why: a sentence that says what was seen, or why nothing could be seen.
    :ivar measured: the measured time; None if no time is measured for this clause.
    :ivar evidence: the events that led to the finding.
    :ivar since: the time at which its cause began.
    :ivar at: the time at which it was found.
    """

    verdict: Verdict
    why: str
    measured: float | None = None
    evidence: tuple[Event, ...] = ()
    since: float = 0.0
    at: float = 0.0

    @property
    def rank(self) -> tuple[int, float]:
        """Return how grave it is: by the verdict and, in a pass, by the time it took."""
        verdicts = (Verdict.PASS, Verdict.NOT_JUDGED, Verdict.FAIL)
        return verdicts.index(self.verdict), self.measured or 0.0


@dataclasses.dataclass(frozen=True)
class Clause:
    """
    A sentence that an inspection checks.

    :ivar source: the source of the sentence, which is the proposal or a document.
    :ivar name: K, the § of the proposal, and a number, such as ``K-3A-07``.
    :ivar title: what a good kart does, in a few words.
    :ivar sentence: the sentence, as in the source.
    :ivar steps: the steps that show whether the kart fulfils it; empty if the whole inspection
        does.
    :ivar limit: the name of its limit; empty if it has none.
    :ivar starred: whether the clause is about wheels that turn or stand still. It is not judged if
        neither eyes nor odometry see them, and no inspection is then passed.
    """

    source: str
    name: str
    title: str
    sentence: str
    steps: tuple[str, ...] = ()
    limit: str = ''
    starred: bool = False

    @property
    def section(self) -> str:
        """Return the § of the proposal to which the clause belongs."""
        return f'§{self.name[2]}.{self.name[3]}'

    def explain(self, done: Mapping[str, str]) -> str:
        """
        Return the complete description of the clause.

        :param done: the description of each step.
        """
        lines = [
            f'{self.name}{"*" if self.starred else " "} {self.title}',
            f'  {self.section}, {self.source}: "{self.sentence}"',
        ]
        lines += [f'  {step}: {done[step]}' for step in self.steps]
        lines += [f'  Limit: --{self.limit.replace("_", "-")}'] if self.limit else []
        return '\n'.join(lines)


def select(clauses: Sequence[Clause], wanted: str) -> tuple[Clause, ...]:
    """
    Return the clauses that a user names.

    :param wanted: names or their beginnings, separated by commas; if empty, all clauses.
    :raises ValueError: if one of them matches no clause.
    """
    parts = [part.strip().upper() for part in wanted.split(',') if part.strip()]
    for part in parts:
        if not any(clause.name.startswith(part) for clause in clauses):
            raise ValueError(f'no clause begins with {part}: --list shows all')
    return tuple(each for each in clauses if not parts or each.name.startswith(tuple(parts)))


def judged(
    findings: Mapping[str, Finding], clauses: Sequence[Clause], remarks: Sequence[str] = ()
) -> dict[Clause, Finding]:
    """
    Return the findings about these clauses. No clause fails if the inspecting computer was late.

    :param remarks: sentences that say why some steps were not done.
    """
    why = f'Not done. {" ".join(remarks)}' if remarks else 'The inspection did not get this far.'
    checks = {}
    for clause in clauses:
        finding = findings.get(clause.name, Finding(Verdict.NOT_JUDGED, why))
        late = [each.value for each in finding.evidence if each.kind is Kind.HELD_UP]
        if finding.verdict is Verdict.FAIL and late:
            why_not = f'The inspecting computer hung for {max(late):.1f} s. Inspect again.'
            finding = finding._replace(verdict=Verdict.NOT_JUDGED, why=why_not)
        checks[clause] = finding
    return checks


@dataclasses.dataclass
class Inspection:
    """
    A whole inspection, as its report shows it.

    :ivar checks: the clauses that were asked for, with their findings.
    :ivar limits: the limits used.
    :ivar seconds: the duration, in seconds.
    :ivar remarks: sentences about the whole inspection, such as why it was not finished.
    :ivar finished: whether every step was done.
    :ivar subject: what was inspected, such as ``kart 7``.
    :ivar team: the team of the subject.
    :ivar inspector: the inspector's name; empty if the inspection is unattended.
    :ivar began: the date and time of the start, in ISO 8601.
    """

    checks: Mapping[Clause, Finding]
    limits: Limits
    seconds: float = 0.0
    remarks: Sequence[str] = ()
    finished: bool = False
    subject: str = 'kart'
    team: str = ''
    inspector: str = ''
    began: str = ''

    def having(self, verdict: Verdict) -> dict[Clause, Finding]:
        return {clause: found for clause, found in self.checks.items() if found.verdict is verdict}

    def limit_of(self, clause: Clause) -> float | None:
        """Return the limit used for a clause, in seconds; None if it has none."""
        return getattr(self.limits, clause.limit) if clause.limit else None

    @property
    def verdict(self) -> Verdict:
        """
        Return the verdict on the whole inspection.

        It is not a pass if a starred clause was not judged, because nobody knows then whether the
        wheels stood still; nor if only the lateness of the inspecting computer excuses a kart.
        """
        if self.having(Verdict.FAIL):
            return Verdict.FAIL
        # What was seen, and is not judged, is the finding's evidence.
        doubtful = any(
            clause.starred or finding.evidence
            for clause, finding in self.having(Verdict.NOT_JUDGED).items()
        )
        passed = self.finished and not doubtful and self.having(Verdict.PASS)
        return Verdict.PASS if passed else Verdict.NOT_JUDGED

    def summary(self) -> str:
        """Return the summary in one line."""
        passed, failed, not_judged = (len(self.having(each)) for each in Verdict)
        return (
            f'{self.verdict.value.upper()}: '
            f'{passed} passed, {failed} failed, {not_judged} not judged'
        )
