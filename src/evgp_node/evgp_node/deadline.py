# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Makes the C library end the process, even if something holds the interpreter's lock.

DDS may hang inside a call and keep that lock, and then no thread or signal handler of Python can
run. This module does not use ROS.
"""

from __future__ import annotations

import ctypes
import pathlib
import struct
import sys
import time
from typing import Any

_SIGEV_THREAD = 2  # of signal.h

_TO_SAY = 0.2
"""Time from the sentence to the end of the process, in seconds."""

_libc = ctypes.CDLL(None, use_errno=True)
_timers: list[ctypes.c_void_p] = []
_kept: list[ctypes.Array[ctypes.c_char]] = []


def end_within(seconds: float, code: int, said: str = '') -> None:
    """
    Make the C library end this process after a time. A later call replaces an earlier one.

    `faulthandler` would not do, because it always exits with code 1, and some versions of Python
    measure its time by the wall clock.

    :param seconds: time until the end, in seconds. 0 cancels the end.
    :param code: the exit code.
    :param said: sentence to write to stderr before that, after the program's name; empty for none.
    :raises OSError: if the system has no timer for this.
    """
    sentence = ctypes.create_string_buffer(said.replace('%', '%%').encode())
    name = ctypes.create_string_buffer(pathlib.Path(sys.argv[0]).name.encode())
    short_name = ctypes.c_void_p.in_dll(_libc, 'program_invocation_short_name')
    short_name.value = ctypes.addressof(name)  # otherwise, the sentence would name Python
    timers = []
    if seconds > 0 and said:
        timers.append(_call_after(seconds, _libc.warnx, ctypes.addressof(sentence)))
    if seconds > 0:
        timers.append(_call_after(seconds + (_TO_SAY if said else 0.0), _libc._exit, code))
    for timer in _timers:
        _libc.timer_delete(timer)
    _timers[:] = timers
    _kept[:] = [sentence, name]  # the C library reads them later


def _call_after(seconds: float, function: Any, argument: int) -> ctypes.c_void_p:
    """Make the C library call a function once, in a thread without the interpreter."""
    timer = ctypes.c_void_p()
    address = ctypes.cast(function, ctypes.c_void_p).value
    event = struct.pack('qiiPP32x', argument, 0, _SIGEV_THREAD, address, 0)
    whole, part = divmod(seconds, 1.0)
    setting = struct.pack('qqqq', 0, 0, int(whole), int(part * 1e9) or 1)
    clock = time.CLOCK_MONOTONIC
    if _libc.timer_create(clock, event, ctypes.byref(timer)) or _libc.timer_settime(
        timer, 0, setting, None
    ):
        raise OSError(ctypes.get_errno(), 'there is no timer to end the process')
    return timer
