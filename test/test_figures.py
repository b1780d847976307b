# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Numbers that people read, held against the one place in the code that each of them has.

The home of a race's times is ``race.RaceTimes``, of the kart server's ``ServerSettings``, of the
bridge's ``arbiter.Settings``, of the port ``frames.DEFAULT_PORT``. Parameters, configuration files
and documents have copies of them.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
import pathlib
import re
from typing import Any

from evgp_inspection.survey import LOST
from evgp_inspection.traces import BEAT
from evgp_kart_bridge.node import read_settings as read_bridge_settings
from evgp_protocol.frames import MAX_FRAME_BYTES
from evgp_protocol.hearing import DEAF, FLOOD, FLOOD_BYTES, QUIET
from evgp_rcs.ros.settings import read_settings as read_race_control_settings
from evgp_rcs.rules.race import RaceTimes
from evgp_rcs_console.button import read_settings as read_button_settings
from evgp_timing.node import read_settings as read_timing_settings
from evgp_timing.timekeeper import read_settings as read_timekeeper_settings
import pytest
import yaml

ROOT = pathlib.Path(__file__).parents[1]
RACE_CONTROL = 'src/evgp_rcs/config/rcs.yaml'
BRIDGE = 'src/evgp_kart_bridge/config/kart_bridge.yaml'
TIMING = 'src/evgp_timing/config/timing_source.yaml'
TIMEKEEPER = 'src/evgp_timing/config/timekeeper.yaml'
ROSTER = ROOT / 'src/evgp_rcs/config/karts.yaml'

Limits = tuple[float, float] | None


class Declared:
    """What a node declares, in the place of its parameters: name, default, limits."""

    def __init__(self, given: dict[str, Any]) -> None:
        self.defaults: dict[str, Any] = {}
        self.limits: dict[str, Limits] = {}
        self._given = given

    def declare(self, name: str, default: Any, meaning: str, limits: Limits = None) -> Any:
        self.defaults[name] = default
        self.limits[name] = limits
        return self._given.get(name, default)

    def refuse_unknown(self, own_file: bool = False) -> None:
        pass


def declared(read: Callable[[Any], object], **given: Any) -> Declared:
    """Return what is declared where these parameters are given."""
    parameters = Declared(given)
    read(parameters)
    return parameters


race_control = declared(read_race_control_settings, roster=str(ROSTER))
race_control.declare('accept_open_graph', False, 'by the node itself')
race_control.declare('banner', '', 'by the node itself')
race_control.declare('officials', [''], 'by the node itself')
bridge = declared(read_bridge_settings, host='10.0.0.1')
timing = declared(read_timing_settings, kind='p3', device='10.1.0.20:5403')
timekeeper = declared(read_timekeeper_settings, roster=str(ROSTER))
button = declared(read_button_settings, device='/dev/input/by-id/one')
CONFIGURED = pytest.mark.parametrize(
    ('node', 'config'),
    [(race_control, RACE_CONTROL), (bridge, BRIDGE), (timing, TIMING), (timekeeper, TIMEKEEPER)],
    ids=['race control', 'bridge', 'timing source', 'timekeeper'],
)


def text_of(path: str) -> str:
    return (ROOT / path).read_text(encoding='utf-8')


@CONFIGURED
def test_a_configuration_file_has_every_parameter_with_its_default_and_range(
    node: Declared, config: str
) -> None:
    text = text_of(config)
    (parameters,) = yaml.safe_load(text).values()
    written = parameters['ros__parameters']
    left_out = re.findall(r'^ +# (\w+): \S', text, re.MULTILINE)
    assert {*written, *left_out} == set(node.defaults)
    assert written == {name: node.defaults[name] for name in written}
    assert [type(value) for value in written.values()] == [
        type(node.defaults[name]) for name in written
    ]
    bracketed = re.findall(r'^ +(\w+): .*# .*\[([\d.]+)-([\d.]+)\]$', text, re.MULTILINE)
    ranges = {name: (float(least), float(greatest)) for name, least, greatest in bracketed}
    assert ranges == {name: limits for name, limits in node.limits.items() if limits is not None}


def test_the_document_has_every_parameter_of_the_stop_button_with_its_default_and_range() -> None:
    """The button has no configuration file: whoever starts it names its device."""
    _, _, rest = text_of('docs/ros-interface.md').partition('\n## rcs_button\n')
    own, _, _ = rest.partition('\n## ')
    rows = re.findall(r'^\| `(\w+)` \| ([^|]*) \| ([^|]*) \| [^|]+ \|$', own, re.MULTILINE)
    defaults = {
        name: '' if cell in ('empty', 'none, required') else yaml.safe_load(cell)
        for name, cell, _ in rows
    }
    assert defaults == button.defaults
    ranges = {
        name: tuple(map(float, cell.split('-')))
        for name, _, cell in rows
        if re.fullmatch(r'[\d.]+-[\d.]+', cell)
    }
    assert ranges == {name: limits for name, limits in button.limits.items() if limits is not None}


