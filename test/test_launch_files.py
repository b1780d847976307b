# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Every launch file, by a real `launch`: what it starts is there, comes back, and ends in order.

A `launch` in a process of its own does here what `ros2 launch` does. launch_testing is not used:
its plugin for pytest breaks every run of pytest 9, and it lets nobody kill what it has launched.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import contextlib
import importlib.util
import itertools
import json
import os
import pathlib
import re
import signal
import subprocess
import sys

from ament_index_python.packages import get_package_share_directory
from evgp_node.process import WRONG_SETTING
from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_testing.kart import Team
from evgp_testing.official import Official, SERVICES
from evgp_testing.process import Program, wait_until_ended
from evgp_testing.race_control import settings, write_roster
from evgp_testing.ros_side import RosSide
from evgp_testing.usage import family
import pytest
from rig.bare_race_control import BareRaceControl
from rig.needs import need_screen
from rig.screen import Screen
import yaml

ROOT = pathlib.Path(__file__).resolve().parents[1]

if importlib.util.find_spec('launch_ros') is None:
    pytest.skip(
        'launch and launch_ros are not installed: they come with ROS, not with its wheels',
        allow_module_level=True,
    )

LAUNCH = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import AnyLaunchDescriptionSource

file, *arguments = sys.argv[1:]
given = [each.split(':=', 1) for each in arguments]
launched = IncludeLaunchDescription(AnyLaunchDescriptionSource(file), launch_arguments=given)
service = LaunchService(noninteractive=True)  # as `ros2 launch` without a terminal
service.include_launch_description(LaunchDescription([launched]))
sys.exit(service.run())
"""

STAND_IN = """#!{python}
import json, os, sys
with open({told!r}, 'w') as file:
    json.dump({{'arguments': sys.argv[1:], 'environment': dict(os.environ)}}, file)
