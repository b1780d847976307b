# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A program at a terminal of its own, as somebody starts it from a shell."""

from __future__ import annotations

import codecs
from collections.abc import Mapping, Sequence
import contextlib
import os
import pathlib
import pty
import re
import select
import subprocess

from evgp_testing.part import Part, PATIENCE


class Terminal(Part):
    """
    A program that is in the foreground of a terminal.

    ``shown`` is what the terminal shows. It is read while somebody waits for it.
    """

    def __init__(
        self,
        command: Sequence[str],
        environment: Mapping[str, str] | None = None,
        cwd: pathlib.Path | None = None,
    ) -> None:
        self.shown = ''
        self._decode = codecs.getincrementaldecoder('utf-8')('replace').decode
        self._hand, its_end = pty.openpty()
        self.process = subprocess.Popen(
            ['setsid', '--ctty', *command],
            stdin=its_end,
            stdout=its_end,
            stderr=its_end,
            cwd=cwd,
            env={**os.environ, **(environment or {})},
        )
        os.close(its_end)

    def press(self, keys: str) -> None:
        os.write(self._hand, keys.encode())

    def wait_for(self, pattern: str) -> re.Match[str]:
        """
        Return the first match in what the terminal shows, once there is one.

        :raises AssertionError: if the program ends, or shows nothing more for long, without it.
        """
        while not (found := re.search(pattern, self.shown)):
            assert self._read(), f'{pattern!r} is not shown:\n{self.shown}'
        return found

    def end(self) -> int:
        """Return the exit code, once the program has ended."""
        while self._read():
            pass
        return self.process.wait(PATIENCE)

    def hang_up(self) -> None:
        """Close the terminal, as by its window."""
        with contextlib.suppress(OSError):
            os.close(self._hand)
        self._hand = -1  # its number may be of another file soon

    def close(self) -> None:
        """End what still runs."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.hang_up()

    def _read(self) -> bool:
        """Read more; return whether there was any."""
        assert select.select([self._hand], [], [], 2 * PATIENCE)[0], self.shown
        try:
            data = os.read(self._hand, 65536)
        except OSError:  # nobody has the other end any more
            data = b''
        self.shown += self._decode(data)
        return bool(data)
