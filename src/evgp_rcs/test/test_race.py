# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The rules of the race by example: what officials, karts and time do, and what comes of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.link_quality import NOT_MEASURED, POOR_LATELY
from evgp_rcs.rules.race import (
    AlertKind,
    Answer,
    Attendance,
    Command,
    Doubt,
    EventKind,
    Heat,
    Kart,
    KartMemory,
    LastRun,
    Outcome,
    Race,
    RaceMemory,
    RaceTimes,
)
from evgp_rcs.rules.snapshot import snapshot_of
import pytest
from recorded_races import as_seen

GREEN_GREEN = RaceState.GREEN_GREEN
GRID_ACTIVE = RaceState.GRID_ACTIVE
IN_GARAGE = RaceState.IN_GARAGE
RED_FLAG = RaceState.RED_FLAG
RED_RED = RaceState.RED_RED

TEAMS = {1: 'Ohm', 2: 'Volta', 3: 'Tesla'}
SPECTATOR = 3
HEATS = (Heat('Heat 1', (1, 2)), Heat('Final', (2, 3)))


NO_PAUSE = RaceTimes(pause=0.0, settle_time=0.0)
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

    def command(self, kind: str, kart: int, fields: dict[str, Any]) -> tuple[Outcome, Answer]:
        """Give a command, with what an official names who sees the race as it is now."""
        self.race.saved(self.race.memory().gridded)  # everything is on the disk at once
        fields = {'heat': HEATS[0].name, **fields}
        command = as_seen(self.race, CommandKind[kind], kart, self.now, **fields)
        outcome = self.race.command(command, self.now)
        assert outcome.answer is not None
        return outcome, outcome.answer

    def does(self, kind: str, kart: int = 0, **fields: Any) -> Outcome:
        """Give a command that is to be accepted."""
        outcome, answer = self.command(kind, kart, fields)
        assert answer.success, answer.message
        return outcome

    def is_refused(self, kind: str, kart: int = 0, **fields: Any) -> str:
        """Give a command that is to be refused, and return what the official reads."""
        outcome, answer = self.command(kind, kart, fields)
        assert not answer.success, answer.message
        assert not outcome.orders
        return answer.message

    def connect(self, kart: int) -> Outcome:
        return self.race.connected(kart, self.now)

    def drop(self, kart: int) -> Outcome:
        return self.race.disconnected(kart, 'end of file', self.now)

    def says(self, kart: int, state: RaceState) -> Outcome:
        return self.race.heard(kart, self.race.karts[kart].serial, state, self.now)

    def measure(self, kart: int, grade: Grade) -> Outcome:
        link = NOT_MEASURED._replace(grade=grade, worst_answer=0.7)
        return self.race.measured(kart, link, self.now)

    def acknowledge(self, *karts: int) -> None:
        for kart in karts:
            self.says(kart, self.race.karts[kart].sent)

    def wait(self, seconds: float) -> Outcome:
        self.now += seconds
        return self.race.tick(self.now)

    # ----- what there is to see -----------------------------------------------------------

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


def kinds(outcome: Outcome) -> list[EventKind]:
    return [event.kind for event in outcome.events]


def texts(outcome: Outcome, kind: EventKind) -> list[str]:
    return [event.text for event in outcome.events if event.kind is kind]


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


def test_a_kart_says_in_garage_and_is_not_said_to_acknowledge_it(officials: Officials) -> None:
    (told,) = officials.says(1, IN_GARAGE).events
    assert told.text == 'Kart 1 (Ohm) reports IN_GARAGE'


