# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What a screen shows for a snapshot."""

from __future__ import annotations

import itertools

from evgp_node.results import (
    Act,
    HeatGrid,
    Judged,
    KartResult,
    Mark,
    Passing,
    RaceOfEvent,
    Standings,
    Status,
    TIMING_GONE,
)
from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.link_quality import LinkQuality, NOT_MEASURED
from evgp_rcs.rules.race import (
    Alert,
    AlertKind,
    Availability,
    Event,
    EventKind,
    Heat,
    TrackAccess,
)
from evgp_rcs.rules.snapshot import KartSnapshot, NOTHING, Snapshot
from evgp_rcs.words import Cell, GONE_AFTER, STATE_CELLS, STATES, tally, time_of_day, Tone
from evgp_rcs_console import texts
from evgp_rcs_console.commands import request
from evgp_rcs_console.questions import question
from evgp_rcs_console.results import races
from evgp_rcs_console.view import (
    BARS,
    BEGINS_WITHIN,
    Button,
    Danger,
    FINISH_KEYS,
    KART_COMMANDS,
    Latest,
    RACE_COMMANDS,
    REMINDS_FOR,
    Screen,
    table,
    UNDONE_BY,
)
from example_race import KART, offers, RACE, replace, warning
import pytest

OFFERED = Availability(CommandKind.GREEN_GREEN, True)
SILENT = Danger('gone', 'MSR', 'long ago', texts.GONE_REASON, stale=True)


def link(grade: Grade, **figures: float) -> LinkQuality:
    return NOT_MEASURED._replace(grade=grade, **figures)  # type: ignore[arg-type]


def with_kart(**changes: object) -> Screen:
    """Return the screen of a race in which some fields of the only kart differ."""
    kart = replace(KART, **changes)  # type: ignore[arg-type]
    return Screen(replace(RACE, karts=(kart,)), 0.0, {})


def timing(**fields: object) -> Standings:
    """Return the timekeeper's present results of the race in these tests."""
    return replace(Standings(RACE.stamp, laps=6), **fields)


def driven(kart: int, laps: int) -> KartResult:
    """Return the result of a kart that has driven some laps, each in 10 s."""
    return KartResult(kart, 1, Status.RUNNING, laps, 10.0 * laps, (10.0,) * laps, ())


def test_a_command_that_a_pause_refuses_shows_in_how_many_seconds_it_is_possible_again() -> None:
    why = 'a stop was sent just now'
    commands = offers(Availability(CommandKind.IN_GARAGE, False, why, available_from=44.6))

    said = []
    for age in (0.0, 1.0, 4.5, 4.7):
        button = Screen(replace(RACE, commands=commands), age, {}).button(CommandKind.IN_GARAGE)
        assert button is not None
        assert not button.enabled  # until race control says so
        said.append(button.reason)

    assert said == [f'possible again in {seconds} s: {why}' for seconds in (5, 4, 1, 1)]


def test_every_command_that_loosens_asks_for_a_condition_and_no_stop_but_the_statement_does() -> (
    None
):
    screen = Screen(RACE, 0.0, {})
    buttons = [*screen.race, screen.msr_button, *screen.rows[0].buttons]

    asking = {button.command for button in buttons if button.asks}

    assert asking == {
        CommandKind.GRID_ACTIVE,
        CommandKind.GREEN_GREEN,
        CommandKind.IN_GARAGE,
        CommandKind.RECORD_MSR,
        CommandKind.KART_IN_GARAGE,
    }
    assert screen.track_button.asks


def button_of(command: CommandKind, offered: Availability, **changes: object) -> Button:
    """Return the button of a command, given its availability and the fields of the kart."""
    commands = offers(offered._replace(command=command))
    kart = replace(KART, commands=commands, **changes)  # type: ignore[arg-type]
    others = tuple(replace(KART, number=n, sent=RaceState.RED_RED) for n in (1, 2, 3))
    race = replace(RACE, commands=commands, karts=(*others, kart))
    button = Screen(race, 0.0, {}).button(command, 7 if CATALOGUE[command].to_one_kart else 0)
    assert button is not None
    return button


def test_a_release_says_and_sends_the_hold_that_it_ends() -> None:
    offered = OFFERED._replace(karts=(7,))
    button = button_of(
        CommandKind.KART_IN_GARAGE, offered, hold=RaceState.RED_RED, hold_reason='ALL_KILL'
    )

    assert 'Releases kart 7 (Purdue): RED RED, ALL_KILL.' in (button.question().consequences)
    assert request(button.gives, 0.0)['hold'] is RaceState.RED_RED


@pytest.mark.parametrize(
    ('command', 'field'),
    [
        (CommandKind.GRID_ACTIVE, 'track_clear'),
        (CommandKind.IN_GARAGE, 'track_safe'),
        (CommandKind.KART_IN_GARAGE, 'made_safe_by_hand'),
    ],
)
def test_a_statement_is_sent_only_if_race_control_asked_for_it_in_its_words(
    command: CommandKind, field: str
) -> None:
    asked = button_of(command, OFFERED._replace(statement='something is so'))
    not_asked = button_of(command, OFFERED)

    assert 'something is so' in asked.question().condition
    assert asked.gives.stated
    assert request(asked.gives, 0.0)[field] is True
    assert not_asked.question().condition
    assert request(not_asked.gives, 0.0)[field] is False


@pytest.mark.parametrize(
    'offered',
    [
        OFFERED._replace(statement='one', karts=(1, 2, 3)),
        OFFERED._replace(statement='other', karts=(1, 2)),
        OFFERED._replace(karts=(1, 2)),
    ],
)
def test_a_question_about_other_karts_another_statement_or_hold_is_another_question(
    offered: Availability,
) -> None:
    asked = button_of(CommandKind.GREEN_GREEN, OFFERED._replace(statement='one', karts=(1, 2)))

    assert not asked.asks_the_same(button_of(CommandKind.GREEN_GREEN, offered))
    assert asked.asks_the_same(replace(asked, reason='not now', label='other'))
    other_hold = replace(asked.gives, hold=RaceState.RED_FLAG)
    assert not asked.asks_the_same(replace(asked, gives=other_hold))


