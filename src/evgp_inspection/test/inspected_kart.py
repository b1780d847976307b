# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A kart that does what docs/wire.md says, and what other karts do otherwise."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Iterator
import functools
import random
import socket
from typing import Any

from evgp_protocol.frames import encode, FrameDecoder, MalformedFrame
from evgp_protocol.link import unread
from evgp_protocol.states import RaceState

IN_GARAGE, GRID_ACTIVE = RaceState.IN_GARAGE, RaceState.GRID_ACTIVE
GREEN_GREEN = RaceState.GREEN_GREEN
RED_FLAG, RED_RED = RaceState.RED_FLAG, RaceState.RED_RED

TURN = 0.05  # s
ACCELERATION, BRAKING, TOP = 20.0, 12.0, 6.0  # m/s², m/s²: it stops in 0.5 s, m/s
FLAG_BRAKING, COASTING = 5.0, 3.0  # m/s²
UNCOMMANDED = 0.3  # s without its stack: then the base brakes by itself
RETRY = 0.1  # s
DEAD_TIME = 0.3  # s; from a command to the movement


class Kart:
    """
    A good kart with inertia, each of whose methods another kart may replace.

    :param take: gets its speed, m/s, each turn.
    :param kind: one of `FAULTS` or `HABITS`; empty: neither.
    :param silence: time without a frame after which it stops, s.
    :param says_garage: it says IN_GARAGE back, as docs/wire.md advises.
    :param long_after: time after which it moves off by itself, if that is its fault, s.
    """

    def __init__(
        self,
        port: int,
        take: Callable[[float], None],
        kind: str,
        silence: float,
        says_garage: bool,
        long_after: float,
    ) -> None:
        self.port, self.take = port, take
        self.silence, self.long_after = silence, long_after
        self._says_garage = says_garage
        self.speed = 0.0
        self.last_heard = b''
        self.loop = asyncio.get_running_loop()
        self.now = self._turned_at = self.loop.time()
        self.link: socket.socket | None = None
        self.links = self.orders = self.grids = 0
        self.others: list[socket.socket] = []
        self._retry_at = self.heard_at = self.took_at = 0.0
        self.frames: deque[float] = deque(maxlen=10)  # the times of the last ones
        self.decoder, self.begun = FrameDecoder(), b''
        self.losses: list[str] = []
        # How it lost race control, and what it obeyed and how fast it was then.
        self.lost_how, self.lost_in, self.lost_at_speed = '', RED_RED, 0.0
        self.drove = self.armed = False
        # The order in force, the one before, and for how long that one was in force.
        self.commanded: RaceState | None = None
        self.before: RaceState | None = None
        self.lasted = self.ordered_at = self.ordered_at_speed = 0.0
        self.reached_at: float | None = None
        self.died_at: float | None = None
        self.see_next = 0.0
        self.random = random.Random(1)
        for name, change in KINDS[kind].items():
            setattr(self, name, functools.partial(change, self))
        self._next_turn = self.loop.call_later(0.0, self._turn)

    # Other karts do something here, or decide otherwise (`in_turns`: to read once in each turn,
    # instead of when something has arrived).
    greet = on_malformed = on_turn = lambda self: None
    prepare = on_frame = on_order = lambda self, x: None
    in_turns = stays_armed_on_new_link = ignores = lambda self: False

    def end(self) -> None:
        self._next_turn.cancel()
        self._close()
        for other in self.others:
            other.close()

    def kill(self, part: str) -> None:
        """Have its bridge die, which is started again, or its stack: then the base is left."""
        if part == 'bridge':
            self.lose('killed')
        else:
            self.died_at = self.now

    def _turn(self) -> None:
        self._next_turn = self.loop.call_later(TURN, self._turn)
        now = self.loop.time()
        step, self._turned_at, self.now = now - self._turned_at, now, now
        if self.link is None and now >= self._retry_at:
            self.connect()
        if self.link is not None and self.silent():
            self.on_silence()
        if self.link is not None and self.in_turns():
            self.read()
        target, braking = self.wants(), self.brakes()
        dead = self.stack_is_dead()
        if dead:
            braking = BRAKING
            if now - (self.died_at or now) > UNCOMMANDED:
                target = self.base_wants()
        self.speed += max(-braking * step, min(self.speeds_up() * step, target - self.speed))
        self.drove = self.drove or self.speed > 1.0
        self.sees(self.speed)
        if self.commanded is not None and not dead:
            self.on_turn()
            self.reports()

    @property
    def since(self) -> float:
        """Return the time since the order in force came, s."""
        return self.now - self.ordered_at

    def lost(self, in_state: RaceState, *how: str) -> bool:
        """Return whether it lost race control so, while it obeyed a state and moved."""
        moved = self.commanded is None and self.lost_at_speed > 0.0
        return moved and self.lost_in is in_state and self.lost_how in (how or [self.lost_how])

    # ----- the connection ------------------------------------------------------------------

    def connect(self) -> None:
        link = socket.socket()
        self.prepare(link)
        try:
            link.connect(('127.0.0.1', self.port))
        except OSError:
            link.close()
            self._retry_after('refused')
            return
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.link = link
        self.links += 1
        self.orders = 0
        self.decoder, self.begun = FrameDecoder(), b''
        self.frames.clear()
        self.heard_at = self.now
        self.armed = self.armed and self.stays_armed_on_new_link()
        if not self.in_turns():
            self.loop.add_reader(link.fileno(), self.read)
        self.greet()

    def _close(self) -> None:
        if self.link is not None:
            self.loop.remove_reader(self.link.fileno())
            self.link.close()
            self.link = None

    def lose(self, how: str) -> None:
        self._close()
        if self.commanded is not None:
            self.lost_how, self.lost_in, self.lost_at_speed = how, self.obeyed, self.speed
        self.commanded = self.reached_at = None
        self._retry_after(how)

    def _retry_after(self, how: str) -> None:
        self.losses.append(how)
        self._retry_at = self.now + (RETRY if self.retries(how) else 1e9)

    def retries(self, how: str) -> bool:
        return True

    def silent(self) -> bool:
        return self.now - self.heard_at >= self.silence

    def on_silence(self) -> None:
        self.lose('silent')

    def read(self) -> None:
        assert self.link is not None
        self.now = self.loop.time()
        try:
            data = self.link.recv(self.size())
            # Its TCP answers at once: on a simulated clock, no real time passes.
            self.link.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
        except BlockingIOError:
            return
        except ConnectionError:
            self.lose('reset')
            return
        if data:
            self.take_in(data)
            self.took_at = self.now
        else:
            self.on_end()

    def size(self) -> int:
        return 65536

    def on_end(self) -> None:
        self.lose('closed')

    def take_in(self, data: bytes) -> None:
        for frame in self.decoder.feed(data):
            if isinstance(frame, MalformedFrame):
                self.on_malformed()
            else:
                self._hear(frame.state)

    def _hear(self, state: RaceState) -> None:
        self.heard_at = self.now
        self.frames.append(self.now)
        self.last_heard = encode(state)
        self.on_frame(state)
        if state is self.commanded or self.ignores():
            return
        self.lasted, self.ordered_at, self.ordered_at_speed = self.since, self.now, self.speed
        self.before, self.commanded = self.commanded, state
        self.reached_at = None
        self.orders += 1
        self.grids += state is GRID_ACTIVE
        self.armed = self.armed and self.stays_armed()
        if state is IN_GARAGE and self.says_garage():
            self.say(encode(state))
        self.on_order(state)

    def says_garage(self) -> bool:
        return self._says_garage

    def stays_armed(self) -> bool:
        if self.before is None:
            return self.commanded is not IN_GARAGE
        return self.before is GRID_ACTIVE and self.commanded is GREEN_GREEN

    def say(self, data: bytes) -> None:
        if self.link is None:
            return
        try:
            self.link.send(data)
        except BlockingIOError:
            pass
        except ConnectionResetError:  # which the next read would take for an orderly close
            self.lose('reset')
        except OSError:
            self.lose('closed')

    # ----- the wheels ----------------------------------------------------------------------

    @property
    def obeyed(self) -> RaceState:
        if self.commanded is None or (self.commanded is GREEN_GREEN and not self.may_drive()):
            return RED_RED
        return self.commanded

    def may_drive(self) -> bool:
        return self.armed

    def wants(self) -> float:
        return TOP if self.obeyed is GREEN_GREEN else 0.0

    def brakes(self) -> float:
        return FLAG_BRAKING if self.obeyed is RED_FLAG else BRAKING

    def speeds_up(self) -> float:
        return ACCELERATION

    def stack_is_dead(self) -> bool:
        return self.died_at is not None

    def base_wants(self) -> float:
        return 0.0

    def sees(self, speed: float) -> None:
        self.take(speed)

    def reports(self) -> None:
        obeyed = self.obeyed
        if obeyed is not self.commanded or obeyed is IN_GARAGE or not self.reached(obeyed):
            return
        if self.reached_at is None:
            self.reached_at = self.now
            self.say(encode(obeyed))
        if obeyed is GRID_ACTIVE:
            self.arm()

    def arm(self) -> None:
        self.armed = True

    def reached(self, obeyed: RaceState) -> bool:
        return (self.speed > 0.0) is (obeyed is GREEN_GREEN)


