# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What a screen shows for a snapshot."""

from __future__ import annotations

import itertools
from typing import Any

from evgp_node.results import (
    Act,
    HeatGrid,
    Judged,
    KartResult,
    Mark,
    Passing,
    Penalty,
    RaceOfEvent,
    Standings,
    Status,
    TIMING_GONE,
)
from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.link_quality import NOT_MEASURED
from evgp_rcs.rules.race import (
    Alert,
    AlertKind,
    Availability,
    Heat,
    TrackAccess,
)
from evgp_rcs.rules.snapshot import NOTHING, Snapshot
from evgp_rcs.words import Cell, GONE_AFTER, STATE_CELLS, STATES, tally, time_of_day, Tone
from evgp_rcs_console import texts
from evgp_rcs_console.results import races
from evgp_rcs_console.results import table as results_table
from evgp_rcs_console.view import (
    ALL_WELL,
    BARS,
    BEGINS_WITHIN,
    Button,
    Danger,
    FINISH_KEYS,
    KART_COMMANDS,
    Latest,
    Pending,
    RACE_COMMANDS,
    REMINDS_FOR,
    Screen,
    table,
    UNDONE_BY,
)
from example_race import KART, offers, RACE, replace, warning
import pytest

GREEN_GREEN, GRID_ACTIVE = RaceState.GREEN_GREEN, RaceState.GRID_ACTIVE
IN_GARAGE, RED_FLAG, RED_RED = RaceState.IN_GARAGE, RaceState.RED_FLAG, RaceState.RED_RED
SILENT = Danger('gone', 'MSR', 'long ago', texts.GONE_REASON, stale=True)


def screen_of(
    results: Standings | None = None,
    age: float = 0.0,
    pending: Pending = {},  # noqa: B006 - nobody changes it
    danger: Danger = ALL_WELL,
    **changes: Any,
) -> Screen:
    """Return the screen of the example race in which some fields differ."""
    return Screen(replace(RACE, **changes), age, pending, danger, results)


def with_kart(results: Standings | None = None, **changes: Any) -> Screen:
    """Return the screen of a race in which some fields of the only kart differ."""
    return screen_of(results, karts=(replace(KART, **changes),))


def steps(screen: Screen) -> list[CommandKind]:
    """Return the commands to the race that are marked as the next step."""
    return [each.command for each in screen.race if each.is_next]


def lost(kart: int) -> Alert:
    """Return an alert that needs the MSR."""
    return Alert(AlertKind.LOST_IN_MOTION, kart, 0.0, f'kart {kart} was lost', True)


def timing(**fields: object) -> Standings:
    """Return the timekeeper's present results of the race in these tests."""
    return replace(Standings(RACE.stamp, laps=6), **fields)


def driven(kart: int, laps: int) -> KartResult:
    """Return the result of a kart that has driven some laps, each in 10 s."""
    return KartResult(kart, 1, Status.RUNNING, laps, 10.0 * laps, (10.0,) * laps, ())


# ----- buttons and questions ----------------------------------------------------------------


@pytest.mark.parametrize(
    'command', [CommandKind.GRID_ACTIVE, CommandKind.IN_GARAGE, CommandKind.KART_IN_GARAGE]
)
def test_no_statement_is_sent_that_race_control_has_not_asked_for(command: CommandKind) -> None:
    asked = screen_of().button(command, 7 * CATALOGUE[command].to_one_kart)
    assert asked.question.condition
    assert not asked.gives.stated


def test_a_question_about_other_karts_another_statement_or_hold_is_another_question() -> None:
    def asking(statement: str, *karts: int) -> Button:
        offered = Availability(CommandKind.GREEN_GREEN, True, statement=statement, karts=karts)
        others = (replace(KART, number=number, sent=RED_RED) for number in (1, 2, 3))
        screen = screen_of(commands=offers(offered), karts=(*others, KART))
        return screen.button(CommandKind.GREEN_GREEN)

    asked = asking('one', 1, 2)
    of_hold = replace(asked, gives=replace(asked.gives, taken={'hold': RED_FLAG}))
    for other in (asking('one', 1, 2, 3), asking('other', 1, 2), asking('', 1, 2), of_hold):
        assert not asked.asks_the_same(other)
    assert asked.asks_the_same(replace(asked, reason='not now', label='other'))
    undo, sent = (
        with_kart(place=1, flag_at=flag_at).button(CommandKind.KART_UNDO_FINISH, 7)
        for flag_at in (RACE.stamp + 4.0, None)
    )
    assert not undo.asks_the_same(sent)  # whether the kart races on is not the same
    for asked, told in ((undo, 'has not been sent yet'), (sent, 'has been sent')):
        assert f'Its RED FLAG {told}.' in asked.question.consequences


def test_a_question_speaks_of_one_kart_and_of_several_and_says_who_stays_held_and_why() -> None:
    held = replace(KART, number=4, hold=RED_RED, hold_reason='lost its connection')
    seven = offers(*(Availability(each, True, karts=(7,)) for each in RACE_COMMANDS))

    def said(screen: Screen, command: CommandKind, kart: int = 0) -> tuple[str, ...]:
        return (*screen.button(command, kart).question.consequences,)

    screen = screen_of(commands=seven, karts=(held, KART))
    assert said(screen, CommandKind.GREEN_GREEN)[0] == (
        'Sends GREEN GREEN now to kart 7. It will start to drive.'
    )
    assert said(screen, CommandKind.IN_GARAGE) == (
        'Sends IN GARAGE now to kart 7. The team has its kart back.',
        'Stays held: kart 4 (Purdue): RED RED, lost its connection.',
    )
    away = with_kart(connected=False, hold=RED_RED, hold_reason='ALL_KILL')
    released = said(away, CommandKind.KART_IN_GARAGE, 7)
    assert 'Releases kart 7 (Purdue): RED RED, ALL_KILL.' in released
    assert 'no kart' not in ' '.join(released)
    for banner in ('', 'REHEARSAL'):
        screen = screen_of(banner=banner)
        assert ('instructor' in ' '.join(said(screen, CommandKind.RECORD_MSR))) is bool(banner)
        assert ('REHEARSAL' in table(screen)[0]) is bool(banner)


