# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The pytest plugin: the fixtures of a race, and what processes printed where a test fails.

pytest loads it by itself wherever the workspace is sourced, so it imports neither ROS nor Qt.
"""

from __future__ import annotations

from collections.abc import Generator
import os
import signal
import time
from typing import Any

from evgp_testing.fixtures import (  # noqa: F401 - pytest finds fixtures by name
    connect_kart,
    join_official,
    join_team,
    parts,
    start_base,
    start_bridge,
    start_race_control,
)
from evgp_testing.process import started
import pytest

LAST_WORDS = 1.0
"""Time that the processes of a test that failed have to print why, s. A kart sees its connection
end before race control, or what is left of it, has said so."""

MOST_LINES = 200
"""Lines of each process that are shown where a test fails: its last."""


def pytest_configure() -> None:
    """Have programs end by Ctrl-C."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # A shell starts what runs in the background so. Programs would inherit it, and some of
        # them would not end by Ctrl-C.
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # ROS's messages bring numpy. Nobody computes with it here, and each process that imports it
    # would start a thread for each further core.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, None]:
    """Have a failure show what every process of the test has printed."""
    outcome = yield
    report: pytest.TestReport = outcome.get_result()
    if not report.failed:
        return
    if any(each.runs for each in started):
        time.sleep(LAST_WORDS)
    for each in started:
        state = 'runs' if each.runs else 'has ended'
        lines = each.output.splitlines()[-MOST_LINES:]
        report.sections.append((f'{each.name} ({each.pid}, {state})', '\n'.join(lines)))


def pytest_runtest_logfinish() -> None:
    """Forget the processes that have ended; those of a wider fixture may go on in the next."""
    started[:] = [each for each in started if each.runs]
