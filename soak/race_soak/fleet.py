# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Many plain TCP karts in one thread: random acknowledgements, random faults, all observed."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterable
import random
import threading
from typing import Any

from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState
from evgp_testing.wire_kart import FRAMES, kart_socket, KartLink
from evgp_testing.witness import Witness

GRID_ACTIVE = RaceState.GRID_ACTIVE
STATES = tuple(RaceState)

MOODS = {'right': 8, 'echo': 4, 'wrong': 2, 'late': 2, 'early': 2, 'mute': 1}
"""Ways in which a kart acknowledges, and their weights."""

FAULTS = {
    'drop': 4,
    'reset': 4,
    'half close': 2,
    'silence': 4,
    'deaf': 1,
    'garbage': 4,
    'flood': 1,
    'half frame': 4,
    'reconnects': 1,
    'stolen address': 2,
    'stranger': 2,
}
"""Faults, and their weights."""


class _Link(KartLink):
    """One connection of a kart; a ``deaf`` one has a tiny buffer."""

    def __init__(
        self, kart: int, address: str, port: int, witness: Witness, mood: str, deaf: bool
    ) -> None:
        # One that is deaf does not see what it is sent.
        watching = None if deaf else witness
        super().__init__(address, ('127.0.0.1', port), watching, kart, int(deaf), timeout=5.0)
        self.socket.setblocking(False)
        self.mood = mood


