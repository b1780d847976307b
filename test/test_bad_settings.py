# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Race control and the bridge refuse a wrong setting at start, in one sentence, with code 2."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import os
import pathlib
import socket

from evgp_kart_bridge.node import read_settings as bridge_settings
from evgp_node.parameter_files import ignored
from evgp_node.parameters import ParameterError, Parameters, StrictNode
from evgp_node.process import IN_THE_WAY, WRONG_SETTING
from evgp_rcs.ros import settings
from evgp_testing import race_control
from evgp_testing.process import Process
import pytest
import rclpy
from rclpy.context import Context

Refusal = Callable[..., str]

ROSTER = 'karts: [{number: 1, team: One, address: 127.0.1.1, in_race: true}]'


@pytest.fixture
def refusal(parts: contextlib.ExitStack, domain: int, tmp_path: pathlib.Path) -> Refusal:
    """Return a function that starts race control and returns what it said when it refused."""
    good = tmp_path / 'good.yaml'
    good.write_text(ROSTER, encoding='utf-8')

    def start(
        *arguments: str,
        roster_text: str | None = None,
        code: int = WRONG_SETTING,
        **parameters: object,
    ) -> str:
        if roster_text is not None:
            good.write_text(roster_text, encoding='utf-8')
        given = {**race_control.settings(tmp_path, good), **parameters}
        control = parts.enter_context(Process('evgp_rcs', 'rcs_node', domain, given, arguments))
        assert control.wait() == code, control.output
        assert 'Traceback' not in control.output
        return control.output

    return start


TWO_FAULTS = 'karts:\n  - {number: 0, team: One, address: 1, in_race: true}\nheats: 3\n'


def test_a_wrong_roster_is_refused_with_each_of_its_faults(refusal: Refusal) -> None:
    refused = refusal(roster_text=TWO_FAULTS)
    assert 'good.yaml:2:' in refused
    assert 'good.yaml:3:' in refused


def test_a_wrong_value_is_refused(refusal: Refusal) -> None:
    assert 'parameter beat_rate' in refusal(beat_rate=5.0)


def test_a_bridge_refuses_a_wrong_value(domain: int) -> None:
    with Process('evgp_kart_bridge', 'kart_bridge_node', domain, {}) as bridge:
        assert bridge.wait() == WRONG_SETTING, bridge.output
        assert 'parameter host is missing' in bridge.output
        assert len(bridge.lines) == 1, bridge.output


HOST = 'host:=10.0.0.1'


@pytest.mark.parametrize(
    ('read', 'given', 'said'),
    [
        (settings.read_settings, [], 'parameter roster is missing'),
        (settings.read_settings, ['beat_rate:=5.0'], 'parameter beat_rate.* from 11 to 100'),
        (settings.read_settings, ['send_timeout:=soon'], 'parameter send_timeout'),
        (settings.read_settings, ['beat_rat:=20.0'], 'beat_rat is unknown; did you mean beat_ra'),
        (settings.read_settings, ['finish_delays:=[2.0, -1.0]'], 'delays: -1 is not possible'),
        (settings.read_settings, ['finish_delays:=[]'], 'a list must not be empty'),
        (settings.read_settings, ['address:=..'], "parameter address: '..' is not an IPv4 addr"),
        (bridge_settings, ['host:=racecontrol'], "host: 'racecontrol' is not an IPv4 address"),
        (bridge_settings, [HOST, 'local_address:=10.0.0.256'], 'parameter local_address'),
        (bridge_settings, [HOST, 'frame_timeout:=5.0'], 'frame_timeout.* from 0.2 to 1'),
    ],
)
def test_a_wrong_value_is_named_with_what_is_possible(
    read: Callable[[Parameters], object], given: list[str], said: str, domain: int
) -> None:
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    arguments = ['--ros-args', *(word for each in given for word in ('-p', each))]
    try:
        with pytest.raises(ParameterError, match=said):
            read(Parameters(StrictNode('rcs', context=context, cli_args=arguments)))
    finally:
        rclpy.try_shutdown(context=context)


def test_an_unknown_argument_of_ros_is_refused(refusal: Refusal) -> None:
    assert 'unknown ROS arguments' in refusal('--unheard-of')


def test_a_roster_that_is_a_pipe_is_refused(refusal: Refusal, tmp_path: pathlib.Path) -> None:
    os.mkfifo(tmp_path / 'pipe')
    assert 'is a pipe' in refusal(roster=tmp_path / 'pipe')


def test_a_parameter_file_that_is_no_yaml_is_refused(
    refusal: Refusal, tmp_path: pathlib.Path
) -> None:
    path = tmp_path / 'rcs.yaml'
    path.write_text('/**:\n  ros__parameters:\n    port: [1\n', encoding='utf-8')
    assert str(path) in refusal('--params-file', str(path))


@pytest.mark.parametrize(
    ('text', 'line', 'said'),
    [
        ('rcs_node:\n  ros__parameters:\n    require_inspection: true\n', 1, 'rcs_node'),
        ('/field:\n  rcs:\n    ros__parameters:\n      pause: 2.0\n', 2, '/field/rcs'),
        ('/**:\n  ros__parameters:\n    pause: 2.0\n    pause: 1.0\n', 4, 'pause'),
        ('/**:\n  ros__parameters: {pause: 2.0}\n/**:\n  ros__parameters: {}\n', 3, '/**'),
        *((f'{each}:\n  ros__parameters: {{}}\n', 0, '') for each in ('/**', '/*', 'rcs', '/rcs')),
    ],
)
def test_what_ros_would_ignore_in_a_parameter_file_is_known_with_its_line(
    tmp_path: pathlib.Path, text: str, line: int, said: str
) -> None:
    path = tmp_path / 'rcs.yaml'
    path.write_text(text, encoding='utf-8')
    found = [*ignored(['--params-file', str(path)], '/rcs', alone=False)]
    assert [each.startswith(f'{path}:{line}: ') and said in each for each in found] == (
        [True] if line else []
    )


def test_what_ros_would_ignore_in_a_parameter_file_is_refused(
    refusal: Refusal, tmp_path: pathlib.Path
) -> None:
    path = tmp_path / 'rcs.yaml'
    path.write_text('rcs_node:\n  ros__parameters: {pause: 2.0}\n', encoding='utf-8')
    assert f'{path}:1: ' in refusal('--params-file', str(path))


def test_a_port_in_use_says_so_and_may_be_free_later(refusal: Refusal) -> None:
    with socket.create_server(('127.0.0.1', 0)) as taken:
        said = refusal(port=taken.getsockname()[1], code=IN_THE_WAY)
    assert 'address already in use' in said
    assert 'choose another address or port' in said