@pytest.mark.parametrize(
    'path', ['README.md', *(str(each.relative_to(ROOT)) for each in ROOT.glob('docs/**/*.md'))]
)
def test_a_number_beside_the_name_of_a_parameter_is_its_default(path: str) -> None:
    beside = (
        r'`(\w+)`\)? \(?(\d[\d.]*) s\b'
        r'|\b(\d[\d.]*) s(?: after a stop)? \((?:parameter )?`(\w+)`\)'
    )
    for name, after, before, named in re.findall(beside, text_of(path)):
        default = (race_control.defaults | bridge.defaults).get(name or named)
        assert default is None or float(after or before) == default, (path, name or named)


RATE = race_control.defaults['beat_rate']
SILENCE_OF_RACE_CONTROL = bridge.defaults['frame_timeout']
PORT = race_control.defaults['port']

WRITTEN = [
    ('docs/rules.md', r'`finish_delays` \(([\d.]+),', RaceTimes().finish_delays[0]),
    ('docs/teams.md', r'\[1 to (\d+) s later\]', RaceTimes().finish_delays[0]),
    ('docs/teams.md', r'the kart stops after ([\d.]+) s', SILENCE_OF_RACE_CONTROL),
    ('docs/wire.md', r'\*\*port (\d+)\*\*', PORT),
    ('docs/wire.md', r"RACE_CONTROL = \('[\d.]+', (\d+)\)", PORT),
    ('docs/wire.md', r'\*\*(\d+) times a second\*\*', RATE),
    ('docs/wire.md', r'never below (\d+)', race_control.limits['beat_rate'][0]),
    ('docs/wire.md', r'within (\d+) bytes', MAX_FRAME_BYTES),
    ('docs/wire.md', r'nothing for \*\*(\d+) s\*\*', SILENCE_OF_RACE_CONTROL),
    ('docs/wire.md', r'heard_at >= ([\d.]+):', SILENCE_OF_RACE_CONTROL),
    ('docs/wire.md', r'\((\d+) missed frames\)', RATE * SILENCE_OF_RACE_CONTROL),
    ('docs/wire.md', r'silent for (\d+) s after its TCP', QUIET),
    ('docs/wire.md', r'reads about (\d+) bytes per beat', FLOOD_BYTES),
    ('docs/wire.md', r'during the flood and for (\d+) s after', DEAF),
    ('docs/wire.md', r'drops it after (\d+) s', FLOOD),
]


@pytest.mark.parametrize(('path', 'pattern', 'figure'), WRITTEN)
def test_what_teams_build_karts_by_says_what_the_code_does(
    path: str, pattern: str, figure: float
) -> None:
    found = re.findall(pattern, text_of(path))
    assert found, f'{path} no longer says {pattern}: take it out here, or mend it'
    assert {float(each) for each in found} == {figure}


def test_the_survey_plays_race_control_as_it_is() -> None:
    assert pytest.approx(1 / RATE) == BEAT
    assert race_control.defaults['send_timeout'] == LOST


# ----- one name, one meaning ---------------------------------------------------------------

NAMESPACES = ('texts.py', 'style.py')
"""Modules whose names are always read with the module's before them: texts, colours."""


def constants() -> dict[str, dict[str, Any]]:
    """Return the plain constants of the product: by name, in which module, which value."""
    found: dict[str, dict[str, Any]] = {}
    paths = [*ROOT.glob('src/evgp_*/evgp_*/*.py'), *ROOT.glob('src/evgp_*/evgp_*/*/*.py')]
    for path in sorted(paths):
        if path.name in NAMESPACES or path.parent.name == 'evgp_testing':
            continue
        for node in ast.parse(path.read_text(encoding='utf-8')).body:
            if not isinstance(node, ast.Assign) or not isinstance(node.targets[0], ast.Name):
                continue
            name = node.targets[0].id
            if re.fullmatch(r'[A-Z][A-Z0-9_]+', name):  # one letter is a type variable
                found.setdefault(name, {})[f'{path.parent.name}.{path.stem}'] = ast.unparse(
                    node.value
                )
    return found


def test_no_two_constants_of_one_name_have_different_values() -> None:
    different = {
        name: values for name, values in constants().items() if len(set(values.values())) > 1
    }
    assert different == {}
