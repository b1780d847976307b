# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Set up the environment and the workspace: .venv, then build/ and install/.

It needs only the standard library and parses on any Python 3.7 or later, so that even an unusable
Python can say why.

If ROS 2 is sourced (ROS_DISTRO is one of SOURCED), the set-up uses it with its interpreter and
colcon, and .venv only adds the tools for tests and checks. Otherwise .venv contains ROS 2 Jazzy
itself, from wheels.

A stamp marks each finished part. It is removed before and written after the work, so that a
half-made environment never counts as complete.
"""

from __future__ import annotations

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

ROOT = pathlib.Path(__file__).resolve().parent.parent
VENV = ROOT / '.venv'
BUILD = ROOT / 'build'
INSTALL = ROOT / 'install'
VENV_STAMP = VENV / '.stamp'
# In build/, because install/ links into it: if either is missing, both are built again.
BUILD_STAMP = BUILD / '.stamp'
# In .venv, so that both disappear together.
CONSOLE_STAMP = VENV / '.console-stamp'

PIP = [VENV / 'bin/python', '-m', 'pip', '--disable-pip-version-check', 'install', '--no-input']
# The lists name every package, so pip has nothing to resolve: a newer release changes nothing.
PIP += ['--require-hashes', '--no-deps', '--only-binary', ':all:']

# Wheels of Jazzy exist only for these, on x86-64 Linux with glibc 2.28 or later.
WHEEL_PYTHONS = ('3.11', '3.12', '3.13', '3.14')
OLDEST_GLIBC = (2, 28)

# The supported distributions; in-workspace lists them too.
SOURCED = ('jazzy', 'lyrical')

# Modules that a sourced ROS must offer besides rclpy, and their packages on Ubuntu.
SOURCED_MODULES = {
    'colcon_core': 'python3-colcon-common-extensions',
    'pytest': 'python3-pytest',
    'yaml': 'python3-yaml',
}


@dataclasses.dataclass(frozen=True)
class Interpreter:
    """The relevant facts about a Python interpreter and its machine; by default this one."""

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
    """Return whether to use an installed ROS instead of wheels."""
    return environment.get('ROS_DISTRO') in SOURCED


def why_no_ros(environment: Mapping[str, str]) -> str | None:
    """Return why the sourced ROS cannot be used; None if it can or there is none."""
    distribution = environment.get('ROS_DISTRO')
    if distribution in (None, '', *SOURCED):
        return None
    return (
        f'ROS 2 {distribution} is sourced in this shell, but the set-up needs Jazzy or Lyrical. '
        'Use a shell with one of them sourced, or with no ROS at all. (On Humble, build the '
        "kart's bridge with colcon: README.)"
    )


def why_unfit(python: Interpreter, *, sourced: bool) -> str | None:
    """
    Return why the set-up cannot use this interpreter and what to install, in one sentence.

    None if it can. With a sourced ROS, its own interpreter fits whatever its version.
    """
    debian = 'on Debian or Ubuntu with'
    where = f'Python {python.version} ({python.executable})'
    if not python.has_venv:
        return (
            f'{where} cannot create virtual environments; install its venv module, '
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
            f'This machine is {python.machine} with {library} {release}, but wheels of ROS 2 '
            'Jazzy exist only for Linux x86_64 with glibc 2.28 or later; install ROS 2 Jazzy '
            'itself, source its setup.bash and try again.'
        )
    if python.version not in WHEEL_PYTHONS or python.implementation != 'CPython':
        return (
            f'There are no wheels of ROS 2 Jazzy for {python.implementation} {python.version} '
            f'({python.executable}); install CPython {WHEEL_PYTHONS[0]} to {WHEEL_PYTHONS[-1]}.'
        )
    if not python.has_headers:
        return (
            f'{where} has no Python.h, which the message packages need to compile; install it, '
            f"{debian} 'apt-get install python{python.version}-dev'."
        )
    return None


def repaired(text: str, include: str, site_packages: str) -> str:
    """
    Return a CMake file of the wheels with the builder's Python replaced by this machine's.

    The wheels name folders that exist only on the machine that built them.
    """
    builder = r'/opt/python/cp3\d+-cp3\d+'
    text = re.sub(rf'{builder}/include/python3\.\d+', lambda _: include, text)
    return re.sub(rf'{builder}/lib/python3\.\d+/site-packages', lambda _: site_packages, text)


BUILT = re.compile(r'\.(msg|srv|action|cpp|hpp)$|/(CMakeLists\.txt|package\.xml|setup\.(cfg|py))$')


def build_inputs(source: pathlib.Path) -> Iterable[tuple[str, bytes]]:
    """
    Yield the inputs whose change requires a new build: (path, relevant content).

    Python modules do not count, because --symlink-install links to them from install/. Launch and
    configuration files are linked too, so only adding or removing them counts.
    """
    for path in sorted(source.glob('*/**/*')):
        inside = path.relative_to(source)
        if not path.is_file() or '__pycache__' in path.parts:
            continue
        if BUILT.search(str(inside)):
            yield str(inside), path.read_bytes()
        elif inside.parts[1] in ('config', 'launch', 'resource'):
            yield str(inside), b''


def digest(parts: Iterable[object]) -> str:
    """Return one hash over all parts."""
    return hashlib.sha256(repr([*parts]).encode()).hexdigest()


# Everything from here on changes the machine.


def run_quietly(
    what: str, command: Sequence[object], environment: Mapping[str, str] | None = None
) -> None:
    """
    Run a command below a line that describes it, and show its output only if it fails.

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
    sys.exit(
        f'{what} failed, see above. Fix the cause, then run the same command again '
        "('make clean' first to start over)."
    )


