# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The kart server's process at one end of a real socket pair, and the test at the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import dataclasses
import pathlib
import queue
import signal
import socket
import subprocess
import sys
import threading
from typing import Any

from evgp_protocol import clock
from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState
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
    ServerSettings,
    Unpacker,
)
from evgp_rcs.karts.server import ROS_HALF_SILENCE
from evgp_rcs.record.run_mark import place, RUN_BEGAN
from evgp_rcs.record.runs import open_runs
from evgp_rcs.ros import kart_client
from evgp_rcs.ros.kart_client import KartServerClient
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import (
    Command,
    Entrant,
    EventKind,
    RaceTimes,
    Roster,
    StampedEvent,
)
from evgp_rcs.rules.snapshot import Snapshot
from evgp_testing.process import freeze
from evgp_testing.race_control import new_port
from evgp_testing.wire_kart import kart_socket, read_to_end, read_until
import pytest
from rig.replaying import events_of

TIMEOUT = 30.0

ALL_KILL = Command(CommandKind.ALL_KILL)
RED_RED = RaceState.RED_RED
IN_GARAGE = RaceState.IN_GARAGE


@pytest.fixture
def begin(tmp_path: pathlib.Path) -> Begin:
    return Begin(
        Roster((Entrant(1, 'A', True, '', '127.0.3.1'), Entrant(2, 'B', False, '', '127.0.3.2'))),
        RaceTimes(),
        ServerSettings(host='127.0.0.1', port=new_port()),
        tmp_path / 'record.sqlite3',
    )


class Half:
    """The ROS half, as the test plays it: it reads when it is told to."""

    def __init__(self) -> None:
        self.end, other = socket.socketpair()
        self.end.settimeout(TIMEOUT)
        with other:
            self.process = subprocess.Popen(
                [sys.executable, '-m', 'evgp_rcs.karts.process', str(other.fileno())],
                pass_fds=(other.fileno(),),
                stderr=subprocess.DEVNULL,
            )
        self._unpacker = Unpacker()
        self._come: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def say(self, message: object) -> None:
        self.end.sendall(pack(message))

    def hear(self) -> Any:
        """Return the next message; None at the end."""
        while self._come.empty():
            data = self.end.recv(65536)
            if not data:
                return None
            for message in self._unpacker.feed(data):
                self._come.put(message)
        return self._come.get()

    def wait_for(self, kind: type) -> Any:
        """Return the next message of a kind."""
        while True:
            message = self.hear()
            assert message is not None, f'it ended without a {kind.__name__}'
            if isinstance(message, kind):
                return message

    def close(self) -> None:
        self.end.close()
        self.process.wait(TIMEOUT)


@pytest.fixture
def half() -> Iterator[Half]:
    with contextlib.closing(Half()) as playing:
        yield playing


@pytest.fixture
def connect(half: Half, begin: Begin) -> Iterator[Callable[[int], socket.socket]]:
    """Return a function that connects a kart; the kart server has begun."""
    half.say(begin)
    address = half.wait_for(Listening).address
    with contextlib.ExitStack() as stack:

        def kart(number: int) -> socket.socket:
            return stack.enter_context(kart_socket(f'127.0.3.{number}', address))

        yield kart


Connect = Callable[[int], socket.socket]


@pytest.mark.parametrize('spoke', [True, False], ids=['silent', 'never spoke'])
def test_a_silence_of_the_ros_half_means_red_red_to_every_kart_and_wakes_it(
    half: Half, connect: Connect, spoke: bool
) -> None:
    client = connect(2)
    read_until(client, IN_GARAGE)
    # The handler may interrupt any wait of this thread, so it takes no lock, as an Event would.
    awaits, wakes = socket.socketpair()
    before = signal.signal(signal.SIGCONT, lambda *_: wakes.send(b'!'))
    try:
        if spoke:
            half.say(Alive(False))
        assert read_to_end(client).endswith(encode(RED_RED))
        assert f'silent for {ROS_HALF_SILENCE:.0f}' in half.wait_for(Failed).text
        awaits.settimeout(TIMEOUT)
        assert awaits.recv(1)
        assert half.process.wait(TIMEOUT) == 1
    finally:
        signal.signal(signal.SIGCONT, before)
        awaits.close()
        wakes.close()


def test_a_ros_half_that_reads_nothing_holds_nobody_up_and_loses_no_event_and_late_is_only_a_stop(
    half: Half, connect: Connect
) -> None:
    client = connect(1)
    read_until(client, IN_GARAGE)
    count = 4000
    for number in range(count):
        half.say(Request(number, Command(CommandKind.KART_FINISH, 1), clock.now()))
    half.say(Request(count, ALL_KILL, clock.now()))
    read_until(client, RED_RED)  # while far more waits than any socket takes
    sequences: list[int] = []
    snapshots = 0
    answers = 0
    while answers <= count:
        message = half.hear()
        if isinstance(message, Happened):
            sequences += [each.sequence for each in message.events]
        snapshots += isinstance(message, Snapshot)
        answers += isinstance(message, Answered)
    assert sequences == list(range(sequences[0], sequences[0] + len(sequences)))
    assert snapshots < count / 10
    close = Command(CommandKind.CLOSE_TRACK)
    long_ago = clock.now() - ANSWER_TIMEOUT
    half.say(Request(-1, close, long_ago))  # too late to be judged
    half.say(Request(-2, close, clock.now()))
    half.say(Request(-3, ALL_KILL, long_ago))
    assert {half.wait_for(Answered).number, half.wait_for(Answered).number} == {-2, -3}


