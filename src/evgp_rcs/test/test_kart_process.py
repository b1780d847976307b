# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The kart server's process and its client in the ROS half, at the two ends of a socket pair."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import dataclasses
import pathlib
import queue
import signal
import socket
import threading

from evgp_protocol import clock
from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState
from evgp_rcs.karts.channel import (
    ANSWER_TIMEOUT,
    Begin,
    End,
    KartServerError,
    pack,
    Request,
    ServerSettings,
)
from evgp_rcs.karts.server import ROS_HALF_SILENCE
from evgp_rcs.record.run_mark import place, RUN_BEGAN
from evgp_rcs.record.runs import open_runs
from evgp_rcs.ros import kart_client
from evgp_rcs.ros.kart_client import KartServerClient
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import (
    Attendance,
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
CLOSE_TRACK = Command(CommandKind.CLOSE_TRACK)
HOLD = Command(CommandKind.KART_RED_RED, 2)
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


class Half(KartServerClient):
    """The ROS half, which gives a sign of life only when the test does, and what it hears."""

    def __init__(self, begin: Begin) -> None:
        self.told: list[StampedEvent] = []
        self.shown: queue.SimpleQueue[Snapshot] = queue.SimpleQueue()
        self.ended: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.on_event: Callable[[StampedEvent], object] = lambda event: None
        super().__init__(begin, self._hear_news, self.ended.put)

    def _hear_news(self, news: list[StampedEvent] | Snapshot) -> None:
        if isinstance(news, Snapshot):
            self.shown.put(news)
            return
        self.told += news
        for each in news:
            self.on_event(each)

    def commands(self) -> list[CommandKind | None]:
        """Return the commands of which it was told."""
        return [each.event.command for each in self.told if each.event.kind is EventKind.COMMAND]

    def exit_code(self) -> int:
        """Return the exit code of the kart server, once all that it said was heard."""
        code = self._process.wait(TIMEOUT)
        self._thread.join(TIMEOUT)
        return code

    def connect(self, number: int) -> socket.socket:
        """Return the connection of a kart that was sent IN_GARAGE."""
        kart = kart_socket(f'127.0.3.{number}', self.address)
        read_until(kart, IN_GARAGE)
        return kart


@pytest.fixture
def half(begin: Begin) -> Iterator[Half]:
    playing = Half(begin)
    playing.start()
    yield playing
    playing.stop(in_order=False)


@pytest.mark.parametrize('spoke', [True, False], ids=['silent', 'never spoke'])
def test_a_silence_of_the_ros_half_means_red_red_to_every_kart_and_wakes_it(
    half: Half, spoke: bool
) -> None:
    # The handler may interrupt any wait of this thread, so it takes no lock, as an Event would.
    awaits, wakes = socket.socketpair()
    before = signal.signal(signal.SIGCONT, lambda *_: wakes.send(b'!'))
    try:
        with half.connect(2) as kart:
            if spoke:
                half.alive(False, Attendance(), '')
            assert read_to_end(kart).endswith(encode(RED_RED))
        assert f'silent for {ROS_HALF_SILENCE:.0f}' in half.ended.get(timeout=TIMEOUT)
        awaits.settimeout(TIMEOUT)
        assert awaits.recv(1)
        assert half.exit_code() == 1
    finally:
        signal.signal(signal.SIGCONT, before)
        awaits.close()
        wakes.close()


def test_a_ros_half_that_reads_nothing_holds_nobody_up_and_loses_no_event_and_late_is_only_a_stop(
    half: Half,
) -> None:
    count, snapshots, reads = 4000, 0, threading.Event()
    with half.connect(1) as kart:
        half.on_event = lambda event: reads.wait(TIMEOUT)
        for number in range(count):
            finish = Command(CommandKind.KART_FINISH, 1)
            half._send(Request(-number, finish, clock.now()))
        half._send(Request(-count, ALL_KILL, clock.now()))
        read_until(kart, RED_RED)  # while far more waits than any socket takes
    reads.set()
    while len(half.commands()) <= count:
        half.alive(False, Attendance(), '')
        half.shown.get(timeout=TIMEOUT)
        snapshots += 1
    numbers = [each.sequence for each in half.told]
    assert numbers == [*range(1, len(numbers) + 1)]
    assert snapshots < count / 10
    half.told.clear()
    long_ago = clock.now() - ANSWER_TIMEOUT
    half._send(Request(0, CLOSE_TRACK, long_ago))  # too late to be judged
    assert half.command(CLOSE_TRACK, clock.now())
    assert half.command(ALL_KILL, long_ago)
    half.stop(in_order=True)
    assert half.commands() == [CommandKind.CLOSE_TRACK, CommandKind.ALL_KILL]


def mark_of(begin: Begin) -> str:
    """Return what the mark of this race control says."""
    path = place(begin.settings.host, begin.settings.port)
    return path.read_text(encoding='ascii').strip()


@pytest.mark.parametrize('end', [End(True), End(False), signal.SIGTERM], ids=str)
def test_record_and_mark_say_whether_the_end_was_in_order_and_red_red_is_sent_last(
    half: Half, begin: Begin, end: End | signal.Signals
) -> None:
    in_order = end != End(False)
    with half.connect(1) as kart:
        assert mark_of(begin) == RUN_BEGAN
        half.end(end.in_order) if isinstance(end, End) else half._process.send_signal(end)
        assert read_to_end(kart).endswith(encode(RED_RED))
    assert half.exit_code() == (0 if in_order else 1)
    ended, gone = (each.event for each in half.told[-2:])
    assert (ended.kind, ended.success) == (EventKind.ENDED, in_order)
    assert ('the part that hears officials failed' in ended.text) is not in_order
    assert (gone.kind, gone.kart) == (EventKind.DISCONNECTED, 1)
    assert gone.text.endswith('disconnected: race control ended')
    assert [*events_of(begin.record)] == half.told
    with open_runs(begin.record) as runs:
        run = runs.choose(None)
    assert (run.ended_ns is not None) is in_order
    assert (mark_of(begin) != RUN_BEGAN) is in_order


def test_what_keeps_it_from_starting_is_named_and_leaves_no_doubt_behind(begin: Begin) -> None:
    elsewhere = dataclasses.replace(begin, settings=ServerSettings('203.0.113.9', new_port()))
    doubtful = dataclasses.replace(begin, cannot_know='no cable')
    with socket.create_server(('127.0.0.1', begin.settings.port)):
        for wrong, why in (
            (elsewhere, 'this machine does not have that address'),
            (doubtful, 'another program uses the port'),
        ):
            refused = Half(wrong)
            with pytest.raises(KartServerError, match=why):
                refused.start()
            assert refused.exit_code() == 2
    again = Half(begin)
    again.start()
    assert again.shown.get(timeout=TIMEOUT).state is IN_GARAGE
    again.stop(in_order=True)


def test_a_hold_of_the_last_moment_is_found_by_the_next_run_and_nothing_is_released_at_the_end(
    half: Half, begin: Begin
) -> None:
    release = Command(CommandKind.KART_IN_GARAGE, 2, True, frozenset({2}), RED_RED)
    last = Request(1, HOLD, clock.now()), End(True), Request(2, release, clock.now() + 60.0)
    with half.connect(2) as kart:
        half._end.sendall(b''.join(map(pack, last)))
        read_until(kart, RED_RED)
        assert encode(IN_GARAGE) not in read_to_end(kart)
    assert half.exit_code() == 0
    assert mark_of(begin) == RUN_BEGAN  # whatever becomes of the record
    again = Half(begin)
    again.start()
    race = again.shown.get(timeout=TIMEOUT)
    again.stop(in_order=True)
    assert (race.state, race.karts[1].hold) == (RED_RED, RED_RED)


def test_a_kart_server_that_hangs_and_takes_nothing_is_given_up_and_no_thread_waits_for_it(
    half: Half, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kart_client, 'ANSWER_TIMEOUT', 0.0)
    freeze(half._process.pid)
    with pytest.raises(KartServerError, match='use the MSR'):
        while True:  # until its end takes no more
            half.command(ALL_KILL, clock.now())
    assert half.ended.get(timeout=TIMEOUT)


def test_a_hearing_thread_that_fails_means_red_red_to_every_kart_and_what_happened_is_on_the_disk(
    begin: Begin, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor does race control take a module from where it works."""
    (tmp_path / 'sqlite3.py').write_text("raise ValueError('it was taken')")
    monkeypatch.chdir(tmp_path)
    half = Half(begin)
    half.start()

    def fail_at_a_command(each: StampedEvent) -> None:
        if each.event.kind is EventKind.COMMAND:
            raise ZeroDivisionError('a fault put in by the test')

    half.on_event = fail_at_a_command
    with half.connect(1) as kart:
        half._send(Request(0, HOLD, clock.now()))
        assert read_to_end(kart).endswith(encode(RED_RED))
    assert 'ZeroDivisionError' in half.ended.get(timeout=TIMEOUT)
    with pytest.raises(KartServerError, match='use the MSR'):
        half.command(ALL_KILL, clock.now())  # at once, and not after a wait for an answer
    assert half.exit_code() == 1
    half.stop(in_order=False)
    told = [each.event for each in events_of(begin.record)]
    assert CommandKind.KART_RED_RED in [each.command for each in told]
    assert 'is gone' in next(each.text for each in told if each.kind is EventKind.ENDED)