def offering(
    command: CommandKind,
    karts: tuple[KartSnapshot, ...],
    track: TrackAccess = RACE.track,
    state: RaceState = RACE.state,
) -> Button:
    """Return the button of a command to the race that race control offers for kart 7."""
    commands = offers(Availability(command, True, karts=(7,)))
    race = replace(RACE, state=state, commands=commands, karts=karts, track=track)
    button = Screen(race, 0.0, {}).button(command)
    assert button is not None
    return button


def test_a_question_names_the_karts_that_stay_held_and_why() -> None:
    held = replace(KART, number=4, hold=RaceState.RED_RED, hold_reason='lost its connection')

    button = offering(CommandKind.IN_GARAGE, (held, KART))

    said = '\n'.join(button.question().consequences)
    assert 'now to kart 7.' in said
    assert 'Stays held: kart 4 (Purdue): RED RED, lost its connection.' in said


NO_RACE_YET = replace(
    RACE.track, reason='nobody has stated it yet', settled_by=CommandKind.OPEN_TRACK
)


@pytest.mark.parametrize(
    ('command', 'settled_by', 'warned'),
    [
        (CommandKind.IN_GARAGE, CommandKind.IN_GARAGE, False),
        (CommandKind.OPEN_TRACK, CommandKind.IN_GARAGE, True),
        (CommandKind.KART_IN_GARAGE, CommandKind.IN_GARAGE, True),
        (CommandKind.OPEN_TRACK, CommandKind.OPEN_TRACK, False),
        (CommandKind.IN_GARAGE, None, True),
    ],
)
def test_no_question_warns_of_what_it_settles_by_itself(
    command: CommandKind, settled_by: CommandKind | None, warned: bool
) -> None:
    track = replace(RACE.track, reason='look at every kart, then send it', settled_by=settled_by)
    race = replace(RACE, state=RaceState.RED_RED, track=track)

    offered = Availability(command, True)
    assert bool(question(command, race, offered, None, None).warning) is warned
    doubtful = replace(KART, sent=RaceState.RED_RED, may_be_moving=True)
    doubted = replace(race, karts=(doubtful,))
    assert question(command, doubted, offered, None, None).warning


@pytest.mark.parametrize('statement', ['', 'no race is under way anywhere'])
def test_to_open_the_track_under_the_msr_the_official_states_that_every_kart_stands(
    statement: str,
) -> None:
    def condition(msr_used: bool) -> str:
        track = replace(RACE.track, allowed=True, msr_used=msr_used)
        offered = Availability(CommandKind.OPEN_TRACK, True, statement=statement)
        button = Screen(replace(RACE, track=track, commands=offers(offered)), 0.0, {}).track_button
        assert statement in button.question().condition
        return button.question().condition

    assert 'every kart is standing still' in condition(True)
    assert 'every kart is standing still' not in condition(False)


def test_the_release_of_a_kart_that_needs_the_msr_recedes_and_stays_possible() -> None:
    stopped = replace(KART, sent=RaceState.RED_RED)
    told = Alert(AlertKind.RED_UNACKNOWLEDGED, 7, 0.0, 'it drives', True)

    def release(*alerts: Alert) -> Button:
        screen = Screen(replace(RACE, karts=(stopped,), alerts=alerts), 0.0, {})
        button = screen.button(CommandKind.KART_IN_GARAGE, 7)
        assert button is not None
        return button

    assert (release().recedes, release(told).recedes) == (False, True)
    assert release(told).enabled
    row = Screen(replace(RACE, karts=(stopped,), alerts=(told,)), 0.0, {}).rows[0]
    assert [each.command for each in row.buttons if each.recedes] == [CommandKind.KART_IN_GARAGE]


@pytest.mark.parametrize(
    ('is_open', 'connected', 'allowed', 'msr', 'text', 'tone'),
    [
        (True, True, True, False, texts.TRACK_OPEN, Tone.GOOD),
        (True, True, False, False, texts.CLEAR_TRACK, Tone.BAD),
        (True, False, False, False, texts.CLEAR_TRACK, Tone.BAD),
        (True, False, True, False, texts.UNHEARD_OPEN, Tone.WAIT),
        (True, False, True, True, texts.TRACK_OPEN, Tone.GOOD),
        (False, True, True, False, texts.TRACK_CLOSED, Tone.PLAIN),
        (False, True, False, False, texts.KEEP_OFF, Tone.WAIT),
        (False, False, False, False, texts.KEEP_OFF, Tone.WAIT),
        (False, False, True, False, texts.UNHEARD_CLOSED, Tone.PLAIN),
        (False, False, True, True, texts.TRACK_CLOSED, Tone.PLAIN),
    ],
)
def test_humans_are_allowed_only_on_an_open_track_and_not_because_no_kart_is_connected(
    is_open: bool, connected: bool, allowed: bool, msr: bool, text: str, tone: Tone
) -> None:
    track = TrackAccess(open=is_open, allowed=allowed, reason='so it is', msr_used=msr)

    karts = (replace(KART, connected=connected, sent=RaceState.RED_RED),)
    screen = Screen(replace(RACE, state=RaceState.RED_RED, karts=karts, track=track), 0.0, {})

    assert (screen.humans.text, screen.humans.tone) == (text, tone)
    unknown = text in (texts.UNHEARD_CLOSED, texts.UNHEARD_OPEN)
    assert ('so it is' in screen.humans_reason) is not unknown


def test_in_a_green_race_a_kart_that_is_held_is_not_the_only_reason_to_keep_off() -> None:
    driving = replace(KART, sent=RaceState.GREEN_GREEN, acknowledged=True, may_be_moving=True)
    held = replace(driving, number=8, sent=RaceState.RED_RED, hold=RaceState.RED_RED)
    track = replace(RACE.track, reason='the race is in GREEN_GREEN')
    race = replace(RACE, state=RaceState.GREEN_GREEN, track=track)

    normal = Screen(replace(race, karts=(driving,)), 0.0, {})
    one_held = Screen(replace(race, karts=(driving, held)), 0.0, {})

    assert normal.humans == Cell(texts.KEEP_OFF)  # nothing is wrong
    for screen in (normal, one_held):
        assert 'the race is in GREEN GREEN' in screen.humans_reason
    assert 'kart 8 may be moving' in one_held.humans_reason
    assert one_held.humans.tone is Tone.WAIT
    lost = Alert(AlertKind.LOST_IN_MOTION, 8, 0.0, 'kart 8 was lost', True)
    both = Screen(replace(race, karts=(driving, held), alerts=(lost,)), 0.0, {})
    assert (both.humans.tone, 'kart 8 was lost' in both.humans_reason) == (Tone.BAD, True)


