# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""SROS2: the policies name what there is, and race control does not run insecure in silence."""

from __future__ import annotations

import contextlib
from fnmatch import fnmatchcase
import pathlib
from typing import Any, NamedTuple
from xml.etree import ElementTree

from evgp_testing.fixtures import JoinOfficial, StartRaceControl
from evgp_testing.official import SERVICES
from evgp_testing.process import executable, Process, Program
from evgp_testing.race_control import settings, Timekeeper, write_roster
from evgp_testing.ros_side import RosSide
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


def check_fits(rules: set[str], services: set[str]) -> None:
    """Check that the rules, some with a star, allow all of these services, and none is idle."""
    fitting = {each: {rule for rule in rules if fnmatchcase(each, rule)} for each in services}
    assert all(fitting.values()), fitting
    assert set().union(*fitting.values()) == rules


class InGraph(NamedTuple):
    """What nodes do in the graph, by the names of topics and services."""

    served: set[str]
    published: set[str]
    subscribed: set[str]
    asked: set[str]

    def does_no_more_than(self, enclave: str) -> None:
        """Check that the policies allow an enclave just this, but what a node need not hear."""
        assert self.published == allowed(enclave, 'topics', 'publish')
        assert self.subscribed <= allowed(enclave, 'topics', 'subscribe')
        assert self.asked == allowed(enclave, 'services', 'request')


def in_graph(node: Any, *named: tuple[str, str]) -> InGraph:
    """Return what nodes with these names and namespaces do; nothing while one is not known."""
    known = {*named} <= {*node.get_node_names_and_namespaces()}
    return InGraph(
        *(
            {name for each in named if known for name, _ in names_and_types(*each)}
            for names_and_types in (
                node.get_service_names_and_types_by_node,
                node.get_publisher_names_and_types_by_node,
                node.get_subscriber_names_and_types_by_node,
                node.get_client_names_and_types_by_node,
            )
        )
    )


def test_race_control_is_allowed_what_it_does_and_nothing_else(
    start_race_control: StartRaceControl, join_official: JoinOfficial
) -> None:
    official = join_official(start_race_control())
    own = [(name, '/') for name in ('rcs', 'rcs_stops', 'rcs_roster')]
    official.wait_until_polled(
        lambda: '/rcs/race' in in_graph(official.node, *own).published, 'the nodes in the graph'
    )
    seen = in_graph(official.node, *own)

    check_fits(allowed('/rcs', 'services', 'reply'), seen.served)
    seen.does_no_more_than('/rcs')
    assert seen.asked == {'/rcs/sign_of_life'}


def test_officials_may_give_every_command_and_publish_nothing_of_race_controls() -> None:
    commands = {f'/rcs/{service}' for service in SERVICES}
    commands |= {f'/rcs/{entry.service}' for entry in CORRECTIONS.values()}

    check_fits(allowed('/officials', 'services', 'request') - TO_LOOK, commands)
    assert allowed('/officials', 'topics', 'publish') == {*OF_RCLPY, '/rcs/presence'}
    assert not any(name.startswith('/rcs/') for name in allowed('/officials', 'services', 'reply'))


def test_watching_takes_no_more_than_watchers_are_allowed_who_may_command_nothing(
    start_race_control: StartRaceControl, join_official: JoinOfficial, parts: contextlib.ExitStack
) -> None:
    control = start_race_control(in_race=(1,))
    official = join_official(control)
    node, named = official.node, ('rcs_ctl', '/')
    command = [executable('evgp_rcs_console', 'rcs_ctl'), 'watch']
    parts.enter_context(Program('watch', command, control.domain))
    hears = {'/rcs/race', '/rcs/events'}
    official.wait_until_polled(lambda: hears <= in_graph(node, named).subscribed, 'the watcher')
    seen = in_graph(node, named)
    assert seen.asked == allowed('/watchers', 'services', 'request') == set()
    assert seen.published <= allowed('/watchers', 'topics', 'publish') == OF_RCLPY
    assert seen.subscribed <= allowed('/watchers', 'topics', 'subscribe')


def test_a_timing_source_does_no_more_than_it_is_allowed(
    domain: int, parts: contextlib.ExitStack
) -> None:
    looking = parts.enter_context(RosSide('looking', domain))
    node, named = looking.node, ('timing_source', '/rcs')
    given = {'kind': 'p3', 'device': '127.0.0.1:1'}
    parts.enter_context(Process('evgp_timing', 'timing_source', domain, given))
    topics = {'/rcs/passings', '/diagnostics', '/rosout', '/parameter_events'}
    looking.wait_until_polled(lambda: in_graph(node, named).published >= topics, 'the source')
    seen = in_graph(node, named)
    seen.does_no_more_than('/timing')
    assert (seen.published, seen.asked) == (topics, set())


def test_the_timekeeper_does_no_more_than_it_is_allowed_and_gives_finish_alone(
    domain: int, parts: contextlib.ExitStack, tmp_path: pathlib.Path
) -> None:
    looking = parts.enter_context(RosSide('looking', domain))
    node, named = looking.node, ('timekeeper', '/rcs')
    write_roster(tmp_path, [1])
    parts.enter_context(Timekeeper(tmp_path, domain))
    wanted = {f'/rcs/{entry.service}' for entry in CORRECTIONS.values()}
    hears = {'/rcs/events', '/rcs/passings'}
    looking.wait_until_polled(
        lambda: (
            wanted <= in_graph(node, named).served and hears <= in_graph(node, named).subscribed
        ),
        'the timekeeper in the graph',
    )
    seen = in_graph(node, named)
    check_fits(allowed('/timekeeper', 'services', 'reply'), seen.served)
    seen.does_no_more_than('/timekeeper')
    assert seen.asked == {'/rcs/kart/finish'}


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
