# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The board's web server: the pages, and for each viewer a stream of what the page shows.

A stream consists of server-sent events. Each message contains everything the page shows, so a
viewer can miss messages without harm. Only one message at a time is on its way to a viewer, and
the next one is the newest at that time. A viewer who does not read therefore costs no further
memory, and the server drops one who accepts nothing for `SLOW_VIEWER`.

Viewers cannot send anything else: the server accepts only GET and HEAD, and forwards nothing.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
import contextlib
from dataclasses import dataclass, field
import functools
import json
import logging
import pathlib
import re
import socket
import struct
import threading
from typing import Any

from aiohttp import hdrs, HttpVersion11, web
from evgp_board import view
from evgp_board.view import Heard, Shown
from evgp_protocol import clock
from evgp_protocol.link import unanswered

NEWS_LOOK = 0.2
"""Time between two checks for news to show, in seconds."""

SAY_AGAIN = 0.7
"""Age from which the next check sends unchanged content again, in seconds. A page thus gets a
message at least once a second, and shows that it is out of date after 2 s without one."""

SLOW_VIEWER = 5.0
"""Time without progress after which the server drops a viewer, in seconds."""

MOST_VIEWERS = 300
"""Maximum number of viewers. Further ones get the answer 503."""

MOST_VISITS = 300
"""Maximum number of other connections, which request pages. The server drops newer ones."""

VISIT = 10.0
"""Maximum duration of a connection that requests a page, in seconds."""

PAGES = pathlib.Path(__file__).parent / 'pages'

HEADERS = {
    'Content-Security-Policy': "default-src 'none'; script-src 'self'; style-src 'self'; "
    "connect-src 'self'; img-src data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    'X-Content-Type-Options': 'nosniff',
    'Referrer-Policy': 'no-referrer',
    'Cache-Control': 'no-store',
    'Server': 'board',
}
"""Headers of every answer, which let a page load and run only our own files."""

OF_A_STREAM = {'Content-Type': 'text/event-stream', 'X-Accel-Buffering': 'no'}
"""Headers of a stream, with which nginx forwards each message at once."""


@dataclass(eq=False)
class _Viewer:
    """
    A viewer of a page.

    :ivar chunks: whether the viewer gets messages in chunks. Some proxies use HTTP/1.0, which has
        none.
    :ivar waits: whether there is news that has not been sent to the viewer yet.
    :ivar moved: the last time when the viewer had received everything, in seconds.
    """

    transport: asyncio.Transport
    protocol: asyncio.Protocol
    moved: float
    chunks: bool = True
    waits: bool = False
    gone: asyncio.Event = field(default_factory=asyncio.Event)

    def has_all(self) -> bool:
        """Return whether everything sent to the viewer has arrived."""
        if self.transport.get_write_buffer_size():
            return False
        with contextlib.suppress(OSError):
            return not unanswered(self.transport.get_extra_info('socket'))
        return False


class _Stream:
    """The content of one page, encoded once for all its viewers."""

    def __init__(self, show: Callable[[Heard], Shown]) -> None:
        self._show = show
        self._heard: Heard | None = None
        self._body = ''
        self._sent_body = ''
        self._sent_at = 0.0
        self.viewers: set[_Viewer] = set()

    def is_due(self, heard: Heard, at: float) -> bool:
        """Return whether a message is due for all viewers, and count it as sent."""
        if heard is not self._heard:
            self._heard, self._body = heard, json.dumps(self._show(heard))
        if self._body == self._sent_body and at - self._sent_at < SAY_AGAIN:
            return False
        self._sent_body, self._sent_at = self._body, at
        return True

    def message(self, heard: Heard, at: float) -> bytes:
        """Return the page's current content, as an event of a stream."""
        self.is_due(heard, at)
        age = at - heard.came if heard.race else 0.0
        of_day, green = view.time_of_today(heard.race), view.green_for(heard.race)
        running = None if heard.gone or green is None else round(green + age, 2)
        times = {
            't': round(at, 3),
            'age': round(age, 1),
            'day': None if of_day is None else round(of_day + age, 2),
            'green': running,
        }
        return f'data: {json.dumps({"times": times})[:-1]}, "show": {self._body}}}\n\n'.encode()


