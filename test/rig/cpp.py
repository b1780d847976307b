# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The package in C++, which is not built everywhere."""

from ament_index_python.packages import get_package_prefix, PackageNotFoundError
import pytest

CPP = 'evgp_race_watch_cpp'
"""The name of the package."""


def need_package(package: str) -> None:
    """Skip the test where this package was not built."""
    try:
        get_package_prefix(package)
    except PackageNotFoundError:
        pytest.skip(f'{package} was not built: the wheels of ROS have no rclcpp')
