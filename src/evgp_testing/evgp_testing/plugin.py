"""
The pytest plugin: the fixtures of a race, and tests that need a process of their own.

pytest loads it by itself wherever the workspace is sourced.
"""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys
import time

from evgp_testing import nursery
from evgp_testing.fixtures import (  # noqa: F401 - pytest finds fixtures by name
    connect_kart,
    join_official,
    join_team,
    parts,
    start_base,
    start_bridge,
    start_race_control,
)
import pytest

IN_OWN_PROCESS = 'EVGP_TEST_IN_OWN_PROCESS'

_PYTEST = pathlib.Path(pytest.__file__).with_name('__main__.py')


def pytest_configure(config: pytest.Config) -> None:
    """Name the plugin's markers, and have programs begin with everything imported."""
    config.addinivalue_line('markers', 'own_process: runs in another pytest (evgp_testing.plugin)')
    config.addinivalue_line('markers', 'long: takes long, and is for `make test-long`')
    if IN_OWN_PROCESS not in os.environ:
        nursery.keep()


def pytest_unconfigure() -> None:
    """End what `pytest_configure` has begun."""
    nursery.let_go()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """
    Run a test marked `own_process` in another pytest.

    Fast DDS learns the network interfaces of its process once. In a process that has used it
    before, it does not find its way in a network namespace.
    """
    if item.get_closest_marker('own_process') is None or IN_OWN_PROCESS in os.environ:
        return None
    hook = item.ihook
    hook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    began = time.time()
    words = ['-p', 'no:cacheprovider', '-p', 'no:xdist', item.nodeid]
    environment = {**os.environ, IN_OWN_PROCESS: '1'}
    root = item.config.rootpath
    with nursery.start(
        [str(_PYTEST), *words], environment, modules=nursery.TESTS, cwd=root
    ) or subprocess.Popen(
        [sys.executable, '-m', 'pytest', *words],
        cwd=root,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as done:
        printed, _ = done.communicate()
    passed = done.returncode == 0 and ' skipped' not in printed.splitlines()[-1]
    ended = time.time()
    report = pytest.TestReport(
        nodeid=item.nodeid,
        location=item.location,
        keywords={},
        outcome='passed' if done.returncode == 0 else 'failed',
        longrepr=None if done.returncode == 0 else printed,
        when='call',
        sections=[('Its own process', printed)],
        duration=ended - began,
        start=began,
        stop=ended,
    )
    if done.returncode == 0 and not passed:
        report.outcome = 'skipped'
        report.longrepr = (str(item.path), 0, f'Skipped: {printed}')
    hook.pytest_runtest_logreport(report=report)
    hook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True
