# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Faults put into the rules of the race on purpose: the oracle's search must find every one.

This is the test of the oracle. A property that no fault can break proves nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from types import ModuleType
from typing import Any

from evgp_rcs.rules import inputs, race
import pytest
import race_oracle as oracle
from rig.faults import faults_in, module_with

pytestmark = [pytest.mark.usefixtures('others_first'), pytest.mark.timeout(900)]

REQUIRED = {'require_inspection': True}
AT_ONCE = {'settle_time': 0.0}
ALL_OF_ONE = oracle.KART_COMMANDS

ONE_SILENT = (
    inputs.Connected(0.0, 1),
    inputs.Connected(0.0, 2),
    inputs.Disconnected(0.0, 1, oracle.GONE, True),
)
ON_THE_GRID = oracle.command('GRID_ACTIVE', 0, True)

ANNA = inputs.Attended(0.0, oracle.ANNA)
NOBODY = inputs.Attended(0.0, oracle.NOBODY)

UNDONE_AND_HOME = (
    oracle.command('KART_FINISH', 1),
    oracle.command('KART_UNDO_FINISH', 1, True),
    oracle.command('RACE_OVER'),
    oracle.command('KART_IN_GARAGE', 1, True),
    oracle.command('IN_GARAGE', 0, True),
    oracle.command('JOIN_RACE', 1),
)

HOME_AND_AGAIN = (oracle.command('IN_GARAGE', 0, True), ON_THE_GRID)

World = tuple[int, dict[str, Any]]


def world(most: int, racing: int, outside: int, begin: str = 'garage', **more: object) -> World:
    """Return a small world, and the number of its states that are searched."""
    return most, {'racing': racing, 'outside': outside, 'begin': begin, **more}


# Each fault is found in one of them well before so many states.
WORLDS = {
    'one outside': world(150, 1, 1),
    'green': world(150, 1, 0, 'green'),
    'grid': world(150, 1, 1, 'grid', times=AT_ONCE),
    'around': world(320, 1, 0, 'grid', around=True, times=AT_ONCE),
    'crash': world(150, 1, 0, 'crash'),
    'lost on the grid': world(150, 1, 0, 'lost on the grid'),
    'unknown': world(150, 1, 0, 'unknown'),
    'network': world(60, 1, 0, 'grid', network=True, times=AT_ONCE),
    'network and pauses': world(60, 1, 0, 'grid', network=True, waits=True),
    'first': world(60, 1, 0, 'first'),
    'silence on the grid': world(60, 1, 1, 'grid', silence=True, times=AT_ONCE),
    'silence in the garage': world(150, 1, 1, silence=True, then=ONE_SILENT),
    'silence for long': world(5, 1, 1, silence=True, then=(*ONE_SILENT, inputs.Tick(3.0))),
    'silence outside': world(10, 1, 1, silence=True, then=(*ONE_SILENT, ON_THE_GRID)),
    'unknown outside': world(150, 0, 1, 'unknown', times={'settle_time': 2.0}),
    'waits': world(150, 1, 1, 'grid', waits=True, times=AT_ONCE),
    'a second grid': world(30, 1, 0, 'grid', waits=True, then=HOME_AND_AGAIN, times=AT_ONCE),
    'held up': world(
        200, 0, 1, 'unknown', waits=True, without=ALL_OF_ONE, times={'settle_time': 2.0}
    ),
    'two in green': world(300, 2, 0, 'green'),
    'two on the grid': world(100, 2, 0, 'grid'),
    'two': world(150, 2, 0),
    'heats': world(60, 1, 1, heats=True),
    'heats alike': world(5, 2, 0, heats=True),
    'an undone finish': world(20, 1, 0, 'green', then=UNDONE_AND_HOME, times=AT_ONCE),
    'two heats': world(60, 1, 1, 'green', heats=True),
    'people on the grid': world(100, 1, 0, 'grid', people=True, then=(ANNA,), times=AT_ONCE),
    'people in green': world(100, 1, 0, 'green', people=True, then=(ANNA,)),
    'nobody told': world(
        60, 1, 0, 'green', people=True, then=(ANNA,), times={'nobody_there': 0.0}
    ),
    'an abandoned grid': world(
        30, 1, 0, 'grid', people=True, waits=True, then=(ANNA, NOBODY), without=ALL_OF_ONE
    ),
    'a race after one without people': world(
        60, 1, 0, 'garage', people=True, then=(ANNA, NOBODY), times=AT_ONCE, without=ALL_OF_ONE
    ),
    'uninspected outside': world(60, 1, 1, times=REQUIRED, uninspected=(2,)),
    'uninspected': world(60, 1, 1, times=REQUIRED, uninspected=(1,)),
}

# The nearest states of all worlds come first: there most faults are found.
NEAREST = (16, 60)

