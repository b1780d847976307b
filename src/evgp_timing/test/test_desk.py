# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What the timekeeper knows of races that race control told it, and of passings on paper."""

from __future__ import annotations

import itertools

from evgp_node.results import Act, BY_HAND, Corrected, Correction, Identity, Mark, Passing, Status
from evgp_node.roster import Format, Heat
from evgp_timing.desk import (
    Answer,
    Desk,
    Heard,
    Input,
    MOST_GIVEN,
    Passed,
    Roster,
    Terms,
    Told,
    What,
)
from evgp_timing.laps import LapSettings
from evgp_timing.passings import MAX_RATE
from hypothesis import given
from hypothesis import strategies as st
import pytest

ROSTER = Roster(
    (1, 2, 3, 4, 5),
    {f't{kart}': kart for kart in range(1, 6)},
    (
        Heat('Heat 1', (1, 2), Format.RACE, 2),
        Heat('Heat 2', (3, 4), Format.RACE, 2, auto_finish=True),
        Heat('Final', (1, 2, 3), grid_from='time_trial'),
        Heat('Practice', (1, 2, 3), Format.PRACTICE),
        *(
            Heat(f'TT {kart}', (kart,), Format.TIME_TRIAL, 2, 'Practice')
            for kart in (5, 4, 1, 2, 3)
        ),
        Heat('TT again', (2, 3), Format.TIME_TRIAL, 2),
    ),
)


class Event:
    """
    An event on paper: race control's word, a timing line, officials.

    :ivar fed: all that the desk was fed.
    :ivar seen: the passings of each race, by its number.
    """

    def __init__(self, first_crossing: str = 'starts') -> None:
        self.settings = LapSettings(first_crossing=first_crossing)
        self.desk = Desk(ROSTER, self.settings)
        self.fed: list[Input] = []
        self.seen: dict[int, list[Passing]] = {}
        self.now = 1000.0
        self.run = 'run 1'
        self.race = 0
        self.heat = ''
        self._numbers = itertools.count(1)

    def feed(self, given: Input) -> Answer | None:
        self.fed.append(given)
        return self.desk.feed(given)

    def fed_again(self, first: int = 0) -> Desk:
        """Return a desk that was fed the same, from the first input that is given."""
        again = Desk(ROSTER, self.settings)
        for each in self.fed[first:]:
            again.feed(each)
        return again

    def tell(self, what: What, kart: int = 0) -> None:
        self.feed(Told(self.now, what, self.run, self.race, self.heat, kart))

    def form(self, heat: str) -> None:
        """Have the grid of a race form."""
        self.race += 1
        self.heat = heat
        self.tell(What.GRID_ACTIVE)

    def start(self, heat: str, *karts: int) -> None:
        self.form(heat)
        self.now += 10.0
        self.tell(What.GREEN_GREEN)
        for kart in karts:
            self.tell(What.SENT_GREEN, kart)

    def cross(
        self, kart: int, after: float = 10.0, ago: float = 0.0, source: str = 'line'
    ) -> Passing:
        """Have the line see a kart, or a beam see somebody (0), and say it so long after that."""
        self.now += after
        stamp = round((self.now - ago) * 1e9)
        passing = Passing(source, 'today', next(self._numbers), 0, f't{kart}' * bool(kart), stamp)
        self.seen.setdefault(self.race, []).append(passing)
        self.feed(Passed(self.now, (passing,)))
        return passing

    def lap(self, laps: int, *karts: int) -> None:
        """Have karts drive so many laps, one behind the other."""
        for kart in karts * (laps + 1):
            self.cross(kart)

    def drive(self, heat: str, laps: dict[int, float]) -> None:
        """Have each kart drive two laps of its own time, and end the race."""
        self.start(heat, *laps)
        at = sorted((number * lap, kart) for kart, lap in laps.items() for number in range(3))
        begun = self.now + 3.0
        for after, kart in at:
            self.cross(kart, begun + after - self.now)
        self.tell(What.OVER)

    def correct(self, act: Act, kart: int = 0, **terms: object) -> bool:
        asked = Correction(act, 'Tina', kart)._replace(**terms)  # type: ignore[arg-type]
        answer = self.feed(self.desk.about(Corrected(self.now, asked)))
        assert answer is not None
        assert answer.text
        return answer.success

    def places(self) -> list[tuple[int, int, Status]]:
        return [(each.kart, each.place, each.status) for each in self.desk.standings().karts]