def test_a_question_says_what_else_a_command_does_and_that_no_kart_is_heard() -> None:
    held = (replace(KART, hold=RED_FLAG, place=1),)
    release = screen_of(state=GREEN_GREEN, karts=held).button(CommandKind.KART_IN_GARAGE, 7)
    for said in (
        'Takes the kart out of the race.',
        f'Humans must stay off the track: {GREEN_NOW}.',
    ):
        assert said in release.question.consequences
    grid = screen_of(karts=held).button(CommandKind.GRID_ACTIVE)
    assert 'Clears the places of the last race.' in grid.question.consequences
    for command in (CommandKind.IN_GARAGE, CommandKind.OPEN_TRACK):
        allowed = screen_of(**AWAY, track=replace(RACE.track, allowed=True)).button(command)
        assert texts.HUMANS_UNKNOWN_REASON in allowed.question.warning


def test_to_open_the_track_under_the_msr_the_official_states_that_every_kart_stands() -> None:
    for statement, by_msr in itertools.product(
        ('', 'no race is under way anywhere'), (True, False)
    ):
        offered = offers(Availability(CommandKind.OPEN_TRACK, True, statement=statement))
        track = replace(RACE.track, allowed=True, msr_used=by_msr)
        screen = screen_of(track=track, commands=offered)
        condition = screen.track_button.question.condition
        assert statement in condition
        assert ('every kart is standing still' in condition) is by_msr
        # YES, AND ALSO of IN GARAGE opens the track, with the statement only if it is asked for.
        with_garage = screen.race_button(CommandKind.IN_GARAGE).also
        assert [each.stated for each in with_garage] == [bool(statement)] * (not by_msr)


def test_the_release_of_a_kart_that_needs_the_msr_recedes_and_stays_possible() -> None:
    for alerts in ((), (lost(7),)):
        row = screen_of(karts=(replace(KART, sent=RED_RED),), alerts=alerts).rows[0]
        recede = [each for each in row.buttons if each.recedes]
        assert [each.command for each in recede] == [CommandKind.KART_IN_GARAGE] * len(alerts)
        assert all(each.enabled for each in recede)


RAN = RaceOfEvent(1, 'Heat 1', 50_700.0, 2, True)
PRACTISED = RaceOfEvent(2, 'Practice', 60_700.0, 2, True)
POOR = tuple(replace(KART, number=number, poor_lately=True) for number in (7, 3))


@pytest.mark.parametrize(
    ('command', 'results', 'changes', 'said'),
    [
        (CommandKind.GREEN_GREEN, None, {}, 'No official can stop the race: no screen or button'),
        (
            *(CommandKind.GREEN_GREEN, None, {'able_to_stop': 2, 'who_can_stop': 'Anna, button'}),
            '2 officials can stop the race: Anna, button.',
        ),
        (CommandKind.GRID_ACTIVE, None, {'karts': POOR}, 'The link to kart 7 has been poor'),
        (
            *(CommandKind.GRID_ACTIVE, timing(races=(RAN, PRACTISED)), {'state': IN_GARAGE}),
            f'Heat 1 has already been run, at {time_of_day(RAN.stamp)[:5]}. This run will count',
        ),
        (CommandKind.GRID_ACTIVE, timing(races=(RAN,)), {}, ''),  # this is that run
        *(
            (CommandKind.GRID_ACTIVE, timing(races=(other,)), {'state': IN_GARAGE}, '')
            for other in (PRACTISED, RAN._replace(counts=False))
        ),
    ],
)
def test_what_a_question_cautions_against_makes_no_other_question(
    command: CommandKind, results: Standings | None, changes: dict[str, Any], said: str
) -> None:
    offered = offers(Availability(command, True, karts=(7,)))
    fields = {'commands': offered, 'karts': (KART, replace(KART, number=3)), 'heat': 'Heat 1'}

    asked = screen_of(results, **fields | changes).button(command)

    assert asked.question.caution.startswith(said)
    assert bool(asked.question.caution) is bool(said)
    assert asked.asks_the_same(screen_of(**fields).button(command))


def test_every_command_to_karts_and_about_the_track_has_a_button() -> None:
    shown = {*RACE_COMMANDS, *KART_COMMANDS, *UNDONE_BY.values()}
    apart = {CommandKind.ALL_KILL, CommandKind.RECORD_MSR, CommandKind.OPEN_TRACK}
    apart |= {CommandKind.TAKE_ROSTER}
    needed = {kind for kind, entry in CATALOGUE.items() if not entry.bookkeeping or entry.loosens}

    assert needed <= shown | apart


def test_without_race_control_or_with_two_only_stops_can_be_pressed() -> None:
    two = [warning(RACE, two=True), warning(alerting(AlertKind.TWO_RACE_CONTROLS))]
    assert [each.title for each in two] == [texts.TWO, texts.TWO]
    stops = {command for command, entry in CATALOGUE.items() if entry.stop}
    for told in (SILENT, *two):
        screen = screen_of(age=5.0, danger=told)
        buttons = [*screen.race, screen.msr_button, *screen.rows[0].buttons]
        enabled = {button.command for button in buttons if button.enabled}
        assert enabled == stops - {CommandKind.ALL_KILL}
        assert {each.reason for each in buttons if not each.enabled} == {told.barred}
        assert {each.phrase for each in screen.race if not each.enabled} == {told.barred}
    for told in (SILENT, ALL_WELL):  # before race control is heard
        buttons = Screen(NOTHING, 0.0, {}, told).race
        assert [each.command for each in buttons if each.enabled] == [CommandKind.RED_FLAG]


