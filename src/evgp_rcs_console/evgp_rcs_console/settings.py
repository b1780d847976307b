# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Saves settings on this machine: the name of its official, and whether the window is dark.

Commands carry the official's name, if it is known. It can be given at the start; otherwise the
programs ask for it once and save it in a text file, which the window and `rcs_ctl` share. This
module uses neither Qt nor ROS.
"""

from __future__ import annotations

import contextlib
import os
import pathlib
import platform
import sys
import threading

from evgp_node.folder import rcs_folder
from evgp_node.official import claim, tidy
from evgp_rcs_console import texts

MOST_BYTES = 4096
"""Maximum number of bytes read from the file."""


class Signature:
    """
    The signature under which this program sends commands.

    :param name: the official's name, if it was given at the start; empty: the saved name.
    :param process: the number of this process, if another one may send under the same name.
    :ivar name: the official's name; empty if it is not known.
    """

    def __init__(self, name: str = '', process: int | None = None) -> None:
        self.name = tidy(name) or kept_name() or ''
        self._process = process

    @property
    def claim(self) -> str:
        return claim(self.name, platform.node(), self._process)

    def sign(self, name: str) -> None:
        """Use a name from now on, and save it in another thread, because the disk may hang."""
        self.name = tidy(name)
        threading.Thread(target=self._keep, args=(self.name,), daemon=True).start()

    def _keep(self, name: str) -> None:
        try:
            keep_name(name)
        except (OSError, RuntimeError) as error:
            print(texts.NAME_NOT_KEPT.format(error=error), file=sys.stderr)


def file_of_name() -> pathlib.Path:
    return rcs_folder() / 'official'


def kept_name() -> str | None:
    """Return the saved name; None if none was ever saved or it cannot be read."""
    try:
        # Whatever the path is, even a pipe, this must not block.
        flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC
        with os.fdopen(os.open(file_of_name(), flags), 'rb', buffering=0) as file:
            data = file.read(MOST_BYTES)
    except (OSError, RuntimeError):
        return None
    return tidy((data or b'').decode(errors='replace'))


def keep_name(name: str) -> None:
    """
    Save a name for the next start. An empty one means that the official wants no name.

    :raises OSError: if it cannot be written.
    :raises RuntimeError: if there is no home folder.
    """
    _keep(file_of_name(), f'{tidy(name)}\n')


def is_night() -> bool:
    try:
        return (rcs_folder() / 'night').exists()
    except (OSError, RuntimeError):
        return False


def keep_night(night: bool) -> None:
    """Save whether the window is dark, in another thread, because the disk may hang."""

    def keep() -> None:
        with contextlib.suppress(OSError, RuntimeError):
            if night:
                _keep(rcs_folder() / 'night', '')
            else:
                (rcs_folder() / 'night').unlink(missing_ok=True)

    threading.Thread(target=keep, daemon=True).start()


def _keep(path: pathlib.Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    # The file is replaced in one step, because another program may be reading it.
    other = path.with_name(f'.{path.name}-{os.getpid()}')
    other.write_text(text, encoding='utf-8')
    other.replace(path)
