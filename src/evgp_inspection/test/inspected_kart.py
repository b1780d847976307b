# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Karts to be inspected: one that does what docs/wire.md says, and others with one fault each."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
import random
import socket

from evgp_protocol.frames import encode, FrameDecoder, MalformedFrame
from evgp_protocol.link import unread
from evgp_protocol.states import RaceState

IN_GARAGE, GRID_ACTIVE = RaceState.IN_GARAGE, RaceState.GRID_ACTIVE
GREEN_GREEN = RaceState.GREEN_GREEN
RED_FLAG, RED_RED = RaceState.RED_FLAG, RaceState.RED_RED

STEP = 0.02  # s

ACCELERATION, BRAKING, TOP = 20.0, 12.0, 6.0  # m/s², m/s²: it stops in 0.5 s, m/s
FLAG_BRAKING = 6.0  # m/s²
COASTING = 3.0  # m/s²
UNCOMMANDED = 0.3  # s: then the base brakes by itself
DEAF = 1.2  # s
RETRY = 0.1  # s
DEAD_TIME = 0.3  # s; from a command to the movement

LONG_AFTER = 1.8  # s; longer than any phase in which nothing but `dwell` has it stand

LOOKS_AWAY = (0.4, 1.6)  # s after GREEN_GREEN

FEW_FRAMES = 17.0
"""Frames that one faulty kart reads in a second while it drives, one in each turn of its loop."""

HABITS = (
    'says a newline after each frame',
    'says each byte by itself',
    'says every frame back',
    'has a tiny window',
    'is slow and gentle',
    'brakes as a wheel that coasts down',
    'takes a shorter silence for a loss',
    'speeds up slowly and is seen at irregular times',
    'is seen late',
)
"""What is unusual about a kart that is good."""

MOST_UNREAD = 200
"""Number of bytes that are read 0.7 s late, 6 in each turn."""

SEEN_LATE = 0.4  # s

LATE_ECHO = 0.3  # s; longer than what comes between two RED_RED of the inspection at the least

ECHOES_LATE = 'echoes late, and needs a whole frame in each read'

