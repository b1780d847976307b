# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The searches of this folder need no time of their own: whatever keeps time goes before them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from rig.niceness import at_niceness


@pytest.fixture(scope='module')
def others_first() -> Iterator[None]:
    """Have this worker of the tests get only what nobody else wants of the processor."""
    # Three searches would leave all processes of a race a quarter of the processor, and race
    # control ends itself if it gets none for a second.
    with at_niceness(19):
        yield
