# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A pytest plugin: the seed of what is random in a run's tests, by which they can be run again.

The tests of every package can use it, also in a `colcon test`: it needs nothing of the workspace.
"""

from __future__ import annotations

import os
import random
import secrets

import pytest

SEED = 'EVGP_TEST_SEED'


@pytest.fixture
def chance(request: pytest.FixtureRequest) -> random.Random:
    """Return random numbers for this test, the same with the same ``--seed``."""
    return random.Random(f'{request.config.getoption("seed")} {request.node.name}')


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let a run's random numbers be given again."""
    parser.addoption('--seed', type=int, help='of random numbers in tests (another each time)')


def pytest_configure(config: pytest.Config) -> None:
    """Choose the seed; the workers of pytest-xdist have it from the environment."""
    if config.option.seed is not None:
        os.environ[SEED] = str(config.option.seed)
    config.option.seed = int(os.environ.setdefault(SEED, str(secrets.randbelow(2**32))))


def pytest_report_header(config: pytest.Config) -> str:
    return f'random numbers: --seed {config.option.seed}'
