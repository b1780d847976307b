# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The inspection, from the first connection to the results, and the exit codes."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Mapping, Sequence
import dataclasses
import enum
import time
from types import MappingProxyType
from typing import Any, TypeAlias

from evgp_inspection.inspector import Inspector
from evgp_inspection.kart_clauses import BY_NAME, KART_STEPS
from evgp_inspection.kart_steps import KartSteps, Kill
from evgp_inspection.kart_wire import KartWire
from evgp_inspection.limits import Limits
from evgp_inspection.odometry import Take
from evgp_inspection.recording import EndedError, first, Recording
from evgp_inspection.report import line
from evgp_inspection.traces import Kind
from evgp_inspection.verdicts import (
    Clause,
    judge,
    NOT_DONE,
    Result,
    steps_for,
    Verdict,
    verdict_on,
)

Odometry: TypeAlias = Callable[[Take], Awaitable[Callable[[], None]]]
"""Begins to hand over speeds, in m/s, and returns what ends that."""


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
    """

    results: list[Result]
    seconds: float = 0.0
    remarks: Sequence[str] = ()
    finished: bool = False

    @property
    def exit_code(self) -> Exit:
        """Return the exit code."""
        good = self.finished and verdict_on(self.results) is Verdict.PASS
        return Exit.PASSED if good else Exit.NOT_PASSED


class _Results:
    """
    The results of an inspection that goes on: each is told as soon as its steps are done.

    :param clauses: those that the report is to have.
    :param judge: judges a clause by what was seen so far.
    :param tell: takes each line.
    """

    def __init__(
        self,
        clauses: Sequence[Clause],
        judge: Callable[[Clause], Result],
        tell: Callable[[str], None],
    ) -> None:
        self._clauses = clauses
        self._judge = judge
        self._tell = tell
        self._began = time.monotonic()
        self._done: set[str] = set()
        self._told: set[Clause] = set()

    def step_done(self, name: str) -> None:
        """Tell what can be judged now that this step is done."""
        self._done.add(name)
        for clause in self._clauses:
            if clause.steps and clause not in self._told and self._done.issuperset(clause.steps):
                self._told.add(clause)
                self._tell(line(self._judge(clause)))

    async def of(
        self, steps: Coroutine[Any, Any, str], stopping: asyncio.Event, when_stopped: str
    ) -> tuple[bool, list[str]]:
        """
        Do the steps, until they end or `stopping` is set.

        :return: whether all were done, and remarks.
        """
        running = asyncio.get_running_loop().create_task(steps)
        remarks: list[str] = []
        finished = False
        try:
            await first(running, stopping)
            if not running.done():
                running.cancel()  # once: the end of the steps stops the kart
                remarks.append(when_stopped)
            remarks += filter(None, [await running])
            finished = True
        except asyncio.CancelledError:
            pass
        except EndedError as error:
            remarks.append(str(error))
        finally:
            running.cancel()
        return finished, remarks

    def end(self, finished: bool, remarks: list[str]) -> Inspection:
        """Tell the rest, and return what it has come to."""
        results = [self._judge(clause) for clause in self._clauses]
        if remarks:
            why = f'Not done. {" ".join(remarks)}'
            not_done = dataclasses.replace(NOT_DONE, why=why)
            results = [
                dataclasses.replace(each, finding=not_done) if each.finding == NOT_DONE else each
                for each in results
            ]
        for result in results:
            if result.clause not in self._told:
                self._tell(line(result))
        return Inspection(results, time.monotonic() - self._began, remarks, finished)


async def inspect(
    inspector: Inspector,
    limits: Limits,
    clauses: Sequence[Clause],
    stopping: asyncio.Event,
    host: str = '127.0.0.1',
    port: int = 0,
    kart_address: str = '',
    odometry: Odometry | None = None,
    kills: Mapping[str, Kill] = MappingProxyType({}),
    listening: Callable[[int], object] = lambda port: None,
) -> Inspection:
    """
    Inspect a kart, once the inspector has given the word.

    :param clauses: those that the report is to have.
    :param stopping: ends the inspection when it is set; the kart is stopped first.
    :param port: where the kart connects; 0: the system chooses.
    :param kart_address: see `KartWire`.
    :param odometry: what begins to hand over speeds; None: there is no odometry.
    :param kills: see `KartSteps`.
    :param listening: is called with the port once the kart may connect.
    :raises OSError: the port or the odometry cannot be used.
    """
    recording = Recording()
    wire = KartWire(recording, inspector.tell, kart_address)
    results = _Results(
        clauses, lambda each: judge(BY_NAME, each, recording.trace, limits), inspector.tell
    )
    steps = KartSteps(
        recording,
        wire,
        inspector,
        limits,
        results.step_done,
        steps_for(clauses, KART_STEPS),
        odometry is not None,
        kills,
    )
    end_odometry = None
    if odometry is not None:
        end_odometry = await odometry(lambda speed: recording.note(Kind.SPEED, value=speed))
    try:
        await wire.listen(host, port)
        listening(wire.port)
        done = await results.of(steps.run(), stopping, 'The inspection was stopped.')
    finally:
        await wire.shut_down()
        if end_odometry is not None:
            end_odometry()
    return results.end(*done)
