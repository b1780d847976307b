# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What officials read in a race, by example; what karts are sent is the oracle's (race_oracle)."""

from __future__ import annotations

from typing import Any

from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState
from evgp_rcs.rules import inputs
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.inputs import Setup
from evgp_rcs.rules.link_quality import POOR_LATELY
from evgp_rcs.rules.race import (
    AlertKind,
    Answer,
    Doubt,
    Entrant,
    EventKind,
    Heat,
    KartMemory,
    LastRun,
    Outcome,
    RaceMemory,
    RaceTimes,
)
from evgp_rcs.rules.snapshot import snapshot_of
import pytest
from recorded_races import NO_PAUSE, PaperRace

GRID_ACTIVE = RaceState.GRID_ACTIVE
IN_GARAGE = RaceState.IN_GARAGE
RED_FLAG = RaceState.RED_FLAG
RED_RED = RaceState.RED_RED

TEAMS = {1: 'Ohm', 2: 'Volta', 3: 'Tesla'}
SPECTATOR = 3
HEATS = (Heat('Heat 1', (1, 2)), Heat('Final', (2, 3)))


class Officials(PaperRace):
    """Karts 1 and 2 in the race, kart 3 outside it, all connected; and a clock that is moved."""

    def __init__(self, teams: dict[int, str] = TEAMS) -> None:
        karts = [Entrant(number, team, number != SPECTATOR) for number, team in teams.items()]
        super().__init__({}, setup=Setup(tuple(karts), NO_PAUSE, HEATS, 1000.0))
        self.connect(*teams)

    def does(self, kind: str, kart: int = 0, **fields: Any) -> Outcome:
        """Give a command that is to be accepted."""
        fields = {'heat': HEATS[0].name, 'official': '', **fields}
        outcome = self.command(CommandKind[kind], kart, **fields)
        assert outcome.answer is not None
        assert outcome.answer.success, outcome.answer.message
        return outcome

    def is_refused(self, kind: str, kart: int = 0, **fields: Any) -> str:
        """Give a command that is to be refused, and return what the official reads."""
        outcome = self.command(CommandKind[kind], kart, **fields)
        assert outcome.answer is not None
        assert not outcome.answer.success, outcome.answer.message
        assert not outcome.orders
        return outcome.answer.message

    def tick(self, seconds: float = 0.0) -> Outcome:
        """Let time pass that race control notices at the end only."""
        self.now += seconds
        return self.feed(inputs.Tick(self.now))

    def begin_again(self, last_run: LastRun, memory: RaceMemory | None = None) -> None:
        """Have race control begin, before any kart connects."""
        self.race = self.setup.race('')
        self.feed(inputs.Recovered(self.now, memory, last_run, 'nobody may ask who has 10.0.0.1'))

    def without_heats(self) -> None:
        self.race.heats = ()

    def alerts(self) -> dict[AlertKind, str]:
        return {alert.kind: alert.text for alert in self.race.alerts(self.now)}


@pytest.fixture
def officials() -> Officials:
    return Officials()


def kinds(outcome: Outcome) -> list[EventKind]:
    return [event.kind for event in outcome.events]


def texts(outcome: Outcome, kind: EventKind) -> list[str]:
    return [event.text for event in outcome.events if event.kind is kind]


def rows(table: dict[str, dict[str, str]]) -> list[tuple[str, int, str, str]]:
    """Return the rows of a table: a command and its kart, a story, and what is read then."""
    found = []
    for command, stories in table.items():
        kind, _, kart = command.partition(' ')
        found += [(kind, int(kart or 0), story, text) for story, text in stories.items()]
    return found


# ----- what officials read when a command is refused, or carried out -----------------------

