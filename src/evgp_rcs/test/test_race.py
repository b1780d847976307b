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

"""The rules of the race by example: what officials, karts and time do, and what comes of it."""

from __future__ import annotations

from collections.abc import Callable
import pickle

from evgp_protocol.states import RaceState
from evgp_rcs.catalogue import CATALOGUE, CommandKind
from evgp_rcs.race import (
    AlertKind,
    Answer,
    Command,
    Doubt,
    EventKind,
    Heat,
    Kart,
    KartMemory,
    Outcome,
    Race,
    RaceMemory,
    RaceTimes,
    Start,
    StartPhase,
)
import pytest

GREEN_GREEN = RaceState.GREEN_GREEN
GRID_ACTIVE = RaceState.GRID_ACTIVE
IN_GARAGE = RaceState.IN_GARAGE
RED_FLAG = RaceState.RED_FLAG
RED_RED = RaceState.RED_RED

TEAMS = {1: 'Ohm', 2: 'Volta', 3: 'Tesla'}
SPECTATOR = 3
HEATS = (Heat('Heat 1', (1, 2)), Heat('Final', (2, 3)))


NO_PAUSE = RaceTimes(pause=0.0, settle=0.0)
"""So that a test can have a stop, its acknowledgement and a release at the same instant."""


class Officials:
    """Karts 1 and 2 in the race, kart 3 outside it, all connected; and a clock that is moved."""

    def __init__(self, times: RaceTimes = NO_PAUSE, connected: bool = True) -> None:
        self.now = 1000.0
        karts = [Kart(number, team, number != SPECTATOR) for number, team in TEAMS.items()]
        self.race = Race(karts, times, self.now, HEATS)
        for number in TEAMS if connected else ():
            self.connect(number)

    # ----- inputs -------------------------------------------------------------------------

    def command(self, kind: str, kart: int = 0, stating: bool = True) -> Outcome:
        return self.gives(self.as_seen(kind, kart, stating))

    def as_seen(self, kind: str, kart: int = 0, stating: bool = True) -> Command:
        """Return a command with what an official names who sees the race as it is now."""
        if CATALOGUE[CommandKind[kind]].to_one_kart:
            hold = self.race.karts[kart].hold if kart in self.race.karts else None
            return Command(CommandKind[kind], kart, stating, hold=hold)
        karts = frozenset(self.race.availability(CommandKind[kind], 0, self.now).karts)
        return Command(CommandKind[kind], kart, stating, karts, heat=HEATS[0].name)

    def gives(self, command: Command) -> Outcome:
        outcome = self.race.command(command, self.now)
        # What a start waits for is so at once.
        if outcome.start is not None:
            outcome = self.becomes(outcome.start, StartPhase.WRITTEN)
        assert outcome.answer is not None
        return outcome

    def becomes(self, start: Start, phase: StartPhase) -> Outcome:
        return self.race.start_becomes(phase, start.number, self.now)

    def answer_to(self, command: Command) -> Answer:
        answer = self.gives(command).answer
        assert answer is not None
        return answer

    def does(self, kind: str, kart: int = 0) -> Outcome:
        """Give a command that is to be accepted."""
        outcome = self.command(kind, kart)
        assert outcome.answer is not None
        assert outcome.answer.success, outcome.answer.message
        return outcome

    def is_refused(self, kind: str, kart: int = 0, stating: bool = True) -> str:
        """Give a command that is to be refused, and return what the official reads."""
        outcome = self.command(kind, kart, stating)
        assert outcome.answer is not None
        assert not outcome.answer.success, outcome.answer.message
        assert not outcome.orders
        return outcome.answer.message

    def connect(self, kart: int) -> Outcome:
        return self.race.connected(kart, self.now)

    def drop(self, kart: int) -> Outcome:
        return self.race.disconnected(kart, 'end of file', self.now)

    def says(self, kart: int, state: RaceState, serial: int | None = None) -> Outcome:
        serial = self.race.karts[kart].serial if serial is None else serial
        return self.race.heard(kart, serial, state, self.now)

    def acknowledge(self, *karts: int) -> None:
        for kart in karts:
            self.says(kart, self.sent(kart))

    def wait(self, seconds: float) -> Outcome:
        self.now += seconds
        return self.race.tick(self.now)

    # ----- what there is to see -----------------------------------------------------------

    def sent(self, kart: int) -> RaceState:
        return self.race.karts[kart].sent

    def all_sent(self) -> list[RaceState]:
        return [kart.sent for kart in self.race.karts.values()]

    def alerts(self) -> dict[AlertKind, str]:
        return {alert.kind: alert.text for alert in self.race.alerts(self.now)}

    # ----- the usual way to a state -------------------------------------------------------

    def to_grid(self) -> Officials:
        self.does('GRID_ACTIVE')
        return self

    def to_ready(self) -> Officials:
        self.to_grid().acknowledge(1, 2)
        return self

    def to_green(self) -> Officials:
        self.to_ready().does('GREEN_GREEN')
        self.acknowledge(1, 2)
        return self

    def to_flag(self) -> Officials:
        self.to_green().does('RED_FLAG')
        return self

    def to_over(self) -> Officials:
        self.to_green().does('RACE_OVER')
        return self


@pytest.fixture
def officials() -> Officials:
    return Officials()


Reach = Callable[[Officials], object]
STATES: dict[str, Reach] = {
    'IN_GARAGE': lambda officials: officials,
    'GRID_ACTIVE': Officials.to_grid,
    'GREEN_GREEN': Officials.to_green,
    'RED_FLAG': Officials.to_flag,
    'RED_RED': Officials.to_over,
}
every_state = pytest.mark.parametrize('reach', STATES.values(), ids=STATES)


def kinds(outcome: Outcome) -> list[EventKind]:
    return [event.kind for event in outcome.events]


# ----- a whole race -----------------------------------------------------------------------


