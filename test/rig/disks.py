# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Small disks, which become full and read-only at once, and files that somebody has harmed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import pathlib
import sqlite3
import subprocess

import pytest
from rig.needs import cannot_run


@contextlib.contextmanager
def small_disk(folder: pathlib.Path, size: str, kind: str = 'tmpfs') -> Iterator[pathlib.Path]:
    """Have a folder on a file system of its own of this size, such as 512k; or skip the test."""
    folder.mkdir(exist_ok=True)
    words = ['mount', '-t', kind, '-o', f'size={size}', kind, str(folder)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        cannot_run(f'a file system cannot be mounted here (not root?): {done.stderr.strip()}')
    try:
        yield folder
    finally:
        subprocess.run(['umount', '-l', str(folder)], check=True)


def remount(disk: pathlib.Path, how: str) -> None:
    """Have a small disk be read-only (ro) or not (rw)."""
    subprocess.run(['mount', '-o', f'remount,{how}', str(disk)], check=True)


def filled(disk: pathlib.Path) -> pathlib.Path:
    """Fill a small disk, and return the file that does."""
    ballast = disk / 'ballast'
    with pytest.raises(OSError, match='No space left'):
        ballast.write_bytes(bytes(1 << 20))
    return ballast


Harm = Callable[[pathlib.Path], object]
"""Does something to a file."""


def in_database(statements: str) -> Harm:
    """Return what changes a database, or makes one."""

    def change(path: pathlib.Path) -> None:
        with contextlib.closing(sqlite3.connect(path)) as database:
            database.executescript(statements)

    return change


def in_place_of(make: Harm) -> Harm:
    """Return what removes a file, and makes something else there."""

    def change(path: pathlib.Path) -> None:
        path.unlink()
        make(path)

    return change


def garble_schema(path: pathlib.Path) -> None:
    """Change a byte of a database, so that SQLite's message about it is no text either."""
    whole = path.read_bytes()
    assert b'CREATE TABLE block' in whole
    path.write_bytes(whole.replace(b'CREATE TABLE block', b'CRE\xe9TE TABLE block'))
