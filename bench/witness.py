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

"""
Whether this computer itself stood still for a moment, as a guest does while its host is busy.

On each processor sleeps a process that comes before every other one (SCHED_FIFO; root only). When
even that one wakes late, no program of ours can have been in time.
"""

from __future__ import annotations

import os
import subprocess
import sys

LATE = 0.02
"""Delay from which a moment is noted, in seconds."""

_SLEEPER = f"""
import os, sys, time
parent = os.getppid()
os.sched_setaffinity(0, [int(sys.argv[1])])
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(90))
print(end='.', flush=True)
due = time.monotonic()
while os.getppid() == parent:
    due += 0.002
    time.sleep(max(0.0, due - time.monotonic()))
    now = time.monotonic()
    if now - due > {LATE}:
        print(due, now, flush=True)
    due = max(due, now)
"""


class Witness:
    """
    Notes when a processor of this computer stood still.

    :raises PermissionError: for a user who may not come before other programs.
    """

    def __init__(self) -> None:
        """Begin to watch."""
        self._sleepers = [
            subprocess.Popen(
                [sys.executable, '-c', _SLEEPER, str(processor)], stdout=subprocess.PIPE, bufsize=0
            )
            for processor in sorted(os.sched_getaffinity(0))
        ]
        self._said = ''
        for sleeper in self._sleepers:
            assert sleeper.stdout is not None
            if not sleeper.stdout.read(1):
                self.close()
                raise PermissionError('only root can tell whether the computer stood still')
            os.set_blocking(sleeper.stdout.fileno(), False)

    def close(self) -> None:
        """End."""
        for sleeper in self._sleepers:
            sleeper.kill()
            sleeper.wait()
            assert sleeper.stdout is not None
            sleeper.stdout.close()

    def stood_still(self, since: float, until: float) -> float:
        """Return for how long a processor stood still that did so in this time, in seconds."""
        for sleeper in self._sleepers:
            assert sleeper.stdout is not None
            # A line is far shorter than what a pipe takes at once: it is never in two parts.
            self._said += (sleeper.stdout.read(65536) or b'').decode()
        spans = [tuple(map(float, line.split())) for line in self._said.splitlines()]
        return max((end - due for due, end in spans if due < until and end > since), default=0.0)