"""
"""A program of somebody else that is not installed here: writes down how it was started."""

Start = Callable[..., 'Launch']


class Launch(Program):
    """A launch file that is being launched, with the processes that it has started."""

    def __init__(
        self,
        path: pathlib.Path,
        arguments: Mapping[str, object],
        environment: Mapping[str, str],
    ) -> None:
        words = [f'{name}:={value}' for name, value in arguments.items()]
        command = [sys.executable, '-c', LAUNCH, str(path), *words]
        super().__init__(path.name, command, environment=environment, end='INT')

    def started(self, program: str = r'\S+') -> int:
        """Return the process number of a program, which something may have started again."""
        line = rf'\[{program}-\d+\]: process started with pid \[(\d+)\]'
        restarting, *programs = family(int(self.wait_for_line(line)[1]))
        return (programs or [restarting])[0]

    @property
    def failures(self) -> list[int]:
        """Return how the processes ended that did not end in order (negative: a signal)."""
        codes = re.findall(r'process has died .*exit code (-?\d+)', self.output)
        return [*map(int, codes)]

    def end(self) -> int:
        """End it as Ctrl-C does; return its exit code."""
        self.signal(signal.SIGINT)
        return self.wait()

    def close(self) -> int:
        """End it, and whatever it leaves behind."""
        left = family(self.pid)[1:] if self.runs else []
        if self.runs:
            self.signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(10)
            if self.runs:
                self.process.kill()
        for pid in left:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        return self.wait()


@pytest.fixture
def launch(parts: contextlib.ExitStack, tmp_path: pathlib.Path) -> Start:
    """Return a function that launches a launch file of a package."""

    def start(
        package: str, file: str, environment: Mapping[str, str] | None = None, **arguments: object
    ) -> Launch:
        path = pathlib.Path(get_package_share_directory(package), 'launch', file)
        own = {'ROS_LOG_DIR': str(tmp_path / 'log'), 'ROS_HOME': str(tmp_path)}
        return parts.enter_context(Launch(path, arguments, {**own, **(environment or {})}))

    return start


def parameter_file(folder: pathlib.Path, parameters: Mapping[str, object]) -> pathlib.Path:
    """Write parameters into a file, and return it."""
    path = folder / 'parameters.yaml'
    given = {name: str(each) if name == 'record' else each for name, each in parameters.items()}
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': given}}), encoding='utf-8')
    return path


# ----- race control -----------------------------------------------------------------------


def race_control(folder: pathlib.Path, domain: int) -> dict[str, object]:
    """Return the arguments of rcs.launch.py for a race control at a port of its own."""
    parameters = settings(folder, write_roster(folder, [1]))
    roster = parameters.pop('roster')
    params_file = parameter_file(folder, parameters)
    return {'roster': roster, 'params_file': params_file, 'domain_id': domain}


def test_race_control_is_there_comes_back_and_ends_in_order(
    launch: Start, domain: int, tmp_path: pathlib.Path, parts: contextlib.ExitStack
) -> None:
    launched = launch('evgp_rcs', 'rcs.launch.py', **race_control(tmp_path, domain))
    official = parts.enter_context(Official(domain))
    official.wait_for_race(lambda race: race.karts, 'a race')
    wanted = {f'/rcs/{service}' for service in SERVICES}
    official.wait_until_polled(
        lambda: wanted <= {name for name, _ in official.node.get_service_names_and_types()},
        'every service of an official',
    )
    official.command('set_track_open', open=False)

    official.wait_until_polled(
        lambda: official.node.count_publishers('/rcs/timekeeper/results') == 1, 'the timekeeper'
    )
    timekeeper = launched.started('timekeeper')
    os.kill(launched.started('rcs_node'), signal.SIGKILL)
    launched.wait_for_line(r'rcs_node was killed \(SIGKILL\)')
    official.wait_for_race(
        lambda race: state_of(race.state) is RaceState.RED_RED, 'race control again'
    )
    official.command('all_kill')

    again = launched.started('rcs_node')
    assert launched.end() == 0, launched.output
    wait_until_ended(again)
    wait_until_ended(timekeeper)
    assert launched.failures == []


def test_a_launch_ends_where_a_setting_of_race_control_is_wrong(
    launch: Start, domain: int, tmp_path: pathlib.Path
) -> None:
    given = race_control(tmp_path, domain)
    wrong = {**given, 'params_file': parameter_file(tmp_path, {'pause': 99.0})}
    launched = launch('evgp_rcs', 'rcs.launch.py', **wrong)
    launched.wait()
    assert launched.failures == [WRONG_SETTING]


# ----- the bridge -------------------------------------------------------------------------


@pytest.fixture
def race(parts: contextlib.ExitStack) -> BareRaceControl:
    return parts.enter_context(BareRaceControl())


@pytest.fixture
def on_a_kart(race: BareRaceControl, domain: int, tmp_path: pathlib.Path) -> dict[str, object]:
    """Return the arguments of a launch file for a kart of `race`."""
    params_file = parameter_file(tmp_path, {'port': race.port})
    return {'host': '127.0.0.1', 'params_file': params_file, 'domain_id': domain}


def test_the_bridge_is_there_comes_back_and_ends_in_order(
    launch: Start, on_a_kart: dict[str, object], domain: int, parts: contextlib.ExitStack
) -> None:
    launched = launch('evgp_kart_bridge', 'kart_bridge.launch.py', odom='/odom', **on_a_kart)
    team = parts.enter_context(Team(domain))
    first = team.wait_for_state(RaceState.IN_GARAGE)
    team.wait_until_polled(lambda: team.node.count_subscribers('/odom') == 1, 'to hear odometry')
    wanted = {'/kart_bridge/acknowledge', '/kart_bridge/team_stop'}
    team.wait_until_polled(
        lambda: wanted <= {name for name, _ in team.node.get_service_names_and_types()},
        'every service of the bridge',
    )

    os.kill(launched.started(), signal.SIGKILL)
    team.wait_for(lambda told: told.order not in (0, first.order), 'the bridge again')

    again = launched.started()
    assert launched.end() == 0, launched.output
    wait_until_ended(again)
    assert launched.failures == []


def test_one_launch_file_starts_the_bridge_and_the_stack(
    launch: Start, on_a_kart: dict[str, object], race: BareRaceControl
) -> None:
    stack = {'executable': 'example_stack'}
    launched = launch('evgp_kart_bridge', 'kart.launch.py', **stack, **on_a_kart)
    race.exchange(RaceState.GRID_ACTIVE)  # the stack has acknowledged
    assert launched.end() == 0, launched.output


# ----- the window -------------------------------------------------------------------------


def test_the_window_is_there_and_ends_in_order(
    launch: Start, domain: int, parts: contextlib.ExitStack
) -> None:
    need_screen()
    screen = parts.enter_context(Screen())
    shown = {'DISPLAY': screen.display, 'QT_QPA_PLATFORM': 'xcb'}
    launched = launch('evgp_rcs_console', 'console.launch.py', shown, domain_id=domain)
    looking = parts.enter_context(RosSide('looking', domain))
    looking.spin()
    looking.wait_until_polled(lambda: looking.node.count_subscribers('/rcs/race') == 1, 'a window')
    window = launched.started()
    assert launched.end() == 0, launched.output
    wait_until_ended(window)
    assert launched.failures == []


def test_a_launch_ends_where_a_setting_of_the_window_is_wrong(
    launch: Start, parts: contextlib.ExitStack
) -> None:
    need_screen()
    screen = parts.enter_context(Screen())
    shown = {'DISPLAY': screen.display, 'QT_QPA_PLATFORM': 'xcb'}
    launched = launch('evgp_rcs_console', 'console.launch.py', shown, domain_id=999)
    launched.wait()
    assert launched.failures == [WRONG_SETTING]


# ----- programs of others -----------------------------------------------------------------


def put_stand_in(program: pathlib.Path) -> pathlib.Path:
    """Put a program in somebody else's place, and return the file that it will write."""
    told = program.with_suffix('.json')
    program.parent.mkdir(parents=True)
    program.write_text(STAND_IN.format(python=sys.executable, told=str(told)), encoding='utf-8')
    program.chmod(0o755)
    return told


