# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Inspections in this process, on a simulated clock, and what they came to."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection
import dataclasses
import functools

from evgp_inspection.inspection import inspect
from evgp_inspection.kart_script import KILLING_STEPS, START_KART_AGAIN
from evgp_inspection.kart_sentences import KART
from evgp_inspection.limits import Limits
from evgp_inspection.odometry import Take
from evgp_inspection.verdicts import Inspection, select, Verdict
from inspected_kart import Kart
import simulated

SHORT = Limits(
    connect=10.0,
    grid=2.0,
    green=2.0,
    red_flag=2.0,
    red_red=2.0,
    silence=0.8,
    reconnect=2.0,
    away=2.5,
    drive=1.4,
    long=6.0,
    dwell=2.5,
    seed=1.0,
    watch=0.8,
    slack=0.4,
    fast=0.6,
    warning=0.0,
    hold=0.8,
)
"""Limits for a kart that stops within a second."""

FULL = dataclasses.replace(Limits(), seed=1.0)
"""The limits of real inspections."""


def those(inspection: Inspection, verdict: Verdict) -> dict[str, str]:
    """Return the clauses with this verdict, and why."""
    return {each.clause.name: each.finding.why for each in inspection.having(verdict)}


@dataclasses.dataclass
class OneInspection:
    """
    One inspection of one kart in this process, and its inspector.

    :param kind: the fault or habit of the kart; empty: it is good and has none.
    :param seen: there is odometry.
    :param long_after: time after which the kart moves off by itself, if that is its fault, s;
        longer than any phase in which it stands, but for `dwell`.
    :param steps: those to be done; none: all that the clauses need.
    :param eyes: the inspector looks at the wheels; otherwise nothing is answered.
    :param starts_again: the inspector starts a kart again that has ended.
    """

    kind: str = ''
    seen: bool = True
    only: str = ''
    limits: Limits = SHORT
    steps: Collection[str] = ()
    long_after: float = 1.8
    eyes: bool = False
    starts_again: bool = False
    kart: Kart | None = None
    driving: asyncio.Event = dataclasses.field(default_factory=asyncio.Event)
    stopping: asyncio.Event = dataclasses.field(default_factory=asyncio.Event)
    _take: Take = lambda speed: None

    def inspect(self) -> Inspection:
        """Inspect to the end, on a simulated clock."""
        return simulated.run(self.run())

    async def run(self) -> Inspection:
        try:
            return await inspect(
                self,
                self.limits,
                select(KART, self.only),
                self.stopping,
                odometry=self._odometry if self.seen else None,
                kills={part: functools.partial(self._kill, part) for part in KILLING_STEPS},
                listening=self._start_kart,
                steps=self.steps,
            )
        finally:
            self._end_kart()

    def tell(self, line: str) -> None:
        pass

    async def ask(self, question: str, seconds: float) -> bool | None:
        assert self.kart is not None
        if self.eyes and 'wheels' in question:
            turn = 'turn' in question
            for _ in range(20):  # whoever sees what is asked for says so, a little later
                await asyncio.sleep(0.3)
                if (self.kart.speed > 0.0) is turn:
                    return True
            return False
        if question != START_KART_AGAIN or not self.starts_again:
            return None
        self._end_kart()
        self._start_kart(self.kart.port)
        return True

    async def _kill(self, part: str) -> bool:
        assert self.kart is not None
        self.kart.kill(part)
        return True

    def _end_kart(self) -> None:
        if self.kart is not None:
            self.kart.end()

    def _start_kart(self, port: int) -> None:
        # One that nobody sees says no more than a kart has to.
        self.kart = Kart(
            port, self._see, self.kind, self.limits.silence, self.seen, self.long_after
        )

    def _see(self, speed: float) -> None:
        if speed > 1.0:
            self.driving.set()
        self._take(speed)

    async def _odometry(self, take: Take) -> Callable[[], None]:
        self._take = take
        return lambda: None
