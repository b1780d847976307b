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
