# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The link on real sockets, without ROS: race control's end does what the test says."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import os
import resource
import socket
import threading
import time
from typing import Any

from evgp_kart_bridge.link import LinkClosedError, RaceControlLink
from evgp_protocol import connection as connections
from evgp_protocol.arbiter import Arbiter, Reaction, Settings, StopSource, Verdict
from evgp_protocol.connection import LinkSettings
from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState
from evgp_testing.part import PATIENCE
import pytest
from rig.bare_race_control import BareRaceControl

GRID_ACTIVE = RaceState.GRID_ACTIVE
GREEN_GREEN = RaceState.GREEN_GREEN
IN_GARAGE = RaceState.IN_GARAGE
RED_RED = RaceState.RED_RED


class Running:
    """A link, and all that it told."""

    other_end: socket.socket

    def __init__(self, port: int, frame_timeout: float = PATIENCE, own: str = '') -> None:
        self.verdicts: list[Verdict] = []
        self.failures: list[BaseException] = []
        self._news = threading.Condition()
        self.link = RaceControlLink(
            Arbiter(Settings(frame_timeout=frame_timeout), 1, f'the host at {port}'),
            LinkSettings('127.0.0.1', port, own),
            lambda verdict: self._keep(self.verdicts, verdict),
            lambda error: self._keep(self.failures, error),
        )
        self.link.start()

    def wait_for(self, found: Callable[[Verdict], object], since: int = 0) -> Verdict:
        """Return the first verdict of this kind, of those told after the first `since`."""

        def first() -> Verdict | None:
            return next((each for each in self.verdicts[since:] if found(each)), None)

        with self._news:
            self._news.wait_for(first, PATIENCE)
            verdict = first()
            assert verdict is not None, self.verdicts[since:]
            return verdict

    def wait_for_reason(self, reason: str, since: int = 0) -> Verdict:
        return self.wait_for(lambda verdict: reason in verdict.reason, since)

    def wait_for_state(self, state: RaceState) -> Verdict:
        return self.wait_for(lambda verdict: verdict.state is state)

    def wait_for_failure(self) -> BaseException:
        with self._news:
            assert self._news.wait_for(lambda: bool(self.failures), PATIENCE)
        return self.failures[0]

    def acknowledge(self, state: RaceState) -> Reaction:
        order = self.verdicts[-1].order
        given = self.link.give(lambda arbiter, now: arbiter.acknowledge(state, order, now))
        return given.result(PATIENCE)

    def obey(self, race: BareRaceControl, *states: RaceState) -> int:
        """
        Have race control command states, one after the other; acknowledge GRID_ACTIVE.

        :return: how much was told by then.
        """
        race.wait_for_connections(1)
        for state in states:
            race.say(state)
            self.wait_for_state(state)
            if state is GRID_ACTIVE:
                self.acknowledge(state)
        return len(self.verdicts)

    def _keep(self, kept: list[Any], told: object) -> None:
        with self._news:
            kept.append(told)
            self._news.notify_all()


StartLink = Callable[..., Running]


@pytest.fixture
def race(parts: contextlib.ExitStack) -> BareRaceControl:
    return parts.enter_context(BareRaceControl())


@pytest.fixture
def start_link(parts: contextlib.ExitStack) -> StartLink:
    """Return a function that starts a link; it takes what `Running` takes."""

    def start(*given: Any, **more: Any) -> Running:
        running = Running(*given, **more)
        parts.callback(running.link.stop)
        return running

    return start


def test_of_all_frames_that_came_together_the_last_alone_is_obeyed(
    race: BareRaceControl, start_link: StartLink
) -> None:
    running = start_link(race.port)
    before = running.obey(race, GRID_ACTIVE)
    race.say(*[GREEN_GREEN] * 100, RED_RED)
    running.wait_for(lambda verdict: verdict.commanded is RED_RED, before)
    assert GREEN_GREEN not in {verdict.state for verdict in running.verdicts[before:]}


def test_in_garage_is_acknowledged_at_once_even_if_another_frame_follows(
    race: BareRaceControl, start_link: StartLink
) -> None:
    running = start_link(race.port)
    race.wait_until_it_says(IN_GARAGE)
    running.wait_for(lambda verdict: verdict.commanded is IN_GARAGE and verdict.acknowledged)
    running.obey(race, GRID_ACTIVE)
    race.say(IN_GARAGE, RED_RED)
    race.wait_until_it_says(IN_GARAGE)


