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

"""ROS domains that nobody else on this machine uses at the same time."""

from __future__ import annotations

from evgp_testing.part import Part
from evgp_testing.ports import take_one

# Above 101 the ports of a domain reach into those the system gives out by itself.
_DOMAINS = range(20, 60)


class Domain(Part):
    """
    A ROS domain of its own, until it is closed or the process ends.

    :raises RuntimeError: if every domain is taken.
    """

    def __init__(self) -> None:
        """Take a domain that is free."""
        self.number, self._lock = take_one('ros-domain', _DOMAINS)

    def close(self) -> None:
        """Let the domain go."""
        self._lock.close()
