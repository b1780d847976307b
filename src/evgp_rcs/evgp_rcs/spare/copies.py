# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
``rcs_spare`` (``make spare``) keeps a copy of race control's files on a spare machine.

The files are the roster, the parameters, the record and the timekeeper's book. The spare machine
fetches them by ssh again and again. It fetches the record and the book as SQLite backups, which
are consistent even while the files are being written. A copy replaces the last one only when it is
complete. ``rcs_takeover`` starts with the `latest` copy.

The first machine may race on after a copy. Therefore, before a copy is in place here, this
machine's own mark (``run_mark``) says *began*, so that every start here assumes the worst.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
import contextlib
import io
import os
import pathlib
import re
import shlex
import sqlite3
import subprocess
import sys
import tarfile
import time

from evgp_node.folder import rcs_folder
from evgp_node.roster import load_roster, RosterError
from evgp_node.stream_file import BOOK, connection
from evgp_protocol import clock
from evgp_rcs.karts.channel import ServerSettings
from evgp_rcs.record.run_mark import leave_began, place
from evgp_rcs.record.store import sessions
import yaml

COPY_EVERY = 5.0
"""Time between two copies, in seconds."""

COPY_TIMEOUT = 20.0
"""Maximum time for one copy, in seconds."""

ROSTER, PARAMETERS, RECORD = NAMES = ('karts.yaml', 'rcs.yaml', 'record.sqlite3')
"""Files of a copy, besides the timekeeper's book (`BOOK`) if there is one beside the record."""

ORIGIN = 'from'
"""Name of a file with the address of the machine from which the copy comes; empty if the copy
comes from this machine."""

_REMOTE = re.compile(r'(\w[\w.-]*@([\d.]+))(?::(.*))?')
_SSH = ('ssh', '-o', 'BatchMode=yes', '-o', 'ConnectTimeout=3', '-o', 'ServerAliveInterval=3')

# This program runs on race control's machine, with the Python there. It works in memory
# (/dev/shm), so that the record has the disk to itself.
_PACK = f"""
import os, pathlib, sqlite3, sys, tarfile, tempfile
*others, record = map(os.path.expanduser, sys.argv[1:])
with tempfile.TemporaryDirectory(dir='/dev/shm') as folder:
    open(record).close()  # the error of this names the file
    copies = []
    for path in (record, os.path.join(os.path.dirname(record), {BOOK!r})):
        if os.path.exists(path):
            copies.append(os.path.join(folder, str(len(copies))))
            of_file = pathlib.Path(path).absolute().as_uri()
            source = sqlite3.connect(of_file + '?mode=ro', uri=True)
            target = sqlite3.connect(copies[-1])
            source.backup(target)
            target.close()
    with tarfile.open(fileobj=sys.stdout.buffer, mode='w|', dereference=True) as out:
        for path, name in zip([*others, *copies], {(*NAMES, BOOK)}):
            out.add(path, name)
"""


class SpareError(RuntimeError):
    """There is no copy, or none can be made now. The text is a phrase that says why."""