class Server:
    """
    The web server.

    :param look: a function that returns the messages to show at a time, which are the same object
        until something changes.
    """

    def __init__(self, look: Callable[[float], Heard]) -> None:
        self._look = look
        self._heard = look(clock.now())
        self._streams: dict[str, _Stream] = {}
        self._visits: dict[Any, float] = {}
        page = (PAGES / 'page.html').read_text(encoding='utf-8')
        app = web.Application(client_max_size=1024)
        app.on_response_prepare.append(_finish)
        for path, name in (
            ('/', 'board'),
            ('/overlay', 'overlay'),
            ('/results', 'results'),
            (r'/kart/{number:[1-9]\d{0,4}}', 'kart'),
        ):
            made = page.replace('PAGE', name).encode()
            app.router.add_get(path, functools.partial(_answer, made, 'text/html'))
        for name, kind in (('board.css', 'text/css'), ('board.js', 'text/javascript')):
            made = (PAGES / name).read_bytes()
            app.router.add_get(f'/{name}', functools.partial(_answer, made, kind))
        app.router.add_get('/live/{what}', self._watch, allow_head=False)
        # Hostile requests must not fill the log.
        self._runner = web.AppRunner(
            app, access_log=None, lingering_time=1.0, logger=logging.getLogger('board.requests')
        )
        logging.getLogger('board.requests').setLevel(logging.CRITICAL)

    async def run(self, listening: socket.socket, ending: threading.Event) -> None:
        """Serve at a socket until ``ending`` is set."""
        await self._runner.setup()
        await web.SockSite(self._runner, listening).start()
        try:
            while not ending.is_set():
                self._step(clock.now())
                await asyncio.sleep(NEWS_LOOK)
        finally:
            for viewer in self._viewers():
                _drop(viewer)
            await self._runner.cleanup()

    def _viewers(self) -> list[_Viewer]:
        return [viewer for stream in self._streams.values() for viewer in stream.viewers]

    def _step(self, at: float) -> None:
        """Send viewers the news and drop those that are too slow."""
        self._heard = self._look(at)
        for name, stream in [*self._streams.items()]:
            due, message = stream.is_due(self._heard, at), b''
            for viewer in [*stream.viewers]:
                viewer.waits |= due
                if viewer.transport.is_closing():
                    viewer.gone.set()
                elif viewer.has_all():
                    viewer.moved = at
                    if viewer.waits:
                        message = message or stream.message(self._heard, at)
                        viewer.transport.write(_chunk(message) if viewer.chunks else message)
                        viewer.waits = False
                elif at - viewer.moved > SLOW_VIEWER:
                    _drop(viewer)
            if not stream.viewers:
                del self._streams[name]
        self._end_visits(at)

    def _end_visits(self, at: float) -> None:
        """Drop surplus and long-lasting connections that are not viewers'."""
        server, watching = self._runner.server, {each.protocol for each in self._viewers()}
        there = [each for each in (server.connections if server else ()) if each not in watching]
        self._visits = {each: self._visits.get(each, at) for each in there}
        oldest_first = sorted(self._visits, key=self._visits.__getitem__)
        for number, visit in enumerate(oldest_first):
            too_much = number >= MOST_VISITS or at - self._visits[visit] > VISIT
            if too_much and visit.transport is not None:
                _reset(visit.transport)

    async def _watch(self, request: web.Request) -> web.StreamResponse:
        """Send a viewer a stream for as long as the viewer accepts it."""
        what = request.match_info['what']
        shows = {'board': view.board, 'results': view.results}.get(what)
        if shows is None and re.fullmatch(r'[1-9]\d{0,4}', what):
            shows = functools.partial(view.kart, number=int(what))
        if shows is None:
            raise web.HTTPNotFound
        if len(self._viewers()) >= MOST_VIEWERS:
            raise web.HTTPServiceUnavailable(
                text=f'The board already has {MOST_VIEWERS} viewers. Try again later'
            )
        transport = request.transport
        if transport is None:
            raise web.HTTPBadRequest
        at = clock.now()
        chunks = request.version >= HttpVersion11
        stream, viewer = _Stream(shows), _Viewer(transport, request.protocol, at, chunks)
        response = web.StreamResponse(headers=OF_A_STREAM)
        await response.prepare(request)
        await response.write(stream.message(self._heard, at))
        transport.pause_reading()  # further input is not read, so it uses no memory
        stream = self._streams.setdefault(what, stream)
        stream.viewers.add(viewer)
        try:
            await viewer.gone.wait()
        finally:
            stream.viewers.discard(viewer)
        return response


def _reset(transport: asyncio.Transport) -> None:
    """Close a connection at once, and drop unsent data, even in the kernel."""
    with contextlib.suppress(OSError):
        connection = transport.get_extra_info('socket')
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', 1, 0))
    transport.abort()


def _drop(viewer: _Viewer) -> None:
    _reset(viewer.transport)
    viewer.gone.set()


def _chunk(data: bytes) -> bytes:
    """Return bytes as a chunk of an HTTP/1.1 answer (RFC 9112, section 7.1)."""
    return b'%x\r\n%b\r\n' % (len(data), data)


async def _answer(body: bytes, kind: str, request: web.Request) -> web.Response:
    return web.Response(body=body, content_type=kind, charset='utf-8')


async def _finish(request: web.Request, response: web.StreamResponse) -> None:
    """Add the headers to an answer and end the connection after it."""
    response.headers.update(HEADERS)
    response.force_close()
    response.headers[hdrs.CONNECTION] = 'close'
