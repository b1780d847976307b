# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
ROS domains and TCP ports that no other process on this machine uses at the same time.

A bridge keeps looking for its race control at the same port, and all tests use the same kart
addresses. If another test got that port from the system, the bridge would connect to the wrong
race control.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import fcntl
import functools
import itertools
import os
import random
import socket

from evgp_testing.part import Part

# Above 101, the ports of a domain overlap with the system's ephemeral ports.
_DOMAINS = range(20, 60)

_BLOCK = 100

# Above the ports of the domains, below the system's ephemeral ports.
_BLOCKS = range(24000, 32000, _BLOCK)


@functools.cache
def _own_ports() -> Iterator[int]:
    """
    Return an endless cycle of the ports that belong to this process until it ends.

    They are locked by a file, which works across network namespaces, like the mark of a race
    control (``evgp_rcs.record.run_mark``). The kernel releases the lock when the process ends.

    :raises RuntimeError: if every port is taken.
    """
    for first in random.SystemRandom().sample(_BLOCKS, len(_BLOCKS)):
        path = f'/dev/shm/evgp-ports-{first}'  # noqa: S108 - it is only a lock
        with contextlib.suppress(PermissionError, BlockingIOError):
            try:
                lock = os.open(path, os.O_RDONLY)
            except FileNotFoundError:
                lock = os.open(path, os.O_RDONLY | os.O_CREAT, 0o644)
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return itertools.cycle(range(first, first + _BLOCK))
    raise RuntimeError('every port is in use')


def free_port() -> int:
    """
    Return a port at which no program listens, and which no other process gets from this module.

    This function returns the same port again only after all other ports of this process.

    :raises RuntimeError: if every port is taken.
    """
    for number in itertools.islice(_own_ports(), _BLOCK):
        try:
            socket.create_server(('127.0.0.1', number)).close()
        except OSError:
            continue
        return number
    raise RuntimeError('every port of this process is in use')


class Domain(Part):
    """
    A ROS domain reserved until it is closed or the process ends, however it ends.

    Its lock is an abstract socket. Like the domain, it belongs to one network namespace.

    :raises RuntimeError: if every domain is taken.
    """

    def __init__(self) -> None:
        # In random order, because something may still use a domain just released.
        for self.number in random.SystemRandom().sample(_DOMAINS, len(_DOMAINS)):
            self._lock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            try:
                self._lock.bind(f'\0evgp-ros-domain-{self.number}')
            except OSError:
                self._lock.close()
            else:
                return
        raise RuntimeError(f'every ROS domain of {_DOMAINS} is in use')

    def close(self) -> None:
        self._lock.close()