# ----- other karts --------------------------------------------------------------------------


def stand_down(k: Kart) -> None:
    k.commanded, k.armed = None, False


def wait_for_error(k: Kart) -> None:
    stand_down(k)
    k.silence = 1e9
    k.say(b' ')


def take_whole_frames(k: Kart, data: bytes) -> None:
    k.decoder = FrameDecoder()
    Kart.take_in(k, data)


def take_what_ends(k: Kart, data: bytes) -> None:
    """Take whatever a semicolon ends for a frame: without its dollar, in any case, in a line."""
    *ended, k.begun = (k.begun + data).split(b';')
    for each in ended:
        Kart.take_in(k, b'$%b;' % each.strip(b'$ \r\n\0').upper())


def echo_late(k: Kart, state: RaceState) -> None:
    """Echo later than the shortest time between two RED_RED of the inspection."""
    link = k.links
    k.loop.call_later(0.3, lambda: link == k.links and k.speed == 0.0 and k.say(encode(state)))


def connect_twice(k: Kart) -> None:
    Kart.connect(k)
    if k.link is not None and not k.others:
        k.others = [socket.create_connection(k.link.getpeername())]


def half_a_frame(k: Kart) -> int:
    """Return how much it reads, of which there is never so much that it misses other limits."""
    assert k.link is not None
    return max(6, unread(k.link) - 200)


