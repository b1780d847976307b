# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Saves settings on this machine: the name of its official, and whether the window is dark.

Commands carry the official's name, if it is known. It can be given at the start; otherwise the
programs ask for it once and save it. Each setting is a line in a text file of its own, so that the
window and `rcs_ctl` share the name. This module uses neither Qt nor ROS.
"""

from __future__ import annotations

import os
import platform
import sys
import threading

from evgp_node.folder import rcs_folder
from evgp_node.official import claim, tidy
from evgp_rcs_console import texts

NAME, NIGHT = 'official', 'night'
"""The settings, by the names of their files."""

MOST_BYTES = 4096
"""Maximum number of bytes read from a file."""


class Signature:
    """
    The signature under which this program sends commands.

    :param name: the official's name, if it was given at the start; empty: the saved name.
    :param process: the number of this process, if another one may send under the same name.
    :ivar name: the official's name; empty if it is not known.
    """

    def __init__(self, name: str = '', process: int | None = None) -> None:
        self.name = tidy(name) or kept(NAME) or ''
        self._process = process

    @property
    def claim(self) -> str:
        return claim(self.name, platform.node(), self._process)

    def sign(self, name: str) -> None:
        """Use a name from now on, and save it."""
        self.name = tidy(name)
        keep_soon(NAME, self.name)


def kept(setting: str) -> str | None:
    """Return a setting; None if it was never saved or cannot be read."""
    try:
        # Whatever the path is, even a pipe, this must not block.
        flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC
        with os.fdopen(os.open(rcs_folder() / setting, flags), 'rb', buffering=0) as file:
            data = file.read(MOST_BYTES)
    except (OSError, RuntimeError):
        return None
    return tidy((data or b'').decode(errors='replace'))


def keep(setting: str, text: str) -> None:
    """
    Save a setting for the next start. An empty name means that the official wants no name.

    :raises OSError: if it cannot be written.
    :raises RuntimeError: if there is no home folder.
    """
    path = rcs_folder() / setting
    path.parent.mkdir(parents=True, exist_ok=True)
    # The file is replaced in one step, because another program may be reading it.
    other = path.with_name(f'.{path.name}-{os.getpid()}')
    other.write_text(f'{tidy(text)}\n', encoding='utf-8')
    other.replace(path)


def keep_soon(setting: str, text: str) -> None:
    """Save a setting in another thread, because the disk may hang."""

    def save() -> None:
        try:
            keep(setting, text)
        except (OSError, RuntimeError) as error:
            print(texts.NOT_KEPT.format(error=error), file=sys.stderr)

    threading.Thread(target=save, daemon=True).start()
