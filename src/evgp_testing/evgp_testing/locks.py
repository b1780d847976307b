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

"""What only one process of this machine may have at a time, such as a ROS domain."""

from __future__ import annotations

from collections.abc import Sequence
import random
import socket


def take_one(what: str, numbers: Sequence[int]) -> tuple[int, socket.socket]:
    """
    Return a number that nobody has, and its lock, which is let go by closing it.

    An abstract socket is the lock: the kernel lets it go with the process, however that ends. Like
    a port, it belongs to one network namespace.

    :param what: is numbered.
    :raises RuntimeError: if every number is taken.
    """
    # Any, and not the first: in one that was let go just now, something may still be ending.
    for number in random.SystemRandom().sample(numbers, len(numbers)):
        lock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            lock.bind(f'\0evgp-{what}-{number}')
        except OSError:
            lock.close()
            continue
        return number, lock
    raise RuntimeError(f'every {what} of {numbers} is in use')