def report_each_turn(k: Kart) -> None:
    k.reached_at = None
    Kart.reports(k)


def see_at_irregular_times(k: Kart, speed: float) -> None:
    if k.now >= k.see_next:
        k.take(speed)
        k.see_next = k.now + k.random.uniform(0.0, 0.1)


_FAULTS = """
K-3A-01 | drives in the garage | wants 1.0 if k.obeyed is IN_GARAGE and k.since > 0.4
K-3A-01 | drives by itself long after IN_GARAGE |
    wants 0.5 if k.obeyed is IN_GARAGE and k.since > k.long_after
K-3A-01 | rolls on in IN_GARAGE | brakes COASTING / 6 if k.obeyed is IN_GARAGE
K-3A-02 K-3A-11 | is never ready | reached False if x is GRID_ACTIVE
K-3A-03 K-4C-07 | creeps on the grid | wants 0.5 if k.obeyed is GRID_ACTIVE;
    reached True if x is GRID_ACTIVE
K-3A-04 | never says that it drives | reached False if x is GREEN_GREEN
K-3A-05 | says that it drives before it does | reached True if x is GREEN_GREEN;
    wants 0.0 if k.obeyed is GREEN_GREEN and k.since < 1.0
K-3A-06 | never acknowledges RED_FLAG | reached False if x is RED_FLAG
K-3A-07 | echoes RED_FLAG | on_order k.say(b'$RED_FLAG;') if x is RED_FLAG
K-3A-08 | rolls off after RED_FLAG |
    wants 0.5 if k.obeyed is RED_FLAG and k.reached_at and k.now - k.reached_at > 1.1
K-3A-09 | never acknowledges RED_RED after a drive | reached False if x is RED_RED and k.drove
K-3A-10 K-3A-09 K-3A-12 K-3E-08 | echoes RED_RED | on_order k.say(b'$RED_RED;') if x is RED_RED
K-3A-10 K-3A-07 | acknowledges RED_RED in its dead time |
    wants k.speed if k.obeyed is GREEN_GREEN and k.since < DEAD_TIME else TOP if
    k.before is GREEN_GREEN and k.lasted < DEAD_TIME and abs(k.since - DEAD_TIME) < 0.15
K-3A-11 | is ready only once | reached False if x is GRID_ACTIVE and k.grids > 1
K-3A-12 | acknowledges RED_RED while RED_FLAG brakes |
    reached True if x is RED_RED and k.before is RED_FLAG
K-3A-13 | brakes for RED_RED as for RED_FLAG | brakes FLAG_BRAKING if k.obeyed is RED_RED
K-3A-13 | brakes on as for RED_FLAG when RED_RED comes |
    brakes FLAG_BRAKING if k.obeyed is RED_RED and k.before is RED_FLAG
K-3A-14 | is deaf after GREEN_GREEN | ignores k.obeyed is GREEN_GREEN and k.since < 1.2
K-3A-14 K-3A-09 K-4C-09 | reads 17 frames a second while it drives | in_turns True;
    read None if k.speed > 0.0 and k.now - k.took_at < 1 / 17; size 13 if k.speed > 0.0
K-3A-14 K-3A-09 K-3B-02 K-3B-04 K-3C-01 K-3E-11 | lets the brake go for a while in RED_RED |
    wants 0.8 * TOP if k.drove and k.obeyed is RED_RED and 0.1 < k.since < 1.4 and k.speed > 0.0
K-3A-15 | moves off long after a red |
    wants 0.5 if k.commanded and k.obeyed is RED_RED and k.since > k.long_after
K-3A-15 K-3A-01 | brakes backwards while it stands |
    wants -1.0 if k.commanded is RED_RED and k.ordered_at_speed == 0.0 and k.since < 0.35
K-3A-16 | ignores RED_FLAG at first | wants k.speed if k.obeyed is RED_FLAG and k.since < 1.0
K-3A-16 | speeds up when RED_FLAG comes |
    wants 2 * TOP if k.obeyed is RED_FLAG and k.since < 0.8 and k.speed > 0.0;
    speeds_up ACCELERATION / 5 if k.obeyed is RED_FLAG
K-3B-01 K-3A-09 K-3B-02 K-3B-03 K-3B-04 K-3E-02 K-3E-05 K-3E-06 K-3E-09 |
    obeys every GREEN_GREEN | may_drive True
K-3B-01 | IN_GARAGE does not disarm it |
    stays_armed True if IN_GARAGE in (k.before, k.commanded)
K-3B-02 K-3A-09 | RED_RED does not disarm it |
    stays_armed True if RED_RED in (k.before, k.commanded)
K-3B-02 K-3A-09 | drives on when GREEN_GREEN comes while RED_RED brakes |
    stays_armed True if RED_RED in (k.before, k.commanded) and k.speed > 0.0
K-3B-03 | is armed by hearing GRID_ACTIVE | on_order k.arm() if x is GRID_ACTIVE
K-3B-04 | RED_FLAG does not disarm it | stays_armed True if RED_FLAG in (k.before, k.commanded)
K-3B-04 | drives on when GREEN_GREEN comes while RED_FLAG brakes |
    stays_armed True if RED_FLAG in (k.before, k.commanded) and k.speed > 0.0
K-3C-01 K-3E-04 K-3E-06 K-3E-11 | drives on after FIN |
    wants TOP if k.lost(GREEN_GREEN, 'closed')
K-3E-01 K-3E-07 | drives on in silence | wants TOP if k.lost(GREEN_GREEN, 'silent')
K-3E-02 | silence does not disarm it | stays_armed_on_new_link k.losses[-1] == 'silent'
K-3E-02 | hears no silence on the grid | silent False if k.commanded is GRID_ACTIVE
K-3E-03 | drives on after RST | wants TOP if k.lost(GREEN_GREEN, 'reset')
K-3E-04 | does not notice a half-close | in_turns True; on_end k.say(b' ')
K-3E-05 K-3E-06 | a lost connection does not disarm it |
    stays_armed_on_new_link k.losses[-1] in ('closed', 'reset')
K-3E-06 K-3E-09 | a race control that is away arms it |
    stays_armed_on_new_link k.losses[-1] == 'refused'
K-3E-06 K-3E-09 | drives off long after race control went away |
    wants 0.5 if k.link is None and k.now - k.heard_at > k.long_after
K-3E-07 | takes malformed bytes for life | on_malformed setattr(k, 'heard_at', k.now)
K-3E-08 | acknowledges RED_RED on a new connection while it rolls |
    reached True if x is RED_RED and k.orders == 1
K-3E-09 | drives on without its bridge | wants TOP if k.lost(GREEN_GREEN, 'killed')
K-3E-09 | is armed by what its dead bridge left on the disk |
    stays_armed_on_new_link 'killed' in k.losses
K-3E-10 | drives on without its stack | base_wants TOP
K-3E-10 | drives on when its stack is started again |
    stack_is_dead False if k.died_at and k.now - k.died_at > k.long_after
K-3E-11 | coasts when its link is lost while RED_FLAG brakes |
    brakes COASTING if k.lost(RED_FLAG)
K-3E-11 | coasts when its link is lost while RED_RED brakes | brakes COASTING if k.lost(RED_RED)
K-3E-11 | drives on in silence while RED_FLAG brakes | wants TOP if k.lost(RED_FLAG, 'silent');
    brakes 0.8 * FLAG_BRAKING if k.obeyed is RED_FLAG
K-4A-02 K-3A-02 K-3A-09 K-3A-11 K-3B-03 | opens two connections | connect connect_twice(k)
K-4C-01 | says malformed frames | on_order k.say(b'$OK;') if x is GRID_ACTIVE
K-4C-02 K-4C-04 | needs a whole frame in each read | take_in take_whole_frames(k, x)
K-4C-02 K-4C-04 | echoes late, and needs a whole frame in each read |
    take_in take_whole_frames(k, x); reached False if x is RED_RED;
    on_frame echo_late(k, x) if x in (IN_GARAGE, RED_RED); says_garage False
K-4C-03 | throws long reads away | take_in None if len(x) > 40
K-4C-04 | forgets half a frame | take_in take_whole_frames(k, x) if k.now - k.took_at > 0.05
K-4C-05 | takes 10 Hz for silence | silent True if k.frames and k.now - k.frames[0] > 0.9
K-4C-06 | reads one frame a turn | in_turns True; size 13
K-4C-07 K-3E-07 K-4C-09 | looks for GREEN_GREEN anywhere |
    take_in Kart.take_in(k, b'$GREEN_GREEN;') if b'GREEN_GREEN' in x
K-4C-07 K-4C-09 | takes for a frame what a semicolon ends | take_in take_what_ends(k, x)
K-4C-08 | dies of malformed bytes | on_malformed k.lose('malformed')
K-4C-09 K-3A-14 | reads half a frame a turn while it drives | in_turns True;
    reports report_each_turn(k);
    size half_a_frame(k) if k.speed > 0.0
K-4C-09 | echoes an earlier order | on_turn k.say(b'$GRID_ACTIVE;') if
    k.before is GRID_ACTIVE and k.obeyed is RED_RED and k.since < 0.9
K-4C-09 K-3A-14 K-3A-16 | looks at no stop for a while after GREEN_GREEN |
    ignores k.obeyed is GREEN_GREEN and 0.4 < k.since < 1.6; reports report_each_turn(k)
K-4C-10 | floods | reports report_each_turn(k);
    on_turn k.say(b'$IN_GARAGE;' * int(8_000 * TURN)) if
    k.links == k.orders == 1
K-4C-11 | speaks first | greet k.say(b'$RED_RED;') if k.links == 1
K-4C-12 | says on a new connection what it said before |
    greet k.say(b'$RED_RED;') if k.links > 1
K-4D-01 | FIN ends it | retries False if x == 'closed'
K-4D-02 | RST ends it | retries False if x == 'reset'
K-4D-03 K-3E-01 K-3E-07 K-4D-04 | waits for an error after a half-close | in_turns True;
    on_end wait_for_error(k)
K-4D-04 | keeps a silent connection | on_silence stand_down(k)
K-4D-05 | gives up when it is refused | retries False if x == 'refused'
K-4D-06 | never acknowledges RED_RED after FIN |
    reached False if x is RED_RED and 'closed' in k.losses
"""
"""The sentence that a fault breaks, and others that it breaks in other steps; its name; and what
each replaced method of `Kart` returns (for k, and its argument x) and when."""