@pytest.fixture
def event() -> Event:
    """Return an event before its first race."""
    return Event()


@pytest.mark.parametrize(
    ('crossings', 'counting'),
    [
        pytest.param([(0.2, 1.2, 'line'), (10.0, 0.0, 'line')], [1], id='at once'),
        pytest.param([(30.0, 31.0, 'line'), (10.0, 0.0, 'line')], [1], id='long after'),
        pytest.param([(5.0, 15.0, 'line'), (0.2, 15.0, 'line')], [], id='two arrive together'),
        pytest.param([(5.0, 15.0, 'line'), (2.0, 16.9, 'line')], [], id='one waited longer'),
        pytest.param([(5.0, 0.0, 'beam'), (10.0, 25.0, 'line')], [0], id='another source first'),
        pytest.param([(20.0, 3600.0, 'line')] * 4, [1, 2, 3], id='its clock was set back'),
    ],
)
def test_a_first_crossing_that_is_of_before_green_by_its_sources_clock_never_counts(
    event: Event, crossings: list[tuple[float, float, str]], counting: list[int]
) -> None:
    event.start('', 1)
    event.cross(1)
    event.tell(What.OVER)
    event.now += 60.0
    event.start('', 1)
    for after, ago, source in crossings:
        event.cross(1, after, ago, source)
    marks = [each.mark for each in event.desk.standings().passings]
    assert [number for number, mark in enumerate(marks) if mark is Mark.COUNTED] == counting
    assert 'the clock of line jumped, or its passings arrived late' in event.desk.questions()[0]


@pytest.mark.parametrize(
    'asked',
    [
        Correction(Act.COUNT, kart=3),
        Correction(Act.STRIKE, passing=Identity('line', 'today', 99), reason='twice'),
        Correction(Act.PENALISE, kart=1, reason='nothing'),
        Correction(Act.PENALISE, kart=1, seconds=5),
        Correction(Act.UNDO_PENALTY, kart=1),
        Correction(Act.GIVE, kart=9, transponder='t9'),
        Correction(Act.GIVE, kart=1),
        Correction(Act.CHOOSE, race=7),
    ],
    ids=lambda asked: f'{asked.act.name} {asked.kart}',
)
def test_what_means_nothing_is_refused_and_changes_nothing(
    event: Event, asked: Correction
) -> None:
    assert not event.correct(Act.COUNT, 1)
    event.form('Heat 1')
    assert not event.correct(Act.COUNT, 1)
    event.start('Heat 1', 1, 2)
    event.lap(1, 1)
    before = event.desk.standings()
    answer = event.feed(Corrected(event.now, asked))
    assert answer is not None
    assert not answer.success
    assert event.desk.standings() == before


@pytest.mark.parametrize(
    ('why', 'order', 'is_asked'),
    [
        ('with laps', (2, 1), True),
        ('without', (2, 1), True),
        ('practice', (1, 2), False),
        ('penalty', (1, 2), False),
        ('lapped', (2, 1), False),
    ],
)
def test_an_order_of_finish_that_is_not_that_of_the_results_is_a_question_if_it_has_to_be(
    event: Event, why: str, order: tuple[int, int], is_asked: bool
) -> None:
    event.start({'without': '', 'practice': 'Practice'}.get(why, 'Heat 1'), 1, 2)
    crossings = [(1, 10.0), (2, 10.0), (1, 20.0), (2, 5.0), (1, 21.0), (2, 10.0)]
    for kart, after in crossings if why != 'lapped' else crossings[:3] + crossings[4:5]:
        event.cross(kart, after)
    assert event.desk.questions() == []
    for kart in order:
        event.tell(What.FINISH, kart)
        event.now += 1.0
    if why == 'penalty':
        assert event.correct(Act.PENALISE, 1, seconds=30, reason='a cone')
    assert any('order of FINISH' in each for each in event.desk.questions()) is is_asked
    event.tell(What.UNDO_FINISH, 2)
    assert not any('order of FINISH' in each for each in event.desk.questions())


def test_what_was_missed_is_asked_of_the_run_that_it_was_missed_in(event: Event) -> None:
    event.start('Heat 1', 1, 2)
    event.feed(Heard(event.now, 'another run', 9, 5))
    assert event.desk.questions() == []
    event.feed(Heard(event.now, event.run, 9, 5))
    (asked,) = event.desk.questions()
    assert asked.startswith('5 events from race control were lost')


