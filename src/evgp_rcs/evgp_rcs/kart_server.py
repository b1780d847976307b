"""
The kart server: the TCP side of race control, and the one owner of the race (§4.A, §4.C, §4.D).

Rules of what lives in this file:

- One thread, one asyncio loop. The race, the sockets and everything below are touched by that
  thread alone; other threads reach it through ``submit`` and are reached through two callbacks.
- No ROS, no disk, no log. What happened leaves as events, what there is to see as a copy of the
  race; whoever takes them works on them in a thread of its own.
- A command is judged and its frames are written to every socket in one go, without an await in
  between: nothing else runs between an official's stop and its bytes.
- Every peer is bounded: bytes read per beat, bytes waiting to be written, events told.
"""

from __future__ import annotations

import array
import asyncio
from collections import deque
from collections.abc import Callable, Iterable, Mapping
import concurrent.futures
from dataclasses import dataclass
import fcntl
import itertools
import socket
import termios
import threading
import time

from evgp_protocol.frames import encode, FrameDecoder, MalformedFrame, StateFrame
from evgp_protocol.states import RaceState
from evgp_rcs.race import (
    Answer,
    Command,
    CommandKind,
    Event,
    EventKind,
    Outcome,
    Race,
    StampedEvent,
    STOPS,
)

READ_BYTES = 4096
"""What is read of one kart per beat, bytes. A kart says some 15 bytes a beat at most."""

FLOOD_BEATS = 40
"""A kart that says more than `READ_BYTES` in each of so many beats in a row is dropped."""

DEAF_BEATS = 20
"""For so many beats after a flood, what a kart says is no acknowledgement."""

UNSENT_BYTES = 4096
"""What may wait for one kart that does not read before it is dropped, bytes."""

HELD_UP = 1.0
"""A beat that comes later than this, s: officials and karts have waited for race control."""

PAUSE_AFTER_HELD_UP = 5.0
"""So long after that nothing is taken that loosens or starts anything, s. What officials sent
meanwhile comes late: up to 3 s were seen, where DDS had to introduce the two ends first."""

WAITING = frozenset(
    {
        CommandKind.GRID_ACTIVE,
        CommandKind.GREEN_GREEN,
        CommandKind.IN_GARAGE,
        CommandKind.KART_IN_GARAGE,
    }
)
"""The commands that are not taken during a pause: those that loosen or start something."""

TCP_THIN_LINEAR_TIMEOUTS = 16
"""An option of Linux (since 2.6.34) that Python does not name."""

CONNECTIONS = (10, 2.0)
"""How often a kart may connect: so many times at once, and then so often a second."""

COPY_PER_KART = 0.0002
"""The least time between two copies of the race, for each of its karts, s. Whoever takes one of a
thousand karts has 40 ms of work with it."""

MOST_WAITED = 0.2
"""So long in all does a piece of work wait for frames that go to the karts, s."""

FRAMES = {state: encode(state) for state in RaceState}


class KartServerError(RuntimeError):
    """The kart server cannot start; the text says why and what would be right."""


@dataclass(frozen=True)
class ServerSettings:
    """
    How the kart server listens and sends.

    :param host: the address to listen at; an empty one is every address of the machine.
    :param port: the TCP port; 0 lets the system choose one (for tests).
    :param beat_rate: frames per second to each kart; §4.C wants at least 10 Hz.
    :param send_timeout: how long a kart may leave bytes unanswered before it counts as lost, s.
    :param pause: after a stop, for how long no command that loosens or starts anything is
        taken, s; after race control was held up, at least `PAUSE_AFTER_HELD_UP`.
    :param copy_interval: the least time between two copies of the race handed out, s; it is
        longer with many karts, by `COPY_PER_KART`.
    :param copy_at_least: the most time between two copies, even if nothing changed, s.
    """

    host: str = ''
    port: int = 12017
    beat_rate: float = 20.0
    send_timeout: float = 1.0
    pause: float = 1.0
    copy_interval: float = 0.05
    copy_at_least: float = 0.5


@dataclass(frozen=True)
class _Waiting:
    """A command that was not judged yet, and when it came (s)."""

    command: Command
    answer: concurrent.futures.Future[Answer]
    came: float


