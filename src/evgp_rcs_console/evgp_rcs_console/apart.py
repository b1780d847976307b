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
import json
import os
import select
import signal
import sys
import traceback
from types import FrameType
from typing import Any, NoReturn

from evgp_protocol.clock import now

Report = Callable[..., None]
"""
Hands something over to who started the work: `report(name=value)`.

`last=True` says that nothing follows: from then on the work is not interrupted, as it only tidies
up, but ended by force if that takes too long.
"""

_PR_SET_PDEATHSIG = 1  # of linux/prctl.h


class Apart:
    """
    A piece of work in a forked process.

    Make it before the process has any thread.

    :param work: is called there, with a ``Report``; it ends early, by SystemExit, on SIGTERM.
    """

    def __init__(self, work: Callable[[Report], object]) -> None:
        """Start it."""
        self._hear, tell = os.pipe()
        sys.stdout.flush()
        sys.stderr.flush()
        parent = os.getpid()
        self._pid = os.fork()
        if self._pid == 0:
            os.close(self._hear)
            _do(work, tell, parent)
        os.close(tell)
        self._heard = b''

    def report(self, seconds: float | None) -> dict[str, Any] | None:
        """
        Return what the work reports next; None if it ends or time is up without a report.

        :param seconds: how long to wait; None: as long as it takes.
        """
        until = None if seconds is None else now() + seconds
        while b'\n' not in self._heard:
            left = None if until is None else max(0.0, until - now())
            if not select.select([self._hear], [], [], left)[0]:
                return None
            more = os.read(self._hear, 65536)
            if not more:
                return None
            self._heard += more
        line, _, self._heard = self._heard.partition(b'\n')
        reported: dict[str, Any] = json.loads(line)
        return reported

    def end(self, seconds: float) -> None:
        """
        End the work, by force if it does not end by itself.

        :param seconds: how long it may take to tidy up.
        """
        os.kill(self._pid, signal.SIGTERM)
        # The pipe's other end is closed by the end of the process, and by nothing else.
        until = now() + seconds
        while (left := until - now()) > 0 and select.select([self._hear], [], [], left)[0]:
            if not os.read(self._hear, 65536):
                break
        os.kill(self._pid, signal.SIGKILL)
        os.waitpid(self._pid, 0)
        os.close(self._hear)


def _do(work: Callable[[Report], object], tell: int, parent: int) -> NoReturn:
    """Work, in the forked process, and never return."""

    def report(last: bool = False, **told: Any) -> None:
        if last:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
        os.write(tell, json.dumps(told).encode() + b'\n')

    def stop(number: int, frame: FrameType | None) -> NoReturn:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once is enough
        raise SystemExit

    code = 1
    try:
        # Whoever started it may be killed: it must not go on, unseen.
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(code)
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who started it
        signal.signal(signal.SIGTERM, stop)
        work(report)
        code = 0
    except SystemExit:
        pass
    except BaseException:  # noqa: BLE001 - as an interpreter does at the end of a program
        traceback.print_exc()
    finally:
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        finally:
            os._exit(code)
