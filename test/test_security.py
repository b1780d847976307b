# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""SROS2: the policies name what there is, and race control does not run insecure in silence."""

from __future__ import annotations

import contextlib
from fnmatch import fnmatchcase
import functools
import itertools
import pathlib
from typing import Any, NamedTuple
from xml.etree import ElementTree

from evgp_testing.domains import free_port
from evgp_testing.fixtures import JoinOfficial, StartRaceControl
from evgp_testing.official import SERVICES
from evgp_testing.process import executable, Process, Program
from evgp_testing.race_control import settings, Timekeeper, write_roster
from evgp_timing.corrections import CORRECTIONS
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]
POLICY = ROOT / 'security' / 'rcs.policy.xml'

# What every node of rclpy has beside its own.
OF_RCLPY = {'/rosout', '/parameter_events'}

TO_LOOK = {
    f'/rcs/{service}'
    for service in (
        'describe_parameters',
        'get_parameter_types',
        'get_parameters',
        'get_type_description',
        'list_parameters',
    )
}
"""The services of rclpy that an official may ask of race control; none changes anything."""


def allowed(enclave: str, kind: str, what: str) -> set[str]:
    """Return what the policies allow an enclave, such as the services it may request."""
    names: set[str] = set()
    policy = ElementTree.parse(POLICY)  # noqa: S314 - our own file
    for profile in policy.iterfind(f".//enclave[@path='{enclave}']//profile"):
        own = f'{profile.get("ns", "").rstrip("/")}/{profile.get("node")}'
        for rule in profile.iterfind(kind):
            if rule.get(what) == 'ALLOW':
                names |= {(name.text or '').replace('~', own) for name in rule}
    return names


def misfits(rules: set[str], services: set[str]) -> set[str]:
    """Return the services that no rule allows, and the rules, some with a star, that are idle."""
    fits = {(rule, each) for rule in rules for each in services if fnmatchcase(each, rule)}
    return (rules | services) - {*itertools.chain(*fits)}


class InGraph(NamedTuple):
    """What nodes do in the graph, by the names of topics and services."""

    published: set[str]
    subscribed: set[str]
    asked: set[str]
    served: set[str]


def in_graph(node: Any, *named: tuple[str, str]) -> InGraph:
    """Return what nodes with these names and namespaces do; nothing while one is not known."""
    known = {*named} <= {*node.get_node_names_and_namespaces()}
    return InGraph(
        *(
            {name for each in named if known for name, _ in names_and_types(*each)}
            for names_and_types in (
                node.get_publisher_names_and_types_by_node,
                node.get_subscriber_names_and_types_by_node,
                node.get_client_names_and_types_by_node,
                node.get_service_names_and_types_by_node,
            )
        )
    )


OF_RACE_CONTROL = [(name, '/') for name in ('rcs', 'rcs_stops', 'rcs_roster')]


def test_each_program_is_allowed_what_it_does_and_nothing_else(
    start_race_control: StartRaceControl,
    join_official: JoinOfficial,
    parts: contextlib.ExitStack,
    tmp_path: pathlib.Path,
) -> None:
    control = start_race_control(in_race=[1])
    official = join_official(control)
    write_roster(tmp_path, [1])
    parts.enter_context(Timekeeper(tmp_path, control.domain))
    device = {'kind': 'p3', 'device': '127.0.0.1:1'}
    parts.enter_context(Process('evgp_timing', 'timing_source', control.domain, device))
    board = {'port': free_port()}
    parts.enter_context(Process('evgp_board', 'board', control.domain, board))
    watch = [executable('evgp_rcs_console', 'rcs_ctl'), 'watch']
    parts.enter_context(Program('watch', watch, control.domain))

    def faults(enclave: str, nodes: list[tuple[str, str]], hears: set[str]) -> set[str]:
        publishes, heard, asks, serves = in_graph(official.node, *nodes)
        unlike = misfits(allowed(enclave, 'services', 'reply'), serves)
        return (
            (publishes ^ allowed(enclave, 'topics', 'publish')) - OF_RCLPY
            | heard - allowed(enclave, 'topics', 'subscribe')
            | hears - heard
            | asks ^ allowed(enclave, 'services', 'request')
            # What every node of rclpy may serve, a program need not.
            | {each for each in unlike if not each.startswith('/*/')}
        )

    for enclave, nodes, hears, asks in (
        ('/rcs', OF_RACE_CONTROL, {'/rcs/presence'}, {'/rcs/sign_of_life'}),
        ('/timekeeper', [('timekeeper', '/rcs')], {'/rcs/passings'}, {'/rcs/kart/finish'}),
        ('/timing', [('timing_source', '/rcs')], set(), set()),
        ('/watchers', [('rcs_ctl', '/')], {'/rcs/race', '/rcs/events'}, set()),
        ('/watchers', [('board', '/rcs')], {'/rcs/timekeeper/results'}, set()),
    ):
        assert allowed(enclave, 'services', 'request') == asks
        look = functools.partial(faults, enclave, nodes, hears)
        with contextlib.suppress(AssertionError):  # while one does not yet know of the other
            official.wait_until_polled(lambda look=look: not look(), 'no faults')
        assert look() == set()


def test_officials_may_give_every_command_and_publish_nothing_of_race_controls() -> None:
    commands = {f'/rcs/{service}' for service in SERVICES}
    commands |= {f'/rcs/{entry.service}' for entry in CORRECTIONS.values()}

    assert misfits(allowed('/officials', 'services', 'request') - TO_LOOK, commands) == set()
    assert allowed('/officials', 'topics', 'publish') == {*OF_RCLPY, '/rcs/presence'}
    assert not any(name.startswith('/rcs/') for name in allowed('/officials', 'services', 'reply'))


def test_race_control_does_not_start_where_security_is_demanded_and_cannot_be_had(
    domain: int, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A keystore without race control's enclave: with any RMW there is nothing to be secure by."""
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_STRATEGY', 'Enforce')
    monkeypatch.setenv('ROS_SECURITY_KEYSTORE', str(tmp_path))
    given = settings(tmp_path, write_roster(tmp_path, [1]))

    with Process('evgp_rcs', 'rcs_node', domain, given, ('--enclave', '/rcs')) as control:
        assert control.wait() == 2

    assert 'SECURITY ERROR' in control.output
    assert 'listens for' not in control.output
