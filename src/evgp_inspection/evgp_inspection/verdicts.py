# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What is checked, and what a check ends with: clauses, their judges, findings, verdicts. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
import dataclasses
import enum
import functools
from typing import Any

from evgp_inspection.traces import Event, Kind, Section, Trace

AFTERMATH = 2.0
"""Time for which a hold-up of the inspecting computer still shows in what others do, s: to them it
was a silence."""

NOTICED = 1.0
"""Maximum time after a hold-up until the inspecting computer notices it itself, s: what has come
meanwhile may be read first."""

EARLY = 0.05
"""A wait that ended this much before its limit was not cut short, s."""


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


def failed(why: str, *sections: Section, measured: float | None = None) -> Finding:
    """Return a failure, with all that happened in these phases as its evidence."""
    return Finding(Verdict.FAIL, why, measured, _evidence(sections))


def passed(why: str, *sections: Section, measured: float | None = None) -> Finding:
    """Return a pass, with all that happened in these phases as its evidence."""
    return Finding(Verdict.PASS, why, measured, _evidence(sections))


def not_judged(why: str, *sections: Section) -> Finding:
    """Return that nothing can be said, with all that happened in these phases."""
    return Finding(Verdict.NOT_JUDGED, why, None, _evidence(sections))


def _evidence(sections: Iterable[Section]) -> tuple[Event, ...]:
    return tuple(event for section in sections for event in section.events)


def worst(findings: Sequence[Finding]) -> Finding:
    """Return a failure if there is one, else what was not judged, else the slowest pass."""
    rank = (Verdict.PASS, Verdict.NOT_JUDGED, Verdict.FAIL)
    return max(findings, key=lambda each: (rank.index(each.verdict), each.measured or 0.0))


NOT_DONE = Finding(Verdict.NOT_JUDGED, 'The inspection did not come to this.')


@dataclasses.dataclass(frozen=True)
class Judge:
    """
    Makes a finding of a trace.

    :ivar find: does so, by the limits of the inspection.
    :ivar judged: what makes the verdict, for people.
    :ivar phases: the phases that show it; empty: the whole inspection does.
    :ivar limit: the name of its limit; empty: it has none.
    :ivar starred: it is about whether the wheels turn or stand, and not judged where nobody and
        nothing sees them. Without it no inspection is passed.
    """

    find: Callable[[Trace, Any], Finding]
    judged: str
    phases: tuple[str, ...] = ()
    limit: str = ''
    starred: bool = False


def judge_of(
    *phases: str, judged: str, limit: str = '', starred: bool = False
) -> Callable[[Callable[..., Finding]], Judge]:
    """
    Make a judge of a function that takes the trace, the limits and these phases.

    Where there was no such phase, it is not asked: the inspection did not come to this.
    """

    def made(find: Callable[..., Finding]) -> Judge:
        def in_phases(trace: Trace, limits: Any) -> Finding:
            sections = [trace.called(each) for each in phases]
            return NOT_DONE if None in sections else find(trace, limits, *sections)

        return Judge(in_phases, judged, phases, limit, starred)

    return made


SAID_NOTHING = not_judged('It said nothing at all.')


@judge_of(judged='Fail: bytes that are no frame.')
def says_frames(trace: Trace, limits: Any) -> Finding:
    """Judge whether everything that is said is a frame."""
    frames = 0
    for section in trace.sections:
        for said in section.said:
            frames += 1
            if said.state is None:
                return failed(f'It said {said}', section)
    return passed(f'It said {frames} frames.') if frames else SAID_NOTHING


