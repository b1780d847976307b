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

"""The inspection of a race control, from the first connection to the results."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
import time

from evgp_inspection.clauses import Clause
from evgp_inspection.drivers import Driver
from evgp_inspection.inspection import Inspection
from evgp_inspection.inspector import Inspector
from evgp_inspection.judging import steps_for
from evgp_inspection.limits import RcsLimits
from evgp_inspection.rcs_clauses import RCS_STEPS
from evgp_inspection.rcs_judges import judge
from evgp_inspection.rcs_karts import Field
from evgp_inspection.rcs_steps import NotInGarageError, RcsSteps
from evgp_inspection.recording import first, Recording
from evgp_inspection.telling import Telling


async def inspect_race_control(
    inspector: Inspector,
    driver: Driver,
    limits: RcsLimits,
    chosen: Sequence[Clause],
    stopping: asyncio.Event,
    where: tuple[str, int],
    addresses: dict[int, str],
    stranger: str,
) -> Inspection:
    """
    Inspect a race control.

    :param chosen: the clauses that the report is to have.
    :param stopping: ends the inspection when it is set.
    :param where: race control's IPv4 address and port.
    :param addresses: the IPv4 address of each kart, by its number; the first two race.
    :param stranger: an IPv4 address that is no kart's.
    """
    recording = Recording()
    field = Field(recording, *where, addresses, stranger)
    telling = Telling(
        chosen, lambda clause: judge(clause, recording.trace, limits), inspector.tell
    )
    began = time.monotonic()
    remarks: list[str] = []
    finished = False
    one, two, out = addresses
    steps = steps_for(chosen, RCS_STEPS)
    play = RcsSteps(recording, field, driver, limits, telling.step_done, steps, (one, two, out))
    running = asyncio.get_running_loop().create_task(play.run())
    try:
        await first(running, stopping)
        if not running.done():
            running.cancel()
            remarks.append('The inspection was stopped. Bring race control to IN_GARAGE.')
        await running
        finished = True
    except asyncio.CancelledError:
        pass
    except NotInGarageError as error:
        remarks.append(str(error))
    finally:
        running.cancel()
        await field.close()
    if not field.count:
        remarks.append('No kart could connect to race control.')
    results = telling.end(' '.join(remarks))
    return Inspection(results, time.monotonic() - began, remarks, finished, field.count > 0)
