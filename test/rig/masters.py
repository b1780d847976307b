# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Two machines that may both be race control, on one network with ten karts.

Each machine has a cable to the karts' switch and one to the officials', and karts that look for
race control's address all the time.
"""

from __future__ import annotations

import contextlib
import itertools
import pathlib
import threading
import time

from evgp_protocol.frames import DEFAULT_PORT
from evgp_protocol.states import RaceState
from evgp_testing.domains import Domain
from evgp_testing.official import Official
from evgp_testing.part import PATIENCE
from evgp_testing.race_control import RaceControl
from evgp_testing.wire_kart import WireKart
from rig.networks import kart_address, Namespace, own_disk, RACE_CONTROL

NUMBERS = range(1, 11)
FIRST, SPARE = '10.78.0.1', '10.78.0.2'
"""The addresses on the officials' network."""

KARTS_CARD = 'eth0'
"""Each machine's interface on the karts' network."""


class Masters:
    """
    The two machines, their switches and their karts.

    :ivar links: what each kart is connected by now.
    :ivar said: each connection of each kart, in order.
    """

    def __init__(self, stack: contextlib.ExitStack, folder: pathlib.Path) -> None:
        """Plug all cables in, and let the karts look for race control's address."""
        self.domain = stack.enter_context(Domain()).number
        self.first, self.spare, self.switches, self.karts = (
            stack.enter_context(Namespace()) for _ in range(4)
        )
        self.stack, self.folder = stack, folder
        self._numbers = itertools.count(1)
        for network in ('karts', 'officials'):
            self.switches.ip(f'link add {network} type bridge', f'link set {network} up')
        self.cable(self.first, 'first', RACE_CONTROL, FIRST)
        self.cable(self.spare, 'spare', '10.77.0.2', SPARE)
        self.cable(self.karts, 'all', *map(kart_address, NUMBERS[:1]))
        self.karts.ip(*(f'addr add {kart_address(n)}/24 dev eth0' for n in NUMBERS[1:]))
        self.links: dict[int, WireKart] = {}
        self.said: dict[int, list[WireKart]] = {number: [] for number in NUMBERS}
        self._ended = threading.Event()
        for number in NUMBERS:
            kart = threading.Thread(target=self._drive, args=(number,))
            kart.start()
            stack.callback(kart.join)
        stack.callback(self._ended.set)

    def cable(self, machine: Namespace, name: str, *addresses: str) -> None:
        """Give a machine a cable to the karts' switch and, with a second address, the other's."""
        networks = zip(('karts', 'officials'), addresses, strict=False)
        for at, (network, address) in enumerate(networks):
            self.switches.ip(
                f'link add {name}-{network} type veth peer name eth{at} netns {machine.path}',
                f'link set {name}-{network} master {network} up',
            )
            machine.ip(f'addr add {address}/24 dev eth{at}', f'link set eth{at} up')
        if len(addresses) == 2:
            machine.ip('route add 239.0.0.0/8 dev eth1')

    def plug(self, name: str, up: bool) -> None:
        """Plug a cable in at its switch, or out."""
        self.switches.ip(f'link set {name} {"up" if up else "down"}')

    def reach(self, name: str, up: bool) -> None:
        """Have the switch forward to a cable, or not; the machine at its end cannot see that."""
        self.switches.ip(f'link set {name} {"master karts" if up else "nomaster"}')

    def start(self, machine: Namespace, under: tuple[str, ...] = ()) -> RaceControl:
        """Start race control on a machine, as the first one there, under a command."""
        folder = self.folder / str(next(self._numbers))
        folder.mkdir()
        with machine.inside():
            control = RaceControl(
                folder,
                self.domain,
                NUMBERS,
                parameters={'address': RACE_CONTROL, 'port': DEFAULT_PORT},
                addresses=kart_address,
                under=(*own_disk(folder), *under),
            )
        return self.stack.enter_context(control)

    def official(self, machine: Namespace) -> Official:
        """Return an official at a screen of a machine."""
        with machine.inside():
            official = Official(self.domain)
        return self.stack.enter_context(official)

    def wait_for(self, state: RaceState, since: float = 0.0) -> float:
        """Return when the last kart was sent a state, by a connection younger than that."""
        ends = time.monotonic() + 2 * PATIENCE
        while time.monotonic() < ends:
            links = [each for each in list(self.links.values()) if each.opened >= since]
            if len(links) == len(NUMBERS) and all(each.state is state for each in links):
                return max(each.changes[-1][0] for each in links)
            time.sleep(0.02)
        raise AssertionError({n: (each.ended, each.changes) for n, each in self.links.items()})

    def sent(self, number: int, since: float) -> tuple[RaceState | None, set[RaceState]]:
        """Return what a kart was sent last before a time, and all that it was sent after it."""
        told = [change for link in self.said[number] for change in link.changes]
        changes = sorted(told, key=lambda change: change[0])
        before = [state for at, state in changes if at < since]
        return before[-1] if before else None, {state for at, state in changes if at >= since}

    def _drive(self, number: int) -> None:
        """Be a kart: connect to the address, again and again."""
        while not self._ended.wait(0.2):
            with self.karts.inside(), contextlib.suppress(OSError):
                kart = WireKart(
                    kart_address(number),
                    DEFAULT_PORT,
                    acknowledges=True,
                    host=RACE_CONTROL,
                    timeout=1.0,
                )
                self.links[number] = kart
                self.said[number].append(kart)
                while not (kart.ended or self._ended.wait(0.05)):
                    if time.monotonic() - max([kart.opened, *kart.times[-1:]]) > 1.0:
                        break  # race control is silent, and a kart waits no longer
                kart.close()
