# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The tests of this folder are inspecting computers: other programs are not to hold them up."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from rig.niceness import at_niceness


@pytest.fixture(autouse=True, scope='module')
def not_held_up() -> Iterator[None]:
    """Have this process come before others, where that is allowed; tests try again anyway."""
    with at_niceness(-5):
        yield
