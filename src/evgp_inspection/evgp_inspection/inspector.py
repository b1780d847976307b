# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What the inspector reads and types: sentences, questions, and a key that stops the kart.

A thread does the printing, so that a paused terminal (Ctrl-S) never delays frames to the kart.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
import contextlib
import os
import queue
import sys
import termios
import threading
import time
import tty
from typing import Protocol

WORD = 'ready'
"""The word that the inspector types to allow the kart to drive."""

FIRST = f"""\
  1. The kart's wheels are OFF THE GROUND, and nobody and nothing touches them.
  2. You hold the MASTER SAFETY REMOTE, and you have tested it.
  3. You know that the SPACE BAR stops the kart and ends the inspection.
When all of this is true, type "{WORD}" and Enter: """


class Inspector(Protocol):
    """The person who sees the wheels."""

    def tell(self, line: str) -> None:
        """Show a line; never waits."""

    async def ask(self, question: str, seconds: float) -> bool | None:
        """Return the answer; None if there is none within this time, in seconds."""


class Unattended:
    """
    The inspector of an unattended inspection, who sees nothing.

    :param tell: prints a line.
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        self.tell = tell

    async def ask(self, question: str, seconds: float) -> bool | None:
        return None


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


class AtTerminal:
    """
    An inspector at a terminal, who answers with single keys.

    A key that is pressed before a question does not answer it. In a pipe, bytes take the place of
    keys.

    :param stop: called in the loop when a stop key is pressed after the word was typed, or when
        the terminal is gone.
    """

    def __init__(self, printer: Printer, stop: Callable[[], None], fd: int = 0) -> None:
        self._printer = printer
        self._stop = stop
        self._fd = fd
        self._word: asyncio.Future[bool] | None = None
        self._typed = ''
        self._answer: asyncio.Future[bool] | None = None
        self._before: list[int | list[bytes | int]] | None = None
        self.tell = printer.tell

    def __enter__(self) -> AtTerminal:
        """Start to read keys."""
        asyncio.get_running_loop().add_reader(self._fd, self._read)
        return self

    def __exit__(self, *reason: object) -> None:
        """Restore the terminal's settings."""
        asyncio.get_running_loop().remove_reader(self._fd)
        if self._before is not None:
            termios.tcsetattr(self._fd, termios.TCSADRAIN, self._before)

    async def confirm(self) -> bool:
        """Ask for the word; return whether it was typed."""
        self._printer.tell(FIRST, end='')
        self._word = asyncio.get_running_loop().create_future()
        given = await self._word
        if given and os.isatty(self._fd):
            self._before = termios.tcgetattr(self._fd)
            tty.setcbreak(self._fd)
        return given

    async def ask(self, question: str, seconds: float) -> bool | None:
        """Ask a question, which the inspector answers by the key y or n."""
        self._printer.tell(f'\a  ?  {question}  y/n ', end='')
        given: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
        self._answer = given
        began = time.monotonic()
        try:
            await asyncio.wait([given], timeout=seconds)
        finally:
            self._answer = None
        if not given.done():
            self._printer.tell('no answer')
            return None
        answer = given.result()
        word = 'yes' if answer else 'NO'
        self._printer.tell(f'{word}, after {time.monotonic() - began:.1f} s')
        return answer

    def _read(self) -> None:
        try:
            text = os.read(self._fd, 1024).decode('utf-8', 'replace')
        except OSError:
            text = ''
        if not text:  # the terminal is gone, so nobody watches
            asyncio.get_running_loop().remove_reader(self._fd)
            if self._word is not None and not self._word.done():
                self._word.set_result(False)
            else:
                self._stop()
            return
        if self._word is not None and not self._word.done():
            self._typed += text
            line, end, _ = self._typed.partition('\n')
            if end:
                self._word.set_result(line.strip().lower() == WORD)
            return
        for key in text.lower():
            if key in ' \x1b':  # space or Escape
                self._stop()
            elif key in 'yn' and self._answer is not None and not self._answer.done():
                self._answer.set_result(key == 'y')
