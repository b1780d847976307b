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

"""What the judges of karts and of race controls have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
import dataclasses
from typing import TypeVar

from evgp_inspection.clauses import Clause
from evgp_inspection.traces import Event, Kind, Section, Trace
from evgp_inspection.verdicts import Finding, Result, Verdict

L = TypeVar('L')


def failed(why: str, *sections: Section, measured: float | None = None) -> Finding:
    """Return a failure, with all that happened in these phases as its evidence."""
    return Finding(Verdict.FAIL, why, measured, evidence(sections))


def passed(why: str, *sections: Section, measured: float | None = None) -> Finding:
    """Return a pass, with all that happened in these phases as its evidence."""
    return Finding(Verdict.PASS, why, measured, evidence(sections))


def not_judged(why: str, *sections: Section) -> Finding:
    """Return that nothing can be said, with all that happened in these phases."""
    return Finding(Verdict.NOT_JUDGED, why, None, evidence(sections))


def evidence(sections: Iterable[Section]) -> tuple[Event, ...]:
    """Return all that happened in these phases."""
    return tuple(event for section in sections for event in section.events)


NOT_DONE = Finding(Verdict.NOT_JUDGED, 'The inspection did not come to this.')


def judge_by(
    judges: Mapping[str, Callable[[Trace, L], Finding]], clause: Clause, trace: Trace, limits: L
) -> Result:
    """
    Judge a clause; one whose failure follows from that of another is not judged.

    :param judges: the judge of each clause, by its name.
    """
    finding = judges[clause.name](trace, limits)
    if finding.verdict is Verdict.FAIL:
        late = _late_around(finding, trace)
        if late:
            finding = dataclasses.replace(finding, evidence=(*late, *finding.evidence))
        why = _doubt(judges, clause, finding, trace, limits)
        if why:
            finding = dataclasses.replace(finding, verdict=Verdict.NOT_JUDGED, why=why)
    return Result(clause, finding, getattr(limits, clause.limit) if clause.limit else None)


AFTERMATH = 2.0
"""Time for which a hold-up of the inspecting computer still shows in what others do, s: to them it
was a silence."""

NOTICED = 1.0
"""Maximum time after a hold-up until the inspecting computer notices it itself, s: what has come
meanwhile may be read first."""


def _late_around(finding: Finding, trace: Trace) -> tuple[Event, ...]:
    """Return the hold-ups shortly before or after the evidence of a finding."""
    if not finding.evidence:
        return ()
    began, ended = finding.evidence[0].at, finding.evidence[-1].at
    known = {id(event) for event in finding.evidence}
    return tuple(
        event
        for event in trace.events
        if event.kind is Kind.HELD_UP
        and began - AFTERMATH <= event.at
        and event.at - event.value <= ended + NOTICED
        and id(event) not in known
    )


def _doubt(
    judges: Mapping[str, Callable[[Trace, L], Finding]],
    clause: Clause,
    finding: Finding,
    trace: Trace,
    limits: L,
) -> str:
    """Return why a failure does not count, a sentence; empty: it does."""
    late = [event.value for event in finding.evidence if event.kind is Kind.HELD_UP]
    if late:
        return f'The inspecting computer was held up for {max(late):.1f} s. Inspect again.'
    for cause in clause.unless:
        if judges[cause](trace, limits).verdict is Verdict.FAIL:
            return f'{cause} fails: this is the same fault, or follows from it.'
    return ''


def steps_for(chosen: Sequence[Clause], steps: tuple[str, ...]) -> tuple[str, ...]:
    """Return those of the steps that these clauses need, in their order."""
    if any(not clause.steps for clause in chosen):
        return steps
    wanted = {step for clause in chosen for step in clause.steps}
    return tuple(step for step in steps if step in wanted)


def judged(results: Sequence[Result], hindrance: str = '') -> list[Result]:
    """
    Return the results, with the reason where a step was not done.

    :param hindrance: why some steps were not done, a sentence; empty: all were.
    """
    if not hindrance:
        return list(results)
    not_done = dataclasses.replace(NOT_DONE, why=f'Not done. {hindrance}')
    return [
        dataclasses.replace(each, finding=not_done) if each.finding == NOT_DONE else each
        for each in results
    ]
