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
``rcs_spare``, or ``make spare``: a second machine keeps a copy of roster, parameters and record.

It fetches them again and again, by ssh from race control's machine: the record as SQLite's own
backup, which is one moment of it, also while race control writes. A copy is whole before it takes
the place of the last one. `latest` is what ``rcs_takeover`` begins with.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import contextlib
import io
import os
import pathlib
import re
import shlex
import signal
import sqlite3
import subprocess
import sys
import tarfile
import time

from evgp_rcs.folder import rcs_folder
from evgp_rcs.roster import load_roster, RosterError

EVERY = 5.0
"""Time between two copies, in seconds."""

TIMEOUT = 20.0
"""Maximum time for one, in seconds."""

ROSTER, PARAMETERS, RECORD, SOURCE = 'karts.yaml', 'rcs.yaml', 'record.sqlite3', 'from'
"""The files of a copy; the last one has the address of the machine it comes from, if it is one."""

_SSH = ('ssh', '-o', 'BatchMode=yes', '-o', 'ConnectTimeout=3', '-o', 'ServerAliveInterval=3')

# What runs on race control's machine, by the Python that is there. In memory (/dev/shm), since
# its disk is the record's.
_PACK = """
import os, sqlite3, sys, tarfile, tempfile
record, *others = map(os.path.expanduser, sys.argv[1:])
with tempfile.TemporaryDirectory(dir='/dev/shm') as folder:
    copy = os.path.join(folder, 'copy')
    source = sqlite3.connect('file:%s?mode=ro' % os.path.abspath(record), uri=True)
    target = sqlite3.connect(copy)
    source.backup(target)
    target.close()
    with tarfile.open(fileobj=sys.stdout.buffer, mode='w|', dereference=True) as out:
        for path, name in zip([*others, copy], ['karts.yaml', 'rcs.yaml', 'record.sqlite3']):
            out.add(path, name)
"""


class SpareError(RuntimeError):
    """There is no copy, or none can be made now; the text says why, in a phrase."""


class Source:
    """
    Race control's machine, or a folder of this one.

    :param given: ``user@address``, then perhaps ``:folder``, or a folder of this machine; other
        paths begin there.
    :raises ValueError: if it is neither.
    """

    def __init__(self, given: str) -> None:
        """Understand it."""
        self.given = given
        remote = re.fullmatch(r'(\w[\w.-]*@([\d.]+))(?::(.*))?', given)
        if remote is None and not pathlib.Path(given).is_dir():
            raise ValueError(
                f'{given} is no folder of this machine, and not user@address of another one, such '
                'as anna@10.1.0.5:evgp, where evgp is the folder that make run was called in'
            )
        self._login, self.address, self._folder = remote.groups('') if remote else ('', '', given)

    def fetch(self, record: str, roster: str, parameters: str) -> bytes:
        """
        Return a tar file of all three, each as it was at one moment.

        :raises SpareError: if that is not possible now.
        """
        paths = [record, *(os.path.join(self._folder, each) for each in (roster, parameters))]  # noqa: PTH118
        command = ['python3' if self._login else sys.executable, '-', *paths]
        if self._login:
            command = [*_SSH, self._login, f'nice -n 19 {shlex.join(command)}']
        try:
            done = subprocess.run(
                command, input=_PACK.encode(), capture_output=True, timeout=TIMEOUT, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise SpareError(str(error)) from error
        if done.returncode:
            said = done.stderr.decode(errors='replace').strip().splitlines()
            raise SpareError(f'{self.given} says: {said[-1] if said else done.returncode}')
        return done.stdout


def keep(packed: bytes, address: str, folder: pathlib.Path) -> float:
    """
    Have this copy take the place of the last one, and return how old its newest event was, s.

    :param address: of the machine it comes from; empty: it is from this one.
    :raises SpareError: if it is not whole, or cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tarfile.open(fileobj=io.BytesIO(packed)) as tar:
            for name in (ROSTER, PARAMETERS, RECORD):
                member = tar.extractfile(name)
                assert member is not None
                _write(folder / f'{name}.new', member.read())
            made = tar.getmember(RECORD).mtime
        load_roster(folder / f'{ROSTER}.new')
        newest = _newest_event(folder / f'{RECORD}.new')
        _write(folder / SOURCE, address.encode())
        # Whatever looked at the last copy: what it has left beside it is not of this one.
        for path in folder.glob(f'{RECORD}-*'):
            path.unlink()
        for name in (ROSTER, PARAMETERS, RECORD):
            (folder / f'{name}.new').replace(folder / name)
    except (OSError, KeyError, tarfile.TarError, sqlite3.Error, RosterError) as error:
        raise SpareError(f'what came cannot be kept: {error}') from error
    return made - newest / 1e9


def _write(path: pathlib.Path, data: bytes) -> None:
    with path.open('wb') as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _newest_event(record: pathlib.Path) -> int:
    # Nobody writes it, so SQLite need not make files beside it.
    uri = f'{record.absolute().as_uri()}?immutable=1'
    with contextlib.closing(sqlite3.connect(uri, uri=True)) as database:
        query = 'SELECT wall_ns FROM event ORDER BY session DESC, sequence DESC LIMIT 1'
        (newest,) = database.execute(query).fetchone() or (0,)
    return int(newest)


def copies() -> pathlib.Path:
    """Return the folder of the copies."""
    return rcs_folder() / 'spare'


def latest() -> pathlib.Path:
    """
    Return the folder of the newest copy, or of what a takeover has made of an earlier one.

    :raises SpareError: if there is none.
    """
    found = {
        path.stat().st_mtime: path.parent
        for path in (copies() / RECORD, *rcs_folder().glob(f'takeover-*/{RECORD}'))
        if path.exists()
    }
    if not found:
        raise SpareError(f'there is no copy in {copies()}: make spare FROM=... makes them')
    return found[max(found)]


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Copy until Ctrl-C.

    :return: 0; 1 if the only copy that was asked for failed; 2 if the usage is wrong.
    """
    parser = argparse.ArgumentParser(
        prog='rcs_spare', description="Keep a copy of race control's roster, parameters, record."
    )
    add = parser.add_argument
    add('source', help='user@address[:folder] of its machine, or a folder of this one')
    add('--roster', required=True, help='as race control was started with, from that folder')
    add('--params', required=True, help='likewise')
    add('--record', default='~/.ros/evgp_rcs/record.sqlite3', help='there: %(default)s')
    add('--once', action='store_true', help='copy once, and end')
    given = parser.parse_args(arguments)
    try:
        source = Source(given.source)
    except ValueError as error:
        parser.error(str(error))
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    at: float | None = None
    end = '\n' if given.once or not sys.stdout.isatty() else '\x1b[K\r'
    with contextlib.suppress(KeyboardInterrupt):
        while True:
            began = time.monotonic()
            try:
                packed = source.fetch(given.record, given.roster, given.params)
                age, at = keep(packed, source.address, copies()), time.monotonic()
                print(f'Copied: the newest event was {age:.0f} s old.', end=end)
            except SpareError as error:
                lag = 'no copy' if at is None else f'the copy is {time.monotonic() - at:.0f} s old'
                print(f'NOT COPIED, {lag}: {error}', end=end)
            sys.stdout.flush()
            if given.once:
                return 0 if at else 1
            time.sleep(max(0.0, began + EVERY - time.monotonic()))
    print()
    return 0


if __name__ == '__main__':
    sys.exit(main())