FAULTS = {
    'drives in the garage': 'K-3A-01',
    'is never ready': 'K-3A-02',
    'creeps on the grid': 'K-3A-03',
    'never says that it drives': 'K-3A-04',
    'says that it drives before it does': 'K-3A-05',
    'never acknowledges RED_FLAG': 'K-3A-06',
    'echoes RED_FLAG': 'K-3A-07',
    'rolls off after RED_FLAG': 'K-3A-08',
    'never acknowledges RED_RED after a drive': 'K-3A-09',
    'echoes RED_RED': 'K-3A-10',
    'is ready only once': 'K-3A-11',
    'acknowledges RED_RED while RED_FLAG brakes': 'K-3A-12',
    'brakes for RED_RED as for RED_FLAG': 'K-3A-13',
    'brakes on as for RED_FLAG when RED_RED comes': 'K-3A-13',
    'is deaf after GREEN_GREEN': 'K-3A-14',
    'acknowledges RED_RED in its dead time': 'K-3A-10',
    'obeys every GREEN_GREEN': 'K-3B-01',
    'RED_RED does not disarm it': 'K-3B-02',
    'is armed by hearing GRID_ACTIVE': 'K-3B-03',
    'RED_FLAG does not disarm it': 'K-3B-04',
    'drives on after FIN': 'K-3C-01',
    'drives on in silence': 'K-3E-01',
    'silence does not disarm it': 'K-3E-02',
    'drives on after RST': 'K-3E-03',
    'does not notice a half-close': 'K-3E-04',
    'a lost connection does not disarm it': 'K-3E-05',
    'a race control that is away arms it': 'K-3E-06',
    'takes malformed bytes for life': 'K-3E-07',
    'acknowledges RED_RED on a new connection while it rolls': 'K-3E-08',
    'drives on without its bridge': 'K-3E-09',
    'drives on without its stack': 'K-3E-10',
    'opens two connections': 'K-4A-02',
    'says malformed frames': 'K-4C-01',
    'needs a whole frame in each read': 'K-4C-02',
    ECHOES_LATE: 'K-4C-02',
    'throws long reads away': 'K-4C-03',
    'forgets half a frame': 'K-4C-04',
    'takes 10 Hz for silence': 'K-4C-05',
    'reads one frame a turn': 'K-4C-06',
    'reads one frame a turn while it drives': 'K-4C-09',
    'looks for GREEN_GREEN anywhere': 'K-4C-07',
    'dies of malformed bytes': 'K-4C-08',
    'echoes an earlier order': 'K-4C-09',
    'floods': 'K-4C-10',
    'speaks first': 'K-4C-11',
    'says on a new connection what it said before': 'K-4C-12',
    'FIN ends it': 'K-4D-01',
    'RST ends it': 'K-4D-02',
    'waits for an error after a half-close': 'K-4D-03',
    'keeps a silent connection': 'K-4D-04',
    'gives up when it is refused': 'K-4D-05',
    'never acknowledges RED_RED after FIN': 'K-4D-06',
    'moves off long after a red': 'K-3A-15',
    'brakes backwards while it stands': 'K-3A-15',
    'coasts when its link is lost while RED_FLAG brakes': 'K-3E-11',
    'looks at no stop for a while after GREEN_GREEN': 'K-4C-09',
    'ignores RED_FLAG at first': 'K-3A-16',
    'drives by itself long after IN_GARAGE': 'K-3A-01',
    'reads 17 frames a second while it drives': 'K-3A-14',
    'drives on when GREEN_GREEN comes while RED_FLAG brakes': 'K-3B-04',
    'drives off long after race control went away': 'K-3E-06',
    'IN_GARAGE does not disarm it': 'K-3B-01',
    'speeds up when RED_FLAG comes': 'K-3A-16',
    'rolls on in IN_GARAGE': 'K-3A-01',
    'hears no silence on the grid': 'K-3E-02',
    'drives on when its stack is started again': 'K-3E-10',
    'coasts when its link is lost while RED_RED brakes': 'K-3E-11',
    'drives on in silence while RED_FLAG brakes': 'K-3E-11',
    'drives on when GREEN_GREEN comes while RED_RED brakes': 'K-3B-02',
    'lets the brake go for a while in RED_RED': 'K-3A-14',
}
"""Each fault, and the sentence that it breaks."""

ALSO = {
    'is never ready': {'K-3A-11'},
    'creeps on the grid': {'K-4C-07'},
    'acknowledges RED_RED in its dead time': {'K-3A-07'},
    'echoes RED_RED': {'K-3A-09', 'K-3A-12', 'K-3E-08'},
    'is deaf after GREEN_GREEN': {'K-4C-09'},
    'obeys every GREEN_GREEN': {
        *('K-3A-09', 'K-3B-02', 'K-3B-03', 'K-3B-04', 'K-3E-02', 'K-3E-05', 'K-3E-06'),
    },
    'RED_RED does not disarm it': {'K-3A-09'},
    'drives on after FIN': {'K-3E-04', 'K-3E-06', 'K-3E-11'},
    'drives on in silence': {'K-3E-07'},
    'a lost connection does not disarm it': {'K-3E-06'},
    'opens two connections': {'K-3A-02', 'K-3A-09', 'K-3A-11', 'K-3B-03'},
    'needs a whole frame in each read': {'K-4C-04'},
    ECHOES_LATE: {'K-4C-04'},
    'reads one frame a turn while it drives': {'K-3A-14'},
    'looks for GREEN_GREEN anywhere': {'K-3E-07', 'K-4C-09'},
    'waits for an error after a half-close': {'K-3E-01', 'K-3E-07', 'K-4D-04'},
    'brakes backwards while it stands': {'K-3A-01'},
    'looks at no stop for a while after GREEN_GREEN': {'K-3A-14', 'K-3A-16'},
    'reads 17 frames a second while it drives': {'K-3A-09', 'K-4C-09'},
    'drives on when GREEN_GREEN comes while RED_RED brakes': {'K-3A-09'},
    'lets the brake go for a while in RED_RED': {'K-3B-02', 'K-3B-04', 'K-3C-01', 'K-3E-11'},
}
"""The other sentences that the same fault breaks, in other steps."""


