# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The official of the tests: what teams read where they name a command, and the way of a race."""

from __future__ import annotations

from collections.abc import Iterator
import pathlib

from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.domains import Domain
from evgp_testing.official import Official, SERVICES
from evgp_testing.wire_race import WireRace
import pytest


@pytest.fixture
def alone() -> Iterator[Official]:
    """Return an official without a race control."""
    with Domain() as domain, Official(domain.number) as official:
        yield official


@pytest.mark.parametrize('give', [Official.call, Official.command, Official.wait_for_available])
def test_a_command_that_does_not_exist_is_answered_with_those_that_do(
    alone: Official, give: object
) -> None:
    assert callable(give)
    with pytest.raises(ValueError, match="'finish'") as told:
        give(alone, 'finish', kart=1)
    assert all(service in str(told.value) for service in SERVICES)


def test_a_command_without_what_tells_it_from_another_says_what_it_needs(alone: Official) -> None:
    with pytest.raises(ValueError, match='in_race=True or in_race=False'):
        alone.command('set_in_race', kart=1)


def test_the_way_to_the_grid_closes_an_open_track_first(tmp_path: pathlib.Path) -> None:
    with WireRace(tmp_path, [1]) as race:
        official = race.official
        official.command('set_track_open', open=True, no_race_anywhere=True)
        official.wait_for_race(lambda race: race.track.open, 'the track open')
        race.bring_to(RaceState.GRID_ACTIVE)
        commands = msg.CommandAvailability
        on_grid = official.wait_for_event(
            lambda event: event.command == commands.GRID_ACTIVE, 'GRID_ACTIVE'
        )
    before = [event.command for event in official.events if event.sequence < on_grid.sequence]
    assert commands.CLOSE_TRACK in before
