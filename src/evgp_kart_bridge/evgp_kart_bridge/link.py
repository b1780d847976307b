# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The link: the kart's end of the TCP connection to race control (§4.A, §4.D).

One thread owns the arbiter, the socket and the time. The arbiter decides what the kart must obey,
and this decision is its verdict. Every input passes through ``_take`` in this thread: frames, the
loss of the connection, deadlines, and what the node passes in (``give``). In the same turn, the
link carries out the arbiter's reaction by sending an acknowledgement, closing the socket or
publishing a verdict.

The same thread publishes the verdict again `REPEAT` times a second, so a thread that hangs falls
silent, and the kart's nodes stop (§3.E).

The time comes from `evgp_protocol.clock`, a clock that cannot be set and runs on during suspend.
After the computer wakes up, the link checks the time within ``1 / REPEAT``, and in any case before
it judges the first frame that arrives. It then finds that the connection was silent for too long.
If the thread was held up for less time, it obeys the frames that waited, but the silence counts
from a time at which none of them had arrived, because race control may have gone since.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
import concurrent.futures
import dataclasses
import errno
import random
import socket
import threading

from evgp_protocol import clock
from evgp_protocol.arbiter import Arbiter, Reaction, Verdict
from evgp_protocol.frames import encode, FrameDecoder, MalformedFrame, StateFrame
from evgp_protocol.loop import run
from evgp_protocol.states import RaceState

REPEAT = 10.0
"""Rate at which the link publishes the verdict again, in Hz."""

CONNECT_TIMEOUT = 2.0
"""Maximum duration of an attempt to connect, in seconds."""

FIRST_WAIT = 0.1
"""Maximum time before the second attempt to connect, in seconds. It doubles with each attempt."""

LAST_WAIT = 2.0
"""Maximum time before any attempt to connect, in seconds."""

TURN = 0.02
"""Time between two turns of the loop, by which the link knows how old a frame may be, in
seconds."""

LINK_END_TIMEOUT = 2.0
"""Maximum time to wait until the thread has ended, in seconds."""

READ_BYTES = 4096
"""Maximum number of bytes read in one turn. The kart obeys the last frame in them. Race control
takes 15 s to send more than this, but a kart that reads no frame for 1 s loses the connection."""

SEND_BYTES = 4096
"""Size of the kernel's send buffer, in bytes. The buffer is small, so that the link soon notices
when race control does not read the kart's replies."""

MOST_UNSENT = 256
"""Maximum number of bytes that may wait because the kernel's buffer is full. If more wait, the
link assumes that race control does not read the kart's replies."""

Publish = Callable[[Verdict, 'LinkStatus'], None]
Input = Callable[[Arbiter, float], Reaction]


@dataclasses.dataclass(frozen=True)
class LinkSettings:
    """
    Where to connect to race control.

    :ivar host: race control's IPv4 address.
    :ivar port: race control's TCP port, from 1 to 65535.
    :ivar local_address: the IPv4 address to connect from. If it is empty, the system chooses.
    """

    host: str
    port: int
    local_address: str = ''


@dataclasses.dataclass
class LinkStatus:
    """
    The link's figures for diagnostics. Only the link's thread uses them.

    :ivar connections: number of connections so far.
    :ivar failures: number of connections and of attempts to connect that have failed so far.
    :ivar heard_anything: whether race control has sent a race state to this process.
    :ivar malformed: number of malformed frames so far (§4.C).
    :ivar last_malformed: what was wrong with the last malformed frame, if there was one.
    """

    connections: int = 0
    failures: int = 0
    heard_anything: bool = False
    malformed: int = 0
    last_malformed: str = ''


class LinkClosedError(RuntimeError):
    """The link has ended and accepts no more inputs."""


