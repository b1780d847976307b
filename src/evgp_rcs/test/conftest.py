# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What the tests of this folder share."""

from __future__ import annotations

from collections.abc import Iterator
import pathlib

import pytest
from rig.niceness import at_niceness


@pytest.fixture
def path(tmp_path: pathlib.Path) -> pathlib.Path:
    """Return where a record may be made."""
    return tmp_path / 'record.sqlite3'


@pytest.fixture(scope='module')
def others_first() -> Iterator[None]:
    """Have this worker of the tests get only what nobody else wants of the processor."""
    # Three searches would leave all processes of a race a quarter of the processor, and race
    # control ends itself if it gets none for a second.
    with at_niceness(19):
        yield