def test_at_a_first_start_the_track_is_closed_and_nothing_is_wrong() -> None:
    race = replace(RACE, state=RaceState.IN_GARAGE, track=NO_RACE_YET)
    race = replace(race, karts=(replace(KART, sent=RaceState.IN_GARAGE),))

    assert Screen(race, 0.0, {}).humans == Cell(texts.TRACK_CLOSED)
    doubtful = replace(race.karts[0], may_be_moving=True)
    assert Screen(replace(race, karts=(doubtful,)), 0.0, {}).humans.tone is Tone.BAD


def test_nothing_is_yellow_while_a_race_goes_as_it_should() -> None:
    track = TrackAccess(False, False, 'the race is under way', False)
    for place, sent in ((0, RaceState.GREEN_GREEN), (1, RaceState.RED_FLAG)):
        kart = replace(KART, sent=sent, reported=sent, acknowledged=True, place=place)
        race = replace(RACE, state=RaceState.GREEN_GREEN, karts=(kart,), track=track)
        screen = Screen(race, 0.0, {})
        assert Tone.WAIT not in (screen.humans.tone, screen.state.tone)
        assert any(each.is_next for each in screen.race) is bool(place)
    for others in ((), (kart,)):
        lost = replace(race, karts=(replace(kart, number=8, place=0), *others))
        assert Screen(lost, 0.0, {}).state.tone is Tone.WAIT


def test_no_step_is_the_next_while_karts_drive_to_their_flag_or_only_the_msr_stops_one() -> None:
    driving = replace(KART, sent=RaceState.GREEN_GREEN, acknowledged=True, place=1)
    race = replace(RACE, state=RaceState.GREEN_GREEN, karts=(driving,))
    assert not any(each.is_next for each in Screen(race, 0.0, {}).race)

    lost = replace(KART, connected=False, sent=RaceState.RED_RED, may_be_moving=True)
    covered = TrackAccess(False, True, 'the MSR was used', True)
    after = replace(RACE, state=RaceState.RED_RED, karts=(lost,), track=covered)
    assert not any(each.is_next for each in Screen(after, 0.0, {}).race)
    safe = replace(after, karts=(replace(lost, may_be_moving=False),))
    assert [each.command for each in Screen(safe, 0.0, {}).race if each.is_next] == [
        CommandKind.IN_GARAGE
    ]


# ----- heats and places ---------------------------------------------------------------------


def with_heats() -> Snapshot:
    """Return a race of kart 7 with two heats: one of this kart, and another."""
    karts = (replace(KART, number=3, in_race=False), KART)
    heats = (Heat('Heat A', (3,)), Heat('Final', (7,)))
    return replace(RACE, karts=karts, heats=heats, heat='Final')


def test_the_list_of_heats_marks_what_was_run_and_what_is_next_each_with_its_number() -> None:
    heats = tuple(Heat(name, (7,)) for name in ('Heat A', 'Heat B', 'Final'))
    race = replace(RACE, heats=heats, heat='Heat B')
    ran = RaceOfEvent(1, 'Heat A', 7200.0, 3, counts=True)

    def marks(results: Standings | None) -> list[str]:
        buttons = Screen(race, 0.0, {}, None, results).heats
        assert [button.key for button in buttons] == ['1', '2', '3']
        return [button.label for button in buttons]

    run_at = f'run at {time_of_day(7200.0)[:5]}'
    assert marks(None) == ['Heat A: 7', 'Heat B: 7  (in the race)', 'Final: 7']
    known = timing(races=(ran,))
    assert marks(known) == [
        f'Heat A: 7  ({run_at})',
        'Heat B: 7  (in the race)',
        'Final: 7  (next)',
    ]
    assert marks(timing(races=(ran,), next_heat='Heat A'))[0] == f'Heat A: 7  ({run_at}, next)'


def test_the_order_of_start_is_shown_before_the_race_and_who_is_next_at_any_time() -> None:
    heats = Heat('Final', (3, 7)), Heat('TT 3', (3,)), Heat('Next', (3, 9))
    karts = (replace(KART, number=3), KART)
    race = replace(RACE, karts=karts, state=RaceState.IN_GARAGE, heats=heats, heat='Final')
    grids = HeatGrid('Final', (7, 3)), HeatGrid('TT 3', (3,)), HeatGrid('Next', ())
    known = timing(grids=grids, next_heat='TT 3')

    screen = Screen(race, 0.0, {}, None, known)

    assert screen.order == 'Grid: 7, 3 · Next: kart 3 (TT 3)'
    assert [button.label for button in screen.heats] == [
        'Final: 7, 3  (in grid order, in the race)',
        'TT 3: 3  (next)',
        'Next: 3, 9',
    ]
    assert screen.order in table(screen)
    driving = Screen(replace(race, state=RaceState.GREEN_GREEN), 0.0, {}, None, known)
    assert driving.order == 'Next: kart 3 (TT 3)'


def test_without_heats_in_the_roster_none_is_offered() -> None:
    for possible in (True, False):
        read = offers(Availability(CommandKind.READ_ROSTER, possible))
        screen = Screen(replace(RACE, commands=read), 0.0, {})

        assert (screen.heat_button.enabled, screen.heats) == (possible, ())


def test_a_heat_that_is_not_possible_says_why() -> None:
    commands = offers(Availability(CommandKind.SET_HEAT, False, 'the race is in RED_RED'))

    screen = Screen(replace(with_heats(), commands=commands), 0.0, {})

    for button in (screen.heat_button, *screen.heats):
        assert not button.enabled
        assert 'the race is in RED_RED' in button.explanation


