# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
No two statements of one screen contradict each other, whatever race control says.

The snapshots are random, and the rules never lead to some of them. A screen may be wrong in only
one way: it may be too careful.
"""

from __future__ import annotations

from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.link_quality import NOT_MEASURED
from evgp_rcs.rules.race import Alert, AlertKind, TrackAccess
from evgp_rcs.rules.snapshot import KartSnapshot, Snapshot
from evgp_rcs.words import ALL_LOST, Cell, STATE_CELLS, STATES, tally, time_of_day, Tone
from evgp_rcs_console import texts
from evgp_rcs_console.notices import ALERT_MSR, AlertBook
from evgp_rcs_console.view import Danger, Screen, table
from example_race import EVERYTHING, KART, RACE, replace, warning
from hypothesis import given, settings
from hypothesis import strategies as st

RED = (RaceState.RED_FLAG, RaceState.RED_RED)
ALLOWED = (
    texts.TRACK_OPEN,
    texts.TRACK_OPEN_MSR,
    texts.TRACK_CLOSED,
    texts.TRACK_CLOSED_MSR,
)
SETTLE = CommandKind.IN_GARAGE, CommandKind.OPEN_TRACK
MSR_KINDS = (
    AlertKind.LOST_IN_MOTION,
    AlertKind.RED_UNACKNOWLEDGED,
    AlertKind.TRACK_UNSAFE,
    AlertKind.KART_LOST,
    AlertKind.NOT_READY,
)
FLAGS = (
    *('in_race', 'connected', 'acknowledged', 'may_be_moving', 'stands'),
    *('stopped_itself', 'poor_lately'),
)
"""What is true of a kart or not."""


@st.composite
def karts(draw: st.DrawFn, number: int) -> KartSnapshot:
    hold = draw(st.sampled_from((None, *RED)))
    sent = hold or draw(st.sampled_from(RaceState))
    reported = draw(st.sampled_from((None, *RaceState)))
    grade = draw(st.sampled_from(Grade))
    return replace(
        KART,
        number=number,
        sent=sent,
        reported=reported,
        hold=hold,
        hold_reason='' if hold is None else 'ALL_KILL by Anna',
        settles_at=draw(st.sampled_from((None, 42.5))),
        counts_at=draw(st.sampled_from((None, 40.0, 42.5))),
        flag_at=draw(st.sampled_from((None, 42.5))),
        link=NOT_MEASURED._replace(grade=grade, worst_answer=0.6, round_trip=0.01),
        **{name: draw(st.booleans()) for name in FLAGS},
    )


@st.composite
def races(draw: st.DrawFn) -> Snapshot:
    """Return a random snapshot, with at most four karts and three alerts."""
    alert = st.builds(
        Alert,
        kind=st.sampled_from(MSR_KINDS),
        kart=st.integers(0, 4),
        since=st.just(0.0),
        use_msr=st.booleans(),
        text=st.just('it is so'),
    )
    track = st.builds(
        TrackAccess,
        open=st.booleans(),
        allowed=st.booleans(),
        reason=st.just('a reason'),
        msr_used=st.booleans(),
        settled_by=st.sampled_from((None, *SETTLE)),
    )
    return RACE._replace(
        state=draw(st.sampled_from(RaceState)),
        over=draw(st.booleans()),
        karts=tuple(draw(karts(number)) for number in range(1, draw(st.integers(0, 4)) + 1)),
        commands=EVERYTHING,
        track=draw(track),
        alerts=tuple(draw(st.lists(alert, max_size=3))),
        state_cause='ALL_KILL by Anna',
    )


def dangers(race: Snapshot) -> list[Danger]:
    """Return the warnings about race control that are possible with this newest snapshot."""
    return [warning(race), warning(race, two=True), warning(race, silent_for=5.0)]


def statements(race: Snapshot, screen: Screen, shown_danger: Danger) -> list[str]:
    """Return all texts on the screen that speak against humans on the track."""
    book = AlertBook()
    book.update(race.alerts)
    said = [str(notice) for notice in book.shown if notice.use_msr]
    said += [row.note.text for row in screen.rows if texts.MAY_MOVE in row.note.text]
    said += [shown_danger.title] if shown_danger.title else []
    states = [screen.state.text, screen.since]
    rows = zip(race.karts, screen.rows, strict=True)
    states += [row.sent.text for kart, row in rows if kart.connected]
    under_way = STATES[RaceState.GRID_ACTIVE], STATES[RaceState.GREEN_GREEN]
    return said + [text for text in states if any(state in text for state in under_way)]


def humans_are_allowed_only_where_nothing_else_on_the_screen_speaks_against_it(
    race: Snapshot, _: Screen
) -> None:
    for shown in dangers(race):
        screen = Screen(race, 0.0, {}, shown)

        if screen.humans.text in ALLOWED or screen.humans.tone is Tone.GOOD:
            # At a first start, the track is closed, and an official's statement opens it.
            first = race.track.settled_by is CommandKind.OPEN_TRACK and not race.track.open
            by_statement = first and screen.humans == Cell(texts.TRACK_CLOSED)
            assert race.track.allowed or by_statement
            assert not statements(race, screen, shown)
        if screen.humans.tone is Tone.GOOD:
            assert race.track.open
            assert not any(kart.in_doubt for kart in race.karts)
        elif screen.humans.text == texts.KEEP_OFF:
            assert screen.humans.tone is Tone.BAD or not any(
                alert.use_msr for alert in race.alerts
            )


def what_is_largest_is_true_of_a_kart_of_the_race(race: Snapshot, screen: Screen) -> None:
    rows = [*zip(race.karts, screen.rows, strict=True)]
    concerned = [each for each in rows if each[0].in_race] or rows
    sent = {row.sent.text for kart, row in concerned if kart.connected}

    shown = {STATE_CELLS[each].text: each for each in RaceState}
    state = shown.get(screen.state.text)
    if state in (RaceState.RED_RED, RaceState.IN_GARAGE) and not sent:
        # A kart without a link stops, and in the garage it may still connect.
        assert state is race.state
    elif state is not None:
        assert screen.state.text in sent
    else:
        assert not any(STATES[race.state] in each for each in sent)
        assert not (sent and screen.state == ALL_LOST)
    # The screen always shows the state of the race and who caused it.
    assert STATES[race.state] in f'{screen.state.text} {screen.since}'
    assert race.state_cause in screen.since
    assert time_of_day(race.state_since) in screen.since


def an_open_track_never_looks_like_a_closed_one(race: Snapshot, screen: Screen) -> None:
    closed = Screen(replace(race, track=replace(race.track, open=False)), 0.0, {}).humans
    if race.track.open:
        assert screen.humans.text != closed.text
        assert (screen.humans.tone is Tone.BAD) is (screen.humans.text == texts.CLEAR_TRACK)
    else:
        assert 'OPEN' not in screen.humans.text


def red_is_only_what_is_wrong(race: Snapshot, screen: Screen) -> None:
    wrong = any(alert.use_msr for alert in race.alerts)
    # Nothing is wrong with a kart that is being stopped and has not stopped yet.
    doubtful = any(
        kart.in_doubt and not (kart.connected and kart.sent in RED) for kart in race.karts
    )
    if screen.humans.tone is Tone.BAD:
        assert wrong or doubtful or race.track.open
    for kart, row in zip(race.karts, screen.rows, strict=True):
        assert row.sent.tone is not Tone.RED or kart.connected
        if row.link.tone is Tone.BAD:
            assert not kart.connected
            assert kart.may_be_moving or (kart.in_race and race.state is not RaceState.IN_GARAGE)


def the_ordinary_way_out_of_the_grid_has_no_warning(race: Snapshot, _: Screen) -> None:
    quiet = replace(
        race,
        state=RaceState.GRID_ACTIVE,
        alerts=(),
        karts=tuple(replace(kart, connected=True, may_be_moving=False) for kart in race.karts),
        track=TrackAccess(False, False, 'the race is in GRID_ACTIVE', False),
    )

    button = Screen(quiet, 0.0, {}).button(CommandKind.IN_GARAGE)

    assert button.question.condition
    assert not button.question.warning


def a_question_that_lets_humans_near_warns_of_what_the_screen_says(
    race: Snapshot, _: Screen
) -> None:
    screen = Screen(replace(race, track=replace(race.track, open=False)), 0.0, {})
    by_msr = screen.humans == Cell(texts.TRACK_CLOSED_MSR, Tone.WAIT)
    track, heard = race.track, any(kart.connected for kart in race.karts)
    doubt = bool(race.msr_alerts) or any(kart.in_doubt for kart in race.karts)
    asks = [screen.button(command) for command in SETTLE]
    asks += [screen.button(CommandKind.KART_IN_GARAGE, 1)] * bool(race.karts)
    for button in asks:
        settles, warned = button.command is track.settled_by, button.question.warning
        if not button.kart and (screen.humans.tone is Tone.BAD or by_msr):
            assert warned
        if race.state not in texts.UNDER_WAY:  # which is nothing wrong
            assert (track.reason in warned) is not (track.allowed or settles)
        if track.allowed and not doubt:
            assert bool(warned) is not (heard or track.msr_used)


def a_kart_that_may_be_moving_is_not_shown_as_stopped(race: Snapshot, screen: Screen) -> None:
    for kart, row in zip(race.karts, screen.rows, strict=True):
        if kart.in_doubt:
            assert row.answer.tone is not Tone.GOOD
            settling = kart.connected and kart.acknowledged and kart.sent in RED
            told = texts.MSR_STOPS_IT if race.track.msr_used else texts.MAY_MOVE
            assert (told in row.note.text) is not settling
    stopped = [kart for kart in race.karts if kart.in_race and kart.sent in RED]
    sure = sum(kart.connected and kart.stands for kart in stopped)
    told = dict(
        reversed(each.split(' ', 1)) for each in tally(screen.snapshot).split(', ') if each
    )
    assert int(told.get('stopped', 0)) == sure
    assert sum(map(int, told.values())) == sum(kart.in_race for kart in race.karts)


def the_terminal_says_what_the_window_says(race: Snapshot, _: Screen) -> None:
    for shown in dangers(race):
        screen = Screen(race, 0.0, {}, shown)

        lines = '\n'.join(table(screen))

        said = [screen.state, screen.humans, screen.msr, *(row.note for row in screen.rows)]
        said += [row.link for row in screen.rows]
        told = screen.since, screen.humans_reason, screen.reminder, tally(screen.snapshot)
        assert [each for each in (*(cell.text for cell in said), *told) if each not in lines] == []
        assert lines.count(ALERT_MSR) == sum(alert.use_msr for alert in race.alerts)


SENTENCES = (
    humans_are_allowed_only_where_nothing_else_on_the_screen_speaks_against_it,
    what_is_largest_is_true_of_a_kart_of_the_race,
    an_open_track_never_looks_like_a_closed_one,
    red_is_only_what_is_wrong,
    the_ordinary_way_out_of_the_grid_has_no_warning,
    a_question_that_lets_humans_near_warns_of_what_the_screen_says,
    a_kart_that_may_be_moving_is_not_shown_as_stopped,
    the_terminal_says_what_the_window_says,
)


@settings(max_examples=300)
@given(races())
def test_no_two_statements_of_one_screen_contradict_each_other(race: Snapshot) -> None:
    screen = Screen(race, 0.0, {})
    for holds in SENTENCES:  # drawing a race takes longer than checking its screen
        holds(race, screen)