def fetch(source: str, roster: str, parameters: str, record: str) -> bytes:
    """
    Fetch race control's files, each of them consistent, and return them as a tar file.

    :param source: ``user@address``, optionally with ``:folder``, or a folder of this machine, to
        which the other paths may be relative.
    :raises SpareError: if that is not possible now, or takes longer than `COPY_TIMEOUT`.
    """
    remote = _REMOTE.fullmatch(source)
    login, _, folder = remote.groups('') if remote else ('', '', source)
    # Do not use pathlib, because the path and ~ may be those of another machine and user.
    own = [os.path.join(folder, each) for each in (roster, parameters)]  # noqa: PTH118
    command = ['python3' if login else sys.executable, '-', *own, record]
    if login:
        command = [*_SSH, login, shlex.join(command)]
    try:
        done = subprocess.run(
            command, input=_PACK.encode(), capture_output=True, timeout=COPY_TIMEOUT, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SpareError(str(error)) from error
    if done.returncode:
        said = done.stderr.decode(errors='replace').strip().rpartition('\n')[2]
        raise SpareError(f'{source} says: {said or done.returncode}')
    return done.stdout


def keep(packed: bytes, source: str, folder: pathlib.Path) -> float:
    """
    Replace the last copy by this one, and return the age of its newest event in seconds.

    :param packed: the copy, as from `fetch`.
    :param folder: the folder of the copies.
    :raises SpareError: if the copy is incomplete, or cannot be written.
    """
    remote = _REMOTE.fullmatch(source)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tarfile.open(fileobj=io.BytesIO(packed)) as tar:
            names = [*NAMES, *(name for name in tar.getnames() if name == BOOK)]
            for name in names:
                member = tar.extractfile(name)
                if member is None:
                    raise SpareError(f'{name} is not a file')
                _write(folder / f'{name}.new', member.read())
            made = tar.getmember(RECORD).mtime
        load_roster(folder / f'{ROSTER}.new')
        newest = _newest_event(folder / f'{RECORD}.new')
        for mark in _marks(folder / f'{PARAMETERS}.new'):
            leave_began(mark)
        _write(folder / ORIGIN, (remote[2] if remote else '').encode())
        # Remove files that a reader may have left beside the last copy.
        for path in (*folder.glob(f'{RECORD}-*'), *folder.glob(f'{BOOK}*')):
            if path.name != f'{BOOK}.new':
                path.unlink()
        for name in names:
            (folder / f'{name}.new').replace(folder / name)
    except (
        *(OSError, KeyError, ValueError, tarfile.TarError, sqlite3.Error, RosterError),
        *(yaml.YAMLError, RecursionError),
    ) as error:
        raise SpareError(f'the copy cannot be kept: {error}') from error
    return made - newest / 1e9


def _write(path: pathlib.Path, data: bytes) -> None:
    with path.open('wb') as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _marks(parameters: pathlib.Path) -> set[pathlib.Path]:
    """
    Return the marks that race control may use here with these parameters, whatever its node name.

    :raises ValueError, yaml.YAMLError, RecursionError: if the parameters cannot be read.
    """
    found = list(_mappings(yaml.safe_load(parameters.read_bytes())))
    addresses = {str(each['address']) for each in found if 'address' in each}
    ports = {int(str(each['port'])) for each in found if 'port' in each}
    return {
        place(address, port)
        for address in addresses or {ServerSettings.host}
        for port in ports | {ServerSettings.port}
    }


def _mappings(value: object) -> Iterator[dict[str, object]]:
    """Yield every mapping in a value read from YAML, at any depth."""
    if isinstance(value, dict):
        yield value
        for each in value.values():
            yield from _mappings(each)


def _newest_event(record: pathlib.Path) -> int:
    # No program writes this file, so SQLite needs no further files beside it.
    with contextlib.closing(connection(record, 'immutable=1')) as database:
        return max((each.last_ns for each in sessions(database)), default=0)


def copies() -> pathlib.Path:
    return rcs_folder() / 'spare'


def latest() -> pathlib.Path:
    """
    Return the folder of the newest copy, which a takeover may have used already.

    :raises SpareError: if there is no copy.
    """
    records = [copies() / RECORD, *rcs_folder().glob(f'takeover-*/{RECORD}')]
    found = [(path.stat().st_mtime, path.parent) for path in records if path.exists()]
    if not found:
        raise SpareError(
            f'there is no copy in {copies()}. While race control runs, make one with: make spare '
            'FROM=... If its machine has died, docs/race-day.md says what to do without a copy'
        )
    return max(found)[1]


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Copy race control's files repeatedly until Ctrl-C or a takeover, or once.

    :return: 0, or 1 if the copy failed with ``--once``. After a usage error, the process exits
        with 2.
    """
    parser = argparse.ArgumentParser(
        prog=os.environ.get('EVGP_CALLED', 'rcs_spare'),
        description="Keep a copy of race control's roster, parameters and record.",
    )
    add = parser.add_argument
    add('source', help='user@address[:folder], or a folder of this machine')
    add('--roster', required=True, help='the roster of race control, relative to that folder')
    add('--params', required=True, help='the parameters of race control, relative to that folder')
    add('--record', default='~/.ros/evgp_rcs/record.sqlite3', help='default: %(default)s')
    add('--once', action='store_true', help='copy once, then end')
    given = parser.parse_args(arguments)
    if not (_REMOTE.fullmatch(given.source) or '/' in given.source):
        parser.error(
            f'{given.source!r} is neither a path on this machine nor user@address of another one. '
            'An example is anna@10.1.0.5:evgp, where evgp is the folder in which make run was '
            'called'
        )
    at: float | None = None
    with contextlib.suppress(KeyboardInterrupt):
        while True:
            began = clock.now()
            try:
                packed = fetch(given.source, given.roster, given.params, given.record)
                age, at = keep(packed, given.source, copies()), clock.now()
                print(f'Copied: the newest event was {age:.0f} s old.', flush=True)
            except SpareError as error:
                lag = 'no copy' if at is None else f'the copy is {clock.now() - at:.0f} s old'
                print(f'NOT COPIED, {lag}: {error}', flush=True)
            if given.once:
                return 0 if at else 1
            time.sleep(max(0.0, began + COPY_EVERY - clock.now()))
            if at is not None and not copies().exists():
                print('ENDED: a takeover has used the copy, so this machine is race control.')
                break  # a later copy of the old machine would seem newer than this one's record
    return 0


if __name__ == '__main__':
    sys.exit(main())
