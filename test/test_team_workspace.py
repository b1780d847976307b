# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A team's own packages beside the clone: built by colcon, and run, as its documents say."""

from __future__ import annotations

import os
import pathlib
import re
import shutil
import subprocess
import sys

import pytest
import yaml

ROOT = pathlib.Path(__file__).parents[1]
TEMPLATE = ROOT / 'kit/template'

MESSAGES = {
    'package.xml': """<?xml version="1.0"?>
<package format="3">
  <name>team_msgs</name>
  <version>0.1.0</version>
  <description>A team's package.</description>
  <maintainer email="team@example.org">team</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  <depend>evgp_rcs_msgs</depend>
  <depend>std_msgs</depend>
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
""",
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
    """Return the one code block of evgp_testing's README that contains this."""
    readme = 'src/evgp_testing/README.md'
    (found,) = [each for each in blocks(readme, language) if containing in each]
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


def steps() -> dict[str, str]:
    """Return the lines of the template's workflow that have a name."""
    text = (TEMPLATE / '.github/workflows/test.yml').read_text(encoding='utf-8')
    job = yaml.safe_load(text)['jobs']['test']
    return {each['name']: each['run'] for each in job['steps'] if 'name' in each}


def test_the_workflow_of_the_template_needs_no_qt_ends_caches_and_says_when_nothing_is_set(
    tmp_path: pathlib.Path,
) -> None:
    text = (TEMPLATE / '.github/workflows/test.yml').read_text(encoding='utf-8')
    job = yaml.safe_load(text)['jobs']['test']
    assert 0 < job['timeout-minutes'] <= 60
    assert '--console' not in text
    assert 'make -C' not in text  # `make setup` installs Qt, too
    checked_out, cached = (
        [at for at, each in enumerate(job['steps']) if each.get('uses', '').startswith(what)]
        for what in ('actions/checkout@', 'actions/cache@')
    )
    assert cached > checked_out  # a later checkout would remove what was restored
    assert job['steps'][cached[0]]['with']['path'].split() == [
        f'evgp/{each}' for each in ('.venv', 'build', 'install')
    ]
    first = job['steps'][0]
    assert first['if'] == '${{ !vars.EVGP_REPOSITORY }}'
    with pytest.raises(AssertionError, match='::error::Set the variable EVGP_REPOSITORY'):
        run(first['run'], tmp_path)


@pytest.mark.long
@pytest.mark.timeout(900)
def test_the_template_with_messages_of_a_team_builds_beside_the_clone_and_passes(
    tmp_path: pathlib.Path,
) -> None:
    workspace = tmp_path / 'team'
    shutil.copytree(TEMPLATE, workspace)
    write(workspace / 'src/team_msgs', MESSAGES)
    example = block('python', 'def test_my_kart')
    assert "'evgp_kart_bridge', 'shortest_stack'" in example
    (workspace / 'test/test_my_stack.py').write_text(
        example.replace("'evgp_kart_bridge', 'shortest_stack'", "'my_kart', 'stack'"),
        encoding='utf-8',
    )
    building, testing = (steps()[name] for name in ('Build', 'Test'))
    assert any(building in each for each in blocks('kit/template/README.md', 'sh'))
    lap = 'python -c "import team_msgs.msg as its; print(its.Lap().state.RED_RED)"'
    using = f'source install/setup.bash\n$EVGP/setup/in-workspace {lap}'
    said = run(f'{building}\n{using}\n{testing}', workspace)
    assert '5 passed' in said
    # The base brakes without commands, so a stack that crashes stands within its distance, too.
    stack = workspace / 'src/my_kart/my_kart/stack.py'
    sound = stack.read_text(encoding='utf-8')
    crashes = 'self.driving = state.is_red and self.driving and exit(1) or '
    stack.write_text(sound.replace('self.driving = fresh', f'{crashes}fresh'), encoding='utf-8')
    with pytest.raises(AssertionError, match='2 failed'):
        run(f'{testing.strip()} -k "red_red or hangs"', workspace)


@pytest.mark.timeout(300)
def test_the_example_passes_with_the_stack_of_readme(tmp_path: pathlib.Path) -> None:
    example = block('python', 'def test_my_kart')
    (tmp_path / 'test_my_stack.py').write_text(example, encoding='utf-8')
    assert '1 passed' in run(block('sh', 'pytest test_my_stack.py'), tmp_path)