REFUSALS = {
    'GRID_ACTIVE': {
        'KART_RED_FLAG 2': 'karts in the race are held; release them first: kart 2 (Volta): '
        'RED_FLAG by Ada',
        'say 3 GREEN_GREEN, JOIN_RACE 3': 'kart 3 (Tesla) may be moving: stop it with RED_RED',
        'KART_RED_RED 3': 'kart 3 (Tesla) has not acknowledged RED_RED',
        'rival': 'another race control is running; shut it down first. Every stop still works',
        'two programs': 'two programs keep connecting as kart 1 (Ohm); have the team stop one of '
        'them',
        'full disk': 'The disk is full. A race cannot start without a record. Make room on the '
        'disk, or restart race control with the parameter record set to a path on another disk. '
        'As a last resort, use /dev/shm',
    },
    'GREEN_GREEN': {
        'GRID_ACTIVE, lose 2': 'waiting for kart 1 (Ohm): has not acknowledged GRID_ACTIVE; '
        'kart 2 (Volta): not connected',
        'drive, RED_FLAG': 'the race is in RED_FLAG; GREEN_GREEN is possible only in GRID_ACTIVE',
        'GRID_ACTIVE, KART_RED_FLAG 3': 'another command was sent after GRID_ACTIVE; send '
        'GRID_ACTIVE again',
        'anna, GRID_ACTIVE, acknowledge, nobody': 'race control is no longer in contact with any '
        'screen or button that can stop the race; open a window, or start again from IN_GARAGE',
        'GRID_ACTIVE, acknowledge, say 1 RED_RED': 'waiting for kart 1 (Ohm): stopped itself; '
        'take it out of the race, or start again from IN_GARAGE',
        'GRID_ACTIVE, acknowledge, say 1 IN_GARAGE': 'waiting for kart 1 (Ohm): withdrew its '
        'acknowledgement of GRID_ACTIVE',
    },
    'IN_GARAGE': {
        'drive, RACE_OVER, acknowledge 1': 'waiting for kart 2 (Volta): has not acknowledged '
        'RED_RED. If a kart does not answer, use the MSR and record its use, or, if the kart is '
        'off the track, make it safe by hand and release it individually',
        'drive, no cable': 'race control is still cut off from the karts: eth0 has no cable',
    },
    'SET_HEAT': {
        'without_heats': "the roster has no heats; list them under 'heats:' and read it again",
    },
    'KART_IN_GARAGE 1': {
        'drive': 'kart 1 (Ohm) is being sent GREEN_GREEN; only a kart sent a red can be released. '
        'Stop it with RED_RED first',
    },
    'LEAVE_RACE 1': {
        'drive': 'the race is in GREEN_GREEN; LEAVE_RACE is possible only in IN_GARAGE or '
        'GRID_ACTIVE. Stop the kart with RED_RED instead',
    },
    'OPEN_TRACK': {
        'say 3 GREEN_GREEN': 'kart 3 (Tesla) may be moving: stop it with RED_RED',
        'drive, lose 1, RACE_OVER, acknowledge 2': 'kart 1 (Ohm) was lost while it may have been '
        'moving: use the MSR',
        'GRID_ACTIVE, lose 1, RED_FLAG, acknowledge 2': 'kart 1 (Ohm) was lost on the grid. Wait '
        'until it is back and has acknowledged a stop, or use the MSR and record its use, or, if '
        'the team has the kart off the track, make it safe by hand, send it RED_RED and release '
        'it individually',
    },
}


@pytest.mark.parametrize(('kind', 'kart', 'story', 'reason'), rows(REFUSALS))
def test_a_refusal_says_what_is_in_the_way(
    kind: str, kart: int, story: str, reason: str, officials: Officials
) -> None:
    officials.go(story)
    assert officials.race.availability(CommandKind[kind], kart, officials.now).reason == reason
    assert officials.is_refused(kind, kart) == f'{kind} refused: {reason}.'