def test_a_command_that_waits_for_its_answer_shows_the_time_and_cannot_be_given_twice() -> None:
    pending = {(kind, 0): 2.1 for kind in (CommandKind.GREEN_GREEN, CommandKind.RED_FLAG)}
    screen = screen_of(state=IN_GARAGE, pending=pending)

    green = screen.button(CommandKind.GREEN_GREEN)
    why = 'no answer yet (2.1 s)'
    assert (green.enabled, green.reason, green.phrase) == (False, why, why)
    assert screen.button(CommandKind.RED_FLAG).enabled


# ----- the track ----------------------------------------------------------------------------


STOPPED_RACE = {'state': RED_RED, 'karts': (replace(KART, sent=RED_RED),)}
AWAY = {'state': RED_RED, 'karts': (replace(KART, sent=RED_RED, connected=False),)}
LOST = {'state': RED_RED, 'alerts': (replace(lost(7), use_msr=False),)}
LOST['karts'] = (replace(KART, connected=False, may_be_moving=True, hold=RED_RED),)
DRIVES = replace(KART, sent=GREEN_GREEN, acknowledged=True, may_be_moving=True)
STOPS = replace(DRIVES, number=8, sent=RED_RED, hold=RED_RED)
GREEN_RACE = {'state': GREEN_GREEN, 'karts': (DRIVES,)}
NO_RACE_YET = replace(
    RACE.track, reason='nobody has stated it yet', settled_by=CommandKind.OPEN_TRACK
)
LOUD = LOST | {'alerts': (lost(7),)}
ONE_HELD = GREEN_RACE | {'karts': (DRIVES, STOPS)}
ONE_LOST = ONE_HELD | {'alerts': (lost(8),)}
GARAGED = replace(KART, sent=IN_GARAGE)
FIRST_START = {'state': IN_GARAGE, 'track': NO_RACE_YET, 'karts': (GARAGED,)}
DOUBTFUL_START = FIRST_START | {'karts': (replace(GARAGED, may_be_moving=True),)}
SO, GREEN_NOW = 'so it is', 'the race is in GREEN GREEN'
ONLY_MSR = 'Only the MSR can stop kart 7. Leave the MSR on until kart 7 is switched off'
UNKNOWN = texts.HUMANS_UNKNOWN_REASON


@pytest.mark.parametrize(
    ('track', 'changes', 'text', 'tone', 'reason'),
    [
        ('open allowed', STOPPED_RACE, texts.TRACK_OPEN, Tone.GOOD, SO),
        ('open', STOPPED_RACE, texts.CLEAR_TRACK, Tone.BAD, SO),
        ('open', AWAY, texts.CLEAR_TRACK, Tone.BAD, SO),
        ('open allowed', AWAY, texts.UNHEARD_OPEN, Tone.WAIT, UNKNOWN),
        ('open allowed msr_used', AWAY, texts.TRACK_OPEN, Tone.GOOD, SO),
        ('allowed', STOPPED_RACE, texts.TRACK_CLOSED, Tone.PLAIN, SO),
        ('', STOPPED_RACE, texts.KEEP_OFF, Tone.WAIT, SO),
        ('', AWAY, texts.KEEP_OFF, Tone.WAIT, SO),
        ('allowed', AWAY, texts.UNHEARD_CLOSED, Tone.PLAIN, UNKNOWN),
        ('allowed msr_used', AWAY, texts.TRACK_CLOSED, Tone.PLAIN, SO),
        ('open allowed msr_used', LOST, texts.TRACK_OPEN_MSR, Tone.WAIT, ONLY_MSR),
        ('allowed msr_used', LOST, texts.TRACK_CLOSED_MSR, Tone.WAIT, ONLY_MSR),
        ('open allowed msr_used', LOUD, texts.CLEAR_TRACK, Tone.BAD, 'kart 7 was lost'),
        # In a green race, nothing is wrong before a kart that is held may be moving.
        ('', GREEN_RACE, texts.KEEP_OFF, Tone.PLAIN, GREEN_NOW),
        ('', ONE_HELD, texts.KEEP_OFF, Tone.WAIT, f'{GREEN_NOW}; kart 8 may be moving'),
        ('', ONE_LOST, texts.KEEP_OFF, Tone.BAD, f'kart 8 was lost; {GREEN_NOW}'),
        # At a first start, nobody has stated yet that there is no race anywhere.
        ('', FIRST_START, texts.TRACK_CLOSED, Tone.PLAIN, NO_RACE_YET.reason),
        ('', DOUBTFUL_START, texts.KEEP_OFF, Tone.BAD, NO_RACE_YET.reason),
    ],
)
def test_humans_are_allowed_only_on_an_open_track_and_not_because_no_kart_is_connected(
    track: str, changes: dict[str, Any], text: str, tone: Tone, reason: str
) -> None:
    access = TrackAccess(False, False, SO, False)
    access = replace(access, **dict.fromkeys(track.split(), True))

    screen = screen_of(**{'track': access, **changes})

    assert screen.humans == Cell(text, tone)
    assert reason in screen.humans_reason
    if changes.get('track') is NO_RACE_YET:  # to open the track settles that
        assert bool(screen.track_button.question.warning) is (tone is Tone.BAD)


