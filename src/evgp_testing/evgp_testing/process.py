"""A node as a real process: what it prints is kept, and it always ends."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import contextlib
import os
import pathlib
import re
import signal
import subprocess
import threading

from ament_index_python.packages import get_package_prefix
from evgp_testing import nursery

PATIENCE = 30.0
"""How long anything is awaited before a test gives up, seconds: far more than it ever takes."""


class Process:
    """
    An executable of a package, started with ROS parameters on a ROS domain.

    :param parameters: ROS parameters, as ``-p name:=value``.
    :param arguments: further arguments behind ``--ros-args``.
    :param under: a command that runs it, with its own arguments.
    """

    def __init__(
        self,
        package: str,
        executable: str,
        domain: int,
        parameters: Mapping[str, object] | None = None,
        arguments: tuple[str, ...] = (),
        under: tuple[str, ...] = (),
    ) -> None:
        """Start the process."""
        path = pathlib.Path(get_package_prefix(package), 'lib', package, executable)
        command = [*under, str(path), '--ros-args', *arguments]
        for name, value in (parameters or {}).items():
            text = str(value).lower() if isinstance(value, bool) else str(value)
            command += ['-p', f'{name}:={text}']
        self.name = executable
        self.lines: list[str] = []
        self._news = threading.Condition()
        environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain), 'PYTHONUNBUFFERED': '1'}
        self._process = nursery.start(command, environment) or subprocess.Popen(
            # Whoever started it may be killed; it must not live on, on a domain that others take.
            ['setpriv', '--pdeathsig', 'TERM' if under else 'KILL', *command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors='replace',
            env=environment,
        )
        self._ended = False
        self._take_output = threading.Event()
        self._take_output.set()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """Return the process number."""
        return self._process.pid

    @property
    def output(self) -> str:
        """Return all it has printed."""
        with self._news:
            return '\n'.join(self.lines)

    def wait_for_line(self, pattern: str) -> re.Match[str]:
        """
        Return the first match of a pattern in a line it has printed or prints.

        :raises AssertionError: if it ends or the patience does, without such a line.
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
        """Return its exit code once it has ended by itself (negative: the signal's number)."""
        code = self._process.wait(PATIENCE)
        self._reader.join(PATIENCE)
        return code

    @contextlib.contextmanager
    def output_held_up(self) -> Iterator[None]:
        """Take nothing of what it prints, meanwhile: as a terminal after Ctrl-S."""
        self._take_output.clear()
        try:
            yield
        finally:
            self._take_output.set()

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        self._process.send_signal(number)

    def kill(self) -> None:
        """End it as a crash does."""
        self._process.kill()
        self.wait()

    def close(self) -> int:
        """End it in an orderly way, or by force if that takes too long; return its exit code."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGCONT)
            self._process.terminate()
            try:
                self._process.wait(10)
            except subprocess.TimeoutExpired:
                self._process.kill()
        return self.wait()

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as output:
            for line in output:
                self._take_output.wait()
                with self._news:
                    self.lines.append(line.rstrip('\n'))
                    self._news.notify_all()
        with self._news:
            self._ended = True
            self._news.notify_all()

    def __enter__(self) -> Process:
        """Return this process."""
        return self

    def __exit__(self, *exc: object) -> None:
        """End it."""
        self.close()