class Fleet:
    """
    Karts with one connection each (or two, or none), until ``stop``.

    :param port: race control's port.
    :param addresses: the karts' addresses, by number.
    :param strangers: addresses that are not in the roster.
    :param witness: learns of everything that karts see.
    :param fault_every: mean time between a kart's faults, s.
    """

    def __init__(
        self,
        port: int,
        addresses: dict[int, str],
        strangers: Iterable[str],
        witness: Witness,
        rng: random.Random,
        fault_every: float,
    ) -> None:
        """Prepare; nothing is opened before ``start``."""
        self.port = port
        self.disciplined = threading.Event()
        """While set, karts acknowledge what they are sent, and faults are rare."""
        self.faults: Counter[str] = Counter()
        self.failure: BaseException | None = None
        self._addresses = addresses
        self._strangers = list(strangers)
        self._witness = witness
        self._rng = rng
        self._fault_every = fault_every
        self._links: dict[int, list[_Link]] = {number: [] for number in addresses}
        self._loop = asyncio.new_event_loop()
        self._after = self._loop.call_later
        self._loop.set_exception_handler(self._fail)
        self._thread = threading.Thread(target=self._run, name='karts', daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        for link in [each for links in self._links.values() for each in links]:
            self._close(link)
        self._loop.close()

    def _run(self) -> None:
        for kart in self._addresses:
            self._after(self._rng.uniform(0, 0.5), self._connect_again, kart)
            self._after(self._rng.uniform(0.5, self._fault_every), self._fault, kart)
        self._loop.run_forever()

    def _fail(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """End because of what went wrong in the thread; the main thread raises it."""
        self.failure = context.get('exception') or RuntimeError(context['message'])
        loop.stop()

    # ----- connections --------------------------------------------------------------------

    def _connect_again(self, kart: int) -> None:
        if not self._links[kart]:
            self._connect(kart)

    def _connect(self, kart: int, deaf: bool = False) -> _Link | None:
        mood = self._rng.choices(list(MOODS), list(MOODS.values()))[0]
        try:
            link = _Link(kart, self._addresses[kart], self.port, self._witness, mood, deaf)
        except OSError:
            self._after(0.5, self._connect_again, kart)
            return None
        self._links[kart].append(link)
        self._loop.add_reader(link.socket, self._read, link)
        if link.mood == 'early':
            self._after(self._rng.uniform(0, 1), self._say_early, link)
        return link

    def _close(self, link: _Link, reset: bool = False) -> None:
        """End a connection from this side."""
        if link not in self._links[link.kart]:
            return
        self._loop.remove_reader(link.socket)
        link.end(reset)
        self._links[link.kart].remove(link)
        most = 0.3 if self.disciplined.is_set() else 2.0
        self._after(self._rng.uniform(0, most), self._connect_again, link.kart)

    # ----- what is heard ------------------------------------------------------------------

    def _read(self, link: _Link) -> None:
        heard = link.take()
        if heard is None:
            self._close(link)
            return
        for state, change in heard:
            self._answer(link, state, change)

    # ----- what is said -------------------------------------------------------------------

    def _answer(self, link: _Link, state: RaceState, change: bool) -> None:
        mood = 'right' if self.disciplined.is_set() else link.mood
        if mood == 'echo':
            self._say(link, state)
        elif change and mood == 'right':
            delay = 0.05 if self.disciplined.is_set() else 0.6
            self._after(self._rng.uniform(0, delay), self._say_if, link, state)
        elif change and mood == 'wrong':
            self._say(link, self._rng.choice(STATES))
        elif change and mood == 'late':
            if len(link.changes) > 1:
                self._say(link, link.changes[-2][1])
            self._after(self._rng.uniform(0.5, 3.0), self._say_if, link, state)
        elif not change and mood == 'right' and self._rng.random() < 0.2:
            # The kart may not have been right yet when the state came.
            self._say(link, state)
        if self._rng.random() < 0.01:
            link.mood = self._rng.choices(list(MOODS), list(MOODS.values()))[0]

    def _say_early(self, link: _Link) -> None:
        if link not in self._links[link.kart]:
            return
        self._say(link, self._rng.choice((GRID_ACTIVE, GRID_ACTIVE, *STATES)))
        self._after(self._rng.uniform(0, 0.5), self._say_early, link)

    def _say_if(self, link: _Link, state: RaceState) -> None:
        if link.state is state:
            self._say(link, state)

    def _say(self, link: _Link, state: RaceState) -> None:
        ready = state is GRID_ACTIVE and self._rng.random() < 0.1
        self._send(link, b'$READY;' if ready else encode(state))

    def _send(self, link: _Link, data: bytes) -> None:
        """Send as much as goes."""
        if link in self._links[link.kart]:
            try:
                link.send(data)
            except OSError:
                pass  # full or gone; the reader notices next

    # ----- what goes wrong ----------------------------------------------------------------

    def _fault(self, kart: int) -> None:
        self._after(self._rng.expovariate(1 / self._fault_every), self._fault, kart)
        if self.disciplined.is_set() and self._rng.random() < 0.95:
            return
        if links := self._links[kart]:
            kind = self._rng.choices(list(FAULTS), list(FAULTS.values()))[0]
            self.faults[kind] += 1
            getattr(self, f'_{kind.replace(" ", "_")}')(links[-1])

    def _drop(self, link: _Link) -> None:
        self._close(link)

    def _reset(self, link: _Link) -> None:
        self._close(link, reset=True)

    def _half_close(self, link: _Link) -> None:
        link.half_close()

    def _silence(self, link: _Link) -> None:
        """Read nothing for a while; race control tolerates that."""
        if self._loop.remove_reader(link.socket):
            self._after(self._rng.uniform(0.1, 0.9), self._hear_again, link)

    def _hear_again(self, link: _Link) -> None:
        if link in self._links[link.kart]:
            self._loop.add_reader(link.socket, self._read, link)

    def _deaf(self, link: _Link) -> None:
        """Use a tiny buffer and never read again; race control gives such a kart up."""
        self._close(link)
        deaf = self._connect(link.kart, deaf=True)
        if deaf is not None:
            self._loop.remove_reader(deaf.socket)
            self._after(self._rng.uniform(1.0, 5.0), self._close, deaf)

    def _garbage(self, link: _Link) -> None:
        self._send(link, self._rng.randbytes(self._rng.choice((1, 7, 40, 3000))))

    def _flood(self, link: _Link) -> None:
        frames = [self._rng.choice((*FRAMES, b'$$', b';', b'\0')) for _ in range(1500)]
        self._send(link, b''.join(frames))

    def _half_frame(self, link: _Link) -> None:
        """Send one half of a frame now and the other half later."""
        frame = encode(self._rng.choice((GRID_ACTIVE, RaceState.RED_RED, *STATES)))
        cut = self._rng.randint(1, len(frame) - 1)
        self._send(link, frame[:cut])
        self._after(self._rng.uniform(0.01, 2.0), self._send, link, frame[cut:])

    def _reconnects(self, link: _Link) -> None:
        """Come and go as quickly as possible."""
        kart = link.kart
        self._close(link, reset=True)
        for turn in range(10):
            new = self._connect(kart)
            if new is not None:
                self._close(new, reset=turn % 2 == 0)

    def _stolen_address(self, link: _Link) -> None:
        """Connect a second time from the same address."""
        self._connect(link.kart)

    def _stranger(self, link: _Link) -> None:
        """Connect from an address outside the roster, which must be sent nothing."""
        address = self._rng.choice(self._strangers)
        try:
            with kart_socket(address, ('127.0.0.1', self.port), timeout=1.0) as stranger:
                stranger.send(encode(RaceState.GREEN_GREEN))
                data = stranger.recv(100)
        except OSError:
            return  # closed, as it must be
        if data:
            self._witness.strangers.append(f'{address} is not in the roster and was sent {data!r}')