def test_a_race_from_garage_to_garage(officials: Officials) -> None:
    assert officials.all_sent() == [IN_GARAGE, IN_GARAGE, IN_GARAGE]
    officials.does('GRID_ACTIVE')
    assert officials.all_sent() == [GRID_ACTIVE, GRID_ACTIVE, IN_GARAGE]
    officials.acknowledge(1, 2)
    officials.does('GREEN_GREEN')
    assert officials.all_sent() == [GREEN_GREEN, GREEN_GREEN, IN_GARAGE]
    officials.does('RED_FLAG')
    assert officials.all_sent() == [RED_FLAG, RED_FLAG, IN_GARAGE]
    officials.acknowledge(1, 2)
    officials.does('RACE_OVER')
    assert officials.all_sent() == [RED_RED, RED_RED, IN_GARAGE]
    officials.acknowledge(1, 2)
    officials.does('IN_GARAGE')
    assert officials.all_sent() == [IN_GARAGE, IN_GARAGE, IN_GARAGE]
    officials.does('GRID_ACTIVE')


def test_the_command_stands_in_the_record_before_what_came_of_it(officials: Officials) -> None:
    outcome = officials.does('GRID_ACTIVE')
    assert kinds(outcome) == [
        EventKind.COMMAND,
        EventKind.RACE_STATE,
        EventKind.KART_STATE,
        EventKind.KART_STATE,
    ]


def test_a_roster_has_every_kart_once() -> None:
    with pytest.raises(ValueError, match='kart 7 is in the roster twice'):
        Race([Kart(7), Kart(7)])


# ----- RED_FLAG ---------------------------------------------------------------------------


def test_the_answer_for_a_thousand_karts_stays_short() -> None:
    race = Race([Kart(number, in_race=True) for number in range(1, 1001)])
    for number in range(1, 501):
        race.connected(number, 0.0)
    assert race.command(Command(CommandKind.ALL_KILL), 0.0).answer == Answer(
        True,
        'RED_RED is sent to karts 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, and 488 more; not '
        'connected, sent when they connect: kart 501; kart 502; kart 503; and 497 more karts.',
    )


def test_a_kart_says_in_garage_and_is_not_said_to_acknowledge_it(officials: Officials) -> None:
    (told,) = officials.says(1, IN_GARAGE).events
    assert told.text == 'Kart 1 (Ohm) says IN_GARAGE'


# ----- GREEN_GREEN ------------------------------------------------------------------------


def test_green_waits_for_every_kart_of_the_race(officials: Officials) -> None:
    officials.to_grid()
    officials.drop(2)
    assert officials.is_refused('GREEN_GREEN') == (
        'GREEN_GREEN refused: waiting for kart 1 (Ohm): no GRID_ACTIVE yet; '
        'kart 2 (Volta): not connected.'
    )
    officials.connect(2)
    officials.acknowledge(1, 2)
    officials.does('GREEN_GREEN')


def test_a_long_refusal_names_three_karts_and_counts_the_others() -> None:
    race = Race([Kart(number, in_race=True) for number in range(1, 9)])
    everyone = frozenset(range(1, 9))
    race.command(Command(CommandKind.GRID_ACTIVE, statement=True, karts=everyone), 0.0)
    answer = race.command(Command(CommandKind.GREEN_GREEN, karts=everyone), 0.0).answer
    assert answer is not None
    assert answer.message == (
        'GREEN_GREEN refused: waiting for kart 1: not connected; kart 2: not connected; '
        'kart 3: not connected; and 5 more karts.'
    )


# ----- what officials read when a command is refused, or carried out -----------------------


def does(*commands: tuple[str, int | None], at: str = 'IN_GARAGE') -> Reach:
    """Return what brings the race to a state, then gives commands that are accepted."""
    return lambda officials: (
        STATES[at](officials),
        [officials.does(*command) for command in commands],
    )


def to_over_without(*silent: int) -> Reach:
    """Return what ends a race in which all acknowledge RED_RED but these."""
    return lambda officials: officials.to_over().acknowledge(*{1, 2}.difference(silent))


def lost(state: str, *commands: str) -> Reach:
    """Return what loses kart 1 in a state of the race; then commands for all are given."""

    def go(officials: Officials) -> None:
        STATES[state](officials)
        officials.drop(1)
        for command in commands:
            officials.does(command)
        officials.acknowledge(2)

    return go


def back_after_the_msr(officials: Officials) -> None:
    lost('GREEN_GREEN', 'RECORD_MSR')(officials)
    officials.does('IN_GARAGE')
    officials.connect(1)


def drives_unasked(officials: Officials) -> None:
    officials.says(SPECTATOR, GREEN_GREEN)
    officials.does('JOIN_RACE', SPECTATOR)


def false_start(officials: Officials) -> None:
    officials.to_ready().says(1, GREEN_GREEN)
    officials.connect(1)
    officials.acknowledge(1)