def test_places_are_the_timekeepers_and_without_timing_the_order_of_finish_by_that_name() -> None:
    karts = tuple(replace(KART, number=number, place=place) for number, place in ((1, 2), (2, 1)))
    first, second = driven(1, 6)._replace(place=1), driven(2, 6)._replace(place=2)
    known = timing(karts=(first, second))
    unseen = timing(karts=(driven(1, 0), driven(2, 0)))
    others = timing(run='earlier', karts=(first, second))

    for state in RaceState:
        race = replace(RACE, karts=karts, state=state)
        for results, said, places in (
            (known, 'Results: 1. kart 1, 2. kart 2', ['P1 6/6', 'P2 6/6']),
            (others, 'Order of FINISH: 1. kart 2, 2. kart 1', ['F2', 'F1']),
            (unseen, 'Order of FINISH: 1. kart 2, 2. kart 1', ['F2', 'F1']),
            (None, 'Order of FINISH: 1. kart 2, 2. kart 1', ['F2', 'F1']),
        ):
            screen = Screen(race, 0.0, {}, None, results)
            assert screen.places == said
            assert [row.place for row in screen.rows] == places
            assert said in table(screen)


def test_the_last_results_are_shown_until_the_next_race_is_green_and_never_in_it() -> None:
    last = timing(run='earlier', karts=(driven(7, 6),))

    for state in RaceState:
        places = Screen(replace(RACE, state=state), 0.0, {}, None, last).places
        assert bool(places) is (state is not RaceState.GREEN_GREEN)


def alerting(kind: AlertKind) -> Snapshot:
    return replace(RACE, alerts=(Alert(kind, 0, 0.0, 'It is so.', False),))


def test_the_failure_of_a_part_of_race_control_asks_for_the_msr() -> None:
    told = warning(alerting(AlertKind.PART_FAILED))

    assert told is not None
    assert (told.title, told.advice, told.detail) == (texts.FAILED, texts.USE_MSR, 'It is so.')
    assert warning(alerting(AlertKind.KART_LOST)) is None


def test_without_race_control_or_with_two_only_stops_can_be_pressed() -> None:
    two = [
        warning(RACE, two=True),
        warning(alerting(AlertKind.TWO_RACE_CONTROLS)),
    ]
    assert [each.title for each in two if each is not None] == [texts.TWO, texts.TWO]
    stops = {command for command, entry in CATALOGUE.items() if entry.stop}
    for told in (SILENT, *two):
        screen = Screen(RACE, 5.0, {}, told)
        buttons = [*screen.race, screen.msr_button, *screen.rows[0].buttons]
        enabled = {button.command for button in buttons if button.enabled}
        assert enabled == stops - {CommandKind.ALL_KILL}
        assert told is not None
        assert {each.reason for each in buttons if not each.enabled} == {told.barred}


def test_before_race_control_is_heard_nothing_but_stops_can_be_pressed() -> None:
    for danger_now in (SILENT, None):
        buttons = Screen(NOTHING, 0.0, {}, danger_now).race
        assert [each.command for each in buttons if each.enabled] == [CommandKind.RED_FLAG]


def test_a_command_that_waits_for_its_answer_shows_the_time_and_cannot_be_given_twice() -> None:
    pending = {(CommandKind.GREEN_GREEN, 0): 2.1, (CommandKind.RED_FLAG, 0): 2.1}
    screen = Screen(RACE, 0.0, pending)

    green = screen.button(CommandKind.GREEN_GREEN)
    flag = screen.button(CommandKind.RED_FLAG)

    assert green is not None
    assert flag is not None
    assert (green.enabled, green.reason) == (False, 'no answer yet (2.1 s)')
    assert flag.enabled


def test_a_word_perhaps_for_the_earlier_command_shows_when_it_counts_or_the_cure() -> None:
    says = {'reported': RaceState.GRID_ACTIVE}
    waits = with_kart(counts_at=42.0, **says).rows[0]
    over = with_kart(counts_at=40.0, **says).rows[0]

    assert (waits.answer.text, waits.says) == ('… in 2 s', 'for an older order?')
    assert (over.answer.text, over.says) == ('… not yet', 'for an older order?')
    assert over.note.text.startswith('its GRID ACTIVE report may answer an older order: have')
    said = with_kart(sent_since=34.0, **says).rows[0]
    assert said.note.text.startswith('its GRID ACTIVE report answered an older order: if')
    assert 'answered an older order' not in with_kart(sent_since=36.0, **says).rows[0].note.text
    stands = {'sent': RaceState.RED_RED, 'acknowledged': True, 'may_be_moving': True}
    assert with_kart(settles_at=42.0, **stands).rows[0].answer.text == texts.SETTLING.format(
        seconds='2'
    )


def test_a_kart_shows_whether_it_acknowledged_and_what_it_says() -> None:
    waiting = with_kart().rows[0]
    done = with_kart(acknowledged=True, reported=RaceState.GRID_ACTIVE).rows[0]

    assert (waiting.answer.text, waiting.answer.tone) == ('… not yet', Tone.WAIT)
    assert (waiting.says, waiting.waits) == ('says IN GARAGE', True)
    assert (done.answer.text, done.answer.tone) == ('✓ ready', Tone.GOOD)
    assert (done.says, done.waits) == ('', False)


def test_a_kart_without_link_stands_out_if_it_matters() -> None:
    racing = with_kart(connected=False).rows[0]
    outside = with_kart(connected=False, in_race=False).rows[0]

    assert (racing.link.text, racing.link.tone) == ('✗ NO LINK', Tone.BAD)
    assert (outside.link.text, outside.link.tone) == ('✗ NO LINK', Tone.FAINT)


def test_how_good_a_link_is_is_told_by_bars_a_word_and_a_time() -> None:
    told = {}
    for grade in Grade:
        screen = with_kart(link=link(grade, round_trip=0.0121, worst_answer=0.6201))
        row = screen.rows[0]
        told[grade] = row.bars, row.link.text, row.link_time, row.link.tone
        assert f'{row.link.text} {row.link_time}'.strip() in '\n'.join(table(screen))

    assert told == {
        Grade.UNKNOWN: (0, '✓ linked', '', Tone.PLAIN),
        Grade.GOOD: (4, 'good', '13 ms', Tone.PLAIN),
        Grade.FAIR: (2, 'fair', '621 ms', Tone.PLAIN),
        Grade.POOR: (1, 'poor', '621 ms', Tone.WAIT),
    }
    assert len(set(BARS.values())) == len(Grade)
    lost = with_kart(connected=False, link=link(Grade.GOOD, round_trip=0.01)).rows[0]
    assert (lost.bars, lost.link.text, lost.link_time) == (0, '✗ NO LINK', '')
    assert with_kart(link=link(Grade.GOOD)).rows[0].link_time == ''


