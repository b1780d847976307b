# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What make and the launch files start: it stays on this machine, and comes back."""

from __future__ import annotations

from collections.abc import Callable
import os
import pathlib
import re
import runpy
import sys
from types import ModuleType, SimpleNamespace
from typing import Any

from evgp_node import restarting
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]
INTERFACE = 'EVGP_GRAPH_INTERFACE'


Describe = Callable[[str], list[Any]]


@pytest.fixture
def describe(monkeypatch: pytest.MonkeyPatch) -> Describe:
    """Return a function that returns what a launch file starts: `launch` is not in the wheels."""

    class Module(ModuleType):
        """Has whatever is imported from it."""

        __path__: tuple[str, ...] = ()

        def __getattr__(self, kind: str) -> Any:
            if kind.startswith('__'):
                raise AttributeError(kind)
            return lambda *positional, **named: SimpleNamespace(
                kind=kind, positional=positional, named=named
            )

    monkeypatch.setattr(os, 'environ', os.environ.copy())
    for name in (
        *('launch', 'launch.actions', 'launch.substitutions', 'launch.launch_description_sources'),
        *('launch.events', 'launch.events.process'),
        *('launch_ros', 'launch_ros.actions', 'launch_ros.parameter_descriptions'),
        'launch_ros.substitutions',
    ):
        monkeypatch.setitem(sys.modules, name, Module(name))

    def description_of(path: str) -> Any:
        made = runpy.run_path(str(ROOT / 'src' / path))['generate_launch_description']()
        return made.positional[0]

    return description_of


def nodes(entities: list[Any]) -> list[Any]:
    """Return the nodes of a launch file, of which there is at least one."""
    found = [each for each in entities if each.kind == 'Node']
    assert found
    return found


@pytest.mark.parametrize(
    ('path', 'argument'),
    [
        ('evgp_rcs/launch/rcs.launch.py', 'officials'),
        ('evgp_rcs_console/launch/console.launch.py', 'officials'),
        ('evgp_kart_bridge/launch/kart_bridge.launch.py', 'graph_interface'),
    ],
)
def test_a_launch_file_stays_on_the_machine_unless_told_otherwise(
    path: str, argument: str, describe: Describe
) -> None:
    entities = describe(path)
    defaults = {
        each.positional[0]: each.named.get('default_value')
        for each in entities
        if each.kind == 'DeclareLaunchArgument'
    }
    for node in nodes(entities):
        used = node.named['additional_env']
        assert {name: each.positional for name, each in used.items()} == {
            INTERFACE: (argument,),
            'ROS_DOMAIN_ID': ('domain_id',),
        }
        for name, unset in ((INTERFACE, ''), ('ROS_DOMAIN_ID', '0')):
            default = defaults[used[name].positional[0]]
            assert default.kind == 'EnvironmentVariable'
            assert (default.positional, default.named['default_value']) == ((name,), unset)


@pytest.mark.parametrize(
    'path', ['evgp_rcs/launch/rcs.launch.py', 'evgp_kart_bridge/launch/kart_bridge.launch.py']
)
def test_a_launch_file_starts_a_node_again_unless_a_setting_is_wrong(
    path: str, describe: Describe
) -> None:
    for node in nodes(describe(path)):
        python, *words = node.named['prefix'].split()
        assert (python, words) == (sys.executable, ['-m', restarting.__name__])
        if node.named['name'] == 'rcs':  # the timekeeper ends with it, and not the other way round
            shutdown = node.named['on_exit'].named['event']
            assert shutdown.kind == 'ShutdownProcess'
            assert shutdown.named['process_matcher'].positional[0].named['name'] == 'timekeeper'
        else:
            assert 'on_exit' not in node.named


def test_foxglove_reaches_topics_only_and_only_from_this_machine(describe: Describe) -> None:
    (node,) = nodes(describe('evgp_rcs/launch/foxglove.launch.py'))
    (given,) = node.named['parameters']
    assert given['address'] == '127.0.0.1'
    assert set(given['capabilities']).isdisjoint(
        {'services', 'clientPublish', 'parameters', 'parametersSubscribe', 'assets'}
    )
    closed = ('service', 'param', 'client_topic')
    (nothing,) = {*(given[f'{kind}_whitelist'][0] for kind in closed)}
    names = ('/rcs/all_kill', '/rcs/green_green', '/x', '')
    assert not any(re.fullmatch(nothing, name) for name in names)
    topics = ['/rcs/race', '/rcs/events', '/rcs/timekeeper/results', '/diagnostics']
    shown = [
        name
        for name in (*topics, '/rosout', '/kart_bridge/stop')
        if any(re.fullmatch(pattern, name) for pattern in given['topic_whitelist'])
    ]
    assert shown == topics


def test_the_launch_file_of_a_kart_starts_its_stack_where_its_bridge_is(
    describe: Describe,
) -> None:
    ours = describe('evgp_kart_bridge/launch/kart.launch.py')
    (stack,), (bridge,) = (
        nodes(ours),
        nodes(describe('evgp_kart_bridge/launch/kart_bridge.launch.py')),
    )
    assert 'IncludeLaunchDescription' in [each.kind for each in ours]
    assert stack.named['namespace'].positional == bridge.named['namespace'].positional
    used = (each.named['additional_env']['ROS_DOMAIN_ID'].positional for each in (stack, bridge))
    assert len(set(used)) == 1