REFUSALS: dict[str, list[tuple[Reach | str, int | 0, str]]] = {
    'GRID_ACTIVE': [
        ('GREEN_GREEN', 0, 'the race is in GREEN_GREEN; bring it to IN_GARAGE first'),
        (does(('LEAVE_RACE', 1), ('LEAVE_RACE', 2)), 0, 'no kart is in the race'),
        (
            does(('KART_RED_FLAG', 2)),
            0,
            'release the held karts first: kart 2 (Volta): RED_FLAG by an official',
        ),
        (
            back_after_the_msr,
            0,
            'release the held karts first: kart 1 (Ohm): lost its connection in GREEN_GREEN',
        ),
        (drives_unasked, 0, 'send RED_RED first to what may be moving: kart 3 (Tesla)'),
        (does(('OPEN_TRACK', None)), 0, 'the track is open to humans; close it first'),
    ],
    'GREEN_GREEN': [
        ('RED_FLAG', 0, 'the race is in RED_FLAG; GREEN_GREEN follows GRID_ACTIVE'),
        (
            does(('KART_RED_FLAG', SPECTATOR), at='GRID_ACTIVE'),
            0,
            'another command was sent after GRID_ACTIVE; bring the race to IN_GARAGE and send '
            'GRID_ACTIVE again',
        ),
        (
            false_start,
            0,
            'bring the race to IN_GARAGE and release the held karts: kart 1 (Ohm): '
            'lost its connection while it may have been moving',
        ),
    ],
    'KART_FINISH': [
        ('RED_FLAG', 1, 'the race is in RED_FLAG; a kart finishes in GREEN_GREEN'),
        ('GREEN_GREEN', SPECTATOR, 'kart 3 (Tesla) is not in the race'),
        (lost('GREEN_GREEN'), 1, 'kart 1 (Ohm) is not connected'),
        (
            does(('KART_RED_RED', 1), at='GREEN_GREEN'),
            1,
            'kart 1 (Ohm) is held: RED_RED by an official',
        ),
        (
            does(('KART_FINISH', 1), at='GREEN_GREEN'),
            1,
            'kart 1 (Ohm) has finished already, in place 1',
        ),
    ],
    'RACE_OVER': [('IN_GARAGE', 0, 'the race is in IN_GARAGE; nothing is under way')],
    'IN_GARAGE': [
        ('IN_GARAGE', 0, 'the race is in IN_GARAGE already'),
        ('GREEN_GREEN', 0, 'the race is in GREEN_GREEN; send RACE_OVER or ALL_KILL first'),
        (
            to_over_without(2),
            0,
            'waiting for kart 2 (Volta): no RED_RED yet. If a kart does not answer, make it safe '
            'by hand and release it alone, or use the MSR and record it',
        ),
    ],
    'KART_IN_GARAGE': [
        ('IN_GARAGE', 1, 'kart 1 (Ohm) is in IN_GARAGE already'),
        ('GREEN_GREEN', 1, 'kart 1 (Ohm) is being sent GREEN_GREEN; stop it first with RED_RED'),
    ],
    'JOIN_RACE': [
        ('GRID_ACTIVE', SPECTATOR, 'the race is in GRID_ACTIVE; karts join in IN_GARAGE'),
        ('IN_GARAGE', 1, 'kart 1 (Ohm) is in the race already'),
    ],
    'LEAVE_RACE': [
        (
            'GREEN_GREEN',
            1,
            'the race is in GREEN_GREEN; karts leave in IN_GARAGE or GRID_ACTIVE. '
            'Stop it with RED_RED instead',
        ),
        ('IN_GARAGE', SPECTATOR, 'kart 3 (Tesla) is not in the race'),
    ],
    'OPEN_TRACK': [
        ('GREEN_GREEN', 0, 'the race is in GREEN_GREEN'),
        (drives_unasked, 0, 'kart 3 (Tesla) may be moving: stop it with RED_RED'),
        (lost('GREEN_GREEN', 'RACE_OVER'), 0, 'kart 1 (Ohm) was lost in motion: use the MSR'),
        (
            lost('GRID_ACTIVE', 'RED_FLAG'),
            0,
            'kart 1 (Ohm) was lost on the grid: wait until it is back and has acknowledged a '
            'stop; or make it safe by hand, send it RED_RED and release it alone; or use the MSR '
            'and record it',
        ),
    ],
    'KART_RED_RED': [
        ('IN_GARAGE', 9, 'no kart 9 in the roster, which has 1, 2, 3; ALL_KILL stops every kart'),
    ],
    'KART_RED_FLAG': [
        (
            'IN_GARAGE',
            0,
            'no kart 0 in the roster, which has 1, 2, 3; ALL_KILL stops every kart',
        ),
    ],
}


@pytest.mark.parametrize(
    ('kind', 'reach', 'kart', 'reason'),
    [(kind, *row) for kind, rows in REFUSALS.items() for row in rows],
)
def test_a_refusal_says_what_is_in_the_way(
    kind: str, reach: Reach | str, kart: int, reason: str, officials: Officials
) -> None:
    (STATES[reach] if isinstance(reach, str) else reach)(officials)
    assert officials.is_refused(kind, kart) == f'{kind} refused: {reason}.'


def gone(*karts: int) -> Reach:
    """Return what loses karts in the garage."""
    return lambda officials: [officials.drop(kart) for kart in karts]


def held_and_gone(officials: Officials) -> None:
    officials.does('KART_RED_RED', 2)
    officials.drop(1)


def one_held_alone(officials: Officials) -> None:
    officials.to_over().does('KART_RED_FLAG', SPECTATOR)
    officials.acknowledge(*TEAMS)


def flagged(officials: Officials) -> None:
    does(('KART_FINISH', 1), at='GREEN_GREEN')(officials)
    officials.wait(6.0)


FINISHED = does(('KART_FINISH', 1), ('KART_FINISH', 2), at='GREEN_GREEN')
ANSWERS: list[tuple[Reach, str, int, str]] = [
    (
        gone(SPECTATOR),
        'ALL_KILL',
        0,
        'RED_RED is sent to karts 1, 2; not connected, sent when it connects: kart 3 (Tesla)',
    ),
    (
        does(('KART_RED_RED', 2), at='GREEN_GREEN'),
        'RED_FLAG',
        0,
        'RED_FLAG is sent to kart 1; in RED_RED already: kart 2 (Volta)',
    ),
    (STATES['GREEN_GREEN'], 'RED_FLAG', 0, 'RED_FLAG is sent to karts 1, 2'),
    (
        STATES['RED_RED'],
        'RED_FLAG',
        0,
        'The race is in RED_RED already, which is stricter than RED_FLAG',
    ),
    (
        gone(SPECTATOR),
        'KART_RED_RED',
        SPECTATOR,
        'Kart 3 (Tesla) is held in RED_RED, but it is not connected',
    ),
    (STATES['GREEN_GREEN'], 'KART_RED_FLAG', 1, 'Kart 1 (Ohm) is held in RED_FLAG'),
    (STATES['GREEN_GREEN'], 'RACE_OVER', 0, 'Race over: RED_RED is sent to karts 1, 2'),
    (
        one_held_alone,
        'IN_GARAGE',
        0,
        'IN_GARAGE is sent to karts 1, 2; still held until released alone: kart 3 (Tesla)',
    ),
    (
        does(('KART_RED_RED', 1), at='GREEN_GREEN'),
        'KART_IN_GARAGE',
        1,
        'Kart 1 (Ohm) is released to IN_GARAGE and is out of the race',
    ),
    (does(('KART_RED_RED', 1)), 'KART_IN_GARAGE', 1, 'Kart 1 (Ohm) is released to IN_GARAGE'),
    (
        does(('KART_RED_RED', SPECTATOR), at='GREEN_GREEN'),
        'KART_IN_GARAGE',
        SPECTATOR,
        'Kart 3 (Tesla) is released to IN_GARAGE',
    ),
    (
        STATES['IN_GARAGE'],
        'SET_HEAT',
        0,
        '"Heat 1" is in the race (karts 1, 2), and no other kart',
    ),
    (
        held_and_gone,
        'SET_HEAT',
        0,
        '"Heat 1" is in the race (karts 1, 2), and no other kart; not connected: kart 1 (Ohm); '
        'still held: kart 2 (Volta): RED_RED by an official',
    ),
    (
        STATES['GREEN_GREEN'],
        'KART_FINISH',
        1,
        'Kart 1 (Ohm) finished in place 1; RED_FLAG follows in 6 s',
    ),
    (
        FINISHED,
        'KART_UNDO_FINISH',
        1,
        'Kart 1 (Ohm) has no place any more and drives on: its RED_FLAG was not sent yet; '
        'moved up: 1. kart 2 (Volta)',
    ),
    (
        flagged,
        'KART_UNDO_FINISH',
        1,
        'Kart 1 (Ohm) has no place any more; it stays held in RED_FLAG',
    ),
]


