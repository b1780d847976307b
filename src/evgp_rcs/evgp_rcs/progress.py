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

"""How far long work has come, for whoever waits at a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
import sys
import time
from typing import TypeVar

SILENT = 0.5
"""Time for which work shows nothing, in seconds: most is done before."""

REDRAW_EVERY = 0.2
"""Minimum time between two changes of what is shown, in seconds."""

_Item = TypeVar('_Item')


def watched(items: Iterable[_Item], total: int, what: str) -> Iterator[_Item]:
    """
    Yield the items, and say on standard error how many are done, if that is a terminal.

    :param total: how many there are, about.
    :param what: what is done with them, as the beginning of a sentence.
    """
    if not sys.stderr.isatty():
        yield from items
        return
    next_at = time.monotonic() + SILENT
    shown = ''
    try:
        for number, item in enumerate(items):
            if time.monotonic() >= next_at:
                next_at = time.monotonic() + REDRAW_EVERY
                shown = f'{what}: {min(100, 100 * number // max(total, 1))} %'
                print(f'\r{shown}', end='', file=sys.stderr, flush=True)
            yield item
    finally:
        if shown:
            # Nothing of it stays.
            print(f'\r{" " * len(shown)}\r', end='', file=sys.stderr, flush=True)
