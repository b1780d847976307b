# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""In which order heats are driven, and what the heats of a day come to together."""

from __future__ import annotations

from evgp_node.results import Act
from evgp_node.roster import Format, Heat
from evgp_timing.desk import Desk, Roster, What
from evgp_timing.laps import LapSettings
import pytest
from test_desk import Event

HEATS = (
    Heat('Practice', (1, 2, 3), Format.PRACTICE),
    *(Heat(f'TT {kart}', (kart,), Format.TIME_TRIAL, 2, 'Practice') for kart in (5, 4, 1, 2, 3)),
    Heat('Final', (1, 2, 3), Format.RACE, 3, 'time_trial'),
    Heat('TT again', (2, 3), Format.TIME_TRIAL, 2),
)


class Day(Event):
    """An event in which 3 was best in practice, then 1, then 2; 4 and 5 did not drive."""

    def __init__(self) -> None:
        super().__init__()
        self.desk = Desk(
            Roster((1, 2, 3, 4, 5), {f't{kart}': kart for kart in range(1, 6)}, HEATS),
            LapSettings(),
        )
        self.drive('Practice', {1: 11.0, 2: 12.0, 3: 10.0})

    def begin(self, heat: str) -> None:
        """Start a heat with all its karts."""
        self.start(heat, *next(each.karts for each in HEATS if each.name == heat))

    def drive(self, heat: str, laps: dict[int, float]) -> None:
        """Have each kart drive two laps of its own time."""
        self.begin(heat)
        at = sorted((number * lap, kart) for kart, lap in laps.items() for number in range(3))
        begun = self.now + 3.0
        for after, kart in at:
            self.cross(kart, begun + after - self.now)
        self.tell(What.OVER)

    def next(self) -> str:  # noqa: A003 - what officials call it
        return self.desk.standings().next_heat

    def overall(self) -> list[tuple[int, int]]:
        """Return place and kart over all time trials."""
        return [(each.place, each.kart) for each in self.desk.best(Format.TIME_TRIAL)]


@pytest.fixture
def day() -> Day:
    return Day()


def test_a_time_trial_is_driven_in_the_order_of_practice_and_then_by_number(day: Day) -> None:
    assert day.desk.grids()['Final'] == ()  # nobody has driven its time trial
    turns = []
    for _ in range(5):
        turns.append(day.next())
        day.drive(turns[-1], {int(turns[-1][-1]): 10.0 + len(turns)})
    assert turns == ['TT 3', 'TT 1', 'TT 2', 'TT 4', 'TT 5']
    assert day.next() == ''
    assert day.overall() == [*enumerate((3, 1, 2, 4, 5), 1)]
    day.drive('TT again', {2: 10.0, 3: 20.0})
    assert day.overall() == [*enumerate((2, 3, 1, 4, 5), 1)]  # each by the better of its heats


def test_the_heat_in_the_race_is_not_next_and_one_without_a_lap_is_next_again(day: Day) -> None:
    day.begin('TT 3')
    assert day.next() == 'TT 1'
    day.tell(What.OVER)
    day.begin('TT 1')
    assert day.next() == 'TT 3'


def test_the_grid_is_the_order_of_the_results_and_behind_it_who_has_none(day: Day) -> None:
    day.drive('TT 3', {3: 12.0})
    assert day.desk.grids()['Final'] == (3, 1, 2)
    day.drive('TT 2', {2: 11.0})
    assert day.desk.grids()['Final'] == (2, 3, 1)
    day.begin('Final')
    assert day.desk.standings().grid == (2, 3, 1)


@pytest.mark.parametrize('race', [0, 3])
def test_a_penalty_changes_what_the_heats_come_to_at_once(day: Day, race: int) -> None:
    day.drive('TT 3', {3: 12.0})
    day.drive('TT 1', {1: 11.0})
    if race:
        day.begin('Final')
    assert day.overall() == [(1, 1), (2, 3)]
    assert day.correct(Act.PENALISE, 1, race=race, seconds=5, reason='a cone')
    assert day.overall() == [(1, 3), (2, 1)]
    assert day.correct(Act.UNDO_PENALTY, 1, race=race)
    assert day.overall() == [(1, 1), (2, 3)]
