# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A kart in Python without ROS: one thread and evgp_protocol, which needs only Python.

    export PYTHONPATH=src/evgp_protocol
    python3 kit/python/example.py 10.0.0.1 [12017 [own address]]

Replace ``drive``, which simulates a speed. Your motors must stop when commands stop coming:
nothing in this program brakes after it has crashed, or while it hangs.
"""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import ipaddress
import os
import select
import socket
import sys
import time

from evgp_protocol import clock
from evgp_protocol.frames import DEFAULT_PORT
from evgp_protocol.kart import Kart
from evgp_protocol.states import RaceState

TURN = 0.02
"""Time of one turn of the loop, in seconds."""

WAIT = 0.5
"""Time between two attempts to connect, in seconds."""

CONNECT_TIMEOUT = 2.0
"""Maximum time of an attempt to connect, in seconds."""

_speed = 0.0


def drive(state: RaceState, may_drive: bool) -> bool:
    """Obey the state for one turn; return whether the kart has reached it."""
    global _speed
    if state is RaceState.GREEN_GREEN and may_drive:
        _speed = min(_speed + 0.05, 6.0)
        return _speed > 0.5
    if state is RaceState.IN_GARAGE and may_drive:
        return True  # your team has the kart
    brake = 0.04 if state is RaceState.RED_FLAG and may_drive else 0.16  # gently, or hard
    _speed = max(_speed - brake, 0.0)
    return _speed == 0.0  # GRID_ACTIVE: ready to race, here at once


class Connection:
    """The connection to race control, which it makes again when lost; it never waits."""

    def __init__(self, kart: Kart, race_control: tuple[str, int], own: str) -> None:
        self._kart = kart
        self._race_control = race_control
        self._own = own
        self._socket: socket.socket | None = None
        self._made = False
        self._began = -WAIT

    def serve(self, now: float) -> None:
        """Do what can be done now: connect, or read all that has come."""
        try:
            if self._socket is None:
                if now - self._began >= WAIT:
                    self._began = now
                    self._connect()
            elif self._made:
                self._receive(self._socket)
            elif select.select([], [self._socket], [], 0)[1]:
                error = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
                if error:
                    raise OSError(error, os.strerror(error))
                self._made = True
                self._kart.connected(now)
            elif now - self._began >= CONNECT_TIMEOUT:
                raise OSError('race control does not answer')
        except OSError as error:
            self._give_up(error)

    def say(self, frame: bytes) -> None:
        """Send a frame; a partly sent frame ends the connection."""
        try:
            if frame and self._socket is not None and self._socket.send(frame) != len(frame):
                raise OSError("race control does not read this kart's replies")
        except OSError as error:
            self._give_up(error)

    def _connect(self) -> None:
        self._socket = socket.socket()
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if self._own:
            self._socket.bind((self._own, 0))
        with contextlib.suppress(BlockingIOError):  # the connection is being made
            self._socket.connect(self._race_control)

    def _receive(self, link: socket.socket) -> None:
        for _ in range(64):  # a flood must not delay the brake
            if not self._kart.is_open:
                raise OSError('race control was silent')
            try:
                data = link.recv(4096)
            except BlockingIOError:
                return
            if not data:
                raise OSError('race control closed the connection')
            self._kart.received(data, clock.now())
        raise OSError('race control never sends that much')

    def _give_up(self, error: OSError) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket, self._made, self._began = None, False, clock.now()
        self._kart.closed(clock.now(), str(error))


def main(drive: Callable[[RaceState, bool], bool] = drive) -> None:
    """Connect, obey and acknowledge, forever."""
    if len(sys.argv) not in (2, 3, 4):
        sys.exit('usage: example.py RACE_CONTROL [PORT [OWN_ADDRESS]], IPv4 addresses')
    host, port, own = (*sys.argv[1:], '', '')[:3]
    for address in filter(None, (host, own)):
        ipaddress.IPv4Address(address)  # the loop would wait while a name is looked up
    if sys.stdout is None:  # closed
        sys.stdout = open(os.devnull, 'w')  # noqa: PTH123, SIM115
    kart = Kart()
    link = Connection(kart, (host, int(port or DEFAULT_PORT)), own)
    printed = ''
    while True:
        time.sleep(TURN)
        now = clock.now()
        kart.tick(now)  # before any received frame counts
        link.serve(now)
        verdict = kart.verdict
        if drive(verdict.state, verdict.may_drive):
            link.say(kart.acknowledge(verdict.order, clock.now()))
        text = f'obey {verdict.state.value} {verdict.reason}'
        # Ask a terminal that takes no text now again: a kart that waits for it does not stop.
        if text != printed and select.select([], [sys.stdout], [], 0)[1]:
            printed = text
            with contextlib.suppress(OSError):  # nobody reads it any more
                print(text, flush=True)


if __name__ == '__main__':
    main()
