# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The instructor's page: a plan of the track, the incidents to choose from, and the debriefs.

Python's standard library serves it on 127.0.0.1 only. The server refuses requests that name
another host, and posts other than JSON, so that no page on the internet can press the buttons.
"""

from __future__ import annotations

from collections.abc import Mapping
import http.server
import json
import pathlib
import threading
from typing import Any

from evgp_rehearsal.event import RefusedError, Rehearsal
from evgp_rehearsal.field import TICK_LENGTH
from evgp_rehearsal.incidents import can_begin, INCIDENTS
from evgp_testing.part import Part

HERE = '127.0.0.1'
"""Address of the page."""


def picture(rehearsal: Rehearsal) -> dict[str, Any]:
    """Return the page's content: what is true, and what race control knows."""
    race = rehearsal.race
    track = rehearsal.plan.track
    heard = {kart.number: kart for kart in race.karts} if race is not None else {}
    with rehearsal.lock:
        field, radio = rehearsal.field, rehearsal.field.truth.messages[-3:]
        karts = []
        for number, kart in field.karts.items():
            x, y = track.point(kart.distance)
            seen = heard.get(number)
            karts.append(
                {
                    'number': number,
                    'x': x,
                    'y': y,
                    'speed': round(kart.speed, 1),
                    'lap': max(0, int(kart.distance // track.length) + 1),
                    'faults': sorted(fault.name for fault in kart.faults),
                    'sent': seen.sent.value if seen else '',
                    'connected': bool(seen and seen.connected),
                    'acknowledged': bool(seen and seen.acknowledged),
                }
            )
        took = rehearsal.present
        return {
            'track': track.corners,
            'incidents': [
                {
                    'name': row.name,
                    'meaning': row.meaning,
                    'order': row.order,
                    'when': row.phase.value,
                }
                for row in INCIDENTS.values()
            ],
            'time': round(field.tick * TICK_LENGTH, 1),
            'paused': rehearsal.paused,
            'race': rehearsal.state.value,
            'track_open': bool(race and race.track.open),
            'karts': karts,
            'person': field.person,
            'radio': [f'{at * TICK_LENGTH:.0f} s: {text}' for at, text in radio],
            'incident': took.incident if took else '',
            'incident_kart': took.kart if took else 0,
            'possible': [
                row.name for row in INCIDENTS.values() if can_begin(row, field, rehearsal.state)
            ],
            'alerts': [alert.told for alert in race.alerts] if race else [],
        }


class Page(Part):
    """The server of a rehearsal's page."""

    def __init__(self, rehearsal: Rehearsal) -> None:
        self._server = http.server.ThreadingHTTPServer((HERE, 0), _handler(rehearsal))
        self._server.daemon_threads = True
        self.url = f'http://{HERE}:{self._server.server_port}/'
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the server."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


def _do(rehearsal: Rehearsal, wanted: Mapping[str, Any]) -> None:
    """
    Carry out what a button asks for.

    :raises RefusedError: with a message for the instructor.
    """
    what = wanted.get('do')
    if what == 'inject':
        rehearsal.inject(str(wanted.get('incident')), int(wanted.get('kart') or 0))
    elif what == 'mend':
        rehearsal.mend()
    elif what == 'msr':
        rehearsal.use_msr()
    elif what == 'pause':
        rehearsal.paused = not rehearsal.paused
    elif what == 'window':
        rehearsal.open_window()
    else:
        raise RefusedError(f'there is no button {what}')


def _handler(rehearsal: Rehearsal) -> type[http.server.BaseHTTPRequestHandler]:
    class Handler(http.server.BaseHTTPRequestHandler):
        """Answers one request."""

        def do_GET(self) -> None:
            if not self._is_here():
                return
            if self.path == '/':
                file = pathlib.Path(__file__).with_name('page.html')
                self._answer(file.read_text(encoding='utf-8'), 'text/html')
            elif self.path == '/state':
                self._answer(json.dumps(picture(rehearsal)), 'application/json')
            elif self.path == '/debrief':
                lines = ['\n'.join(each) for each in rehearsal.debriefs()]
                self._answer('\n\n'.join(lines or ['No incident began.']), 'text/plain')
            else:
                self.send_error(404)

        def do_POST(self) -> None:
            if not self._is_here():
                return
            length = int(self.headers.get('Content-Length') or 0)
            if self.headers.get('Content-Type') != 'application/json' or length > 10_000:
                self.send_error(400)
                return
            told = ''
            try:
                _do(rehearsal, json.loads(self.rfile.read(length)))
            except (RefusedError, ValueError, AttributeError) as error:
                told = str(error)
            self._answer(json.dumps({'told': told}), 'application/json')

        def log_message(self, *_: object) -> None:
            """Log nothing, because the terminal belongs to the instructor."""

        def _is_here(self) -> bool:
            port = self.connection.getsockname()[1]
            if self.headers.get('Host') in (f'{HERE}:{port}', f'localhost:{port}'):
                return True
            self.send_error(403)
            return False

        def _answer(self, text: str, kind: str) -> None:
            data = text.encode()
            self.send_response(200)
            self.send_header('Content-Type', f'{kind}; charset=utf-8')
            self.send_header('Content-Length', str(len(data)))
            self.send_header('Cache-Control', 'no-store')
            self.end_headers()
            self.wfile.write(data)

    return Handler
