# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The mark of a run: a small file that says whether race control last ended well on this machine.

There is one mark for each port, at a fixed place that survives a restart of the machine and does
not depend on race control's user, home, record or unit. Race control writes `RUN_BEGAN` to the
disk before a kart can connect and, when the run ends normally, how it ended. A mark that cannot be
read or written proves nothing.

A `FOLDER` that is private to a service, or whose files are lost with the power, cannot hold a mark
(``_why_not_lasting``). Without a mark, race control does not start a race (``record_process``).
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import ipaddress
import os
import pathlib
import stat
import time

from evgp_protocol import clock
from evgp_rcs.rules.race import LastRun

FOLDER = pathlib.Path('/var/tmp/evgp-race-control')  # noqa: S108 - see the checks below
"""Folder of the marks, in which every user of the machine may write."""

CLAIM_TIMEOUT = 2.0
"""Maximum wait for an ending race control to release its mark or record, in seconds."""

KEEP_EVERY = 1.0
"""Time between two checks that the mark still exists, in seconds."""

RUN_BEGAN = LastRun.UNKNOWN.value
"""Text of the mark while race control runs, and after a run that did not end well."""

_SIZE = 32  # so that a single write within one sector replaces the text
_PROCESS = pathlib.Path('/proc/self')


class InUseError(RuntimeError):
    """Another running race control has this mark. The text says what to do."""


def place(address: str, port: int) -> pathlib.Path:
    """
    Return the file of the mark.

    :param address: address at which race control listens. Each loopback address has marks of its
        own, because karts on other machines cannot reach it; rehearsals use such addresses.
    """
    loopback = ipaddress.IPv4Address(address).is_loopback
    return FOLDER / (f'{address}:{port}' if loopback else str(port))


