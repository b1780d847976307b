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
import sys
import time

from evgp_protocol import clock
from evgp_protocol.connection import Connection, LinkSettings
from evgp_protocol.frames import DEFAULT_PORT
from evgp_protocol.kart import Kart
from evgp_protocol.states import RaceState

TURN = 0.02
"""Time of one turn of the loop, in seconds."""

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
    link = Connection(kart, LinkSettings(host, int(port or DEFAULT_PORT), own))
    printed = ''
    while True:
        time.sleep(TURN)
        kart.tick(clock.now())  # before any received frame counts
        link.serve()
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
