# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A bad peer of race control, as a script that needs nothing but the standard library.

Run as a script, with the name of an attack, the address and port of race control, and the address
to attack from, it attacks until it is killed. It says ``ready`` once it is under way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import os
import resource
import select
import socket
import struct
import sys
import time

IP_BIND_ADDRESS_NO_PORT = 24  # of Linux; Python has a name for it from 3.12 on

CONNECTIONS = 2000
RECONNECTS = 200


class Attack:
    """
    What one bad peer does; each public method is an attack, and yields while it is under way.

    It ends if race control hangs up, and is then made again.
    """

    def __init__(self, server: tuple[str, int], source: str) -> None:
        self._server = server
        self._source = source

    def flood(self) -> Iterator[None]:
        return self._pour(lambda: b'$GREEN_GREEN;$RED_RED;' * 200)

    def random_bytes(self) -> Iterator[None]:
        return self._pour(lambda: os.urandom(4096))

    def reset(self) -> Iterator[None]:
        """Connect and reset, again and again."""
        with self._connected() as peer:
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', 1, 0))
            yield

    def reconnects(self) -> Iterator[None]:
        """Connect and close, 200 times a second."""
        due = time.monotonic() + 1 / RECONNECTS
        yield from self.hammer()
        time.sleep(max(due - time.monotonic(), 0))

    def hammer(self) -> Iterator[None]:
        """Connect again and again, without a pause."""
        self._connected().close()
        yield

    def many_connections(self) -> Iterator[None]:
        """Keep 2,000 connections open, and connect anew those that race control ends."""
        peers = [self._connected(wait=False) for _ in range(CONNECTIONS)]
        while True:
            yield
            for number, peer in enumerate(peers):
                peer.close()
                peers[number] = self._connected(wait=False)
                if number % 50 == 0:
                    time.sleep(0.02)

    def _connected(self, wait: bool = True) -> socket.socket:
        peer = socket.socket()
        try:
            # So that the port is chosen in `connect`. For `bind`, none will do that another
            # connection just had, and with thousands of those, its search takes 3 ms each time.
            peer.setsockopt(socket.IPPROTO_IP, IP_BIND_ADDRESS_NO_PORT, 1)
            peer.bind((self._source, 0))
            peer.settimeout(1.0 if wait else 0.0)
            with contextlib.suppress(BlockingIOError):  # it connects meanwhile
                peer.connect(self._server)
        except BaseException:
            peer.close()
            raise
        return peer

    def _pour(self, data: Callable[[], bytes]) -> Iterator[None]:
        with self._connected() as peer:
            while True:
                with contextlib.suppress(TimeoutError):  # race control takes its time
                    peer.send(data())
                    yield
                while select.select([peer], [], [], 0)[0]:
                    if not peer.recv(65536):
                        return


def main(name: str, host: str, port: str, source: str) -> None:
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, CONNECTIONS + 1000), hard))
    attack: Callable[[], Iterator[None]] = getattr(Attack((host, int(port)), source), name)
    ready = 'ready\n'
    while True:
        try:
            for _ in attack():
                print(ready, end='', flush=True)
                ready = ''
        except OSError:
            time.sleep(0.005)  # race control has hung up: once more


if __name__ == '__main__':
    main(*sys.argv[1:])
