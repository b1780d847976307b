# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What a test needs of its machine: without it, it is skipped, or fails where all must run."""

from __future__ import annotations

import os
from typing import NoReturn

import pytest
from rig.screen import why_no_screen

CPP = 'evgp_race_watch_cpp'
"""The package in C++, which is not built everywhere."""


def cannot_run(why: str, *, whole_file: bool = False) -> NoReturn:
    """
    Skip this test, or with EVGP_ALL_TESTS fail it.

    :param why: what is missing, and where there is a package with it, which.
    :param whole_file: skip all tests of the file that calls this as it is imported.
    """
    if os.environ.get('EVGP_ALL_TESTS'):
        raise pytest.fail.Exception(f'EVGP_ALL_TESTS is set, but {why}', pytrace=False)
    raise pytest.skip.Exception(why, allow_module_level=whole_file)


def need_package(package: str) -> None:
    """Skip the test where this package was not built: not even EVGP_ALL_TESTS builds it."""
    from ament_index_python.packages import get_package_prefix, PackageNotFoundError

    try:
        get_package_prefix(package)
    except PackageNotFoundError:
        pytest.skip(f'{package} was not built: the wheels of ROS have no rclcpp')


def need_qt() -> None:
    """Skip the test where Qt for Python cannot be loaded."""
    try:
        import evgp_node.qt  # noqa: F401
    except ImportError as error:
        cannot_run(f'Qt cannot be loaded: {error}')


def need_screen() -> None:
    """Skip the test where no window can be opened."""
    need_qt()
    if why := why_no_screen():
        cannot_run(why)
