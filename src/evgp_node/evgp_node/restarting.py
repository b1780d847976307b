# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A small loop that keeps a program running, for make, launch files and a spare machine.

Usage: ``python -m evgp_node.restarting program argument ...``

The loop restarts a program that dies, unless `Ends` says that this end is final; the loop then
exits with the program's exit code. A signal of `ENDING` or a closed terminal ends both for good.
"""

from __future__ import annotations

from collections.abc import Sequence
import os
import select
import signal
import subprocess
import sys
import time

from evgp_node.output import open_closed_streams

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
"""Signals that end our programs normally. A terminal sends one of them when it is closed."""

PREFIX = f'{sys.executable} -m evgp_node.restarting'
"""What a launch file puts before a program that is to be restarted."""

DELAYS = (0.0, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Times before the first, second, ... restart in a row, in seconds. The last one repeats."""

HEALTHY = 30.0
"""Time for which a program must run before the next restart counts as the first, in seconds."""

FIRST_TRIES = 10.0
"""Maximum time for retrying a program that was never up because something is in the way, in
seconds. The remains of an earlier run disappear sooner."""

WRONG_SETTING = 2
"""Exit code of a program that cannot start because of a setting. A restart would not help."""

IN_THE_WAY = 3
"""Exit code of a program that cannot start now because something is in the way."""


class Ends:
    """
    The rules that decide which ends of a program are final.

    :param now: time of the first start by a monotonic clock, in seconds.
    :param gives_way: whether an obstacle that lasts for `FIRST_TRIES` ends the program for good
        even if the program was up before.
    """

    def __init__(self, now: float, *, gives_way: bool = False) -> None:
        self._tries_since = now
        self._gives_way = gives_way
        self._was_up = False

    def is_final(self, code: int, now: float) -> bool:
        """
        Record an end of the program, and return whether it is final.

        :param code: exit code of the program, or the negative number of the signal that ended it.
        """
        if code not in (WRONG_SETTING, IN_THE_WAY):
            # The program was up with these settings, so a later refusal may be due to its own
            # remains or to a change around it.
            self._was_up = True
            self._tries_since = now
        if code == 0:
            return True
        if self._was_up and not (self._gives_way and code == IN_THE_WAY):
            return False
        # A second program that someone started by mistake must not take over later.
        return code == WRONG_SETTING or now - self._tries_since >= FIRST_TRIES


def keep_running(command: Sequence[str], *, gives_way: bool = False) -> int:
    """
    Run a program until it ends for good (`Ends`).

    :return: the program's exit code, or 128 plus the number of the signal that ended it; 0 if a
        signal came while the program was not running.
    """
    open_closed_streams()
    told, tell = os.pipe()
    os.set_blocking(tell, False)
    signal.set_wakeup_fd(tell, warn_on_full_buffer=False)
    for number in ENDING:
        signal.signal(number, lambda *_: None)
    signal.signal(signal.SIGTSTP, signal.SIG_IGN)  # Ctrl-Z
    # If SIGCHLD stayed ignored, as some parents leave it, the program's exit code would be lost.
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    news = select.poll()
    news.register(told, select.POLLIN)
    if os.isatty(0):
        # Watch for a closed terminal here, because the kernel signals only the terminal's first
        # process, which may be make.
        news.register(0, 0)
    name = os.path.basename(command[0])  # noqa: PTH119
    failures = 0
    ends = Ends(time.monotonic(), gives_way=gives_way)
    while True:
        began = time.monotonic()
        # Give the program a session of its own, so that signals from the terminal reach it only
        # through this process.
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
            program.send_signal(signal.SIGCONT)  # a suspended program could not end
        code = program.wait()
        now = time.monotonic()
        failures = 1 if now - began >= HEALTHY else failures + 1
        delay = DELAYS[min(failures, len(DELAYS)) - 1]
        if is_told or ends.is_final(code, now + delay):
            return code if code >= 0 else 128 - code
        how = (
            f'was killed ({signal.Signals(-code).name})' if code < 0 else f'ended with code {code}'
        )
        _say(f'{name} {how}. Starting it again {f"in {delay:g} s" if delay else "now"}.')
        if news.poll(delay * 1000):
            return 0


def _say(text: str) -> None:
    """Print a line on stderr, unless printing would block, as on a terminal after Ctrl-S."""
    try:
        if select.select([], [2], [], 0)[1]:
            os.write(2, f'{text}\n'.encode())
    except OSError:
        pass  # stderr is closed


if __name__ == '__main__':
    sys.exit(keep_running(sys.argv[1:]))
