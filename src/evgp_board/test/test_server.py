# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The web server on real sockets: what viewers get, and what bad ones cannot do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import itertools
import json
import socket
import threading
import time
from typing import Any

from evgp_board import server
from evgp_board.server import Server
from evgp_board.view import Heard
from evgp_protocol import clock
from evgp_protocol.loop import run
from evgp_rcs.rules.snapshot import NOTHING
import pytest

PATIENCE = 20.0


class Board:
    """A server whose race a test changes."""

    def __init__(self) -> None:
        self.now = Heard()
        self._listening = socket.create_server(('127.0.0.1', 0), backlog=128)
        self.port = self._listening.getsockname()[1]
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        run(Server(lambda at: self.now).run(self._listening, self._ending))

    def say(self, banner: str) -> None:
        """Have race control say something, which every page shows."""
        self.now = Heard(NOTHING._replace(banner=banner), came=clock.now())

    def ask(self, request: str, receives: int | None = None) -> socket.socket:
        """Return a connection on which this was asked."""
        asking = socket.socket()
        if receives is not None:
            asking.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receives)
        asking.settimeout(PATIENCE)
        asking.connect(('127.0.0.1', self.port))
        asking.sendall(request.encode())
        return asking

    def get(self, path: str, method: str = 'GET') -> str:
        """Return the whole answer."""
        with self.ask(f'{method} {path} HTTP/1.1\r\nHost: x\r\n\r\n') as asking:
            return to_end(asking)

    def begins(self, path: str) -> str:
        """Return how the answer begins."""
        with self.watch(path) as asking:
            return asking.recv(100).decode()

    def watch(self, path: str = '/live/board', receives: int | None = None) -> socket.socket:
        """Return a connection with a stream."""
        return self.ask(f'GET {path} HTTP/1.1\r\nHost: x\r\n\r\n', receives)

    def wait_until(self, found: Callable[[], object]) -> None:
        """Return once something is true."""
        until = clock.now() + PATIENCE
        while not found():
            assert clock.now() < until
            time.sleep(0.05)

    def close(self) -> None:
        """End, and check that it ends."""
        self._ending.set()
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()


def to_end(asking: socket.socket) -> str:
    """Return what comes until the connection ends."""
    found = b''
    with contextlib.suppress(ConnectionError):
        while data := asking.recv(65536):
            found += data
    return found.decode()


def messages(watching: socket.socket) -> Iterator[dict[str, Any]]:
    with watching.makefile(encoding='utf-8') as lines:
        for line in lines:
            if line.startswith('data: '):
                yield json.loads(line.removeprefix('data: '))


def wait_for(watching: socket.socket, banner: str) -> int:
    """Return how many messages came until one with this banner."""
    for count, message in enumerate(messages(watching), 1):
        if message['show']['banner'] == banner:
            return count
    pytest.fail(f'the stream ended without {banner}')


@pytest.fixture
def board() -> Iterator[Board]:
    made = Board()
    yield made
    made.close()


def test_every_message_is_all_there_is_and_one_comes_though_nothing_changes(board: Board) -> None:
    with board.watch('/live/7') as watching:
        heard = messages(watching)
        first, second = next(heard), next(heard)
        assert first['show'] == second['show']
        assert first['times']['t'] < second['times']['t']
        board.say('REHEARSAL')
        assert wait_for(watching, 'REHEARSAL')


def test_what_no_page_can_show_ends_the_board() -> None:
    """The log of requests is silent, so nobody would learn of it."""
    looks: Any = iter((Heard(), None))
    with (
        socket.create_server(('127.0.0.1', 0)) as listening,
        pytest.raises(AttributeError),
    ):
        run(Server(lambda at: next(looks)).run(listening, threading.Event()))