def mark_of(begin: Begin) -> str:
    """Return what the mark of this race control says."""
    path = place(begin.settings.host, begin.settings.port)
    return path.read_text(encoding='ascii').strip()


@pytest.mark.parametrize('end', [End(True), End(False), signal.SIGTERM], ids=str)
def test_record_and_mark_say_whether_the_end_was_in_order_and_red_red_is_sent_last(
    half: Half, connect: Connect, begin: Begin, end: End | signal.Signals
) -> None:
    client = connect(1)
    read_until(client, IN_GARAGE)
    assert mark_of(begin) == RUN_BEGAN
    half.say(end) if isinstance(end, End) else half.process.send_signal(end)
    assert read_to_end(client).endswith(encode(RED_RED))
    told: list[StampedEvent] = []
    while (message := half.hear()) is not None:
        told += message.events if isinstance(message, Happened) else []
    ended, gone = (each.event for each in told[-2:])
    in_order = end != End(False)
    assert (ended.kind, ended.success) == (EventKind.ENDED, in_order)
    assert ('the part that hears officials failed' in ended.text) is not in_order
    assert (gone.kind, gone.kart) == (EventKind.DISCONNECTED, 1)
    assert gone.text.endswith('disconnected: race control ended')
    assert half.process.wait(TIMEOUT) == (0 if in_order else 1)
    assert [*events_of(begin.record)] == told
    with open_runs(begin.record) as runs:
        run = runs.choose(None)
    assert (run.ended_ns is not None) is in_order
    assert (mark_of(begin) != RUN_BEGAN) is in_order


def test_an_end_of_the_ros_half_means_red_red_and_what_happened_is_on_the_disk(
    half: Half, connect: Connect, begin: Begin
) -> None:
    client = connect(1)
    read_until(client, IN_GARAGE)
    half.say(Request(1, Command(CommandKind.KART_RED_RED, 2), clock.now()))
    half.wait_for(Answered)
    half.end.close()
    assert read_to_end(client).endswith(encode(RED_RED))
    assert half.process.wait(TIMEOUT) == 1
    commands = [each.event.command for each in events_of(begin.record)]
    assert CommandKind.KART_RED_RED in commands


def test_a_port_in_use_is_refused_and_leaves_no_doubt_behind(half: Half, begin: Begin) -> None:
    with socket.create_server(('127.0.0.1', begin.settings.port)):
        half.say(dataclasses.replace(begin, cannot_know='no cable'))
        assert 'another program uses the port' in half.wait_for(Failed).text
        assert half.process.wait(TIMEOUT) == 2
    with contextlib.closing(Half()) as again:
        again.say(begin)
        again.wait_for(Listening)
        assert again.wait_for(Snapshot).state is IN_GARAGE


def test_an_address_that_this_machine_does_not_have_is_refused(half: Half, begin: Begin) -> None:
    half.say(dataclasses.replace(begin, settings=ServerSettings('203.0.113.9', new_port())))
    assert 'this machine does not have that address' in half.wait_for(Failed).text
    assert half.process.wait(TIMEOUT) == 2


def test_a_hold_of_the_last_moment_is_found_by_the_next_run_and_nothing_is_released_at_the_end(
    half: Half, connect: Connect, begin: Begin
) -> None:
    client = connect(2)
    read_until(client, IN_GARAGE)
    held = Request(1, Command(CommandKind.KART_RED_RED, 2), clock.now())
    release = Command(CommandKind.KART_IN_GARAGE, 2, True, frozenset({2}), RED_RED)
    released = Request(2, release, clock.now() + 60.0)
    half.end.sendall(pack(held) + pack(End(True)) + pack(released))
    read_until(client, RED_RED)
    assert encode(IN_GARAGE) not in read_to_end(client)
    assert half.process.wait(TIMEOUT) == 0
    assert mark_of(begin) == RUN_BEGAN  # whatever becomes of the record
    with contextlib.closing(Half()) as again:
        again.say(begin)
        again.wait_for(Listening)
        race = again.wait_for(Snapshot)
    assert (race.state, race.karts[1].hold) == (RED_RED, RED_RED)


# ----- the client of it, in the ROS half ---------------------------------------------------


def test_a_kart_server_that_hangs_and_takes_nothing_is_given_up_and_no_thread_waits_for_it(
    begin: Begin, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kart_client, 'ANSWER_TIMEOUT', 0.0)
    ended = threading.Event()
    client = KartServerClient(begin, lambda news: None, lambda why: ended.set())
    client.start()
    try:
        freeze(client._process.pid)
        with pytest.raises(KartServerError, match='use the MSR'):
            while True:  # until its end takes no more
                client.command(ALL_KILL, clock.now())
        assert ended.wait(TIMEOUT)
    finally:
        client.stop(in_order=False)


def test_a_hearing_thread_that_fails_ends_race_control_which_takes_no_module_from_where_it_works(
    begin: Begin, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'sqlite3.py').write_text("raise ValueError('it was taken')")
    monkeypatch.chdir(tmp_path)
    ended: queue.SimpleQueue[str] = queue.SimpleQueue()

    def broken(news: object) -> None:
        raise ZeroDivisionError('a fault put in by the test')

    client = KartServerClient(begin, broken, ended.put)
    client.start()
    assert 'ZeroDivisionError' in ended.get(timeout=TIMEOUT)
    with pytest.raises(KartServerError, match='use the MSR'):
        client.command(ALL_KILL, clock.now())  # at once, and not after a wait for an answer
    assert client._process.wait(TIMEOUT) == 1  # and every kart was sent RED_RED
    client.stop(in_order=False)
