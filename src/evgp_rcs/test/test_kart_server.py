# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The kart server on real sockets, without ROS."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
import concurrent.futures
import contextlib
import itertools
import queue
import socket
import threading
import time
from typing import Any, TypeVar

from evgp_node.roster import MOST_ENTRIES
from evgp_protocol import clock
from evgp_protocol.frames import encode
from evgp_protocol.hearing import FLOOD_BYTES, Hearing
from evgp_protocol.link import BEAT_RATE, Grade, unread
from evgp_protocol.loop import run as run_loop
from evgp_protocol.states import RaceState
from evgp_rcs.karts import server as kart_server
from evgp_rcs.karts.channel import Alive, Answered, Happened, Request, ServerSettings, Unpacker
from evgp_rcs.karts.link import KartLink
from evgp_rcs.karts.server import KartServer, ROS_HALF_SILENCE, STALL
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.inputs import Batch, Recovered, Stalled
from evgp_rcs.rules.race import (
    AlertKind,
    Answer,
    Command,
    Doubt,
    Event,
    EventKind,
    Kart,
    LastRun,
    Race,
    RaceMemory,
    RaceTimes,
    StampedEvent,
)
from evgp_rcs.rules.snapshot import Snapshot
from evgp_testing.wire_kart import kart_socket, read_to_end, read_until
import pytest
from recorded_races import as_seen

T = TypeVar('T')

TIMEOUT = 20.0
NO_BEAT = 0.001  # Hz: no second frame comes by itself while a test runs

GRID_ACTIVE = RaceState.GRID_ACTIVE
GREEN_GREEN = RaceState.GREEN_GREEN
IN_GARAGE = RaceState.IN_GARAGE
RED_RED = RaceState.RED_RED


def address_of(kart: int) -> str:
    return f'127.0.{2 + kart // 250}.{1 + kart % 250}'


