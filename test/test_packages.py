# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What every package of this repository has, as the ROS world expects it."""

from __future__ import annotations

import ast
import configparser
import os
import pathlib
import re
import sys

from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.package import Package, parse_package
from catkin_pkg.package_version import get_forthcoming_label
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]
PACKAGES = sorted(path.parent for path in (ROOT / 'src').glob('*/package.xml'))
PYTHON_PACKAGES = [path for path in PACKAGES if (path / 'setup.py').exists()]

OPTIONAL = {
    'evgp_kart_bridge': [
        'autoware_adapi_v1_msgs',
        'tier4_control_msgs',
        'tier4_external_api_msgs',
    ],
    'evgp_node': ['PyQt6', 'PySide6'],  # each package with a window asks for PyQt6 itself
    'evgp_rcs': ['mcap'],  # no rosdep key; `rcs_record bag` says what to install
    'evgp_testing': ['evgp_rcs_console'],
}
"""What a package imports only where it is installed, by the package."""

every_package = pytest.mark.parametrize('path', PACKAGES, ids=lambda path: path.name)
every_python_package = pytest.mark.parametrize('path', PYTHON_PACKAGES, ids=lambda path: path.name)


def described(path: pathlib.Path) -> Package:
    """Return what a package.xml says; a fault in it, or what it warns of, raises."""
    warnings: list[str] = []
    package = parse_package(path, warnings=warnings)
    assert not warnings
    return package


def set_up(path: pathlib.Path) -> configparser.SectionProxy:
    """Return the metadata in a package's setup.cfg."""
    config = configparser.ConfigParser()
    config.read(path / 'setup.cfg', encoding='utf-8')
    return config['metadata']


def needs_of(package: str) -> set[str]:
    """Return the other packages of this repository that a package needs, and they need."""
    asked = described(ROOT / 'src' / package)
    depends = {each.name for each in [*asked.build_depends, *asked.exec_depends]}
    direct = depends & {path.name for path in PACKAGES}
    return direct.union(*map(needs_of, direct))


def test_ci_leaves_out_on_humble_all_that_a_kart_does_not_need() -> None:
    text = (ROOT / '.github/workflows/ci.yml').read_text(encoding='utf-8')
    (names,) = re.findall(r'touch evgp_\{(.*)\}/COLCON_IGNORE', text)
    left = {path.name for path in PACKAGES} - needs_of('evgp_kart_bridge') - {'evgp_kart_bridge'}
    assert {f'evgp_{each}' for each in names.split(',')} == left


@every_package
def test_all_packages_have_one_version_one_maintainer_and_one_licence(path: pathlib.Path) -> None:
    package, first = described(path), described(PACKAGES[0])
    assert package.version == first.version
    assert [str(each) for each in package.maintainers] == [str(each) for each in first.maintainers]
    assert [str(each) for each in package.authors] == [str(each) for each in first.authors]
    assert [(each.type, each.url) for each in package.urls] == [
        (each.type, each.url) for each in first.urls
    ]
    assert [(str(each), each.file) for each in package.licenses] == [('Apache-2.0', 'LICENSE')]
    licence = (path / 'LICENSE').read_bytes()
    assert licence == (ROOT / 'LICENSE').read_bytes()


def test_the_maintainers_have_an_address_that_can_exist() -> None:
    (maintainer,) = described(PACKAGES[0]).maintainers
    reserved = ('.example', '.invalid', '.localhost', '.test')  # RFC 2606
    assert not maintainer.email.endswith(reserved)


@pytest.mark.filterwarnings('ignore:nodes.Node.traverse:DeprecationWarning')  # of catkin_pkg
@every_package
def test_the_change_log_can_be_read_and_is_of_this_version(path: pathlib.Path) -> None:
    log = get_changelog_from_path(str(path / 'CHANGELOG.rst'), path.name)
    assert log.package_name == path.name
    versions = [version for version, _, _ in log.foreach_version()]
    assert get_forthcoming_label(log.rst) or versions[0] == described(path).version


@every_package
def test_the_readme_begins_with_the_name(path: pathlib.Path) -> None:
    text = (path / 'README.md').read_text(encoding='utf-8')
    assert text.splitlines()[0] == f'# {path.name}'


@every_python_package
def test_setup_cfg_says_what_package_xml_says(path: pathlib.Path) -> None:
    package, given = described(path), set_up(path)
    (maintainer,) = package.maintainers
    (url,) = package.urls
    (author,) = package.authors
    assert given['name'] == package.name
    assert given['version'] == package.version
    assert given['maintainer'] == maintainer.name
    assert given['maintainer_email'] == maintainer.email
    assert given.get('author', author.name) == author.name
    assert given.get('url', url.url) == url.url
    assert given['license'] == package.licenses[0]