@pytest.mark.parametrize(
    ('frame_timeout', 'data', 'reason'),
    [
        (0.3, b'$IN_GARAGE', 'accepts but sends no race state'),  # what is malformed is no frame
        (
            PATIENCE,
            encode(IN_GARAGE) * 400,
            'race control never sends that much',
        ),  # all may be old
    ],
)
def test_neither_malformed_frames_nor_a_flood_keep_a_connection_alive(
    race: BareRaceControl, start_link: StartLink, frame_timeout: float, data: bytes, reason: str
) -> None:
    running = start_link(race.port, frame_timeout=frame_timeout)
    running.obey(race, IN_GARAGE)
    race.fall_silent()
    while not any(reason in verdict.reason for verdict in running.verdicts):
        with contextlib.suppress(OSError, AssertionError):  # the link has given it up
            race.send(data)
        time.sleep(0.01)


def test_silence_is_red_red_and_the_socket_is_given_up(
    race: BareRaceControl, start_link: StartLink
) -> None:
    running = start_link(race.port, frame_timeout=0.3)
    since = running.obey(race, GRID_ACTIVE, GREEN_GREEN)
    race.fall_silent()
    lost = running.wait_for(lambda verdict: not verdict.connected, since)
    assert (lost.state, lost.may_drive) == (RED_RED, False)
    assert f'the host at {race.port} was silent for 0.3 s' in lost.reason
    race.wait_for_connections(2)


def test_a_frame_that_waited_while_the_link_was_held_up_is_as_old_as_it_may_be(
    race: BareRaceControl, start_link: StartLink
) -> None:
    running = start_link(race.port, frame_timeout=2.0)
    since = running.obey(race, GRID_ACTIVE, GREEN_GREEN)
    race.fall_silent()
    held = threading.Event()

    def hold_up(arbiter: Arbiter, now: float) -> Reaction:
        held.set()
        time.sleep(1.6)  # that time passes is itself what is awaited
        return arbiter.tick(now)

    running.link.give(hold_up)
    assert held.wait(PATIENCE)
    sent_at = time.monotonic()
    race.send(encode(GREEN_GREEN))
    running.wait_for(lambda verdict: not verdict.connected, since)
    assert time.monotonic() - sent_at < 3.0


def test_what_came_while_the_link_was_held_up_in_connecting_is_not_obeyed(
    race: BareRaceControl, start_link: StartLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, 'CONNECT_TIMEOUT', 0.0)  # any hold-up is too long
    race.say(GRID_ACTIVE)
    running = start_link(race.port)
    running.wait_for_reason('does not answer')
    race.wait_for_connections(2)
    assert not any(verdict.connected for verdict in running.verdicts)


def test_green_green_is_not_obeyed_on_a_new_connection(
    race: BareRaceControl, start_link: StartLink
) -> None:
    running = start_link(race.port)
    since = running.obey(race, GRID_ACTIVE, GREEN_GREEN)
    race.hang_up()
    running.wait_for(lambda verdict: not verdict.connected, since)
    since = len(running.verdicts)
    again = running.wait_for(lambda verdict: verdict.commanded is GREEN_GREEN, since)
    assert (again.state, again.may_drive) == (RED_RED, False)
    assert {verdict.may_drive for verdict in running.verdicts[since:]} == {False}


def test_it_reconnects_after_every_loss_and_soon_where_it_was_heard(
    race: BareRaceControl, start_link: StartLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, 'FIRST_WAIT', 1e-3)
    monkeypatch.setattr(connections, 'LAST_WAIT', 1e6)
    running = start_link(race.port)
    for count in range(1, 21):  # by doubling, the last wait would be of minutes
        running.wait_for(lambda verdict: verdict.connected, len(running.verdicts))
        assert running.link.connection.made == count
        told = len(running.verdicts)
        race.hang_up()
        running.wait_for(lambda verdict: not verdict.connected, told)


def test_a_closed_port_is_named_and_tried_until_it_opens(
    race: BareRaceControl, start_link: StartLink, parts: contextlib.ExitStack
) -> None:
    race.close()
    running = start_link(race.port)
    running.wait_for_reason(f'127.0.0.1, port {race.port}, refuses the connection: is race')
    parts.enter_context(BareRaceControl(port=race.port))
    running.wait_for_state(IN_GARAGE)


