# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0
# PYTHON_ARGCOMPLETE_OK

"""
The officials' terminal client as a process: it keeps the deadline and prints the answer.

It knows no rule of the race, and has no ROS: what works with ROS may hang, inside DDS and with the
interpreter's lock held, and then no thread and no signal handler of that process runs. So
``ctl_ros`` works in a process of its own, which is killed if it does not answer.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
import ctypes
import multiprocessing
from multiprocessing.connection import Connection
import os
import signal
import sys
from types import FrameType
from typing import Any, NoReturn

from evgp_node.official import tidy
from evgp_protocol.clock import now
from evgp_rcs_console import texts
from evgp_rcs_console.catalogue import CATALOGUE
from evgp_rcs_console.command_line import (
    COMMANDS,
    Exit,
    no_answer,
    parser,
    Report,
    STARTING,
    without_ros_arguments,
)
from evgp_rcs_console.settings import keep_name, kept_name, MOST_BYTES

TIDY = 1.0
"""Maximum time to leave the ROS domain once the answer is printed, in seconds."""

STALLED = 5.0
"""Time without anything new after which a `watch` counts as hanging, in seconds. It shows the race
once a second."""

_PR_SET_PDEATHSIG = 1  # of linux/prctl.h


class TimedProcess:
    """
    A piece of work in a forked process: a new interpreter would make each stop 0.3 s later.

    Make it before the process has any thread.

    :param work: is called there, with a ``Report``; it ends early, by SystemExit, on SIGTERM.
    """

    def __init__(self, work: Callable[[Report], object]) -> None:
        fork = multiprocessing.get_context('fork')
        self._hear, tell = fork.Pipe(duplex=False)
        self._process = fork.Process(target=_do, args=(work, tell, os.getpid()))
        self._process.start()
        self.failed = False  # it ended without a report
        tell.close()

    def report(self, seconds: float | None) -> dict[str, Any] | None:
        """
        Return what the work reports next; None if it ends or time is up without a report.

        :param seconds: how long to wait; None: as long as it takes.
        """
        try:
            return self._hear.recv() if self._hear.poll(seconds) else None
        except EOFError:
            self.failed = True
            return None

    def end(self, seconds: float) -> None:
        """
        End the work, by force if it does not end by itself.

        :param seconds: how long it may take to tidy up.
        """
        self._process.terminate()
        self._process.join(seconds)
        self._process.kill()
        self._process.join()


def _do(work: Callable[[Report], object], tell: Connection, parent: int) -> None:
    """Work, in the forked process."""

    def report(last: bool = False, **told: Any) -> None:
        if last:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
        tell.send(told)

    def stop(number: int, frame: FrameType | None) -> NoReturn:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once is enough
        raise SystemExit

    # Whoever started it may be killed: it must not go on, unseen.
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who started it
    signal.signal(signal.SIGTERM, stop)
    try:
        work(report)
    except SystemExit:
        pass
    sys.stdout.flush()
    os._exit(0)  # what a library does at its end could hang


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Give a command, or watch the race.

    :return: a code of ``Exit``.
    """
    if '_ARGCOMPLETE' in os.environ:  # the shell asks what could come next
        _complete()
    given = list(sys.argv[1:] if arguments is None else arguments)
    wanted = parser().parse_args(without_ros_arguments(given))
    # A shell that starts it in the background makes it ignore SIGINT, and Python keeps that.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        _ask_for_name(wanted)
    except KeyboardInterrupt:
        return Exit.NOT_THERE
    began = now()

    def work(report: Report) -> None:
        from evgp_rcs_console.ctl_ros import attend

        attend(given, wanted, began, report)

    process = TimedProcess(work)
    try:
        return _answer(process, wanted, began)
    except KeyboardInterrupt:
        return Exit.ACCEPTED if wanted.command == 'watch' else Exit.NOT_THERE
    finally:
        process.end(TIDY)


def _complete() -> NoReturn:
    """Answer the shell, and exit. No command may ever come of a question."""
    import argcomplete

    argcomplete.autocomplete(parser())
    raise AssertionError('argcomplete exits')


def _ask_for_name(wanted: argparse.Namespace) -> None:
    """Ask the official at the terminal for a name, once; never before what stops a kart."""
    command = COMMANDS.get(wanted.command)
    if command is None or CATALOGUE[command].overtakes:
        return
    if wanted.official or not _official_is_there() or kept_name() is not None:
        return
    print(texts.NAME_PROMPT.format(command=CATALOGUE[command].label), end='', file=sys.stderr)
    sys.stderr.flush()
    line = os.read(sys.stdin.fileno(), MOST_BYTES).decode(errors='replace')
    if not line.endswith('\n'):
        print(file=sys.stderr)  # no answer: asked again the next time
        return
    try:
        keep_name(line)
    except (OSError, RuntimeError) as error:
        wanted.official = tidy(line)
        print(texts.NAME_NOT_KEPT.format(error=error), file=sys.stderr)


def _official_is_there() -> bool:
    """Return whether someone at a terminal sees a question, and can answer it."""
    if sys.stdin is None or not sys.stdin.isatty() or not sys.stderr.isatty():
        return False
    try:
        # Whoever reads from the terminal in the background is stopped.
        return os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except OSError:
        return False  # it is not our terminal


def _answer(process: TimedProcess, wanted: argparse.Namespace, began: float) -> int:
    """Print the answer, or that there is none, before anything is torn down."""
    ends = began + STARTING + wanted.wait
    told = process.report(ends - now())
    while told is not None and 'code' not in told:  # a `watch` that shows the race by itself
        told = process.report(STALLED)
    if told is None:
        waited = min(now(), ends) - began
        why = 'rcs_ctl failed' if process.failed else 'ROS hangs'
        told = {'code': Exit.NOT_THERE, 'error': _no_answer(wanted, waited, why)}
    for text, stream in ((told.get('output'), sys.stdout), (told.get('error'), sys.stderr)):
        if text:
            print(text, file=stream, flush=True)
    return int(told['code'])


def _no_answer(wanted: argparse.Namespace, waited: float, why: str) -> str:
    details = f'{why}; ROS domain {os.environ.get("ROS_DOMAIN_ID", "0")}'
    if wanted.command not in COMMANDS:
        return f'{texts.NOT_YET}: {texts.USE_MSR} ({details})'
    return no_answer(COMMANDS[wanted.command], waited, details)


if __name__ == '__main__':
    sys.exit(main())
