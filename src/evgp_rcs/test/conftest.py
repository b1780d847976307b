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