@pytest.mark.parametrize(('reach', 'kind', 'kart', 'message'), ANSWERS)
def test_an_answer_says_who_is_sent_what_and_who_is_not(
    reach: Reach, kind: str, kart: int, message: str, officials: Officials
) -> None:
    reach(officials)
    assert officials.does(kind, kart).answer == Answer(True, f'{message}.')


@pytest.mark.parametrize(
    ('kind', 'reach', 'kart', 'wanted'),
    [
        ('GRID_ACTIVE', STATES['IN_GARAGE'], 0, 'state that the track is clear of humans'),
        ('IN_GARAGE', to_over_without(), 0, 'state that the track is safe for humans'),
        ('RECORD_MSR', STATES['RED_RED'], 0, 'state that the Master Safety Remote was used'),
        (
            'KART_IN_GARAGE',
            does(('KART_RED_RED', 1)),
            1,
            'kart 1 (Ohm): no RED_RED yet; wait for it, or state that kart 1 (Ohm) was made safe '
            'by hand',
        ),
    ],
)
def test_a_refusal_says_what_must_be_stated(
    kind: str, reach: Reach, kart: int, wanted: str, officials: Officials
) -> None:
    reach(officials)
    assert officials.is_refused(kind, kart, stating=False) == f'{kind} refused: {wanted}.'
    officials.does(kind, kart)


# ----- heats -------------------------------------------------------------------------------


def test_without_heats_in_the_roster_the_command_is_unavailable_with_a_reason() -> None:
    availability = Race([Kart(1)]).availability(CommandKind.SET_HEAT, 0, 0.0)
    assert not availability.available
    assert availability.reason == (
        "the roster has no heats; list them under 'heats:' and restart race control"
    )


# ----- FINISH and the end of the race -----------------------------------------------------


def results(outcome: Outcome) -> list[str]:
    """Return the results that an outcome tells."""
    return [event.text for event in outcome.events if event.kind is EventKind.RESULTS]


def test_the_results_are_told_once_when_the_race_is_over(officials: Officials) -> None:
    officials.to_green().does('KART_FINISH', 2)
    told = officials.does('RACE_OVER')
    assert results(told) == ['Results: 1. kart 2 (Volta); did not finish: kart 1 (Ohm)']
    officials.acknowledge(1, 2)
    assert not results(officials.does('RACE_OVER'))
    assert not results(officials.does('IN_GARAGE'))


def test_the_results_are_told_when_the_race_goes_over_by_itself(officials: Officials) -> None:
    officials.to_green().does('KART_FINISH', 2)
    officials.does('KART_FINISH', 1)
    officials.wait(6.0)
    officials.acknowledge(1, 2)
    assert results(officials.wait(0.0)) == ['Results: 1. kart 2 (Volta), 2. kart 1 (Ohm)']


def test_the_results_of_a_race_that_was_stopped_are_told_with_in_garage(
    officials: Officials,
) -> None:
    assert not results(officials.to_green().does('ALL_KILL'))
    officials.acknowledge(1, 2, 3)
    assert results(officials.does('IN_GARAGE')) == [
        'Results: no kart finished; did not finish: kart 1 (Ohm), kart 2 (Volta)'
    ]


def test_a_red_flag_in_the_garage_after_a_race_stays_a_red_flag(officials: Officials) -> None:
    officials.to_green().does('KART_FINISH', 1)
    officials.does('KART_FINISH', 2)
    officials.does('RACE_OVER')
    officials.acknowledge(1, 2)
    officials.does('IN_GARAGE')
    officials.does('RED_FLAG')
    officials.wait(60.0)
    assert officials.race.state is RED_FLAG


def test_the_last_delay_serves_all_further_places() -> None:
    times = RaceTimes(finish_delays=(3.0, 1.0))
    assert [times.finish_delay(place) for place in (1, 2, 3, 40)] == [3.0, 1.0, 1.0, 1.0]
    assert RaceTimes(finish_delays=()).finish_delay(1) == 0.0


def finish_both(officials: Officials) -> Officials:
    officials.to_green()
    officials.does('KART_FINISH', 1)
    officials.does('KART_FINISH', 2)
    officials.wait(5.0)
    officials.wait(1.0)
    assert officials.all_sent() == [RED_FLAG, RED_FLAG, IN_GARAGE]
    return officials


def test_the_end_of_the_race_can_be_left_to_the_official() -> None:
    officials = finish_both(Officials(RaceTimes(auto_race_over=False, pause=0.0)))
    officials.acknowledge(1, 2)
    officials.wait(3600.0)
    assert officials.race.state is GREEN_GREEN
    officials.does('RACE_OVER')


