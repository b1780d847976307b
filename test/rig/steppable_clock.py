# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The clocks of a machine, which a test steps while processes run on it."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import os
import pathlib
import struct
import subprocess

from evgp_testing.part import Part
from evgp_testing.ros_side import environment_kept

SOURCE = pathlib.Path(__file__).with_suffix('.c')


class SteppableClock(Part):
    """
    The wall clock and the boot-time clock of the processes that are started inside `on_it`.

    No container can set a clock for some processes only, so a preloaded library does.

    :param folder: where the library is built.
    """

    def __init__(self, folder: pathlib.Path) -> None:
        """Build the library; the clocks go right as yet."""
        self._library = folder / 'steppable_clock.so'
        subprocess.run(
            ['cc', '-O2', '-shared', '-fPIC', '-o', self._library, SOURCE, '-ldl'], check=True
        )
        self._path = folder / 'clock'
        self._wall = self._boot = 0.0
        self._file = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o600)
        self._write()

    def set_wall(self, offset: float) -> None:
        """Set the wall clock to this many seconds ahead of the right time."""
        self._wall = offset
        self._write()

    def suspend(self, seconds: float) -> None:
        """Let the time of a suspend pass: for all clocks but the monotonic one."""
        self._wall += seconds
        self._boot += seconds
        self._write()

    @contextlib.contextmanager
    def on_it(self) -> Iterator[None]:
        """Have the processes that are started meanwhile go by these clocks."""
        own = {'LD_PRELOAD': str(self._library), 'EVGP_TEST_CLOCK': str(self._path)}
        with environment_kept():
            os.environ.update(own)
            yield

    def _write(self) -> None:
        nanoseconds = (round(each * 1e9) for each in (self._wall, self._boot))
        os.pwrite(self._file, struct.pack('=qq', *nanoseconds), 0)

    def close(self) -> None:
        os.close(self._file)