@pytest.mark.parametrize('own', ['', '127.0.1.7'])
def test_a_connection_closed_at_once_names_its_ends_and_the_way_out(
    race: BareRaceControl, start_link: StartLink, own: str
) -> None:
    race.fall_silent()
    running = start_link(race.port, own=own)
    race.wait_for_connections(1)
    race.hang_up()
    ends = f'127.0.0.1, port {race.port} closed the connection from {own or "127.0.0.1"} at once: '
    closed = running.wait_for_reason(f'{ends}is that address in its roster')
    assert ('local_address' in closed.reason) is not bool(own)


def test_race_control_that_was_heard_and_closes_is_not_suspected_of_another_roster(
    race: BareRaceControl, start_link: StartLink
) -> None:
    running = start_link(race.port)
    running.obey(race, IN_GARAGE)
    race.fall_silent()
    for count in (1, 2):
        race.hang_up()
        race.wait_for_connections(count + 1)
    running.wait_for(lambda verdict: verdict.reason.endswith(' closed the connection'))
    running.wait_for(lambda verdict: verdict.reason.endswith(' at once'))
    assert not any('roster' in verdict.reason for verdict in running.verdicts)


def test_an_address_this_machine_does_not_have_is_named(
    race: BareRaceControl, start_link: StartLink
) -> None:
    # Of a block that nobody has (RFC 5737); it is only bound, and nothing is sent.
    running = start_link(race.port, own='192.0.2.1')
    running.wait_for_reason('this machine has no address 192.0.2.1')


@pytest.fixture
def many_files(parts: contextlib.ExitStack) -> None:
    """Have so many files open that the next ones are beyond what select.select can take."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 4096), hard))
    parts.callback(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
    for _ in range(1024):
        parts.callback(os.close, os.open(os.devnull, os.O_RDONLY))


@pytest.fixture
def running(start_link: StartLink, parts: contextlib.ExitStack) -> Running:
    """Return a link whose end at race control reads nothing."""
    listening = parts.enter_context(socket.create_server(('127.0.0.1', 0)))
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
    running = start_link(listening.getsockname()[1])
    running.other_end = parts.enter_context(listening.accept()[0])
    running.other_end.settimeout(PATIENCE)
    running.other_end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # no bursts
    running.other_end.sendall(encode(IN_GARAGE))
    running.wait_for_state(IN_GARAGE)
    return running


def test_a_program_with_many_open_files_has_a_link(many_files: None, running: Running) -> None:
    assert running.other_end.fileno() > 1023
    assert not running.failures


def test_race_control_that_does_not_read_is_lost(running: Running) -> None:
    with contextlib.suppress(OSError):  # the link has given it up, as it should
        while running.acknowledge(IN_GARAGE).verdict.connected:
            running.other_end.sendall(encode(IN_GARAGE))  # each is answered once
    running.wait_for_reason("does not read the kart's replies")


@pytest.mark.parametrize('fails', [False, True])
def test_the_end_and_a_fault_close_the_connection_and_nothing_is_told_any_more(
    running: Running, fails: bool
) -> None:
    def break_it(arbiter: Arbiter, now: float) -> Reaction:
        raise ZeroDivisionError

    if fails:
        given = running.link.give(break_it)
        assert isinstance(given.exception(PATIENCE), ZeroDivisionError)
        assert isinstance(running.wait_for_failure(), ZeroDivisionError)
    else:
        running.link.stop()
        assert not running.failures
    with contextlib.suppress(ConnectionResetError):
        while running.other_end.recv(1024):
            pass
    with pytest.raises(LinkClosedError):
        running.acknowledge(RED_RED)


def test_whoever_stops_a_kart_learns_that_the_stop_could_not_be_published(
    race: BareRaceControl, parts: contextlib.ExitStack
) -> None:
    def publish(verdict: Verdict) -> None:
        if verdict.team_stop:
            raise ZeroDivisionError

    arbiter, settings = Arbiter(Settings(), 1), LinkSettings('127.0.0.1', race.port)
    link = RaceControlLink(arbiter, settings, publish, lambda error: None)
    parts.callback(link.stop)
    link.start()
    given = link.give(lambda arbiter, now: arbiter.team_stop(StopSource.SERVICE, True, now))
    assert isinstance(given.exception(PATIENCE), ZeroDivisionError)