def test_places_are_given_anew_in_the_next_race_and_who_left_has_none(
    officials: Officials,
) -> None:
    finish_both(officials).does('RACE_OVER')
    officials.acknowledge(1, 2)
    officials.does('IN_GARAGE')
    officials.does('LEAVE_RACE', 1)
    officials.to_green().does('KART_FINISH', 2)
    assert officials.race.karts[2].place == 1
    assert officials.race.karts[1].place == 0


def test_officials_are_told_once_when_every_kart_has_acknowledged(officials: Officials) -> None:
    officials.to_over()
    officials.says(1, RED_RED)
    assert EventKind.ALL_ACKNOWLEDGED not in kinds(officials.wait(0.05))
    officials.says(2, RED_RED)
    news = [
        event.text
        for event in officials.wait(0.05).events
        if event.kind is EventKind.ALL_ACKNOWLEDGED
    ]
    assert news == [
        'Every kart of the race has acknowledged; '
        'IN_GARAGE may be sent when the track is safe for humans'
    ]
    assert EventKind.ALL_ACKNOWLEDGED not in kinds(officials.wait(1.0))


# ----- IN_GARAGE for the race -------------------------------------------------------------


def test_the_use_of_the_msr_answers_for_lost_karts_but_not_for_one_that_is_there_and_silent(
    officials: Officials,
) -> None:
    officials.to_over().acknowledge(1)
    officials.does('RECORD_MSR')
    assert officials.is_refused('IN_GARAGE') == (
        'IN_GARAGE refused: waiting for kart 2 (Volta): no RED_RED yet. If a kart does not '
        'answer, make it safe by hand and release it alone.'
    )
    officials.drop(2)
    officials.does('IN_GARAGE')
    assert officials.all_sent() == [IN_GARAGE, RED_RED, RED_RED]


@pytest.mark.parametrize('first', ['ALL_KILL', 'KART_RED_FLAG'])
def test_all_kill_does_not_hide_that_an_official_held_a_kart_alone(
    first: str, officials: Officials
) -> None:
    second = 'KART_RED_FLAG' if first == 'ALL_KILL' else 'ALL_KILL'
    for kind in (first, second, second):
        officials.does(kind, SPECTATOR if kind == 'KART_RED_FLAG' else None)
    assert officials.race.karts[SPECTATOR].hold_reason == 'ALL_KILL; RED_FLAG by an official'
    officials.acknowledge(1, 2, SPECTATOR)
    officials.does('IN_GARAGE')
    assert officials.all_sent() == [IN_GARAGE, IN_GARAGE, RED_RED]


# ----- acknowledgements -------------------------------------------------------------------


def test_what_a_kart_says_unasked_is_reported_and_is_no_acknowledgement(
    officials: Officials,
) -> None:
    officials.to_ready().does('GREEN_GREEN')
    outcome = officials.says(1, RED_RED)
    assert kinds(outcome) == [EventKind.REPORTED]
    assert outcome.events[0].text == 'Kart 1 (Ohm) says RED_RED; it is being sent GREEN_GREEN'
    officials.does('KART_RED_RED', 1)
    assert not officials.race.karts[1].acknowledged


def test_a_report_is_told_once_however_often_it_is_repeated(officials: Officials) -> None:
    officials.to_green().says(1, RED_RED)
    assert not officials.says(1, RED_RED).events


def test_a_kart_that_says_another_state_takes_its_acknowledgement_back(
    officials: Officials,
) -> None:
    officials.to_ready()
    outcome = officials.says(1, IN_GARAGE)
    assert kinds(outcome) == [EventKind.WITHDRAWN]
    assert outcome.events[0].text == (
        'Kart 1 (Ohm) says IN_GARAGE: its acknowledgement of GRID_ACTIVE does not count any more'
    )
    why = officials.is_refused('GREEN_GREEN')
    assert 'kart 1 (Ohm): withdrew its acknowledgement of GRID_ACTIVE' in why
    officials.acknowledge(1)
    officials.does('GREEN_GREEN')


def test_what_a_kart_can_cause_again_and_again_by_talking_is_marked(officials: Officials) -> None:
    officials.to_grid()
    talk = [GRID_ACTIVE, IN_GARAGE, GRID_ACTIVE, IN_GARAGE, RED_RED]
    events = [event for state in talk for event in officials.says(1, state).events]
    assert [(event.kind, event.chatter) for event in events] == [
        (EventKind.ACKNOWLEDGED, False),
        (EventKind.WITHDRAWN, True),
        (EventKind.ACKNOWLEDGED, True),
        (EventKind.WITHDRAWN, True),
        (EventKind.REPORTED, True),
    ]


# ----- connections ------------------------------------------------------------------------


def test_a_kart_whose_connection_is_replaced_counts_as_dropped(officials: Officials) -> None:
    outcome = officials.to_green().connect(1)
    assert kinds(outcome)[0] is EventKind.DISCONNECTED
    assert [(order.kart, order.state) for order in outcome.orders] == [(1, RED_RED)]


def test_a_kart_lost_in_motion_calls_for_the_msr_until_it_is_back_and_stands(
    officials: Officials,
) -> None:
    officials.to_green().drop(2)
    officials.connect(2)
    assert officials.alerts() == {
        AlertKind.LOST_IN_MOTION: (
            'Use the MSR: kart 2 (Volta) lost its connection while it may have been moving; '
            'it is back and has not stopped yet'
        )
    }
    officials.acknowledge(2)
    assert officials.alerts() == {}


def test_a_kart_that_drops_again_and_again_does_not_renew_the_time_of_its_alarm(
    officials: Officials,
) -> None:
    officials.to_green().drop(2)
    lost = officials.now
    officials.wait(3.0)
    officials.connect(2)
    officials.drop(2)
    (alert,) = officials.race.alerts(officials.now)
    assert alert.since == lost


def test_a_second_disconnect_of_the_same_kart_is_no_event(officials: Officials) -> None:
    officials.drop(1)
    assert not officials.drop(1).events


