# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Inspections in this process, on a simulated clock, and what they came to."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection
import dataclasses

from evgp_inspection.inspection import inspect
from evgp_inspection.kart_script import Kill, START_KART_AGAIN
from evgp_inspection.kart_sentences import KART
from evgp_inspection.limits import Limits
from evgp_inspection.odometry import Take
from evgp_inspection.verdicts import Inspection, select, Verdict
from inspected_kart import InspectedKart
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

    def __init__(
        self,
        kind: str = '',
        seen: bool = True,
        only: str = '',
        limits: Limits = SHORT,
        steps: Collection[str] = (),
        long_after: float = 1.8,
        eyes: bool = False,
        starts_again: bool = False,
    ) -> None:
        self.lines: list[str] = []
        self.kart: InspectedKart | None = None
        self.driving = asyncio.Event()
        self.stopping = asyncio.Event()
        self._kind, self._long_after = kind, long_after
        self._seen = seen
        self._only = only
        self._limits = limits
        self._steps = steps
        self._eyes = eyes
        self._starts_again = starts_again
        self._port = 0
        self._takes: list[Take] = []

    def inspect(self) -> Inspection:
        """Inspect to the end, on a simulated clock."""
        return simulated.run(self.run())

    async def run(self) -> Inspection:
        try:
            return await inspect(
                self,
                self._limits,
                select(KART, self._only),
                self.stopping,
                odometry=self._odometry if self._seen else None,
                kills={'bridge': self._kill('bridge'), 'stack': self._kill('stack')},
                listening=self._start_kart,
                steps=self._steps,
            )
        finally:
            self._end_kart()

    def tell(self, line: str) -> None:
        self.lines.append(line)

    async def ask(self, question: str, seconds: float) -> bool | None:
        if self._eyes and self.kart is not None and 'wheels' in question:
            turn = 'turn' in question
            for _ in range(20):  # whoever sees what is asked for says so, a little later
                await asyncio.sleep(0.3)
                if (self.kart.speed > 0.0) is turn:
                    return True
            return False
        if question != START_KART_AGAIN or not self._starts_again:
            return None
        self._end_kart()
        self._start_kart(self._port)
        return True

    def _kill(self, part: str) -> Kill:
        async def kill() -> bool:
            assert self.kart is not None
            self.kart.kill(part)
            return True

        return kill

    def _end_kart(self) -> None:
        if self.kart is not None:
            self.kart.end()

    def _start_kart(self, port: int) -> None:
        self._port = port
        self.kart = InspectedKart(
            port,
            self._take,
            self._kind,
            self._limits.silence,
            self._seen,  # the one that nobody sees says no more than a kart has to
            self._long_after,
        )

    def _take(self, speed: float) -> None:
        if speed > 1.0:
            self.driving.set()
        for take in self._takes:
            take(speed)

    async def _odometry(self, take: Take) -> Callable[[], None]:
        self._takes.append(take)
        return self._takes.clear