class InspectedKart:
    """
    A kart with inertia.

    :param take: gets its speed, m/s, 50 times a second.
    :param fault: one of `FAULTS`; empty: none.
    :param habit: one of `HABITS`; empty: none.
    :param long_after: time after which it moves off by itself, if that is its fault, s.
    :param silence: time without a frame after which it stops, s.
    :param says_garage: it says IN_GARAGE back, as docs/wire.md advises.
    """

    def __init__(
        self,
        port: int,
        take: Callable[[float], None],
        fault: str = '',
        silence: float = 1.0,
        says_garage: bool = True,
        habit: str = '',
        long_after: float = LONG_AFTER,
    ) -> None:
        self.speed = 0.0
        assert habit in ('', *HABITS)
        assert fault in ('', *FAULTS)
        self._has = {name: name == habit for name in HABITS}
        self._fault = fault
        self._long_after = long_after
        self._read_at = self._took_at = 0.0
        self._says_garage = says_garage
        self.last_heard = b''
        self._port = port
        self._take = take
        self._is = {name: name == fault for name in FAULTS}
        shorter = self._has['takes a shorter silence for a loss']
        self._silence = 0.9 * silence if shorter else silence
        self._loop = asyncio.get_running_loop()
        self._link: socket.socket | None = None
        self._links = 0
        self._orders = 0  # on this connection
        self._commanded: RaceState | None = None
        self._before: RaceState | None = None
        self._ordered_at = self._heard_at = 0.0
        self._ticked_at = self._loop.time()
        self._armed = False
        self._reached_at: float | None = None
        self._grids = 0
        self._lost_how = ''
        self._reset = False  # the connection, as a frame was to be sent
        self._closed = False  # race control has once closed a connection
        self._drove = False
        self._goes_on = False  # faulty: drives on although race control is gone
        self._decoder = FrameDecoder()
        self._found: asyncio.Future[bool] = self._loop.create_future()
        self._frame_times: list[float] = []
        self._silent_kept = False
        self._deaf_until = 0.0
        self._bridge_killed = False
        self._stack_died_at: float | None = None
        self._coasts = False
        self._green_at = 0.0
        self._seen_next = 0.0
        self._random = random.Random(1)
        self._backs = False
        self._begins = False  # it was told to drive just before a stop

    async def run(self) -> None:
        self._tick()
        second: socket.socket | None = None
        try:
            while True:
                try:
                    link = self._connect()
                except ConnectionRefusedError:
                    if self._is['gives up when it is refused']:
                        await self._loop.create_future()
                    if self._is['a race control that is away arms it']:
                        self._lost_how = 'refused'
                    await asyncio.sleep(RETRY)
                    continue
                link.setblocking(False)
                link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                if self._is['opens two connections'] and second is None:
                    second = socket.create_connection(('127.0.0.1', self._port))
                with link:
                    await self._serve(link)
                ends = {'FIN ends it': 'closed', 'RST ends it': 'reset'}
                if self._lost_how == ends.get(self._fault):
                    await self._loop.create_future()
                await asyncio.sleep(RETRY)
        finally:
            self._next_tick.cancel()
            if second is not None:
                second.close()

    def _connect(self) -> socket.socket:
        link = socket.socket()
        if self._has['has a tiny window']:
            link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
        try:
            link.connect(('127.0.0.1', self._port))
        except OSError:
            link.close()
            raise
        return link

    def kill(self, part: str) -> None:
        """Have its bridge die, which is started again, or its stack: then the base is left."""
        if part == 'bridge':
            self._bridge_killed = True
            self._find(False)
        else:
            self._stack_died_at = self._loop.time()

    # ----- the connection ------------------------------------------------------------------

    async def _serve(self, link: socket.socket) -> None:
        self._link = link
        self._links += 1
        self._orders = 0
        self._decoder = FrameDecoder()
        self._reset = False
        self._heard_at = self._loop.time()
        self._frame_times.clear()
        self._silent_kept = False
        keeps = {
            'silence does not disarm it': ('silent',),
            'a lost connection does not disarm it': ('closed', 'reset'),
            'a race control that is away arms it': ('refused',),
        }
        if self._lost_how not in keeps.get(self._fault, ()):
            self._armed = False
        again = self._links > 1
        if self._is['says on a new connection what it said before' if again else 'speaks first']:
            self._say(encode(RED_RED))
        try:
            await self._read(link)
        finally:
            self._link = None
            self._commanded = None
            self._reached_at = None

    async def _read(self, link: socket.socket) -> None:
        gone = False
        while True:
            now = self._loop.time()
            if self._bridge_killed:
                self._lost('killed')
                self._bridge_killed = False
                return
            deaf = self._is['hears no silence on the grid'] and self._commanded is GRID_ACTIVE
            if now - self._heard_at >= self._silence and not deaf:
                if not self._is['keeps a silent connection']:
                    self._lost('silent')
                    return
                self._silent_kept = True
            if self._too_slow(now):
                self._lost('silent')
                return
            one_frame = self._is['reads one frame a turn'] or (
                self._is['reads one frame a turn while it drives'] and self.speed > 0.0
            )
            if gone or one_frame:
                await asyncio.sleep(STEP)
            if gone:
                try:
                    link.send(b'$RED_RED;' if self._silent_kept else b' ')
                except OSError:
                    self._lost('closed')
                    return
                continue
            if self._is['reads 17 frames a second while it drives'] and self.speed > 0.0:
                await asyncio.sleep(max(self._read_at + 1 / FEW_FRAMES - self._loop.time(), 0.0))
                self._read_at = self._loop.time()
                one_frame = True
            # While it drives it has more to do: a turn is half a frame.
            half = self._is['reads one frame a turn while it drives']
            size = 4096 if not one_frame else 6 if half else 13
            if size == 6:  # but it is never so late that it misses other limits too
                size = max(size, unread(link) - MOST_UNREAD)
            often = self._is['takes 10 Hz for silence']
            left = 0.0 if often else self._heard_at + self._silence - now
            if not await self._readable(link, max(left, STEP)):
                continue
            try:
                data = link.recv(size)
                # Its TCP answers at once: on a simulated clock, no real time passes.
                link.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
            except ConnectionError:
                self._lost('reset')
                return
            if not data and self._reset:
                self._lost('reset')
                return
            if not data:
                if self._is['waits for an error after a half-close']:
                    self._commanded = None
                    self._silence = 1e9
                    gone = True
                elif self._is['does not notice a half-close']:
                    gone = True
                else:
                    self._lost('closed')
                    return
                continue
            if not self._take_in(data):
                self._lost('malformed')
                return

    async def _readable(self, link: socket.socket, seconds: float) -> bool:
        """Return whether there is something to read within a time, while its bridge lives."""
        self._found = self._loop.create_future()
        number = link.fileno()  # asyncio writes out the socket itself for each lookup
        self._loop.add_reader(number, self._find, True)
        timer = self._loop.call_later(seconds, self._find, False)
        try:
            return await self._found
        finally:
            timer.cancel()
            self._loop.remove_reader(number)

    def _find(self, readable: bool) -> None:
        if not self._found.done():
            self._found.set_result(readable)

    def _too_slow(self, now: float) -> bool:
        if not self._is['takes 10 Hz for silence'] or not self._frame_times:
            return False
        recent = [at for at in self._frame_times if at > now - 0.9]
        return now - self._frame_times[0] > 0.9 and len(recent) < 10

    def _lost(self, how: str) -> None:
        self._lost_how = how
        commanded = self._commanded.value if self._commanded else ''
        coasts = f'coasts when its link is lost while {commanded} brakes'
        self._coasts = self._fault == coasts and self.speed > 0.0
        self._closed = self._closed or how == 'closed'
        drives_on = {
            'drives on after FIN': 'closed',
            'drives on in silence': 'silent',
            'drives on after RST': 'reset',
            'drives on without its bridge': 'killed',
        }
        self._goes_on = (how == drives_on.get(self._fault) and self._obeyed is GREEN_GREEN) or (
            self._goes_on and self._is['drives on without its bridge']
        )
        if self._is['drives on in silence while RED_FLAG brakes']:
            self._goes_on = how == 'silent' and self._obeyed is RED_FLAG and self.speed > 0.0

    def _take_in(self, data: bytes) -> bool:
        now = self._loop.time()
        forgets = {
            'needs a whole frame in each read': True,
            ECHOES_LATE: True,
            'forgets half a frame': now - self._took_at > 2 * STEP,
        }
        if forgets.get(self._fault):
            self._decoder = FrameDecoder()
        self._took_at = now
        if self._is['throws long reads away'] and len(data) > 40:
            return True
        if self._is['looks for GREEN_GREEN anywhere'] and b'GREEN_GREEN' in data:
            data = encode(GREEN_GREEN)
        for frame in self._decoder.feed(data):
            if isinstance(frame, MalformedFrame):
                if self._is['takes malformed bytes for life']:
                    self._heard_at = now
                if self._is['dies of malformed bytes']:
                    return False
            else:
                self._heard(frame.state, now)
        return True

    def _heard(self, state: RaceState, now: float) -> None:
        self._heard_at = now
        self.last_heard = encode(state)
        if now < self._deaf_until:
            return
        if self._is['takes 10 Hz for silence']:
            self._frame_times = [*self._frame_times[-40:], now]
        self._goes_on = False
        if self._is[ECHOES_LATE] and state in (IN_GARAGE, RED_RED):
            self._loop.call_later(LATE_ECHO, self._echo, state, self._links)
        if self._silent_kept:
            self._silent_kept = False
            self._armed = False
        if state is self._commanded:
            if self._has['says every frame back'] and self._reached_at is not None:
                self._say(encode(state))
            return
        away, back = LOOKS_AWAY
        looks_away = self._is['looks at no stop for a while after GREEN_GREEN']
        if looks_away and self._armed and away < now - self._green_at < back:
            return
        self._green_at = now if state is GREEN_GREEN else 0.0
        self._coasts = False
        self._backs = (
            self._is['brakes backwards while it stands'] and state is RED_RED and self.speed == 0.0
        )
        before, self._before, self._commanded = self._commanded, self._commanded, state
        if self._is['is deaf after GREEN_GREEN'] and state is GREEN_GREEN and self._armed:
            self._deaf_until = now + DEAF
        self._orders += 1
        self._begins = self._is['acknowledges RED_RED in its dead time'] and (
            before is GREEN_GREEN and now - self._ordered_at < DEAD_TIME
        )
        self._ordered_at = now
        self._reached_at = None
        if state is IN_GARAGE and self._says_garage and not self._is[ECHOES_LATE]:
            self._say(encode(state))
        both = [each.value for each in (before, state) if each]
        keeps = {f'{each} does not disarm it' for each in both}
        if self.speed > 0.0:
            keeps |= {f'drives on when GREEN_GREEN comes while {each} brakes' for each in both}
        stays = before is None or (before is GRID_ACTIVE and state is GREEN_GREEN)
        if self._fault not in keeps and (not stays or state is IN_GARAGE):
            self._armed = False
        if state is GRID_ACTIVE:
            self._grids += 1
            self._armed = self._armed or self._is['is armed by hearing GRID_ACTIVE']
        if self._fault == f'echoes {state.value}':
            self._say(encode(state))
        if self._is['says malformed frames'] and state is GRID_ACTIVE:
            self._say(b'$OK;')

    def _echo(self, state: RaceState, link: int) -> None:
        if link == self._links and self.speed == 0.0:
            self._say(encode(state))

    def _say(self, data: bytes) -> None:
        if self._link is not None:
            if self._has['says a newline after each frame']:
                data += b'\r\n'
            bytewise = self._has['says each byte by itself']
            try:
                for each in [bytes([byte]) for byte in data] if bytewise else [data]:
                    self._link.send(each)
            except ConnectionResetError:
                self._reset = True  # which the next read would take for an orderly close
            except OSError:
                pass  # as `_read` finds

    # ----- the wheels ----------------------------------------------------------------------

    @property
    def _obeyed(self) -> RaceState:
        commanded = self._commanded
        if commanded is None or self._silent_kept:
            return RED_RED
        if commanded is GREEN_GREEN and not (self._armed or self._is['obeys every GREEN_GREEN']):
            return RED_RED
        return commanded

    def _tick(self) -> None:
        now = self._loop.time()
        self._next_tick = self._loop.call_later(STEP, self._tick)
        obeyed = self._obeyed
        since = now - self._ordered_at
        target = TOP if obeyed is GREEN_GREEN or self._goes_on else 0.0
        if self._is['drives in the garage'] and obeyed is IN_GARAGE and since > 0.4:
            target = 1.0
        if self._is['creeps on the grid'] and obeyed is GRID_ACTIVE:
            target = 0.5
        if self._is['acknowledges RED_RED in its dead time'] and since < DEAD_TIME:
            target = self.speed if obeyed is GREEN_GREEN else target
        if self._begins and DEAD_TIME - 0.15 < since < DEAD_TIME + 0.15:
            target = TOP
        if self._is['says that it drives before it does'] and since < 1.0:
            target = min(target, self.speed)
        rolls = self._reached_at is not None and now - self._reached_at > 1.1
        if self._is['rolls off after RED_FLAG'] and obeyed is RED_FLAG and rolls:
            target = 0.5
        long_after = {
            'moves off long after a red': RED_RED,
            'drives by itself long after IN_GARAGE': IN_GARAGE,
        }
        if since > self._long_after and self._commanded is not None:
            target = 0.5 if obeyed is long_after.get(self._fault) else target
        if self._is['ignores RED_FLAG at first'] and obeyed is RED_FLAG and since < 1.0:
            target = self.speed
        away = self._link is None and now - self._heard_at > self._long_after
        if away and self._is['drives off long after race control went away']:
            target = 0.5
        speeds_up = self._is['speeds up when RED_FLAG comes'] and obeyed is RED_FLAG
        speeds_up = speeds_up and since < 0.8 and self.speed > 0.0
        if speeds_up:
            target = 2 * TOP
        lets_go = self._is['lets the brake go for a while in RED_RED'] and self._drove
        if lets_go and obeyed is RED_RED and 0.2 < since < 1.5 and self.speed > 0.0:
            target = 0.8 * TOP
        if self._backs and since < 0.35:
            target = -1.0
        died = self._stack_died_at
        comes_back = self._is['drives on when its stack is started again']
        if comes_back and died is not None and now - died > self._long_after:
            died = self._stack_died_at = None
        if died is not None and now - died > UNCOMMANDED:
            target = TOP if self._is['drives on without its stack'] else 0.0
        weak = {
            'brakes for RED_RED as for RED_FLAG': True,
            'brakes on as for RED_FLAG when RED_RED comes': self._before is RED_FLAG,
        }
        gently = obeyed is RED_FLAG or (obeyed is RED_RED and weak.get(self._fault, False))
        braking = FLAG_BRAKING if gently and died is None else BRAKING
        if gently and self._is['drives on in silence while RED_FLAG brakes']:
            braking = 0.6 * FLAG_BRAKING  # it still rolls when it notices the silence
        acceleration = ACCELERATION / 5 if speeds_up else ACCELERATION
        if self._has['is slow and gentle']:
            braking, acceleration = braking / 3, ACCELERATION / 10
            if since < DEAD_TIME:  # and it begins gently, too
                braking = acceleration = 0.0
            elif since < 2 * DEAD_TIME:
                braking *= (since - DEAD_TIME) / DEAD_TIME
        if self._has['speeds up slowly and is seen at irregular times']:
            acceleration = ACCELERATION / 10
        if self._has['brakes as a wheel that coasts down'] and self.speed > 0.3:
            braking *= 3 * self.speed / TOP
        if self._coasts:
            braking = COASTING
        if self._is['rolls on in IN_GARAGE'] and obeyed is IN_GARAGE:
            braking = COASTING / 6
        change = target - self.speed
        # Where this computer is busy, a step is longer.
        step, self._ticked_at = now - self._ticked_at, now
        self.speed += max(-braking * step, min(acceleration * step, change))
        self._drove = self._drove or self.speed > 1.0
        if now >= self._seen_next:
            if self._has['is seen late']:
                self._loop.call_later(SEEN_LATE, self._take, self.speed)
            else:
                self._take(self.speed)
            if self._has['speeds up slowly and is seen at irregular times']:
                self._seen_next = now + self._random.uniform(0.0, 0.1)
        if self._commanded is not None and died is None:
            self._acknowledge(obeyed, now, since, step)

    def _acknowledge(self, obeyed: RaceState, now: float, since: float, step: float) -> None:
        if self._is['floods'] and self._links == 1 and obeyed is IN_GARAGE:
            self._say(encode(IN_GARAGE) * int(12_500 * step))
        late = self._before is GRID_ACTIVE and obeyed is RED_RED and since < 0.9
        if self._is['echoes an earlier order'] and late:
            self._say(encode(GRID_ACTIVE))
        if obeyed is not self._commanded or obeyed is IN_GARAGE:
            return
        moves = self.speed > 0.0
        reached = moves is (obeyed is GREEN_GREEN)
        false = {
            'creeps on the grid': GRID_ACTIVE,
            'says that it drives before it does': GREEN_GREEN,
        }
        reached = reached or obeyed is false.get(self._fault)
        early = {
            'acknowledges RED_RED while RED_FLAG brakes': self._before is RED_FLAG,
            'acknowledges RED_RED on a new connection while it rolls': self._orders == 1,
        }
        reached = reached or (obeyed is RED_RED and early.get(self._fault, False))
        if not reached or self._keeps_quiet(obeyed):
            return
        if self._reached_at is None:
            self._reached_at = now
        self._armed = self._armed or obeyed is GRID_ACTIVE
        if not (self._has['says every frame back'] and now > self._reached_at):
            self._say(encode(obeyed))

    def _keeps_quiet(self, obeyed: RaceState) -> bool:
        keeps = {
            'is never ready': (GRID_ACTIVE, True),
            'is ready only once': (GRID_ACTIVE, self._grids > 1),
            'never says that it drives': (GREEN_GREEN, True),
            'never acknowledges RED_FLAG': (RED_FLAG, True),
            'never acknowledges RED_RED after a drive': (RED_RED, self._drove),
            'never acknowledges RED_RED after FIN': (RED_RED, self._closed),
            ECHOES_LATE: (RED_RED, True),
        }
        state, now = keeps.get(self._fault, (None, False))
        return obeyed is state and now
