# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0
# PYTHON_ARGCOMPLETE_OK

"""
The officials' terminal client as a process: it keeps the deadline and prints the answer.

It contains none of the rules. ROS code may hang inside DDS while it holds the interpreter's lock.
In that case, the C library prints that there is no answer and ends the process (`end_within`).
ROS is imported only to send a command or show the race, so that Tab completion stays fast.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import contextlib
import ctypes
import os
import signal
import sys
import traceback

from evgp_node.official import tidy
from evgp_node.output import show_what_it_can
from evgp_protocol.clock import now
from evgp_rcs_console import texts
from evgp_rcs_console.catalogue import CATALOGUE
from evgp_rcs_console.command_line import COMMANDS, Exit, parse, parser, STARTING, Told
from evgp_rcs_console.commands import Given
from evgp_rcs_console.settings import keep, kept, MOST_BYTES, NAME

TIDY = 1.0
"""Maximum time to leave the ROS domain after the answer is printed, in seconds."""

STALLED = 5.0
"""Time after which one round of a `watch` counts as hung, in seconds. It normally takes at most
1 s."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Give a command, or watch the race; return a code of ``Exit``."""
    if '_ARGCOMPLETE' in os.environ:  # the shell asks for what Tab completes
        import argcomplete

        argcomplete.autocomplete(parser())
        raise AssertionError('argcomplete exits')  # Tab must never send a command
    words = sys.argv[1:] if arguments is None else arguments
    # ROS cannot carry a word in another encoding, such as a name typed at an old terminal.
    given = [os.fsencode(each).decode(errors='replace') for each in words]
    show_what_it_can()
    wanted = parse(given)
    # A shell that starts a program in the background makes it ignore SIGINT; Python keeps that.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        _ask_for_name(wanted)
    except KeyboardInterrupt:
        return Exit.NOT_THERE
    return _work(given, wanted)


def _work(given: Sequence[str], wanted: argparse.Namespace) -> int:
    """Carry out the command with ROS and print the answer before ROS is shut down."""
    from evgp_node.deadline import end_within

    _let_a_second_interrupt_kill()
    began, limit = now(), STARTING + wanted.wait

    def hangs(seconds: float) -> None:
        end_within(max(seconds, 0.001), Exit.NOT_THERE, _no_answer(wanted, limit, 'ROS has hung'))

    hangs(limit)
    told = Told(Exit.NOT_THERE)
    with contextlib.ExitStack() as parts:
        try:
            from evgp_rcs_console.ctl_ros import attend

            told = attend(given, wanted, began, parts, lambda: hangs(STALLED))
        except KeyboardInterrupt:
            if wanted.command == 'watch':
                told = told._replace(code=Exit.ACCEPTED)
            elif wanted.command in COMMANDS and not (told.output or told.error):
                # After sending, ctl_ros says what is known.
                told = Told(Exit.NOT_THERE, error=wanted.parser.unsent)
        except BrokenPipeError:
            told = told._replace(code=Exit.ACCEPTED)  # the reader of a watch has closed the pipe
        except Exception:  # noqa: BLE001 - tell the official
            traceback.print_exc()
            error = _no_answer(wanted, now() - began, 'rcs_ctl failed')
            told = Told(Exit.NOT_THERE, error=error)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        end_within(0.0, 0)
        try:
            for said, stream in ((told.output, sys.stdout), (told.error, sys.stderr)):
                if said:
                    with contextlib.suppress(OSError):  # whoever cannot print has still sent it
                        print(said, file=stream, flush=True)
        finally:
            end_within(TIDY, told.code)
    os._exit(told.code)  # a library's clean-up could hang


def _let_a_second_interrupt_kill() -> None:
    """Have the first Ctrl-C restore the kernel's default for SIGINT, because Python may hang."""
    handle = ctypes.CDLL(None).sysv_signal
    handle.restype, handle.argtypes = ctypes.c_void_p, (ctypes.c_int, ctypes.c_void_p)
    handle(signal.SIGINT, handle(signal.SIGINT, None))


def _ask_for_name(wanted: argparse.Namespace) -> None:
    """Ask the official at the terminal for a name once, but never before a stop or RACE OVER."""
    command = COMMANDS.get(wanted.command)
    if command is None or CATALOGUE[command].overtakes:
        return
    if wanted.official or not _official_is_there() or kept(NAME) is not None:
        return
    sends = f'Enter also sends {CATALOGUE[command].label}; Ctrl-C sends nothing'
    print(f'Your name, for the record ({sends}): ', end='', file=sys.stderr, flush=True)
    line = os.read(sys.stdin.fileno(), MOST_BYTES).decode(errors='replace')
    if not line.endswith('\n'):
        print(file=sys.stderr)  # no answer, so rcs_ctl asks again the next time
        return
    try:
        keep(NAME, line)
    except (OSError, RuntimeError) as error:
        wanted.official = tidy(line)
        print(texts.NOT_KEPT.format(error=error), file=sys.stderr)


def _official_is_there() -> bool:
    """Return whether someone at a terminal can see and answer a question."""
    if sys.stdin is None or not sys.stdin.isatty() or not sys.stderr.isatty():
        return False
    try:
        # The kernel stops a background process that reads from the terminal.
        return os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except OSError:
        return False  # the terminal is not ours


def _no_answer(wanted: argparse.Namespace, waited: float, why: str) -> str:
    details = f'{why}; ROS domain {os.environ.get("ROS_DOMAIN_ID", "0")}'
    if wanted.command not in COMMANDS:
        return f'{texts.NOT_YET}: {texts.USE_MSR} ({details})'
    given = Given(COMMANDS[wanted.command], getattr(wanted, 'kart', 0))
    return texts.no_answer(given, waited, details)


if __name__ == '__main__':
    sys.exit(main())
