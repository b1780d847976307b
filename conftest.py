# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
For the tests of every package, also where the workspace is not sourced.

Their random numbers, their order, and which of them were skipped.
"""

from __future__ import annotations

import contextlib
import gc
import pathlib

import hypothesis
import pytest

# The machine may be busy.
hypothesis.settings.register_profile('evgp', deadline=None)
hypothesis.settings.load_profile('evgp')

pytest_plugins = ('rig.seed', 'rig.own_process')


@pytest.fixture
def domain(parts: contextlib.ExitStack) -> int:
    """Return a ROS domain that nobody else uses, for as long as this test's parts run."""
    from evgp_testing.domains import Domain

    return parts.enter_context(Domain()).number


def pytest_collection_finish() -> None:
    """Spare the garbage collector the modules and the tests, which stay until the end."""
    gc.freeze()


_skipped: list[str] = []


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let a run list what it skipped, so that another can run just that."""
    parser.addoption('--skipped-to', help='a file for the tests that were skipped, for `@FILE`')


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Remember a test that was skipped."""
    if report.skipped:
        _skipped.append(report.nodeid)


def pytest_collectreport(report: pytest.CollectReport) -> None:
    """Remember a file that was skipped; each worker of xdist tells of it."""
    if report.skipped and report.nodeid not in _skipped:
        _skipped.append(report.nodeid)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """List what was skipped; xdist's workers report to the process that has the list."""
    file = session.config.getoption('skipped_to')
    if file and not hasattr(session.config, 'workerinput'):
        pathlib.Path(file).parent.mkdir(exist_ok=True)
        pathlib.Path(file).write_text('\n'.join(_skipped), encoding='utf-8')


@pytest.hookimpl(trylast=True)  # of what is left of them
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """
    Have each worker begin with tests that take half a minute.

    With ``--dist worksteal`` each has an equal part of the tests, in their order. Where such a
    test comes last, all others wait for it. Long tests that search states stand among those that
    mostly wait, so that no processor is idle at the end.
    """
    if config.getoption('markexpr') == 'long':
        searches = [item for item in items if 'others_first' in getattr(item, 'fixturenames', ())]
        waits = [item for item in items if item not in searches]
        part = {
            id(each): at / len(all_) for all_ in (searches, waits) for at, each in enumerate(all_)
        }
        items.sort(key=lambda item: part[id(item)])
        return
    workers: int = getattr(config, 'workerinput', {}).get('workercount', 1)
    early = [item for item in items if item.get_closest_marker('early')]
    others = [item for item in items if item not in early]
    left = len(items)
    items.clear()
    for worker in range(workers):
        part = early[worker::workers]
        share = left // (workers - worker)
        left -= share
        fill = max(0, share - len(part))
        items += part + others[:fill]
        del others[:fill]
    items += others