def locks(*names: str) -> list[bytes]:
    """Return the contents of lists of packages to install."""
    return [(ROOT / 'setup' / name).read_bytes() for name in names]


def make(stamp: pathlib.Path, wanted: str, how: Callable[[], None], there: bool = True) -> None:
    """Make something and stamp it, unless it exists with the wanted stamp."""
    if there and stamp.exists() and stamp.read_text() == wanted:
        return
    stamp.unlink(missing_ok=True)
    how()
    stamp.write_text(wanted)


def make_venv(*, sourced: bool) -> None:
    """Create .venv from scratch and install the locked packages."""
    # Everything built against the old one contains its paths.
    for old in (VENV, BUILD, INSTALL):
        shutil.rmtree(old, ignore_errors=True)
    words = ['-m', 'venv', *(['--system-site-packages'] if sourced else []), VENV]
    version = Interpreter.version
    run_quietly(f'Making .venv with Python {version}', [sys.executable, *words])
    if sourced:
        # Even packages that the system has, because without-ros sees only .venv.
        install('the test tools', 'tools.txt', '--ignore-installed')
        return
    install('the build tools', 'build.txt')
    flags = ['--no-binary', 'empy', '--no-build-isolation']
    install('ROS 2 Jazzy from wheels, about a minute', 'ros.txt', *flags)
    repair_wheels()


def install(what: str, lock: str, *flags: str) -> None:
    """Install the packages of a list into .venv."""
    run_quietly(f'Installing {what}', [*PIP, *flags, '-r', ROOT / 'setup' / lock])


def repair_wheels() -> None:
    """Put this machine's folders into the CMake files of the wheels just installed."""
    include = sysconfig.get_path('include')
    site_packages = sysconfig.get_path('purelib', 'venv', vars={'base': str(VENV)})
    files = [each for each in VENV.glob('share/**/*.cmake') if '/opt/python/' in each.read_text()]
    if not files:
        sys.exit('The CMake files of the ROS wheels are not as expected: nothing needs repair.')
    for path in files:
        text = repaired(path.read_text(), include, site_packages)
        if '/opt/python/' in text:
            sys.exit(f"{path} names a builder's folder that the set-up cannot repair.")
        path.write_text(text)


def build_workspace(*, sourced: bool) -> None:
    """Build src/ into build/ and install/ with colcon."""
    environment = dict(os.environ)
    command: list[object] = ['colcon', 'build', '--base-paths', 'src', '--symlink-install']
    if not sourced:
        environment['AMENT_PREFIX_PATH'] = environment['CMAKE_PREFIX_PATH'] = str(VENV)
        environment['PATH'] = f'{VENV / "bin"}{os.pathsep}{environment["PATH"]}'
        command += ['--packages-skip', 'evgp_race_watch_cpp']  # the wheels have no rclcpp
        command += ['--cmake-args', f'-DPython3_EXECUTABLE={VENV / "bin/python"}']
    run_quietly('Building the workspace, two to four minutes', command, environment)


def main() -> None:
    """
    Set up. With --console, also install what the officials' window needs.

    With --fit, only print this interpreter, or why it cannot be used (exit code 1).
    """
    sourced, python = is_sourced(os.environ), Interpreter()
    reason = why_no_ros(os.environ) or why_unfit(python, sourced=sourced)
    if '--fit' in sys.argv:
        print(reason or python.executable)
        raise SystemExit(1 if reason else 0)
    if reason:
        sys.exit(reason)
    if not sourced:
        # Keep out any other workspace that this shell has sourced.
        for name in ('COLCON_PREFIX_PATH', 'PYTHONPATH', '_ROS_WHEELS_BOOTSTRAP_COMPLETE'):
            os.environ.pop(name, None)

    # Two set-ups at once (tests in one terminal, the demonstration in another) take turns.
    turn = os.open(ROOT / 'setup', os.O_RDONLY)
    try:
        fcntl.flock(turn, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        sys.stderr.write('Waiting for the set-up that another terminal has started ...\n')
        fcntl.flock(turn, fcntl.LOCK_EX)
    # Unless PYTHON names an interpreter, .venv may contain any that fits.
    chosen = python.version if os.environ.get('PYTHON') else ''
    # The place is part of the key, because venv and colcon write absolute paths.
    key = digest([ROOT, sourced, *locks('build.txt', 'ros.txt', 'tools.txt')])
    has_python = (VENV / f'bin/python{chosen}').exists()
    make(VENV_STAMP, key, lambda: make_venv(sourced=sourced), has_python)
    if '--console' in sys.argv:
        qt = "Qt for the officials' console"
        make(CONSOLE_STAMP, digest(locks('console.txt')), lambda: install(qt, 'console.txt'))
    built = digest([key, *build_inputs(ROOT / 'src')])
    is_there = (INSTALL / 'setup.bash').exists()
    make(BUILD_STAMP, built, lambda: build_workspace(sourced=sourced), is_there)


if __name__ == '__main__':
    try:
        main()
    except OSError as problem:  # such as a full disk, or a clone that belongs to somebody else
        sys.exit(f'The set-up failed ({problem}). Fix the cause, then run the same command again.')
