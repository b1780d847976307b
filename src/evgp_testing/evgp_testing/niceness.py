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

"""What share of the processor a worker of the tests gets."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import os
import pathlib
import time

_SESSION = pathlib.Path('/proc/self/autogroup')


@contextlib.contextmanager
def session_at(niceness: int) -> Iterator[None]:
    """
    Have the session of this process get more of the processor (below 0) or less (above) meanwhile.

    Linux first shares the processor between sessions. Nothing happens where it does not, or where
    this process is in somebody else's session; a worker of the tests has its own.

    :param niceness: from -20 to 19; below 0 for root only.
    """
    if os.getsid(0) != os.getpid() or not _SESSION.exists():
        yield
        return
    _SESSION.write_text(str(niceness), encoding='ascii')
    try:
        yield
    finally:
        try:
            _SESSION.write_text('0', encoding='ascii')
        except BlockingIOError:  # so soon again, only root may
            time.sleep(0.2)
            _SESSION.write_text('0', encoding='ascii')
