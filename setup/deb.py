# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Build the Debian package for officials (docs/install-officials.md). Run it with `make deb`.

The package contains what the set-up has made, without what only developers need, in a folder of
the same shape, so setup/in-workspace, setup/official and the systemd units work there too.

    setup/in-workspace --console python setup/deb.py [VERSION [COMPRESSION OF DPKG-DEB]]
"""

from __future__ import annotations

from collections.abc import Iterator
import importlib.metadata
import os
import pathlib
import re
import shutil
import subprocess
import sys

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
import prepare

NAME = 'evgp-race-control'
HOME = '/opt/evgp'
MADE = prepare.BUILD / 'deb'
ROOT = MADE / 'root'
INSIDE = ROOT / HOME[1:]

COMMANDS = (
    *('ctl', 'record', 'rehearsal', 'roster', 'run', 'spare'),
    *('takeover', 'timekeeper', 'window'),
)
"""The commands of setup/official, which the package has as `evgp-...`."""

MENU = {
    'run': ('Race control', 'Run a race, with karts.yaml from the home folder', True),
    'window': ('Race window', 'Start, flag and stop the race', False),
    'timekeeper': ('Timekeeper', 'Correct laps and publish results', False),
    'rehearsal': ('Rehearsal', 'Train officials: simulated karts, incidents, debrief', True),
}
"""Menu entries: name, comment, and whether the program runs in a terminal."""

NEEDED = """argcomplete jinja2 mcap pyside6-essentials pyyaml
ros-jazzy-common-interfaces ros-jazzy-rcl-interfaces ros-jazzy-rclpy ros-jazzy-rmw-fastrtps-cpp"""
"""The distributions in setup/*.in that run here; their requirements come along."""

LEFT_OUT = re.compile(
    r'\.(a|c|cmake|h|hpp|pyc|pyi)$|/(bin|f2py|tests|PySide6)/|/zstandard/_cffi'
    r'|/libfastrtps\.so($|\.\d+\.\d+\.)'  # duplicates under other names
)
OF_QT = re.compile(
    r'/PySide6/(_\w+\.py|support/.*|libpyside6\..*|Qt(Core|DBus|Gui|Widgets)\.abi3\.so)$'
    r'|/Qt/lib/(libicu.*|libQt6(Core|DBus|Gui|OpenGL|Svg|Widgets|XcbQpa)\.so\.6)$'
    r'|/Qt/lib/libQt6W(aylandClient|lShellIntegration)\.so\.6$'
    r'|/Qt/plugins/(platforms/libq(offscreen|wayland|xcb)|wayland-.*client/|wayland-shell|xcbgl)'
)
"""Files left out of the package; of PySide6, only the files that the window needs are kept."""

DESKTOP = """libdbus-1-3 libegl1 libfontconfig1 libgl1 libglib2.0-0 libwayland-cursor0
libwayland-egl1 libx11-xcb1 libxcb-randr0 libxcb-render0 libxcb-shape0 libxcb-util1 libxcb-xkb1
libxkbcommon-x11-0"""
"""Libraries that Qt needs and that every desktop of Debian 12 has."""

NOT_ON_ALL = 'libxcb-cursor0 libxcb-icccm4 libxcb-image0 libxcb-keysyms1 libxcb-render-util0'
"""Further libraries that Qt needs. Some desktops lack them, so the package contains them and no
network is needed."""

# The terminal stays open until the user presses Enter.
IN_TERMINAL = 'sh -c "trap : INT; {}; echo; echo Enter closes this window.; read -r _"'

UNITS = sorted(path.name for path in prepare.ROOT.glob('src/*/config/*.service'))

# The brackets keep grep from finding itself.
BEFORE_REMOVAL = f"""#!/bin/sh
# Before dpkg removes or replaces the files: running programs would lose them or get other ones.
set -e
if grep -qsa '{HOME}/[.i]' /proc/[0-9]*/cmdline; then
    echo 'A program of race control is running on this machine. End it first.' >&2
    exit 1