@every_python_package
def test_all_that_lies_beside_the_code_is_installed_with_it(path: pathlib.Path) -> None:
    """Such as the sound of the alarm, which nobody misses who has not built with links."""
    config = configparser.ConfigParser()
    config.read(path / 'setup.cfg', encoding='utf-8')
    code = path / path.name
    beside = {each for each in code.rglob('*.*') if each.suffix not in ('.py', '.pyc')}
    patterns = config['options.package_data'][path.name].split(', ')
    assert beside <= {each for pattern in patterns for each in code.glob(pattern)}


@every_python_package
@pytest.mark.parametrize('linter', ['flake8', 'pep257', 'xmllint'])
def test_a_linter_of_ament_has_nothing_to_say(linter: str, path: pathlib.Path) -> None:
    reason = "ament's linters are not installed: they come with ROS, not with its wheels"
    module = pytest.importorskip(f'ament_{linter}.main', reason=reason)
    assert module.main(argv=[str(path)]) == 0


@every_python_package
def test_a_package_asks_for_what_it_imports_and_its_tests_for_what_is_of_this_repository(
    path: pathlib.Path,
) -> None:
    package, ours = described(path), {each.name for each in PACKAGES}
    asked = {each.name for each in package.exec_depends}
    known = {path.name, *sys.stdlib_module_names, *OPTIONAL.get(path.name, ())}
    missing = {
        f'{file.relative_to(path)}: {name}'
        for file in [*path.glob(f'{path.name}/**/*.py'), *path.glob('launch/*.py')]
        for name in imported(file) - known
        if not {name, f'python3-{name}'} & asked
    }
    # Tests find evgp_testing by the path in pyproject.toml, since it needs most of the others.
    known = {path.name, 'evgp_testing', *asked, *(each.name for each in package.test_depends)}
    missing |= {
        f'{file.relative_to(path)}: {name}'
        for file in path.glob('test/**/*.py')
        for name in imported(file) & ours - known
    }
    assert missing == set()


def test_the_bridges_readme_lists_the_packages_that_come_along() -> None:
    text = (ROOT / 'src/evgp_kart_bridge/README.md').read_text(encoding='utf-8')
    named = {path.name for path in PACKAGES if f'`{path.name}`' in text}
    assert named == needs_of('evgp_kart_bridge') | {'evgp_race_watch_cpp'}


def imported(file: pathlib.Path) -> set[str]:
    """Return the packages that a Python file imports."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            found |= {each.name.partition('.')[0] for each in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add(str(node.module).partition('.')[0])
    return found


def test_every_launch_file_is_launched_by_a_test() -> None:
    text = (ROOT / 'test/test_launch_files.py').read_text(encoding='utf-8')
    files = [path.name for path in (ROOT / 'src').glob('*/launch/*.py')]
    assert files
    assert [name for name in files if f"'{name}'" not in text] == []


HEADER = re.compile(r'\W*(.*\n\W*)?Copyright \d{4} .*\n\W*SPDX-License-Identifier: Apache-2\.0\b')
"""The copyright and the licence, after a line for the browser or the shell."""

SOURCE = re.compile(r'.*\.([ch]|[ch]pp|css|html|ino|j2|js|py)|CMakeLists\.txt|Makefile')


def lacks_header(name: str, text: str) -> bool:
    """Return whether a source file, or a script without a suffix, does not begin with a header."""
    is_source = SOURCE.fullmatch(name) or ('.' not in name and text.startswith('#!'))
    return bool(text and is_source and not HEADER.match(text))


def test_every_source_file_begins_with_its_copyright_and_its_licence() -> None:
    header = '# Copyright 2026 EVGP\n# SPDX-License-Identifier: Apache-2.0\n'
    for name, begins in (
        ('a.py', ''),
        ('Makefile', ''),
        ('page.html', '<!-- \n'),
        ('run', '#!/bin/sh\n'),
    ):
        assert not lacks_header(name, begins + header)
        assert lacks_header(name, f'{begins}# text\n')
    lacking = []
    for folder, folders, names in os.walk(ROOT):
        made = {'__pycache__', 'build', 'install', 'log'}
        folders[:] = [
            each for each in folders if each == '.ci' or not (each[0] == '.' or each in made)
        ]
        paths = [path for name in names if not (path := pathlib.Path(folder, name)).is_symlink()]
        lacking += [
            each for each in paths if lacks_header(each.name, each.read_text(errors='replace'))
        ]
    assert lacking == []


def test_one_file_alone_touches_what_rclpy_keeps_to_itself() -> None:
    private = re.compile(r'rclpy\.(_|impl\b)|\b(subscription|service)\.handle\b')
    files = (ROOT / 'src').glob('*/evgp_*/**/*.py')
    found = [path.name for path in files if private.search(path.read_text(encoding='utf-8'))]
    assert found == ['rclpy_private.py']
