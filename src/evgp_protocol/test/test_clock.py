# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The clock that counts a suspend, and the event loop that goes by it."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import time

from evgp_protocol import clock
from evgp_protocol.loop import run
import pytest


def test_it_is_the_time_since_the_machine_was_started_suspended_or_not() -> None:
    before = time.clock_gettime(time.CLOCK_BOOTTIME)
    now = clock.now()
    after = time.clock_gettime(time.CLOCK_BOOTTIME)
    assert before <= now <= after


def test_the_loop_goes_by_that_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    suspended = 0.0
    real = time.clock_gettime

    def after_a_suspend(which: int) -> float:
        return real(which) + (suspended if which == time.CLOCK_BOOTTIME else 0.0)

    monkeypatch.setattr(time, 'clock_gettime', after_a_suspend)

    async def sleep_over_a_suspend() -> float:
        nonlocal suspended
        began = time.monotonic()
        loop = asyncio.get_running_loop()
        sleeping = loop.create_task(asyncio.sleep(3600.0))
        await asyncio.sleep(0)
        suspended = 3600.0
        loop.call_soon(lambda: None)  # the loop must wake to see it
        await sleeping
        return time.monotonic() - began

    assert run(sleep_over_a_suspend()) < 60.0


def test_run_ends_what_is_left_and_closes_its_loop() -> None:
    left: list[asyncio.Task[None]] = []

    async def main(fails: bool) -> int:
        left.append(asyncio.create_task(asyncio.sleep(3600.0)))
        await asyncio.sleep(0)
        if fails:
            raise LookupError('gone')
        return 7

    assert run(main(False)) == 7
    with pytest.raises(LookupError, match='gone'):
        run(main(True))
    assert all(each.cancelled() and each.get_loop().is_closed() for each in left)


def test_it_needs_no_more_than_the_standard_library() -> None:
    code = (
        'import sys; import evgp_protocol.loop; '
        'print(sorted({name.split(".")[0] for name in sys.modules} '
        '- sys.stdlib_module_names - {"__main__", "evgp_protocol"}))'
    )
    done = subprocess.run(
        [sys.executable, '-S', '-c', code],
        capture_output=True,
        text=True,
        check=True,
        env={'PYTHONPATH': clock.__file__.rsplit('/', 2)[0]},
    )
    assert done.stdout.strip() == '[]'


@pytest.mark.parametrize(
    ('seconds', 'digits', 'text'),
    [
        (-1, 0, '0 s'),
        (41.94, 1, '41.9 s'),
        (59.96, 1, '1:00.0 min'),
        (65.1234, 3, '1:05.123 min'),
        (3600, 0, '1:00:00 h'),
        (7265.5, 1, '2:01:05.5 h'),
    ],
)
def test_a_duration_is_short_and_has_its_unit(seconds: float, digits: int, text: str) -> None:
    assert clock.duration(seconds, digits) == text