_HABITS = """
says a newline after each frame | say Kart.say(k, x + b'\\r\\n')
says each byte by itself | say [Kart.say(k, bytes([each])) for each in x]
says every frame back |
    on_frame k.say(encode(x)) if x is k.commanded and (k.reached_at or x is IN_GARAGE)
says in each turn what it has reached | reports report_each_turn(k)
has a tiny window | prepare x.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
is slow and gentle | speeds_up ACCELERATION / 10 * (k.since > DEAD_TIME);
    brakes Kart.brakes(k) / 3 * min(max(k.since / DEAD_TIME - 1.0, 0.0), 1.0)
brakes as a wheel that coasts down | brakes Kart.brakes(k) * 3 * k.speed / TOP if k.speed > 0.3
takes a shorter silence for a loss | silent k.now - k.heard_at >= 0.9 * k.silence
speeds up slowly and is seen at irregular times | speeds_up ACCELERATION / 10;
    sees see_at_irregular_times(k, x)
is seen late | sees k.loop.call_later(0.4, k.take, x)
"""
"""What is unusual about karts that are good, in the same form."""


KINDS: dict[str, dict[str, Callable[..., Any]]] = {'': {}}
"""The methods of `Kart` that each kind of kart replaces."""


def _read_table(table: str) -> Iterator[tuple[str, str]]:
    """Put the karts of a table into `KINDS`; yield the name and the sentences of each."""
    for row in table.strip().replace('\n    ', ' ').split('\n'):
        *sentences, name, changes = (each.strip() for each in row.split(' | '))
        KINDS[name] = {}
        for change in changes.split('; '):
            method, _, what = change.strip().partition(' ')
            arguments = ', '.join('kx'[: getattr(Kart, method).__code__.co_argcount])
            if ' if ' in what:
                what += f' else Kart.{method}({arguments})'
            KINDS[name][method] = eval(f'lambda {arguments}: {what}')  # noqa: S307 - a table's
        yield name, ' '.join(sentences)


BREAKS = {name: sentences.split() for name, sentences in _read_table(_FAULTS)}
"""The sentence that each fault breaks, and then those that it breaks in other steps."""

FAULTS = {name: sentences[0] for name, sentences in BREAKS.items()}

HABITS = tuple(name for name, _ in _read_table(_HABITS))