class _Allowance:
    """So many times at once, and then so often a second: what a peer may cause."""

    def __init__(self, burst: int, rate: float = 1.0) -> None:
        self._burst = burst
        self._rate = rate
        self._left = float(burst)
        self._at = 0.0
        self.withheld = 0

    def take(self, now: float) -> bool:
        self._left = min(self._burst, self._left + self._rate * (now - self._at))
        self._at = now
        if self._left < 1:
            self.withheld += 1
            return False
        self._left -= 1
        return True

    def mention(self) -> str:
        """Return how many were withheld since the last mention, as the end of a sentence."""
        withheld, self.withheld = self.withheld, 0
        return f' ({withheld} more were not told)' if withheld else ''


class _KartLink(asyncio.BufferedProtocol):
    """One connection of one kart: bytes in, frames out."""

    def __init__(self, server: KartServer) -> None:
        self._server = server
        self._buffer = bytearray(READ_BYTES)
        self._decoder = FrameDecoder(ready_is_grid_active=True)
        self._transport: asyncio.Transport | None = None
        self._socket: socket.socket | None = None
        self._read_this_beat = 0
        self._paused = False
        self._throttled_beats = 0
        self._open_beats = DEAF_BEATS
        # Bytes that arrived before the present order: what they say cannot be about it.
        self._unprocessed = 0
        self._stale = 0
        self._stale_frame = False
        # How many bytes were written; how many of them were answered, and when that last grew.
        self._written = 0
        self._answered = 0
        self._answered_at = 0.0
        self._ask_at = 0.0
        self._send_timeout = 0.0
        self.number = 0
        self.serial = 0
        self.frame = b''
        self.frames_sent = 0
        self.reason = 'the connection ended'

    # ----- asyncio's side -----------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._socket = transport.get_extra_info('socket')
        self._server.link_made(self, transport.get_extra_info('peername'))

    def set_up(self, settings: ServerSettings) -> None:
        """Make the socket prompt: no Nagle, little in flight, and a vanished kart noticed."""
        assert self._socket is not None
        self._send_timeout = settings.send_timeout
        self._answered_at = time.monotonic()
        option = self._socket.setsockopt
        option(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            # It does not take lost packets for a sign to send less. With the usual ones, where
            # 5 % are lost a kart hears nothing for a second every twenty minutes.
            option(socket.IPPROTO_TCP, socket.TCP_CONGESTION, b'bbr')
        except OSError:
            pass  # this kernel does not have it, or not for everyone
        # What was lost is sent again at an even pace (where it is not bbr that decides). With
        # ever longer waits, a link that fails for half a second is silent for more than one.
        option(socket.IPPROTO_TCP, TCP_THIN_LINEAR_TIMEOUTS, 1)
        # Only for the case that `_is_unanswered` is not asked: the kernel counts from when it
        # first had to send anything again, even if that has been answered since.
        option(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, int(3 * settings.send_timeout * 1000))
        option(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        option(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 1)
        option(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 1)
        # A kart that reads late must not find seconds of old states before the stop.
        option(socket.SOL_SOCKET, socket.SO_SNDBUF, 2048)

    def get_buffer(self, sizehint: int) -> bytearray:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        self._unprocessed = nbytes
        self._server.take_commands()
        stale = min(self._stale, nbytes)
        view = memoryview(self._buffer)
        if stale:
            self._stale -= stale
            self._hear(view[:stale], 0)
            self._stale_frame = self._decoder.in_frame
        self._unprocessed = 0
        # Of what a flood has left at the kart's end nobody knows when it was said.
        self._hear(view[stale:nbytes], self.serial if self._open_beats >= DEAF_BEATS else 0)
        self._read_this_beat += nbytes
        if self._read_this_beat >= READ_BYTES and self._transport is not None:
            self._paused = True
            self._transport.pause_reading()

    def _hear(self, data: memoryview, serial: int) -> None:
        for heard in self._decoder.feed(data):
            if serial and self._stale_frame:
                # It began before the order: its beginning lies in what was stale.
                self._stale_frame = False
                self._server.link_heard(self, heard, 0)
            else:
                self._server.link_heard(self, heard, serial)

    def eof_received(self) -> bool:
        # At once, whatever waits to be written: a kart that closed hears nothing any more.
        self.drop('the kart closed the connection')
        return False

    def connection_lost(self, exc: Exception | None) -> None:
        if exc is not None:
            self.reason = _plain(exc)
        self._transport = None
        self._server.link_lost(self)

    # ----- the server's side --------------------------------------------------------------

    def order(self, frame: bytes, serial: int) -> None:
        """Send a new state at once; what has arrived by now is no answer to it."""
        self._stale = self._unprocessed + self._unread()
        self._stale_frame = self._decoder.in_frame
        self.serial = serial
        self.frame = frame
        self._write()

    def beat(self) -> None:
        """Send the state again, unless the kart has not taken the last one yet."""
        self._read_this_beat = 0
        if self._transport is None:
            return
        if self._is_unanswered():
            self.drop('it left what it was sent unanswered')
            return
        if self._paused:
            self._paused = False
            self._open_beats = 0
            self._throttled_beats += 1
            if self._throttled_beats > FLOOD_BEATS:
                self.drop('the kart floods race control')
                return
            self._transport.resume_reading()
        else:
            self._throttled_beats = 0
            self._open_beats = min(self._open_beats + 1, DEAF_BEATS)
        if not self._transport.get_write_buffer_size():
            self._write()

    def drop(self, reason: str) -> None:
        """Give the connection up now; what waits to be written is thrown away."""
        self.reason = reason
        if self._transport is not None:
            self._transport.abort()

    def farewell(self) -> None:
        """Send RED_RED and close: race control is going away."""
        if self._transport is not None:
            self._transport.write(FRAMES[RaceState.RED_RED])
            self._transport.close()

    def _write(self) -> None:
        if self._transport is None:
            return
        self._transport.write(self.frame)
        self.frames_sent += 1
        self._written += len(self.frame)
        if self._transport.get_write_buffer_size() > UNSENT_BYTES:
            self.drop('the kart does not read what it is sent')

    def _is_unanswered(self) -> bool:
        """Return whether the kart has answered nothing of what it was sent for too long (§4.D)."""
        now = time.monotonic()
        if self._transport is None or now < self._ask_at:
            return False
        self._ask_at = now + self._send_timeout / 8  # to ask the kernel at every beat is too dear
        unanswered = self._transport.get_write_buffer_size() + self._in_kernel(termios.TIOCOUTQ)
        answered = self._written - unanswered
        if not unanswered or answered > self._answered:
            self._answered = answered
            self._answered_at = now
        return now - self._answered_at >= self._send_timeout

    def _unread(self) -> int:
        """Return how many bytes lie in the kernel, read by nobody yet."""
        return self._in_kernel(termios.FIONREAD)

    def _in_kernel(self, which: int) -> int:
        if self._socket is None or self._transport is None:
            return 0
        count = array.array('i', [0])
        fcntl.ioctl(self._socket.fileno(), which, count)
        return count[0]


class KartServer:
    """
    The karts' sockets and the race, in one thread of their own.

    :param race: the race; from ``start`` on it belongs to this server's thread.
    :param addresses: the roster's IPv4 addresses and the kart number of each (§4.A).
    :param settings: how to listen and send.
    :param on_events: takes the events, in order, in the server's thread: it must only hand
        them on.
    :param on_copy: takes a copy of the race and the time (s) it was taken, likewise.
    :param on_failure: takes the error that ended the server after it had started; by then every
        kart has been sent RED_RED and is disconnected.
    :param first_events: what happened before, to be told first.
    """

    def __init__(
        self,
        race: Race,
        addresses: Mapping[str, int],
        settings: ServerSettings,
        on_events: Callable[[list[StampedEvent]], None],
        on_copy: Callable[[Race, float], None],
        on_failure: Callable[[BaseException], None],
        first_events: Iterable[Event] = (),
    ) -> None:
        """Take note of everything; nothing is opened before ``start``."""
        self._race = race
        self._addresses = dict(addresses)
        self._settings = settings
        self._on_events = on_events
        self._on_copy = on_copy
        self._on_failure = on_failure
        self._first_events = tuple(first_events)
        self._links: dict[int, _KartLink] = {}
        self._stops: deque[_Waiting] = deque()
        self._commands: deque[_Waiting] = deque()
        self._sequence = itertools.count(1)
        self._refusals = _Allowance(5)
        self._connections = {number: _Allowance(*CONNECTIONS) for number in race.karts}
        self._too_often = {number: _Allowance(1) for number in race.karts}
        self._rubbish = {number: _Allowance(5) for number in race.karts}
        self._reports = {number: _Allowance(20) for number in race.karts}
        self._paused_until = 0.0
        self._paused_by = ''
        self._beat_at = 0.0
        self._copied_at = 0.0
        self._copy_interval = max(settings.copy_interval, COPY_PER_KART * len(race.karts))
        self._copy_asked = False
        self._loop: asyncio.AbstractEventLoop | None = None
        self._closing: asyncio.Event | None = None
        self._listening: concurrent.futures.Future[tuple[str, int]] = concurrent.futures.Future()
        self._thread = threading.Thread(target=self._run, name='kart_server', daemon=True)
        self._failure: BaseException | None = None
        self.address = ('', 0)
        self.calm = threading.Event()
        """Not set while a stop or a beat is on its way to the karts: whoever has work that can
        wait waits for it, see ``courtesy``. Else each write hands them the interpreter."""
        self.calm.set()

    # ----- for other threads --------------------------------------------------------------

    def start(self) -> None:
        """
        Listen, and return once karts can connect.

        :raises KartServerError: if the address cannot be listened at.
        """
        self._thread.start()
        try:
            self.address = self._listening.result()
        except OSError as error:
            where = f'{self._settings.host or "any address"}, port {self._settings.port}'
            raise KartServerError(
                f'race control cannot listen for karts at {where}: {_plain(error)}; '
                'stop the program that has the port, or choose another address or port'
            ) from error

    def submit(
        self, command: Command, came: float | None = None
    ) -> concurrent.futures.Future[Answer]:
        """
        Hand over an official's command; stops are taken before anything else that waits.

        :param came: when it came (monotonic, s), if that was before.
        :returns: a future with the answer, done once every frame has been written.
        :raises KartServerError: if the server is not running: then only the MSR is left.
        """
        answer: concurrent.futures.Future[Answer] = concurrent.futures.Future()
        waiting = _Waiting(command, answer, time.monotonic() if came is None else came)
        if command.kind in STOPS:
            self.calm.clear()
            self._stops.append(waiting)
        else:
            self._commands.append(waiting)
        self._call(self.take_commands)
        return answer

    def report(self, event: Event) -> None:
        """
        Have something told among the events, in order with them.

        :raises KartServerError: if the server is not running.
        """
        self._call(lambda: self._tell([event]))

    def copy(self) -> concurrent.futures.Future[tuple[Race, float]]:
        """
        Return a copy of the race with its time (s), as soon as the server comes to it.

        :raises KartServerError: if the server is not running.
        """
        future: concurrent.futures.Future[tuple[Race, float]] = concurrent.futures.Future()
        self._call(lambda: future.set_result((self._race.copy(), self._now())))
        return future

    def courtesy(self) -> Callable[[], None]:
        """
        Return what a piece of work calls between its parts, in whatever thread.

        It waits while frames are on their way to the karts, `MOST_WAITED` in all its calls.
        """
        left = MOST_WAITED

        def give_way() -> None:
            nonlocal left
            if left > 0 and not self.calm.is_set():
                began = time.monotonic()
                self.calm.wait(left)
                left -= time.monotonic() - began

        return give_way

    def _call(self, work: Callable[[], object]) -> None:
        try:
            assert self._loop is not None, 'nothing can be asked for before start'
            self._loop.call_soon_threadsafe(work)
        except RuntimeError as error:
            self.calm.set()
            raise KartServerError('the kart server is not running: use the MSR') from error

    def stop(self) -> None:
        """Send every kart RED_RED, close every connection, and return when that is done."""
        if self._loop is not None and self._closing is not None and self._thread.is_alive():
            closing = self._closing
            try:
                self._loop.call_soon_threadsafe(closing.set)
            except RuntimeError:  # the loop ended by itself between the question and the call
                return
        if self._thread.ident is not None:
            self._thread.join()

    # ----- the loop -----------------------------------------------------------------------

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except BaseException as error:  # noqa: BLE001 - handed to whoever owns the process
            if self._listening.done():
                self._on_failure(error)
            else:
                self._listening.set_exception(error)
        finally:
            # Again: until the loop was closed, something could still be handed over.
            self._refuse_the_rest()

    async def _serve(self) -> None:
        self._loop = loop = asyncio.get_running_loop()
        self._closing = asyncio.Event()
        loop.set_exception_handler(self._fail)
        server = await loop.create_server(
            lambda: _KartLink(self),
            self._settings.host or None,
            self._settings.port,
            family=socket.AF_INET,
            backlog=128,
            reuse_address=True,
        )
        self._tell(self._first_events)
        self._beat_at = loop.time()
        loop.call_soon(self._beat, loop.time())
        try:
            self._listening.set_result(server.sockets[0].getsockname()[:2])
            await self._closing.wait()
        finally:
            server.close()
            for link in list(self._links.values()):
                link.farewell()
            self._refuse_the_rest()
        if self._failure is not None:
            raise self._failure
        # One turn of the loop, so that closed transports let go of their sockets.
        await asyncio.sleep(0)

    def _fail(self, loop: asyncio.AbstractEventLoop, context: dict[str, object]) -> None:
        """Stop everything on an error nobody foresaw: the karts see RED_RED, then the end."""
        error = context.get('exception')
        if isinstance(error, OSError) and str(context.get('message')).startswith('socket.accept'):
            # Out of file descriptors: asyncio tries again in a second, the race goes on.
            if self._refusals.take(self._now()):
                text = f'No further connection can be taken now: {_plain(error)}'
                self._tell([Event(EventKind.REFUSED_CONNECTION, text, success=False)])
            return
        if self._failure is None:
            self._failure = (
                error
                if isinstance(error, BaseException)
                else RuntimeError(str(context.get('message')))
            )
        assert self._closing is not None
        self._closing.set()

    def _refuse_the_rest(self) -> None:
        answer = Answer(False, 'Race control is stopping; if a kart still moves, use the MSR.')
        for queue in (self._stops, self._commands):
            while queue:
                future = queue.popleft().answer
                if future.set_running_or_notify_cancel():
                    future.set_result(answer)
        self.calm.set()

    def _beat(self, due: float) -> None:
        assert self._loop is not None
        assert self._closing is not None
        if self._closing.is_set():
            return
        self._notice_delay(self._now())
        self.take_commands()
        now = self._beat_at = self._now()
        self._apply(self._race.tick(now))
        self.calm.clear()
        for link in list(self._links.values()):
            if self._stops:
                self.take_commands()
                self.calm.clear()
            link.beat()
        if not self._stops:
            self.calm.set()
        if now - self._copied_at >= self._settings.copy_at_least:
            self._ask_for_copy()
        period = 1.0 / self._settings.beat_rate
        # A late beat is not made up for: the next one is a whole period away at the most.
        due = max(due + period, self._loop.time())
        self._loop.call_at(due, self._beat, due)

    def take_commands(self) -> None:
        """Judge what officials have sent, stops first; called before any other work."""
        while self._stops or self._commands:
            now = self._now()
            self._notice_delay(now)
            is_stop = bool(self._stops)
            waiting = (self._stops or self._commands).popleft()
            command, future = waiting.command, waiting.answer
            if is_stop:
                self.calm.clear()
                self._pause(now + self._settings.pause, 'a stop was given just now')
            elif not future.set_running_or_notify_cancel():
                continue  # its official has been told that it is not answered
            if command.kind in WAITING and waiting.came < self._paused_until:
                outcome = self._race.refuse(
                    command, f'{self._paused_by}; look at the race, and send it again'
                )
            else:
                outcome = self._race.command(command, now)
            self._apply(outcome)
            if is_stop and not future.set_running_or_notify_cancel():
                continue
            future.set_result(outcome.answer)
        self.calm.set()

    def _pause(self, until: float, why: str) -> None:
        """
        Take nothing that loosens until then, s.

        A release may have been sent before a stop, by an official who had not seen it, and come
        here after it. It must not undo the stop.
        """
        if until > self._paused_until:
            self._paused_until = until
            self._paused_by = why

    def _notice_delay(self, now: float) -> None:
        """Pause if race control was held up: what waits may have been sent long ago."""
        held_up = now - self._beat_at - 1.0 / self._settings.beat_rate
        if held_up > HELD_UP:
            self._beat_at = now
            until = now + max(self._settings.pause, PAUSE_AFTER_HELD_UP)
            self._pause(until, f'race control was held up for {held_up:.1f} s')

    def _apply(self, outcome: Outcome) -> None:
        for order in outcome.orders:
            link = self._links.get(order.kart)
            if link is not None:
                link.order(FRAMES[order.state], order.serial)
        self._tell(outcome.events)

    def _tell(self, events: Iterable[Event]) -> None:
        now = self._now()
        wall = time.time_ns()
        stamped = [
            StampedEvent(next(self._sequence), wall, now, event)
            for event in events
            if event.kind is not EventKind.REPORTED or self._reports[event.kart].take(now)
        ]
        if stamped:
            self._on_events(stamped)
            self._ask_for_copy()

    def _ask_for_copy(self) -> None:
        if not self._copy_asked:
            assert self._loop is not None
            self._copy_asked = True
            delay = self._copied_at + self._copy_interval - self._now()
            self._loop.call_later(max(delay, 0.0), self._copy)

    def _copy(self) -> None:
        self._copy_asked = False
        self._copied_at = self._now()
        self._on_copy(self._race.copy(), self._copied_at)

    def _now(self) -> float:
        assert self._loop is not None
        return self._loop.time()

    # ----- what the links tell ------------------------------------------------------------

    def link_made(self, link: _KartLink, peer: tuple[str, int]) -> None:
        """Take a new connection, or refuse it if its address is not in the roster (§4.A)."""
        number = self._addresses.get(peer[0])
        now = self._now()
        if number is None:
            link.drop('its address is not in the roster')
            if self._refusals.take(now):
                text = (
                    f'A connection from {peer[0]} was refused: no kart of the roster has that '
                    f'address{self._refusals.mention()}'
                )
                self._tell([Event(EventKind.REFUSED_CONNECTION, text, success=False)])
            return
        if not self._connections[number].take(now):
            link.drop('it connects too often')
            allowance = self._too_often[number]
            if allowance.take(now):
                text = (
                    f'A connection of {self._race.karts[number]} was refused: it connects too '
                    f'often{allowance.mention()}'
                )
                event = Event(EventKind.REFUSED_CONNECTION, text, kart=number, success=False)
                self._tell([event])
            return
        old = self._links.pop(number, None)
        if old is not None:
            old.drop('a new connection from its address took its place')
        link.number = number
        link.set_up(self._settings)
        self._links[number] = link
        self._apply(self._race.connected(number, now))

    def link_heard(self, link: _KartLink, heard: StateFrame | MalformedFrame, serial: int) -> None:
        """Take a frame, or what should have been one, from a kart."""
        if self._links.get(link.number) is not link:
            return
        now = self._now()
        if isinstance(heard, MalformedFrame):
            allowance = self._rubbish[link.number]
            if allowance.take(now):
                kart = self._race.karts[link.number]
                text = f'From {kart}: {heard.reason}: {heard.raw!r}{allowance.mention()}'
                self._tell([Event(EventKind.MALFORMED, text, kart=link.number, success=False)])
            return
        self._apply(self._race.heard(link.number, serial, heard.state, now))

    def link_lost(self, link: _KartLink) -> None:
        """Take note that a connection ended; one that was replaced has been told already."""
        if self._links.get(link.number) is link:
            del self._links[link.number]
            self._apply(self._race.disconnected(link.number, link.reason, self._now()))


def _plain(error: BaseException) -> str:
    """Return what an operating system error says, without its number."""
    if isinstance(error, TimeoutError):
        return 'it left what it was sent unanswered'
    if isinstance(error, OSError) and error.strerror:
        return error.strerror.lower()
    return str(error) or type(error).__name__
