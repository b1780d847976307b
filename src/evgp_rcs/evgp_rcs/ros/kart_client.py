# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The ROS half's client of the kart server.

The client starts the kart server's process, passes commands on to it, and receives its events in a
thread of its own. You may call every method from any thread.
"""

from __future__ import annotations

from collections.abc import Callable
import concurrent.futures
import contextlib
import itertools
import queue
import select
import socket
import subprocess
import sys
import threading
from typing import Any

from evgp_rcs.karts.channel import (
    Alive,
    ANSWER_TIMEOUT,
    Answered,
    Begin,
    End,
    Failed,
    Happened,
    KartServerError,
    Listening,
    pack,
    Request,
    Unpacker,
)
from evgp_rcs.rules.race import Answer, Attendance, Command, StampedEvent
from evgp_rcs.rules.snapshot import Snapshot

KART_SERVER_END_TIMEOUT = 5.0
"""Maximum time for a kart server to end, in seconds. After that, the client kills it."""

START_TIMEOUT = 20.0
"""Maximum time for the kart server to start, in seconds. This allows for a slow disk. If the disk
hangs, officials must still get an answer."""

KART_SERVER_SILENCE = 1.5
"""Maximum silence of a kart server, in seconds. After that, the client kills it. A working one
sends a snapshot of the race at least every 0.5 s."""

LOOKS = 10
"""Number of checks for silence in `KART_SERVER_SILENCE`. The client counts checks instead of
measuring time, because a stopped process misses only one check, however long it was stopped."""

FROM_KART_SERVER_BYTES = 1 << 20
"""Maximum number of bytes read from the kart server at a time. A large snapshot fits into it."""

_LOST = 'race control has lost its karts, so use the MSR'

_CHILD = (
    'import sys; sys.path[:] = sys.argv[2:]; '
    'from evgp_rcs.karts.process import main; sys.exit(main(sys.argv[1:2]))'
)
"""The program that runs the kart server. It looks for modules in the same places as this one."""


class KartServerClient:
    """
    The kart server's process, as the ROS half sees it.

    :param on_news: called with events, in order, and with each snapshot of the race, in the
        hearing thread. It must not block.
    :param on_end: called with the reason, in the hearing thread, if the kart server has ended on
        its own. Every kart has then been sent RED_RED or has lost its connection.
    :ivar address: the address and port at which karts can connect, once ``start`` has returned.
    """

    def __init__(
        self,
        begin: Begin,
        on_news: Callable[[list[StampedEvent] | Snapshot], None],
        on_end: Callable[[str], None],
    ) -> None:
        self._begin = begin
        self._on_news = on_news
        self._on_end = on_end
        self._numbers = itertools.count(1)
        self._waiting: dict[int, queue.SimpleQueue[Answer | None]] = {}
        self._listening: concurrent.futures.Future[tuple[str, int]] = concurrent.futures.Future()
        self._sending = threading.Lock()
        self._stopping = False
        """Whether the client has told the kart server to end and sends nothing more."""
        self._end: socket.socket
        self._process: subprocess.Popen[bytes]
        self._thread = threading.Thread(target=self._run, name='kart_client', daemon=True)
        self.address = ('', 0)

    def start(self) -> None:
        """
        Start the kart server, and return once karts can connect.

        :raises KartServerError: if the kart server cannot start, or not within `START_TIMEOUT`.
        """
        self._end, other = socket.socketpair()
        with other:
            self._process = subprocess.Popen(
                # With -m, Python would first look for modules in the working directory.
                [sys.executable, '-c', _CHILD, str(other.fileno()), *map(str, sys.path)],
                pass_fds=(other.fileno(),),
                stdin=subprocess.DEVNULL,
                # A signal from the terminal then reaches only the ROS half, which ends both.
                start_new_session=True,
            )
        self._thread.start()
        try:
            self._send(self._begin)
            self.address = self._listening.result(START_TIMEOUT)
        except KartServerError:
            self._clear_away()
            raise
        except concurrent.futures.TimeoutError:
            self._process.kill()
            self._clear_away()
            raise KartServerError(
                f'the kart server has not started within {START_TIMEOUT:g} s. Check whether the '
                f'disk of the record hangs ({self._begin.record})'
            ) from None

    def command(self, command: Command, came: float) -> Answer | None:
        """
        Pass on an official's command, and wait for its answer.

        If no answer comes in time, a stop or RACE_OVER still waits until the kart server judges
        it. Any other command expires.

        :param came: when the command arrived, in seconds by the rules' clock.
        :return: the answer, once the kart server has written every frame. None if it does not
            arrive within `ANSWER_TIMEOUT`.
        :raises KartServerError: if the kart server is gone, so that only the MSR can stop karts.
        """
        number = next(self._numbers)
        # Creating a future would take longer than sending a stop.
        answers = self._waiting[number] = queue.SimpleQueue()
        self._send(Request(number, command, came))
        try:
            answer = answers.get(timeout=ANSWER_TIMEOUT)
        except queue.Empty:
            self._waiting.pop(number, None)
            return None
        if answer is None:
            raise KartServerError(_LOST)
        return answer

    def alive(self, rival: bool, there: Attendance, cut_off: str) -> None:
        """Give the kart server a sign of life (``channel.Alive``)."""
        if not self._stopping:
            self._send(Alive(rival, there, cut_off))

    def end(self, in_order: bool) -> None:
        """Tell the kart server to end, with RED_RED to every kart (``channel.End``)."""
        if self._stopping:
            return
        self._stopping = True
        try:
            self._send(End(in_order))
        except KartServerError:
            pass  # the kart server has ended already

    def stop(self, in_order: bool) -> None:
        """Call ``end`` and wait until the process has ended."""
        self.end(in_order)
        self._clear_away()

    def _clear_away(self) -> None:
        self._stopping = True
        try:
            self._process.wait(KART_SERVER_END_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._thread.join(KART_SERVER_END_TIMEOUT)
        self._end.close()

    def _send(self, message: object) -> None:
        data = pack(message)
        try:
            with self._sending:
                self._end.sendall(data)
        except OSError as error:
            raise KartServerError(_LOST) from error  # it has ended, or was killed for its silence

    # ----- the hearing thread -------------------------------------------------------------

    def _run(self) -> None:
        try:
            why = self._hear()
        except BaseException as error:  # noqa: BLE001 - the node ends the process
            why = f'race control can no longer hear the kart server: {error!r}'
        # End the kart server in any case. Karts must not stay connected to a race control that
        # officials cannot hear. After this, `_send` fails, so no command can still be added to
        # those that wait.
        with contextlib.suppress(OSError):
            self._end.shutdown(socket.SHUT_RDWR)
        self._refuse_the_rest()
        if not self._listening.done():
            self._listening.set_exception(KartServerError(why))
        elif not self._stopping:
            self._on_end(why)

    def _hear(self) -> str:
        """Handle messages from the kart server until it ends and return why it ended."""
        unpacker = Unpacker()
        why = 'the process of the kart server has ended'
        silent = 0
        while True:
            if not select.select([self._end], [], [], KART_SERVER_SILENCE / LOOKS)[0]:
                silent += self._listening.done() and not self._stopping
                if silent < LOOKS:
                    continue
                self._process.kill()  # so that the karts lose their connections
                return f'the kart server was silent for {KART_SERVER_SILENCE:g} s and was killed'
            silent = 0
            try:
                data = self._end.recv(FROM_KART_SERVER_BYTES)
            except OSError:
                return why
            if not data:
                return why
            for message in unpacker.feed(data):
                if isinstance(message, Failed):
                    why = message.text
                else:
                    self._take(message)

    def _take(self, message: Any) -> None:
        if isinstance(message, Happened):
            self._on_news(message.events)
        elif isinstance(message, Snapshot):
            self._on_news(message)
        elif isinstance(message, Answered):
            self._answer(message.number, message.answer)
        else:
            assert isinstance(message, Listening)
            self._listening.set_result(message.address)

    def _refuse_the_rest(self) -> None:
        for number in list(self._waiting):
            self._answer(number, None)

    def _answer(self, number: int, answer: Answer | None) -> None:
        answers = self._waiting.pop(number, None)
        if answers is not None:  # its caller still waits
            answers.put(answer)