def test_nothing_is_yellow_while_a_race_goes_as_it_should() -> None:
    for place, sent in ((0, GREEN_GREEN), (1, RED_FLAG)):
        kart = replace(KART, sent=sent, reported=sent, acknowledged=True, place=place)
        screen = screen_of(state=GREEN_GREEN, karts=(kart,))
        assert Tone.WAIT not in (screen.humans.tone, screen.state.tone)
        assert steps(screen) == [CommandKind.RACE_OVER] * place
    for others in ((), (kart,)):
        karts = (replace(kart, number=8, place=0), *others)
        assert screen_of(state=GREEN_GREEN, karts=karts).state.tone is Tone.WAIT
    # No step is the next while karts drive to their flag, or only the MSR stops one.
    assert not steps(screen_of(state=GREEN_GREEN, karts=(replace(DRIVES, place=1),)))
    covered = TrackAccess(False, True, 'the MSR was used', True)
    alarmed = AWAY | {'alerts': (lost(7),)}
    for changes, found in ((LOST, []), (AWAY, [CommandKind.IN_GARAGE]), (alarmed, [])):
        assert steps(screen_of(**(changes | {'track': covered}))) == found


def test_every_kart_that_needs_the_msr_is_named_and_that_it_is_in_use_stays_to_be_read() -> None:
    numbers = range(1, 8)
    moving = tuple(
        replace(KART, number=each, sent=RED_RED, may_be_moving=True) for each in numbers
    )
    stopped = tuple(replace(each, may_be_moving=False) for each in moving)
    loud = tuple(map(lost, numbers))
    quiet = tuple(replace(alert, use_msr=False) for alert in loud)
    unsafe = Alert(AlertKind.TRACK_UNSAFE, 0, 0.0, 'clear the track', True)
    in_use = {'track': replace(RACE.track, allowed=True, msr_used=True), 'alerts': quiet}
    named = 'karts 1, 2, 3, 4, 5, 6, 7'

    for changes, said in (
        ({'alerts': loud}, Cell(f'USE THE MSR: {named}', Tone.BAD)),
        ({'alerts': quiet}, Cell('')),
        (in_use, Cell(f'MSR IN USE: nothing else can stop {named}', Tone.WAIT)),
        ({**in_use, 'karts': stopped}, Cell('MSR IN USE', Tone.WAIT)),
        ({'alerts': (unsafe,)}, Cell('USE THE MSR', Tone.BAD)),
    ):
        screen = screen_of(**{'state': RED_RED, 'karts': moving, **changes})
        assert screen.msr == said
        for row in screen.rows:
            starts = row.note.text.startswith(texts.USE_MSR)
            urgent = row.use_msr, starts, row.note.tone is Tone.BAD
            assert urgent == (changes.get('alerts') is loud,) * 3


# ----- heats and places ---------------------------------------------------------------------


def test_the_order_of_start_is_shown_before_the_race_and_who_is_next_at_any_time() -> None:
    heats = Heat('Final', (3, 7)), Heat('TT 3', (3,)), Heat('Next', (3, 9))
    grids = HeatGrid('Final', (7, 3)), HeatGrid('TT 3', (3,)), HeatGrid('Next', ())
    runs = [RaceOfEvent(each, 'TT 3', 3600.0 * each, 3, counts=each == 1) for each in (1, 2)]
    known = timing(grids=grids, races=tuple(runs))
    fields = {'karts': (replace(KART, number=3), KART), 'heats': heats, 'heat': 'Final'}
    run, final = f'run at {time_of_day(7200.0)[:5]}', 'Final: 7, 3  (in grid order, in the race)'

    for next_heat, order, labels in (
        ('TT 3', 'Next: kart 3 (TT 3)', [final, f'TT 3: 3  ({run}, next)', 'Next: 3, 9']),
        ('', '', [final, f'TT 3: 3  ({run})', 'Next: 3, 9  (next)']),
    ):
        now = known._replace(next_heat=next_heat)
        screen = screen_of(now, state=IN_GARAGE, **fields)
        assert screen.order == ' · '.join(filter(None, ('Grid: 7, 3', order)))
        assert screen.order in table(screen)
        assert [(each.key, each.label) for each in screen.heats] == [
            *zip('123', labels, strict=True)
        ]
        assert screen_of(now, state=GREEN_GREEN, **fields).order == order
    assert screen_of(**fields).heats[1].label == 'TT 3: 3'
    fields['karts'] = replace(KART, number=3), replace(KART, in_race=False)
    assert screen_of(**fields).heats[0].label == 'Final: 3, 7  (in the race, without kart 7)'


def test_once_every_kart_has_finished_a_heat_the_next_step_is_the_next_heat_not_run() -> None:
    heats = tuple(Heat(name, (7,)) for name in ('Heat 1', 'Heat 2', 'Heat 3'))

    def next_of(*ran: str, place: int = 1, **changes: Any) -> tuple[list[CommandKind], str]:
        # Without laps, no run counts at the timekeeper.
        runs = tuple(RaceOfEvent(1, name, 3600.0, 0, counts=False) for name in ran)
        fields = {'state': IN_GARAGE, 'heats': heats, 'heat': 'Heat 1', **changes}
        fields['karts'] = (replace(KART, place=place),)
        screen = screen_of(timing(races=runs), **fields)
        heat = [CommandKind.SET_HEAT] * screen.heat_button.is_next
        return [*steps(screen), *heat], screen.next_heat

    assert next_of() == ([CommandKind.GRID_ACTIVE], 'Heat 2')
    assert next_of('Heat 1') == ([CommandKind.SET_HEAT], 'Heat 2')
    assert next_of('Heat 1', 'Heat 2') == ([CommandKind.SET_HEAT], 'Heat 3')
    assert next_of('Heat 1', heat='Heat 2') == ([CommandKind.GRID_ACTIVE], 'Heat 3')
    assert next_of('Heat 1', place=0) == ([CommandKind.GRID_ACTIVE], 'Heat 2')
    assert next_of('Heat 1', state=RED_RED)[0] == [CommandKind.IN_GARAGE]
    assert next_of('Heat 1', state=GRID_ACTIVE)[0] == [CommandKind.GREEN_GREEN]  # it is run again
    assert next_of('Heat 1', alerts=(lost(7),))[0] == []
    refused = offers(Availability(CommandKind.SET_HEAT, False, 'not now'))
    assert next_of('Heat 1', commands=refused)[0] == []
    assert next_of('Heat 1', 'Heat 2', 'Heat 3') == ([], '')