class RaceControlLink:
    """
    Owns an arbiter, and keeps it connected to race control in a thread of its own.

    :param arbiter: the arbiter. From now on, only the link may change it.
    :param settings: where to connect.
    :param publish: called in the thread with every new verdict, and `REPEAT` times a second. It
        must not wait for anything.
    :param on_failure: called in the thread if the link cannot continue. The link then publishes
        nothing more.
    """

    def __init__(
        self,
        arbiter: Arbiter,
        settings: LinkSettings,
        publish: Publish,
        on_failure: Callable[[BaseException], None],
    ) -> None:
        self._arbiter = arbiter
        self._settings = settings
        self._publish = publish
        self._on_failure = on_failure
        self._published: Verdict | None = None
        self._status = LinkStatus()
        self._connection: _Connection | None = None
        self._timer: asyncio.TimerHandle | None = None
        # The last two turns of the loop. What is read now arrived after the first of them:
        # otherwise, the loop would have read it before the second.
        self._turn = self._turn_before = clock.now()
        self._thread = threading.Thread(target=self._run, name='link', daemon=True)
        self._started = threading.Event()
        # The loop must not end while another thread passes in an input.
        self._running = threading.Lock()
        self._loop: asyncio.AbstractEventLoop | None = None

    def start(self) -> None:
        """Begin to publish verdicts and to connect."""
        self._thread.start()
        self._started.wait()

    def stop(self) -> None:
        """Close the connection and wait up to `LINK_END_TIMEOUT` for the thread to end."""
        with self._running:
            if self._loop is not None:
                self._loop.call_soon_threadsafe(self._end, None)
        if self._thread.ident is not None:
            self._thread.join(LINK_END_TIMEOUT)

    def give(self, take: Input) -> concurrent.futures.Future[Reaction]:
        """
        Pass an input to the arbiter. Any thread may call this.

        :param take: a function that receives the arbiter and the current time (in seconds), and
            returns the reaction.
        :return: a future for the reaction. It raises LinkClosedError if the link has ended.
        """
        future: concurrent.futures.Future[Reaction] = concurrent.futures.Future()

        def give() -> None:
            try:
                future.set_result(self._take(take))
            except BaseException as error:
                future.set_exception(error)
                raise

        with self._running:
            if self._loop is None:
                future.set_exception(LinkClosedError('the bridge is not running'))
            else:
                self._loop.call_soon_threadsafe(give)
        return future

    # ----- the thread ---------------------------------------------------------------------

    def _run(self) -> None:
        try:
            run(self._serve())
        except BaseException as error:  # noqa: BLE001 - passed to the owner of the process
            self._on_failure(error)
        finally:
            self._started.set()

    async def _serve(self) -> None:
        loop = asyncio.get_running_loop()
        self._ending: asyncio.Future[None] = loop.create_future()
        # Any exception ends the link, because an input may then be only half processed.
        loop.set_exception_handler(
            lambda _, context: self._end(context.get('exception') or RuntimeError(context))
        )
        tasks = [
            loop.create_task(each())
            for each in (self._count_turns, self._repeat, self._keep_connected)
        ]
        for task in tasks:
            task.add_done_callback(lambda task: task.cancelled() or self._end(task.exception()))
        with self._running:
            self._loop = loop
        self._started.set()
        try:
            await self._ending
        finally:
            with self._running:
                self._loop = None
            await asyncio.sleep(0)  # process earlier inputs first
            for task in tasks:
                task.cancel()
            connection, self._connection = self._connection, None
            if connection is not None:
                connection.abort()

    def _end(self, error: BaseException | None) -> None:
        if self._ending.done():
            return
        if error is None:
            self._ending.set_result(None)
        else:
            self._ending.set_exception(error)

    def _take(self, take: Input) -> Reaction:
        """Pass an input to the arbiter, carry out its reaction, and publish a new verdict."""
        reaction = self._give(take)
        self._publish_news()
        return reaction

    def _give(self, take: Input) -> Reaction:
        """Pass an input to the arbiter and carry out its reaction, but do not publish yet."""
        loop = asyncio.get_running_loop()
        reaction = take(self._arbiter, loop.time())
        connection = self._connection
        if reaction.give_up is not None and connection is not None:
            self._connection = None
            self._status.failures += 1
            connection.abort()
        elif reaction.send is not None and connection is not None:
            connection.send(reaction.send)
        due = self._arbiter.deadline
        if due is not None and (self._timer is None or due < self._timer.when()):
            if self._timer is not None:
                self._timer.cancel()
            self._timer = loop.call_at(due, self._tick)
        return reaction

    def _tick(self) -> None:
        self._timer = None
        self._take(Arbiter.tick)

    def _publish_news(self, repeat: bool = False) -> None:
        verdict = self._arbiter.verdict
        if repeat or verdict != self._published:
            self._published = verdict
            self._publish(verdict, self._status)

    async def _count_turns(self) -> None:
        while True:
            self._turn_before, self._turn = self._turn, clock.now()
            await asyncio.sleep(TURN)

    async def _repeat(self) -> None:
        while True:
            self._give(Arbiter.tick)
            self._publish_news(repeat=True)
            await asyncio.sleep(1 / REPEAT)

    # ----- the connection -----------------------------------------------------------------

    async def _keep_connected(self) -> None:
        settings = self._settings
        wait = FIRST_WAIT
        while True:
            connection = _Connection(self)
            try:
                await asyncio.wait_for(
                    asyncio.get_running_loop().create_connection(
                        lambda connection=connection: connection,
                        settings.host,
                        settings.port,
                        family=socket.AF_INET,
                        local_addr=(settings.local_address, 0) if settings.local_address else None,
                    ),
                    CONNECT_TIMEOUT,
                )
            except (asyncio.TimeoutError, OSError) as error:
                connection.abort()
                reason = why_not_connected(settings, error)
                self._status.failures += 1
                self._take(lambda arbiter, now, why=reason: arbiter.disconnected(why, now))
            else:
                await connection.lost
                if connection.heard_anything:
                    wait = FIRST_WAIT
            # Wait for a random time, so that karts that lost the same race control do not all
            # reconnect at once.
            await asyncio.sleep(wait * random.uniform(0.5, 1.0))  # noqa: S311 - no secret
            wait = min(2 * wait, LAST_WAIT)

    def opened(self, connection: _Connection) -> None:
        self._connection = connection
        self._status.connections += 1
        self._take(Arbiter.connected)

    def heard(
        self, connection: _Connection, events: Iterable[StateFrame | MalformedFrame]
    ) -> None:
        """Process everything that has arrived and publish only the last verdict."""
        for event in events:
            if connection is not self._connection:
                break  # the link has given up on this connection, so the rest is too late
            self._hear(connection, event)
        self._publish_news()

    def _hear(self, connection: _Connection, event: StateFrame | MalformedFrame) -> None:
        if isinstance(event, StateFrame):
            self._status.heard_anything = connection.heard_anything = True
            before = self._arbiter.verdict.order
            verdict = self._give(
                lambda arbiter, now: arbiter.heard(event.state, now, self._turn_before)
            ).verdict
            if verdict.commanded is RaceState.IN_GARAGE and verdict.order != before:
                # Acknowledge at once, because the kart need not do anything first. The reply shows
                # race control that later replies do not answer earlier commands.
                connection.send(RaceState.IN_GARAGE)
        else:
            self._status.malformed += 1
            self._status.last_malformed = f'{event.reason}: {event.raw!r}'

    def why_closed(self, connection: _Connection, error: Exception | None) -> str:
        """Return how race control ended a connection, and what to check, for messages."""
        peer = peer_of(self._settings)
        if connection.heard_anything:
            if error is not None:
                return f'the connection to {peer} broke: {error}'
            return f'{peer} closed the connection'
        why = f'{peer} closed the connection from {connection.local_address} at once'
        if self._status.heard_anything:
            return why
        why += ': is that address in its roster?'
        if not self._settings.local_address:
            why += ' If this computer has several addresses, set local_address'
        return why

    def lost(self, connection: _Connection, reason: str) -> None:
        if connection is self._connection:
            self._connection = None
            self._status.failures += 1
            self._take(lambda arbiter, now: arbiter.disconnected(reason, now))


