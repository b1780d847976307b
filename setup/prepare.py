# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Set up the environment and the workspace: .venv, then build/ and install/.

Needs the standard library only, and parses on any Python 3.7 or later, so that a Python that
cannot be used can still say so.

With ROS 2 sourced (ROS_DISTRO, one of SOURCED), it is used as it stands, its interpreter and its
colcon too, and .venv only adds the tools of tests and checks. Without, .venv holds ROS itself,
Jazzy, from wheels.

A stamp marks what has been made. It is removed before and written after the making, so that a
half-made environment is never taken for a whole one.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping, Sequence
import dataclasses
import fcntl
import hashlib
import importlib.util
import os
import pathlib
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import time
from typing import NoReturn

ROOT = pathlib.Path(__file__).resolve().parent.parent
VENV = ROOT / '.venv'
BUILD = ROOT / 'build'
INSTALL = ROOT / 'install'
VENV_STAMP = VENV / '.stamp'
# In build/, since install/ links into it: either of them missing means building again.
BUILD_STAMP = BUILD / '.stamp'
# In .venv, so that it goes with it.
CONSOLE_STAMP = VENV / '.console-stamp'

PIP = [VENV / 'bin/python', '-m', 'pip', '--disable-pip-version-check', 'install', '--no-input']
# The lists name every package, so pip has nothing to resolve: a newer release changes nothing.
PIP += ['--require-hashes', '--no-deps', '--only-binary', ':all:']

# There are wheels of Jazzy for these, on x86-64 Linux with glibc 2.28 or later, and no others.
WHEEL_PYTHONS = ('3.11', '3.12', '3.13', '3.14')
OLDEST_GLIBC = (2, 28)

# The distributions that everything is for; in-workspace has them too.
SOURCED = ('jazzy', 'lyrical')

# What a sourced ROS must offer beside rclpy, and what brings it on Ubuntu.
SOURCED_MODULES = {
    'colcon_core': 'python3-colcon-common-extensions',
    'pytest': 'python3-pytest',
    'yaml': 'python3-yaml',
}


@dataclasses.dataclass(frozen=True)
class Interpreter:
    """What matters of a Python interpreter and its machine; by default of this one."""

    executable: str = sys.executable
    version: str = '{}.{}'.format(*sys.version_info)
    implementation: str = platform.python_implementation()
    machine: str = f'{platform.system()} {platform.machine()}'
    libc: tuple[str, str] = platform.libc_ver()
    has_venv: bool = importlib.util.find_spec('ensurepip') is not None
    has_headers: bool = pathlib.Path(sysconfig.get_path('include'), 'Python.h').is_file()
    modules: frozenset[str] = frozenset(
        name for name in ('rclpy', *SOURCED_MODULES) if importlib.util.find_spec(name)
    )


def is_sourced(environment: Mapping[str, str]) -> bool:
    """Return whether an installed ROS is to be used, rather than wheels."""
    return environment.get('ROS_DISTRO') in SOURCED


def why_no_ros(environment: Mapping[str, str]) -> str | None:
    """Return why the sourced ROS cannot be used, None where it can or there is none."""
    distribution = environment.get('ROS_DISTRO')
    if distribution in (None, '', *SOURCED):
        return None
    return (
        f'ROS 2 {distribution} is sourced in this shell, and this needs Jazzy or Lyrical; use a '
        'shell with one of them sourced, or with no ROS at all. (On Humble, a kart builds the '
        'bridge with colcon: README.)'
    )