ANSWERS = {
    'ALL_KILL': {
        'lose 3': 'RED_RED sent to karts 1, 2; once connected, also to: kart 3 (Tesla)',
    },
    'RED_FLAG': {
        'drive, KART_RED_RED 2': 'RED_FLAG sent to kart 1',
        'drive, RACE_OVER': 'The race is already in RED_RED, which is stricter than RED_FLAG',
    },
    'KART_RED_RED 3': {'lose 3': 'Kart 3 (Tesla) is held in RED_RED, but it is not connected'},
    'IN_GARAGE': {
        'drive, RACE_OVER, KART_RED_FLAG 3, acknowledge': 'IN_GARAGE sent to karts 1, 2. Still '
        'held until released individually: kart 3 (Tesla)',
    },
    'KART_IN_GARAGE 1': {
        'drive, KART_RED_RED 1': 'Kart 1 (Ohm) is released to IN_GARAGE and is out of the race',
    },
    'SET_HEAT': {
        'KART_RED_RED 2, lose 1': '"Heat 1" is now in the race (karts 1, 2), with no other karts. '
        'Still held: kart 2 (Volta): RED_RED by Ada',
    },
    'KART_UNDO_FINISH 1': {
        'drive, KART_FINISH 1, KART_FINISH 2': 'Kart 1 (Ohm) no longer has a place, and is still '
        'being sent GREEN_GREEN',
        'drive, KART_FINISH 1, wait 6': 'Kart 1 (Ohm) no longer has a place, and is still being '
        'sent RED_FLAG',
    },
    'OPEN_TRACK': {
        'lose 1, lose 2, lose 3': 'The track is open to humans: no kart is connected, so race '
        'control does not know what the karts are doing',
    },
}


@pytest.mark.parametrize(('kind', 'kart', 'story', 'message'), rows(ANSWERS))
def test_an_answer_says_who_is_sent_what_and_who_is_not(
    kind: str, kart: int, story: str, message: str, officials: Officials
) -> None:
    officials.go(story)
    assert officials.does(kind, kart).answer == Answer(True, f'{message}.')


STATEMENTS = {
    'GRID_ACTIVE': {'': 'state that the track is clear of humans (this command closes it)'},
    'IN_GARAGE': {
        'drive, RACE_OVER, acknowledge': 'state that the track is safe for humans',
        'begin_again UNKNOWN, wait 5': 'state that the track is safe for humans, no race is under '
        'way anywhere, and no kart is moving, not even those that have not confirmed a stop: '
        'kart 1 (Ohm); kart 2 (Volta); kart 3 (Tesla)',
    },
    'OPEN_TRACK': {
        'begin_again NONE': 'state that no race is under way anywhere, and no kart is moving',
    },
    'RECORD_MSR': {'drive, RACE_OVER': 'state that the Master Safety Remote was used'},
    'KART_IN_GARAGE 1': {
        'KART_RED_RED 1': 'kart 1 (Ohm): has not acknowledged RED_RED. Wait for it, or state that '
        'kart 1 (Ohm) was made safe by hand',
    },
}


@pytest.mark.parametrize(('kind', 'kart', 'story', 'wanted'), rows(STATEMENTS))
def test_a_refusal_says_what_must_be_stated(
    kind: str, kart: int, story: str, wanted: str, officials: Officials
) -> None:
    officials.go(story)
    assert officials.is_refused(kind, kart, statement=False) == f'{kind} refused: {wanted}.'
    officials.does(kind, kart)


def test_a_refusal_says_what_is_named_wrong(officials: Officials) -> None:
    refused = 'GRID_ACTIVE refused: '
    assert officials.is_refused('GRID_ACTIVE', opening=3) == (
        f'{refused}you named opening 3, but the track has not been opened.'
    )
    officials.does('OPEN_TRACK')
    assert officials.is_refused('GRID_ACTIVE', opening=0) == (
        f'{refused}the track was opened since you looked (by an official, 0 s ago); make sure '
        'that nobody is on it, then send this command again.'
    )


def test_a_stop_to_a_kart_that_is_not_in_the_roster_begins_a_pause_too(
    officials: Officials,
) -> None:
    officials.race.times = RaceTimes()
    assert officials.is_refused('KART_RED_RED', 9).endswith(
        'the roster has no kart 9; it has 1, 2, 3; ALL_KILL stops every kart.'
    )
    assert officials.is_refused('GRID_ACTIVE').endswith(
        'refused: a stop was sent just now. Check the race, then send this command again.'
    )