def test_who_can_stop_the_race_is_told_to_whoever_starts_it_and_makes_no_other_question() -> None:
    alone = Screen(RACE, 0.0, {})
    race = replace(RACE, able_to_stop=2, who_can_stop='Anna (window), button')
    screen = Screen(race, 0.0, {})
    green = screen.button(CommandKind.GREEN_GREEN)
    before = alone.button(CommandKind.GREEN_GREEN)
    assert green is not None
    assert before is not None

    for said in (
        green.question().caution,
        texts.can_stop(screen.snapshot),
        '\n'.join(table(screen)),
    ):
        assert '2 officials can stop the race' in said
        assert 'Anna (window), button' in said
    assert '0' not in before.question().caution
    assert green.asks_the_same(before)


def test_once_the_race_is_green_for_30_s_it_is_said_that_each_kart_must_have_begun() -> None:
    driving = replace(KART, sent=RaceState.GREEN_GREEN, acknowledged=True)

    def reminder(green_for: float, age: float = 0.0, **changes: object) -> str:
        kart = replace(driving, **changes)  # type: ignore[arg-type]
        race = replace(RACE, state=RaceState.GREEN_GREEN, stamp=green_for, karts=(kart,))
        screen = Screen(race, age, {})
        assert screen.reminder in '\n'.join(table(screen))
        assert not Screen(race, age, {}, SILENT).reminder
        return screen.reminder

    begun, over = BEGINS_WITHIN, BEGINS_WITHIN + REMINDS_FOR
    assert [bool(reminder(each)) for each in (begun - 0.1, begun, over - 0.1, over)] == [
        False,
        True,
        True,
        False,
    ]
    assert '30 s' in reminder(begun - 1.0, age=1.0)
    # A kart that has not answered is not forgotten; one that is sent another state need not drive.
    assert reminder(over, acknowledged=False)
    assert not reminder(begun, sent=RaceState.RED_RED, acknowledged=False)
    assert not reminder(begun, in_race=False)


def test_a_kart_that_was_seen_to_cross_the_line_has_begun_whatever_it_acknowledged() -> None:
    silent = replace(KART, sent=RaceState.GREEN_GREEN, acknowledged=False)
    karts = (silent, replace(silent, number=8))
    over = BEGINS_WITHIN + REMINDS_FOR
    race = replace(RACE, state=RaceState.GREEN_GREEN, stamp=over, karts=karts)

    def reminder(*seen: int) -> str:
        results = tuple(driven(each, 2) for each in seen)
        return Screen(race, 0.0, {}, None, Standings(over, karts=results)).reminder

    assert reminder()
    assert reminder(7)  # kart 8 was not seen
    assert not reminder(7, 8)
    line = Passing('line', '', 1)
    crossed = tuple(Judged(line, each, Mark.COUNTED, over, '') for each in (7, 8))
    assert not Screen(race, 0.0, {}, None, Standings(over, passings=crossed)).reminder
    of_another_race = Standings(over, race=2, passings=crossed)
    assert Screen(race, 0.0, {}, None, of_another_race).reminder


def test_the_day_of_an_inspection_is_shown_where_nothing_else_is_to_be_read() -> None:
    inspected = with_kart(inspected='2026-05-01')
    assert inspected.rows[0].note.text == 'inspected 2026-05-01'
    assert 'inspected 2026-05-01' in '\n'.join(table(inspected))
    held = with_kart(inspected='2026-05-01', hold=RaceState.RED_FLAG, hold_reason='ALL_KILL')
    assert held.rows[0].note.text == 'held: ALL_KILL'
    assert with_kart().rows[0].note.text == ''


def test_a_finished_kart_that_drives_on_shows_when_it_is_sent_its_flag() -> None:
    driving = replace(KART, sent=RaceState.GREEN_GREEN, acknowledged=True, place=1, flag_at=42.5)
    for age, seconds in ((0.0, 3), (0.6, 2), (9.0, 1)):  # never too soon
        screen = Screen(replace(RACE, karts=(driving,)), age, {})
        assert screen.rows[0].note.text == f'F1, flag in {seconds} s'
        assert tally(screen.snapshot) == '1 driving'
        assert f'Purdue F1, flag in {seconds} s' in '\n'.join(table(screen))

    not_due, without_link = replace(driving, flag_at=None), replace(driving, connected=False)
    for kart in (not_due, without_link, replace(driving, sent=RaceState.RED_RED)):
        row = Screen(replace(RACE, karts=(kart,)), 0.0, {}).rows[0]
        assert (row.place, row.note.text) == ('F1', '')


def test_the_finish_key_of_a_kart_stays_its_own_when_another_leaves_the_race() -> None:
    karts = tuple(replace(KART, number=number) for number in range(1, 61))
    left = tuple(replace(kart, in_race=kart.number != 3) for kart in karts)

    before = Screen(replace(RACE, karts=karts), 0.0, {}).rows
    after = Screen(replace(RACE, karts=left), 0.0, {}).rows

    keys = [row.buttons[2].key for row in before]
    assert keys == [row.buttons[2].key for row in after]
    assert len({*filter(None, keys)}) == len(FINISH_KEYS)
    assert keys[len(FINISH_KEYS)] == ''  # more karts than keys are shown all the same
    assert keys[0] == 'A'
    assert keys[24] == 'Shift+A'


def test_no_state_is_told_by_its_colour_alone() -> None:
    assert set(STATES) == set(STATE_CELLS) == {None, *RaceState}
    assert len(set(STATES.values())) == len(STATES)
    assert len({each.text[0] for each in STATE_CELLS.values()}) == len(STATE_CELLS)


