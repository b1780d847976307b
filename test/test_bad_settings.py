# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Our programs refuse a wrong setting at the start, in one sentence, with exit code 2."""

from __future__ import annotations

from collections.abc import Iterator
import pathlib
from typing import Any

from evgp_kart_bridge import node as bridge
from evgp_node.parameter_files import ignored, unreadable
from evgp_node.parameters import ParameterError, StrictNode
from evgp_node.process import WRONG_SETTING
from evgp_rcs.ros import settings
from evgp_rcs_console import button
from evgp_testing import race_control
from evgp_testing.domains import Domain
from evgp_testing.process import Process
from evgp_testing.ros_side import joined
from evgp_timing import node as timing_source
from evgp_timing import timekeeper
import pytest
from rclpy.context import Context

FILES = {
    'karts.yaml': 'karts: [{number: 1, team: One, address: 127.0.1.1, in_race: true}]',
    'faulty.yaml': 'karts:\n  - {number: 0, team: One, address: 1, in_race: true}\nheats: 3\n',
    'broken.yaml': '/**:\n  ros__parameters:\n    port: [1\n',
    'other.yaml': 'rcs_node:\n  ros__parameters: {pause: 2.0}\n',
}
RCS = 'evgp_rcs/rcs_node'


@pytest.mark.parametrize(
    ('program', 'given', 'arguments', 'said'),
    [
        ('evgp_timing/timekeeper', {'roster': '/nowhere/a.yaml'}, (), ['/nowhere/a.yaml: cannot']),
        (RCS, {'roster': 'faulty.yaml'}, (), ['faulty.yaml:2:', 'address', 'faulty.yaml:3:']),
        (RCS, {}, ('--unheard-of',), ['unknown ROS arguments']),
        (RCS, {}, ('-p', 'officials:=[Anna, 3]'), ['rcl', 'Sequence should be of same type']),
        (RCS, {}, ('--params-file', 'broken.yaml'), ["broken.yaml:4: expected ',' or ']', but"]),
        (RCS, {}, ('--params-file', 'other.yaml'), ['rcs: other.yaml:1: ']),
    ],
)
def test_a_wrong_setting_ends_a_program_with_a_sentence_for_each_fault(
    program: str,
    given: dict[str, object],
    arguments: tuple[str, ...],
    said: list[str],
    domain: int,
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding='utf-8')
    if program == RCS:
        given = {**race_control.settings(tmp_path, tmp_path / 'karts.yaml'), **given}
    with Process(*program.split('/'), domain, given, arguments) as started:
        assert started.wait() == WRONG_SETTING, started.output
    assert all(part in line for part, line in zip(said, started.lines, strict=True))
    assert '.c:' not in started.output  # where in ROS's own code


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
        ([], 'parameter host is missing'),
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
        ([KIND], 'parameter device'),
        (['kind:=p4', 'device:=10.0.0.1:5403'], "parameter kind: 'p4'"),
        ([KIND, 'device:=10.0.0.1'], 'parameter device'),
        ([KIND, DEVICE, 'source:=official'], "parameter source: 'official'"),
        (['kind:=contact', 'device:=10.0.0.1:5403'], 'parameter device'),
        (['kind:=contact', DEVICE, 'line:=rts'], 'parameter line'),
        ([KIND, 'device:=10.0.0.1:5403', 'baut:=9600'], 'did you mean baud?'),
    ],
    button: [
        ([], 'parameter device'),
        (['device:=event3'], 'parameter device'),
        ([DEVICE, 'key:=768'], 'parameter key'),
        ([DEVICE, 'keys:=3'], 'did you mean key?'),
    ],
}
"""Parameters of each program, by the module that reads them, and what is said of them."""


@pytest.fixture(scope='module')
def context() -> Iterator[Context]:
    """Return a ROS context for nodes that only read their parameters."""
    with Domain() as domain, joined(domain.number) as context:
        yield context


@pytest.mark.parametrize(
    ('module', 'given', 'said'),
    [(module, *row) for module, rows in WRONG_VALUES.items() for row in rows],
)
def test_a_wrong_value_is_named_with_what_is_possible(
    module: Any, given: list[str], said: str, context: Context
) -> None:
    arguments = ['--ros-args', *(word for each in given for word in ('-p', each))]
    with pytest.raises(ParameterError, match=said):
        module.read_settings(StrictNode('it', context=context, cli_args=arguments))


PAUSE = '/**:\n  ros__parameters:\n    pause: 2.0\n'


@pytest.mark.parametrize(
    ('content', 'line', 'said'),
    [
        # What ROS would ignore.
        ('rcs_node:\n  ros__parameters:\n    require_inspection: true\n', ':1', 'rcs_node'),
        ('/field:\n  rcs:\n    ros__parameters:\n      pause: 2.0\n', ':2', '/field/rcs'),
        (f'{PAUSE}    pause: 1.0\n', ':4', "'pause' is already in line 3"),
        ('/**:\n  ros__parameters: {pause: 2.0}\n/**:\n  ros__parameters: {}\n', ':3', '/**'),
        *(
            (f'{each}:\n  ros__parameters: {{}}\n', None, '')
            for each in ('/**', '/*', 'rcs', '/rcs')
        ),
        # What ROS would stop at, with words of its own.
        (PAUSE.replace('2.0', '2.0\t# s'), ':3', ''),
        (f'{PAUSE}---\n{PAUSE}', ':4', ''),
        (PAUSE.encode('utf-16'), '', ''),
        ('rcs.yaml\n', ':1', ''),
        ('pause: 2.0\n', ':1', ''),
        (PAUSE.replace('ros__', 'ros_'), ':3', ''),
        ('- pause: 2.0\n', ':1', ''),
        ('/**:\n  ros__parameters: &all\n    pause: *all\n', ':3', ''),
        ('[' * 500, '', ''),
        (None, '', ''),  # there is no such file
        ('\ufeff' + PAUSE.replace('\n', '\r\n'), None, ''),
    ],
)
def test_what_is_wrong_with_a_parameter_file_is_known_with_its_line(
    tmp_path: pathlib.Path, content: str | bytes | None, line: str | None, said: str
) -> None:
    path = tmp_path / 'rcs.yaml'
    if content is not None:
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    arguments = ['--params-file', str(path)]
    stops = [*unreadable(arguments)]
    found = stops or [*ignored(arguments, '/rcs', alone=False)]
    assert [each.startswith(f'{path}{line}: ') and said in each for each in found] == (
        [] if line is None else [True]
    )
    assert bool(stops) == (line is not None and not said)
    assert 'Node' not in ''.join(found)  # PyYAML's own terms
