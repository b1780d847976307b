# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The pytest plugin, which offers the fixtures and shows the output of processes if a test fails.

pytest loads it automatically wherever the workspace is sourced, so it imports neither ROS nor Qt.
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
"""Time that the processes of a failed test have to print why, in seconds. A kart sees its
connection end before any process of race control has printed anything."""

MOST_LINES = 200
"""Maximum number of lines shown of each process when a test fails, which are its last."""


def pytest_configure() -> None:
    """Make sure that programs end at Ctrl-C."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # A shell starts background programs with SIGINT ignored. Programs would inherit that, and
        # some would not end at Ctrl-C.
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # ROS's messages import numpy. Nothing here computes with numpy, but each process that imports
    # it would start a thread per core.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, None]:
    """Add the output of every process of the test to a failure."""
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
    """Forget the processes that have ended. Those of a wider fixture may continue."""
    started[:] = [each for each in started if each.runs]
