# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Keeps a program running: starts it again when it dies, as ``ros2 launch`` does with ``respawn``.

Use: ``python -m evgp_node.restarting program argument ...``

It is the program's only parent, in the same terminal and process group, and has no ROS, no thread
and no socket: nothing in it can hang with the program. These ends are final, and the program's
exit code is passed on:

- exit code 0: it ended in good order;
- exit code 2 before it was ever up: a setting is wrong, and will be wrong the next time;
- exit code 3 before it was ever up, for longer than `FIRST_TRIES`: something is in the way, such
  as another one that runs. It must not take over later, when nobody expects it;
- any end after this process was told to end (`ENDING`). It passes the signal on and waits.

After any other end the program is started again: at once the first time, later the longer it keeps
failing. Before that, every process that the program has left behind must have ended. Such an
orphan gets `LEFT_BEHIND` to do what it must, such as a last RED_RED, and is killed then.

A program that does not notice for `HANGS` that a process of its own has ended hangs: it is killed,
and started again.
"""

from __future__ import annotations

from collections.abc import Sequence
import ctypes
import math
import os
import pathlib
import select
import signal
import sys
import time
from typing import NoReturn

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
"""The signals that end a program of ours in good order; a terminal that is closed sends one."""

DELAYS = (0.0, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Time before the first, second, ... restart in a row, in seconds; the last serves all further."""

HEALTHY = 30.0
"""Time after which a program that runs counts as healthy again, in seconds."""

LEFT_BEHIND = 5.0
"""Maximum time that processes of the program may outlive it, in seconds; then they are killed."""

PROGRAM_END_TIMEOUT = 15.0
"""Maximum time the program may take to end when it was told to, in seconds; then it is killed.
A node of ours takes 10 s at most."""

TERMINAL_LOOK = 1.0
"""Time between two looks whether the terminal is still there, in seconds. The kernel tells only
the first process of a terminal when it is closed, and that one may be make, which tells nobody."""

HANGS = 10.0
"""Time after which a program that takes no note of its ended child is killed, in seconds."""

FIRST_TRIES = 10.0
"""Maximum time for which a program that was never up is started again and again because something
is in the way, in seconds. What an earlier one has left behind ends sooner."""

WRONG_SETTING = 2
"""The exit code of a program that a setting keeps from starting: to start it again changes
nothing."""

IN_THE_WAY = 3
"""The exit code of a program that something around it keeps from starting; it may start later."""

_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36  # of linux/prctl.h
_LIBC = ctypes.CDLL(None)
_AWAITED = (*ENDING, signal.SIGCHLD)
_terminal = select.poll()


def delay_before(failures: int) -> float:
    """Return how long to wait before a restart, in seconds, after so many failures in a row."""
    return DELAYS[min(failures, len(DELAYS)) - 1]


class Ends:
    """
    Which ends of a program are final.

    :param now: when it is started first, in seconds of a monotonic clock.
    """

    def __init__(self, now: float) -> None:
        """Begin with a program that was never up."""
        self._began = now
        self._was_up = False

    def is_final(self, code: int, now: float) -> bool:
        """Take note of an end (negative: a signal); return whether no start follows it."""
        if code not in (WRONG_SETTING, IN_THE_WAY):
            # Not refused: what refuses it later may be what it has left behind, or what has
            # changed around it. The settings are those with which it was up.
            self._was_up = True
        if code == 0:
            return True
        if self._was_up:
            return False
        return code == WRONG_SETTING or now - self._began >= FIRST_TRIES


def keep_running(command: Sequence[str]) -> int:
    """
    Run a program until it ends for good.

    :param command: the program and its arguments.
    :return: its exit code; 128 and the signal's number if a signal ended it.
    """
    # What a program leaves behind when it dies becomes a child of this process.
    _LIBC.prctl(_PR_SET_CHILD_SUBREAPER, 1)
    # From now on a signal waits until it is taken by `_wait`: none comes at a wrong moment.
    signal.pthread_sigmask(signal.SIG_BLOCK, _AWAITED)
    # A shell that puts a job into the background has it ignore SIGINT.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    # Where this one is ignored, the kernel tells nobody that the program has ended, nor how.
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    if os.isatty(0):
        _terminal.register(0, 0)
    signal.signal(signal.SIGTSTP, signal.SIG_IGN)  # Ctrl-Z: the program ignores it too
    failures = 0
    ends = Ends(time.monotonic())
    while True:
        began = time.monotonic()
        code, told = _run(command)
        next_try = time.monotonic() + delay_before(failures + 1)
        if told or ends.is_final(code, next_try):
            if code == IN_THE_WAY and not told:
                _say(
                    f'{_name(command)} cannot start because something is in its way, as it says '
                    'above. It is not started again.'
                )
            return code if code >= 0 else 128 - code
        failures = 1 if time.monotonic() - began >= HEALTHY else failures + 1
        _say(_what_happened(_name(command), code, failures))
        if _wait(delay_before(failures), ENDING) is not None:
            return 0


