# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The link: a thread that keeps a kart connected to race control (§4.A, §4.D).

The thread owns the arbiter, the socket and the time. The arbiter decides what the kart must obey,
and this decision is its verdict. In each turn, the thread lets time pass, reads everything that
has arrived, processes what the node passes in (``give``), and publishes each new verdict. It uses
the `Kart` and the `Connection` of karts without ROS.

The same thread publishes the verdict again `REPEAT` times a second, so a thread that hangs falls
silent, and the kart's nodes stop (§3.E).

The time comes from `evgp_protocol.clock`, a clock that cannot be set and runs on during suspend.
After the computer wakes up, the link checks the time within `TURN`, and in any case before it
judges the first frame that arrives. It then finds that the connection was silent for too long.
If the thread was held up for less time, it obeys the frames that waited, but the silence counts
from a time at which none of them had arrived, because race control may have gone since.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
import concurrent.futures
import contextlib
import os
import threading

from evgp_protocol import clock
from evgp_protocol.arbiter import Arbiter, Reaction, Verdict
from evgp_protocol.connection import Connection, LinkSettings
from evgp_protocol.kart import Kart

REPEAT = 10.0
"""Rate at which the link publishes the verdict again, in Hz."""

TURN = 0.02
"""Maximum time between two turns of the loop, by which the link knows how old a frame may be, in
seconds."""

LINK_END_TIMEOUT = 2.0
"""Maximum time to wait until the thread has ended, in seconds."""

Input = Callable[[Arbiter, float], Reaction]


class LinkClosedError(RuntimeError):
    """The link has ended and accepts no more inputs."""


class RaceControlLink:
    """
    Owns an arbiter, and keeps it connected to race control in a thread of its own.

    Only the link's thread uses these:

    :ivar kart: the arbiter, with the decoder of the connection.
    :ivar connection: the connection, with its figures for diagnostics.

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
        publish: Callable[[Verdict], None],
        on_failure: Callable[[BaseException], None],
    ) -> None:
        self.kart = Kart(arbiter=arbiter)
        self.connection = Connection(self.kart, settings)
        self._arbiter = arbiter
        self._publish = publish
        self._on_failure = on_failure
        self._published: Verdict | None = None
        self._repeat_at = 0.0
        self._thread = threading.Thread(target=self._run, name='link', daemon=True)
        self._ending = False
        # What other threads pass in, and what wakes the thread then; gone once it has ended.
        self._giving = threading.Lock()
        self._given: deque[tuple[Input, concurrent.futures.Future[Reaction]]] = deque()
        self._bell: int | None = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)

    def start(self) -> None:
        """Begin to publish verdicts and to connect."""
        self._thread.start()

    def stop(self) -> None:
        """Close the connection and wait up to `LINK_END_TIMEOUT` for the thread to end."""
        self._ending = True
        with self._giving:
            if self._bell is not None:
                os.eventfd_write(self._bell, 1)
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
        with self._giving:
            if self._bell is None:
                future.set_exception(LinkClosedError('the bridge is not running'))
            else:
                self._given.append((take, future))
                os.eventfd_write(self._bell, 1)
        return future

    # ----- the thread ---------------------------------------------------------------------

    def _run(self) -> None:
        assert self._bell is not None
        bell = self._bell
        try:
            try:
                while not self._ending:
                    self._turn(bell)
                self._take_given()
            finally:
                self.connection.close()
                with self._giving:
                    self._bell = None
                os.close(bell)
                for _, future in self._given:
                    future.set_exception(LinkClosedError('the bridge is not running'))
        except BaseException as error:  # noqa: BLE001 - passed to the owner of the process
            self._on_failure(error)

    def _turn(self, bell: int) -> None:
        self.kart.tick(clock.now())
        self.connection.serve()
        self.connection.say(self.kart.acknowledge_garage(clock.now()))
        self._publish_news()
        self._take_given()
        due = (self._repeat_at, self._arbiter.deadline or self._repeat_at)
        self.connection.wait(bell, min(min(due) - clock.now(), TURN))
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(bell)

    def _take_given(self) -> None:
        """Pass what was given by now to the arbiter, and publish each new verdict."""
        for _ in range(len(self._given)):
            take, future = self._given.popleft()
            try:
                reaction = take(self._arbiter, clock.now())
                self.connection.say(self.kart.follow(reaction))
                self._publish_news()
            except BaseException as error:
                future.set_exception(error)
                raise
            future.set_result(reaction)

    def _publish_news(self) -> None:
        verdict, now = self.kart.verdict, clock.now()
        if now >= self._repeat_at:
            self._repeat_at = now + 1 / REPEAT
        elif verdict == self._published:
            return
        self._published = verdict
        self._publish(verdict)
