# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The inspection, from the first connection to the results."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Collection, Coroutine, Mapping, Sequence
from types import MappingProxyType
from typing import Any, TypeAlias

from evgp_inspection.inspector import Inspector
from evgp_inspection.kart_script import KartScript, Kill, STEPS
from evgp_inspection.kart_wire import KartWire
from evgp_inspection.limits import Limits
from evgp_inspection.odometry import Take
from evgp_inspection.recording import EndedError, first, Recording
from evgp_inspection.report import line
from evgp_inspection.traces import Kind
from evgp_inspection.verdicts import Clause, Finding, Inspection, judged

Odometry: TypeAlias = Callable[[Take], Awaitable[Callable[[], None]]]
"""Starts to deliver speeds, in m/s, and returns a function that ends the delivery."""


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
    steps: Collection[str] = (),
) -> Inspection:
    """
    Inspect a kart. Call this once the inspector has typed the word.

    The inspector sees each step when it begins, and each breach as soon as it is found.

    :param clauses: the clauses for the report.
    :param stopping: ends the inspection when it is set, but only after stopping the kart.
    :param port: the port for the kart; with 0, the system chooses one.
    :param kart_address: see `KartWire`.
    :param odometry: starts to deliver speeds; None if there is no odometry.
    :param kills: see `KartScript`.
    :param listening: called with the port once the kart can connect.
    :param steps: the steps to do; if empty, those that the clauses need.
    :raises OSError: if the port or the odometry cannot be used.
    """

    def tell(name: str, found: Finding) -> None:
        inspector.tell(f'{found.at:6.1f}  FAIL  {name}  {found.why}')

    recording = Recording(limits, tell)
    wire = KartWire(recording, inspector.tell, kart_address)
    wanted = steps or {step for clause in clauses for step in clause.steps or STEPS}
    script = KartScript(recording, wire, inspector, limits, odometry is not None, kills)
    end_odometry = None
    if odometry is not None:
        end_odometry = await odometry(lambda speed: recording.note(Kind.SPEED, value=speed))
    try:
        await wire.listen(host, port)
        listening(wire.port)
        finished, remarks = await _until_stopped(script.run(wanted), stopping)
    finally:
        await wire.shut_down()
        if end_odometry is not None:
            end_odometry()
    checks = judged(recording.oracle.findings(), clauses, remarks)
    inspection = Inspection(checks, limits, recording.now, remarks, finished)
    for clause in clauses:
        inspector.tell(line(inspection, clause))
    return inspection


async def _until_stopped(
    script: Coroutine[Any, Any, str], stopping: asyncio.Event
) -> tuple[bool, list[str]]:
    """
    Run a script until it ends or `stopping` is set.

    :return: whether everything was done, and remarks.
    """
    running = asyncio.get_running_loop().create_task(script)
    remarks: list[str] = []
    finished = False
    try:
        await first(running, stopping)
        if not running.done():
            running.cancel()  # only once, because the script's clean-up stops the kart
            remarks.append('The inspection was stopped.')
        remarks += filter(None, [await running])
        finished = True
    except asyncio.CancelledError:
        pass
    except EndedError as error:
        remarks.append(str(error))
    finally:
        running.cancel()
    return finished, remarks
