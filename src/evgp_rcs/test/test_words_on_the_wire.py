# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Clients of every habit through a sequence of orders, on real sockets."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import socket
import threading
import time

from evgp_protocol.frames import encode, FrameDecoder, StateFrame
from evgp_protocol.link import BEAT_RATE
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import AlertKind, Event, EventKind, Race
from heard_karts import Habit, HABITS, Says
from test_kart_server import run, Running  # noqa: F401 - a fixture


class Client:
    """
    A client of a habit, in a thread.

    :param rate: it reads one frame in each turn, and makes so many turns a second; 0: all at once.
    """

    def __init__(self, link: socket.socket, habit: Habit, rate: float = 0.0) -> None:
        self._link, self._habit, self._rate = link, habit, rate
        if habit.greets:
            link.sendall(encode(RaceState.IN_GARAGE))
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        decoder = FrameDecoder()
        last: RaceState | None = None
        word: RaceState | None = None
        with contextlib.suppress(OSError):
            while data := self._link.recv(13 if self._rate else 4096):
                for frame in decoder.feed(data):
                    assert isinstance(frame, StateFrame)
                    is_new, last = frame.state is not last, frame.state
                    if self._habit.says_back(last, is_new, word):
                        word = last
                        self._link.sendall(encode(last))
                if self._rate:
                    time.sleep(1.0 / self._rate)


def test_clients_of_every_habit_acknowledge_a_second_all_kill_just_after_in_garage(
    run: Callable[..., Running],  # noqa: F811 - the fixture
) -> None:
    habits = dict(enumerate(HABITS, 1))
    running = run(beat_rate=BEAT_RATE, karts=len(habits), settle_time=2.5)
    waits: dict[int, list[float]] = {number: [] for number in habits}

    def note(event: Event) -> None:
        if event.kart and 'perhaps in answer to an earlier command' in event.text:
            counts_at = running.race.karts[event.kart].counts_at
            if counts_at is not None:
                waits[event.kart].append(counts_at - running.server.now())

    def all_stand(race: Race, _: float) -> bool:
        return all(kart.stands for kart in race.karts.values())

    running.on_event = note
    for number, habit in habits.items():
        Client(running.connect(number), habit)
        running.wait_for(EventKind.CONNECTED, number)
    running.give(CommandKind.ALL_KILL)
    running.wait_until_shown(all_stand)
    assert running.give(CommandKind.IN_GARAGE).success
    running.give(CommandKind.ALL_KILL)
    running.wait_until_shown(all_stand)
    # It is told once that a word waits, and for how long.
    for number, habit in habits.items():
        assert habit.garage or len(waits[number]) == 1, habit
        assert all(each > 0.0 for each in waits[number]), habit


def test_a_client_that_never_says_the_second_one_is_let_go_on_by_a_new_connection(
    run: Callable[..., Running],  # noqa: F811 - the fixture
) -> None:
    running = run(beat_rate=BEAT_RATE, karts=1, settle_time=0.1)
    Client(running.connect(1), Habit(Says.NEWS))
    running.give(CommandKind.ALL_KILL)
    running.wait_until_shown(lambda race, at: race.karts[1].stands)
    assert running.give(CommandKind.IN_GARAGE).success
    running.give(CommandKind.ALL_KILL)
    running.wait_until_shown(lambda race, at: race.karts[1].delivered_after is not None)
    assert 'it must reconnect' in running.give(CommandKind.IN_GARAGE).message
    Client(running.connect(1), Habit(Says.NEWS))
    running.wait_until_shown(lambda race, at: race.karts[1].stands)


def test_a_client_that_says_every_frame_and_reads_too_few_is_shown_as_poor(
    run: Callable[..., Running],  # noqa: F811 - the fixture
) -> None:
    running = run(beat_rate=BEAT_RATE, karts=1)
    Client(running.connect(1), Habit(Says.FRAMES, garage=True), rate=8.0)
    running.wait_until_shown(lambda race, at: race.karts[1].link.behind > 0.0)
    (alert,) = running.race.alerts(0.0)
    assert alert.kind is AlertKind.LINK_POOR
    assert 'may read' in alert.text
