# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A real browser without a window: Chromium, driven over a pipe by its DevTools protocol.

Whatever the page writes to the console, and whatever it asks the network for, is kept.
"""

from __future__ import annotations

import base64
import contextlib
import fcntl
import json
import os
import pathlib
import select
import shutil
import subprocess
import tempfile
import time
from typing import Any

from evgp_testing.part import Part, PATIENCE
from rig.needs import cannot_run

NAMES = ('chromium', 'chromium-browser', 'google-chrome')


COMPLAINTS = (
    'Runtime.consoleAPICalled',
    'Runtime.exceptionThrown',
    'Log.entryAdded',
    'Page.javascriptDialogOpening',
)
"""The events that tell of a message on the console, an exception or a dialog."""


class Browser(Part):
    """A browser that shows one page at a time, at first an empty one."""

    def __init__(self) -> None:
        """Start it; skip the test where there is none."""
        program = next((found for name in NAMES if (found := shutil.which(name))), None)
        if program is None:
            cannot_run('there is no chromium (Debian: apt install chromium)')
        self._stack = contextlib.ExitStack()
        folder = self._stack.enter_context(
            tempfile.TemporaryDirectory(prefix='browser', ignore_cleanup_errors=True)
        )
        arguments = [
            program,
            '--headless',
            '--remote-debugging-pipe',
            f'--user-data-dir={folder}',
            '--no-first-run',
            '--disable-gpu',
            '--disable-dev-shm-usage',
            '--hide-scrollbars',
            # It shows pages of ours only; root has no other choice.
            '--no-sandbox',
            '--no-startup-window',
        ]
        # The browser reads at 3 and writes at 4, where the shell puts what is elsewhere here.
        low_in, self._write = os.pipe()
        self._read, low_out = os.pipe()
        theirs_in, theirs_out = (fcntl.fcntl(low, fcntl.F_DUPFD, 10) for low in (low_in, low_out))
        self._process = subprocess.Popen(
            ['bash', '-c', f'exec "$@" 3<&{theirs_in} 4>&{theirs_out}', 'bash', *arguments],
            pass_fds=(theirs_in, theirs_out),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for end in (low_in, low_out, theirs_in, theirs_out):
            os.close(end)
        self._number = 0
        self._unread = b''
        self.complaints: list[str] = []
        """What the page wrote to the console, and the exceptions that it did not catch."""
        self.requested: list[str] = []
        """The addresses that the page asked for, the page itself first."""
        self._session: dict[str, str] = {}
        target = self.call('Target.createTarget', url='about:blank')['targetId']
        attached = self.call('Target.attachToTarget', targetId=target, flatten=True)
        self._session = {'sessionId': attached['sessionId']}
        for domain in ('Page', 'Runtime', 'Log', 'Network'):
            self.call(f'{domain}.enable')

    def close(self) -> None:
        os.close(self._write)  # it ends when nobody is at the pipe any more
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._read)
        self._stack.close()

    # ----- the protocol -------------------------------------------------------------------

    def call(self, method: str, **parameters: object) -> dict[str, Any]:
        """
        Return what the browser answers.

        :raises AssertionError: if it answers with an error, or not in time.
        """
        self._number += 1
        message = {'id': self._number, 'method': method, 'params': parameters, **self._session}
        os.write(self._write, json.dumps(message).encode() + b'\0')
        until = time.monotonic() + PATIENCE
        while True:
            answer = self._next(until)
            if answer.get('id') == self._number:
                assert 'error' not in answer, f'{method}: {answer["error"]}'
                return dict(answer['result'])
            self._take(answer)

    def _next(self, until: float) -> dict[str, Any]:
        while b'\0' not in self._unread:
            ready, _, _ = select.select([self._read], [], [], max(0.0, until - time.monotonic()))
            assert ready, 'the browser does not answer'
            data = os.read(self._read, 1 << 20)
            assert data, 'the browser has ended'
            self._unread += data
        first, self._unread = self._unread.split(b'\0', 1)
        return dict(json.loads(first))

    def _take(self, event: dict[str, Any]) -> None:
        if event.get('method') in COMPLAINTS:
            self.complaints.append(json.dumps(event['params']))
        elif event.get('method') == 'Network.requestWillBeSent':
            self.requested.append(event['params']['request']['url'])

    # ----- the page -----------------------------------------------------------------------

    def visit(self, page: pathlib.Path | str) -> None:
        """Show a file, or what is at an address, and return once it is there."""
        self.requested.clear()
        self.call('Page.navigate', url=page if isinstance(page, str) else page.absolute().as_uri())
        self.wait_for("document.readyState === 'complete'")

    def resize(self, width: int, height: int, mobile: bool = False) -> None:
        """Give the page this size on its screen, in pixels."""
        size = {'width': width, 'height': height, 'deviceScaleFactor': 1, 'mobile': mobile}
        self.call('Emulation.setDeviceMetricsOverride', **size)

    def evaluate(self, expression: str) -> Any:
        """
        Return what a JavaScript expression is, on the page, once a promise of it has come true.

        :raises AssertionError: if it fails.
        """
        answer = self.call(
            'Runtime.evaluate', expression=expression, returnByValue=True, awaitPromise=True
        )
        assert 'exceptionDetails' not in answer, answer
        return answer['result'].get('value')

    def wait_for(self, expression: str) -> Any:
        """Return what an expression is as soon as it is true; it is looked at with each frame."""
        return self.evaluate(
            f"""new Promise((done, failed) => {{
                const until = performance.now() + {PATIENCE * 1000};
                const look = () => {{
                    const found = {expression};
                    if (found) done(found);
                    else if (performance.now() > until) failed({json.dumps(expression)});
                    else requestAnimationFrame(look);
                }};
                look();
            }})"""
        )

    def picture(self, file: pathlib.Path, selector: str = 'body') -> None:
        """Write an element as a PNG."""
        x, y, width, height = self.evaluate(
            f"""(() => {{
                const box = document.querySelector({json.dumps(selector)}).getBoundingClientRect();
                return [box.left + scrollX, box.top + scrollY, box.width, box.height];
            }})()"""
        )
        clip = {'x': x, 'y': y, 'width': width, 'height': height, 'scale': 1}
        answer = self.call('Page.captureScreenshot', clip=clip, captureBeyondViewport=True)
        file.write_bytes(base64.b64decode(answer['data']))

    def pdf(self) -> bytes:
        """Return the page as it is printed, as PDF."""
        answer = self.call('Page.printToPDF', preferCSSPageSize=True, printBackground=True)
        return base64.b64decode(answer['data'])