KARTS = st.sampled_from((1, 2, 3))
WORDS = st.sampled_from([*What, *Act, 'roster', 'again'])
SEEN = st.sampled_from(['line', 'beam'])
# Steps of time that bring a passing near to a limit, and such that do not.
STEPS = st.one_of(st.sampled_from((0.0, 0.4, 2.0, 4.9, 5.0, 5.1)), st.floats(0.0, 40.0))
# How long a crossing is over by its source's clock, in s: not, a delay, a clock that jumps.
AGO = st.one_of(st.sampled_from((0.0, 0.3, 8.0, 600.0, -600.0, 1e9)), st.floats(0.0, 0.45))
ROSTERS = (ROSTER, ROSTER._replace(heats=()), Roster((1, 2), {'t1': 2}, ROSTER.heats[::2]))
HAPPENED = st.tuples(st.one_of(WORDS, SEEN, SEEN), KARTS, STEPS, AGO)


@st.composite
def events(draw: st.DrawFn) -> Event:
    """Return an event with races in which anything happened, in any order."""
    event = Event(draw(st.sampled_from(('starts', 'ends'))))
    event.start(ROSTER.heats[draw(KARTS) - 1].name, 1, 2)
    for what, kart, after, ago in draw(st.lists(HAPPENED, min_size=10, max_size=40)):
        event.now += after
        if what is What.GRID_ACTIVE:
            event.form(ROSTER.heats[kart - 1].name)
        elif what is What.GREEN_GREEN:
            event.start(ROSTER.heats[kart - 1].name, 1, 2)
        elif isinstance(what, What):
            event.tell(what, kart)
        elif isinstance(what, Act):
            passing = Identity('line', 'today', kart)
            event.correct(
                what, kart, passing=passing, transponder='t9', seconds=5, reason='because'
            )
        elif what == 'roster':
            event.feed(Terms(event.now, ROSTERS[kart - 1], event.settings))
        elif what == 'again':  # its source says it a second time
            event.feed(Passed(event.now, tuple(event.seen.get(event.race, ())[-1:])))
        else:
            event.cross(kart if what == 'line' else 0, 0.0, ago, what)
    return event


@given(events())
def test_a_desk_that_is_fed_again_knows_the_same_and_no_order_of_things_breaks_it(
    event: Event,
) -> None:
    again = event.fed_again()
    assert again.standings() == event.desk.standings()
    assert again.grids() == event.desk.grids()
    assert again.questions() == event.desk.questions()
    found = event.desk.standings()
    assert found.from_green is (event.settings.first_crossing == 'ends')
    by_hand = [each.passing for each in found.passings if each.passing.source == BY_HAND]
    assert len({each.identity for each in by_hand}) == len(by_hand)
    assert len({each.kart for each in found.karts}) == len(found.karts)


def test_what_officials_give_beyond_a_limit_is_refused_and_withdraws_no_results(
    event: Event,
) -> None:
    event.start('Heat 1', 1, 2)
    event.lap(2, 2)
    event.tell(What.OVER)
    assert all(event.correct(Act.COUNT, 1) for _ in range(MAX_RATE))
    assert event.correct(Act.PUBLISH)
    assert not event.correct(Act.COUNT, 1)
    assert event.desk.standings().published
    assert all(event.correct(Act.GIVE, 2, transponder=f'x{n}') for n in range(MOST_GIVEN))
    assert event.correct(Act.GIVE, 1, transponder='x0')
    assert not event.correct(Act.GIVE, 1, transponder='one more')


def test_results_that_change_after_they_were_published_are_no_longer_official(
    event: Event,
) -> None:
    event.start('Heat 1', 1, 2)
    event.lap(1, 1)
    event.tell(What.OVER)
    assert event.correct(Act.PUBLISH)
    assert event.desk.standings().published
    assert event.correct(Act.GIVE, 2, transponder='t9')
    assert event.desk.standings().published  # nobody carried it
    assert event.correct(Act.GIVE, 2, transponder='t1')
    assert not event.desk.standings().published
    assert event.correct(Act.PUBLISH)
    event.tell(What.FINISH, 2)  # an official who was late
    assert not event.desk.standings().published