def test_a_long_refusal_names_three_karts_but_every_number_to_paste() -> None:
    officials = Officials(dict.fromkeys(range(1, 23), ''))
    numbers = [*officials.race.availability(CommandKind.GRID_ACTIVE, 0, officials.now).karts]
    assert len(numbers) == 21
    refusal = f'GRID_ACTIVE refused: no kart is named. Add karts: {numbers}.'
    assert officials.is_refused('GRID_ACTIVE', karts=frozenset()) == refusal
    officials.go('GRID_ACTIVE, lose 1, lose 2, lose 4')
    assert officials.is_refused('GREEN_GREEN') == (
        'GREEN_GREEN refused: waiting for kart 1: not connected; kart 2: not connected; '
        'kart 4: not connected; and 18 more karts.'
    )


def test_the_last_delay_serves_all_further_places() -> None:
    times = RaceTimes(finish_delays=(3.0, 1.0))
    assert [times.finish_delay(place) for place in (1, 2, 3, 40)] == [3.0, 1.0, 1.0, 1.0]


def test_officials_are_told_once_when_every_kart_has_acknowledged(officials: Officials) -> None:
    officials.go('drive, RACE_OVER')
    officials.say(1, RED_RED)
    assert EventKind.ALL_ACKNOWLEDGED not in kinds(officials.tick(0.05))
    officials.say(2, RED_RED)
    news = texts(officials.tick(0.05), EventKind.ALL_ACKNOWLEDGED)
    assert news == ['Every kart in the race acknowledged RED_RED']
    assert EventKind.ALL_ACKNOWLEDGED not in kinds(officials.tick(1.0))


def test_of_a_kart_that_is_away_nobody_says_that_it_acknowledged(officials: Officials) -> None:
    officials.go('drive')
    officials.lose(1)
    officials.does('RECORD_MSR')
    officials.say(2, RED_RED)
    news = texts(officials.tick(), EventKind.ALL_ACKNOWLEDGED)
    assert news == ['Every kart that the race is waiting for acknowledged RED_RED']


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


def test_what_a_kart_says_unasked_is_reported_once_and_in_garage_is_only_reported(
    officials: Officials,
) -> None:
    (told,) = officials.say(1, IN_GARAGE).events
    assert told.text == 'Kart 1 (Ohm) reports IN_GARAGE'
    officials.go('GRID_ACTIVE, acknowledge')
    (told,) = officials.say(1, RED_RED).events
    assert told.text == (
        'Kart 1 (Ohm) reports RED_RED, so its acknowledgement of GRID_ACTIVE no longer counts'
    )
    assert not officials.say(1, RED_RED).events
    (told,) = officials.say(1, RED_FLAG).events
    assert told.text == 'Kart 1 (Ohm) reports RED_FLAG while being sent GRID_ACTIVE'


def test_what_a_kart_can_cause_again_and_again_by_talking_is_marked(officials: Officials) -> None:
    officials.does('GRID_ACTIVE')
    talk = [GRID_ACTIVE, IN_GARAGE, GRID_ACTIVE, RED_FLAG, IN_GARAGE]
    events = [event for state in talk for event in officials.say(1, state).events]
    assert [(event.kind, event.chatter) for event in events] == [
        (EventKind.ACKNOWLEDGED, False),
        (EventKind.WITHDRAWN, True),
        (EventKind.ACKNOWLEDGED, True),
        (EventKind.WITHDRAWN, True),
        (EventKind.REPORTED, True),
    ]


CURE = (
    'reported RED_RED, perhaps in answer to an earlier command (if waiting does not help, it must '
    'reconnect, and will be held)'
)


