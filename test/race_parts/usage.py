"""What a process has taken of this machine so far, as Linux tells it."""

from __future__ import annotations

import os
import pathlib
import re

TICK = os.sysconf('SC_CLK_TCK')


def cpu_seconds(pid: int) -> float:
    """Return the CPU time that a process has used, s."""
    fields = pathlib.Path(f'/proc/{pid}/stat').read_text(encoding='ascii').rsplit(')', 1)[1]
    user, system = fields.split()[11:13]
    return (int(user) + int(system)) / TICK


def resident(pid: int) -> int:
    """Return how much memory a process has, in KiB."""
    status = pathlib.Path(f'/proc/{pid}/status').read_text(encoding='ascii')
    found = re.search(r'VmRSS:\s+(\d+) kB', status)
    assert found is not None, f'process {pid} has ended'
    return int(found[1])


def open_files(pid: int) -> int:
    """Return how many files a process has open."""
    return len(list(pathlib.Path(f'/proc/{pid}/fd').iterdir()))