@pytest.mark.parametrize(
    ('silent_for', 'title', 'barred'),
    [
        (None, texts.NOT_YET, texts.NOT_YET_REASON),
        (0.0, '', ''),
        (GONE_AFTER - 0.01, '', ''),
        (GONE_AFTER, texts.GONE, texts.GONE_REASON),
        (60.0, texts.GONE, texts.GONE_REASON),
    ],
)
def test_race_control_is_gone_within_a_second(
    silent_for: float | None, title: str, barred: str
) -> None:
    green = replace(RACE, state=RaceState.GREEN_GREEN)
    never = Latest(began=0.0).danger(3.0)
    said = never if silent_for is None else warning(green, silent_for=silent_for)

    assert (said.title if said else '', said.barred if said else '') == (title, barred)
    assert GONE_AFTER < 1.0
    if said:
        # Before the first snapshot, there is no sign of any race.
        assert (said.advice == texts.USE_MSR) is (silent_for is not None)


STOPPED_BY_MSR = replace(RACE.track, allowed=True, msr_used=True)


@pytest.mark.parametrize(
    ('calm', 'ended', 'changes'),
    [
        (True, True, {'state': RaceState.IN_GARAGE}),
        (True, True, {'track': NO_RACE_YET}),
        (False, False, {}),
        (False, True, {'track': replace(RACE.track, reason='the race is in GREEN_GREEN')}),
        (False, True, {'track': replace(RACE.track, settled_by=CommandKind.IN_GARAGE)}),
        (False, True, {'karts': (replace(KART, may_be_moving=True),)}),
        (False, True, {'karts': (replace(KART, may_be_moving=True),), 'track': STOPPED_BY_MSR}),
        (False, True, {'alerts': (Alert(AlertKind.LOST_IN_MOTION, 7, 0.0, 'lost', True),)}),
        (False, True, {'alerts': (Alert(AlertKind.PART_FAILED, 0, 0.0, 'failed', True),)}),
    ],
)
def test_the_msr_is_asked_for_when_race_control_is_gone_but_for_a_good_end_without_a_doubt(
    calm: bool, ended: bool, changes: dict[str, object]
) -> None:
    rest = replace(RACE, track=replace(RACE.track, allowed=True, reason='all are in the garage'))

    said = warning(replace(rest, **changes), silent_for=5.0, ended=ended)

    assert said is not None
    assert (said.title == texts.ENDED, said.advice == texts.USE_MSR) == (calm, not calm)
    assert said.stale
    assert said.barred


def test_every_kart_that_needs_the_msr_is_named_and_that_it_is_in_use_stays_to_be_read() -> None:
    kart = replace(KART, sent=RaceState.RED_RED, may_be_moving=True)
    karts = tuple(replace(kart, number=number) for number in range(1, 8))
    lost = tuple(
        Alert(AlertKind.LOST_IN_MOTION, number, 0.0, 'lost', True) for number in range(1, 8)
    )
    race = replace(RACE, state=RaceState.RED_RED, karts=karts, alerts=lost)
    used = replace(race.track, allowed=True, msr_used=True)

    def said(race: Snapshot) -> tuple[str, Tone]:
        screen = Screen(race, 0.0, {})
        assert screen.msr.text in '\n'.join(table(screen))
        return screen.msr.text, screen.msr.tone

    assert said(race) == ('USE THE MSR: karts 1, 2, 3, 4, 5, 6, 7', Tone.BAD)
    quiet = tuple(replace(alert, use_msr=False) for alert in lost)
    assert said(replace(race, alerts=quiet))[0] == ''
    in_use = replace(race, alerts=quiet, track=used)
    assert said(in_use)[0] == 'MSR IN USE: nothing else can stop karts 1, 2, 3, 4, 5, 6, 7'
    stopped = tuple(replace(each, may_be_moving=False) for each in karts)
    assert said(replace(in_use, karts=stopped))[0] == 'MSR IN USE'
    unsafe = Alert(AlertKind.TRACK_UNSAFE, 0, 0.0, 'clear the track', True)
    assert said(replace(race, alerts=(unsafe,)))[0] == 'USE THE MSR'


def test_the_terminal_shows_the_same() -> None:
    alert = Alert(AlertKind.RED_UNACKNOWLEDGED, 7, 0.0, 'Kart 7 drives', True)
    commands = offers(Availability(CommandKind.GREEN_GREEN, False, 'waiting for kart 7'))
    race = replace(RACE, commands=commands, alerts=(alert,))

    lines = '\n'.join(table(Screen(race, 0.0, {})))

    assert f'Race: ▦ GRID ACTIVE  (0:40, {time_of_day(RACE.state_since)})' in lines
    assert '⚠ USE THE MSR: Kart 7 drives\n' in lines
    assert 'GREEN GREEN  waiting for kart 7\n' in lines
    assert '7     Purdue USE THE MSR  ▦ GRID ACTIVE 0:40  … not yet' in lines


def test_every_command_to_karts_and_about_the_track_has_a_button() -> None:
    shown = {*RACE_COMMANDS, *KART_COMMANDS, *UNDONE_BY.values()}
    apart = {CommandKind.ALL_KILL, CommandKind.RECORD_MSR, CommandKind.OPEN_TRACK}
    apart |= {CommandKind.TAKE_ROSTER}
    needed = {kind for kind, entry in CATALOGUE.items() if not entry.bookkeeping or entry.loosens}

    assert needed <= shown | apart


def test_a_question_speaks_of_one_kart_and_of_several() -> None:
    said = [offering(CommandKind.GREEN_GREEN, (KART,)), offering(CommandKind.IN_GARAGE, (KART,))]
    away = button_of(CommandKind.KART_IN_GARAGE, OFFERED, connected=False)

    assert [button.question().consequences[0] for button in said] == [
        'Sends GREEN GREEN now to kart 7. It will start to drive.',
        'Sends IN GARAGE now to kart 7. The team has its kart back.',
    ]
    assert 'no kart' not in ' '.join(away.question().consequences)


@pytest.mark.parametrize(('command', 'by'), UNDONE_BY.items())
def test_the_button_of_a_command_in_force_offers_to_take_it_back(
    command: CommandKind, by: CommandKind
) -> None:
    def offered(in_force: bool) -> set[CommandKind]:
        result = CATALOGUE[command].result
        kart = replace(
            KART,
            in_race=in_force and bool(result.in_race),
            place=int(in_force and bool(result.placed)),
        )
        track = replace(RACE.track, open=in_force and bool(result.track_open))
        screen = Screen(replace(RACE, karts=(kart,), track=track), 0.0, {})
        return {each.command for each in (*screen.rows[0].buttons, screen.track_button)}

    assert {command, by} & offered(False) == {command}
    assert {command, by} & offered(True) == {by}