@pytest.mark.parametrize('over', ['it counts', 'another connection', 'another state'])
def test_a_word_that_cannot_count_yet_is_told_once_with_its_cure_until_that_is_over(
    over: str, officials: Officials
) -> None:
    officials.does('ALL_KILL')
    kart = officials.race.karts[1]
    for since, told in ((0.0, [EventKind.REPORTED]), (0.5, [])):
        now = officials.now + since
        outcome = officials.feed(inputs.Heard(now, 1, kart.serial - 1, RED_RED, 2.0))
        assert kinds(outcome) == told
        assert all(CURE in event.text for event in outcome.events)
        assert kart.counts_at == now + 2.0
    assert CURE in officials.is_refused('IN_GARAGE')
    if over == 'it counts':
        officials.acknowledge(1)
    elif over == 'another connection':
        officials.connect(1)
    else:
        officials.say(1, RED_FLAG)
    assert 'perhaps' not in officials.is_refused('IN_GARAGE')


# ----- alerts -----------------------------------------------------------------------------


ALERTS = {
    AlertKind.LOST_IN_MOTION: (
        'drive, lose 2, connect 2',
        'Kart 2 (Volta) lost its connection while it may have been moving. It is back but has not '
        'stopped yet',
    ),
    AlertKind.TWO_PROGRAMS: (
        'two programs',
        'Two programs keep connecting as kart 1 (Ohm): have the team stop one of them',
    ),
    AlertKind.GREEN_UNACKNOWLEDGED: (
        'drive, say 1 RED_RED, wait 30',
        'Kart 1 (Ohm) stopped itself while being sent GREEN_GREEN',
    ),
}


@pytest.mark.parametrize('kind', ALERTS)
def test_an_alert_says_what_is_wrong(kind: AlertKind, officials: Officials) -> None:
    story, text = ALERTS[kind]
    officials.go(story)
    assert officials.alerts() == {kind: text}


@pytest.mark.parametrize(
    ('story', 'what_to_do'),
    [
        ('late reader', 'LEAVE_RACE before GREEN_GREEN: kart 1'),
        ('GRID_ACTIVE, late reader', 'LEAVE_RACE before GREEN_GREEN: kart 1'),
        ('drive, late reader', 'Send RED_FLAG: kart 1'),
        ('drive, late reader, RED_FLAG', 'Kart 1'),
    ],
)
def test_the_alert_of_a_poor_link_says_only_what_helps_now(
    story: str, what_to_do: str, officials: Officials
) -> None:
    officials.go(story)
    said = f'{what_to_do} (Ohm) may read a stop 1.2 s late'
    assert officials.alerts() == {AlertKind.LINK_POOR: said}


def test_an_alert_is_told_once_when_it_comes_and_once_when_it_goes(officials: Officials) -> None:
    officials.go('drive, RACE_OVER')
    officials.acknowledge(1)
    assert EventKind.ALERT_RAISED in kinds(officials.tick(5.0))
    assert kinds(officials.tick(1.0)) == []
    officials.say(2)
    cleared = officials.tick().events
    assert [event.text for event in cleared if event.kind is EventKind.ALERT_CLEARED] == [
        'Alert ended: RED UNACKNOWLEDGED, kart 2 (Volta)'
    ]


def test_a_grade_is_told_when_it_changes_and_why_it_is_poor(officials: Officials) -> None:
    for grade in (Grade.GOOD, Grade.GOOD, Grade.FAIR, Grade.FAIR):
        officials.measure(1, grade)
    officials.go('late reader')
    told = [each.event for each in officials.stamped if each.event.kind is EventKind.LINK_GRADE]
    assert [each.grade for each in told] == [Grade.GOOD, Grade.FAIR, Grade.POOR]
    assert told[-1].text.endswith('is poor: the kart may read a stop 1.2 s late')


def test_a_link_that_was_poor_is_remembered_for_a_minute_however_often_it_was_lost(
    officials: Officials,
) -> None:
    def names() -> list[int]:
        shown = snapshot_of(officials.race, officials.now).karts
        return [kart.number for kart in shown if kart.poor_lately]

    assert names() == []
    officials.measure(2, Grade.POOR)
    officials.lose(2)
    officials.connect(2)
    officials.measure(2, Grade.GOOD)
    officials.now += POOR_LATELY - 0.1
    assert names() == [2]
    officials.now += 0.1
    assert names() == []


