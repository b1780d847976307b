# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A bad peer of race control, as a script that needs nothing but the standard library.

Run as a script, with the name of an attack, the address and port of race control, and the address
to attack from, it attacks until its standard input ends. It says ``ready`` once it is under way.
"""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import os
import resource
import select
import socket
import struct
import sys
import threading
import time

IP_BIND_ADDRESS_NO_PORT = 24  # of Linux; Python has a name for it from 3.12 on

CONNECTIONS = 2000
RECONNECTS = 200


class Attack:
    """
    What one bad peer does; each method is an attack.

    :param server: race control's address and port.
    :param source: the address to attack from.
    """

    def __init__(self, server: tuple[str, int], source: str) -> None:
        """Take note of where to attack."""
        self._server = server
        self._source = source
        self._over = threading.Event()
        self._ready = False

    def run(self, name: str) -> None:
        threading.Thread(target=self._wait_for_the_end, daemon=True).start()
        attack: Callable[[], None] = getattr(self, name)
        while not self._over.is_set():
            try:
                attack()
            except OSError:
                self._over.wait(0.005)  # race control has hung up: once more

    # ----- what it sends ------------------------------------------------------------------

    def flood(self) -> None:
        self._pour(lambda: b'$GREEN_GREEN;$RED_RED;' * 200)

    def random_bytes(self) -> None:
        self._pour(lambda: os.urandom(4096))

    # ----- what it does not do ------------------------------------------------------------

    def slow_reader(self) -> None:
        """Never read, with a tiny buffer."""
        with self._connected(receive_buffer=1) as peer:
            self._is_ready()
            while not self._over.is_set() and not _has_hung_up(peer):
                self._over.wait(0.05)

    # ----- how it comes and goes ----------------------------------------------------------

    def half_close(self) -> None:
        with self._connected() as peer:
            peer.shutdown(socket.SHUT_WR)
            self._is_ready()
            while peer.recv(4096):
                pass

    def reset(self) -> None:
        """Connect and reset, again and again."""
        with self._connected() as peer:
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', 1, 0))
            self._is_ready()

    def reconnects(self) -> None:
        """Connect and close, 200 times a second."""
        due = time.monotonic()
        while not self._over.is_set():
            due += 1 / RECONNECTS
            self._connected().close()
            self._is_ready()
            self._over.wait(max(due - time.monotonic(), 0))

    def hammer(self) -> None:
        """Connect again and again, without a pause."""
        while not self._over.is_set():
            self._connected().close()
            self._is_ready()

    def many_connections(self) -> None:
        """Keep 2,000 connections open, and connect anew those that race control ends."""
        with contextlib.ExitStack() as stack:
            peers = [stack.enter_context(self._connected(wait=False)) for _ in range(CONNECTIONS)]
            self._is_ready()
            while not self._over.wait(0.02):
                peers = peers[50:] + peers[:50]
                for number, peer in enumerate(peers[:50]):
                    peer.close()
                    peers[number] = stack.enter_context(self._connected(wait=False))

    # ----- how ----------------------------------------------------------------------------

    def _connected(self, receive_buffer: int = 0, wait: bool = True) -> socket.socket:
        peer = socket.socket()
        try:
            if receive_buffer:
                peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
            # So that the port is chosen in `connect`. For `bind`, none will do that another
            # connection just had, and with thousands of those, its search takes 3 ms each time.
            peer.setsockopt(socket.IPPROTO_IP, IP_BIND_ADDRESS_NO_PORT, 1)
            peer.bind((self._source, 0))
            peer.settimeout(1.0 if wait else 0.0)
            peer.connect(self._server)
        except BlockingIOError:
            pass  # it connects meanwhile
        except BaseException:
            peer.close()
            raise
        return peer

    def _pour(self, data: Callable[[], bytes]) -> None:
        with self._connected() as peer:
            while not self._over.is_set():
                try:
                    peer.send(data())
                    self._is_ready()
                except TimeoutError:
                    pass  # race control takes its time
                while select.select([peer], [], [], 0)[0]:
                    if not peer.recv(65536):
                        return

    def _is_ready(self) -> None:
        if not self._ready:
            self._ready = True
            print('ready', flush=True)

    def _wait_for_the_end(self) -> None:
        sys.stdin.read()
        self._over.set()


def _has_hung_up(peer: socket.socket) -> bool:
    """Return whether the other end is gone, without reading."""
    poll = select.poll()
    poll.register(peer, select.POLLRDHUP | select.POLLERR | select.POLLHUP)
    return bool(poll.poll(0))


if __name__ == '__main__':
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, CONNECTIONS + 1000), hard))
    Attack((sys.argv[2], int(sys.argv[3])), sys.argv[4]).run(sys.argv[1])