def test_the_letter_of_finish_never_takes_a_finish_back() -> None:
    said = 'kart 7 (Purdue) has already finished as P1'
    commands = offers(Availability(CommandKind.KART_FINISH, False, said))

    screen = with_kart(place=1, commands=commands)

    finish = screen.button(CommandKind.KART_FINISH, 7)
    assert finish is not None
    assert not finish.enabled
    assert finish.reason == said
    assert not any(each.key for each in screen.rows[0].buttons if each != finish)


GREEN = replace(RACE, state=RaceState.GREEN_GREEN, heat='Final')


def test_the_letter_is_lap_until_only_the_last_lap_is_left_and_then_finish() -> None:
    def letter(results: Standings | None, race: Snapshot = GREEN, **changes: object) -> object:
        kart = replace(KART, sent=RaceState.GREEN_GREEN, **changes)  # type: ignore[arg-type]
        screen = Screen(replace(race, karts=(kart,)), 0.0, {}, None, results)
        assert screen.button(CommandKind.KART_FINISH, 7) == screen.rows[0].finish
        assert screen.rows[0].finish.enabled  # it can always be sent by the kart's number
        assert screen.rows[0].letter.enabled
        return screen.rows[0].letter.command

    first = timing(karts=(driven(7, 0),))
    assert letter(first) == Act.COUNT
    assert letter(timing(karts=(driven(7, 4),))) == Act.COUNT
    assert letter(timing(karts=(driven(7, 4),)), hold=RaceState.RED_FLAG) == Act.COUNT
    assert letter(timing(karts=(driven(7, 5),))) == CommandKind.KART_FINISH
    assert letter(first._replace(laps=0)) == CommandKind.KART_FINISH
    assert letter(None, replace(GREEN, heat='')) == CommandKind.KART_FINISH
    for elsewhere in ({'in_race': False}, {'place': 1}):
        assert letter(first, **elsewhere) == CommandKind.KART_FINISH
    of_one = first._replace(laps=1)
    seen = Judged(Passing('line', 'today', 1), 7, Mark.COUNTED, 3.0, '')
    assert letter(of_one) == Act.COUNT  # this crossing begins the lap
    assert letter(of_one._replace(passings=(seen,))) == CommandKind.KART_FINISH


@pytest.mark.parametrize(
    'results',
    [
        None,
        Standings(0.0, 'run', 3, laps=6),
        Standings(RACE.stamp, 'run', 2, laps=6),
        Standings(RACE.stamp, 'run', 3, laps=6),
    ],
    ids=['none', 'old', 'another race', 'not this kart'],
)
def test_without_timing_the_letter_sends_nothing_and_says_so_and_finish_by_number_is_sent(
    results: Standings | None,
) -> None:
    karts = (replace(KART, sent=RaceState.GREEN_GREEN),)
    screen = Screen(replace(GREEN, run='run', number=3, karts=karts), 0.0, {}, None, results)
    (row,) = screen.rows

    assert (row.letter.enabled, row.finish.enabled) == (False, True)
    assert row.letter.reason == texts.NO_TIMING_REASON
    assert row.letter in row.buttons
    assert screen.button(CommandKind.KART_FINISH, 7) == row.finish


def test_no_crossing_is_counted_while_race_control_is_gone_or_the_last_is_not_answered() -> None:
    known = timing(karts=(driven(7, 0),))
    for pending, danger_now in (({(Act.COUNT, 7): 0.1}, None), ({}, SILENT)):
        count = Screen(GREEN, 0.0, pending, danger_now, known).button(Act.COUNT, 7)
        assert count is not None
        assert not count.enabled


def test_the_end_of_one_of_two_race_controls_is_not_taken_for_the_end_of_the_other() -> None:
    quiet = replace(RACE, track=replace(RACE.track, allowed=True))
    for two in (False, True):
        latest = Latest(began=0.0, looking='here')
        latest.take_race(quiet, 0.0, two)
        latest.take_event(Event(EventKind.ENDED, 'it ends'))
        latest.take_race(quiet, 5.0, False)

        silent = latest.danger(10.0)

        assert silent is not None
        assert silent.title == (texts.GONE if two else texts.ENDED)


def test_a_kart_that_moved_on_the_grid_is_not_said_to_need_only_time() -> None:
    screen = with_kart(acknowledged=True, may_be_moving=True)

    assert screen.rows[0].answer == Cell('! may move', Tone.BAD)


# ----- the way of a race ------------------------------------------------------------------


def phrases(race: Snapshot) -> dict[CommandKind, str]:
    """Return the phrase of each command to the race."""
    return {button.command: button.phrase for button in Screen(race, 0.0, {}).race}


def test_each_command_to_the_race_says_what_is_and_what_it_waits_for() -> None:
    waits = 'waiting for kart 8 (Purdue): not connected'
    waiting = Availability(CommandKind.GREEN_GREEN, False, waits)
    pause = Availability(CommandKind.IN_GARAGE, False, 'a stop', available_from=42.1)
    ready = replace(KART, acknowledged=True)
    race = replace(RACE, commands=offers(waiting, pause), karts=(ready, replace(KART, number=8)))

    said = phrases(race)

    assert said[CommandKind.GRID_ACTIVE] == f'since {time_of_day(RACE.state_since)}'
    assert said[CommandKind.GREEN_GREEN] == waits
    assert said[CommandKind.IN_GARAGE] == 'possible again in 3 s: a stop'
    assert texts.missing(race) == 'waiting for 8'
    garage = replace(race, state=RaceState.IN_GARAGE)
    assert phrases(garage)[CommandKind.GREEN_GREEN] == 'after GRID ACTIVE'


@pytest.mark.parametrize('pending', [{}, {(kind, 0): 1.0 for kind in CommandKind}])
@pytest.mark.parametrize('danger_now', [None, SILENT])
@pytest.mark.parametrize('state', RaceState)
def test_a_command_to_the_race_shows_why_it_is_not_possible_or_when_it_is_usual(
    state: RaceState, danger_now: Danger | None, pending: dict[tuple[CommandKind, int], float]
) -> None:
    why = 'another race control is running; shut it down first'
    barred = replace(
        RACE,
        state=state,
        commands=tuple(
            Availability(kind, False, why, available_from=until)
            for kind, until in zip(CommandKind, itertools.cycle((None, 42.1)), strict=False)
        ),
    )

    for button in Screen(barred, 0.0, pending, danger_now).race:
        if not (button.enabled or button.current):
            assert button.phrase in (button.reason, CATALOGUE[button.command].follows)
            assert danger_now or pending or why in button.reason