def test_a_heat_that_is_not_possible_says_why_and_without_any_the_roster_is_offered() -> None:
    refused = offers(Availability(CommandKind.SET_HEAT, False, 'the race is in RED_RED'))
    screen = screen_of(heats=(Heat('Heat A', (3,)), Heat('Final', (7,))), commands=refused)
    for button in (screen.heat_button, *screen.heats):
        assert not button.enabled
        assert 'the race is in RED_RED' in button.explanation

    for possible in (True, False):
        read = offers(Availability(CommandKind.READ_ROSTER, possible))
        screen = screen_of(commands=read)
        assert (screen.heat_button.enabled, screen.heats) == (possible, ())


def test_places_are_the_timekeepers_and_without_timing_the_order_of_finish_by_that_name() -> None:
    karts = tuple(replace(KART, number=number, place=place) for number, place in ((1, 2), (2, 1)))
    timed = driven(1, 6)._replace(place=1), driven(2, 6)._replace(place=2)
    known = 'Results: 1. kart 1, 2. kart 2', ['P1 6/6', 'P2 6/6']
    unknown = 'Order of FINISH: 1. kart 2, 2. kart 1', ['F2', 'F1']

    for state, (results, said) in itertools.product(
        RaceState,
        (
            (timing(karts=timed), known),
            (timing(run='earlier', karts=timed), unknown),
            (timing(karts=(driven(1, 0), driven(2, 0))), unknown),
            (None, unknown),
        ),
    ):
        screen = screen_of(results, karts=karts, state=state)
        assert (screen.places, [row.place for row in screen.rows]) == said
        assert screen.places in table(screen)
    for state, number, said in (
        (IN_GARAGE, 0, known),
        (GREEN_GREEN, 3, known),
        (RED_RED, 4, unknown),
    ):
        screen = screen_of(timing(race=3, karts=timed), karts=karts, state=state, number=number)
        assert screen.places == said[0]


def test_the_last_results_are_shown_with_their_heat_until_the_next_race_is_green() -> None:
    last = timing(run='earlier', heat='Heat 1', karts=(driven(7, 6)._replace(place=1),))

    for state in RaceState:
        said = '' if state is GREEN_GREEN else 'Results of Heat 1: 1. kart 7'
        assert screen_of(last, state=state, heat='Heat 2').places == said


# ----- race control that is gone or fails -----------------------------------------------------


def alerting(kind: AlertKind) -> Snapshot:
    return replace(RACE, alerts=(Alert(kind, 0, 0.0, 'It is so.', False),))


def test_the_failure_of_a_part_of_race_control_asks_for_the_msr() -> None:
    told = warning(alerting(AlertKind.PART_FAILED))
    assert told == Danger(texts.FAILED, texts.USE_MSR, 'It is so.')
    assert warning(alerting(AlertKind.KART_LOST)) == ALL_WELL


REST = replace(RACE, track=replace(RACE.track, allowed=True, reason='all are in the garage'))
STOPPED_BY_MSR = replace(RACE.track, allowed=True, msr_used=True)
UNCLEAR = replace(NO_RACE_YET, settled_by=CommandKind.IN_GARAGE)
MOVING = (replace(KART, may_be_moving=True),)
ENDED = {'ended': True}


@pytest.mark.parametrize(
    ('title', 'silent_for', 'how', 'changes'),
    [
        ('', 0.0, {}, {}),
        ('', GONE_AFTER - 0.01, ENDED, {}),
        (texts.GONE, GONE_AFTER, {}, {}),
        (texts.ENDED, GONE_AFTER, ENDED, {'state': IN_GARAGE}),
        (texts.ENDED, 5.0, ENDED, {'track': NO_RACE_YET}),
        (texts.GONE, 5.0, ENDED, {'track': replace(RACE.track, reason='it is GREEN_GREEN')}),
        (texts.GONE, 5.0, ENDED, {'track': UNCLEAR}),
        (texts.GONE, 5.0, ENDED, {'karts': MOVING}),
        (texts.GONE, 5.0, ENDED, {'karts': MOVING, 'track': STOPPED_BY_MSR}),
        (texts.GONE, 5.0, ENDED, {'alerts': (lost(7),)}),
        (texts.GONE, 5.0, ENDED, {'alerts': (Alert(AlertKind.PART_FAILED, 0, 0.0, 'x', True),)}),
        # Only the orderly end of the one race control is taken for its end.
        (texts.ENDED, 5.0, ENDED | {'then': REST}, {}),
        (texts.GONE, 5.0, {'ended': False}, {}),
        (texts.GONE, 5.0, ENDED | {'two': True, 'then': REST}, {}),
        (texts.GONE, 5.0, ENDED | {'then': replace(REST, run='another')}, {}),
    ],
)
def test_race_control_is_gone_within_a_second_unless_it_ended_without_a_doubt(
    title: str, silent_for: float, how: dict[str, Any], changes: dict[str, object]
) -> None:
    said = warning(replace(REST, **changes), silent_for=silent_for, **how)

    assert said.title == title
    assert GONE_AFTER < 1.0
    if title:
        assert (said.advice == texts.USE_MSR) is (title == texts.GONE)
        assert (said.stale, said.barred) == (True, texts.GONE_REASON)