class Running:
    """
    A server in a thread, with its karts, of which 1 and 2 are in the race, and what it told.

    It is the server's ROS half and record itself.
    """

    def __init__(self, beat_rate: float, times: RaceTimes, karts: int) -> None:
        self.events: list[Event] = []
        self.log: list[Batch] = []
        self.on_event: Callable[[Event], None] = lambda event: None
        self.failure: BaseException | None = None
        self.remembered: list[RaceMemory] = []
        self.on_saved: Callable[[int], None]
        self.record_works_at_once = True
        self.shown: list[float] = []  # when (s)
        self.record_trouble = ''
        self.gone = ''
        self.unsent = 0
        self._numbers = itertools.count()
        self._answers: dict[int, concurrent.futures.Future[Answer]] = {}
        self._said: queue.SimpleQueue[Request] = queue.SimpleQueue()
        self.ros_half_lives = True
        self._news = threading.Condition()
        numbers = range(1, karts + 1)
        entered = [Kart(each, '', each <= 2, address=address_of(each)) for each in numbers]
        self.race = Race(entered, times)
        self._settings = ServerSettings(host='127.0.0.1', port=0, beat_rate=beat_rate)
        self._listening: concurrent.futures.Future[tuple[str, int]] = concurrent.futures.Future()
        self._connected = contextlib.ExitStack()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        self.address = self._listening.result(TIMEOUT)

    def submit(self, command: Command, *, wakes: bool = True) -> concurrent.futures.Future[Answer]:
        """Have the ROS half send a command, from any thread."""
        number = next(self._numbers)
        answer = self._answers[number] = concurrent.futures.Future()
        self._said.put(Request(number, command, clock.now()))
        if wakes:
            self._loop.call_soon_threadsafe(self.server.take_commands)
        return answer

    def give(self, kind: CommandKind, kart: int | None = None, statement: bool = True) -> Answer:
        return self.submit(self.command(kind, kart, statement)).result(TIMEOUT)

    def command(
        self, kind: CommandKind, kart: int | None = None, statement: bool = True
    ) -> Command:
        """Return a command of an official who sees the race as it is."""
        return as_seen(self.race, kind, kart or 0, clock.now(), statement=statement)

    def connect(self, kart: int, receive_buffer: int = 0) -> socket.socket:
        """Return a connection from a kart's address, with a bounded receive buffer."""
        client = kart_socket(address_of(kart), self.address, receive_buffer)
        return self._connected.enter_context(client)

    def stop_serving(self) -> None:
        """Return once the server has ended."""
        self._thread.join(TIMEOUT)
        assert not self._thread.is_alive()

    def stop(self) -> None:
        """Close all connections, end the server, and return once it has."""
        self._connected.close()
        if self._thread.is_alive():
            try:
                self._loop.call_soon_threadsafe(self.server.end)
            except RuntimeError:
                pass  # it ended by itself meanwhile
        self._thread.join(TIMEOUT)

    def wait_for(self, kind: EventKind, kart: int = 0, count: int = 1) -> list[Event]:
        def found() -> list[Event]:
            events = [each for each in self.events if (each.kind, each.kart) == (kind, kart)]
            return events if len(events) >= count else []

        return self.wait_until(found)

    def wait_until(self, found: Callable[[], T]) -> T:
        """Return what a function returns about this server, once that is true."""
        with self._news:
            value = self._news.wait_for(found, TIMEOUT)
        assert value, [each.text for each in self.events]
        return value

    def _run(self) -> None:
        try:
            run_loop(self._serve())
        except BaseException as error:  # noqa: BLE001 - asserted by the test
            self.failure = error

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        outside: Any = self
        self.server = KartServer(self.race, self._settings, outside, outside)
        left_behind = Recovered(clock.now(), None, LastRun.ENDED)
        await self.server.serve(left_behind, self._listening.set_result)

    # ----- the ROS half; in the server's thread -------------------------------------------

    def receive(self) -> Iterator[Alive | Request]:
        if self.ros_half_lives:
            yield Alive(False)
        while not self._said.empty():
            yield self._said.get()

    def send(self, data: bytes) -> None:
        stamped: list[StampedEvent] = []
        with self._news:
            for message in Unpacker().feed(data):
                if isinstance(message, Answered):
                    self._answers[message.number].set_result(message.answer)
                elif isinstance(message, Snapshot):
                    self.shown.append(message.stamp)
                elif isinstance(message, Happened):
                    stamped += message.events
            self.events += [each.event for each in stamped]
            self._news.notify_all()
        for each in stamped:
            self.on_event(each.event)

    def lose(self, why: str) -> None:
        self.gone = why

    # ----- the record; in the server's thread ---------------------------------------------

    def put(self, batch: Batch) -> None:
        with self._news:
            self.log.append(batch)
            self._news.notify_all()

    def wait_until_shown(
        self, found: Callable[[Race, float], bool] = lambda race, at: True, times: int = 1
    ) -> float:
        """Return when the race was shown so often again and `found` was true of it (s)."""
        wanted = len(self.shown) + times
        return self.wait_until(
            lambda: (
                len(self.shown) >= wanted and found(self.race, self.shown[-1]) and self.shown[-1]
            )
        )

    def remember(self, memory: RaceMemory) -> None:
        with self._news:
            self.remembered.append(memory)
            self._news.notify_all()
        if self.record_works_at_once:
            self._loop.call_soon(self.on_saved, memory.gridded)

    def trouble(self) -> str:
        return self.record_trouble


Run = Callable[..., Running]


@pytest.fixture
def run() -> Iterator[Run]:
    """Return a function that starts a server."""
    with contextlib.ExitStack() as stack:

        def start(beat_rate: float = 50.0, karts: int = 3, **times: float) -> Running:
            running = Running(beat_rate, RaceTimes(**{'pause': 0.0, **times}), karts)
            stack.callback(running.stop)
            return running

        yield start


def test_a_stop_has_been_written_when_it_is_answered(run: Run) -> None:
    running = run(NO_BEAT)
    clients = [running.connect(kart) for kart in (1, 2, 3)]
    for client in clients:
        read_until(client, IN_GARAGE)
    running.give(CommandKind.ALL_KILL)
    for client in clients:
        client.setblocking(False)  # it is there now, or recv raises
        assert client.recv(4096) == encode(RED_RED)


def test_an_address_outside_the_roster_gets_no_frame_and_none_keeps_another_from_being_told(
    run: Run,
) -> None:
    running = run()
    for stranger in [9] * 20 + [8]:
        assert read_to_end(running.connect(stranger)) == b''
    running.wait_until(lambda: any(address_of(8) in each.text for each in running.events))
    assert 0 < sum(address_of(9) in each.text for each in running.events) < 20


