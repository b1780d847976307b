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
The proof that a run ended in good order: one small file beside the record.

It says when the run ended, as the record does. Race control writes it last, and the next start
takes it away before any kart can connect. So a run that did not end in good order leaves none,
also where the disk was full, the record was deleted, or the machine lost its power.
"""

from __future__ import annotations

import os
import pathlib


class OrderlyEnd:
    """
    The proof beside one record.

    :param record: the file of the record.
    """

    def __init__(self, record: pathlib.Path) -> None:
        """Find its place."""
        self._path = record.with_name(f'{record.name}-ended')

    def take(self) -> str:
        """
        Take the proof away and return when the run ended; empty: there is no proof.

        :raises OSError: if there is one that cannot be taken away.
        """
        try:
            # Others may have put a pipe there, for whose other end one waits.
            with os.fdopen(os.open(self._path, os.O_RDONLY | os.O_NONBLOCK), 'rb') as file:
                ended = file.read(100).decode(errors='replace')
        except (FileNotFoundError, NotADirectoryError):
            return ''
        self._path.unlink()
        self._sync()
        return ended

    def write(self, ended: str) -> None:
        """
        Prove that this run ended in good order, and when.

        :raises OSError: if it cannot be written: then the next start is careful.
        """
        new = self._path.with_name(f'{self._path.name}.new')
        with new.open('w') as file:
            file.write(ended)
            file.flush()
            os.fsync(file.fileno())
        new.replace(self._path)
        self._sync()

    def _sync(self) -> None:
        folder = os.open(self._path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