class _Connection(asyncio.BufferedProtocol):
    """One connection to race control, or an attempt to make one."""

    def __init__(self, link: RaceControlLink) -> None:
        self._link = link
        self._transport: asyncio.Transport | None = None
        self._decoder = FrameDecoder()
        self._buffer = bytearray(READ_BYTES)
        self.heard_anything = False
        self.local_address = 'this computer'
        self.lost: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def send(self, state: RaceState) -> None:
        """Reply that the kart has reached a state."""
        assert self._transport is not None
        self._transport.write(encode(state))
        if self._transport.get_write_buffer_size() > MOST_UNSENT:
            self._link.lost(self, "race control does not read the kart's replies")
            self.abort()

    def abort(self) -> None:
        """End the connection now and discard unsent bytes."""
        if self._transport is not None:
            self._transport.abort()

    # asyncio calls the following methods.

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self.local_address = transport.get_extra_info('sockname', (self.local_address,))[0]
        transport.get_extra_info('socket').setsockopt(
            socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BYTES
        )
        self._link.opened(self)

    def get_buffer(self, sizehint: int) -> bytearray:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        self._link.heard(self, self._decoder.feed(memoryview(self._buffer)[:nbytes]))

    def connection_lost(self, exc: Exception | None) -> None:
        self._link.lost(self, self._link.why_closed(self, exc))
        if not self.lost.done():
            self.lost.set_result(None)


def peer_of(settings: LinkSettings) -> str:
    """Return race control's address and port, for messages."""
    return f'{settings.host}, port {settings.port}'


def why_not_connected(settings: LinkSettings, error: BaseException) -> str:
    """Return why an attempt to connect failed, and what to check, for messages."""
    peer = f'{peer_of(settings)},'
    number = error.errno if isinstance(error, OSError) else None
    if number == errno.EADDRNOTAVAIL and settings.local_address:
        return f'this machine has no address {settings.local_address}: check local_address'
    if number == errno.ECONNREFUSED:
        why = 'is race control running, and are address and port right?'
        return f'{peer} refuses the connection: {why}'
    if number in (errno.ENETUNREACH, errno.EHOSTUNREACH):
        return f"{settings.host} cannot be reached: is the kart on race control's network?"
    if number is None or number == errno.ETIMEDOUT:
        return f"{peer} does not answer: is the kart on race control's network?"
    return f'connecting to {peer_of(settings)} failed: {error}'