def test_two_programs_that_push_each_other_out_raise_one_alert_and_few_events(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kart_server, 'TAKEOVERS', (3, 1.0))
    monkeypatch.setattr(kart_server, 'CONNECTIONS', (50, 2.0))
    running = run()
    before = last = running.connect(1)
    read_until(last, IN_GARAGE)
    for _ in range(39):
        before, last = last, running.connect(1)
        read_until(last, IN_GARAGE)
        read_to_end(before)
    assert running.race.karts[1].contested
    assert not running.give(CommandKind.GRID_ACTIVE).success
    raised = running.wait_for(EventKind.ALERT_RAISED, 1)
    assert [each.alert for each in raised] == [AlertKind.TWO_PROGRAMS]
    running.wait_for(EventKind.ALERT_CLEARED, 1)
    assert running.give(CommandKind.GRID_ACTIVE).success
    told = [each for each in running.events if each.kart == 1]
    assert len(told) < 80  # of the 120 and more that these connections cause
    running.give(CommandKind.ALL_KILL)
    read_until(last, RED_RED)


def test_every_kart_is_sent_in_garage_as_it_connects_even_while_race_control_is_busy(
    run: Run,
) -> None:
    running = run(NO_BEAT, karts=MOST_ENTRIES)
    all_there = threading.Event()

    def be_busy(event: Event) -> None:
        if event.kind is EventKind.CONNECTED:
            all_there.wait(2 * TIMEOUT)

    running.on_event = be_busy
    try:
        # Each waits until the kernel has taken it; one that finds the queue full waits in vain.
        clients = [running.connect(kart) for kart in running.race.karts]
    finally:
        all_there.set()
    for client in clients:
        assert client.recv(4096).startswith(encode(IN_GARAGE))


def on_the_grid(running: Running) -> tuple[Running, socket.socket, socket.socket]:
    """Have karts 1 and 2 acknowledge GRID_ACTIVE, and what the race remembers be saved."""
    one, two = running.connect(1), running.connect(2)
    running.wait_for(EventKind.CONNECTED, 1)
    running.wait_for(EventKind.CONNECTED, 2)
    running.give(CommandKind.GRID_ACTIVE)
    for number, client in ((1, one), (2, two)):
        read_until(client, GRID_ACTIVE)
        client.sendall(encode(GRID_ACTIVE))
        running.wait_for(EventKind.ACKNOWLEDGED, number)
    if running.record_works_at_once:
        running.wait_until_shown(
            lambda race, at: race.availability(CommandKind.GREEN_GREEN, 0, at).available
        )
    return running, one, two