def test_green_waits_for_every_kart_of_the_race(officials: Officials) -> None:
    officials.to_grid()
    officials.drop(2)
    assert officials.is_refused('GREEN_GREEN') == (
        'GREEN_GREEN refused: waiting for kart 1 (Ohm): has not acknowledged GRID_ACTIVE; '
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


def drives_unasked(officials: Officials) -> None:
    officials.says(SPECTATOR, GREEN_GREEN)
    officials.does('JOIN_RACE', SPECTATOR)


def two_programs_connect(officials: Officials) -> None:
    officials.race.contested(1, True, officials.now)


def is_cut_off(officials: Officials) -> None:
    officials.to_green().race.cut_off('eth0 has no cable', officials.now)


def has_no_heats(officials: Officials) -> None:
    officials.race.heats = ()


def says_on_the_grid(state: RaceState) -> Reach:
    return lambda officials: officials.to_ready().says(1, state)


def left_on_the_grid(officials: Officials) -> None:
    officials.race.attended(Attendance(1, 'Anna (window)'), officials.now)
    officials.to_ready().race.attended(Attendance(), officials.now)


REFUSALS: dict[str, list[tuple[Reach | str, int | 0, str]]] = {
    'GRID_ACTIVE': [
        (
            does(('KART_RED_FLAG', 2)),
            0,
            'karts in the race are held; release them first: kart 2 (Volta): RED_FLAG',
        ),
        (drives_unasked, 0, 'kart 3 (Tesla) may be moving: stop it with RED_RED'),
        (does(('KART_RED_RED', SPECTATOR)), 0, 'kart 3 (Tesla) has not acknowledged RED_RED'),
        (
            lambda officials: officials.race.rival(True, officials.now),
            0,
            'another race control is running; shut it down first. Every stop still works',
        ),
        (
            two_programs_connect,
            0,
            'two programs keep connecting as kart 1 (Ohm); have the team stop one of them',
        ),
        (
            lambda officials: officials.race.record_trouble('The disk is full', officials.now),
            0,
            'The disk is full. A race cannot start without a record. Make room on the disk, or '
            'restart race control with the parameter record set to a path on another disk. As a '
            'last resort, use /dev/shm',
        ),
    ],
    'GREEN_GREEN': [
        ('RED_FLAG', 0, 'the race is in RED_FLAG; GREEN_GREEN is possible only in GRID_ACTIVE'),
        (
            does(('KART_RED_FLAG', SPECTATOR), at='GRID_ACTIVE'),
            0,
            'another command was sent after GRID_ACTIVE; send GRID_ACTIVE again',
        ),
        (
            left_on_the_grid,
            0,
            'race control is no longer in contact with any screen or button that can stop the '
            'race; open a window, or start again from IN_GARAGE',
        ),
        (
            says_on_the_grid(RED_RED),
            0,
            'waiting for kart 1 (Ohm): stopped itself; take it out of the race, or start again '
            'from IN_GARAGE',
        ),
        (
            says_on_the_grid(IN_GARAGE),
            0,
            'waiting for kart 1 (Ohm): withdrew its acknowledgement of GRID_ACTIVE',
        ),
    ],
    'IN_GARAGE': [
        (
            to_over_without(2),
            0,
            'waiting for kart 2 (Volta): has not acknowledged RED_RED. If a kart does not answer, '
            'use the MSR and record its use, or, if the kart is off the track, make it safe by '
            'hand and release it individually',
        ),
        (is_cut_off, 0, 'race control is still cut off from the karts: eth0 has no cable'),
    ],
    'SET_HEAT': [
        (has_no_heats, 0, "the roster has no heats; list them under 'heats:' and read it again"),
    ],
    'KART_IN_GARAGE': [
        (
            'GREEN_GREEN',
            1,
            'kart 1 (Ohm) is being sent GREEN_GREEN; only a kart sent a red can be released. Stop '
            'it with RED_RED first',
        ),
    ],
    'LEAVE_RACE': [
        (
            'GREEN_GREEN',
            1,
            'the race is in GREEN_GREEN; LEAVE_RACE is possible only in IN_GARAGE or GRID_ACTIVE. '
            'Stop the kart with RED_RED instead',
        ),
    ],
    'OPEN_TRACK': [
        (drives_unasked, 0, 'kart 3 (Tesla) may be moving: stop it with RED_RED'),
        (
            lost('GREEN_GREEN', 'RACE_OVER'),
            0,
            'kart 1 (Ohm) was lost while it may have been moving: use the MSR',
        ),
        (
            lost('GRID_ACTIVE', 'RED_FLAG'),
            0,
            'kart 1 (Ohm) was lost on the grid. Wait until it is back and has acknowledged a '
            'stop, or use the MSR and record its use, or, if the team has the kart off the track, '
            'make it safe by hand, send it RED_RED and release it individually',
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
    assert officials.race.availability(CommandKind[kind], kart, officials.now).reason == reason
    assert officials.is_refused(kind, kart) == f'{kind} refused: {reason}.'


def test_who_names_no_kart_reads_every_number_to_paste(officials: Officials) -> None:
    numbers = [1, 2, *range(10, 30)]
    karts = [Kart(number, 'Team', in_race=True) for number in numbers]
    officials.race = Race(karts, NO_PAUSE, officials.now)
    for number in numbers:
        officials.connect(number)
    refusal = f'GRID_ACTIVE refused: no kart is named. Add karts: {numbers}.'
    assert officials.is_refused('GRID_ACTIVE', karts=frozenset()) == refusal


def gone(officials: Officials) -> None:
    officials.drop(SPECTATOR)


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
        gone,
        'ALL_KILL',
        0,
        'RED_RED sent to karts 1, 2; once connected, also to: kart 3 (Tesla)',
    ),
    (
        does(('KART_RED_RED', 2), at='GREEN_GREEN'),
        'RED_FLAG',
        0,
        'RED_FLAG sent to kart 1',
    ),
    (
        STATES['RED_RED'],
        'RED_FLAG',
        0,
        'The race is already in RED_RED, which is stricter than RED_FLAG',
    ),
    (
        gone,
        'KART_RED_RED',
        SPECTATOR,
        'Kart 3 (Tesla) is held in RED_RED, but it is not connected',
    ),
    (
        one_held_alone,
        'IN_GARAGE',
        0,
        'IN_GARAGE sent to karts 1, 2. Still held until released individually: kart 3 (Tesla)',
    ),
    (
        does(('KART_RED_RED', 1), at='GREEN_GREEN'),
        'KART_IN_GARAGE',
        1,
        'Kart 1 (Ohm) is released to IN_GARAGE and is out of the race',
    ),
    (
        held_and_gone,
        'SET_HEAT',
        0,
        '"Heat 1" is now in the race (karts 1, 2), with no other karts. Still held: kart 2 '
        '(Volta): RED_RED',
    ),
    (
        FINISHED,
        'KART_UNDO_FINISH',
        1,
        'Kart 1 (Ohm) no longer has a place, and is still being sent GREEN_GREEN',
    ),
    (
        flagged,
        'KART_UNDO_FINISH',
        1,
        'Kart 1 (Ohm) no longer has a place, and is still being sent RED_FLAG',
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
        (
            'GRID_ACTIVE',
            STATES['IN_GARAGE'],
            0,
            'state that the track is clear of humans (this command closes it)',
        ),
        ('IN_GARAGE', to_over_without(), 0, 'state that the track is safe for humans'),
        ('RECORD_MSR', STATES['RED_RED'], 0, 'state that the Master Safety Remote was used'),
        (
            'KART_IN_GARAGE',
            does(('KART_RED_RED', 1)),
            1,
            'kart 1 (Ohm): has not acknowledged RED_RED. Wait for it, or state that kart 1 (Ohm) '
            'was made safe by hand',
        ),
    ],
)
def test_a_refusal_says_what_must_be_stated(
    kind: str, reach: Reach, kart: int, wanted: str, officials: Officials
) -> None:
    reach(officials)
    assert officials.is_refused(kind, kart, statement=False) == f'{kind} refused: {wanted}.'
    officials.does(kind, kart)


def test_the_last_delay_serves_all_further_places() -> None:
    times = RaceTimes(finish_delays=(3.0, 1.0))
    assert [times.finish_delay(place) for place in (1, 2, 3, 40)] == [3.0, 1.0, 1.0, 1.0]


def test_officials_are_told_once_when_every_kart_has_acknowledged(officials: Officials) -> None:
    officials.to_over()
    officials.says(1, RED_RED)
    assert EventKind.ALL_ACKNOWLEDGED not in kinds(officials.wait(0.05))
    officials.says(2, RED_RED)
    news = texts(officials.wait(0.05), EventKind.ALL_ACKNOWLEDGED)
    assert news == ['Every kart in the race acknowledged RED_RED']
    assert EventKind.ALL_ACKNOWLEDGED not in kinds(officials.wait(1.0))


@pytest.mark.parametrize('first', ['ALL_KILL', 'KART_RED_FLAG'])
def test_all_kill_does_not_hide_that_an_official_held_a_kart_alone(
    first: str, officials: Officials
) -> None:
    second = 'KART_RED_FLAG' if first == 'ALL_KILL' else 'ALL_KILL'
    for kind in (first, second, second):
        officials.does(kind, SPECTATOR if kind == 'KART_RED_FLAG' else None)
    reason = officials.race.karts[SPECTATOR].hold_reason
    assert sorted(reason.split('; ')) == ['ALL_KILL', 'RED_FLAG']


# ----- acknowledgements -------------------------------------------------------------------


def test_what_a_kart_says_unasked_is_reported_and_is_no_acknowledgement(
    officials: Officials,
) -> None:
    officials.to_ready().does('GREEN_GREEN')
    outcome = officials.says(1, RED_RED)
    assert kinds(outcome) == [EventKind.REPORTED]
    assert outcome.events[0].text == 'Kart 1 (Ohm) reports RED_RED while being sent GREEN_GREEN'
    assert not officials.says(1, RED_RED).events
    officials.does('KART_RED_RED', 1)
    assert not officials.race.karts[1].acknowledged


def test_what_a_kart_can_cause_again_and_again_by_talking_is_marked(officials: Officials) -> None:
    officials.to_grid()
    talk = [GRID_ACTIVE, IN_GARAGE, GRID_ACTIVE, RED_FLAG, IN_GARAGE]
    events = [event for state in talk for event in officials.says(1, state).events]
    assert [(event.kind, event.chatter) for event in events] == [
        (EventKind.ACKNOWLEDGED, False),
        (EventKind.WITHDRAWN, True),
        (EventKind.ACKNOWLEDGED, True),
        (EventKind.WITHDRAWN, True),
        (EventKind.REPORTED, True),
    ]


def test_a_kart_lost_in_motion_calls_for_the_msr_until_it_is_back_and_stands(
    officials: Officials,
) -> None:
    officials.to_green().drop(2)
    officials.connect(2)
    assert officials.alerts() == {
        AlertKind.LOST_IN_MOTION: (
            'Kart 2 (Volta) lost its connection while it may have been moving. '
            'It is back but has not stopped yet'
        )
    }
    officials.acknowledge(2)
    assert officials.alerts() == {}


CURE = (
    'reported RED_RED, perhaps in answer to an earlier command (if waiting does not help, it must '
    'reconnect, and will be held)'
)


@pytest.mark.parametrize('over', ['it counts', 'another connection', 'another state'])
def test_a_word_that_cannot_count_yet_is_told_once_with_its_cure_until_that_is_over(
    over: str, officials: Officials
) -> None:
    officials.does('ALL_KILL')
    race, kart = officials.race, officials.race.karts[1]
    for since, told in ((0.0, [EventKind.REPORTED]), (0.5, [])):
        outcome = race.heard(1, kart.serial - 1, RED_RED, officials.now + since, 2.0)
        assert kinds(outcome) == told
        assert all(CURE in event.text for event in outcome.events)
        assert kart.counts_at == officials.now + since + 2.0
    assert CURE in officials.is_refused('IN_GARAGE')
    if over == 'it counts':
        officials.acknowledge(1)
    elif over == 'another connection':
        officials.connect(1)
    else:
        officials.says(1, RED_FLAG)
    assert 'perhaps' not in officials.is_refused('IN_GARAGE')


# ----- alerts -----------------------------------------------------------------------------


def test_an_alert_is_told_once_when_it_comes_and_once_when_it_goes(officials: Officials) -> None:
    officials.to_over().acknowledge(1)
    assert EventKind.ALERT_RAISED in kinds(officials.wait(5.0))
    assert kinds(officials.wait(1.0)) == []
    officials.acknowledge(2)
    cleared = officials.wait(0.0).events
    assert [event.text for event in cleared if event.kind is EventKind.ALERT_CLEARED] == [
        'Alert ended: RED UNACKNOWLEDGED, kart 2 (Volta)'
    ]


def test_a_grade_is_told_when_it_changes(officials: Officials) -> None:
    outcomes = [
        officials.measure(1, grade) for grade in (Grade.GOOD, Grade.GOOD, Grade.FAIR, Grade.FAIR)
    ]
    told = [event for outcome in outcomes for event in outcome.events]
    assert [(each.kind, each.grade) for each in told] == [
        (EventKind.LINK_GRADE, Grade.GOOD),
        (EventKind.LINK_GRADE, Grade.FAIR),
    ]


def test_a_kart_that_may_read_late_has_a_poor_link_that_says_so(officials: Officials) -> None:
    link = NOT_MEASURED._replace(grade=Grade.POOR, worst_answer=0.01, behind=1.2)
    (event,) = officials.race.measured(1, link, officials.now).events
    assert event.text.endswith('the kart may read a stop 1.2 s late')
    assert 'kart 1 (Ohm) may read a stop 1.2 s late' in officials.alerts()[AlertKind.LINK_POOR]


def test_a_link_that_was_poor_is_remembered_for_a_minute_however_often_it_was_lost(
    officials: Officials,
) -> None:
    def names() -> list[int]:
        shown = snapshot_of(officials.race, officials.now).karts
        return [kart.number for kart in shown if kart.poor_lately]

    assert names() == []
    officials.measure(2, Grade.POOR)
    officials.drop(2)
    officials.connect(2)
    officials.measure(2, Grade.GOOD)
    officials.now += POOR_LATELY - 0.1
    assert names() == [2]
    officials.now += 0.1
    assert names() == []


def test_only_the_present_order_is_told_to_have_arrived_and_once(officials: Officials) -> None:
    def arrives(serial: int) -> list[EventKind]:
        answered = officials.now - 0.03
        return kinds(officials.race.delivered(1, serial, answered, officials.now))

    kart = officials.race.karts[1]
    old = kart.serial
    officials.does('ALL_KILL')
    officials.now += 0.1
    assert arrives(old) == []
    assert kart.delivered_after is None
    assert arrives(kart.serial) == [EventKind.DELIVERED]
    assert arrives(kart.serial) == []
    assert kart.delivered_after == pytest.approx(0.07)
    officials.acknowledge(1)
    assert kart.acknowledged_after == pytest.approx(0.1)
    officials.drop(1)
    assert (kart.delivered_after, kart.acknowledged_after) == (None, None)


def test_alerts_come_newest_first(officials: Officials) -> None:
    officials.to_green().drop(1)
    officials.wait(1.0)
    officials.drop(2)
    officials.wait(0.1)
    assert [alert.kart for alert in officials.race.alerts(officials.now)] == [2, 1]


def test_of_a_kart_that_is_away_nobody_says_that_it_acknowledged(officials: Officials) -> None:
    officials.to_green().drop(1)
    officials.does('RECORD_MSR')
    officials.says(2, RED_RED)
    news = texts(officials.wait(5.0), EventKind.ALL_ACKNOWLEDGED)
    assert news == ['Every kart that the race is waiting for acknowledged RED_RED']


def test_without_a_connected_kart_humans_are_allowed_because_nothing_is_known_of_the_karts() -> (
    None
):
    access = Officials(connected=False).race.track_access()
    assert access.allowed
    assert (
        access.reason
        == 'no kart is connected, so race control does not know what the karts are doing'
    )


def test_a_stop_to_a_kart_that_is_not_in_the_roster_begins_a_pause_too() -> None:
    officials = Officials(RaceTimes(pause=1.0, settle_time=0.0))
    assert officials.is_refused('KART_RED_RED', 9).endswith(
        'the roster has no kart 9; it has 1, 2, 3; ALL_KILL stops every kart.'
    )
    assert officials.is_refused('GRID_ACTIVE').endswith(
        'refused: a stop was sent just now. Check the race, then send this command again.'
    )


# ----- what is wrong around race control --------------------------------------------------


def test_a_record_that_fails_in_other_words_is_no_new_alert(officials: Officials) -> None:
    officials.race.record_trouble('Disk full; 1 event waits', officials.now)
    officials.wait(0.1)
    officials.race.record_trouble('Disk full; 2 events wait', officials.now)
    assert not officials.wait(0.1).events
    assert officials.alerts() == {AlertKind.RECORD_FAILING: 'Disk full; 2 events wait'}


def test_a_start_without_proof_says_why_and_what_to_do_about_a_kart_that_left_the_roster() -> None:
    held = KartMemory(True, True, 1, Doubt.MOVING, False)
    memory, race = RaceMemory(GREEN_GREEN, {7: held}), Race([Kart(1)])
    events = race.recover(memory, LastRun.UNKNOWN, 0.0, 'nobody may ask who has 10.0.0.1').events
    assert [event.text for event in events if event.kart == 7] == [
        'Kart 7 (no longer in the roster) is held in RED_RED; find it, make it safe, then '
        'release it individually'
    ]
    assert 'nobody may ask who has 10.0.0.1' in race.state_cause


def begun(last_run: LastRun, memory: RaceMemory | None = None) -> Officials:
    """Return officials whose race control has just begun, before any kart connects."""
    officials = Officials(connected=False)
    officials.race.recover(memory, last_run, officials.now)
    return officials


def test_at_the_first_start_the_track_is_opened_on_a_statement_about_all_machines() -> None:
    assert 'state that no race is under way anywhere, and no kart is moving' in begun(
        LastRun.NONE
    ).is_refused('OPEN_TRACK', statement=False)


def test_an_opening_that_this_run_does_not_know_is_refused_and_named(officials: Officials) -> None:
    refusal = officials.is_refused('GRID_ACTIVE', opening=3)
    assert 'you named opening 3, but the track has not been opened' in refusal


def test_the_grid_closes_the_track_that_the_official_saw_and_no_later_opening(
    officials: Officials,
) -> None:
    looked = officials.race.opening
    officials.does('OPEN_TRACK')
    refusal = officials.is_refused('GRID_ACTIVE', opening=looked)
    assert 'the track was opened since you looked (by an official, 0 s ago)' in refusal
    officials.does('GRID_ACTIVE')
    assert not officials.race.track_open


def test_the_statement_after_a_start_without_proof_names_the_karts_that_say_nothing() -> None:
    officials = begun(LastRun.UNKNOWN)
    officials.wait(RaceTimes().pause_after_stall)
    refusal = officials.is_refused('IN_GARAGE', statement=False)
    assert 'have not confirmed a stop: kart 1 (Ohm); kart 2 (Volta); kart 3 (Tesla)' in refusal


def test_what_cut_race_control_off_is_said(officials: Officials) -> None:
    is_cut_off(officials)
    assert 'race control was cut off from the karts (eth0 has' in officials.race.state_cause


def test_every_kart_that_is_silent_at_once_is_race_control_that_is_cut_off(
    officials: Officials,
) -> None:
    for kart in TEAMS:
        officials.race.disconnected(kart, 'it stopped answering', officials.now, silent=True)
    assert officials.all_sent() == [RED_RED, RED_RED, RED_RED]
    assert 'no kart answers: kart 1 (Ohm); kart 2' in officials.race.state_cause


def test_two_programs_of_one_kart_are_an_alert_and_what_they_cause_is_marked(
    officials: Officials,
) -> None:
    two_programs_connect(officials)
    assert officials.alerts() == {
        AlertKind.TWO_PROGRAMS: (
            'Two programs keep connecting as kart 1 (Ohm): have the team stop one of them'
        )
    }
    assert all(event.chatter for event in officials.connect(1).events)


def test_a_kart_that_stops_itself_is_an_alert_that_says_so(officials: Officials) -> None:
    officials.to_green().says(1, RED_RED)
    officials.wait(30.0)
    assert officials.alerts() == {
        AlertKind.GREEN_UNACKNOWLEDGED: 'Kart 1 (Ohm) stopped itself while being sent GREEN_GREEN'
    }


@pytest.mark.parametrize(('age', 'said'), [(0.0, ''), (3.0, ''), (65.4, 'pressed 65 s ago')])
@pytest.mark.parametrize('kind', [kind for kind, entry in CATALOGUE.items() if entry.stop])
def test_a_stop_that_was_pressed_long_ago_says_so_wherever_it_is_named(
    kind: CommandKind, age: float, said: str, officials: Officials
) -> None:
    officials.to_green().wait(1.0)
    kart = 1 if CATALOGUE[kind].to_one_kart else 0
    outcome = officials.does(kind.name, kart, official='Anna', age=age)
    message = outcome.events[0].text
    assert message.endswith(f' {kind.value} was {said}.') if said else 'pressed' not in message
    assert outcome.answer == Answer(True, message)
    cause = officials.race.karts[1].hold_reason if kart else officials.race.state_cause
    by = 'RED_RED' if kind is CommandKind.KART_RED_RED else 'RED_FLAG' if kart else kind.value
    assert cause == (f'{by} by Anna, {said}' if said else f'{by} by Anna')