def _run(command: Sequence[str]) -> tuple[int, bool]:
    """Run the program once; return how it ended, and whether this process was told to end."""
    program = _start(command)
    code: int | None = None
    told = False
    ends: float | None = None
    unnoticed: dict[int, float] = {}
    while True:
        left = TERMINAL_LOOK if ends is None else max(0.0, ends - time.monotonic())
        came = _wait(left, _AWAITED)
        if came in ENDING:
            told = True
            if code is None:
                _send(program, signal.Signals(came))
                ends = ends or time.monotonic() + PROGRAM_END_TIMEOUT
        ended, orphans = _reap(program)
        if ended is not None:
            code = ended
            # Counted from the end of the program: time for what it has left behind.
            ends = time.monotonic() + LEFT_BEHIND
        if code is not None and not orphans:
            return code, told
        if ends is None:
            now = time.monotonic()
            unnoticed = {each: unnoticed.get(each, now) for each in _ended_children(program)}
            if any(now - since >= HANGS for since in unnoticed.values()):
                _say(f'{_name(command)} hangs: it is killed.')
                _send(program, signal.SIGKILL)
        elif came is None:
            for each in [program] if code is None else _children():
                _send(each, signal.SIGKILL)
            ends = None


def _start(command: Sequence[str]) -> int:
    """Start the program and return its process number."""
    parent = os.getpid()
    program = os.fork()
    if program == 0:
        _become(command, parent)
    return program


def _become(command: Sequence[str], parent: int) -> NoReturn:
    """Turn this forked process into the program."""
    try:
        # Without this process nobody would start it again, and Ctrl-C would not reach it.
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() == parent:
            signal.signal(signal.SIGTSTP, signal.SIG_DFL)
            signal.pthread_sigmask(signal.SIG_UNBLOCK, _AWAITED)
            os.execvp(command[0], list(command))  # noqa: S606 - the program that is asked for
    except OSError as error:
        _say(f'{command[0]} cannot be started: {error.strerror}')
    finally:
        os._exit(WRONG_SETTING)


def _wait(seconds: float | None, awaited: Sequence[int]) -> int | None:
    """Return the signal that came, None after so many seconds without one (None: for ever)."""
    until = None if seconds is None else time.monotonic() + seconds
    while True:
        left = math.inf if until is None else max(0.0, until - time.monotonic())
        came = signal.sigtimedwait(awaited, min(TERMINAL_LOOK, left))
        if came is not None:
            return came.si_signo
        if _terminal.poll(0):
            _terminal.unregister(0)
            return signal.SIGHUP
        if until is not None and time.monotonic() >= until:
            return None


def _reap(program: int) -> tuple[int | None, bool]:
    """Return how the program ended, if it has since, and whether there are other processes."""
    code = None
    while True:
        try:
            ended, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return code, False
        if ended == 0:
            return code, True
        if ended == program:
            code = os.waitstatus_to_exitcode(status)


def _ended_children(program: int) -> list[int]:
    """Return the children of the program that have ended and that it has not asked about."""
    ended = []
    try:
        for task in pathlib.Path(f'/proc/{program}/task').iterdir():
            for child in (task / 'children').read_text(encoding='ascii').split():
                status = pathlib.Path(f'/proc/{child}/stat').read_text(errors='replace')
                if status.rpartition(')')[2].split()[0] == 'Z':
                    ended.append(int(child))
    except OSError:
        pass  # something has ended just now: the next look tells
    return ended


def _children() -> list[int]:
    with open(f'/proc/self/task/{os.getpid()}/children', encoding='ascii') as file:  # noqa: PTH123
        return [int(each) for each in file.read().split()]


def _send(process: int, number: signal.Signals) -> None:
    """Send a signal to a child; until it is reaped, its number is nobody else's."""
    os.kill(process, number)
    if number is not signal.SIGKILL:
        os.kill(process, signal.SIGCONT)  # a frozen one could not end


def _name(command: Sequence[str]) -> str:
    return os.path.basename(command[0])  # noqa: PTH119


def _what_happened(name: str, code: int, failures: int) -> str:
    how = f'was killed ({signal.Signals(-code).name})' if code < 0 else f'ended with code {code}'
    delay = delay_before(failures)
    when = f'in {delay:g} s' if delay else 'now'
    again = f', {failures} times in a row' if failures > 1 else ''
    return f'{name} {how}{again}. It is started again {when}.'


def _say(text: str) -> None:
    """Print a line on stderr, unless nobody takes it: a terminal after Ctrl-S holds up nothing."""
    try:
        if select.select([], [2], [], 0)[1]:
            os.write(2, f'{text}\n'.encode())
    except OSError:
        pass  # a terminal that was closed


if __name__ == '__main__':
    if len(sys.argv) < 2:
        sys.exit('use: python -m evgp_node.restarting program argument ...')
    sys.exit(keep_running(sys.argv[1:]))
