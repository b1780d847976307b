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
import functools
import json
import logging
import pathlib
import socket
import struct
import sys
import threading
from typing import Any

from aiohttp import hdrs, web
from evgp_board import view
from evgp_board.view import Heard
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

SHOWS = {'board': view.board, 'results': view.results}
"""The function that returns what a page shows. A kart's page has its number instead of a name."""

NUMBER_PATTERN = r'[1-9]\d{0,4}'
"""Pattern of a kart's number."""

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


class Server:
    """
    The web server.

    :param look: a function that returns the messages to show at a time.
    """

    def __init__(self, look: Callable[[float], Heard]) -> None:
        self._look = look
        self._heard = look(clock.now())
        self._looked = asyncio.Event()
        self._body = functools.lru_cache(MOST_VIEWERS)(self._encode)  # once for all viewers
        self._viewers: set[asyncio.Protocol] = set()
        self._visits: dict[Any, float] = {}
        page = (PAGES / 'page.html').read_text(encoding='utf-8')
        app = web.Application(client_max_size=1024)
        app.on_response_prepare.append(_finish)
        for path, name in (
            ('/', 'board'),
            ('/overlay', 'overlay'),
            ('/results', 'results'),
            (f'/kart/{{number:{NUMBER_PATTERN}}}', 'kart'),
        ):
            made = page.replace('PAGE', name).encode()
            app.router.add_get(path, functools.partial(_answer, made, 'text/html'))
        for name, kind in (('board.css', 'text/css'), ('board.js', 'text/javascript')):
            made = (PAGES / name).read_bytes()
            app.router.add_get(f'/{name}', functools.partial(_answer, made, kind))
        what = f'{"|".join(SHOWS)}|{NUMBER_PATTERN}'
        app.router.add_get(f'/live/{{what:{what}}}', self._watch, allow_head=False)
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
                at = clock.now()
                self._heard = self._look(at)
                self._body.cache_clear()
                for each in SHOWS:  # a page that cannot be made ends the board
                    self._body(each)
                self._looked.set()  # every viewer that waits looks once
                self._looked.clear()
                self._end_visits(at)
                await asyncio.sleep(NEWS_LOOK)
        finally:
            for each in self._connections():
                _reset(each.transport)
            self._looked.set()
            await self._runner.cleanup()

    def _connections(self) -> list[Any]:
        server = self._runner.server
        return [each for each in server.connections if each.transport] if server else []

    def _end_visits(self, at: float) -> None:
        """Drop surplus and long-lasting connections that are not viewers'."""
        visits = [each for each in self._connections() if each not in self._viewers]
        self._visits = {each: self._visits.get(each, at) for each in visits}
        oldest_first = sorted(self._visits, key=self._visits.__getitem__)
        for number, visit in enumerate(oldest_first):
            if number >= MOST_VISITS or at - self._visits[visit] > VISIT:
                _reset(visit.transport)

    async def _watch(self, request: web.Request) -> web.StreamResponse:
        """Send a viewer what a page shows, for as long as the viewer accepts it."""
        transport = request.transport
        if len(self._viewers) >= MOST_VIEWERS:
            raise web.HTTPServiceUnavailable(
                text=f'The board already has {MOST_VIEWERS} viewers. Try again later'
            )
        if transport is None:
            raise web.HTTPBadRequest
        response = web.StreamResponse(headers=OF_A_STREAM)
        self._viewers.add(request.protocol)
        try:
            await response.prepare(request)
            transport.pause_reading()  # further input is not read, so it uses no memory
            # Writing never waits, because only one message at a time is on its way.
            transport.set_write_buffer_limits(sys.maxsize)
            shown, said_at, moved = '', 0.0, clock.now()
            while not transport.is_closing():
                at = clock.now()
                if _has_all(transport):
                    moved, body = at, self._body(request.match_info['what'])
                    if body != shown or at - said_at >= SAY_AGAIN:
                        shown, said_at = body, at
                        await response.write(self._message(body, at))
                elif at - moved > SLOW_VIEWER:
                    _reset(transport)
                await self._looked.wait()
        finally:
            self._viewers.discard(request.protocol)
        return response

    def _encode(self, what: str) -> str:
        """Return the content of a page: a key of `SHOWS`, or the number of a kart."""
        show = SHOWS[what](self._heard) if what in SHOWS else view.kart(self._heard, int(what))
        return json.dumps(show)

    def _message(self, body: str, at: float) -> bytes:
        """Return the content of a page, with the present times, as an event of a stream."""
        heard = self._heard
        age = at - heard.came if heard.race else 0.0
        of_day, green = view.time_of_today(heard.race), view.green_for(heard.race)
        running = None if heard.gone or green is None else round(green + age, 2)
        times = {
            't': round(at, 3),
            'age': round(age, 1),
            'day': None if of_day is None else round(of_day + age, 2),
            'green': running,
        }
        return f'data: {json.dumps({"times": times})[:-1]}, "show": {body}}}\n\n'.encode()


def _has_all(transport: asyncio.Transport) -> bool:
    """Return whether everything sent on a connection has arrived."""
    if transport.get_write_buffer_size():
        return False
    with contextlib.suppress(OSError):
        return not unanswered(transport.get_extra_info('socket'))
    return False


def _reset(transport: asyncio.Transport) -> None:
    """Close a connection at once, and drop unsent data, even in the kernel."""
    with contextlib.suppress(OSError):
        connection = transport.get_extra_info('socket')
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', 1, 0))
    transport.abort()


async def _answer(body: bytes, kind: str, request: web.Request) -> web.Response:
    return web.Response(body=body, content_type=kind, charset='utf-8')


async def _finish(request: web.Request, response: web.StreamResponse) -> None:
    """Add the headers to an answer and end the connection after it."""
    response.headers.update(HEADERS)
    response.force_close()
    response.headers[hdrs.CONNECTION] = 'close'
