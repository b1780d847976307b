# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Finds the class of a service type by its ROS name."""

from __future__ import annotations

import importlib
from typing import Any


def service_class(name: str) -> Any:
    """Return the class of a service type by its ROS name, such as 'std_srvs/srv/Trigger'."""
    package, folder, type_name = name.split('/')
    return getattr(importlib.import_module(f'{package}.{folder}'), type_name)