def test_an_acknowledgement_that_waited_unread_when_the_command_came_counts_for_nothing(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The kart's kernel has answered the command before race control looks again.
    monkeypatch.setattr('evgp_rcs.karts.link.unanswered', lambda _: 0)
    running = run(NO_BEAT)
    client = running.connect(1)
    running.wait_for(EventKind.CONNECTED, 1)

    def say_early(event: Event) -> None:
        # In the server's own thread: what kart 1 says now lies unread when the stop is judged.
        if (event.kind, event.kart) == (EventKind.CONNECTED, 2):
            client.sendall(encode(RED_RED))
            running.submit(Command(CommandKind.ALL_KILL))

    running.on_event = say_early
    running.connect(2)
    running.wait_for(EventKind.REPORTED, 1)
    assert not running.race.karts[1].acknowledged
    client.sendall(encode(RED_RED))
    running.wait_for(EventKind.ACKNOWLEDGED, 1)


def test_a_word_that_may_be_an_old_one_is_told_with_its_wait_and_counts_after_it(
    run: Run,
) -> None:
    running = run(BEAT_RATE, karts=1, settle_time=2.5)
    client = running.connect(1)
    for count in (1, 2):  # a second stop, just after the first one was released
        running.give(CommandKind.ALL_KILL)
        read_until(client, RED_RED)
        client.sendall(encode(RED_RED))  # once, as a kart that says each change
        if count == 1:
            running.wait_until_shown(lambda race, at: race.karts[1].stands)
            assert running.give(CommandKind.IN_GARAGE).success
            read_until(client, IN_GARAGE)
    (told,) = running.wait_for(EventKind.REPORTED, 1)
    assert 'perhaps in answer to an earlier command' in told.text
    counts_at = running.race.karts[1].counts_at
    assert counts_at is None or counts_at > clock.now()
    running.wait_for(EventKind.ACKNOWLEDGED, 1, count=2)


def test_a_kart_that_is_heard_to_read_late_has_a_poor_link(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Hearing, 'behind', 1.2)
    running = run(beat_rate=20.0)
    running.connect(1)
    (event,) = running.wait_for(EventKind.LINK_GRADE, 1)
    assert event.text.endswith('is poor: the kart may read a stop 1.2 s late')


def test_a_stop_that_lies_unread_is_judged_before_what_a_kart_says(run: Run) -> None:
    running = run(NO_BEAT)
    client = running.connect(1)
    read_until(client, IN_GARAGE)
    answer = running.submit(Command(CommandKind.ALL_KILL), wakes=False)  # only the kart does
    client.sendall(encode(RED_RED))
    read_until(client, RED_RED)
    running.wait_for(EventKind.REPORTED, 1)
    assert answer.result(TIMEOUT).success
    kinds = [each.kind for each in running.events]
    assert kinds.index(EventKind.COMMAND) < kinds.index(EventKind.REPORTED)
    assert not running.race.karts[1].acknowledged


def test_a_stop_that_lies_unread_is_judged_before_the_race_is_shown(run: Run) -> None:
    running = run(NO_BEAT)
    stopped: list[concurrent.futures.Future[Answer]] = []

    def stop(event: Event) -> None:
        # In the server's own thread: what was published is shown next, and nothing else wakes it.
        if event.command is CommandKind.CLOSE_TRACK:
            stopped.append(running.submit(Command(CommandKind.ALL_KILL), wakes=False))

    running.on_event = stop
    running.give(CommandKind.CLOSE_TRACK)
    running.wait_for(EventKind.RACE_STATE)
    assert stopped[0].result(TIMEOUT).success


def test_a_kart_that_goes_on_flooding_is_dropped(run: Run) -> None:
    running = run(beat_rate=12.0)
    client = running.connect(1)
    running.wait_for(EventKind.CONNECTED, 1)
    hearing = running.server._links[1]._hearing
    with contextlib.suppress(ConnectionError):
        while True:
            client.sendall(b'$' * 65536)
    (event,) = running.wait_for(EventKind.DISCONNECTED, 1)
    assert 'floods' in event.text
    assert hearing._read < 2 * FLOOD_BYTES * (hearing._beats + 1)  # the rest was left unread


def test_an_order_is_delivered_when_the_karts_kernel_answers_and_before_it_is_acknowledged(
    run: Run,
) -> None:
    running = run(beat_rate=20.0)
    client = running.connect(3)
    running.give(CommandKind.KART_RED_RED, 3)
    *_, event = running.wait_for(EventKind.DELIVERED, 3)  # though its program has read nothing
    assert event.state is RED_RED
    assert 0.0 <= event.after < TIMEOUT
    assert running.race.karts[3].delivered_after is not None
    assert not running.race.karts[3].acknowledged
    read_until(client, RED_RED)
    running.give(CommandKind.ALL_KILL)  # it is sent RED_RED already: no order, no delivery
    client.sendall(encode(RED_RED))
    running.wait_for(EventKind.ACKNOWLEDGED, 3)
    told = [each.kind for each in running.events if each.kart == 3 and each.state is RED_RED]
    assert told == [EventKind.KART_STATE, EventKind.DELIVERED, EventKind.ACKNOWLEDGED]


@pytest.mark.parametrize('tells', [True, False], ids=['Linux', 'another kernel'])
def test_each_link_is_measured_as_the_kernel_tells_and_a_new_connection_begins_unknown(
    run: Run, monkeypatch: pytest.MonkeyPatch, tells: bool
) -> None:
    if not tells:
        monkeypatch.setattr('evgp_rcs.karts.link.read', lambda link: None)
    running = run(beat_rate=20.0)
    client = running.connect(1)
    (event,) = running.wait_for(EventKind.LINK_GRADE, 1)
    link = running.race.karts[1].link
    assert event.grade is link.grade is Grade.GOOD
    assert (link.round_trip is not None) is tells
    running.wait_for(EventKind.DELIVERED, 1)
    client.shutdown(socket.SHUT_WR)  # its program may go on reading, but says no more
    running.wait_for(EventKind.DISCONNECTED, 1)
    assert running.race.karts[1].link.grade is Grade.UNKNOWN


def test_only_a_stop_that_the_karts_kernel_has_answered_to_its_end_has_arrived(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    running = run(beat_rate=20.0)
    client = running.connect(3)
    running.wait_for(EventKind.DELIVERED, 3)  # so all that was sent before the stop is answered
    link = running.server._links[3]
    link._send_timeout = TIMEOUT
    order = link.order

    def order_unanswered(state: RaceState, serial: int) -> None:
        before = link._answers.written
        monkeypatch.setattr(
            'evgp_rcs.karts.link.unanswered', lambda _: link._answers.written - before
        )
        order(state, serial)

    monkeypatch.setattr(link, 'order', order_unanswered)
    running.give(CommandKind.KART_RED_RED, 3)
    client.sendall(encode(RED_RED) + b'.')
    running.wait_for(EventKind.MALFORMED, 3)
    assert not any(each.kind is EventKind.ACKNOWLEDGED for each in running.events)
    assert running.race.karts[3].delivered_after is None

    def say_just_before_the_answer() -> None:
        # In the server's own thread: this lies unread when race control looks once more.
        client.sendall(encode(RED_RED) + b'.')
        while not unread(link._socket):
            pass
        link._look(running.server.now())
        monkeypatch.undo()

    running._loop.call_soon_threadsafe(say_just_before_the_answer)
    running.wait_for(EventKind.MALFORMED, 3, count=2)
    running.wait_for(EventKind.DELIVERED, 3, count=2)
    assert not any(each.kind is EventKind.ACKNOWLEDGED for each in running.events)
    client.sendall(encode(RED_RED))
    running.wait_for(EventKind.ACKNOWLEDGED, 3)


def test_a_kart_that_never_reads_has_one_frame_before_a_stop_and_is_dropped_and_the_others_are_not(
    run: Run,
) -> None:
    running = run(beat_rate=500.0)
    running.connect(3, receive_buffer=1024)
    running.wait_for(EventKind.CONNECTED, 3)
    link = running.server._links[3]
    link._send_timeout = TIMEOUT
    # Bytes that have not left are not enough: they may wait for an answer that is only late.
    running.wait_until_shown(lambda race, at: race.karts[3].link.grade is Grade.POOR)
    other = running.connect(1)
    received = b''
    while received.count(b';') < 50:  # so many beats later
        received += other.recv(65536)
    assert 0 < link._unsent() <= len(encode(IN_GARAGE))
    link._send_timeout = running._settings.send_timeout
    # It is gone whatever still waits to be written.
    running._loop.call_soon_threadsafe(link._transport.write, bytes(1 << 24))
    running.wait_for(EventKind.DISCONNECTED, 3)
    told = [each.kart for each in running.events if each.kind is EventKind.DISCONNECTED]
    assert told == [3]


def test_the_race_is_shown_again_when_a_pause_ends(run: Run) -> None:
    running = run(NO_BEAT, pause=0.3)
    running.give(CommandKind.ALL_KILL)
    shown = running.wait_until_shown(
        lambda race, at: race.availability(CommandKind.KART_IN_GARAGE, 3, at).available
    )
    assert shown >= running.race.paused_until


def test_a_stop_waits_for_no_beat_that_has_begun(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    running = run()
    for number in (1, 2):
        other = running.connect(number)
        running.wait_for(EventKind.CONNECTED, number)
    beat = KartLink.beat
    taken = threading.Event()

    def beat_amid_which_a_stop_comes(link: KartLink) -> None:
        beat(link)
        if link.number == 1 and not taken.is_set():
            with contextlib.suppress(BlockingIOError):  # what the beats before have sent
                other.recv(65536, socket.MSG_DONTWAIT)
            running.submit(Command(CommandKind.ALL_KILL))
            taken.set()

    monkeypatch.setattr(KartLink, 'beat', beat_amid_which_a_stop_comes)
    assert taken.wait(TIMEOUT)
    assert other.recv(4096).startswith(encode(RED_RED))


def test_a_start_that_waited_while_race_control_was_held_up_is_refused(run: Run) -> None:
    running = run(pause=TIMEOUT)
    waiting = []

    def hold_up(event: Event) -> None:
        if event.kind is EventKind.CONNECTED:
            waiting.append(running.submit(running.command(CommandKind.GRID_ACTIVE)))
            time.sleep(STALL + 0.1)  # as a machine that was suspended

    running.on_event = hold_up
    running.connect(1)
    running.wait_for(EventKind.COMMAND)
    answer = waiting[0].result(TIMEOUT)
    assert not answer.success
    assert 'race control stalled for' in answer.message


def test_an_error_nobody_foresaw_sends_red_red_to_every_kart_and_ends_the_server(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    running = run()
    client = running.connect(3)
    read_until(client, IN_GARAGE)

    def broken(now: float) -> None:
        raise ZeroDivisionError('a fault put in by the test')

    monkeypatch.setattr(running.race, 'tick', broken)

    assert read_to_end(client).endswith(encode(RED_RED))
    running.stop_serving()
    assert isinstance(running.failure, ZeroDivisionError)


def test_a_kart_that_connects_just_as_race_control_ends_is_sent_red_red(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    running = run()
    assert running.give(CommandKind.GRID_ACTIVE).success

    def as_it_ends(*given: Any) -> KartLink:
        running.server.end()
        return KartLink(*given)

    monkeypatch.setattr(kart_server, 'KartLink', as_it_ends)
    client = running.connect(1)
    running.stop_serving()
    assert read_to_end(client) == encode(RED_RED)


def test_a_command_that_waits_when_the_server_stops_is_answered_with_use_the_msr(
    run: Run,
) -> None:
    running = run()
    answers = []

    def stop() -> None:
        running.server.end()
        running.server.take_commands = lambda: None  # type: ignore[method-assign]
        answers.append(running.submit(Command(CommandKind.ALL_KILL)))
        running.server._hear(running._said.get())

    running._loop.call_soon_threadsafe(stop)
    running.stop_serving()
    answer = answers[0].result(TIMEOUT)
    assert not answer.success
    assert 'use the MSR' in answer.message


# ----- GREEN_GREEN needs the record, and no stop does ---------------------------------------


def test_karts_start_only_once_the_disk_knows_that_they_may_move(run: Run) -> None:
    running = run()
    running.record_works_at_once = False
    running, one, two = on_the_grid(running)
    assert not running.give(CommandKind.GREEN_GREEN).success
    running.wait_until_shown(times=2)  # and remembered after the first time
    memory = running.remembered[-1]
    assert memory.karts[1].doubt is memory.karts[2].doubt is Doubt.MOVING
    running.record_trouble = 'the disk is full'
    running._loop.call_soon_threadsafe(running.on_saved, memory.gridded)
    # No beat comes in between: the server looks at the record before it judges a start.
    assert 'the disk is full' in running.give(CommandKind.GREEN_GREEN).message
    running.record_trouble = ''
    running.wait_until_shown(times=2)
    assert running.give(CommandKind.GREEN_GREEN).success
    for client in (one, two):
        read_until(client, GREEN_GREEN)
    assert running.give(CommandKind.ALL_KILL).success  # which waits for no disk


def test_an_orderly_end_on_the_grid_leaves_no_kart_that_may_be_moving(run: Run) -> None:
    running, _, _ = on_the_grid(run())
    assert running.remembered[-1].karts[1].doubt is Doubt.MOVING
    running.stop()
    assert running.remembered[-1].karts[1].doubt is Doubt.GRID


# ----- the ROS half ------------------------------------------------------------------------


def test_a_kart_server_that_was_held_up_does_not_take_the_ros_half_for_silent(run: Run) -> None:
    running = run()

    def hold_up(event: Event) -> None:
        if event.kind is EventKind.CONNECTED:
            running.ros_half_lives = False
            # As a process that was stopped, and the other as well.
            time.sleep(STALL + ROS_HALF_SILENCE)
            running.on_event = lambda event: None

    running.on_event = hold_up
    running.connect(1)
    running.wait_until(
        lambda: any(isinstance(each, Stalled) for batch in running.log for each in batch.entries)
    )
    assert running.give(CommandKind.CLOSE_TRACK).success
    assert running.failure is None


def test_a_ros_half_that_accepts_nothing_is_shown_no_race_and_given_up_in_the_end(
    run: Run,
) -> None:
    running = run()
    running.unsent = 1
    shown, remembered = len(running.shown), len(running.remembered)
    running.wait_until(lambda: len(running.remembered) > remembered + 1)
    assert len(running.shown) <= shown + 1  # one may have been under way
    running.unsent = kart_server.TO_ROS_HALF_BYTES + 1
    running.stop_serving()
    assert 'no longer accepts' in str(running.failure)
