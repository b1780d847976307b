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

"""The end of a process, within a time that nothing can prolong."""

from __future__ import annotations

import ctypes
import sys
import time

_LIBC = ctypes.CDLL(None, use_errno=True)
_SIGEV_THREAD = 2


class _Event(ctypes.Structure):
    """As ``struct sigevent``: what happens when the time is over."""

    _fields_ = (
        ('value', ctypes.c_void_p),
        ('signal', ctypes.c_int),
        ('notify', ctypes.c_int),
        ('function', ctypes.c_void_p),
        ('attributes', ctypes.c_void_p),
        ('rest', ctypes.c_char * 32),
    )


class _Setting(ctypes.Structure):
    """As ``struct itimerspec``, seconds and nanoseconds."""

    _fields_ = (
        ('interval_s', ctypes.c_long),
        ('interval_ns', ctypes.c_long),
        ('value_s', ctypes.c_long),
        ('value_ns', ctypes.c_long),
    )


_armed: list[ctypes.c_void_p] = []


def end_within(seconds: float, code: int) -> None:
    """
    Have this process end with an exit code after so long, whatever it is doing by then.

    Call it before everything is torn down, as the last step that matters: what was printed is
    flushed. A later call replaces an earlier one; nothing takes the last one back.

    The time runs in the C library, not in Python: DDS may hang while it holds the interpreter's
    lock, and then no line of Python runs any more.

    :raises OSError: if the system gives no timer.
    """
    event = _Event(
        value=code,
        notify=_SIGEV_THREAD,
        function=ctypes.cast(_LIBC._exit, ctypes.c_void_p),  # which gets the value
    )
    timer = ctypes.c_void_p()
    setting = _Setting(value_s=int(seconds), value_ns=int(seconds % 1 * 1e9))
    if _LIBC.timer_create(
        time.CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)
    ) or _LIBC.timer_settime(timer, 0, ctypes.byref(setting), None):
        raise OSError(ctypes.get_errno(), 'no timer for the end of the process')
    while _armed:
        _LIBC.timer_delete(_armed.pop())
    _armed.append(timer)
    sys.stdout.flush()
    sys.stderr.flush()