def test_before_the_first_snapshot_there_is_no_sign_of_any_race() -> None:
    never = Latest(began=0.0).danger(3.0)
    told = never.title, never.barred, never.stale
    assert told == (texts.NOT_YET, texts.NOT_YET_REASON, True)
    assert never.advice != texts.USE_MSR


# ----- the row of a kart ------------------------------------------------------------------


OLDER = {'reported': GRID_ACTIVE}  # perhaps it reported this of an earlier GRID_ACTIVE
STOPPED = {'sent': RED_RED, 'acknowledged': True}
DRIVING = {'sent': GREEN_GREEN, 'acknowledged': True}
FLAGGED = {**DRIVING, 'place': 1, 'flag_at': 42.5}
INSPECTED = {'inspected': '2026-05-01'}
HELD = {'hold': RED_FLAG, 'hold_reason': 'ALL_KILL'}
SAYS, PERHAPS = 'says IN GARAGE', 'for an older order?'
TONES = {'✓': Tone.GOOD, '…': Tone.WAIT, '!': Tone.BAD}


@pytest.mark.parametrize(
    ('kart', 'answer', 'says', 'note'),
    [
        ({}, '… not yet', SAYS, ''),
        ({**OLDER, 'acknowledged': True}, '✓ ready', '', ''),
        # A kart that moved on the grid is not said to need only time.
        ({'acknowledged': True, 'may_be_moving': True}, '! may move', SAYS, texts.MAY_MOVE),
        ({**STOPPED, 'may_be_moving': True, 'settles_at': 42.0}, '… wait 2 s', SAYS, ''),
        ({**OLDER, 'counts_at': 42.0}, '… in 2 s', PERHAPS, ''),
        ({**OLDER, 'counts_at': 40.0}, '… not yet', PERHAPS, 'its GRID ACTIVE report may answer'),
        ({**OLDER, 'sent_since': 34.0}, '… not yet', '', 'its GRID ACTIVE report answered an old'),
        ({**OLDER, 'sent_since': 36.0}, '… not yet', '', ''),
        (INSPECTED, '… not yet', SAYS, 'inspected 2026-05-01'),
        ({**INSPECTED, **HELD}, '… not yet', SAYS, 'held: ALL_KILL'),  # which is more urgent
        (FLAGGED, '✓ driving', SAYS, 'F1, flag in 3 s'),
        ({**FLAGGED, 'flag_at': None}, '✓ driving', SAYS, ''),
        ({**FLAGGED, 'sent': RED_RED}, '✓ stopped', SAYS, ''),
        ({**FLAGGED, 'connected': False}, '! no answer', '', ''),
        ({'in_race': False}, '… not yet', SAYS, 'not in the race'),
        ({'stopped_itself': True, 'reported': RED_RED}, '! stopped itself', 'says RED RED', ''),
    ],
)
def test_a_row_says_what_a_kart_answered_and_what_it_needs(
    kart: dict[str, object], answer: str, says: str, note: str
) -> None:
    screen = with_kart(**kart)
    (row,) = screen.rows

    assert (row.answer, row.says) == (Cell(answer, TONES[answer[0]]), says)
    assert row.waits is (answer[0] != '✓' and screen.snapshot.karts[0].connected)
    assert row.place == ('F1' if 'place' in kart else '')
    assert row.note.text.startswith(note) if note else not row.note.text
    assert (row.note.tone is Tone.BAD) is (note == texts.MAY_MOVE)


@pytest.mark.parametrize(
    ('sent_since', 'since'), [(39.0, '0:01'), (-19.0, '0:59'), (-25.0, '1 min')]
)
def test_a_row_says_for_how_long_a_kart_was_sent_its_state(sent_since: float, since: str) -> None:
    (row,) = with_kart(sent_since=sent_since).rows
    assert row.since == since


def test_how_good_a_link_is_is_told_by_bars_a_word_and_a_time() -> None:
    for grade, bars, word, time, tone in (
        (Grade.UNKNOWN, 0, '✓ linked', '', Tone.PLAIN),
        (Grade.GOOD, 4, 'good', '13 ms', Tone.PLAIN),
        (Grade.FAIR, 2, 'fair', '621 ms', Tone.PLAIN),
        (Grade.POOR, 1, 'poor', '621 ms', Tone.WAIT),
    ):
        link = NOT_MEASURED._replace(grade=grade, round_trip=0.0121, worst_answer=0.6201)
        row = with_kart(link=link).rows[0]
        assert (row.bars, row.link, row.link_time) == (bars, Cell(word, tone), time)
        for in_race, stands_out in ((True, Tone.BAD), (False, Tone.FAINT)):
            away = with_kart(connected=False, link=link, in_race=in_race).rows[0]
            assert (away.bars, away.link, away.link_time) == (0, Cell('✗ NO LINK', stands_out), '')
    lost_outside = with_kart(connected=False, in_race=False, may_be_moving=True).rows[0]
    assert lost_outside.link.tone is Tone.BAD
    assert len(set(BARS.values())) == len(Grade)
    assert with_kart(link=NOT_MEASURED._replace(grade=Grade.GOOD)).rows[0].link_time == ''


def test_the_time_until_a_finished_kart_is_sent_its_flag_is_never_shown_too_short() -> None:
    for age, seconds in ((0.0, 3), (0.6, 2), (9.0, 1)):
        screen = screen_of(age=age, karts=(replace(KART, **FLAGGED),))
        assert screen.rows[0].note.text == f'F1, flag in {seconds} s'
        assert tally(screen.snapshot) == '1 driving'


