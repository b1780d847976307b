# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The shortest loop that keeps a program running where there is neither systemd nor ``ros2 launch``.

Use: ``python -m evgp_node.restarting program argument ...``

A program that dies is started again; `Ends` says which ends are final, and the program's exit code
is passed on. A signal of `ENDING` and a terminal that is closed end both for good.
"""

from __future__ import annotations

from collections.abc import Sequence
import os
import select
import signal
import subprocess
import sys
import time

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
"""The signals that end a program of ours in good order; a terminal that is closed sends one."""

DELAYS = (0.0, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Time before the first, second, ... restart in a row, in seconds; the last serves all further."""

HEALTHY = 30.0
"""Time after which a program that runs counts as healthy again, in seconds."""

FIRST_TRIES = 10.0
"""Maximum time for which a program that was never up is started again and again because something
is in the way, in seconds. What an earlier one has left behind ends sooner."""

WRONG_SETTING = 2
"""The exit code of a program that a setting keeps from starting: to start it again changes
nothing."""

IN_THE_WAY = 3
"""The exit code of a program that something around it keeps from starting; it may start later."""


class Ends:
    """
    Which ends of a program are final.

    :param now: when it is started first, in seconds of a monotonic clock.
    :param gives_way: whether what is in the way for `FIRST_TRIES` ends it also after it was up.
    """

    def __init__(self, now: float, *, gives_way: bool = False) -> None:
        self._tries_since = now
        self._gives_way = gives_way
        self._was_up = False

    def is_final(self, code: int, now: float) -> bool:
        """Take note of an end (negative: a signal); return whether no start follows it."""
        if code not in (WRONG_SETTING, IN_THE_WAY):
            # Not refused: what refuses it later may be what it has left behind, or what has
            # changed around it. The settings are those with which it was up.
            self._was_up = True
            self._tries_since = now
        if code == 0:
            return True
        if self._was_up and not (self._gives_way and code == IN_THE_WAY):
            return False
        # A second one that is started by mistake must not take over later, unexpected.
        return code == WRONG_SETTING or now - self._tries_since >= FIRST_TRIES


def keep_running(command: Sequence[str], *, gives_way: bool = False) -> int:
    """
    Run a program until it ends for good.

    :param command: the program and its arguments.
    :param gives_way: as of `Ends`.
    :return: its exit code; 128 and the signal's number if a signal ended it.
    """
    told, tell = os.pipe()
    os.set_blocking(tell, False)
    signal.set_wakeup_fd(tell, warn_on_full_buffer=False)
    for number in ENDING:
        signal.signal(number, lambda *_: None)
    signal.signal(signal.SIGTSTP, signal.SIG_IGN)  # Ctrl-Z
    # Where whoever started this one ignores it, nobody learns how the program ended.
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    news = select.poll()
    news.register(told, select.POLLIN)
    if os.isatty(0):
        # Its hang-up: the kernel tells only the terminal's first process, which may be make.
        news.register(0, 0)
    name = os.path.basename(command[0])  # noqa: PTH119
    failures = 0
    ends = Ends(time.monotonic(), gives_way=gives_way)
    while True:
        began = time.monotonic()
        # In a session of its own: it hears of the terminal through this process.
        program = subprocess.Popen(
            ['setpriv', '--pdeathsig', 'TERM', *command], start_new_session=True
        )
        ended = os.pidfd_open(program.pid)
        news.register(ended, select.POLLIN)
        is_told = [ready for ready, _ in news.poll() if ready != ended]
        news.unregister(ended)
        os.close(ended)
        if is_told:
            program.terminate()
            program.send_signal(signal.SIGCONT)  # a stopped one could not end
        code = program.wait()
        now = time.monotonic()
        failures = 1 if now - began >= HEALTHY else failures + 1
        delay = DELAYS[min(failures, len(DELAYS)) - 1]
        if is_told or ends.is_final(code, now + delay):
            return code if code >= 0 else 128 - code
        how = (
            f'was killed ({signal.Signals(-code).name})' if code < 0 else f'ended with code {code}'
        )
        _say(f'{name} {how}. It is started again {f"in {delay:g} s" if delay else "now"}.')
        if news.poll(delay * 1000):
            return 0


def _say(text: str) -> None:
    """Print a line on stderr, unless nobody takes it: a terminal after Ctrl-S holds up nothing."""
    try:
        if select.select([], [2], [], 0)[1]:
            os.write(2, f'{text}\n'.encode())
    except OSError:
        pass  # it was closed


if __name__ == '__main__':
    sys.exit(keep_running(sys.argv[1:]))
