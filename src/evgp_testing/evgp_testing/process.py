# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Programs as real processes, whose output is kept and which always end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import contextlib
import os
import pathlib
import re
import select
import signal
import subprocess
import threading
import time

from ament_index_python.packages import get_package_prefix
from evgp_testing.part import Part, PATIENCE

started: list[Program] = []
"""Programs started by this process; the pytest plugin shows them on a failure and clears them."""


def executable(package: str, name: str) -> str:
    return str(pathlib.Path(get_package_prefix(package), 'lib', package, name))


def freeze(pid: int) -> None:
    """
    Stop a process with SIGSTOP, and return once none of its threads runs.

    On a busy computer, other threads continue until the thread that gets the signal has its turn.
    """
    os.kill(pid, signal.SIGSTOP)
    while any(_runs(stat) for stat in pathlib.Path(f'/proc/{pid}/task').glob('*/stat')):
        time.sleep(0.001)


def _runs(stat: pathlib.Path) -> bool:
    try:
        said = stat.read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False  # that thread has ended
    return said.rpartition(')')[2].split()[0] not in 'TtZX'


class Program(Part):
    """
    Any program as a process, whose output is kept and which always ends.

    ``lines`` are the lines that it has printed.

    :param name: the program's name in the output of a failed test.
    :param domain: its ROS domain; None for that of the environment.
    :param environment: more environment variables.
    :param end: the signal that the program gets if its parent is killed, so that it does not live
        on in a domain that others may then use.
    :param shown: whether to also print its output here.
    """

    def __init__(
        self,
        name: str,
        command: Sequence[str],
        domain: int | None = None,
        environment: Mapping[str, str] | None = None,
        end: str = 'KILL',
        shown: bool = False,
    ) -> None:
        self.name = name
        self._shown = shown
        self.lines: list[str] = []
        self._news = threading.Condition()
        whole = {
            **os.environ,
            **({} if domain is None else {'ROS_DOMAIN_ID': str(domain)}),
            'PYTHONUNBUFFERED': '1',
            **(environment or {}),
        }
        self.process = subprocess.Popen(
            ['setpriv', '--pdeathsig', end, *command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors='replace',
            env=whole,
        )
        started.append(self)
        self._ended = False
        self._take_output = threading.Event()
        self._take_output.set()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        return self.process.pid

    @property
    def runs(self) -> bool:
        return self.process.poll() is None

    @property
    def output(self) -> str:
        with self._news:
            return '\n'.join(self.lines)

    def wait_for_line(self, pattern: str) -> re.Match[str]:
        """
        Return the first match of a pattern in a past or future line of the output.

        :raises AssertionError: if the program ends, or time runs out, without such a line.
        """

        def found() -> re.Match[str] | None:
            matches = (re.search(pattern, line) for line in self.lines)
            return next((match for match in matches if match), None)

        with self._news:
            self._news.wait_for(lambda: found() or self._ended, PATIENCE)
            match = found()
            printed = '\n'.join(self.lines)
        assert match, f'{self.name} did not print {pattern!r}; it printed:\n{printed}'
        return match

    def wait(self) -> int:
        """Wait until the program ends, and return its exit code, or minus the signal's number."""
        code = self.process.wait(PATIENCE)
        self._reader.join(PATIENCE)
        return code

    @contextlib.contextmanager
    def output_held_up(self) -> Iterator[None]:
        """Meanwhile, read none of the output, like a terminal after Ctrl-S."""
        self._take_output.clear()
        try:
            yield
        finally:
            self._take_output.set()

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to the program. After a SIGSTOP, return only once it has stopped."""
        if number is signal.SIGSTOP and self.process.poll() is None:
            freeze(self.process.pid)
        else:
            self.process.send_signal(number)

    def kill(self) -> None:
        """End the program as if it had crashed."""
        self.process.kill()
        self.wait()

    def close(self) -> int:
        """End the program in order, or by force if that takes too long; return its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
            self.process.terminate()
            try:
                self.process.wait(10)
            except subprocess.TimeoutExpired:
                self.process.kill()
        return self.wait()

    def _read(self) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as output:
            for line in output:
                self._take_output.wait()
                if self._shown:
                    print(line, end='', flush=True)
                with self._news:
                    self.lines.append(line.rstrip('\n'))
                    self._news.notify_all()
        with self._news:
            self._ended = True
            self._news.notify_all()


class Process(Program):
    """
    An executable of a package, started with ROS parameters on a ROS domain.

    :param parameters: ROS parameters, as ``-p name:=value``.
    :param arguments: further arguments after ``--ros-args``.
    :param under: a command, with its arguments, that runs the executable.
    :param shown: whether to also print its output here.
    """

    def __init__(
        self,
        package: str,
        name: str,
        domain: int,
        parameters: Mapping[str, object] | None = None,
        arguments: tuple[str, ...] = (),
        under: tuple[str, ...] = (),
        shown: bool = False,
    ) -> None:
        command = [*under, executable(package, name), '--ros-args', *arguments]
        for parameter, value in (parameters or {}).items():
            text = str(value).lower() if isinstance(value, bool) else str(value)
            command += ['-p', f'{parameter}:={text}']
        super().__init__(name, command, domain, end='TERM' if under else 'KILL', shown=shown)


def wait_until_ended(pid: int) -> None:
    """
    Wait until a process has ended, whoever its parent is.

    :raises AssertionError: if it does not end in time.
    """
    with contextlib.suppress(ProcessLookupError):
        descriptor = os.pidfd_open(pid)
        with open(descriptor):  # noqa: PTH123 - to close it
            assert select.select([descriptor], [], [], PATIENCE)[0], f'process {pid} still runs'