def test_a_correction_stays_with_its_race_when_earlier_races_are_of_another_event(
    event: Event,
) -> None:
    event.start('Heat 1', 1, 2)
    first = len(event.fed)
    event.start('Heat 1', 1, 2)
    assert event.correct(Act.PENALISE, 1, race=1, seconds=5, reason='cut the chicane')
    event.start('Heat 1', 1, 2)
    again = event.fed_again(first)  # the first race has become too old
    assert [each.laps.penalties for each in again.races] == [(), ()]


def test_a_race_keeps_the_roster_and_settings_with_which_it_was_started(event: Event) -> None:
    event.start('Heat 1', 1, 2)
    event.lap(2, 1)
    before = event.places()
    heats = (Heat('Heat 1', (1, 2), Format.PRACTICE, 1),)
    terms = Terms(event.now, Roster((1, 2), {'t1': 2, 't2': 1}, heats), LapSettings(60.0))
    event.feed(terms)
    event.tell(What.FINISH, 1)
    assert event.places() == before
    event.start('Heat 1', 1, 2)
    event.cross(1)
    event.cross(1, after=50.0)
    seen = event.desk.standings()
    assert (seen.format, seen.laps) == (Format.PRACTICE, 1)
    assert [each.kart for each in seen.passings] == [2, 2]
    assert [each.mark for each in seen.passings] == [Mark.COUNTED, Mark.DOUBTFUL]


# ----- heats --------------------------------------------------------------------------------


@pytest.fixture
def day(event: Event) -> Event:
    """Return an event in which 3 was best in practice, then 1, then 2; 4 and 5 did not drive."""
    event.drive('Practice', {1: 11.0, 2: 12.0, 3: 10.0})
    return event


def next_heat(event: Event) -> str:
    return event.desk.standings().next_heat


def overall(event: Event) -> list[tuple[int, int]]:
    """Return place and kart over all time trials."""
    return [(each.place, each.kart) for each in event.desk.best(Format.TIME_TRIAL)]


def test_a_time_trial_is_driven_in_the_order_of_practice_and_then_by_number(day: Event) -> None:
    assert day.desk.grids()['Final'] == ()  # nobody has driven its time trial
    turns = []
    for _ in range(5):
        turns.append(next_heat(day))
        day.drive(turns[-1], {int(turns[-1][-1]): 10.0 + len(turns)})
    assert turns == ['TT 3', 'TT 1', 'TT 2', 'TT 4', 'TT 5']
    assert next_heat(day) == ''
    assert overall(day) == [*enumerate((3, 1, 2, 4, 5), 1)]
    day.drive('TT again', {2: 10.0, 3: 20.0})
    assert overall(day) == [*enumerate((2, 3, 1, 4, 5), 1)]  # each by the better of its heats


def test_the_heat_in_the_race_is_not_next_and_one_without_a_lap_is_next_again(day: Event) -> None:
    day.start('TT 3', 3)
    assert next_heat(day) == 'TT 1'
    day.tell(What.OVER)
    day.start('TT 1', 1)
    assert next_heat(day) == 'TT 3'


def test_the_grid_is_the_order_of_the_results_that_count_and_behind_it_who_has_none(
    day: Event,
) -> None:
    for heat, laps, order in (
        ('TT 3', {3: 12.0}, (3, 1, 2)),
        ('TT 2', {2: 11.0}, (2, 3, 1)),
        ('TT 2', {}, (2, 3, 1)),  # by mistake; no lap: it is no result
        ('TT 2', {2: 13.0}, (3, 2, 1)),
    ):
        day.drive(heat, laps)
        assert day.desk.grids()['Final'] == order
    assert day.correct(Act.CHOOSE, race=3)
    assert not day.correct(Act.CHOOSE, race=4)
    assert day.desk.grids()['Final'] == (2, 3, 1)
    day.start('Final', 1, 2, 3)
    assert day.desk.standings().grid == (2, 3, 1)


@pytest.mark.parametrize('race', [0, 3])
def test_a_penalty_changes_what_the_heats_come_to_at_once(day: Event, race: int) -> None:
    day.drive('TT 3', {3: 12.0})
    day.drive('TT 1', {1: 11.0})
    if race:
        day.start('Final', 1, 2, 3)
    assert overall(day) == [(1, 1), (2, 3)]
    assert day.correct(Act.PENALISE, 1, race=race, seconds=5, reason='a cone')
    assert overall(day) == [(1, 3), (2, 1)]
    assert day.correct(Act.UNDO_PENALTY, 1, race=race)
    assert overall(day) == [(1, 1), (2, 3)]