def why_unfit(python: Interpreter, *, sourced: bool) -> str | None:
    """
    Return why the set-up cannot use this interpreter and what to install, in one sentence.

    None where it can. With a sourced ROS its own interpreter is right whatever its version.
    """
    debian = 'on Debian or Ubuntu with'
    where = f'Python {python.version} ({python.executable})'
    if not python.has_venv:
        return (
            f'{where} cannot make virtual environments; install its venv module, '
            f"{debian} 'apt-get install python{python.version}-venv'."
        )
    if sourced:
        if 'rclpy' not in python.modules:
            return (
                f'ROS_DISTRO is set but {where} finds no rclpy; source the setup.bash of your '
                'ROS 2, or unset ROS_DISTRO to use wheels.'
            )
        missing = [apt for name, apt in SOURCED_MODULES.items() if name not in python.modules]
        if missing:
            packages = ' '.join(missing)
            return f"{where} lacks modules; install them with 'apt-get install {packages}'."
        return None
    library, release = python.libc
    old = library != 'glibc' or tuple(map(int, release.split('.'))) < OLDEST_GLIBC
    if python.machine != 'Linux x86_64' or old:
        return (
            f'This machine is {python.machine} with {library} {release}, and there are wheels of '
            'ROS 2 Jazzy only for Linux x86_64 with glibc 2.28 or later; install ROS 2 Jazzy '
            'itself, source its setup.bash and try again.'
        )
    if python.version not in WHEEL_PYTHONS or python.implementation != 'CPython':
        return (
            f'There are no wheels of ROS 2 Jazzy for {python.implementation} {python.version} '
            f'({python.executable}); install CPython {WHEEL_PYTHONS[0]} to {WHEEL_PYTHONS[-1]}.'
        )
    if not python.has_headers:
        return (
            f'{where} has no Python.h, which the message packages are compiled with; install it, '
            f"{debian} 'apt-get install python{python.version}-dev'."
        )
    return None


def repaired(text: str, include: str, site_packages: str) -> str:
    """
    Return a CMake file of the wheels with this machine's Python in place of their builder's.

    The wheels name the folders of the machine that built them, which exist on no other.
    """
    builder = r'/opt/python/cp3\d+-cp3\d+'
    text = re.sub(rf'{builder}/include/python3\.\d+', lambda _: include, text)
    return re.sub(rf'{builder}/lib/python3\.\d+/site-packages', lambda _: site_packages, text)


def build_inputs(source: pathlib.Path) -> Iterable[tuple[str, bytes]]:
    """
    Yield what a change of must lead to a new build: (path, what matters of the content).

    Python modules are not among it: --symlink-install puts links to them in install/. Of launch
    and configuration files, which are linked too, only the coming and going matters.
    """
    for path in sorted(source.glob('*/**/*')):
        if not path.is_file() or '__pycache__' in path.parts:
            continue
        inside = path.relative_to(source)
        if path.suffix in ('.msg', '.srv', '.action', '.cpp', '.hpp') or path.name in (
            'CMakeLists.txt',
            'package.xml',
            'setup.cfg',
            'setup.py',
        ):
            yield str(inside), path.read_bytes()
        elif inside.parts[1] in ('config', 'launch', 'resource'):
            yield str(inside), b''


def digest(parts: Iterable[tuple[str, bytes]]) -> str:
    """Return one hash over named contents."""
    sha = hashlib.sha256()
    for name, content in parts:
        sha.update(f'{name}\0{len(content)}\0'.encode())
        sha.update(content)
    return sha.hexdigest()


# From here on everything touches the machine.


def stop(reason: str) -> NoReturn:
    """End the set-up with one sentence to the user."""
    sys.stderr.write(f'{reason}\n')
    raise SystemExit(1)


