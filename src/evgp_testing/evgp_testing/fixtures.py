# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Pytest fixtures for the parts of a race.

Each fixture starts parts, and after the test ends them in reverse order, even if the test failed.
A fixture imports what it needs only when it is used, because pytest loads this module in every
run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
import contextlib
import pathlib
from typing import TYPE_CHECKING, TypeAlias

import pytest

if TYPE_CHECKING:
    from evgp_testing.base import SimulatedBase
    from evgp_testing.kart import Bridge, Team
    from evgp_testing.official import Official
    from evgp_testing.race_control import RaceControl
    from evgp_testing.wire_kart import WireKart

StartRaceControl: TypeAlias = 'Callable[..., RaceControl]'
JoinOfficial: TypeAlias = 'Callable[[RaceControl], Official]'
ConnectKart: TypeAlias = 'Callable[..., WireKart]'
StartBridge: TypeAlias = 'Callable[..., Bridge]'
JoinTeam: TypeAlias = 'Callable[[Bridge], Team]'
StartBase: TypeAlias = 'Callable[..., SimulatedBase]'


@pytest.fixture
def parts() -> Iterator[contextlib.ExitStack]:
    """Return the stack of this test's parts. Everything entered here ends with the test."""
    with contextlib.ExitStack() as stack:
        yield stack


@pytest.fixture
def start_race_control(parts: contextlib.ExitStack, tmp_path: pathlib.Path) -> StartRaceControl:
    """Return a function that starts a race control on its own ROS domain."""
    from evgp_testing.domains import Domain
    from evgp_testing.race_control import RaceControl

    def start(
        in_race: Iterable[int] = (1, 2),
        others: Iterable[int] = (),
        heats: Mapping[str, Iterable[int]] | None = None,
        **parameters: object,
    ) -> RaceControl:
        domain = parts.enter_context(Domain())
        folder = tmp_path / f'domain_{domain.number}'
        folder.mkdir()
        return parts.enter_context(
            RaceControl(folder, domain.number, in_race, others, parameters, heats=heats)
        )

    return start


@pytest.fixture
def join_official(parts: contextlib.ExitStack) -> JoinOfficial:
    """Return a function that lets an official join a race control's domain."""
    from evgp_testing.official import Official

    return lambda control: parts.enter_context(Official(control.domain))


@pytest.fixture
def connect_kart(parts: contextlib.ExitStack) -> ConnectKart:
    """Return a function that connects a plain TCP kart, by its number in the roster."""
    from evgp_testing.race_control import address_of
    from evgp_testing.wire_kart import WireKart

    def connect(control: RaceControl, number: int, acknowledges: bool = False) -> WireKart:
        return parts.enter_context(WireKart(address_of(number), control.port, acknowledges))

    return connect


@pytest.fixture
def start_bridge(parts: contextlib.ExitStack) -> StartBridge:
    """
    Return a function that starts a kart's bridge on its own ROS domain.

    Without a port, the bridge finds no race control.
    """
    from evgp_testing.domains import Domain, free_port
    from evgp_testing.kart import Bridge
    from evgp_testing.race_control import address_of

    def start(
        port: int = 0,
        number: int = 1,
        program: str = 'kart_bridge_node',
        arguments: tuple[str, ...] = (),
        **parameters: object,
    ) -> Bridge:
        domain, port = parts.enter_context(Domain()), port or free_port()
        return parts.enter_context(
            Bridge(domain.number, port, address_of(number), parameters, program, arguments)
        )

    return start


@pytest.fixture
def start_base(parts: contextlib.ExitStack) -> StartBase:
    """Return a function that puts a simulated base on the domain of its bridge."""
    from evgp_testing.base import SimulatedBase

    def start(bridge: Bridge, acceleration: float = 3.0, braking: float = 8.0) -> SimulatedBase:
        return parts.enter_context(SimulatedBase(bridge.domain, acceleration, braking))

    return start


@pytest.fixture
def join_team(parts: contextlib.ExitStack) -> JoinTeam:
    """Return a function that lets a team's stack join the domain of its bridge."""
    from evgp_testing.kart import Team

    return lambda bridge: parts.enter_context(Team(bridge.domain))
