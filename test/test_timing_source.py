# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The node `timing_source` on real ports: a device's passings are heard, and how it is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import os
import socket
import tty
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from evgp_node.results import Passing
from evgp_node.spinning import Spinning
from evgp_rcs_msgs import msg
from evgp_testing.domains import free_port
from evgp_testing.part import PATIENCE
from evgp_testing.process import Process
from evgp_testing.ros_side import RosSide
from evgp_timing import node
from evgp_timing.passings import Event
from evgp_timing.timekeeper import passing_of
from evgp_timing.window import Client
import pytest
from rclpy.parameter import Parameter
from recorded_bytes import P3_LIVE, p3_passing, RECORDED

Start = Callable[..., None]


class Listener(RosSide):
    """The timekeeper's ear, and that of whoever looks at diagnostics."""

    def __init__(self, domain: int, name: str = 'listener') -> None:
        super().__init__(name, domain)
        self.passings = self.hear(msg.Passing, '/rcs/passings', node.PASSINGS_QOS)
        self._diagnostics = self.hear(DiagnosticArray, '/diagnostics')
        self.spin()

    def wait_for_passings(self, count: int) -> list[msg.Passing]:
        """Return the first so many passings."""
        self.wait_until(
            lambda: len(self.passings) >= count, lambda: f'{count} passings: {self.passings}'
        )
        return self.passings[:count]

    def statuses(self, level: bytes, **values: str) -> list[DiagnosticStatus]:
        """Return the newest status if it has this level and these values."""
        newest = [each for array in self._diagnostics[-1:] for each in array.status]
        told = {(each.key, each.value) for status in newest for each in status.values}
        return [each for each in newest if each.level == level and {*values.items()} <= told]

    def wait_for_status(self, level: bytes, **values: str) -> DiagnosticStatus:
        """Return the status once it has this level and these values."""
        (status,) = self.wait_until(
            lambda: self.statuses(level, **values),
            lambda: f'{level!r} {values}: {self._diagnostics[-1:]}',
        )
        return status


@pytest.fixture
def listener(parts: contextlib.ExitStack, domain: int) -> Listener:
    """Return somebody who hears all."""
    return parts.enter_context(Listener(domain))


@pytest.fixture
def start(parts: contextlib.ExitStack, listener: Listener) -> Start:
    """Return a function that starts the node with these parameters in this process."""

    def start(**parameters: object) -> None:
        failures: list[BaseException] = []
        source = node.TimingSource(
            failures.append,
            context=listener.context,
            use_global_arguments=False,
            parameter_overrides=[Parameter(name, value=it) for name, it in parameters.items()],
        )
        spinning = Spinning(source, failures.append)

        def end() -> None:
            source.close()
            assert spinning.stop(PATIENCE)
            source.destroy_node()
            assert not failures

        parts.callback(end)

    return start


@pytest.fixture
def server() -> Iterator[socket.socket]:
    """Return where a decoder listens."""
    with socket.create_server(('127.0.0.1', free_port())) as listening:
        listening.settimeout(30)
        yield listening


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    """Return the device's end of a serial line, and the path of the other end."""
    device, line = os.openpty()
    tty.setraw(line)
    yield device, os.ttyname(line)
    for each in (device, line):
        with contextlib.suppress(OSError):
            os.close(each)


def at(server: socket.socket) -> str:
    """Return where a server listens, as the parameter has it."""
    return '{}:{}'.format(*server.getsockname())


def of(heard: msg.Passing) -> Passing:
    """Return what a passing has of its device, whose numbers need not be its own."""
    assert heard.kart == 0
    return passing_of(heard)._replace(source='', session='', number=0)


def passings(records: list[tuple[bytes, Event]]) -> list[Passing]:
    """Return the passings in these records, without numbers."""
    return [each._replace(number=0) for _, each in records if isinstance(each, Passing)]


def test_what_a_device_sends_is_heard_as_it_came_without_gates_also_by_who_comes_later(
    listener: Listener, domain: int, server: socket.socket, parts: contextlib.ExitStack
) -> None:
    """Each record comes in two pieces."""
    gates = ('9992', '9995')
    sent = [each for each in passings(P3_LIVE) if each.transponder not in gates]
    given = {'kind': 'p3', 'device': at(server), 'source': 'north', 'gates': ', '.join(gates)}
    source = parts.enter_context(Process('evgp_timing', 'timing_source', domain, given))
    decoder = parts.enter_context(server.accept()[0])
    for record, _ in P3_LIVE:
        for piece in (record[:7], record[7:]):
            decoder.sendall(piece)

    heard = listener.wait_for_passings(len(sent))
    listener.wait_for_status(DiagnosticStatus.WARN, passings=str(len(sent)), missed='0')
    later = parts.enter_context(Listener(domain, 'later')).wait_for_passings(len(sent))
    for each in (heard, later):
        assert [of(one) for one in each] == sent
    assert {each.source for each in heard} == {'north'}
    identities = [(each.session, each.number) for each in heard]
    assert identities == [(each.session, each.number) for each in later]
    assert len(set(identities)) == len(sent)
    assert source.close() == 0


