"""
Pytest fixtures for the parts of a race.

Each fixture starts parts and ends them after the test, in reverse order, also when it failed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
import contextlib
import pathlib

from evgp_testing.base import SimulatedBase
from evgp_testing.domains import Domain
from evgp_testing.kart import Bridge, Team
from evgp_testing.official import Official
from evgp_testing.race_control import address_of, RaceControl
from evgp_testing.wire_kart import Acknowledges, WireKart
import pytest

StartRaceControl = Callable[..., RaceControl]
JoinOfficial = Callable[[RaceControl], Official]
ConnectKart = Callable[..., WireKart]
StartBridge = Callable[..., Bridge]
JoinTeam = Callable[[Bridge], Team]
StartBase = Callable[..., SimulatedBase]


@pytest.fixture
def parts() -> Iterator[contextlib.ExitStack]:
    """Return the stack of all parts of this test: what is entered here ends with the test."""
    with contextlib.ExitStack() as stack:
        yield stack


@pytest.fixture
def start_race_control(parts: contextlib.ExitStack, tmp_path: pathlib.Path) -> StartRaceControl:
    """Return a function that starts a race control on a ROS domain of its own."""

    def start(
        in_race: Iterable[int] = (1, 2),
        others: Iterable[int] = (),
        heats: Mapping[str, Iterable[int]] | None = None,
        **parameters: object,
    ) -> RaceControl:
        domain = parts.enter_context(Domain())
        folder = tmp_path / f'domain_{domain.number}'
        folder.mkdir()
        control = RaceControl(folder, domain.number, in_race, others, parameters, heats=heats)
        parts.callback(control.close)
        return control

    return start


@pytest.fixture
def join_official(parts: contextlib.ExitStack) -> JoinOfficial:
    """Return a function that lets an official join a race control's domain."""

    def join(control: RaceControl) -> Official:
        official = Official(control.domain)
        parts.callback(official.close)
        return official

    return join


@pytest.fixture
def connect_kart(parts: contextlib.ExitStack) -> ConnectKart:
    """Return a function that connects a plain TCP kart, by its number in the roster."""

    def connect(
        control: RaceControl, number: int, acknowledges: Acknowledges = Acknowledges.NEVER
    ) -> WireKart:
        return parts.enter_context(WireKart(address_of(number), control.port, acknowledges))

    return connect


@pytest.fixture
def start_bridge(parts: contextlib.ExitStack) -> StartBridge:
    """Return a function that starts a kart's bridge on a ROS domain of its own."""

    def start(
        port: int,
        number: int = 1,
        program: str = 'kart_bridge_node',
        arguments: tuple[str, ...] = (),
        **parameters: object,
    ) -> Bridge:
        domain = parts.enter_context(Domain())
        bridge = Bridge(domain.number, port, address_of(number), parameters, program, arguments)
        parts.callback(bridge.close)
        return bridge

    return start


@pytest.fixture
def start_base(parts: contextlib.ExitStack) -> StartBase:
    """Return a function that puts a simulated base on the domain of its bridge."""

    def start(bridge: Bridge, acceleration: float = 3.0, braking: float = 8.0) -> SimulatedBase:
        base = SimulatedBase(bridge.domain, acceleration, braking)
        parts.callback(base.close)
        return base

    return start


@pytest.fixture
def join_team(parts: contextlib.ExitStack) -> JoinTeam:
    """Return a function that lets a team's stack join the domain of its bridge."""

    def join(bridge: Bridge) -> Team:
        team = Team(bridge.domain)
        parts.callback(team.close)
        return team

    return join
