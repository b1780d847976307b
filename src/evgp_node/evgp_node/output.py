# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Keeps standard input, output and error from blocking, ending or deafening the process."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import io
import os
import sys
import threading

FINISH_TIMEOUT = 1.0
"""Maximum time for printing the last output at the end, in seconds."""


def open_closed_streams() -> None:
    """
    Open each of the standard streams that is closed, at nothing.

    Call this first. Otherwise, a socket or pipe of the process would take its number, and what is
    printed, or put in place of the stream, would take the place of that socket or pipe.
    """
    while (opened := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(opened, True)
    os.close(opened)


def show_what_it_can() -> None:
    """Have a terminal with few characters show a replacement for the others, and no traceback."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors='replace')


@contextlib.contextmanager
def unwaiting_output() -> Iterator[None]:
    """
    Put a pipe and a thread between the process and its standard output and error.

    rclpy writes its log while it holds the interpreter's lock. If the terminal blocked (Ctrl-S, a
    hung ssh, a stopped ``ros2 launch``), the next log line would block every thread of the
    process, and officials could no longer stop any kart. With the pipe, output for which there is
    no room is lost instead.
    """
    for stream in (1, 2):
        if os.isatty(stream):
            # Otherwise, rcutils would see a pipe and write no colours.
            os.environ.setdefault('RCUTILS_COLORIZED_OUTPUT', '1')
    pumps = [_Pump(stream) for stream in (1, 2)]
    try:
        yield
    finally:
        for each in filter(None, (sys.stdout, sys.stderr)):  # None if Python found it closed
            each.flush()
        for pump in pumps:
            pump.finish()


class _Pump:
    """The pipe and thread for one file descriptor."""

    def __init__(self, stream: int) -> None:
        self._stream = stream
        self._original = os.dup(stream)
        self._source, sink = os.pipe()
        os.set_blocking(sink, False)
        os.dup2(sink, stream)
        os.close(sink)
        self._thread = threading.Thread(target=self._run, name='output', daemon=True)
        self._thread.start()

    def finish(self) -> None:
        """Restore the descriptor and give the thread `FINISH_TIMEOUT` to print the rest."""
        # This closes the last writing end of the pipe, so the thread ends.
        os.dup2(self._original, self._stream)
        self._thread.join(FINISH_TIMEOUT)

    def _run(self) -> None:
        while data := os.read(self._source, 65536):
            try:
                while data:
                    count = os.write(self._original, data)
                    data = data[count:]
            except OSError:
                pass  # nobody reads the output any longer, and the process goes on
