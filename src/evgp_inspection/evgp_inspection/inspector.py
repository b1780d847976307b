# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What the inspector reads and types: sentences, questions, and a key that stops the kart.

A thread does the printing, so that a paused terminal (Ctrl-S) never delays frames to the kart.
"""

from __future__ import annotations

import asyncio
import codecs
from collections.abc import Callable, Iterator
import contextlib
import os
import queue
import shutil
import signal
import sys
import termios
import threading
import time
import tty
from typing import Protocol

from evgp_inspection.recording import first

WORD = 'ready'
"""The word that the inspector types to allow the kart to drive."""

CONDITIONS = """\
  1. The kart's wheels are OFF THE GROUND, and nobody and nothing touches them.
  2. You hold the MASTER SAFETY REMOTE, and you have tested it.
  3. You know that the SPACE BAR stops the kart and ends the inspection."""


class Inspector(Protocol):
    """The person who sees the wheels."""

    def tell(self, line: str) -> None:
        """Show a line; never waits."""

    async def ask(self, question: str, seconds: float) -> bool | None:
        """Return the answer; None if there is none within this time, in seconds."""


class Printer:
    """Prints lines in a thread."""

    def __init__(self) -> None:
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._print, daemon=True)
        self._thread.start()

    def tell(self, line: str, end: str = '\n') -> None:
        """Print a line soon."""
        self._lines.put(line + end)

    def close(self) -> None:
        """Print the remaining lines, unless the terminal is paused."""
        self._lines.put(None)
        self._thread.join(1.0)

    def _print(self) -> None:
        with contextlib.suppress(OSError, ValueError):  # the output is closed
            while (text := self._lines.get()) is not None:
                sys.stdout.write(text)
                sys.stdout.flush()


class Unattended(Printer):
    """The inspector of an unattended inspection, who sees nothing."""

    async def ask(self, question: str, seconds: float) -> bool | None:
        return None


class Terminal(Printer):
    """
    Shows lines and, below them, a status with the typed text.

    In a pipe, bytes take the place of keys.

    :param stopping: set when Ctrl-D is typed.
    :param word: the word, if it was given in another way.
    """

    def __init__(self, stopping: asyncio.Event, word: str = '') -> None:
        super().__init__()
        self._stopping = stopping
        self._decode = codecs.getincrementaldecoder('utf-8')('replace').decode
        self._typed = self._status = ''
        self._word: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        if word:
            self._word.set_result(word)
        self._live = sys.stdout.isatty()

    def tell(self, line: str, end: str = '\n') -> None:
        """Print a permanent line."""
        super().tell(f'\r\x1b[J{line}' if self._live and self._status else line, end)
        self._show()

    def show(self, status: str) -> None:
        """Print a status, replacing the earlier one if possible."""
        self._status = status
        if self._live:
            self._show()
        else:
            super().tell(status)

    def _show(self) -> None:
        if self._live and self._status:
            width = shutil.get_terminal_size().columns - 1
            typed = f'  {self._typed}'[-width:]
            super().tell(f'\r\x1b[J{self._status[: width - len(typed)]}{typed}', end='')

    @contextlib.contextmanager
    def reading(self) -> Iterator[None]:
        """Read keys and show them below the rest."""
        loop = asyncio.get_running_loop()
        before = termios.tcgetattr(0) if os.isatty(0) else None
        try:
            loop.add_reader(0, self._read)
        except PermissionError:  # a file, or nothing
            self._end()
        try:
            if before is not None:
                tty.setcbreak(0, termios.TCSANOW)  # what is typed already counts
            yield
        finally:
            loop.remove_reader(0)
            if before is not None:
                with contextlib.suppress(termios.error):  # the terminal is gone
                    termios.tcsetattr(0, termios.TCSADRAIN, before)
            self._status = ''
            self.tell('')

    async def confirm(self, conditions: str) -> bool:
        """Show the conditions and ask for the word; return whether it was typed."""
        if not self._word.done():
            self.tell(f'{conditions}\nWhen all of this is true, type "{WORD}" and Enter.')
            self.show('>')
            await first(self._word, self._stopping)
            self._status = ''
            self.tell('')
        return self._word.done() and self._word.result().lower() == WORD

    def _read(self) -> None:
        try:
            data = os.read(0, 1024)
        except OSError:
            data = b''
        if not data:
            asyncio.get_running_loop().remove_reader(0)
            self._end()
        for key in self._decode(data):
            if key == '\x04':
                self._stopping.set()
            elif self._word.done():
                self.on_key(key)
            else:
                self.edit(key, self._word.set_result)
        self._show()

    def edit(self, key: str, take_line: Callable[[str], None]) -> None:
        """Change the typed text; pass it on when Enter is typed."""
        if key in '\r\n':
            typed, self._typed = self._typed, ''
            take_line(typed.strip())
        elif key in '\b\x7f':
            self._typed = self._typed[:-1]
        elif key.isprintable():
            self._typed += key

    def _end(self) -> None:
        """Take note that there is no keyboard input any more."""
        if self._word.done():
            self.on_end()
        else:
            self._word.set_result('')

    def on_key(self, key: str) -> None:
        """Handle a key that is typed after the word."""

    def on_end(self) -> None:
        """Handle the end of the keyboard input after the word."""


class AtTerminal(Terminal):
    """
    An inspector at a terminal, who answers with single keys.

    A key that is pressed before a question does not answer it. Space and Escape set `stopping`, as
    does the end of the terminal, because nobody watches then.
    """

    _answer: asyncio.Future[bool] | None = None

    async def ask(self, question: str, seconds: float) -> bool | None:
        """Ask a question, which the inspector answers by the key y or n."""
        self.tell(f'\a  ?  {question}  y/n ', end='')
        given: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
        self._answer = given
        began = time.monotonic()
        try:
            await asyncio.wait([given], timeout=seconds)
        finally:
            self._answer = None
        if not given.done():
            self.tell('no answer')
            return None
        answer = given.result()
        word = 'yes' if answer else 'NO'
        self.tell(f'{word}, after {time.monotonic() - began:.1f} s')
        return answer

    def on_key(self, key: str) -> None:
        if key in ' \x1b':  # space or Escape
            self._stopping.set()
        elif key in 'ynYN' and self._answer is not None and not self._answer.done():
            self._answer.set_result(key in 'yY')

    def on_end(self) -> None:
        self._stopping.set()


def stopped_by_signals() -> asyncio.Event:
    """Return an event of the running loop that the signals set which end programs."""
    stopping = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        asyncio.get_running_loop().add_signal_handler(number, stopping.set)
    return stopping
