# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Ends a process by the C library, even if something holds the interpreter's lock; without ROS.

DDS may hang inside a call and keep that lock, so that no thread or signal handler of Python runs.
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
"""Time to write the sentence before the process ends, in seconds."""

_libc = ctypes.CDLL(None, use_errno=True)
_timers: list[ctypes.c_void_p] = []
_kept: list[ctypes.Array[ctypes.c_char]] = []


def end_within(seconds: float, code: int, said: str = '') -> None:
    """
    Make the C library end this process after a time; a later call replaces an earlier one.

    `faulthandler` can only exit with code 1, and some Pythons time it by the wall clock.

    :param seconds: time until the end, in seconds; 0 cancels it.
    :param code: the exit code.
    :param said: sentence to write to stderr before the end, after the program's name.
    :raises OSError: if the system provides no timer.
    """
    sentence = ctypes.create_string_buffer(said.replace('%', '%%').encode())
    name = ctypes.create_string_buffer(pathlib.Path(sys.argv[0]).name.encode())
    short_name = ctypes.c_void_p.in_dll(_libc, 'program_invocation_short_name')
    short_name.value = ctypes.addressof(name)  # otherwise the name would be python's
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
        raise OSError(ctypes.get_errno(), 'no timer for the end of the process')
    return timer
