# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A team's own packages beside the clone: built by colcon, and run, as docs/teams.md says."""

from __future__ import annotations

import os
import pathlib
import re
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).parents[1]

PACKAGE_XML = """<?xml version="1.0"?>
<package format="3">
  <name>{name}</name>
  <version>0.1.0</version>
  <description>A team's package.</description>
  <maintainer email="team@example.org">team</maintainer>
  <license>Apache-2.0</license>
  {depends}
  <export><build_type>{build_type}</build_type></export>
</package>
"""

MESSAGES = {
    'package.xml': PACKAGE_XML.format(
        name='team_msgs',
        build_type='ament_cmake',
        depends="""<buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  <depend>evgp_rcs_msgs</depend>
  <depend>std_msgs</depend>
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>""",
    ),
    'CMakeLists.txt': """cmake_minimum_required(VERSION 3.8)
project(team_msgs)
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
find_package(evgp_rcs_msgs REQUIRED)
find_package(std_msgs REQUIRED)
rosidl_generate_interfaces(${PROJECT_NAME} "msg/Lap.msg" DEPENDENCIES evgp_rcs_msgs std_msgs
  ADD_LINTER_TESTS)
ament_package()
""",
    'msg/Lap.msg': 'std_msgs/Header header\nevgp_rcs_msgs/RaceState state\nfloat64 seconds\n',
}

STACK = {
    'package.xml': PACKAGE_XML.format(
        name='team_stack',
        build_type='ament_python',
        depends='<depend>rclpy</depend>\n  <depend>evgp_kart_bridge</depend>',
    ),
    'setup.cfg': '[develop]\nscript_dir=$base/lib/team_stack\n'
    '[install]\ninstall_scripts=$base/lib/team_stack\n',
    'setup.py': """from setuptools import setup

setup(
    name='team_stack',
    version='0.1.0',
    packages=['team_stack'],
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/team_stack']),
        ('share/team_stack', ['package.xml']),
    ],
    entry_points={'console_scripts': ['team_stack = team_stack.stack:main']},
)
""",
    'resource/team_stack': '',
    'team_stack/__init__.py': '',
}
"""Its node is that of docs/teams.md, as it stands."""


PATHS = {'PATH'}
if 'ROS_DISTRO' in os.environ:
    PATHS |= {
        'AMENT_PREFIX_PATH',
        'CMAKE_PREFIX_PATH',
        'LD_LIBRARY_PATH',
        'PKG_CONFIG_PATH',
        'PYTHONPATH',
        'ROS_DISTRO',
    }
"""What a shell knows that has sourced an installed ROS, where there is one."""


def write(folder: pathlib.Path, files: dict[str, str]) -> None:
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content, encoding='utf-8')


def blocks(document: str, language: str) -> list[str]:
    """Return the code blocks of a document, in order."""
    text = (ROOT / document).read_text(encoding='utf-8')
    return re.findall(rf'^```{language}\n(.*?)^```$', text, re.MULTILINE | re.DOTALL)


def block(language: str, containing: str) -> str:
    """Return the one code block of docs/teams.md that has this in it."""
    (found,) = [each for each in blocks('docs/teams.md', language) if containing in each]
    return found


def run(script: str, folder: pathlib.Path) -> str:
    """
    Run lines of a document in a shell that has sourced nothing of this workspace.

    An installed ROS that is sourced here is sourced there too. Without it, the set-up would put
    ROS's wheels in its place, under every other test.

    :return: what they print.
    :raises AssertionError: if they fail.
    """
    environment = {name: os.environ[name] for name in ('HOME', *PATHS) if name in os.environ}
    for name in PATHS & {*environment}:
        environment[name] = os.pathsep.join(
            each for each in environment[name].split(os.pathsep) if not each.startswith(str(ROOT))
        )
    environment['PYTHON'] = f'python{sys.version_info.major}.{sys.version_info.minor}'
    done = subprocess.run(
        ['bash', '-ec', script],
        cwd=folder,
        env={**environment, 'EVGP': str(ROOT)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    return done.stdout


@pytest.mark.long
@pytest.mark.timeout(600)
def test_a_workspace_with_messages_of_its_own_builds_beside_the_clone_and_passes_the_example(
    tmp_path: pathlib.Path,
) -> None:
    workspace = tmp_path / 'team'
    write(workspace / 'src/team_msgs', MESSAGES)
    write(workspace / 'src/team_stack', STACK)
    (workspace / 'src/team_stack/team_stack/stack.py').write_text(
        block('python', 'class Stack'), encoding='utf-8'
    )
    example = block('python', 'def test_my_kart')
    assert "'evgp_kart_bridge', 'shortest_stack'" in example
    (workspace / 'test_my_stack.py').write_text(
        example.replace("'evgp_kart_bridge', 'shortest_stack'", "'team_stack', 'team_stack'"),
        encoding='utf-8',
    )
    lap = 'python -c "import team_msgs.msg as its; print(its.Lap().state.RED_RED)"'
    building, testing = block('sh', 'colcon build'), block('sh', 'pytest test_my_stack.py')
    said = run(f'{building}\n$EVGP/setup/in-workspace {lap}\n{testing}', workspace)
    assert '1 passed' in said


@pytest.mark.timeout(300)
def test_the_examples_pass_the_teams_with_the_stack_of_readme(tmp_path: pathlib.Path) -> None:
    examples = [*blocks('docs/testing.md', 'python'), block('python', 'def test_my_kart')]
    (tmp_path / 'test_my_stack.py').write_text('\n\n'.join(examples), encoding='utf-8')
    assert '2 passed' in run(block('sh', 'pytest test_my_stack.py'), tmp_path)