@dataclasses.dataclass(frozen=True)
class Clause:
    """
    One clause, and how it is checked: everything that names, selects or judges a check goes by it.

    :ivar source: where the sentence is: the proposal or a document.
    :ivar name: K, the § of the proposal, and a number, such as ``K-3A-07``.
    :ivar title: what a good one does, in a few words.
    :ivar sentence: the sentence, as it is in the source.
    :ivar done: what the inspection does.
    :ivar unless: clauses whose failure is the cause of this one's: it is not judged then.
    """

    source: str
    name: str
    title: str
    sentence: str
    done: str
    judge: Judge
    unless: tuple[str, ...] = ()

    @property
    def section(self) -> str:
        """Return the § of the proposal that it belongs to."""
        return f'§{self.name[2]}.{self.name[3]}'

    @property
    def steps(self) -> tuple[str, ...]:
        """Return the steps that show it; empty: the whole inspection does."""
        return tuple(dict.fromkeys(phase.partition('/')[0] for phase in self.judge.phases))

    def explain(self) -> str:
        """Return all that the row says, for a person."""
        lines = [
            f'{self.name}  {self.title}',
            f'  {self.section}, {self.source}: "{self.sentence}"',
            f'  Done:    {self.done}',
            f'  Judged:  {self.judge.judged}',
        ]
        if self.judge.limit:
            lines.append(f'  Limit:   --{self.judge.limit.replace("_", "-")}')
        if self.unless:
            lines.append(f'  Not judged where {" or ".join(self.unless)} fails: the same fault.')
        lines.append(f'  Step:    {", ".join(self.steps) or "the whole inspection"}')
        return '\n'.join(lines)

    def line(self) -> str:
        """Return it in one line."""
        return f'{self.name}{"*" if self.judge.starred else " "} {self.section:5} {self.title}'


proposal = functools.partial(Clause, 'proposal')
wire = functools.partial(Clause, 'docs/wire.md')

DISCONNECTED = (
    'If a kart has disconnected (as described in Connection status) during the race, the kart '
    'shall immediately enter the RED_RED state.'
)
"""A sentence of the proposal, §3.E."""


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


def select(clauses: Sequence[Clause], wanted: str) -> tuple[Clause, ...]:
    """
    Return the clauses that a person names.

    :param wanted: identifiers or their beginnings, with commas between; empty: all.
    :raises ValueError: a part of it names no clause.
    """
    parts = [part.strip().upper() for part in wanted.split(',') if part.strip()]
    for part in parts:
        if not any(clause.name.startswith(part) for clause in clauses):
            raise ValueError(f'no clause begins with {part}: --list shows all')
    return tuple(each for each in clauses if not parts or each.name.startswith(tuple(parts)))


def steps_for(clauses: Sequence[Clause], steps: tuple[str, ...]) -> tuple[str, ...]:
    """Return those of the steps that these clauses need, in their order."""
    needed = {step for clause in clauses for step in clause.steps or steps}
    return tuple(step for step in steps if step in needed)


def judge(by_name: Mapping[str, Clause], clause: Clause, trace: Trace, limits: Any) -> Result:
    """
    Judge a clause; one whose failure follows from that of another is not judged.

    :param by_name: all clauses of what is inspected.
    """
    finding = clause.judge.find(trace, limits)
    if finding.verdict is Verdict.FAIL:
        finding = dataclasses.replace(
            finding, evidence=(*_late_around(finding, trace), *finding.evidence)
        )
        causes = (by_name[name] for name in clause.unless)
        late = [event.value for event in finding.evidence if event.kind is Kind.HELD_UP]
        why = ''
        if late:
            why = f'The inspecting computer was held up for {max(late):.1f} s. Inspect again.'
        elif cause := next((c for c in causes if _fails(c, trace, limits)), None):
            why = f'{cause.name} fails: this is the same fault, or follows from it.'
        if why:
            finding = dataclasses.replace(finding, verdict=Verdict.NOT_JUDGED, why=why)
    limit = clause.judge.limit
    return Result(clause, finding, getattr(limits, limit) if limit else None)


def _fails(clause: Clause, trace: Trace, limits: Any) -> bool:
    return clause.judge.find(trace, limits).verdict is Verdict.FAIL


def _late_around(finding: Finding, trace: Trace) -> list[Event]:
    """Return the hold-ups shortly before or after the evidence of a finding."""
    if not finding.evidence:
        return []
    began, ended = finding.evidence[0].at, finding.evidence[-1].at
    known = {id(event) for event in finding.evidence}
    return [
        event
        for event in trace.events
        if event.kind is Kind.HELD_UP
        and began - AFTERMATH <= event.at
        and event.at - event.value <= ended + NOTICED
        and id(event) not in known
    ]


def verdict_on(results: Sequence[Result]) -> Verdict:
    """
    Return the verdict on the whole.

    It is no pass if a starred clause was not judged: nobody knows whether the wheels stood.
    """
    found = {each.verdict for each in results}
    if Verdict.FAIL in found:
        return Verdict.FAIL
    unseen = any(
        each.clause.judge.starred and each.verdict is Verdict.NOT_JUDGED for each in results
    )
    return Verdict.NOT_JUDGED if unseen or Verdict.PASS not in found else Verdict.PASS