def test_only_the_present_order_is_told_to_have_arrived_and_once(officials: Officials) -> None:
    def arrives(serial: int) -> list[EventKind]:
        given = inputs.Delivered(officials.now, 1, serial, officials.now - 0.03)
        return kinds(officials.feed(given))

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
    officials.lose(1)
    assert (kart.delivered_after, kart.acknowledged_after) == (None, None)


def test_alerts_come_newest_first(officials: Officials) -> None:
    officials.go('drive')
    officials.lose(1)
    officials.wait(1.0)
    officials.lose(2)
    officials.wait(0.1)
    assert [alert.kart for alert in officials.race.alerts(officials.now)] == [2, 1]


def test_a_record_that_fails_in_other_words_is_no_new_alert(officials: Officials) -> None:
    officials.go('full disk, wait 1')
    officials.feed(inputs.RecordTrouble(officials.now, 'Disk full; 2 events wait'))
    assert not officials.tick(0.1).events
    assert officials.alerts() == {AlertKind.RECORD_FAILING: 'Disk full; 2 events wait'}


def test_a_start_without_proof_says_what_to_do_about_a_kart_that_left_the_roster(
    officials: Officials,
) -> None:
    held = KartMemory(True, True, 1, Doubt.MOVING, False)
    officials.begin_again(LastRun.UNKNOWN, RaceMemory(RaceState.GREEN_GREEN, {7: held}))
    assert [each.event.text for each in officials.stamped if each.event.kart == 7] == [
        'Kart 7 (no longer in the roster) is held in RED_RED; find it, make it safe, then '
        'release it individually'
    ]


CUT_OFF = 'race control was cut off from the karts'


@pytest.mark.parametrize(
    ('story', 'cause'),
    [
        ('drive, no cable', f'{CUT_OFF} (eth0 has no cable)'),
        (
            'silence 1, silence 2, silence 3',
            f'{CUT_OFF} (no kart answers: kart 1 (Ohm); kart 2 (Volta); kart 3 (Tesla))',
        ),
        (
            'begin_again UNKNOWN',
            'race control has started and does not know what happened before that: nobody may ask '
            'who has 10.0.0.1',
        ),
    ],
)
def test_why_race_control_went_to_red_red_by_itself_is_said(
    story: str, cause: str, officials: Officials
) -> None:
    officials.go(story)
    assert officials.race.state_cause == cause


def test_what_two_programs_of_one_kart_cause_is_marked(officials: Officials) -> None:
    officials.go('two programs')
    outcome = officials.feed(inputs.Connected(officials.now, 1))
    assert all(event.chatter for event in outcome.events)


@pytest.mark.parametrize(('age', 'said'), [(0.0, ''), (3.0, ''), (65.4, 'pressed 65 s ago')])
@pytest.mark.parametrize('kind', [kind for kind, entry in CATALOGUE.items() if entry.stop])
def test_a_stop_that_was_pressed_long_ago_says_so_wherever_it_is_named(
    kind: CommandKind, age: float, said: str, officials: Officials
) -> None:
    officials.go('drive')
    officials.wait(1.0)
    kart = 1 if CATALOGUE[kind].to_one_kart else 0
    outcome = officials.does(kind.name, kart, official='Anna', age=age)
    message = outcome.events[0].text
    assert message.endswith(f' {kind.value} was {said}.') if said else 'pressed' not in message
    assert outcome.answer == Answer(True, message)
    cause = officials.race.karts[1].hold_reason if kart else officials.race.state_cause
    by = 'RED_RED' if kind is CommandKind.KART_RED_RED else 'RED_FLAG' if kart else kind.value
    assert cause == (f'{by} by Anna, {said}' if said else f'{by} by Anna')
