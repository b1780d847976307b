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

"""
A pytest plugin of its own: the dice that tests throw, and the seed by which they fall again.

The tests of every package can use it, also in a `colcon test` without this package: it needs
nothing of the workspace.
"""

from __future__ import annotations

import os
import random
import secrets

import pytest

SEED = 'EVGP_TEST_SEED'


def dice_of(request: pytest.FixtureRequest) -> random.Random:
    """Return dice for a test, or a module of them: with the same ``--seed`` they fall the same."""
    return random.Random(f'{request.config.getoption("seed")} {request.node.name}')


@pytest.fixture
def dice(request: pytest.FixtureRequest) -> random.Random:
    """Return the test's own dice."""
    return dice_of(request)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let a run's random numbers be given again."""
    parser.addoption('--seed', type=int, help='of the tests that throw dice (another each time)')


def pytest_configure(config: pytest.Config) -> None:
    """Choose the seed; the workers of pytest-xdist have it from the environment."""
    if config.option.seed is not None:
        os.environ[SEED] = str(config.option.seed)
    config.option.seed = int(os.environ.setdefault(SEED, str(secrets.randbelow(2**32))))


def pytest_report_header(config: pytest.Config) -> str:
    """Say the seed."""
    return f'dice: --seed {config.option.seed}'