def test_what_comes_over_a_serial_line_is_heard(
    start: Start, listener: Listener, terminal: tuple[int, str]
) -> None:
    device, path = terminal
    start(kind='lines', device=path)
    listener.wait_for_status(DiagnosticStatus.OK)
    for record, _ in RECORDED['lines']:
        os.write(device, record)
    sent = passings(RECORDED['lines'])
    assert [of(each) for each in listener.wait_for_passings(len(sent))] == sent


def test_a_decoder_that_is_gone_is_told_and_read_again_once_it_is_back(
    start: Start, listener: Listener, server: socket.socket, parts: contextlib.ExitStack
) -> None:
    client = Client(context=listener.context, use_global_arguments=False)
    parts.callback(client.close)
    lines: list[tuple[str, ...]] = []
    window = SimpleNamespace(on_line=lambda *line: lines.append(line))

    def is_shown(trouble: str) -> bool:
        client.take(window)
        return lines[-1:] == [('line', f'p3 at {where}', trouble)]

    start(kind='p3', device=(where := at(server)))
    with server.accept()[0] as decoder:
        cut = p3_passing(42, 1001, 1_500_000)
        for number in (40, 41):
            decoder.sendall(p3_passing(number, 1001, 1_000_000))
        decoder.sendall(cut[: len(cut) // 2])
        listener.wait_for_passings(2)
        listener.wait_until_polled(lambda: is_shown(''), 'the line in the window')
    with server.accept()[0] as decoder:
        decoder.sendall(p3_passing(43, 1001, 2_000_000) * 2)
        *_, first, second = listener.wait_for_passings(3)
        assert (first.number, second.number) == (41, 43)
        assert first.session == second.session
        # What was cut off is told as missed, and what came twice brings nothing twice.
        told = {'missed': '1', 'repeated': '1', 'refused': '0', 'connections': '2'}
        listener.wait_for_status(DiagnosticStatus.WARN, **told)
        address = server.getsockname()
        server.close()
    status = listener.wait_for_status(DiagnosticStatus.ERROR, passings='3')
    assert status.hardware_id == where
    listener.wait_until_polled(lambda: is_shown(status.message), 'its trouble in the window')
    with socket.create_server(address) as again:
        again.settimeout(30)
        with again.accept()[0] as decoder:
            decoder.sendall(p3_passing(1, 1001, 3_000_000))  # it was switched off
            third = listener.wait_for_passings(4)[3]
            assert third.number == 1
            assert third.session != second.session
            listener.wait_for_status(DiagnosticStatus.WARN, restarted='1')


def test_a_silent_decoder_is_told_and_connected_to_again(
    start: Start, listener: Listener, server: socket.socket
) -> None:
    start(kind='p3', device=at(server), silent_after=1.0)
    with server.accept()[0]:
        listener.wait_for_status(DiagnosticStatus.ERROR)
        with server.accept()[0] as decoder:  # by itself

            def is_heard() -> object:
                decoder.sendall(P3_LIVE[0][0])
                return listener.statuses(DiagnosticStatus.OK)

            listener.wait_until_polled(is_heard, 'that it is heard again')


def test_a_contact_makes_a_passing_of_nobody_known(
    monkeypatch: pytest.MonkeyPatch, start: Start, listener: Listener
) -> None:
    # There is no control line without hardware.
    line = SimpleNamespace(cts=False, close=lambda: None)
    monkeypatch.setattr(node, 'connect', lambda *_: line)
    start(kind='contact', device='/dev/ttyS0', debounce=0.05)
    for count in (1, 2):
        # A crossing needs a line that was free for so long.
        while len(listener.passings) < count:
            line.cts = not line.cts
            with listener.news:
                listener.news.wait(0.1)
        line.cts = False
    first, second = listener.wait_for_passings(2)
    assert (first.number, second.number) == (1, 2)
    assert (first.kart, first.transponder) == (0, '')


def test_a_port_without_control_lines_is_told_and_the_node_goes_on(
    start: Start, listener: Listener, terminal: tuple[int, str]
) -> None:
    start(kind='contact', device=terminal[1])
    listener.wait_for_status(DiagnosticStatus.ERROR, connections='2')
