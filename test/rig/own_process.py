# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A pytest plugin for tests marked `own_process`: another pytest runs each of them."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

from evgp_testing.part import PATIENCE
import pytest

IN_OWN_PROCESS = 'EVGP_TEST_IN_OWN_PROCESS'


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Have each test marked `own_process` run in another pytest."""
    if IN_OWN_PROCESS not in os.environ:
        items[:] = [
            each
            if each.get_closest_marker('own_process') is None
            else _InOwnProcess.from_parent(each.parent or each.session, name=each.name, item=each)
            for each in items
        ]


class _InOwnProcess(pytest.Item):
    """
    A test that another pytest runs.

    Fast DDS learns the network interfaces of its process once. In a process that has used it
    before, it does not find its way in a network namespace.
    """

    def __init__(self, *, item: pytest.Item, **names: Any) -> None:
        super().__init__(**names)
        self._item = item
        self.own_markers = [*item.own_markers]
        self.keywords.update(item.keywords)
        if self.config.pluginmanager.hasplugin('timeout'):
            own = item.get_closest_marker('timeout')
            limit = own.args[0] if own is not None else self.config.getini('timeout')
            if limit:
                # The other pytest's limit comes first: it can say where the test hangs.
                self.add_marker(pytest.mark.timeout(float(limit) + PATIENCE), append=False)

    def runtest(self) -> None:
        words = ['-rs', '-p', 'no:cacheprovider', '-p', 'no:xdist']
        words += [f'--seed={self.config.option.seed}', self.nodeid]
        done = subprocess.run(
            [sys.executable, '-m', 'pytest', *words],
            cwd=self.config.rootpath,
            env={**os.environ, IN_OWN_PROCESS: '1'},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        self.add_report_section('call', 'its own process', done.stdout)
        if done.returncode != 0:
            pytest.fail(done.stdout, pytrace=False)
        if ' skipped' in done.stdout.splitlines()[-1]:
            pytest.skip(done.stdout)

    def reportinfo(self) -> tuple[os.PathLike[str] | str, int | None, str]:
        return self._item.reportinfo()
