# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The resources that a process and its children use on this machine."""

from __future__ import annotations

import pathlib
import re


def family(pid: int) -> list[int]:
    """Return the IDs of a process and all its descendants."""
    children = pathlib.Path(f'/proc/{pid}/task/{pid}/children').read_text(encoding='ascii')
    return [pid, *(each for child in children.split() for each in family(int(child)))]


def resident(pid: int) -> int:
    """Return the memory of a process and its descendants, in KiB."""
    return sum(map(_resident, family(pid)))


def _resident(pid: int) -> int:
    status = pathlib.Path(f'/proc/{pid}/status').read_text(encoding='ascii')
    found = re.search(r'VmRSS:\s+(\d+) kB', status)
    assert found is not None, f'process {pid} has ended'
    return int(found[1])


def open_files(pid: int) -> int:
    return len(list(pathlib.Path(f'/proc/{pid}/fd').iterdir()))
