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

"""Single threads of other processes: those by which DDS receives, and how to make one hang."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import ctypes
import os
import pathlib

_LIBC = ctypes.CDLL(None, use_errno=True)
_SEIZE, _INTERRUPT, _DETACH = 0x4206, 0x4207, 17  # of ptrace
_WALL = 0x40000000


def receiving_threads(pid: int, port: int | None = None) -> list[int]:
    """Return the threads by which Fast DDS receives in a process: all, or those of a UDP port."""
    wanted = 'dds.udp.' if port is None else f'dds.udp.{port}'
    tasks = pathlib.Path(f'/proc/{pid}/task')
    names = {int(each.name): (each / 'comm').read_text().strip() for each in tasks.iterdir()}
    return sorted(
        thread
        for thread, name in names.items()
        if (name.startswith(wanted) if port is None else name == wanted)
    )


@contextlib.contextmanager
def stopped_thread(thread: int) -> Iterator[None]:
    """
    Have one thread of another process stand still, while all others go on.

    :raises OSError: if it may not be traced.
    """
    _trace(_SEIZE, thread)
    _trace(_INTERRUPT, thread)
    os.waitpid(thread, _WALL)
    try:
        yield
    finally:
        # If its process has ended: nobody else can take it away.
        with contextlib.suppress(OSError):
            _trace(_DETACH, thread)
        with contextlib.suppress(ChildProcessError):
            os.waitpid(thread, _WALL | os.WNOHANG)


def _trace(request: int, thread: int) -> None:
    if _LIBC.ptrace(request, thread, None, None):
        number = ctypes.get_errno()
        raise OSError(number, f'ptrace of thread {thread}: {os.strerror(number)}')