# ----- alerts -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('reach', 'limit', 'kind', 'text'),
    [
        (
            Officials.to_grid,
            120.0,
            AlertKind.NOT_READY,
            'Kart 2 (Volta) has not acknowledged GRID_ACTIVE',
        ),
        (
            lambda officials: officials.to_ready().does('GREEN_GREEN'),
            30.0,
            AlertKind.GREEN_UNACKNOWLEDGED,
            'Kart 2 (Volta) has not acknowledged GREEN_GREEN',
        ),
        (
            Officials.to_flag,
            15.0,
            AlertKind.FLAG_UNACKNOWLEDGED,
            'Use the MSR: kart 2 (Volta) has not acknowledged RED_FLAG',
        ),
        (
            Officials.to_over,
            5.0,
            AlertKind.RED_UNACKNOWLEDGED,
            'Use the MSR: kart 2 (Volta) has not acknowledged RED_RED',
        ),
    ],
    ids=['GRID_ACTIVE', 'GREEN_GREEN', 'RED_FLAG', 'RED_RED'],
)
def test_a_kart_that_does_not_acknowledge_in_time_raises_an_alert(
    reach: Reach, limit: float, kind: AlertKind, text: str, officials: Officials
) -> None:
    reach(officials)
    officials.acknowledge(1)
    officials.wait(limit - 0.1)
    assert officials.alerts() == {}
    officials.wait(0.1)
    assert officials.alerts() == {kind: text}


def test_a_kart_lost_on_the_grid_or_after_its_stop_does_not_call_for_the_msr(
    officials: Officials,
) -> None:
    officials.to_over().acknowledge(1, 2)
    officials.drop(2)
    assert officials.alerts() == {AlertKind.KART_LOST: 'Kart 2 (Volta) lost its connection'}
    (alert,) = officials.race.alerts(officials.now)
    assert not alert.use_msr


def test_people_on_a_track_that_is_no_longer_safe_raise_an_alert(officials: Officials) -> None:
    officials.does('OPEN_TRACK')
    officials.does('KART_RED_RED', 1)
    assert officials.alerts() == {
        AlertKind.TRACK_UNSAFE: (
            'Clear the track, or use the MSR: kart 1 (Ohm) has not acknowledged RED_RED'
        )
    }
    officials.acknowledge(1)
    assert officials.alerts() == {}


def test_an_alert_is_told_once_when_it_comes_and_once_when_it_goes(officials: Officials) -> None:
    officials.to_over().acknowledge(1)
    assert EventKind.ALERT_RAISED in kinds(officials.wait(5.0))
    assert kinds(officials.wait(1.0)) == []
    officials.acknowledge(2)
    cleared = officials.wait(0.0).events
    assert [event.text for event in cleared if event.kind is EventKind.ALERT_CLEARED] == [
        'No longer: Use the MSR: kart 2 (Volta) has not acknowledged RED_RED'
    ]


def test_alerts_come_newest_first(officials: Officials) -> None:
    officials.to_green().drop(1)
    officials.wait(1.0)
    officials.drop(2)
    assert [alert.kart for alert in officials.race.alerts(officials.now)] == [2, 1]


# ----- what is announced ------------------------------------------------------------------


@every_state
@pytest.mark.parametrize('kind', sorted(kind.name for kind in CommandKind))
def test_a_command_is_refused_for_the_announced_reason_and_only_then(
    kind: str, reach: Reach, officials: Officials
) -> None:
    reach(officials)
    announced = officials.race.availability(CommandKind[kind], 1, officials.now)
    answer = officials.command(kind, 1).answer
    assert answer is not None
    assert answer.success == announced.available
    if not announced.available:
        assert answer.message == f'{kind} refused: {announced.reason}.'


# ----- what the official saw --------------------------------------------------------------


def test_the_grid_does_not_form_with_a_kart_the_official_did_not_see(officials: Officials) -> None:
    command = officials.as_seen('GRID_ACTIVE')
    officials.does('JOIN_RACE', SPECTATOR)
    answer = officials.answer_to(command)
    assert answer.message == (
        'GRID_ACTIVE refused: the race has changed since you looked: it is now for '
        'karts 1, 2, 3, you named karts 1, 2; you did not name kart 3; look again.'
    )
    assert officials.race.state is IN_GARAGE


def test_green_is_not_given_to_fewer_karts_than_the_official_saw(officials: Officials) -> None:
    command = officials.to_ready().as_seen('GREEN_GREEN')
    officials.does('LEAVE_RACE', 2)
    officials.acknowledge(2)
    answer = officials.answer_to(command)
    assert answer.message == (
        'GREEN_GREEN refused: the race has changed since you looked: it is now for kart 1, '
        'you named karts 1, 2; it is not for kart 2; look again.'
    )
    assert officials.all_sent() == [GRID_ACTIVE, RED_RED, IN_GARAGE]


def test_a_kart_is_not_released_from_another_hold_than_the_official_saw(
    officials: Officials,
) -> None:
    officials.does('KART_RED_FLAG', 1)
    command = officials.as_seen('KART_IN_GARAGE', 1)
    officials.does('ALL_KILL')
    answer = officials.answer_to(command)
    assert answer.message == (
        'KART_IN_GARAGE refused: kart 1 (Ohm) has changed since you looked: it is held in '
        'RED_RED, you saw it held in RED_FLAG; look again.'
    )


def test_the_race_is_not_said_to_be_on_when_every_kart_stands(officials: Officials) -> None:
    def news() -> list[str]:
        events = officials.wait(0.0).events
        return [each.text for each in events if each.kind is EventKind.ALL_ACKNOWLEDGED]

    officials.to_green()
    assert news() == ['Every kart of the race has acknowledged; the race is on']
    officials.does('KART_RED_RED', 1)
    officials.acknowledge(1)
    officials.wait(0.0)
    officials.does('KART_FINISH', 2)
    officials.wait(6.0)
    officials.acknowledge(2)
    assert news() == [
        'Every kart of the race has acknowledged; all of them have stopped, and RACE_OVER '
        'may be sent'
    ]


