# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What is kept on this machine for its officials: their name, and whether the window is dark.

The name that commands carry was given at start, or kept from before, or is not known. It is asked
for once and kept in a plain text file, for the window and `rcs_ctl`. No Qt, no ROS.
"""

from __future__ import annotations

import contextlib
import os
import pathlib
import platform
import sys
import tempfile
import threading

from evgp_node.folder import rcs_folder
from evgp_node.official import claim, tidy
from evgp_rcs_console import texts

MOST_BYTES = 4096
"""Maximum of the file that is read, in bytes."""


class Signature:
    """
    Who commands from this program.

    :param name: the official's name, if it was given at start; empty: the one that is kept.
    :param process: the number of this process, if another one may send in the same name.
    """

    def __init__(self, name: str = '', process: int | None = None) -> None:
        """Take the name that was given, or else the one that is kept."""
        self._name = tidy(name) or kept_name() or ''
        self._process = process

    @property
    def name(self) -> str:
        """Return the official's name; empty: not known."""
        return self._name

    @property
    def claim(self) -> str:
        """Return what goes with a command."""
        return claim(self._name, platform.node(), self._process)

    def sign(self, name: str) -> None:
        """Take a name from now on, and keep it; a disk that hangs holds nobody up."""
        self._name = tidy(name)
        threading.Thread(target=self._keep, args=(self._name,), daemon=True).start()

    def _keep(self, name: str) -> None:
        try:
            keep_name(name)
        except (OSError, RuntimeError) as error:
            print(texts.NAME_NOT_KEPT.format(error=error), file=sys.stderr)


def file_of_name() -> pathlib.Path:
    """
    Return the file in which the name is kept.

    :raises RuntimeError: if there is no home folder.
    """
    return rcs_folder() / 'official'


def kept_name() -> str | None:
    """Return the name that is kept; None: nobody was asked yet, or it cannot be read."""
    try:
        # Whatever is there, such as a pipe: nothing here may wait for it.
        flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC
        with os.fdopen(os.open(file_of_name(), flags), 'rb', buffering=0) as file:
            data = file.read(MOST_BYTES)
    except (OSError, RuntimeError):
        return None
    return tidy((data or b'').decode(errors='replace'))


def keep_name(name: str) -> None:
    """
    Keep a name for the next start; empty: the official wants none, and is not asked again.

    :raises OSError: if the disk does not take it.
    :raises RuntimeError: if there is no home folder.
    """
    _keep(file_of_name(), f'{tidy(name)}\n')


def is_night() -> bool:
    """Return whether the window was dark when it was used last."""
    try:
        return (rcs_folder() / 'night').exists()
    except (OSError, RuntimeError):
        return False


def keep_night(night: bool) -> None:
    """Keep whether the window is dark; a disk that hangs holds nobody up."""

    def keep() -> None:
        with contextlib.suppress(OSError, RuntimeError):
            if night:
                _keep(rcs_folder() / 'night', '')
            else:
                (rcs_folder() / 'night').unlink(missing_ok=True)

    threading.Thread(target=keep, daemon=True).start()


def _keep(path: pathlib.Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    # In one piece: another program may read it just now.
    descriptor, other = tempfile.mkstemp(prefix=f'.{path.name}', dir=path.parent)
    try:
        with os.fdopen(descriptor, 'wb') as file:
            file.write(text.encode())
        pathlib.Path(other).replace(path)
    except OSError:
        pathlib.Path(other).unlink(missing_ok=True)
        raise
