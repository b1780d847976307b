"""ROS domains that nobody else on this machine uses at the same time."""

from __future__ import annotations

import random
import socket

from evgp_testing.part import Part

# Above 101 the ports of a domain reach into those the system gives out by itself.
_DOMAINS = range(20, 60)


class Domain(Part):
    """
    A ROS domain of its own, until it is closed or the process ends.

    An abstract socket of the domain's name is the lock: the kernel lets it go with the process,
    however that ends.

    :raises RuntimeError: if every domain is taken.
    """

    def __init__(self) -> None:
        """Take a domain that is free."""
        # Any, and not the first: in one that was let go just now, something may still be ending.
        for number in random.SystemRandom().sample(_DOMAINS, len(_DOMAINS)):
            lock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            try:
                lock.bind(f'\0evgp-ros-domain-{number}')
            except OSError:
                lock.close()
                continue
            self.number = number
            self._lock = lock
            return
        raise RuntimeError(f'every ROS domain of {_DOMAINS} is in use')

    def close(self) -> None:
        """Let the domain go."""
        self._lock.close()
