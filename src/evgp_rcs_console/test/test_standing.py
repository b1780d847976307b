# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Stops that race control has not accepted are pressed again."""

from __future__ import annotations

from evgp_rcs.catalogue import CATALOGUE, CommandKind
from evgp_rcs_console.commands import Given, PRESS_AGAIN, StandingStops
import pytest

STOPS = [kind for kind, entry in CATALOGUE.items() if entry.stop]


def kart_of(command: CommandKind) -> int:
    """Return kart 7 for a command to one kart, 0 for any other."""
    return 7 if CATALOGUE[command].to_one_kart else 0


@pytest.mark.parametrize('command', STOPS)
def test_every_stop_is_pressed_again_until_it_is_accepted(command: CommandKind) -> None:
    stops = StandingStops()
    given = Given(command, kart_of(command), at=0.0)
    stops.add(given, 0.0)

    pressed = [stops.press(PRESS_AGAIN * n) for n in range(4)]

    assert pressed == [[given]] * 4
    (stop,) = stops.pressed
    assert (stop.presses, stop.since) == (4, 0.0)
    assert stops.accepted(given)
    assert stops.press(99.0) == []
    assert stops.next_press(99.0) is None


def test_a_stop_is_not_pressed_before_its_time() -> None:
    stops = StandingStops()
    stops.add(Given(CommandKind.RED_FLAG, at=0.0), 0.0)
    stops.press(0.0)

    assert stops.press(PRESS_AGAIN - 0.01) == []
    assert stops.next_press(0.1) == pytest.approx(PRESS_AGAIN - 0.1)


def test_stops_of_several_karts_stand_beside_each_other() -> None:
    stops = StandingStops()
    pressed_stops = [Given(CommandKind.KART_RED_RED, kart, at=0.0) for kart in (1, 2)]
    for given in pressed_stops:
        stops.add(given, 0.0)

    assert stops.press(0.0) == pressed_stops
    stops.accepted(pressed_stops[0])
    assert stops.press(PRESS_AGAIN) == [pressed_stops[1]]


def test_an_official_who_presses_again_waits_for_the_answer_to_that() -> None:
    stops = StandingStops()
    first, second = Given(CommandKind.ALL_KILL, at=0.0), Given(CommandKind.ALL_KILL, at=5.0)
    stops.add(first, 0.0)
    stops.press(0.0)
    stops.add(second, 5.0)

    assert stops.press(5.0) == [second]
    assert not stops.accepted(first)
    (stop,) = stops.pressed
    assert (stop.presses, stop.since) == (2, 0.0)
    assert stops.accepted(second)


def test_a_stop_that_is_refused_for_good_is_given_up() -> None:
    stops = StandingStops()
    given = Given(CommandKind.KART_RED_RED, 99, at=0.0)
    stops.add(given, 0.0)

    stops.refused(given, 'there is no kart 99 in the roster', final=True)

    assert stops.pressed == ()


def test_a_stop_that_failed_is_pressed_on_and_says_why() -> None:
    stops = StandingStops()
    given = Given(CommandKind.RED_FLAG, at=0.0)
    stops.add(given, 0.0)

    stops.refused(given, 'race control ends', final=False)

    (stop,) = stops.pressed
    assert stop.said == 'race control ends'
    assert stops.press(PRESS_AGAIN) == [given]


@pytest.mark.parametrize(
    'later', [CommandKind.GRID_ACTIVE, CommandKind.GREEN_GREEN, CommandKind.IN_GARAGE]
)
def test_what_an_official_loosens_later_ends_the_stops_given_before(later: CommandKind) -> None:
    stops = StandingStops()
    for command in STOPS:
        stops.add(Given(command, kart_of(command), at=0.0), 0.0)

    stops.accepted(Given(later, at=1.0))

    stand = [stop.given.command for stop in stops.pressed]
    assert stand == [CommandKind.ALL_KILL, CommandKind.RECORD_MSR]


def test_the_release_of_a_kart_ends_the_stops_of_that_kart_only() -> None:
    stops = StandingStops()
    for kart in (1, 2):
        stops.add(Given(CommandKind.KART_RED_RED, kart, at=0.0), 0.0)
        stops.add(Given(CommandKind.KART_RED_FLAG, kart, at=0.0), 0.0)

    stops.accepted(Given(CommandKind.KART_IN_GARAGE, 1, at=1.0))

    assert [stop.given.kart for stop in stops.pressed] == [2, 2]


def test_a_stop_given_after_what_loosens_stands() -> None:
    stops = StandingStops()
    loosens = Given(CommandKind.KART_IN_GARAGE, 1, at=0.0)
    stop = Given(CommandKind.KART_RED_RED, 1, at=1.0)
    stops.add(stop, 1.0)

    stops.accepted(loosens)

    assert stops.stands(stop)
