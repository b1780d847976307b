# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The link on real sockets, without ROS: race control's end is a socket of the test."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import socket
import threading

from evgp_kart_bridge.link import LinkClosedError, LinkSettings, LinkStatus, RaceControlLink
from evgp_protocol.arbiter import Arbiter, Names, Reaction, Settings, Verdict
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
            Arbiter(Settings(frame_timeout=frame_timeout), 1, Names(f'the host at {port}')),
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


StartLink = Callable[..., Running]


@pytest.fixture
def parts() -> Iterator[contextlib.ExitStack]:
    with contextlib.ExitStack() as stack:
        yield stack


@pytest.fixture
def race_control(parts: contextlib.ExitStack) -> socket.socket:
    """Return a listening socket in race control's place."""
    listening = parts.enter_context(socket.create_server(('127.0.0.1', 0)))
    listening.settimeout(PATIENCE)
    return listening


@pytest.fixture
def start_link(parts: contextlib.ExitStack) -> StartLink:
    """Return a function that starts a link; at the end it must have had no failure."""

    def start(
        to: socket.socket | int, frame_timeout: float = PATIENCE, local_address: str = ''
    ) -> Running:
        port = to if isinstance(to, int) else to.getsockname()[1]
        running = Running(port, frame_timeout, local_address)
        parts.callback(running.link.stop)
        return running

    return start


@pytest.fixture
def accept(parts: contextlib.ExitStack) -> Callable[[socket.socket], socket.socket]:
    """Return a function that accepts the next connection."""

    def take(listening: socket.socket) -> socket.socket:
        connection = parts.enter_context(listening.accept()[0])
        connection.settimeout(PATIENCE)
        return connection

    return take


Accept = Callable[[socket.socket], socket.socket]


def is_over(connection: socket.socket) -> bool:
    try:
        return connection.recv(1024) == b''
    except ConnectionResetError:
        return True


def test_what_race_control_commands_is_told_whatever_the_cuts(
    start_link: StartLink, race_control: socket.socket, accept: Accept
) -> None:
    running = start_link(race_control)
    connection = accept(race_control)
    connection.sendall(b'$IN_GA')
    connection.sendall(b'RAGE;\r\n$')
    running.wait_for_state(IN_GARAGE)
    connection.sendall(b'GRID_ACTIVE;')
    running.wait_for_state(GRID_ACTIVE)


def test_of_all_frames_that_came_together_the_last_alone_is_obeyed(
    start_link: StartLink, race_control: socket.socket, accept: Accept
) -> None:
    running = start_link(race_control)
    connection = accept(race_control)
    running.obey(connection, IN_GARAGE, GRID_ACTIVE)
    before = len(running.verdicts)
    connection.sendall(encode(GREEN_GREEN) * 100 + encode(RED_RED))
    running.wait_for_state(RED_RED)
    running.wait_for(lambda verdict: verdict.commanded is RED_RED, before)
    assert GREEN_GREEN not in {verdict.state for verdict in running.verdicts[before:]}


def test_the_state_is_told_again_and_again(
    start_link: StartLink, race_control: socket.socket, accept: Accept
) -> None:
    running = start_link(race_control)
    running.obey(accept(race_control), IN_GARAGE)
    since = len(running.verdicts)
    running.wait_for(lambda verdict: len(running.verdicts) >= since + 3)
    assert {verdict.state for verdict in running.verdicts[since:]} == {IN_GARAGE}


def test_an_accepted_acknowledgement_goes_out_and_a_refused_one_does_not(
    start_link: StartLink, race_control: socket.socket, accept: Accept
) -> None:
    running = start_link(race_control)
    connection = accept(race_control)
    connection.sendall(encode(GRID_ACTIVE))
    running.wait_for_state(GRID_ACTIVE)
    refused = running.acknowledge(RED_RED).answer
    assert refused is not None
    assert not refused.accepted
    accepted = running.acknowledge(GRID_ACTIVE).answer
    assert accepted is not None
    assert accepted.accepted
    assert connection.recv(1024) == encode(GRID_ACTIVE)


def test_malformed_frames_are_counted_and_hide_no_valid_one(
    start_link: StartLink, race_control: socket.socket, accept: Accept
) -> None:
    running = start_link(race_control)
    accept(race_control).sendall(b'$PARTY;\x00\xff$' + b'x' * 5000 + encode(IN_GARAGE))
    running.wait_for_state(IN_GARAGE)
    assert running.status.malformed > 1
    assert running.status.last_malformed


def test_malformed_frames_do_not_keep_a_connection_alive(
    start_link: StartLink, race_control: socket.socket, accept: Accept
) -> None:
    running = start_link(race_control, frame_timeout=0.3)
    connection = accept(race_control)
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
        running.wait_for(lambda verdict: 'sends no race state' in verdict.reason)
    finally:
        ended.set()
        babbling.join()


def test_silence_is_red_red_and_the_socket_is_given_up(
    start_link: StartLink, race_control: socket.socket, accept: Accept
) -> None:
    running = start_link(race_control, frame_timeout=0.3)
    connection = accept(race_control)
    running.obey(connection, GRID_ACTIVE, GREEN_GREEN)
    since = len(running.verdicts)
    lost = running.wait_for(lambda verdict: not verdict.connected, since)
    assert (lost.state, lost.may_drive) == (RED_RED, False)
    port = race_control.getsockname()[1]
    assert f'the host at {port} was silent for 0.3 s' in lost.reason
    connection.recv(1024)  # the acknowledgement
    assert is_over(connection)


