# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Our programs refuse a wrong setting at the start, in one sentence, with exit code 2."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import pathlib
from typing import Any

from evgp_kart_bridge import node as bridge
from evgp_node.parameter_files import ignored, unreadable
from evgp_node.parameters import ParameterError, StrictNode
from evgp_node.process import WRONG_SETTING
from evgp_rcs.ros import settings
from evgp_rcs_console import button
from evgp_testing import race_control
from evgp_testing.process import Process
from evgp_testing.ros_side import joined
from evgp_timing import node as timing_source
from evgp_timing import timekeeper
import pytest

Refusal = Callable[..., str]

ROSTER = 'karts: [{number: 1, team: One, address: 127.0.1.1, in_race: true}]'


@pytest.fixture
def refusal(parts: contextlib.ExitStack, domain: int, tmp_path: pathlib.Path) -> Refusal:
    """Return a function that starts race control and returns what it said when it refused."""

    def start(*arguments: str, roster_text: str = ROSTER) -> str:
        roster = tmp_path / 'karts.yaml'
        roster.write_text(roster_text, encoding='utf-8')
        given = race_control.settings(tmp_path, roster)
        control = parts.enter_context(Process('evgp_rcs', 'rcs_node', domain, given, arguments))
        assert control.wait() == WRONG_SETTING, control.output
        assert 'Traceback' not in control.output
        return control.output

    return start


TWO_FAULTS = 'karts:\n  - {number: 0, team: One, address: 1, in_race: true}\nheats: 3\n'


def test_a_wrong_roster_is_refused_with_each_of_its_faults(refusal: Refusal) -> None:
    refused = refusal(roster_text=TWO_FAULTS)
    assert 'karts.yaml:2:' in refused
    assert 'karts.yaml:3:' in refused


@pytest.mark.parametrize(
    ('package', 'program', 'given', 'said'),
    [
        ('evgp_kart_bridge', 'kart_bridge_node', {}, 'parameter host is missing'),
        ('evgp_timing', 'timekeeper', {'roster': '/nowhere/a.yaml'}, '/nowhere/a.yaml: cannot be'),
        ('evgp_timing', 'timing_source', {'kind': 'p3'}, 'parameter device'),
        ('evgp_rcs_console', 'rcs_button', {'device': 'event3'}, 'parameter device'),
    ],
)
def test_a_wrong_setting_ends_a_program_with_one_sentence(
    package: str, program: str, given: dict[str, object], said: str, domain: int
) -> None:
    with Process(package, program, domain, given) as started:
        assert started.wait() == WRONG_SETTING, started.output
        assert said in started.output
        assert len(started.lines) == 1, started.output


HOST, KIND, DEVICE = 'host:=10.0.0.1', 'kind:=p3', 'device:=/dev/x'
WRONG_VALUES = {
    settings: [
        ([], 'parameter roster is missing'),
        (['beat_rate:=5.0'], 'parameter beat_rate.* from 11 to 100'),
        (['send_timeout:=soon'], 'parameter send_timeout'),
        (['beat_rat:=20.0'], 'beat_rat is unknown; did you mean beat_rate?'),
        (['finish_delays:=[2.0, -1.0]'], 'parameter finish_delays: -1 is not possible'),
        (['finish_delays:=[]'], 'a list must not be empty'),
        (['address:=..'], "parameter address: '..' is not an IPv4 address"),
    ],
    bridge: [
        (['host:=racecontrol'], "parameter host: 'racecontrol' is not an IPv4 address"),
        ([HOST, 'local_address:=10.0.0.256'], 'parameter local_address'),
        ([HOST, 'frame_timeout:=5.0'], 'parameter frame_timeout.* from 0.2 to 1'),
    ],
    timekeeper: [
        ([], 'parameter roster is missing'),
        (['min_laptime:=5.0'], 'did you mean min_lap_time?'),
        (['first_crossing:=begins'], "parameter first_crossing: 'begins' is not valid"),
    ],
    timing_source: [
        (['kind:=p4', 'device:=10.0.0.1:5403'], "parameter kind: 'p4'"),
        ([KIND, 'device:=10.0.0.1'], 'parameter device'),
        ([KIND, DEVICE, 'source:=official'], "parameter source: 'official'"),
        (['kind:=contact', 'device:=10.0.0.1:5403'], 'parameter device'),
        (['kind:=contact', DEVICE, 'line:=rts'], 'parameter line'),
        ([KIND, 'device:=10.0.0.1:5403', 'baut:=9600'], 'did you mean baud?'),
    ],
    button: [
        ([], 'parameter device'),
        ([DEVICE, 'key:=768'], 'parameter key'),
        ([DEVICE, 'keys:=3'], 'did you mean key?'),
    ],
}
"""Parameters of each program, by the module that reads them, and what is said of them."""


@pytest.mark.parametrize(
    ('module', 'given', 'said'),
    [(module, *row) for module, rows in WRONG_VALUES.items() for row in rows],
)
def test_a_wrong_value_is_named_with_what_is_possible(
    module: Any, given: list[str], said: str, domain: int
) -> None:
    arguments = ['--ros-args', *(word for each in given for word in ('-p', each))]
    with joined(domain) as context, pytest.raises(ParameterError, match=said):
        module.read_settings(StrictNode('it', context=context, cli_args=arguments))


def test_an_argument_that_ros_does_not_know_or_cannot_read_is_refused(refusal: Refusal) -> None:
    assert 'unknown ROS arguments' in refusal('--unheard-of')
    refused = refusal('-p', 'officials:=[Anna, 3]')
    assert 'Sequence should be of same type' in refused
    assert '.c:' not in refused  # where in ROS's own code


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('/**:\n  ros__parameters:\n    port: [1\n', ":4: expected ',' or ']', but got "),
        ('rcs_node:\n  ros__parameters: {pause: 2.0}\n', ':1: '),
        (None, ': cannot be read ('),
    ],
)
def test_a_parameter_file_that_ros_cannot_read_or_would_ignore_is_refused_in_one_sentence(
    text: str | None, said: str, refusal: Refusal, tmp_path: pathlib.Path
) -> None:
    path = tmp_path / 'parameters.yaml'
    if text is not None:
        path.write_text(text)
    (line,) = refusal('--params-file', str(path)).splitlines()
    assert line.startswith(f'rcs: {path}{said}')


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


PAUSE = '/**:\n  ros__parameters:\n    pause: 2.0\n'


@pytest.mark.parametrize(
    ('content', 'line'),
    [
        (PAUSE.replace('2.0', '2.0\t# s').encode(), ':3'),
        (f'{PAUSE}---\n{PAUSE}'.encode(), ':4'),
        (PAUSE.encode('utf-16'), ''),
        (b'rcs.yaml\n', ':1'),
        (b'pause: 2.0\n', ':1'),
        (PAUSE.replace('ros__', 'ros_').encode(), ':3'),
        (b'- pause: 2.0\n', ':1'),
        (b'/**:\n  ros__parameters: &all\n    pause: *all\n', ':3'),
        (b'[' * 3000, ''),
        (b'\xef\xbb\xbf' + PAUSE.replace('\n', '\r\n').encode(), None),
    ],
)
def test_a_parameter_file_that_cannot_be_used_is_named_in_a_sentence(
    tmp_path: pathlib.Path, content: bytes, line: str | None
) -> None:
    path = tmp_path / 'rcs.yaml'
    path.write_bytes(content)
    found = [*unreadable(['--params-file', str(path)])]
    assert [each.startswith(f'{path}{line}: ') for each in found] == [True] * (line is not None)
    assert 'Node' not in ''.join(found)  # PyYAML's own terms