def words_told(launched: Launch, told: pathlib.Path) -> list[str]:
    """Return how a stand-in was started: on the graph of race control, and found here only."""
    assert launched.wait() == 0, launched.output
    was = json.loads(told.read_text(encoding='utf-8'))
    assert was['environment']['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'SYSTEM_DEFAULT'
    assert 'evgp-graph-' in was['environment']['FASTRTPS_DEFAULT_PROFILES_FILE']
    return was['arguments']


def test_foxglove_starts_on_the_graph_of_race_control_and_listens_here_only(
    launch: Start, tmp_path: pathlib.Path
) -> None:
    index = tmp_path / 'ros/share/ament_index/resource_index/packages'
    index.mkdir(parents=True)
    (index / 'foxglove_bridge').touch()
    told = put_stand_in(tmp_path / 'ros/lib/foxglove_bridge/foxglove_bridge')
    path = f'{tmp_path / "ros"}{os.pathsep}{os.environ["AMENT_PREFIX_PATH"]}'
    launched = launch('evgp_rcs', 'foxglove.launch.py', {'AMENT_PREFIX_PATH': path})
    words = words_told(launched, told)
    files = [file for word, file in itertools.pairwise(words) if word == '--params-file']
    assert any('address: 127.0.0.1' in pathlib.Path(file).read_text() for file in files)


def test_a_race_is_recorded_with_what_the_latched_topics_keep(
    launch: Start, tmp_path: pathlib.Path
) -> None:
    told = put_stand_in(tmp_path / 'bin/ros2')
    path = f'{tmp_path / "bin"}{os.pathsep}{os.environ["PATH"]}'
    launched = launch('evgp_rcs', 'bag.launch.py', {'PATH': path}, output='race1')
    words = words_told(launched, told)
    assert words[:2] == ['bag', 'record']
    assert words[words.index('--output') + 1] == 'race1'
    topics = ['/rcs/race', '/rcs/events', '/rcs/timekeeper/results', '/diagnostics']
    assert words[-5:] == ['--topics', *topics]
    file = pathlib.Path(words[words.index('--qos-profile-overrides-path') + 1])
    assert file.read_bytes() == (ROOT / 'src/evgp_rcs/config/bag_qos.yaml').read_bytes()