def test_the_finish_key_of_a_kart_stays_its_own_when_another_leaves_the_race() -> None:
    karts = tuple(replace(KART, number=number) for number in range(1, 61))
    left = tuple(replace(kart, in_race=kart.number != 3) for kart in karts)

    keys = [row.buttons[2].key for row in screen_of(karts=karts).rows]

    assert keys == [row.buttons[2].key for row in screen_of(karts=left).rows]
    assert len({*filter(None, keys)}) == len(FINISH_KEYS)
    assert keys[len(FINISH_KEYS)] == ''  # more karts than keys are shown all the same
    assert (keys[0], keys[24]) == ('A', 'Shift+A')


def test_no_state_is_told_by_its_colour_alone() -> None:
    assert set(STATES) == set(STATE_CELLS) == {None, *RaceState}
    assert len(set(STATES.values())) == len(STATES)
    assert len({each.text[0] for each in STATE_CELLS.values()}) == len(STATE_CELLS)


# ----- the letter of a kart -----------------------------------------------------------------


def test_the_letter_of_finish_never_takes_a_finish_back() -> None:
    said = 'kart 7 (Purdue) has already finished as P1'
    commands = offers(Availability(CommandKind.KART_FINISH, False, said))

    screen = with_kart(place=1, commands=commands)

    finish = screen.button(CommandKind.KART_FINISH, 7)
    assert (finish.enabled, finish.reason) == (False, said)
    assert not any(each.key for each in screen.rows[0].buttons if each != finish)


FINAL = {'state': GREEN_GREEN, 'heat': 'Final'}
FIRST = timing(karts=(driven(7, 0),))
SEEN = Judged(Passing('line', 'today', 1), 7, Mark.COUNTED, 3.0, '')


@pytest.mark.parametrize(
    ('results', 'changes', 'given'),
    [
        (FIRST, {}, Act.COUNT),
        (timing(karts=(driven(7, 4),)), {'hold': RED_FLAG}, Act.COUNT),
        (timing(karts=(driven(7, 5),)), {}, CommandKind.KART_FINISH),
        (FIRST._replace(laps=0), {}, CommandKind.KART_FINISH),
        (FIRST, {'in_race': False}, CommandKind.KART_FINISH),
        (FIRST, {'place': 1}, CommandKind.KART_FINISH),
        (FIRST._replace(laps=1), {}, Act.COUNT),  # this crossing begins the lap
        (FIRST._replace(laps=1, from_green=True), {}, CommandKind.KART_FINISH),
        (FIRST._replace(laps=1, passings=(SEEN,)), {}, CommandKind.KART_FINISH),
        (None, {}, None),
        (Standings(0.0, laps=6), {}, None),  # it is old
        (timing(race=2), {}, None),  # it is of another race
        (timing(), {}, None),  # it is not of this kart
    ],
)
def test_the_letter_is_lap_until_only_the_last_lap_is_left_and_sends_nothing_without_timing(
    results: Standings | None, changes: dict[str, object], given: CommandKind | Act | None
) -> None:
    karts = (replace(KART, sent=GREEN_GREEN, **changes),)
    screen = screen_of(results, **FINAL, karts=karts)
    (row,) = screen.rows

    assert screen.button(CommandKind.KART_FINISH, 7).enabled  # by its number
    assert row.letter in row.buttons or 'place' in changes
    if given is not None:
        assert (row.letter.command, row.letter.enabled) == (given, True)
    else:
        assert (row.letter.enabled, row.letter.reason) == (False, texts.NO_TIMING_REASON)


def test_without_a_heat_the_letter_is_finish() -> None:
    (row,) = screen_of(state=GREEN_GREEN).rows
    assert (row.letter.command, row.letter.enabled) == (CommandKind.KART_FINISH, True)


def test_no_crossing_is_counted_while_race_control_is_gone_or_the_last_is_not_answered() -> None:
    for pending, danger_now in (({(Act.COUNT, 7): 0.1}, ALL_WELL), ({}, SILENT)):
        screen = screen_of(FIRST, 0.0, pending, danger_now, **FINAL)
        assert not screen.button(Act.COUNT, 7).enabled


# ----- the way of a race ------------------------------------------------------------------


def test_each_command_to_the_race_says_what_is_and_what_it_waits_for() -> None:
    waits = 'waiting for kart 8 (Purdue): not connected'
    waiting = Availability(CommandKind.GREEN_GREEN, False, waits)
    pause = Availability(CommandKind.IN_GARAGE, False, 'a stop', available_from=42.1)
    done = {'acknowledged': True, 'place': 1, 'sent': RED_FLAG, 'stands': True}
    away = {'number': 8, 'connected': False}
    each = {'acknowledged': True}, done, away, {**away, 'may_be_moving': True}
    karts = tuple(replace(KART, **changes) for changes in each)
    fields = {'commands': offers(waiting, pause), 'karts': karts}

    screen = screen_of(**fields)
    kinds = CommandKind.GRID_ACTIVE, CommandKind.GREEN_GREEN, CommandKind.IN_GARAGE
    grid, green, garage = map(screen.button, kinds)

    assert grid.phrase == f'since {time_of_day(RACE.state_since)}'
    assert green.phrase == waits
    assert f'GREEN GREEN  {waits}' in table(screen)
    assert garage.phrase == 'possible again in 3 s: a stop'
    assert not garage.enabled  # until race control says so
    strip = texts.missing, texts.heat_in_race, tally
    shown = ['waiting for 8, 8', '4 karts', '1 ready, 1 finished, 1 not connected, 1 lost']
    assert [text(screen.snapshot) for text in strip] == shown
    for state in (IN_GARAGE, RED_FLAG, RED_RED):  # a race that was stopped begins on the grid
        green = screen_of(state=state, **fields).button(CommandKind.GREEN_GREEN)
        assert green.phrase == 'after GRID ACTIVE'
    over = screen_of(state=RED_RED, over=True)
    assert over.button(CommandKind.RACE_OVER).phrase == 'the race is over'
    assert 'the race is over' in '\n'.join(table(over))