fi
if [ "$1" = remove ] && command -v systemctl > /dev/null; then
    systemctl disable --quiet {' '.join(UNITS)}
fi
"""

LICENCES = f"""\
Below: the licence of race control. The licences of included software are in {HOME}/.venv, in
*.dist-info and *.copyright; Qt for Python, LGPL-3.0, can be replaced there.

"""


def output(*command: object) -> str:
    """Run a command that must succeed, and return its output."""
    return subprocess.check_output([*map(str, command)], cwd=prepare.ROOT, text=True)


def needed(names: list[str]) -> Iterator[importlib.metadata.Distribution]:
    """Yield the installed distributions with these names, and all their requirements."""
    seen = set()
    while names:
        name = canonicalize_name(names.pop())
        if name not in seen:
            seen.add(name)
            found = importlib.metadata.distribution(name)
            yield found
            asked = map(Requirement, found.requires or ())
            here = {'extra': ''}
            names += [each.name for each in asked if not each.marker or each.marker.evaluate(here)]


def need_libraries() -> None:
    """Stop with what to install if an included library is missing on this machine."""
    if subprocess.run(['dpkg', '-L', *NOT_ON_ALL.split()], capture_output=True).returncode:
        sys.exit(f"Install the libraries to include: 'apt-get install {NOT_ON_ALL}'.")


def need_python_of(system: pathlib.Path) -> None:
    """Stop if .venv has another Python than the system, on which the package could not run."""
    if system.resolve().name != f'python{prepare.Interpreter.version}':
        sys.exit(
            f'The package runs with {system}, but .venv has Python {prepare.Interpreter.version}. '
            f"Use 'make deb PYTHON={system}'."
        )


def copy_environment() -> None:
    """Copy what is needed of .venv."""
    for distribution in needed(NEEDED.split()):
        for file in distribution.files or ():
            path = pathlib.Path(os.path.normpath(str(distribution.locate_file(file))))
            inside = path.relative_to(prepare.ROOT)
            wanted = OF_QT.search(str(inside)) or not LEFT_OUT.search(str(inside))
            if wanted and path.is_file():
                (INSIDE / inside).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(path, INSIDE / inside)
    (INSIDE / '.venv/bin').mkdir()
    (INSIDE / '.venv/bin/python').symlink_to(f'/usr/bin/python{prepare.Interpreter.version}')
    (INSIDE / '.venv/pyvenv.cfg').write_text('home = /usr/bin\n')
    (qt,) = INSIDE.glob('.venv/lib/python*/site-packages/PySide6/Qt/lib')
    for package in NOT_ON_ALL.split():
        for path in map(pathlib.Path, output('dpkg', '-L', package).split()):
            if re.search(r'\.so\.\d+$', path.name):
                shutil.copy2(path, qt)
            elif path.name == 'copyright':
                shutil.copy2(path, qt / f'{package}.copyright')


def copy_workspace() -> None:
    """Build the packages once more, without links into this clone; their messages are built."""
    install, messages = INSIDE / 'install', 'evgp_rcs_msgs'
    shutil.copytree(prepare.INSTALL / messages, install / messages)
    own = ('AMENT_PREFIX_PATH', 'CMAKE_PREFIX_PATH', 'COLCON_PREFIX_PATH', 'PYTHONPATH')
    environment = {name: value for name, value in os.environ.items() if name not in own}
    command = ['colcon', '--log-base', MADE / 'log', 'build', '--base-paths', 'src']
    command += ['--build-base', MADE / 'build', '--install-base', install]
    command += ['--packages-up-to', 'evgp_rehearsal', '--packages-skip', messages]
    prepare.run_quietly('Building the packages', command, environment)
    (INSIDE / 'setup').mkdir()
    for name in ('in-workspace', 'official'):
        shutil.copy2(prepare.ROOT / 'setup' / name, INSIDE / 'setup')
    for path in [each for each in install.rglob('*') if each.is_file()]:
        content = path.read_bytes()
        if LEFT_OUT.search(str(path.relative_to(install))):
            path.unlink()
        elif b'\0' not in content and bytes(prepare.ROOT) in content:
            for here in (INSIDE, prepare.ROOT):
                content = content.replace(bytes(here), HOME.encode())
            path.write_bytes(content)


def script(command: str) -> str:
    """Return the script `evgp-...`."""
    runs = f'{HOME}/setup/in-workspace {HOME}/setup/official {command} "$@"'
    return f'#!/bin/sh\nEVGP_CALLED=evgp-{command} exec {runs}\n'


def write(path: str, content: str, mode: int = 0o644) -> None:
    """Write a file into the package."""
    (ROOT / path).parent.mkdir(parents=True, exist_ok=True)
    (ROOT / path).write_text(content)
    (ROOT / path).chmod(mode)


def write_surface() -> None:
    """Write what officials use: commands with help and completion, the menu, units."""
    for command in COMMANDS:
        name = f'evgp-{command}'
        write(f'usr/bin/{name}', script(command), 0o755)
        if command in ('ctl', 'record'):
            completion = output('register-python-argcomplete', name)
            write(f'usr/share/bash-completion/completions/{name}', completion)
    for command, (name, comment, terminal) in MENU.items():
        program = IN_TERMINAL.format(f'evgp-{command}') if terminal else f'evgp-{command}'
        entry = f'[Desktop Entry]\nType=Application\nName={name}\nComment={comment}\n'
        entry += f'Exec={program}\nTerminal={str(terminal).lower()}\nCategories=Utility;\n'
        write(f'usr/share/applications/evgp-{command}.desktop', entry)
    for unit in prepare.ROOT.glob('src/*/config/*.service'):
        write(f'lib/systemd/system/{unit.name}', unit.read_text())
    write('DEBIAN/prerm', BEFORE_REMOVAL, 0o755)
    licence = (prepare.ROOT / 'LICENSE').read_text()
    write(f'usr/share/doc/{NAME}/copyright', LICENCES + licence)


def main() -> None:
    """Build the package and print its path."""
    if prepare.is_sourced(os.environ):
        sys.exit('The package contains the wheels of ROS. Use a shell without a sourced ROS.')
    need_python_of(pathlib.Path('/usr/bin/python3'))
    need_libraries()
    version = (*sys.argv[1:], importlib.metadata.version('evgp-rcs'))[0]
    compression = (*sys.argv[2:], 'gzip')[0]
    shutil.rmtree(MADE, ignore_errors=True)
    os.umask(0o022)
    ROOT.mkdir(parents=True)
    copy_environment()
    copy_workspace()
    # Only root can write there, so modules not compiled now would be compiled at every start.
    how = ['--invalidation-mode', 'unchecked-hash', '-s', ROOT, '-p', '/']
    output(sys.executable, '-m', 'compileall', '-q', *how, INSIDE / '.venv', INSIDE / 'install')
    write_surface()
    size = sum(each.lstat().st_size for each in ROOT.rglob('*'))
    major, minor = sys.version_info[:2]
    python = f'python3 (>= {major}.{minor}), python3 (<< {major}.{minor + 1})'
    write(
        'DEBIAN/control',
        f'Package: {NAME}\nVersion: {version}\nArchitecture: amd64\n'
        'Maintainer: EVGP race control maintainers <evgp-race-control@users.noreply.github.com>\n'
        f'Installed-Size: {size // 1024}\nDepends: {", ".join([python, *DESKTOP.split()])}\n'
        'Recommends: iputils-arping\n'
        'Suggests: bash-completion, iproute2, openssh-client, sudo\n'
        'Description: race control for driverless kart races, with window and rehearsal\n',
    )
    output('chmod', '-R', 'a-s,u=rwX,go=rX', ROOT)  # independent of the umask during the set-up
    package = prepare.BUILD / f'{NAME}_{version}_amd64.deb'
    words = ['dpkg-deb', '--build', '--root-owner-group', f'-Z{compression}', ROOT, package]
    prepare.run_quietly('Packing', words)
    shutil.rmtree(MADE)
    print(f'{package}: {package.stat().st_size / 1e6:.0f} MB')


if __name__ == '__main__':
    main()