FAULTS = faults_in(
    """
what was said before the command is an acknowledgement: ack-old heard: without serial
anything said under the present serial is an acknowledgement: ack-old heard: sent == => serial ==
    kart.serial
an acknowledgement of GREEN_GREEN is not heard: ack-deaf heard: sent == => state is kart.sent is
    not GREEN_GREEN and serial == kart.serial
no acknowledgement is heard: ack-deaf, stuck heard: serial == => serial > kart.serial
time acknowledges: ack-from-nothing tick: after _settle: kart.acknowledged = kart.connected
an order to a kart that is not connected: order-wrong, restart _redirect: always connected
a stop is announced as allowed, and refused: stop-refused _refusal_of: after availability: if kind
    is CommandKind.ALL_KILL and self.state is IN_GARAGE: ¶> return 'nothing is under way'
an acknowledgement survives the connection: ack-survives _drop: skips _void_answers
a new connection goes on under the old serial: order-serial _redirect: 1 #1 => changed
a reconnection lets a hold be forgotten: hold-forgotten, red-loosened connected: went_silent_at =>
    kart.hold
a kart that drops in RED_FLAG is not held: drop-not-held [green] _drop: state GRID_ACTIVE =>
    self.state not in (GRID_ACTIVE, RED_FLAG)
a kart that drops is held in RED_FLAG only: drop-not-held _drop: RED_RED #1 => RED_FLAG
a kart that is replaced while connected does not count as dropped: drop-not-held, alerts connected:
    skips _drop
RED_FLAG loosens RED_RED: stop-loosens, stop-idempotent, red-loosened _red_flag: never RED_RED
a later hold loosens an earlier one: stop-loosens, stop-idempotent, hold-forgotten _hold: stricter
    hold => hold
a stop is refused to a kart outside the race: availability, stop-refused _refusals: first: if kind
    is CommandKind.KART_RED_RED and not kart.sent.is_red: ¶> yield f'{kart} is not being sent a
    red'
a stop that is in force is sent again and its acknowledgement falls: stop-idempotent _redirect:
    resend changed => changed or resend or state is RED_RED
a kart is not told at once: stop-at-once, sent-wrong, restart _hold: skips _redirect
ALL_KILL forgets the karts outside the race: stop-at-once _all_kill: values #1 => self.racing
GREEN_GREEN after another command than GRID_ACTIVE: available-from, availability, green-needs-grid
    [grid] command: instead of GRID_ACTIVE: self.grid_was_last |= kind is
    CommandKind.GRID_ACTIVE
closing the track comes between GRID_ACTIVE and GREEN_GREEN: availability [grid] command:
    bookkeeping => it and kind is not CommandKind.CLOSE_TRACK
GREEN_GREEN while a kart is not connected: availability, green-needs-acks _refusals: racing
    _unanswered => self._unanswered(each for each in self.racing() if each.connected)
GREEN_GREEN while a kart has not acknowledged: availability, green-needs-acks, refusal-silent
    _refusals: racing _unanswered => self._unanswered(each for each in self.racing() if not
    each.connected)
GRID_ACTIVE while a kart is held: availability _no_race: _held racing => _held(each for each in
    racing if each.hold is RED_FLAG)
GRID_ACTIVE without the statement that the track is clear: statement COMMANDS: clear => ''
joining the race releases a held kart: membership-loosens, hold-forgotten _join_race: after
    in_race: self._unhold(kart)
a kart that is taken out on the grid is not held: effect, sent-wrong _leave_race: _hold out =>
    self._redirect(kart, now)
a kart leaves the race while it drives: availability COMMANDS: LEAVE_RACE _leave_race =>
    Rule(Race._leave_race)
IN_GARAGE while a kart is silent: availability _refusals: _waited_for _unanswered =>
    self._unanswered(each for each in self._waited_for() if not each.hold)
IN_GARAGE releases a kart that never acknowledged its red: hold-forgotten, red-loosened, as-seen,
    stuck _released_by_garage: always stands
IN_GARAGE leaves the use of the MSR in force for the next race: effect _race_in_garage: without
    msr_used
a release without the statement that a silent kart was made safe: statement COMMANDS: stands was =>
    ''
a kart released during a race goes on with the race: effect, sent-wrong, red-to-green,
    green-only-by-command _release_kart: state IN_GARAGE => self.state is RED_RED
a finish stops the kart on the finish line: sent-wrong, effect tick: without flag_at >=
a finish is never followed by RED_FLAG: sent-wrong, finish-put-off [green] tick: skips _hold
every place has the delay of the first: effect finish_delay: finish_delays - => 0
a kart finishes twice: availability _refusals: place #1 => it > 1
a finish that is undone ends the hold of the kart: red-loosened, hold-forgotten [green]
    _kart_undo_finish: before attempt: if kart.flag_at is None: ¶> self._unhold(kart) ¶>
    self._redirect(kart, now)
a finish that is undone sends the kart on: green-needs-grid, red-loosened, green-only-by-command
    [green] _kart_undo_finish: before attempt: if self.state is RED_FLAG: ¶>
    self._go(GREEN_GREEN, now)
later places stay when a finish is undone: effect [two in green] _kart_undo_finish: skips place -
a finish is undone when the order of FINISH was told: availability [green] _refusals: never
    starters
a finish is undone without the statement that the kart has not finished: statement COMMANDS: kart
    has => ''
the race goes over while a finish is outstanding: sent-wrong, effect _all_have_finished:
    without flag_at
the race goes over when the first kart has finished: sent-wrong, effect [two in green]
    _all_have_finished: all ( => any(kart.place and kart.flag_at is None for kart in racing)
humans may be on the track while the race drives: track-access, availability track_access: state
    GREEN_GREEN => self.state is GRID_ACTIVE
the track stays open when the grid forms: track-open-in-motion _grid_active: skips track_open
the track closes for the grid whoever has been let onto it since: as-seen _misnamed: opening != =>
    command.opening > self.opening
an opening of the track is not counted: as-seen, effect _open_track: instead of
    _count_opening: self.track_open = True
a kart that was lost in a race goes home with all others: stuck, effect, sent-wrong, availability
    away_at_rest: without lost
a kart that was away when an official held it goes home with all others: alone-released, effect,
    sent-wrong, availability away_at_rest: without held_alone
a kart that was away must be released alone: availability, effect, sent-wrong, as-seen
    _released_by_garage: without away_at_rest
the race waits for karts that were away when all were stopped: availability _waited_for: without
    sent away_at_rest
a kart lost in motion lets humans on the track: track-access, availability _danger: skips
    may_be_moving MSR
an open track asks for the MSR although every kart obeys its stop: use-msr alerts: stopped => False
a kart that was told to go counts as standing: doubt-unnoticed, effect _redirect:
    _covered_by_statement not => state is not GREEN_GREEN and it
a refused command takes GREEN_GREEN away: refused-changes command: after refused:
    if refusal: ¶> self.grid_was_last = False
a refusal does not name the kart: refusal-silent _unanswered: _silence f =>
    f'{self._silence(each)}'
looking at alerts acts: alerts-act alerts: first: self.track_open = False
a lost kart raises no alert: effect, alerts _drop: doubt under_way => under_way and
    kart.may_be_moving
a silent kart in RED_FLAG raises no alert: alerts _current_alerts: flag_alert =>
    self.times.ready_alert + 9.0
every kart is said to have acknowledged when one has: false-news [two on the grid]
    _report_all_answered: all answered => any(kart.answered for kart in waited_for)
a kart connecting during a race is sent IN_GARAGE: sent-wrong, red-loosened, order-wrong, ack-deaf
    _redirect: _commanded kart => IN_GARAGE if resend else it
a heat leaves the others in the race: effect _set_heat: karts number => each.in_race or it
a heat releases the karts that it puts into the race: membership-loosens, hold-forgotten _set_heat:
    after number: if each.in_race: ¶> self._unhold(each)
a heat that takes a kart out forgets that it may be moving: doubt-forgotten [two] _set_heat: after
    number: each.doubt = each.doubt if each.in_race else Doubt.NONE
a heat is put into a race that is under way: availability COMMANDS: SET_HEAT _set_heat =>
    Rule(Race._set_heat)
a heat that the roster does not have empties the race: availability, effect _no_such_heat: first:
    if name == 'no such heat': ¶> self.heats += (Heat(name, ()),)
a heat that is not in the roster is refused without those that are: refusal-silent _no_such_heat:
    join name => 'others'
the places are gone with IN_GARAGE: results, effect [green] _race_in_garage: after flag_at:
    each.place = 0
the order of FINISH of a race that was stopped is never told: results _race_in_garage: skips
    _report_order_of_finish
the order of FINISH is told again with every RACE_OVER: results _report_order_of_finish: skips
    starters = #2
the order of FINISH leaves out who did not finish: results _report_order_of_finish: place not => it
    and each.in_race
a restart forgets that the order of FINISH was never told: restart recover: memory starters => ()
a kart that is held is given a place: availability _refusals: skips hold
an unanswered stop leaves no doubt: doubt-unnoticed, alarm-cleared _redirect: _covered_by_statement
    not => state is GREEN_GREEN and it
a kart told to form the grid leaves no doubt: doubt-unnoticed _redirect: skips GRID
a lost connection ends the doubt: effect, doubt-forgotten, drop-not-held, alerts _drop: after
    _void_answers: kart.doubt = Doubt.NONE
a kart that is back counts as standing: effect, doubt-forgotten, alarm-cleared, drop-not-held,
    alerts, settle connected: instead of may_be_moving: kart.lost = False ¶ kart.doubt =
    Doubt.NONE
a kart that is back ends the alarm of its loss: effect, alarm-cleared, alerts connected: instead of
    may_be_moving: kart.lost = False
the alarm of a kart lost in motion is told of missing karts only: alarm-cleared, alerts
    _current_alerts: may_be_moving #1 => it and not kart.connected
a kart outside the race that drops with a stop unanswered raises no alert: effect, alarm-cleared,
    alerts _drop: without doubt
any acknowledgement ends the doubt: doubt-forgotten, effect heard: always is_red #1
the acknowledgement of a stop leaves the doubt: effect, stuck heard: is_red state => state is
    RED_FLAG
a kart that says GREEN_GREEN unasked is not seen: doubt-unnoticed heard: sent GREEN_GREEN =>
    kart.sent is GRID_ACTIVE
a kart seen to move and lost comes back to be tested on: drop-not-held _drop: never may_be_moving
a kart lost on the grid lets humans on the track: track-access, availability _danger: GRID doubt =>
    it and kart.in_race and (self.state is IN_GARAGE)
a kart in the garage that was seen to move lets humans on the track: track-access, availability,
    refusal-silent, restart _danger: may_be_moving #1 => kart.hold
the grid forms with a kart that was seen to move: availability [around] _no_race: may_be_moving =>
    each.hold
GREEN_GREEN counts the acknowledgement of a red: availability, green-needs-acks, refusal-silent
    [around] _refusals: _no_race ( #2 => ()
IN_GARAGE does not wait for a lost kart: availability _waited_for: without in_race msr_used
IN_GARAGE waits for lost karts in spite of the MSR: availability, stuck _waited_for: always
    msr_used not
IN_GARAGE after the grid forgets a kart that was lost there: availability _refusals: without doubt
    connected
a release by hand leaves the doubt: effect, stuck _release_kart: skips _end_doubt
a kart that says another state stands by its acknowledgement: ack-stale heard: never sent
    acknowledged
only what is heard under the present serial takes an acknowledgement back: ack-stale heard:
    acknowledged sent => it and serial == kart.serial
a kart that takes the acknowledgement of a stop back counts as standing: doubt-unnoticed heard:
    skips sent is_red
IN_GARAGE releases a kart outside the race that was held alone: alone-released, as-seen, stuck
    _released_by_garage: without in_race held_alone
ALL_KILL hides that a kart was held alone: effect, stop-idempotent _all_kill: after _hold:
    each.held_alone = False
a kart held by ALL_KILL already is not held alone: effect _hold: held_alone or => kart.held_alone
    or (alone and before[0] is not kart.hold)
a start need not be as the official saw it: as-seen _misnamed: karts == => command.karts <=
    concerned
a kart is released whatever hold the official saw: as-seen _misnamed: command hold is => it and
    command.hold is None
a start is announced for all karts of the roster: as-seen COMMANDS: racing #1 => race.karts.values
a difference is not named: refusal-silent _misnamed: skips did
a kart is released while another race control runs: availability, rival [around] _refusals:
    has_rival => it and not kart.number
a stop that names another race is refused: stop-refused _misnamed: without KART_FINISH
a stop is refused while another race control runs: availability, stop-refused _refusals: kind
    has_rival => self.has_rival
another race control raises no alert: alerts _current_alerts: has_rival => it and self.record_fails
a race starts without a record: no-record, availability _no_race: never
    record_fails
a failing record raises no alert: alerts _current_alerts: record_fails #1 => it and self.has_rival
a release is taken right behind a stop: effect, pause, available-from command: skips _pause
a stop to one kart lets a release through: effect, pause, available-from command: stop entry => it
    and (not command.kart)
a stop that is refused for want of its statement begins no pause: refused-changes [waits] command:
    stop entry => it and (command.statement or kind is not CommandKind.RECORD_MSR)
a release that came before a stop is taken when the pause is over: pause _refusal_of: availability
    came => self.availability(kind, command.kart, max(came, self.paused_until))
a pause refuses what came after its end: availability, available-from availability: now
    paused_until => now <= self.paused_until
a pause refuses a stop: stop-refused, availability, available-from availability: without loosens
a pause lets one kart be released: pause, available-from availability: now paused_until => it and
    kind is not CommandKind.KART_IN_GARAGE
what was sent while race control was held up is taken: pause, available-from, effect stalled: skips
    _pause
a stop cuts the pause short that a delay began: pause, available-from, effect [waits] _pause:
    always paused_until
a pause is not announced: available-from availability: available_from => None
what the rules refuse is announced for the end of the pause: available-from availability: kind
    reason => Availability(kind, False, reason, '', self.paused_until)
karts start before it is on the disk: start-first, availability [waits] _refusals: never _saved
what was written for an earlier grid lets karts start: start-first, availability [a second
    grid] _refusals: _saved _gridded => not self._saved
a kart that comes to the grid is taken to be on the disk: start-first, availability [waits]
    _redirect: skips _gridded
what is on the disk does not count: availability, stuck saved: skips _saved
an orderly end on the grid leaves karts that may be moving: start-memory memory: without ended
what is written does not say for which grid: availability, stuck memory: _gridded => 0
a restart forgets the karts that left the roster: restart recover: always held not
a restart does not name the karts that left the roster: restart recover: skips _add_event
a restart forgets the places: restart recover: skips place
a restart forgets a stop that was left unanswered: restart recover: before held_alone: kart.doubt =
    min(kart.doubt, Doubt.GRID)
a restart forgets who was on the grid: restart recover: before held_alone: if kart.doubt is
    Doubt.GRID: ¶> kart.doubt = Doubt.NONE
a restart forgets who was held alone: restart recover: skips held_alone
a restart that knows nothing begins in IN_GARAGE: restart recover: at_rest UNKNOWN => last_run is
    not LastRun.UNKNOWN or memory is None
a restart goes on where the race was: restart _lose_track: skips _hold
what is on the disk before GREEN_GREEN does not say that karts will move: start-memory, restart
    memory: MOVING => kart.doubt
a kart without an inspection may join: uninspected, availability [uninspected outside] _refusals:
    _uninspected kart => ''
a kart without an inspection may start: uninspected, availability [uninspected] _refusals:
    _uninspected racing => ''
a heat may have a kart without an inspection: uninspected [uninspected outside] _no_such_heat:
    karts _uninspected => ''
the statement that the track is safe leaves the doubt of a restart: effect, stuck _race_in_garage:
    skips unstated
an acknowledgement at once ends the doubt: settle, effect heard: times now => now
the time to stand counts from the order: settle, effect [green] heard: times now => kart.sent_since
    + self.times.settle_time
the time to stand counts from when it is first looked at: effect heard: settle_time => 2 * it
a word that was taken back ends the doubt later: settle, effect heard: skips settles_at None
a kart that is lost while it settles is taken to stand: settle, effect, doubt-forgotten _drop:
    instead of _void_answers: settles = kart.settles_at ¶ self._void_answers(kart) ¶
    kart.settles_at = settles
a new order lets the time to stand run on: settle, effect [green] _redirect: instead of
    _void_answers: settles = kart.settles_at ¶ self._void_answers(kart) ¶ kart.settles_at = settles
a kart stands while race control is held up and hears nothing: settle, effect [held up] stalled:
    instead of settle_time: kart.settles_at += 0.0
every word said again begins the time to stand again: effect [unknown outside] heard: acknowledged
    counts => counts and (not kart.acknowledged or kart.settles_at is not None)
the doubt never ends by standing: effect, stuck tick: skips _settle
humans are allowed as soon as a kart has acknowledged: track-access, availability, refusal-silent
    _danger: stands => kart.stopped
IN_GARAGE goes out as soon as every kart has acknowledged: availability, false-news answered: sent
    stands => self.acknowledged
IN_GARAGE releases a kart that has not stood yet: as-seen, hold-forgotten, red-loosened [green]
    _released_by_garage: stands => each.stopped
a kart that has only just acknowledged is released alone without a word: statement COMMANDS: stands
    => kart.stopped
the alarm of a kart lost in motion ends with its acknowledgement: effect, alerts heard: after
    times: kart.lost = False
GREEN_GREEN while a kart taken off the grid has not answered: availability _no_race: doubt
    may_be_moving => each.in_race and each.may_be_moving
GREEN_GREEN while a kart outside the race is lost on the grid: availability [two on the grid]
    _no_race: without doubt in_race
GREEN_GREEN while a kart on the grid may be moving: availability [around] _no_race: without
    may_be_moving
GREEN_GREEN while a kart that left the grid has only just acknowledged: availability [two on the
    grid] _no_race: doubt may_be_moving => it and (not each.stopped)
GREEN_GREEN does not name the kart in doubt: refusal-silent _no_race: _dangers ( => 'a kart may be
    moving' if it else ''
GRID_ACTIVE while a kart outside the race may be moving: availability _refusals: _no_race ( #1 =>
    ()
the grid forms with a kart as which two programs connect: availability [network] _no_race:
    contested each => it and self.state is GRID_ACTIVE
a race starts with a kart as which two programs connect: availability, contested [network]
    _no_race: contested each => it and self.state is IN_GARAGE
two programs of one kart raise no alert: alerts [network] _current_alerts: contested => it and
    self.has_rival
GRID_ACTIVE that is given again clears the places: effect, finish-other, order-wrong, nobody-there,
    results [grid] _grid_active: instead of have: pass
GRID_ACTIVE is not given again: availability COMMANDS: IN_GARAGE GRID_ACTIVE #1 => (IN_GARAGE,)
GRID_ACTIVE is given after a race that is over: availability, red-loosened COMMANDS: IN_GARAGE
    GRID_ACTIVE #1 => (IN_GARAGE, GRID_ACTIVE, RED_RED)
race control that is cut off goes on: cut-off, effect [network] cut_off: skips _cut_off
race control that is cut off takes the track for closed: cut-off, restart [network] _lose_track:
    instead of _count_opening: self.opening += 1
race control that is cut off leaves the use of the MSR in force: cut-off [network] _lose_track:
    skips msr_used
race control that is cut off takes itself to know what happened: cut-off, restart [network]
    _lose_track: skips past_unknown
a release that was sent before race control was cut off is taken: effect, available-from, pause
    [network and pauses] _lose_track: instead of _pause: if late: ¶> self._pause(cause, now, late)
every kart of the race that goes silent changes nothing: cut-off, effect [silence on the grid]
    disconnected: skips _check_whether_all_went_silent
one kart that goes silent beside another one is race control that is cut off: effect, sent-wrong
    [silence on the grid] _check_whether_all_went_silent: len 1 => False
one kart that goes silent in the garage is race control that is cut off: effect, sent-wrong
    [silence in the garage] _check_whether_all_went_silent: len in_garage => len(silent) > 0
a kart that goes silent outside the race stops it: effect, sent-wrong [silence outside]
    _check_whether_all_went_silent: without in_race in_garage
karts that are silent long since count: effect, sent-wrong [silence for long]
    _check_whether_all_went_silent: without LOST_AT_ONCE
a kart that is back counts as silent: effect, sent-wrong [silence in the garage] connected: skips
    went_silent_at
karts that are silent in RED_RED take the use of the MSR back: effect [silence on the grid]
    _check_whether_all_went_silent: without state
the first start begins in RED_RED: restart recover: UNKNOWN last_run => last_run in (LastRun.ENDED,
    LastRun.ENDED_OPEN)
the first start opens the track without a statement: restart, statement [first] recover: skips NONE
an official's statement is asked for at every opening: effect [first] _open_track: skips unstated
any IN_GARAGE states that no race is under way anywhere: effect [first] _race_in_garage: always
    past_unknown
an orderly end at the first start counts as proof: restart ends_as: skips unstated
an end with karts in doubt counts as an orderly one: restart ends_as: skips at_rest
a proof is believed against what the record knows: restart recover: without at_rest is
a stop to one kart that is not seen to move leaves no doubt: effect, alarm-cleared _hold:
    unconfirmed _by => it and not alone
ALL_KILL leaves no doubt of a kart that was not seen to move: effect, stuck _hold: unconfirmed _by
    => it and alone
a kart that is covered stands with its first word: effect, availability, track-access, as-seen,
    statement stands: without settles_at
a release while race control is cut off: availability, cut-off [network] _refusals: cut_off_by #1
    => not it and self.has_rival
race control that is cut off is so for ever: availability, effect, stuck [network] cut_off: instead
    of reason =: self.cut_off_by = reason or self.cut_off_by
the command that settles what is not known is not named: track-access [unknown] track_access:
    IN_GARAGE CommandKind => None
the first start lets humans near before anybody has spoken: track-access [first] track_access:
    unstated => it and self.track_open
one kart of two that goes silent is race control that is cut off: effect, sent-wrong [silence on
    the grid] _check_whether_all_went_silent: instead of len everyone: if len(silent) == 1: ¶> pass
a kart whose program boots calls for the MSR: alerts, alarm-cleared _current_alerts: skips
    _covered_by_statement
the MSR is asked for to clear the track of karts that were not seen to move: use-msr alerts: skips
    doubt
GREEN_GREEN without a record: availability, no-record _no_race: record_fails #1 => it and
    self.state is not GRID_ACTIVE
GRID_ACTIVE without a record: availability _no_race: record_fails #1 => it and self.state is not
    IN_GARAGE
an orderly end forgets that the track was open: restart memory: track_open => False
a start after it does: restart recover: skips _count_opening
a release that was sent before a restart undoes it: restart _lose_track: instead of _pause: if not
    late: ¶> self._pause(cause, now)
a run of which nothing is known counts as ended well: restart recover: without UNKNOWN
a kart in doubt does not keep a restart from going home: restart at_rest: without doubt
a restart does not hold the karts of which nothing is known: restart _lose_track: instead of _hold:
    if kart.doubt: ¶> self._hold(kart, RED_RED, held, now)
a kart that was lost before a restart raises no alarm: restart, alerts recover: skips lost
the statement answers for a kart that was known in doubt: availability, as-seen, hold-forgotten,
    track-access [crash] _covered_by_statement: without doubt
the statement answers for a kart that was lost on the grid: availability, as-seen, hold-forgotten,
    track-access [lost on the grid] _covered_by_statement: doubt => kart.may_be_moving
the statement answers for a kart that was held alone: availability, available-from, as-seen,
    alone-released, hold-forgotten [unknown] _covered_by_statement: without held_alone
the statement answers for absent karts without a restart: doubt-unnoticed _covered_by_statement:
    without past_unknown
after a restart nobody answers for a kart that never comes: effect, availability, as-seen, stuck
    [unknown] _covered_by_statement: never doubt not
IN_GARAGE after a restart does not wait for a connected kart outside: availability, available-from
    [unknown outside] _waited_for: without sent past_unknown
IN_GARAGE always waits for connected karts outside the race: availability, false-news _waited_for:
    without past_unknown
OPEN_TRACK after a restart before the statement: restart, track-access, availability track_access:
    past_unknown => it and self.over
a finish that is undone keeps its RED_FLAG: effect, sent-wrong [green] _kart_undo_finish: skips
    flag_at
a finish that is undone cancels the RED_FLAG of another kart: finish-put-off [two in green]
    _kart_undo_finish: after place -: each.flag_at = None
a finish that is undone puts the RED_FLAG of who moves up off: finish-put-off, effect [two in
    green] _kart_undo_finish: after place -: each.flag_at = now + 9.0
a finish that is undone lifts the hold of a stop that came meanwhile: red-loosened, hold-forgotten
    [green] _kart_undo_finish: instead of flag_at: if kart.flag_at is not None: ¶>
    self._unhold(kart) ¶> self._redirect(kart, now) ¶ kart.flag_at = None
a kart that moves on the grid raises no alert: alerts _current_alerts: sent IN_GARAGE => kart.sent
    is IN_GARAGE
a kart that moves in the garage raises no alert: alerts _current_alerts: sent IN_GARAGE =>
    kart.sent is GRID_ACTIVE
a kart that moves unasked and says it again is no alert: alerts _current_alerts: sent IN_GARAGE =>
    it and not kart.acknowledged
a poor link raises no alert: alerts [around] _current_alerts: skips LINK_POOR
a poor link of a kart that is not in the race raises an alert: alerts [around] _current_alerts:
    without in_race
a poor link stops the kart: effect, sent-wrong [around] measured: instead of link_poor_at:
    self._hold(kart, RED_RED, 'poor link', now)
an order that has arrived counts as acknowledged: ack-from-nothing, effect [around] delivered:
    after max: kart.acknowledged = True
a command is told after what comes of it: told-first command: skips insert
a change of state does not say what caused it: cause _go: without _cause
a change of state does not say who gave the command: cause _add_event: _by official => ''
the cause does not name the official: cause _cause: _by if => ''
the cause is that of the last change: cause _go: _cause why => self.state_cause or why or
    self._cause()
the MSR is asked for at once when a kart connects to a stop: alerts _current_alerts: ordered_at
    sent_since => kart.sent_since
a kart that was lost in motion has its time again with every connection: alerts _current_alerts:
    without lost not
the MSR is asked for when it was used: use-msr alerts: without msr_used
the MSR is not asked for when a kart is lost in motion: use-msr MSR_ALERTS: without LOST_IN_MOTION
a track that officials opened is closed by a stop: effect, stop-idempotent _all_kill: after _hold:
    self.track_open = False
a race goes home from the grid with a kart that may be moving: availability _refusals: without
    may_be_moving
a race goes home from the grid with a kart that has an unanswered stop: availability _refusals:
    may_be_moving => it and each.hold is None
a race never goes home from the grid with a kart on it: availability, stuck _refusals: _dangers (
    => _listed(each for each in self.racing() if each.doubt)
a race cannot go home without a record: availability [around] _refusals: after _unanswered
    _waited_for: yield self.record_fails
a FINISH of another run of race control is taken: finish-other [green] _misnamed: run meant =>
    meant[1:] != (self.number, kart.attempt)
a FINISH of another race is taken: finish-other [green] _misnamed: number => command.race
a FINISH that was undone is taken again: finish-other [green] _misnamed: attempt kart =>
    command.attempt
an undone finish is no attempt: effect [green] _kart_undo_finish: skips attempt
the attempts of a race go on in the next one: effect [an undone finish] _grid_active: without
    attempt
a FINISH that names no race is refused: availability [green] _misnamed: run and #1 => kind is
    CommandKind.KART_FINISH
a FINISH counts as somebody who is there: effect [people in green] _kart_finish: after
    flag_at: self.nobody_since = None
a heat stays in the race with karts of another one: heat [heats] heat: without karts racing
a heat stays in the race without any kart: heat [heats] heat: inside racing => inside
of two heats with the karts of the race, the first is in it: heat [heats alike] __init__: len alike
    => bool(alike)
the race did not begin when GRID_ACTIVE was accepted: effect _grid_active: skips race_since
a race that nobody can stop goes on: nobody-there, effect [people in green] tick: skips IN_CONTACT
    _go
the grid stays when nobody can stop it any more: nobody-there, effect, alerts [people on the grid]
    _unattended_since: state GREEN_GREEN => self.state is GREEN_GREEN
a race that nobody can stop goes on for longer than it may: nobody-there, effect [people in green]
    tick: limit + => since + 2 * limit
a race is stopped as soon as nobody is there: effect, sent-wrong [people in green] tick: without
    limit >=
a race is stopped though that is turned off: effect, sent-wrong [nobody told] tick: limit is =>
    since is not None and now >= since + limit
a race is stopped for nobody where nobody ever was: effect [people in green] attended: always
    able_to_stop self
a screen that is back does not count: effect [people in green] attended: skips nobody_since
    None
to hear again that nobody is there begins the time again: effect [people in green] attended:
    able_to_stop self => it or self.nobody_since is not None
that nobody was there before the race stops it: effect [a race after one without people]
    _grid_active: skips nobody_since
a screen that goes stops the race at once: there-acts [people in green] attended: after
    nobody_since now: self._go(RED_FLAG, now, 'gone')
a screen that goes on the grid brings the karts home: there-acts [people on the grid] attended:
    after nobody_since now: self._go(IN_GARAGE, now, 'gone')
a screen that is back starts the race again: there-acts, red-to-green, green-only-by-command,
    green-needs-grid, red-loosened [people in green] attended: before nobody_since None: if
    self.nobody_since is not None and self.state is RED_FLAG: ¶> self._go(GREEN_GREEN, now, 'back')
GREEN_GREEN while nobody is there any more: nobody-there, availability [people on the grid]
    _refusals: never nobody_since
a release that was sent before race control stopped the race is taken: effect, available-from,
    pause [an abandoned grid] tick: skips _pause
that nobody is there raises no alert: alerts [people in green] _current_alerts: _unattended_since (
    => None
a button at fault raises no alert: alerts [people in green] _current_alerts: skips BUTTON_FAULT
a button at fault stops the race: there-acts, effect [people in green] attended: first: if
    there.button_fault: ¶> self._go(RED_RED, now, 'button')
RED_FLAG to a kart outside the race takes the place of the hold of ALL_KILL: stop-loosens
    _stop_kart: before _hold: if hold is RED_FLAG and not kart.in_race: ¶> kart.hold = None
the race starts by itself when every kart is on the grid: green-only-by-command [grid]
    _report_all_answered: before waited_for #1: if all(each.acknowledged for each in self.racing())
    and self.state is GRID_ACTIVE: ¶> self._go(GREEN_GREEN, self.state_since, 'all are ready')
GREEN_GREEN starts the karts outside the race as well: red-to-green [grid] _green_green: first: for
    each in self.karts.values(): ¶> each.in_race = True
a connection that comes back ends the alarm of its loss: alarm-cleared connected: first: if not
    self.karts[number].connected: ¶> self.karts[number].lost = False
IN_GARAGE releases every kart that stands, whatever it announced: alone-released [grid]
    _race_in_garage: _released_by_garage ( => [*it, *(each for each in self.karts.values() if
    each.stands)]
the grid forms again when another race control has ended: rival [around] rival: first: if not
    present and self.has_rival and self.state is IN_GARAGE: ¶> self._go(GRID_ACTIVE, now, 'it has
    ended')
"""
)
"""Each fault under what it would mean on the track."""