def test_a_proxy_that_asks_by_http_1_0_gets_a_stream_too(board: Board) -> None:
    # As nginx does that nobody has told otherwise; it knows no chunks, and must keep nothing back.
    request = 'GET /live/board HTTP/1.0\r\nHost: board\r\nAccept: text/event-stream\r\n\r\n'
    with board.ask(request) as watching, watching.makefile(encoding='utf-8') as lines:
        head = [line.strip().lower() for line in iter(lines.readline, '\n')]
        assert head[0].endswith('200 ok')
        assert {'content-type: text/event-stream', 'connection: close'} <= {*head}
        assert 'x-accel-buffering: no' in head
        board.say('REHEARSAL')
        body = list(itertools.takewhile(lambda line: 'REHEARSAL' not in line, lines))
    assert {line[:6] for line in body} <= {'data: ', '\n'}


@pytest.mark.parametrize(
    'path', ['/', '/kart/7', '/overlay', '/results', '/board.css', '/board.js']
)
def test_a_page_may_load_and_run_nothing_but_what_is_ours(board: Board, path: str) -> None:
    head, _, body = board.get(path).partition('\r\n\r\n')
    assert head.startswith('HTTP/1.1 200')
    assert "default-src 'none'; script-src 'self'" in head
    assert 'nosniff' in head
    assert 'style=' not in body
    assert 'innerHTML' not in body
    assert body
    assert not board.get(path, 'HEAD').partition('\r\n\r\n')[2]


@pytest.mark.parametrize(
    ('method', 'path', 'code'),
    [
        ('POST', '/', 405),
        ('PUT', '/live/board', 405),
        ('GET', '/kart/x', 404),
        ('GET', '/kart/0', 404),
        ('GET', '/kart/7777777', 404),
        ('GET', '/live/../../etc/passwd', 404),
        ('GET', '/live/kart', 404),
        ('GET', '/' + 'x' * 9000, 400),
        ('GET', '/ HTTP/1.1\r\nX: ' + 'x' * 40000 + '\r\nY:', 400),
        ('\0\1\2', '/', 400),
    ],
)
def test_what_is_no_page_is_refused_in_short(
    board: Board, method: str, path: str, code: int
) -> None:
    said = board.get(path, method)
    assert said.startswith(('HTTP/1.1', 'HTTP/1.0'))
    assert int(said.split()[1]) == code
    assert len(said) < 2000
    assert board.get('/').startswith('HTTP/1.1 200')


def test_more_viewers_than_there_is_room_for_are_told_so(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, 'MOST_VIEWERS', 2)
    with board.watch() as one, board.watch() as other:
        assert next(messages(one))
        assert next(messages(other))
        assert board.get('/live/board').startswith('HTTP/1.1 503')
    # Who has gone makes room.
    monkeypatch.setattr(server, 'SLOW_VIEWER', 0.5)
    board.wait_until(lambda: board.begins('/live/board').startswith('HTTP/1.1 200'))


def test_a_viewer_who_reads_nothing_gets_the_newest_later_and_is_dropped_in_the_end(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    with board.watch(receives=2048) as slow, board.watch() as quick:
        for number in range(20):
            board.say(f'{number}: {"x" * 5000}')
            wait_for(quick, board.now.race.banner)
        assert wait_for(slow, board.now.race.banner) < 10
    monkeypatch.setattr(server, 'SLOW_VIEWER', 0.5)
    with board.watch(receives=2048) as slow:
        board.say('x' * 200_000)
        assert slow.recv(10)
        board.wait_until(lambda: slow.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR))


def test_who_asks_for_nothing_or_never_stops_asking_is_dropped(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, 'VISIT', 0.5)
    for request in ('', 'GET / HT', 'GET / HTTP/1.1\r\nHost: x\r\nContent-Length: 9\r\n\r\n'):
        with board.ask(request) as asking:
            to_end(asking)
    with board.ask('GET / HTTP/1.1\r\nHost: x\r\n\r\n' * 500) as asking:
        assert to_end(asking).count('200 OK') == 1
    with board.watch() as watching:  # what a viewer says is not heard
        with contextlib.suppress(ConnectionError, TimeoutError):
            watching.sendall(b'GET / HTTP/1.1\r\nHost: x\r\n\r\n' * 100)
        assert wait_for(watching, '')
