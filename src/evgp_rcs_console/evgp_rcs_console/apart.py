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
A piece of work in a process of its own, which can be given up at any moment.

What works with ROS may hang, inside DDS and with the interpreter's lock held: then no thread and
no signal handler of that process runs. So who must keep a deadline stays outside, without ROS.
"""

from __future__ import annotations

from collections.abc import Callable
import ctypes
import multiprocessing
from multiprocessing.connection import Connection
import os
import signal
import sys
from types import FrameType
from typing import Any, NoReturn

Report = Callable[..., None]
"""
Hands something over to who started the work: `report(name=value)`.

`last=True` says that nothing follows: from then on the work is not interrupted, as it only tidies
up, but ended by force if that takes too long.
"""

_PR_SET_PDEATHSIG = 1  # of linux/prctl.h


class Apart:
    """
    A piece of work in a forked process: a new interpreter would make each stop 0.3 s later.

    Make it before the process has any thread.

    :param work: is called there, with a ``Report``; it ends early, by SystemExit, on SIGTERM.
    """

    def __init__(self, work: Callable[[Report], object]) -> None:
        """Start it."""
        fork = multiprocessing.get_context('fork')
        self._hear, tell = fork.Pipe(duplex=False)
        self._process = fork.Process(target=_do, args=(work, tell, os.getpid()))
        self._process.start()
        tell.close()

    def report(self, seconds: float | None) -> dict[str, Any] | None:
        """
        Return what the work reports next; None if it ends or time is up without a report.

        :param seconds: how long to wait; None: as long as it takes.
        """
        try:
            return self._hear.recv() if self._hear.poll(seconds) else None
        except EOFError:
            return None

    def end(self, seconds: float) -> None:
        """
        End the work, by force if it does not end by itself.

        :param seconds: how long it may take to tidy up.
        """
        self._process.terminate()
        self._process.join(seconds)
        self._process.kill()
        self._process.join()


def _do(work: Callable[[Report], object], tell: Connection, parent: int) -> None:
    """Work, in the forked process."""

    def report(last: bool = False, **told: Any) -> None:
        if last:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
        tell.send(told)

    def stop(number: int, frame: FrameType | None) -> NoReturn:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once is enough
        raise SystemExit

    # Whoever started it may be killed: it must not go on, unseen.
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who started it
    signal.signal(signal.SIGTERM, stop)
    try:
        work(report)
    except SystemExit:
        pass
    sys.stdout.flush()
    os._exit(0)  # what a library does at its end could hang
