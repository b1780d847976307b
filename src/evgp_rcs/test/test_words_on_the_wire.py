# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Clients of every habit through a sequence of orders, on real sockets; and what officials see."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import socket
import threading
import time

from evgp_protocol.frames import encode, FrameDecoder, StateFrame
from evgp_protocol.link import BEAT_RATE, Grade
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.link_quality import NOT_MEASURED
from evgp_rcs.rules.race import AlertKind, Command, Event, EventKind, Kart, Race, RaceTimes
from heard_karts import Habit, HABITS, Says
import pytest
from test_kart_server import run, Running  # noqa: F401 - a fixture

IN_GARAGE, RED_RED = RaceState.IN_GARAGE, RaceState.RED_RED

CURE = (
    'reported RED_RED, perhaps in answer to an earlier command (if waiting does not help, it must '
    'reconnect, and will be held)'
)


class Client:
    """
    A client of a habit, in a thread.

    :param rate: it reads one frame in each turn, and makes so many turns a second; 0: all at once.
    """

    def __init__(self, link: socket.socket, habit: Habit, rate: float = 0.0) -> None:
        self._link, self._habit, self._rate = link, habit, rate
        if habit.greets:
            link.sendall(encode(IN_GARAGE))
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        decoder = FrameDecoder()
        last = word = None
        with contextlib.suppress(OSError):
            while data := self._link.recv(13 if self._rate else 4096):
                for frame in decoder.feed(data):
                    assert isinstance(frame, StateFrame)
                    news, last = frame.state is not last, frame.state
                    if frame.state is IN_GARAGE and not self._habit.garage:
                        continue
                    says = self._habit.says
                    if says is Says.FRAMES or (news if says is Says.CHANGES else last is not word):
                        word = last
                        self._link.sendall(encode(frame.state))
                if self._rate:
                    time.sleep(1.0 / self._rate)


@pytest.mark.parametrize('habit', HABITS, ids=str)
def test_a_client_of_every_habit_acknowledges_a_second_all_kill_just_after_in_garage(
    habit: Habit,
    run: Callable[..., Running],  # noqa: F811 - the fixture
) -> None:
    running = run(beat_rate=BEAT_RATE, karts=1, settle_time=2.5)
    waits: list[float] = []

    def note(event: Event) -> None:
        counts_at = running.race.karts[1].counts_at
        if counts_at is not None and 'perhaps in answer to an earlier command' in event.text:
            waits.append(counts_at - running.server.now())

    running.on_event = note
    Client(running.connect(1), habit)
    running.wait_for(EventKind.CONNECTED, 1)
    running.give(CommandKind.ALL_KILL)
    running.wait_until_shown(lambda race, at: race.karts[1].stands)
    assert running.give(CommandKind.IN_GARAGE).success
    running.give(CommandKind.ALL_KILL)
    running.wait_until_shown(lambda race, at: race.karts[1].stands)
    # It is told once that its word waits, and for how long.
    assert habit.garage or (len(waits) == 1 and waits[0] > 0.0)


def test_a_client_that_never_says_the_second_one_is_let_go_on_by_a_new_connection(
    run: Callable[..., Running],  # noqa: F811 - the fixture
) -> None:
    running = run(beat_rate=BEAT_RATE, karts=1, settle_time=0.1)
    Client(running.connect(1), Habit(Says.NEWS))
    for _ in range(2):
        running.give(CommandKind.ALL_KILL)
        running.wait_until_shown(lambda race, at: race.karts[1].delivered_at is not None)
        if _ == 0:
            running.wait_until_shown(lambda race, at: race.karts[1].stands)
            assert running.give(CommandKind.IN_GARAGE).success
    why = running.give(CommandKind.IN_GARAGE).message
    assert CURE in why
    Client(running.connect(1), Habit(Says.NEWS))
    running.wait_until_shown(lambda race, at: race.karts[1].stands)


def test_a_client_that_says_every_frame_and_reads_too_few_is_shown_as_poor(
    run: Callable[..., Running],  # noqa: F811 - the fixture
) -> None:
    running = run(beat_rate=BEAT_RATE, karts=1)
    Client(running.connect(1), Habit(Says.FRAMES, garage=True), rate=8.0)
    running.wait_until_shown(
        lambda race, at: race.karts[1].link is not None and race.karts[1].link.behind > 0.0
    )
    (alert,) = running.race.alerts(0.0)
    assert alert.kind is AlertKind.LINK_POOR
    assert 'may read' in alert.text


# ----- what the rules make of it ----------------------------------------------------------------


@pytest.fixture
def race() -> Race:
    """Return a race in whose RED_RED kart 1 is connected."""
    race = Race([Kart(1, in_race=True)], RaceTimes(pause=0.0))
    race.connected(1, 0.0)
    race.command(Command(CommandKind.ALL_KILL), 0.0)
    return race


def refusal(race: Race, now: float) -> str:
    return race.availability(CommandKind.IN_GARAGE, 0, now).reason


def test_a_word_that_cannot_count_yet_is_told_once_and_named_with_the_cure_and_its_cost(
    race: Race,
) -> None:
    kart = race.karts[1]
    first = race.heard(1, kart.serial - 1, RED_RED, 1.0, 2.0)
    again = race.heard(1, kart.serial - 1, RED_RED, 1.5, 1.6)
    assert [each.kind for each in first.events] == [EventKind.REPORTED]
    assert not again.events
    assert kart.counts_at == 3.1
    assert CURE in first.events[0].text
    assert CURE in refusal(race, 1.6)
    race.connected(1, 4.0)
    assert 'has not acknowledged RED_RED' in refusal(race, 4.0)


@pytest.mark.parametrize('how', ['it counts', 'another order', 'another state'])
def test_what_is_over_is_not_said_any_more(race: Race, how: str) -> None:
    kart = race.karts[1]
    race.heard(1, kart.serial - 1, RED_RED, 1.0, 2.0)
    if how == 'it counts':
        race.heard(1, kart.serial, RED_RED, 1.5)
    elif how == 'another order':
        race.disconnected(1, 'gone', 1.5)
    else:
        race.heard(1, kart.serial, RaceState.RED_FLAG, 1.5)
    assert 'perhaps' not in refusal(race, 1.6)


def test_a_kart_that_may_read_late_has_a_poor_link_that_says_so(race: Race) -> None:
    link = NOT_MEASURED._replace(grade=Grade.POOR, worst_answer=0.01, behind=1.2)
    (event,) = race.measured(1, link, 1.0).events
    assert event.text.endswith('the kart may read a stop 1.2 s late')
    (text,) = (each.text for each in race.alerts(1.0) if each.kind is AlertKind.LINK_POOR)
    assert 'kart 1 may read a stop 1.2 s late' in text
