# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The link on real sockets, without ROS: race control's end is a socket of the test."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import socket
import threading
import time

from evgp_kart_bridge import link
from evgp_kart_bridge.link import LinkClosedError, LinkSettings, LinkStatus, RaceControlLink
from evgp_protocol.arbiter import Arbiter, Reaction, Settings, Verdict
from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState
import pytest

PATIENCE = 20.0
GRID_ACTIVE = RaceState.GRID_ACTIVE
GREEN_GREEN = RaceState.GREEN_GREEN
IN_GARAGE = RaceState.IN_GARAGE
RED_RED = RaceState.RED_RED


class Running:
    """A link, and all that it told."""

    def __init__(self, port: int, frame_timeout: float, local_address: str) -> None:
        self.verdicts: list[Verdict] = []
        self.status = LinkStatus()
        self.failures: list[BaseException] = []
        self._news = threading.Condition()
        self.link = RaceControlLink(
            Arbiter(Settings(frame_timeout=frame_timeout), 1, f'the host at {port}'),
            LinkSettings('127.0.0.1', port, local_address),
            self._hear,
            self._fail,
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

    def obey(self, connection: socket.socket, *states: RaceState) -> None:
        """Have race control command states, one after the other; acknowledge GRID_ACTIVE."""
        for state in states:
            connection.sendall(encode(state))
            self.wait_for_state(state)
            if state is GRID_ACTIVE:
                self.acknowledge(state)

    def _hear(self, verdict: Verdict, status: LinkStatus) -> None:
        with self._news:
            self.verdicts.append(verdict)
            self.status = status
            self._news.notify_all()

    def _fail(self, error: BaseException) -> None:
        with self._news:
            self.failures.append(error)
            self._news.notify_all()


class RaceControl:
    """Race control's end of links: a listening socket, and the links that the test starts."""

    def __init__(self, parts: contextlib.ExitStack) -> None:
        self._parts = parts
        self.listen()

    def listen(self, port: int = 0) -> None:
        """Listen, at any port or at this one."""
        listening = socket.create_server(('127.0.0.1', port))
        self.listening = self._parts.enter_context(listening)
        self.listening.settimeout(PATIENCE)
        self.port: int = self.listening.getsockname()[1]

    def start_link(self, frame_timeout: float = PATIENCE, local_address: str = '') -> Running:
        running = Running(self.port, frame_timeout, local_address)
        self._parts.callback(running.link.stop)
        return running

    def accept(self) -> socket.socket:
        connection = self._parts.enter_context(self.listening.accept()[0])
        connection.settimeout(PATIENCE)
        return connection


@pytest.fixture
def race_control() -> Iterator[RaceControl]:
    with contextlib.ExitStack() as stack:
        yield RaceControl(stack)


def is_over(connection: socket.socket) -> bool:
    try:
        return connection.recv(1024) == b''
    except ConnectionResetError:
        return True


def test_of_all_frames_that_came_together_the_last_alone_is_obeyed(
    race_control: RaceControl,
) -> None:
    running = race_control.start_link()
    connection = race_control.accept()
    running.obey(connection, IN_GARAGE, GRID_ACTIVE)
    before = len(running.verdicts)
    connection.sendall(encode(GREEN_GREEN) * 100 + encode(RED_RED))
    running.wait_for_state(RED_RED)
    running.wait_for(lambda verdict: verdict.commanded is RED_RED, before)
    assert GREEN_GREEN not in {verdict.state for verdict in running.verdicts[before:]}


def test_valid_frames_are_obeyed_whatever_the_cuts_and_whatever_else_comes(
    race_control: RaceControl,
) -> None:
    running = race_control.start_link()
    connection = race_control.accept()
    connection.sendall(b'$PARTY;\x00\xff$' + b'x' * 5000 + b'$IN_GA')
    connection.sendall(b'RAGE;\r\n$')
    running.wait_for_state(IN_GARAGE)
    assert running.status.malformed > 1
    assert running.status.last_malformed
    connection.sendall(b'GRID_ACTIVE;')
    running.wait_for_state(GRID_ACTIVE)


def test_malformed_frames_do_not_keep_a_connection_alive(race_control: RaceControl) -> None:
    running = race_control.start_link(frame_timeout=0.3)
    connection = race_control.accept()
    running.obey(connection, IN_GARAGE)
    ended = threading.Event()

    def babble() -> None:
        try:
            while not ended.wait(0.01):
                connection.sendall(b'$IN_GARAGE')
        except OSError:
            pass  # the link has given it up, as it should

    babbling = threading.Thread(target=babble)
    babbling.start()
    try:
        named = f'the host at {race_control.port} accepts but sends no race state'
        running.wait_for(lambda verdict: named in verdict.reason)
    finally:
        ended.set()
        babbling.join()


def test_silence_is_red_red_and_the_socket_is_given_up(race_control: RaceControl) -> None:
    running = race_control.start_link(frame_timeout=0.3)
    connection = race_control.accept()
    running.obey(connection, GRID_ACTIVE, GREEN_GREEN)
    since = len(running.verdicts)
    lost = running.wait_for(lambda verdict: not verdict.connected, since)
    assert (lost.state, lost.may_drive) == (RED_RED, False)
    port = race_control.port
    assert f'the host at {port} was silent for 0.3 s' in lost.reason
    connection.recv(1024)  # the acknowledgement
    assert is_over(connection)


def test_a_frame_that_waited_while_the_link_was_held_up_is_as_old_as_it_may_be(
    race_control: RaceControl,
) -> None:
    running = race_control.start_link(frame_timeout=2.0)
    connection = race_control.accept()
    running.obey(connection, GRID_ACTIVE, GREEN_GREEN)
    since = len(running.verdicts)
    held = threading.Event()

    def hold_up(arbiter: Arbiter, now: float) -> Reaction:
        held.set()
        time.sleep(1.6)  # that time passes is itself what is awaited
        return arbiter.tick(now)

    running.link.give(hold_up)
    assert held.wait(PATIENCE)
    sent_at = time.monotonic()
    connection.sendall(encode(GREEN_GREEN))
    running.wait_for(lambda verdict: not verdict.connected, since)
    assert time.monotonic() - sent_at < 3.0


def test_green_green_is_not_obeyed_on_a_new_connection(race_control: RaceControl) -> None:
    running = race_control.start_link()
    connection = race_control.accept()
    running.obey(connection, GRID_ACTIVE, GREEN_GREEN)
    since = len(running.verdicts)
    connection.close()
    race_control.accept().sendall(encode(GREEN_GREEN))
    again = running.wait_for(lambda verdict: verdict.commanded is GREEN_GREEN, since)
    assert (again.state, again.may_drive) == (RED_RED, False)
    assert {verdict.may_drive for verdict in running.verdicts[since:]} == {False}


def test_it_reconnects_after_every_loss_and_soon_where_it_was_heard(
    race_control: RaceControl, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(link, 'FIRST_WAIT', 1e-3)
    monkeypatch.setattr(link, 'LAST_WAIT', 1e6)
    running = race_control.start_link()
    for count in range(1, 21):  # by doubling, the last wait would be of minutes
        connection = race_control.accept()
        connection.sendall(encode(IN_GARAGE))
        running.wait_for(lambda verdict: verdict.connected, len(running.verdicts))
        assert running.status.connections == count
        connection.close()
        running.wait_for(lambda verdict: not verdict.connected, len(running.verdicts))


def test_a_closed_port_is_named_and_tried_until_it_opens(race_control: RaceControl) -> None:
    race_control.listening.close()
    port = race_control.port
    running = race_control.start_link()
    refused = running.wait_for(lambda verdict: 'refuses' in verdict.reason)
    assert f'127.0.0.1, port {port}, refuses the connection: is race' in refused.reason
    race_control.listen(port)
    race_control.accept().sendall(encode(IN_GARAGE))
    running.wait_for_state(IN_GARAGE)


@pytest.mark.parametrize('own', ['', '127.0.1.7'])
def test_a_connection_closed_at_once_names_its_ends_and_the_way_out(
    race_control: RaceControl, own: str
) -> None:
    port = race_control.port
    running = race_control.start_link(local_address=own)
    connection = race_control.accept()
    assert connection.getpeername()[0] == (own or '127.0.0.1')
    connection.close()
    closed = running.wait_for(lambda verdict: 'roster' in verdict.reason)
    ends = f'127.0.0.1, port {port} closed the connection from {own or "127.0.0.1"} '
    assert ends in closed.reason
    assert ('local_address' in closed.reason) is not bool(own)
    assert running.status.failures == 1


def test_race_control_that_was_heard_and_closes_is_not_suspected_of_another_roster(
    race_control: RaceControl,
) -> None:
    running = race_control.start_link()
    connection = race_control.accept()
    running.obey(connection, IN_GARAGE)
    connection.shutdown(socket.SHUT_WR)
    running.wait_for(lambda verdict: verdict.reason.endswith('closed the connection'))
    for count in (2, 3):
        race_control.accept().close()
        running.wait_for(
            lambda verdict, count=count: running.status.failures >= count, len(running.verdicts)
        )
    assert not any('roster' in verdict.reason for verdict in running.verdicts)


def test_an_address_this_machine_does_not_have_is_named(race_control: RaceControl) -> None:
    # Of a block that nobody has (RFC 5737); it is only bound, and nothing is sent.
    running = race_control.start_link(local_address='192.0.2.1')
    running.wait_for(lambda verdict: 'this machine has no address 192.0.2.1' in verdict.reason)


def test_race_control_that_does_not_read_is_lost(race_control: RaceControl) -> None:
    race_control.listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
    running = race_control.start_link()
    running.obey(race_control.accept(), IN_GARAGE)
    outcome = running.acknowledge(IN_GARAGE)
    while outcome.verdict.connected:
        outcome = running.acknowledge(IN_GARAGE)
    running.wait_for(lambda verdict: "does not read the kart's replies" in verdict.reason)


@pytest.mark.parametrize('fails', [False, True])
def test_the_end_and_a_fault_close_the_connection_and_nothing_is_told_any_more(
    race_control: RaceControl, fails: bool
) -> None:
    running = race_control.start_link()
    connection = race_control.accept()

    def break_it(arbiter: Arbiter, now: float) -> Reaction:
        raise ZeroDivisionError

    if fails:
        given = running.link.give(break_it)
        assert isinstance(given.exception(PATIENCE), ZeroDivisionError)
        assert isinstance(running.wait_for_failure(), ZeroDivisionError)
    else:
        running.link.stop()
        assert not running.failures
    assert is_over(connection)
    with pytest.raises(LinkClosedError):
        running.acknowledge(RED_RED)
