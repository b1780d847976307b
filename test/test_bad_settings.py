# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Race control refuses a wrong setting at start, with one sentence and exit code 2."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import os
import pathlib
import socket
from typing import Any

from evgp_node.parameter_files import ignored
from evgp_node.process import IN_THE_WAY, WRONG_SETTING
from evgp_testing.domains import Domain
from evgp_testing.process import Process
from evgp_testing.race_control import settings
import pytest

Refusal = Callable[..., str]

ROSTER = 'karts: [{number: 1, team: One, address: 127.0.1.1, in_race: true}]'


@pytest.fixture
def refusal(parts: contextlib.ExitStack, tmp_path: pathlib.Path) -> Refusal:
    """Return a function that starts race control and returns what it said when it refused."""
    domain = parts.enter_context(Domain())
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
        given = {**settings(tmp_path, good), **parameters}
        control = parts.enter_context(
            Process('evgp_rcs', 'rcs_node', domain.number, given, arguments)
        )
        assert control.wait() == code, control.output
        assert 'Traceback' not in control.output
        return control.output

    return start


TWO_FAULTS = 'karts:\n  - {number: 0, team: One, address: 1, in_race: true}\nheats: 3\n'


@pytest.mark.parametrize(
    ('given', 'said'),
    [
        ({'roster': "''"}, ['parameter roster is missing']),
        ({'roster_text': TWO_FAULTS}, ['good.yaml:2:', 'good.yaml:3:']),
        ({'beat_rate': 5.0}, ['parameter beat_rate', 'from 11 to 100']),
        ({'send_timeout': 'soon'}, ['parameter send_timeout']),
        ({'beat_rat': 20.0}, ['parameter beat_rat is unknown; did you mean beat_rate?']),
        ({'finish_delays': '[2.0, -1.0]'}, ['parameter finish_delays: -1 is not possible']),
        ({'finish_delays': '[]'}, ['a list must not be empty']),
        ({'address': '..'}, ["parameter address: '..' is not an IPv4 address"]),
    ],
)
def test_a_wrong_value_is_named_with_what_is_possible(
    refusal: Refusal, given: dict[str, Any], said: list[str]
) -> None:
    refused = refusal(**given)
    assert [each for each in said if each not in refused] == []


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