@pytest.mark.parametrize('state', [RaceState.RED_FLAG, RaceState.RED_RED])
def test_a_race_that_was_stopped_has_no_clock_and_begins_on_the_grid(state: RaceState) -> None:
    green = replace(RACE, state=RaceState.GREEN_GREEN, stamp=48.0)
    barred = Availability(CommandKind.GREEN_GREEN, False, 'the race was stopped')

    stopped = replace(green, state=state, commands=offers(barred))

    assert (Screen(green, 0.0, {}).clock, Screen(stopped, 0.0, {}).clock) == ('0:48', '')
    assert phrases(stopped)[CommandKind.GREEN_GREEN] == 'after GRID ACTIVE'


def test_race_over_is_said_and_not_as_old_as_the_state_in_which_it_was_declared() -> None:
    over = replace(RACE, state=RaceState.RED_RED, over=True)

    assert phrases(over)[CommandKind.RACE_OVER] == 'the race is over'
    assert 'the race is over' in '\n'.join(table(Screen(over, 0.0, {})))


def test_the_strip_tells_who_is_missing_and_the_row_that_the_msr_is_needed() -> None:
    lost = replace(KART, number=8, connected=False, may_be_moving=True)
    done = replace(KART, acknowledged=True, place=1, sent=RaceState.RED_FLAG, stands=True)
    told = Alert(AlertKind.LOST_IN_MOTION, 8, 0.0, 'Kart 8 was lost', True)

    screen = Screen(replace(RACE, karts=(done, lost), alerts=(told,)), 0.0, {})

    assert tally(screen.snapshot) == '1 finished, 1 lost'
    assert texts.missing(screen.snapshot) == 'waiting for 8'
    assert texts.heat_in_race(screen.snapshot) == '2 karts'
    assert [row.use_msr for row in screen.rows] == [False, True]
    assert screen.rows[1].note.text.startswith(texts.USE_MSR)
    assert screen.rows[1].note.tone is Tone.BAD


# ----- laps ---------------------------------------------------------------------------------


def test_a_row_shows_position_lap_and_gap_beside_what_is_more_urgent() -> None:
    karts = tuple(replace(KART, number=number, hold=RaceState.RED_FLAG) for number in (7, 8, 9))
    best = driven(8, 3)
    late = best._replace(kart=7, place=2, total=32.5)
    known = timing(karts=(best, late, driven(9, 1)._replace(place=3)))

    rows = Screen(replace(RACE, karts=karts), 0.0, {}, None, known).rows

    assert [row.place for row in rows] == ['P2 3/6', 'P1 3/6', 'P3 1/6']
    assert [row.gap for row in rows] == ['+2.500', '', '+2 laps']
    assert all(texts.HELD.format(reason='') in row.note.text for row in rows)


def test_results_that_are_out_of_date_or_of_the_future_are_no_timing() -> None:
    for age, said in ((0.0, ''), (TIMING_GONE - 0.1, ''), (TIMING_GONE, texts.NO_TIMING)):
        for ahead in (age, -age):
            known = timing(stamp=RACE.stamp + ahead, karts=(driven(7, 3),))
            screen = Screen(RACE, 0.0, {}, None, known)
            assert (screen.timing, bool(screen.places)) == (said, not said)
    assert Screen(RACE, 0.0, {}).timing == texts.NO_TIMING
    assert texts.NO_TIMING in table(Screen(RACE, 0.0, {}))
    assert Screen(GREEN, 0.0, {}, None, timing(race=2)).timing == texts.NO_TIMING


def test_a_disagreement_about_results_is_no_question_to_the_race_director() -> None:
    known = timing(karts=(driven(7, 3),))
    asked = known._replace(questions=('Kart 7 is marked as finished, but 3 laps are missing',))

    screens = [Screen(RACE, 0.0, {}, None, results) for results in (asked, known)]
    assert table(screens[0]) == table(screens[1])
    assert screens[0].rows == screens[1].rows


def test_grid_active_asks_whether_a_heat_is_to_be_run_again_and_stays_the_same_question() -> None:
    race = replace(RACE, state=RaceState.IN_GARAGE, heat='Heat 1')
    ran = RaceOfEvent(1, 'Heat 1', 50_700.0, 2, True)
    practised = RaceOfEvent(2, 'Practice', 60_700.0, 2, True)

    def question(*ran: RaceOfEvent) -> Button:
        button = Screen(race, 0.0, {}, None, timing(races=ran)).button(CommandKind.GRID_ACTIVE)
        assert button is not None
        return button

    again, first = question(ran, practised), question(practised)
    clock = time_of_day(ran.stamp)[:5]
    said = f'Heat 1 has already been run, at {clock}. This run will count instead.'
    assert again.question().caution == said
    assert not first.question().caution
    assert not question(ran._replace(counts=False)).question().caution
    assert again.asks_the_same(first)


def test_the_races_of_the_event_are_listed_with_the_numbers_by_which_one_is_chosen() -> None:
    known = timing(races=(RaceOfEvent(1, 'A', 0.0, 2, False), RaceOfEvent(2, 'A', 60.0, 3, True)))

    assert [(*row[:1], *row[2:]) for row in races(known)] == [
        ('1', 'A', '2 classified', ''),
        ('2', 'A', '3 classified', 'counts'),
    ]


def test_a_kart_whose_last_lap_is_done_is_named_in_the_strip_and_in_its_row() -> None:
    race = replace(GREEN, stamp=90.0)
    known = timing(stamp=90.0, karts=(driven(7, 6),))

    screen = Screen(race, 0.0, {}, None, known)

    assert screen.reminder == 'FINISH 7: last lap done'
    assert texts.LAST_LAP_DONE in screen.rows[0].note.text
    assert screen.rows[0].note.tone is Tone.WAIT
    assert screen.reminder in '\n'.join(table(screen))
    assert not Screen(race, 0.0, {}, SILENT, known).reminder
