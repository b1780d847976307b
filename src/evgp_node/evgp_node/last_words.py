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

"""The last words of a node: they are heard before their publisher is gone."""

from __future__ import annotations

from rclpy.duration import Duration
from rclpy.publisher import Publisher

LAST_WORD = 0.5
"""Maximum time that the last words of one publisher may take to be heard, seconds."""


def wait_until_heard(*publishers: Publisher) -> None:
    """
    Wait until every reliable subscriber has what these publishers have published.

    A publisher that is gone sends nothing again that got lost on the way. A subscriber that does
    not listen any more costs `LAST_WORD` per publisher, and no more.
    """
    for publisher in publishers:
        publisher.wait_for_all_acked(Duration(seconds=LAST_WORD))