BEGUN, OVER = BEGINS_WITHIN, BEGINS_WITHIN + REMINDS_FOR
SILENT_KART = {'acknowledged': False}
LAPS = (driven(7, 2), driven(8, 2))
CROSSED = tuple(SEEN._replace(kart=each) for each in (7, 8))


@pytest.mark.parametrize(
    ('green_for', 'age', 'changes', 'results', 'reminded'),
    [
        (BEGUN - 0.1, 0.0, {}, {}, False),
        (BEGUN, 0.0, {}, {}, True),
        (BEGUN - 1.0, 1.0, {}, {}, True),
        (OVER - 0.1, 0.0, {}, {}, True),
        (OVER, 0.0, {}, {}, False),
        # A kart that has not answered is not forgotten; one sent another state need not drive.
        (OVER, 0.0, SILENT_KART, {}, True),
        (BEGUN, 0.0, {'sent': RED_RED, 'acknowledged': False}, {}, False),
        (BEGUN, 0.0, {'in_race': False}, {}, False),
        # A kart that was seen to cross the line has begun, whatever it acknowledged.
        (OVER, 0.0, SILENT_KART, {'karts': LAPS[:1]}, True),
        (OVER, 0.0, SILENT_KART, {'karts': LAPS}, False),
        (OVER, 0.0, SILENT_KART, {'passings': CROSSED}, False),
        (OVER, 0.0, SILENT_KART, {'passings': CROSSED, 'race': 2}, True),  # in another race
    ],
)
def test_once_the_race_is_green_for_30_s_it_is_said_that_each_kart_must_have_begun(
    green_for: float,
    age: float,
    changes: dict[str, object],
    results: dict[str, Any],
    reminded: bool,
) -> None:
    kart = replace(KART, **(DRIVING | changes))
    race = {'state': GREEN_GREEN, 'stamp': green_for, 'karts': (kart, replace(kart, number=8))}
    known = Standings(green_for, **results)

    reminder = screen_of(known, age, **race).reminder

    assert ('30 s' in reminder, bool(reminder)) == (reminded, reminded)
    assert not screen_of(known, age, danger=SILENT, **race).reminder
    assert not screen_of(known, age, alerts=(lost(7),), **race).reminder  # there is room for one


# ----- laps ---------------------------------------------------------------------------------


def test_a_row_shows_position_lap_and_gap_beside_what_is_more_urgent() -> None:
    karts = tuple(replace(KART, number=number, hold=RED_FLAG) for number in (7, 8, 9))
    best = driven(8, 3)
    late = best._replace(kart=7, place=2, total=32.5)
    known = timing(karts=(best, late, driven(9, 1)._replace(place=3)))

    rows = screen_of(known, karts=karts).rows

    assert [row.place for row in rows] == ['P2 3/6', 'P1 3/6', 'P3 1/6']
    assert [row.gap for row in rows] == ['+2.500', '', '+2 laps']
    assert all(texts.HELD.format(reason='') in row.note.text for row in rows)


def test_results_that_are_out_of_date_or_of_the_future_are_no_timing() -> None:
    for age, said in ((0.0, ''), (TIMING_GONE - 0.1, ''), (TIMING_GONE, texts.NO_TIMING)):
        for ahead in (age, -age):
            known = timing(stamp=RACE.stamp + ahead, karts=(driven(7, 3),))
            screen = screen_of(known)
            assert (screen.timing, bool(screen.places)) == (said, not said)
    assert screen_of().timing == texts.NO_TIMING
    assert texts.NO_TIMING in table(screen_of())
    assert screen_of(timing(race=2), **FINAL).timing == texts.NO_TIMING


def test_a_disagreement_about_results_is_no_question_to_the_race_director() -> None:
    known = timing(karts=(driven(7, 3),))
    asked = known._replace(questions=('Kart 7 is marked as finished, but 3 laps are missing',))

    screens = [screen_of(results) for results in (asked, known)]
    assert table(screens[0]) == table(screens[1])
    assert screens[0].rows == screens[1].rows


def test_a_disqualified_kart_is_said_to_be_so_once_with_the_reason() -> None:
    out = Penalty(7, 0, 0, True, 'not fit to race', 'Ben')
    kart = driven(7, 1)._replace(place=0, status=Status.DISQUALIFIED, penalties=(out,))

    assert results_table(timing(karts=(kart,)), {})[1][-1] == 'disqualified: not fit to race'


def test_the_races_of_the_event_are_listed_with_the_numbers_by_which_one_is_chosen() -> None:
    known = timing(races=(RaceOfEvent(1, 'A', 0.0, 2, False), RaceOfEvent(2, 'A', 60.0, 3, True)))

    assert [(*row[:1], *row[2:]) for row in races(known)] == [
        ('1', 'A', '2 classified', ''),
        ('2', 'A', '3 classified', 'counts'),
    ]


def test_a_kart_whose_last_lap_is_done_is_named_in_the_strip_and_in_its_row() -> None:
    lap_taken = Penalty(7, 0, 1, False, 'short cut', 'Ben')  # it has driven that lap all the same
    known = timing(karts=(driven(7, 6)._replace(laps=5, penalties=(lap_taken,)),))

    screen = screen_of(known, **FINAL)

    assert screen.reminder == 'FINISH 7: last lap done'
    assert texts.LAST_LAP_DONE in screen.rows[0].note.text
    assert screen.rows[0].note.tone is Tone.WAIT
    assert not screen_of(known, danger=SILENT, **FINAL).reminder
    for changes in ({'place': 1}, {'in_race': False}, {'hold': RED_FLAG}):
        assert not screen_of(known, **FINAL, karts=(replace(KART, **changes),)).reminder