def test_green_green_is_not_obeyed_on_a_new_connection(
    start_link: StartLink, race_control: socket.socket, accept: Accept
) -> None:
    running = start_link(race_control)
    connection = accept(race_control)
    running.obey(connection, GRID_ACTIVE, GREEN_GREEN)
    since = len(running.verdicts)
    connection.close()
    accept(race_control).sendall(encode(GREEN_GREEN))
    again = running.wait_for(lambda verdict: verdict.commanded is GREEN_GREEN, since)
    assert (again.state, again.may_drive) == (RED_RED, False)
    assert {verdict.may_drive for verdict in running.verdicts[since:]} == {False}


def test_it_reconnects_after_every_loss(
    start_link: StartLink, race_control: socket.socket, accept: Accept
) -> None:
    running = start_link(race_control)
    for count in range(1, 4):
        connection = accept(race_control)
        connection.sendall(encode(IN_GARAGE))
        running.wait_for(lambda verdict: verdict.connected, len(running.verdicts))
        assert running.status.connections == count
        connection.close()
        running.wait_for(lambda verdict: not verdict.connected, len(running.verdicts))


def test_a_closed_port_is_named_and_tried_until_it_opens(
    start_link: StartLink, parts: contextlib.ExitStack, accept: Accept
) -> None:
    with socket.create_server(('127.0.0.1', 0)) as reserved:
        port = reserved.getsockname()[1]
    running = start_link(port)
    refused = running.wait_for(lambda verdict: 'refuses' in verdict.reason)
    assert f'127.0.0.1, port {port}, refuses the connection: is race' in refused.reason
    opened = parts.enter_context(socket.create_server(('127.0.0.1', port)))
    opened.settimeout(PATIENCE)
    accept(opened).sendall(encode(IN_GARAGE))
    running.wait_for_state(IN_GARAGE)


@pytest.mark.parametrize('own', ['', '127.0.1.7'])
def test_a_connection_closed_at_once_names_its_ends_and_the_way_out(
    start_link: StartLink, race_control: socket.socket, accept: Accept, own: str
) -> None:
    port = race_control.getsockname()[1]
    running = start_link(race_control, local_address=own)
    connection = accept(race_control)
    assert connection.getpeername()[0] == (own or '127.0.0.1')
    connection.close()
    closed = running.wait_for(lambda verdict: 'roster' in verdict.reason)
    ends = f'127.0.0.1, port {port} closed the connection from {own or "127.0.0.1"} '
    assert ends in closed.reason
    assert ('local_address' in closed.reason) is not bool(own)
    assert running.status.failures == 1


def test_race_control_that_was_heard_before_is_not_suspected_of_another_roster(
    start_link: StartLink, race_control: socket.socket, accept: Accept
) -> None:
    running = start_link(race_control)
    connection = accept(race_control)
    running.obey(connection, IN_GARAGE)
    connection.close()
    for count in (2, 3):
        accept(race_control).close()
        running.wait_for(
            lambda verdict, count=count: running.status.failures >= count, len(running.verdicts)
        )
    assert not any('roster' in verdict.reason for verdict in running.verdicts)


def test_a_host_that_accepts_and_says_nothing_is_named(
    start_link: StartLink, race_control: socket.socket, accept: Accept
) -> None:
    running = start_link(race_control, frame_timeout=0.3)
    accept(race_control)
    port = race_control.getsockname()[1]
    running.wait_for(
        lambda verdict: f'the host at {port} accepts but sends no race state' in verdict.reason
    )


def test_a_connection_closed_in_the_race_says_so(
    start_link: StartLink, race_control: socket.socket, accept: Accept
) -> None:
    running = start_link(race_control)
    connection = accept(race_control)
    running.obey(connection, IN_GARAGE)
    connection.shutdown(socket.SHUT_WR)
    running.wait_for(lambda verdict: 'closed the connection' in verdict.reason)


def test_an_address_this_machine_does_not_have_is_named(
    start_link: StartLink, race_control: socket.socket
) -> None:
    # Of a block that nobody has (RFC 5737); it is only bound, and nothing is sent.
    running = start_link(race_control, local_address='192.0.2.1')
    running.wait_for(lambda verdict: 'this machine has no address 192.0.2.1' in verdict.reason)


def test_race_control_that_does_not_read_is_lost(
    start_link: StartLink, race_control: socket.socket, accept: Accept
) -> None:
    race_control.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
    running = start_link(race_control)
    running.obey(accept(race_control), IN_GARAGE)
    outcome = running.acknowledge(IN_GARAGE)
    while outcome.verdict.connected:
        outcome = running.acknowledge(IN_GARAGE)
    running.wait_for(lambda verdict: "does not read the kart's replies" in verdict.reason)


def test_the_end_closes_the_connection(
    start_link: StartLink, race_control: socket.socket, accept: Accept
) -> None:
    running = start_link(race_control)
    connection = accept(race_control)
    running.link.stop()
    assert is_over(connection)
    assert not running.failures
    with pytest.raises(LinkClosedError):
        running.acknowledge(RED_RED)


def test_a_fault_ends_the_link_and_nothing_is_told_any_more(
    start_link: StartLink, race_control: socket.socket, accept: Accept
) -> None:
    running = start_link(race_control)
    connection = accept(race_control)

    def break_it(arbiter: Arbiter, now: float) -> Reaction:
        raise ZeroDivisionError

    given = running.link.give(break_it)
    assert isinstance(given.exception(PATIENCE), ZeroDivisionError)
    assert isinstance(running.wait_for_failure(), ZeroDivisionError)
    assert is_over(connection)
    with pytest.raises(LinkClosedError):
        running.acknowledge(RED_RED)