def in_words(error: BaseException) -> str:
    """Return an error's text for officials, without the system's error number."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror.lower()
    return str(error) or type(error).__name__


def claim(file: int) -> bool:
    """Lock a file until it is closed and return whether that was possible."""
    until = clock.now() + CLAIM_TIMEOUT
    while True:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if clock.now() >= until:
                return False
            time.sleep(CLAIM_TIMEOUT / 100)
        else:
            return True


def _why_not_lasting(folder: int) -> str:
    """Return why files in an open folder would not last until the next run; empty: they would."""
    # The kernel knows which of several mounts over each other is the one in use.
    about = (_PROCESS / 'fdinfo' / str(folder)).read_text(encoding='ascii').split()
    mount = about[about.index('mnt_id:') + 1]
    for line in (_PROCESS / 'mountinfo').read_text(errors='replace').splitlines():
        before, _, after = line.partition(' - ')
        number, _, _, root, point, *_ = before.split(' ')
        if number != mount:
            continue
        if 'systemd-private' in root:
            return f'{point} is private to this service: set PrivateTmp=no in its unit'
        if after.startswith(('tmpfs ', 'ramfs ')):
            return f'{point} is in memory, so files there are lost with the power'
    return ''


class RunMark:
    """
    The mark during a run of race control.

    :raises InUseError: if another running race control has the mark.
    """

    def __init__(self, path: pathlib.Path) -> None:
        self._path = path
        self._file: int | None = None
        self._looked_at = clock.now()
        self.error = ''
        """A phrase that says why the mark cannot be written now; empty if it can."""
        self.last_run = LastRun.UNKNOWN
        """How the last run ended, if that is known."""
        self.why = ''
        """A phrase that says why nothing is known about the last run; empty if something is."""
        try:
            self.last_run = LastRun(self._begin())
        except OSError as error:
            self.error = self.why = self._in_words(error)
        except ValueError:
            self.why = f'{path} is damaged'

    def due_in(self) -> float:
        return max(0.0, self._looked_at + KEEP_EVERY - clock.now())

    def keep(self) -> None:
        """Write *began* again if that failed before, or if somebody has deleted the mark."""
        self._looked_at = clock.now()
        try:
            if self._file is None or not self._is_there(self._file):
                self._begin()
            self.error = ''
        except (OSError, InUseError) as error:
            self.error = self._in_words(error)

    def end(self, ends_as: LastRun) -> None:
        """
        Write how this run ended, and release the mark.

        If that fails, the mark still says *began*, and the next run assumes the worst.
        """
        if self._file is not None:
            with contextlib.suppress(OSError):
                _write(self._file, ends_as)
            os.close(self._file)

    def _begin(self) -> str:
        """Lock the mark, write *began*, and return its previous text."""
        if self._file is not None:
            os.close(self._file)
            self._file = None
        folder = _open_folder(self._path.parent)
        try:
            if self._path.parent == FOLDER and (why := _why_not_lasting(folder)):
                raise OSError(why)
            file, is_new = _open(self._path.name, folder)
            try:
                if not claim(file):
                    raise InUseError(
                        'another race control on this machine is using this port (it holds '
                        f'{self._path}). End it, or choose another port'
                    )
                if not self._is_there(file):
                    raise OSError('it was deleted just now')
                word = LastRun.NONE.value if is_new else _read(file)
                _write(file, LastRun.UNKNOWN)
                os.fsync(folder)
            except BaseException:
                os.close(file)
                raise
        finally:
            os.close(folder)
        self._file = file
        return word

    def _is_there(self, file: int) -> bool:
        """Return whether the mark is still this open file."""
        try:
            there = self._path.stat(follow_symlinks=False)
        except FileNotFoundError:
            return False
        return os.path.samestat(there, os.fstat(file))

    def _in_words(self, error: Exception) -> str:
        what = f'{self._path}, which tells the next start about a crash, cannot be used'
        return f'{what}: {in_words(error)}'


def leave_began(path: pathlib.Path) -> None:
    """
    Write *began* into a mark, so that the next start on this machine assumes the worst.

    A race control that is running here has already written this.

    :raises OSError: if the mark cannot be written.
    """
    try:
        mark = RunMark(path)
    except InUseError:
        return
    mark.end(LastRun.UNKNOWN)
    if mark.error:
        raise OSError(mark.error)


def _open_folder(path: pathlib.Path) -> int:
    with contextlib.suppress(FileExistsError):
        path.mkdir()
        _sync(path.parent)
    folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    _let_all_write(folder, 0o777)
    return folder


def _sync(path: pathlib.Path) -> None:
    folder = os.open(path, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _let_all_write(file: int, mode: int) -> None:
    """Let every user of the machine write a file of this user, whatever the umask is."""
    found = os.fstat(file)
    if found.st_uid == os.geteuid() and stat.S_IMODE(found.st_mode) != mode:
        os.fchmod(file, mode)


def _open(name: str, folder: int) -> tuple[int, bool]:
    """
    Open a mark, and return its file descriptor and whether the mark is new.

    :raises OSError: if the mark cannot be written, or is not a regular file without other links.
    """
    # Another user may have put a link there, or a pipe, which would block `open`.
    how = os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK
    try:
        file, is_new = os.open(name, how, dir_fd=folder), False
    except FileNotFoundError:
        file, is_new = os.open(name, how | os.O_CREAT | os.O_EXCL, dir_fd=folder), True
    try:
        found = os.fstat(file)
        if not stat.S_ISREG(found.st_mode) or found.st_nlink != 1:
            raise OSError('it is not a regular file without other links')
        # systemd-tmpfiles does not delete old files that have the sticky bit.
        _let_all_write(file, stat.S_ISVTX | 0o666)
    except BaseException:
        os.close(file)
        raise
    return file, is_new


def _read(file: int) -> str:
    return os.pread(file, _SIZE + 1, 0).decode(errors='replace').strip()


def _write(file: int, meaning: LastRun) -> None:
    data = f'{meaning.value:<{_SIZE - 1}}\n'.encode()
    if os.pwrite(file, data, 0) != len(data):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    os.ftruncate(file, len(data))
    os.fsync(file)