def test_a_race_that_is_on_names_the_karts_that_stand(officials: Officials) -> None:
    officials.to_green().does('KART_RED_RED', 1)
    officials.wait(0.0)
    officials.acknowledge(1)
    (event,) = officials.wait(0.0).events
    assert event.text == (
        'Every kart of the race has acknowledged; the race is on, without kart 1 (Ohm)'
    )


def test_without_a_connected_kart_humans_are_allowed_because_nothing_is_known_of_the_karts() -> (
    None
):
    access = Officials(connected=False).race.track_access()
    assert access.allowed
    assert access.reason == 'no kart is connected: race control does not know what the karts do'


# ----- pauses -----------------------------------------------------------------------------


@pytest.fixture
def paused() -> Officials:
    """Return officials after an ALL_KILL that every kart has acknowledged at once."""
    officials = Officials(RaceTimes(pause=1.0, settle=0.0))
    officials.does('ALL_KILL')
    officials.acknowledge(*TEAMS)
    return officials


def test_a_pause_says_why_it_refuses_a_release_and_until_when(paused: Officials) -> None:
    announced = paused.race.availability(CommandKind.IN_GARAGE, 0, paused.now)
    assert not announced.available
    assert announced.available_from == paused.now + 1.0
    assert announced.reason == (
        'a stop was sent just now; look at the race, then send this command again'
    )
    assert paused.is_refused('IN_GARAGE') == f'IN_GARAGE refused: {announced.reason}.'
    paused.now += 1.0
    announced = paused.race.availability(CommandKind.IN_GARAGE, 0, paused.now)
    assert announced.available
    assert announced.available_from is None
    paused.does('IN_GARAGE')


def test_a_stop_to_a_kart_that_is_not_in_the_roster_begins_a_pause_too() -> None:
    officials = Officials(RaceTimes(pause=1.0, settle=0.0))
    officials.is_refused('KART_RED_RED', 9)
    assert 'a stop was sent just now' in officials.is_refused('GRID_ACTIVE')


def test_a_stop_does_not_shorten_the_pause_after_race_control_was_held_up(
    officials: Officials,
) -> None:
    officials.race.held_up(30.0, officials.now)
    until = officials.now + officials.race.times.pause_after_held_up
    officials.does('KART_RED_RED', SPECTATOR)
    announced = officials.race.availability(CommandKind.GRID_ACTIVE, 0, officials.now)
    assert announced.available_from == until
    assert announced.reason.startswith('race control was held up for 30.0 s; ')


def test_that_the_race_may_go_home_is_told_with_the_time_until_then(paused: Officials) -> None:
    texts = [event.text for event in paused.wait(0.1).events]
    assert texts == [
        'Every kart of the race has acknowledged; '
        'IN_GARAGE may be sent in 1 s when the track is safe for humans'
    ]


# ----- a start waits until it is on the disk, and nothing waits for a start -----------------


def starting(officials: Officials) -> Start:
    """Give GREEN_GREEN, and return the start that waits."""
    command = officials.to_ready().as_seen('GREEN_GREEN')
    outcome = officials.race.command(command, officials.now)
    assert outcome.answer is None
    assert not outcome.orders
    assert outcome.start is not None
    return outcome.start


def test_karts_start_once_it_is_on_the_disk_that_they_may_move(officials: Officials) -> None:
    start = starting(officials)
    doubts = [start.memory.karts[number].doubt for number in TEAMS]
    assert doubts == [Doubt.MOVING, Doubt.MOVING, Doubt.NONE]
    assert officials.all_sent() == [GRID_ACTIVE, GRID_ACTIVE, IN_GARAGE]
    outcome = officials.becomes(start, StartPhase.WRITTEN)
    assert outcome.answer == Answer(True, 'GREEN_GREEN is sent to karts 1, 2.')
    assert [order.state for order in outcome.orders] == [GREEN_GREEN, GREEN_GREEN]


def test_what_the_disk_says_of_an_earlier_start_starts_nothing(officials: Officials) -> None:
    earlier = starting(officials)
    officials.becomes(earlier, StartPhase.WITHDRAWN)
    later = officials.race.command(officials.as_seen('GREEN_GREEN'), officials.now).start
    assert later is not None
    assert officials.becomes(earlier, StartPhase.WRITTEN).answer is None
    assert officials.race.start is later
    assert officials.race.state is GRID_ACTIVE


# ----- what is wrong around race control --------------------------------------------------


def test_while_another_race_control_runs_a_refusal_says_what_to_do(officials: Officials) -> None:
    assert kinds(officials.race.rival(True, officials.now)) == [EventKind.ALERT_RAISED]
    assert officials.is_refused('GRID_ACTIVE') == (
        'GRID_ACTIVE refused: another race control is running; end it first. '
        'Every stop still works.'
    )
    assert kinds(officials.race.rival(False, officials.now)) == [EventKind.ALERT_CLEARED]


@pytest.mark.parametrize('kind', ['GRID_ACTIVE', 'GREEN_GREEN'])
def test_while_the_record_fails_no_race_starts_and_the_refusal_names_the_remedy(
    kind: str, officials: Officials
) -> None:
    if kind == 'GREEN_GREEN':
        officials.to_ready()
    officials.race.record_trouble('The record fails: disk full', officials.now)
    assert officials.alerts() == {AlertKind.RECORD_FAILING: 'The record fails: disk full'}
    refusal = officials.is_refused(kind)
    assert 'The record fails: disk full' in refusal
    assert 'the parameter record on another disk' in refusal
    officials.race.record_trouble('', officials.now)
    assert officials.alerts() == {}
    officials.does(kind)


def test_a_record_that_fails_in_other_words_is_no_new_alert(officials: Officials) -> None:
    officials.race.record_trouble('disk full; 1 event waits', officials.now)
    assert not officials.race.record_trouble('disk full; 2 events wait', officials.now).events
    assert officials.alerts() == {AlertKind.RECORD_FAILING: 'disk full; 2 events wait'}


# ----- after a restart --------------------------------------------------------------------


