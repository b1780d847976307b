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

"""What the parts of a race have in common."""

from __future__ import annotations

from typing import TypeVar

PATIENCE = 30.0
"""How long anything is awaited before a test gives up, seconds: far more than it ever takes."""

P = TypeVar('P', bound='Part')


class Part:
    """A part of a race, which gives everything back in ``close``; it can be used in ``with``."""

    def close(self) -> object:
        """End it."""
        raise NotImplementedError

    def __enter__(self: P) -> P:
        """Return it."""
        return self

    def __exit__(self, *exc: object) -> None:
        """End it."""
        self.close()
