# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Inspections in this process, and what they came to."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from typing import TypeVar

from evgp_inspection.inspection import Inspection
from evgp_inspection.traces import Kind
from evgp_inspection.verdicts import Verdict

ATTEMPTS = 10
"""Maximum number of inspections of the same, while other programs hold this computer up."""

APART = 0.1
"""Time between the beginnings of two inspections, in seconds: so they do not all judge at once."""

T = TypeVar('T')


def those(inspection: Inspection, verdict: Verdict) -> dict[str, str]:
    """Return the clauses with this verdict, and why."""
    return {
        each.clause.name: each.finding.why
        for each in inspection.results
        if each.verdict is verdict
    }


def held_up(inspection: Inspection) -> bool:
    """Return whether this computer was busy with something else, so that one has to try again."""
    return any(
        event.kind is Kind.HELD_UP
        for result in inspection.results
        for event in result.finding.evidence
    )


def inspect_all(
    inspected: Sequence[T],
    begin: Callable[[T], Callable[[], Awaitable[Inspection]]],
    is_found: Callable[[T, Inspection], bool] = lambda one, inspection: False,
    was_held_up: Callable[[T], bool] = lambda one: False,
) -> list[Inspection]:
    """
    Inspect all at the same time, and those again for which this computer was held up.

    :param begin: makes the next inspection of one; all are made before any of them runs.
    :param is_found: whether an inspection was good enough although this computer was held up.
    :param was_held_up: whether what was inspected was itself held up in its last inspection.
    """

    async def after(order: int, inspection: Callable[[], Awaitable[Inspection]]) -> Inspection:
        await asyncio.sleep(order * APART)
        return await inspection()

    async def run() -> list[Inspection]:
        found: dict[int, Inspection] = {}
        left = list(range(len(inspected)))
        for _ in range(ATTEMPTS):
            begun = [begin(inspected[each]) for each in left]
            done = await asyncio.gather(*(after(*each) for each in enumerate(begun)))
            found.update(zip(left, done, strict=True))
            left = [
                each
                for each in left
                if held_up(found[each]) or was_held_up(inspected[each])
                if not is_found(inspected[each], found[each])
            ]
            if not left:
                break
        assert not left, f'This computer was busy with something else {ATTEMPTS} times.'
        return [found[each] for each in range(len(inspected))]

    return asyncio.run(run())