def search(rules: ModuleType) -> None:
    """Search all worlds."""
    for bound, options in WORLDS.values():
        oracle.Search(rules, **options).run(bound)


def search_nearest(rules: ModuleType, bounds: Iterable[int] = NEAREST[-1:]) -> None:
    """Search the nearest states of all worlds."""
    for bound in bounds:
        for _, options in WORLDS.values():
            oracle.Search(rules, **options).run(bound)


def search_nearest_first(rules: ModuleType, begin: str) -> None:
    """Search all worlds: first the one to begin with, then the nearest states of each."""
    if begin:
        bound, options = WORLDS[begin]
        oracle.Search(rules, **options).run(bound)
    search_nearest(rules, NEAREST)
    search(rules)


@pytest.mark.parametrize(
    'search_for_none',
    [
        search_nearest,
        pytest.param(search, marks=[pytest.mark.long, pytest.mark.longest]),
    ],
)
def test_the_rules_without_a_fault_pass_the_same_search(
    search_for_none: Callable[[ModuleType], None],
) -> None:
    # Otherwise a fault could be found for the way in which it is put in.
    search_for_none(module_with(race, None))


DAILY = {
    min(
        (name for name, fault in FAULTS.items() if each in fault.breaks),
        key=lambda name: len(FAULTS[name].breaks),
    )
    for each in oracle.PROPERTIES.keys() - {'abstraction'}  # that one is the search's own
}
"""A fault for each property: the first of those that break the fewest others."""


@pytest.mark.parametrize(
    'name',
    [
        pytest.param(each, marks=() if each in DAILY else (pytest.mark.long, pytest.mark.longest))
        for each in FAULTS
    ],
)
def test_the_search_finds(name: str) -> None:
    fault = FAULTS[name]
    rules = module_with(race, fault)
    with pytest.raises(oracle.RuleBrokenError) as caught:
        search_nearest_first(rules, fault.begin)
    assert caught.value.name in fault.breaks, caught.value