def run_quietly(
    what: str, command: Sequence[object], environment: Mapping[str, str] | None = None
) -> None:
    """
    Run a command under a line that says what it does, and show what it says only if it fails.

    A failure ends the set-up.
    """
    sys.stderr.write(f'{what} ...')
    sys.stderr.flush()
    began = time.monotonic()
    done = subprocess.run(
        [str(word) for word in command],
        cwd=ROOT,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    if done.returncode == 0:
        sys.stderr.write(f' {time.monotonic() - began:.0f} s\n')
        return
    sys.stderr.write(' failed:\n')
    sys.stderr.flush()
    sys.stderr.buffer.write(done.stdout)
    stop(
        f'{what} failed, see above; run the same command again once the cause is gone '
        "('make clean' first, to start from nothing)."
    )


def locks(*names: str) -> list[tuple[str, bytes]]:
    """Return lists of what is installed, with their names."""
    return [(name, (ROOT / 'setup' / name).read_bytes()) for name in names]


def make(stamp: pathlib.Path, wanted: str, how: Callable[[], None], there: bool = True) -> None:
    """Make something, and mark it; not if it is there, and marked as what is wanted."""
    if there and stamp.exists() and stamp.read_text() == wanted:
        return
    stamp.unlink(missing_ok=True)
    how()
    stamp.write_text(wanted)


def make_venv(*, sourced: bool) -> None:
    """Make .venv anew and install what is locked into it."""
    # What was built against the old one names its folders.
    for old in (VENV, BUILD, INSTALL):
        shutil.rmtree(old, ignore_errors=True)
    words = ['-m', 'venv', *(['--system-site-packages'] if sourced else []), VENV]
    version = Interpreter.version
    run_quietly(f'Making .venv with Python {version}', [sys.executable, *words])
    if sourced:
        # Also what the system has: without-ros sees .venv alone.
        install('the test tools', 'tools.txt', '--ignore-installed')
        return
    install('the build tools', 'build.txt')
    flags = ['--no-binary', 'empy', '--no-build-isolation']
    install('ROS 2 Jazzy from wheels, about a minute', 'ros.txt', *flags)
    repair_wheels()


def install(what: str, lock: str, *flags: str) -> None:
    """Install what a list names into .venv."""
    run_quietly(f'Installing {what}', [*PIP, *flags, '-r', ROOT / 'setup' / lock])


def repair_wheels() -> None:
    """Put this machine's folders into the CMake files of the wheels just installed."""
    include = sysconfig.get_path('include')
    site_packages = sysconfig.get_path('purelib', 'venv', vars={'base': str(VENV)})
    changed = 0
    for path in sorted((VENV / 'share').glob('**/*.cmake')):
        old = path.read_text()
        new = repaired(old, include, site_packages)
        if '/opt/python/' in new:
            stop(f'{path} names a folder of its builder that the set-up does not know to repair.')
        if new != old:
            path.write_text(new)
            changed += 1
    if not changed:
        stop('The CMake files of the ROS wheels are not as expected: there is nothing to repair.')


def build_workspace(*, sourced: bool) -> None:
    """Build src/ into build/ and install/ with colcon."""
    environment = dict(os.environ)
    command: list[object] = ['colcon', 'build']
    if not sourced:
        environment['AMENT_PREFIX_PATH'] = environment['CMAKE_PREFIX_PATH'] = str(VENV)
        environment['PATH'] = f'{VENV / "bin"}{os.pathsep}{environment["PATH"]}'
        command = [VENV / 'bin/colcon', 'build']
    command += ['--base-paths', 'src', '--symlink-install']
    if not sourced:
        command += ['--packages-skip', 'evgp_race_watch_cpp']  # the wheels have no rclcpp
        command += ['--cmake-args', f'-DPython3_EXECUTABLE={VENV / "bin/python"}']
    run_quietly('Building the workspace, two to four minutes', command, environment)


def main() -> None:
    """Set up, or with --fit say whether this interpreter can."""
    parser = argparse.ArgumentParser(description='Set up .venv and build the workspace.')
    parser.add_argument(
        '--fit',
        action='store_true',
        help='only print this interpreter, or why it cannot be used (exit status 1)',
    )
    parser.add_argument(
        '--console', action='store_true', help="also install what the officials' window needs"
    )
    arguments = parser.parse_args()

    sourced, python = is_sourced(os.environ), Interpreter()
    reason = why_no_ros(os.environ) or why_unfit(python, sourced=sourced)
    if arguments.fit:
        print(reason or python.executable)
        raise SystemExit(1 if reason else 0)
    if reason:
        stop(reason)
    if not sourced:
        # Nothing of another workspace that this shell may have sourced gets into this one.
        for name in ('COLCON_PREFIX_PATH', 'PYTHONPATH', '_ROS_WHEELS_BOOTSTRAP_COMPLETE'):
            os.environ.pop(name, None)

    # Two at once (a test run in one terminal, the demonstration in another) take turns.
    turn = os.open(ROOT / 'setup', os.O_RDONLY)
    fcntl.flock(turn, fcntl.LOCK_EX)
    # Unless PYTHON names one, .venv may have another that fits.
    chosen = python.version if os.environ.get('PYTHON') else ''
    # Both venv and colcon write absolute paths.
    place = [('root', str(ROOT).encode()), ('sourced', str(sourced).encode())]
    key = digest(place + locks('build.txt', 'ros.txt', 'tools.txt'))
    has_python = (VENV / f'bin/python{chosen}').exists()
    make(VENV_STAMP, key, lambda: make_venv(sourced=sourced), has_python)
    if arguments.console:
        qt = "Qt for the officials' console"
        make(CONSOLE_STAMP, digest(locks('console.txt')), lambda: install(qt, 'console.txt'))
    built = digest([(key, b''), *build_inputs(ROOT / 'src')])
    is_there = (INSTALL / 'setup.bash').exists()
    make(BUILD_STAMP, built, lambda: build_workspace(sourced=sourced), is_there)


if __name__ == '__main__':
    main()
