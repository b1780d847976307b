# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The kart server owns the race, and communicates with the karts over TCP (§4.A, §4.C, §4.D).

The code in this file follows these rules:

- The server has one thread with one asyncio loop, in a process without ROS (``karts.process``).
  Only that thread touches the race, the sockets or anything defined below.
- The server never uses the disk or a log file. It sends data to the ROS half and the record
  through two socket pairs (``channel``), which never block.
- The server judges a command and writes its frames to every socket without an await in between, so
  nothing else can run between judging an official's stop and writing its frames.
- Every input reaches the rules through ``KartServer._take``, which logs the input so that a replay
  can repeat it.
- The server limits how many bytes it reads from a peer in each beat, how many bytes wait to be
  written to it, and how many events the peer can cause.
"""

from __future__ import annotations

import asyncio
from collections import defaultdict, deque
from collections.abc import Callable
import errno
import itertools
import socket
import time
from typing import Any

from evgp_protocol.frames import MalformedFrame
from evgp_protocol.hearing import Heard
from evgp_rcs.karts.channel import (
    Alive,
    ANSWER_TIMEOUT,
    Answered,
    End,
    Happened,
    KartServerError,
    LocalEnd,
    pack,
    Request,
    ServerSettings,
)
from evgp_rcs.karts.link import KartLink
from evgp_rcs.karts.record_process import RecordProcess
from evgp_rcs.record.run_mark import in_words
from evgp_rcs.rules import inputs
from evgp_rcs.rules.catalogue import CATALOGUE
from evgp_rcs.rules.race import (
    Answer,
    Event,
    EventKind,
    LastRun,
    Outcome,
    Race,
    StampedEvent,
)
from evgp_rcs.rules.snapshot import snapshot_of

STALL = 1.0
"""Maximum delay of a beat, in seconds. If a beat is later than that, race control has stalled."""

CONNECTIONS = (10, 2.0)
"""Limit on new connections from each kart: the size of a burst, and then the number per second."""

MOST_STRANGERS = 20
"""Maximum number of addresses outside the roster whose refusals are reported separately."""

TAKEOVERS = (3, 10.0)
"""Limit on takeovers: the number of times, and the period in seconds. If new connections replace a
kart's live connection this many times within the period, two programs are contesting the kart. The
contest ends after one such period without a takeover."""

CONNECTION_QUEUE = 4096
"""Maximum number of connections that wait to be accepted. The kernel may allow fewer (somaxconn).
A kart that finds the queue full tries again after 1, 3, 7, ... s."""

CONNECTIONS_AT_ONCE = 16
"""Maximum number of connections that the server accepts before it handles a stop or a beat."""

GATHER = 0.005
"""Time for which the server gathers events before it forwards them, in seconds. If a hundred karts
acknowledge at the same time, sending each event separately would keep all processes busy and delay
the answer to the stop that caused the events."""

LEAST_BETWEEN_SNAPSHOTS, MOST_BETWEEN_SNAPSHOTS = 0.05, 0.5
"""Minimum and maximum time between two snapshots of the race, in seconds."""

SHOW_AFTER = 0.01
"""Minimum delay before a snapshot shows an event, in seconds. As with `GATHER`, one snapshot then
covers many events."""

TO_ROS_HALF_BYTES = 64 * 2**20
"""Maximum backlog to the ROS half, in bytes. If it is larger, the server abandons the ROS half."""

ROS_HALF_SILENCE = 1.0
"""Maximum silence of the ROS half, in seconds. After that, the server abandons it."""

FIRST_SIGN = 2.0
"""Additional time for the ROS half's first sign of life, in seconds, because it is still
starting."""

_ENDING = Answer(False, 'Race control is ending. If a kart is still moving, use the MSR.')


class RosHalfGoneError(RuntimeError):
    """
    The ROS half has failed, is gone, or has been silent for longer than `ROS_HALF_SILENCE`.

    :param how: what happened to the ROS half. Officials do not know the term "ROS half", so the
        text calls it the part that hears officials.
    """

    def __init__(self, how: str) -> None:
        super().__init__(f'the part that hears officials {how}')


class _Allowance:
    """A token bucket that limits a peer to a burst, and then to `rate` events per second."""

    def __init__(self, burst: int, rate: float = 1.0) -> None:
        self._burst = burst
        self._rate = rate
        self._left = float(burst)
        self._at = 0.0

    def take(self, now: float) -> bool:
        self._left = min(self._burst, self._left + self._rate * (now - self._at))
        self._at = now
        if self._left < 1:
            return False
        self._left -= 1
        return True


class KartServer:
    """
    The race and the karts' sockets, in the loop that runs when it is created.

    Once ``serve`` is called, only this server may use the race.
    """

    def __init__(
        self,
        race: Race,
        settings: ServerSettings,
        ros_half: LocalEnd,
        record: RecordProcess,
    ) -> None:
        self._race = race
        self._settings = settings
        self._ros_half = ros_half
        self._ros_half_heard_at = 0.0
        self._record = record
        record.on_saved = self._note_saved
        self._log = inputs.Log()
        self._links: dict[int, KartLink] = {}
        self._stops: deque[Request] = deque()
        self._commands: deque[Request] = deque()
        self._sequence = itertools.count(1)
        self._gathered: list[StampedEvent] = []
        # By a kart's number or a stranger's address; '' is for the strangers beyond the limit.
        self._refusals = defaultdict[int | str, _Allowance](lambda: _Allowance(5))
        # The limits of each kart, by its number.
        self._connections = defaultdict[int, _Allowance](lambda: _Allowance(*CONNECTIONS))
        self._takeovers = defaultdict[int, deque[float]](lambda: deque(maxlen=TAKEOVERS[0]))
        self._rubbish = defaultdict[int, _Allowance](lambda: _Allowance(5))
        self._reports = defaultdict[int, _Allowance](lambda: _Allowance(20))
        self._beat_at = 0.0
        self._shown_at = 0.0
        self._showing = False
        self._shown_pause = 0.0
        self._loop = asyncio.get_running_loop()
        self._closing = asyncio.Event()
        self._failure: BaseException | None = None

    # ----- for its owner, in the thread of its loop ---------------------------------------

    async def serve(
        self, left_behind: inputs.Recovered, listening: Callable[[tuple[str, int]], None]
    ) -> LastRun:
        """
        Serve karts until ``end`` is called, and then send every kart RED_RED as its last frame.

        :param listening: called with the address and port once karts can connect.
        :returns: how this run ended, for the next run.
        :raises KartServerError: if the server cannot listen at its address.
        :raises BaseException: the failure that ended the server, after every kart has been sent
            RED_RED.
        """
        loop = self._loop
        loop.set_exception_handler(self._fail)
        recovered = self._feed(left_behind)
        try:
            server = await loop.create_server(
                lambda: KartLink(self, self._settings.beat_rate, self._settings.send_timeout),
                self._settings.host,
                self._settings.port,
                family=socket.AF_INET,
                backlog=CONNECTIONS_AT_ONCE,
            )
            # asyncio uses one number for both limits, so this second call enlarges the queue.
            with server.sockets[0].dup() as taking:
                taking.listen(CONNECTION_QUEUE)
        except OSError as error:
            host, port = self._settings.host, self._settings.port
            # From CPython 3.13 on, asyncio gives no number if this machine lacks the address.
            why = {
                errno.EADDRINUSE: 'another program uses the port, perhaps another race control. '
                'End it',
                errno.EADDRNOTAVAIL: 'this machine does not have that address. Connect its '
                "network, or set the one that it has on the karts' network (make run ADDRESS=...)",
            }.get(error.errno or errno.EADDRNOTAVAIL, in_words(error))
            raise KartServerError(
                f'race control cannot listen for karts at {host}, port {port}: {why}'
            ) from error
        self._publish_outcome(recovered.events, left_behind.at)
        self._beat_at = loop.time()
        self._ros_half_heard_at = loop.time() + FIRST_SIGN
        loop.call_soon(self._beat, loop.time())
        try:
            listening(server.sockets[0].getsockname()[:2])
            await self._closing.wait()
        finally:
            server.close()
            for link in list(self._links.values()):
                link.farewell()
            self._publish(_ended(self._failure), at=self.now())
            self._refuse_the_rest()
            # The next run must also find the changes since the last snapshot.
            self._remember()
            ends_as = self._race.memory().ends_as
        # Give the loop one turn. Closed transports then release their sockets, and the server
        # publishes the disconnections after the end that caused them.
        await asyncio.sleep(0)
        self._flush()
        if self._failure is not None:
            raise self._failure
        return ends_as

    def end(self, failure: BaseException | None = None) -> None:
        """
        Make ``serve`` send every kart RED_RED, close every connection, and return.

        If there is a failure, ``serve`` raises it instead of returning; of several, the first.
        """
        if self._failure is None:
            self._failure = failure
        self._closing.set()

    def now(self) -> float:
        """Return the time, in seconds by the rules' clock."""
        return self._loop.time()

    # ----- the loop -----------------------------------------------------------------------

    def _fail(self, loop: asyncio.AbstractEventLoop, context: dict[str, object]) -> None:
        """Handle an error that the loop reports: send every kart RED_RED and end."""
        error = context.get('exception')
        if isinstance(error, OSError) and str(context.get('message')).startswith('socket.accept'):
            # No file descriptor is left. The race continues, and asyncio tries again in a second.
            text = f'Race control cannot accept another connection now: {in_words(error)}'
            self._publish_refusal(text, '')
            return
        self.end(
            error
            if isinstance(error, BaseException)
            else RuntimeError(str(context.get('message')))
        )

    def _refuse_the_rest(self) -> None:
        for request in (*self._stops, *self._commands):
            self._answer(request, _ENDING)
        self._stops.clear()
        self._commands.clear()

    def _beat(self, due: float) -> None:
        if self._closing.is_set():
            return
        self.take_commands()
        now = self.now()
        self._notice_stall(now)
        self._beat_at = now
        self._check_ros_half(now)
        self._note_record_trouble(now)
        self._take(inputs.Tick(now))
        for kart in [each.number for each in self._race.karts.values() if each.contested]:
            self._check_contest(kart, now)
        for link in list(self._links.values()):
            self.take_commands()
            link.beat()
        if now - self._shown_at >= MOST_BETWEEN_SNAPSHOTS:
            self._ask_to_show()
        period = 1.0 / self._settings.beat_rate
        # The server does not make up for late beats. The next one comes at most one period later.
        due = max(due + period, self._loop.time())
        self._loop.call_at(due, self._beat, due)

    def _check_ros_half(self, now: float) -> None:
        """End if the ROS half is silent, because no official could then stop a kart."""
        silent_for = now - self._ros_half_heard_at
        if silent_for > ROS_HALF_SILENCE:
            self.end(RosHalfGoneError(f'was silent for {silent_for:.1f} s'))

    def take_commands(self) -> None:
        """Process the commands that have arrived, stops first. Called before any other work."""
        for message in self._ros_half.receive():
            self._hear(message)
        if self._ros_half.gone:
            self.end(RosHalfGoneError(f'is gone: {self._ros_half.gone}'))
        while self._stops or self._commands:
            now = self.now()
            self._notice_stall(now)
            request = (self._stops or self._commands).popleft()
            entry = CATALOGUE[request.command.kind]
            if not entry.overtakes and now - request.came > ANSWER_TIMEOUT:
                continue  # its sender has already been told that there is no answer
            if entry.loosens:
                if self._closing.is_set():
                    self._answer(request, _ENDING)
                    continue
                # A race must not start without a record, so check whether the record works now.
                self._note_record_trouble(now)
            self._take(inputs.Commanded(now, request.command, request.came), request)

    def _hear(self, message: Any) -> None:
        """Handle a message from the ROS half. Each one shows that the ROS half accepts stops."""
        self._ros_half_heard_at = self.now()
        if isinstance(message, Request):
            overtakes = CATALOGUE[message.command.kind].overtakes
            (self._stops if overtakes else self._commands).append(message)
        elif isinstance(message, Alive):
            if message.rival != self._race.has_rival:
                self._take(inputs.Rival(self.now(), message.rival))
            if message.there != self._race.there:
                self._take(inputs.Attended(self.now(), message.there))
            if message.cut_off != self._race.cut_off_by:
                self._take(inputs.CutOff(self.now(), message.cut_off))
        elif isinstance(message, End):
            self.end(None if message.in_order else RosHalfGoneError('failed'))
        else:
            raise TypeError(f'the ROS half sent {message!r}')

    def _note_saved(self, gridded: int) -> None:
        """Tell the rules that a memory with this `RaceMemory.gridded` is on the disk."""
        self._take(inputs.Saved(self.now(), gridded))
        self._ask_to_show()

    def _notice_stall(self, now: float) -> None:
        """Report a stall of race control to the rules, if one has occurred."""
        stalled = now - self._beat_at - 1.0 / self._settings.beat_rate
        if stalled > STALL:
            self._beat_at = now
            # Meanwhile, race control could not hear the ROS half.
            self._ros_half_heard_at = max(self._ros_half_heard_at, now)
            self._take(inputs.Stalled(now, stalled))
            self._ask_to_show()

    def _feed(self, given: inputs.Input) -> Outcome:
        """Log an input, then feed it to the rules. No other code may do this."""
        self._log.add(given)
        return inputs.feed(given, self._race)

    def _take(self, given: inputs.Input, request: Request | None = None) -> None:
        """Feed an input to the rules, send and publish the results, and answer its request."""
        outcome = self._feed(given)
        self._send(outcome)
        if outcome.answer is not None and request is not None:
            self._answer(request, outcome.answer)
        self._publish_outcome(outcome.events, given.at)

    def _answer(self, request: Request, answer: Answer) -> None:
        self._ros_half.send(pack(Answered(request.number, answer)))

    def _send(self, outcome: Outcome) -> None:
        for order in outcome.orders:
            link = self._links.get(order.kart)
            if link is not None:
                link.order(order.state, order.serial)
        if outcome.orders:
            self._log.add(inputs.Ordered(outcome.orders))

    def _publish_outcome(self, events: tuple[Event, ...], at: float) -> None:
        """Publish the events of an input with its time (s), so that a replay can compare them."""
        published = [
            each for each in events if not each.chatter or self._reports[each.kart].take(at)
        ]
        if published:
            self._publish(*published, at=at)

    def _publish(self, *events: Event, at: float) -> None:
        """Stamp events with this time, and gather them, so that they are forwarded together."""
        wall = time.time_ns() - round((self.now() - at) * 1e9)
        stamped = [StampedEvent(next(self._sequence), wall, at, event) for event in events]
        self._log.add(*stamped)
        if not self._gathered:
            self._loop.call_later(GATHER, self._flush)
        self._gathered += stamped
        self._ask_to_show()

    def _flush(self) -> None:
        """Forward the gathered events and all log entries."""
        gathered, self._gathered = self._gathered, []
        if gathered:
            self._ros_half.send(pack(Happened(gathered)))
        batch = self._log.take()
        if batch.entries:
            self._record.put(batch)
        if self._ros_half.unsent > TO_ROS_HALF_BYTES:
            self._ros_half.lose('it no longer accepts messages')

    def _ask_to_show(self) -> None:
        if not self._showing:
            self._showing = True
            delay = self._shown_at + LEAST_BETWEEN_SNAPSHOTS - self.now()
            self._loop.call_later(max(delay, SHOW_AFTER), self._show)

    def _show(self) -> None:
        """Send a snapshot, unless earlier messages are still waiting for the ROS half."""
        self.take_commands()
        self._showing = False
        now = self._shown_at = self.now()
        self._note_record_trouble(now)
        if not self._ros_half.unsent:
            self._log.add(inputs.Shown(now))
            self._ros_half.send(pack(snapshot_of(self._race, now)))
        self._remember()
        if self._race.paused_until > max(now, self._shown_pause):
            # More commands become available when the pause ends, even if nothing else changes.
            self._shown_pause = self._race.paused_until
            self._loop.call_at(self._shown_pause, self._ask_to_show)

    def _note_record_trouble(self, now: float) -> None:
        trouble = self._record.trouble()
        if trouble != self._race.record_fails:
            self._take(inputs.RecordTrouble(now, trouble))

    def _remember(self) -> None:
        self._flush()
        self._record.remember(self._race.memory(ended=self._closing.is_set()))

    # ----- called by the links ------------------------------------------------------------

    def link_made(self, link: KartLink, address: str) -> None:
        """Accept a new connection, or refuse it if its address is not in the roster (§4.A)."""
        karts = self._race.karts.values()
        number = next((each.number for each in karts if each.address == address), None)
        now = self.now()
        if number is None:
            link.drop('its address is not in the roster')
            text = (
                f'A connection from {address} was refused: no kart in the roster has that address'
            )
            known = address in self._refusals or len(self._refusals) < MOST_STRANGERS
            self._publish_refusal(text, address if known else '')
            return
        if self._closing.is_set():
            link.farewell()
            return
        if not self._connections[number].take(now):
            link.drop('it connects too often')
            kart = self._race.karts[number]
            text = f'A connection from {kart} was refused: it connects too often'
            self._publish_refusal(text, number)
            return
        old = self._links.pop(number, None)
        # It is not a takeover if the kart lost its link and connects again before race control
        # has noticed the loss.
        is_pushed_out = old is not None and old.answers(now)
        if old is not None:
            old.drop('a new connection from its address replaced it')
        link.number = number
        link.set_up()
        self._links[number] = link
        self._take(inputs.Connected(now, number))
        if is_pushed_out:
            self._takeovers[number].append(now)
            self._check_contest(number, now)

    def _publish_refusal(self, text: str, peer: int | str) -> None:
        """Publish that a connection was refused, as often as this peer may cause it."""
        now = self.now()
        if self._refusals[peer].take(now):
            kart = peer if isinstance(peer, int) else 0
            event = Event(EventKind.REFUSED_CONNECTION, text, kart=kart, success=False)
            self._publish(event, at=now)

    def _check_contest(self, number: int, now: float) -> None:
        """Report to the rules when two programs begin or stop contesting a kart."""
        most, within = TAKEOVERS
        before, at = self._race.karts[number].contested, self._takeovers[number]
        contested = len(at) == most and now - at[-1 if before else 0] <= within
        if contested != before:
            self._take(inputs.Contested(now, number, contested))

    def link_heard(self, link: KartLink, heard: Heard, serial: int, counts_in: float) -> None:
        """
        Handle a frame from a kart, or bytes that are not a frame.

        :param serial: serial of the order that the report can answer.
        :param counts_in: see `Hearing.counts_in`.
        """
        if self._links.get(link.number) is not link:
            return
        now = self.now()
        if isinstance(heard, MalformedFrame):
            if self._rubbish[link.number].take(now):
                kart = self._race.karts[link.number]
                text = f'From {kart}: {heard.reason}: {heard.raw!r}'
                event = Event(EventKind.MALFORMED, text, kart=link.number, success=False)
                self._publish(event, at=now)
            return
        self._take(inputs.Heard(now, link.number, serial, heard.state, counts_in))

    def link_noticed(self, link: KartLink, given: inputs.Delivered | inputs.Measured) -> None:
        """Feed what a link has noticed to the rules."""
        if self._links.get(link.number) is link:
            self._take(given)

    def link_lost(self, link: KartLink) -> None:
        """Report the end of a connection to the rules, unless a new one has replaced it."""
        if self._links.get(link.number) is link:
            del self._links[link.number]
            given = inputs.Disconnected(self.now(), link.number, link.reason, link.silent)
            self._take(given)


def _ended(failure: BaseException | None) -> Event:
    """Return the event saying that race control is shutting down, and why."""
    follows = 'It sends RED_RED to every connected kart, and closes the connections'
    if failure is None:
        text = f'Race control ends because of Ctrl-C or a signal. {follows}'
    else:
        text = f'Race control ends because of a failure ({in_words(failure)}). {follows}'
    return Event(EventKind.ENDED, text, success=failure is None)