def restarted(memory: RaceMemory | None, *numbers: int) -> Officials:
    officials = Officials(connected=False)
    karts = [Kart(number) for number in numbers]
    officials.race = Race(karts, NO_PAUSE, officials.now)
    outcome = officials.race.recover(memory, officials.now)
    assert not outcome.orders
    return officials


CALM = KartMemory(False, False, 0, Doubt.NONE, held_alone=False)
unproved = pytest.mark.parametrize(
    'memory', [None, RaceMemory(IN_GARAGE, {1: CALM, 2: CALM})], ids=['unknown', 'crash']
)


def test_after_a_crash_in_the_garage_no_results_are_told_again(officials: Officials) -> None:
    finish_both(officials).does('RACE_OVER')
    officials.acknowledge(1, 2)
    officials.does('IN_GARAGE')
    assert officials.race.karts[1].place == 1
    again = restarted(officials.race.memory(), *TEAMS)
    assert not results(again.does('RACE_OVER'))


@unproved
def test_a_statement_in_the_garage_answers_for_karts_that_are_away(
    memory: RaceMemory | None,
) -> None:
    officials = restarted(memory, 1, 2)
    officials.connect(1)
    officials.acknowledge(1)
    statement = officials.is_refused('IN_GARAGE', stating=False)
    assert 'no kart moves' in statement
    assert 'kart 2' in statement
    officials.does('IN_GARAGE')
    assert officials.all_sent() == [IN_GARAGE, IN_GARAGE]
    assert officials.race.track_access().allowed
    assert officials.race.memory().at_rest


def test_a_kart_that_left_the_roster_is_named_and_held_until_it_is_released_by_hand() -> None:
    held = KartMemory(True, True, 1, Doubt.MOVING, False)
    memory = RaceMemory(GREEN_GREEN, {1: CALM, 7: held, 8: CALM})
    race = Race([Kart(1)], now=0.0)
    events = race.recover(memory, 0.0).events
    assert [event.text for event in events if event.kart == 7] == [
        'Kart 7 (not in the roster any more) is held in RED_RED; find it, make it safe, release '
        'it alone'
    ]
    assert list(race.karts) == [1, 7]
    assert not race.karts[7].in_race
    allowed = race.track_access()
    assert 'kart 7 (not in the roster any more) was lost in motion' in allowed.reason
    command = Command(CommandKind.KART_IN_GARAGE, 7, True, hold=RED_RED)
    assert race.command(command, 0.0).answer
    command = Command(CommandKind.IN_GARAGE, None, True, frozenset({1}))
    assert race.command(command, 0.0).answer
    assert race.track_access().allowed
    assert race.memory().karts[7] == CALM


def test_a_kart_that_was_held_alone_before_a_restart_is_held_for_one_reason() -> None:
    race = Race([Kart(1)], now=0.0)
    memory = RaceMemory(RED_RED, {1: KartMemory(True, True, 0, Doubt.NONE, True)}, final=True)
    race.recover(memory, 0.0)
    assert race.karts[1].hold_reason == 'race control was restarted'


# ----- a stop counts for people once the kart has stood ------------------------------------


@pytest.fixture
def patient() -> Officials:
    return Officials(RaceTimes(pause=0.0, settle=3.0))


def test_humans_are_allowed_once_a_kart_has_stood_by_its_stop(patient: Officials) -> None:
    patient.to_green().does('ALL_KILL')
    patient.acknowledge(*TEAMS)
    patient.wait(2.9)
    for kind in ('OPEN_TRACK', 'IN_GARAGE'):
        assert 'must stand for 3 s' in patient.is_refused(kind)
    patient.is_refused('KART_IN_GARAGE', 1, stating=False)
    assert not patient.race.track_access().allowed
    patient.wait(0.1)
    assert patient.race.track_access().allowed
    patient.does('IN_GARAGE')


def test_a_kart_is_not_taken_to_have_stood_while_race_control_was_held_up(
    patient: Officials,
) -> None:
    """What it said meanwhile, and that its link is gone, waits unread."""
    patient.to_green().does('ALL_KILL')
    patient.acknowledge(*TEAMS)
    patient.now += 4.0
    patient.race.held_up(4.0, patient.now)
    patient.wait(2.9)
    assert not patient.race.track_access().allowed
    patient.wait(0.1)
    assert patient.race.track_access().allowed


# ----- who caused it -----------------------------------------------------------------------


def test_a_change_of_state_names_its_cause_and_who_gave_it(officials: Officials) -> None:
    officials.to_green().wait(1.0)
    command = Command(CommandKind.ALL_KILL, official='Anna')
    events = officials.race.command(command, officials.now).events
    of_state = (EventKind.RACE_STATE, EventKind.KART_STATE)
    changes = [each for each in events if each.kind in of_state]
    assert len(changes) == 1 + len(TEAMS)
    assert {(each.command, each.official) for each in changes} == {(CommandKind.ALL_KILL, 'Anna')}
    assert officials.race.state_cause == 'ALL_KILL by Anna'
    assert officials.race.state_since == officials.now
    assert officials.race.karts[1].hold_reason == 'ALL_KILL by Anna'


def test_a_race_that_ends_by_itself_says_so(officials: Officials) -> None:
    officials.to_green()
    for kart in (1, 2):
        officials.does('KART_FINISH', kart)
    officials.wait(10.0)
    officials.acknowledge(1, 2)
    outcome = officials.wait(0.1)
    (change,) = (each for each in outcome.events if each.kind is EventKind.RACE_STATE)
    assert change.command is None
    assert officials.race.state_cause == 'race over, every kart of the race has finished'


def test_the_race_goes_to_another_process_and_is_the_same_there(officials: Officials) -> None:
    officials.to_green().drop(1)
    officials.wait(1.0)
    there = pickle.loads(pickle.dumps(officials.race))  # noqa: S301 - our own bytes
    assert there.karts == officials.race.karts
    assert there.alerts(officials.now) == officials.race.alerts(officials.now)
    assert there.memory() == officials.race.memory()
    assert [there.availability(kind, 1, officials.now) for kind in CommandKind] == [
        officials.race.availability(kind, 1, officials.now) for kind in CommandKind
    ]
