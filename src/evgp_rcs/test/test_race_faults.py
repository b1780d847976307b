# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Faults put into the rules of the race on purpose: the oracle's search must find every one.

This is the test of the oracle. A property that no fault can break proves nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

from evgp_rcs.rules import race
import pytest
import race_oracle as oracle
from rig.faults import faults_in, module_with

pytestmark = [pytest.mark.usefixtures('others_first'), pytest.mark.timeout(900)]

REQUIRED = {'require_inspection': True}
AT_ONCE = {'settle': 0.0}
ALL_OF_ONE = oracle.KART_COMMANDS

ONE_SILENT = (
    oracle.Input('connected', '', 1),
    oracle.Input('connected', '', 2),
    oracle.Input('disconnected', '', 1, True),
)
ON_THE_GRID = oracle.Input('command', 'GRID_ACTIVE', 0, True)

ANNA = oracle.Input('there', statement=True)
NOBODY = oracle.Input('there')

UNDONE_AND_HOME = (
    oracle.Input('command', 'KART_FINISH', 1),
    oracle.Input('command', 'KART_UNDO_FINISH', 1, True),
    oracle.Input('command', 'RACE_OVER'),
    oracle.Input('command', 'KART_IN_GARAGE', 1, True),
    oracle.Input('command', 'IN_GARAGE', 0, True),
    oracle.Input('command', 'JOIN_RACE', 1),
)

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
    'crash on the grid': world(150, 1, 0, 'crash on the grid'),
    'unknown': world(150, 1, 0, 'unknown'),
    'network': world(60, 1, 0, 'grid', network=True, times=AT_ONCE),
    'network and pauses': world(60, 1, 0, 'grid', network=True, waits=True),
    'first': world(60, 1, 0, 'first'),
    'silence on the grid': world(60, 1, 1, 'grid', silence=True, times=AT_ONCE),
    'silence in the garage': world(150, 1, 1, silence=True, then=ONE_SILENT),
    'silence for long': world(
        5, 1, 1, silence=True, then=(*ONE_SILENT, *[oracle.Input('tick')] * 3)
    ),
    'silence outside': world(10, 1, 1, silence=True, then=(*ONE_SILENT, ON_THE_GRID)),
    'unknown outside': world(150, 0, 1, 'unknown', times={'settle': 2.0}),
    'waits': world(150, 1, 1, 'grid', waits=True, times=AT_ONCE),
    'a start alone': world(300, 1, 0, 'grid', waits=True, track=False, without=ALL_OF_ONE),
    'waits around': world(150, 1, 0, 'grid', waits=True, around=True),
    'held up': world(200, 0, 1, 'unknown', waits=True, without=ALL_OF_ONE, times={'settle': 2.0}),
    'two in green': world(300, 2, 0, 'green'),
    'two on the grid': world(100, 2, 0, 'grid'),
    'two': world(150, 2, 0),
    'heats': world(60, 1, 1, heats=True),
    'an undone finish': world(20, 1, 0, 'green', then=UNDONE_AND_HOME, times=AT_ONCE),
    'two heats': world(60, 1, 1, 'green', heats=True),
    'people on the grid': world(100, 1, 0, 'grid', people=True, then=(ANNA,), times=AT_ONCE),
    'people in green': world(100, 1, 0, 'green', people=True, then=(ANNA,)),
    'nobody told': world(
        60, 1, 0, 'green', people=True, then=(ANNA,), times={'nobody_there': 0.0}
    ),
    'a start with people': world(
        60, 1, 0, 'grid', people=True, waits=True, then=(ANNA,), without=ALL_OF_ONE
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
what was said before the command is an acknowledgement: ack-old heard: and serial == kart.serial =>
anything said under the present serial is an acknowledgement: ack-old
    heard: state is kart.sent and =>
an acknowledgement of GREEN_GREEN is not heard: ack-deaf
    heard: and serial => is not GREEN_GREEN and serial
no acknowledgement is heard: ack-deaf, stuck heard: serial == kart => serial > kart
time acknowledges: ack-from-nothing
    tick: self._settle(kart, now) => self._settle(kart, now) ¶ kart.acknowledged = kart.connected
an order to a kart that is not connected: order-wrong, restart _redirect: kart.connected => True
a stop is announced as allowed, and refused: stop-refused
    _refusal_of: if refusal => if command.kind is CommandKind.ALL_KILL and self.state is IN_GARAGE:
        ¶> refusal = 'nothing is under way' ¶ if refusal
an acknowledgement survives the connection: ack-survives _drop: kart.acknowledged = False => pass
a new connection goes on under the old serial: order-serial _redirect: 1 => changed
a reconnection lets a hold be forgotten: hold-forgotten, red-loosened connected: reported => hold
a kart that drops in RED_FLAG is not held: drop-not-held [green]
    _drop: is not GRID_ACTIVE => not in (GRID_ACTIVE, RED_FLAG)
a kart that drops is held in RED_FLAG only: drop-not-held
    _drop: RED_RED, f'lost its connection in {self.state.value}' => RED_FLAG, f'lost its connection
        in {self.state.value}'
a kart that is replaced while connected does not count as dropped: drop-not-held, alerts
    connected: self._drop(kart, 'a new connection from its address took its place', now) => pass
RED_FLAG loosens RED_RED: stop-loosens, stop-idempotent, red-loosened
    _red_flag: stricter(self.state, RED_FLAG) => RED_FLAG
a later hold loosens an earlier one: stop-loosens, stop-idempotent, hold-forgotten
    _hold: None or hold.strictness > kart.hold.strictness => not hold
a stop is refused to a kart outside the race: availability, stop-refused
    COMMANDS: KART_RED_RED: Rule(Race._stop_kart) => KART_RED_RED: Rule(Race._stop_kart,
        Race._no_release)
a stop that is in force is sent anew and its acknowledgement falls: stop-idempotent
    _redirect: or anew => or anew or state is RED_RED
a kart is not told at once: stop-at-once, sent-wrong, restart _hold: self._redirect(kart, now) =>
ALL_KILL forgets the karts outside the race: stop-at-once
    _all_kill: in self.karts.values => in self.racing
GREEN_GREEN after another command than GRID_ACTIVE: available-from, availability, green-needs-grid
    [grid]
    _decide: grid_was_last = command => grid_was_last |= command
closing the track comes between GRID_ACTIVE and GREEN_GREEN: availability [grid]
    _decide: CATALOGUE[command.kind].bookkeeping => (CATALOGUE[command.kind].bookkeeping and
        command.kind is not CommandKind.CLOSE_TRACK)
GREEN_GREEN while a kart is not connected: availability, green-needs-acks
    _no_green_green: not (each.connected and each.acknowledged) => each.connected and not
        each.acknowledged
GREEN_GREEN while a kart has not acknowledged: availability, green-needs-acks, refusal-silent
    _no_green_green: (each.connected and each.acknowledged) => each.connected
GRID_ACTIVE while a kart is held: availability
    _no_grid_active: _held(racing) => _held(each for each in racing if each.hold is RED_FLAG)
GRID_ACTIVE without the statement that the track is clear: statement
    COMMANDS: else 'the track is clear of humans' => else ''
joining the race releases a held kart: membership-loosens, hold-forgotten
    _join_race: _redirect => _unhold(kart) ¶ self._redirect
a kart that is taken out on the grid is not held: effect, sent-wrong
    _leave_race: _hold(kart, RED_RED, 'taken out of the race on the grid', now) => _redirect(kart,
        now)
a kart leaves the race while it drives: availability
    _no_leave: not in (IN_GARAGE, GRID_ACTIVE) => is RED_RED
IN_GARAGE while a kart is silent: availability
    _no_in_garage: each.answered => (each.answered or each.hold)
IN_GARAGE releases a kart that never acknowledged its red: hold-forgotten, red-loosened, as-seen,
    stuck
    _released_by_garage: (each.stands and (each.in_race or not each.held_alone)) => each.in_race ¶
        or not each.held_alone
IN_GARAGE leaves the use of the MSR in force for the next race: effect
    _race_in_garage: self.msr_used = False => pass
a release without the statement that a silent kart was made safe: statement
    _state_made_safe: if kart.stands else f'{kart} was made safe by hand' =>
a kart released during a race goes on with the race: effect, sent-wrong, red-to-green,
    green-only-by-command
    _release_kart: not IN_GARAGE => RED_RED
a finish stops the kart on the finish line: sent-wrong, effect tick: and now >= kart.finish_due =>
a finish is never followed by RED_FLAG: sent-wrong, finish-put-off [green]
    tick: self._hold(kart, RED_FLAG, MARKED_AS_FINISHED, now) => pass
every place has the delay of the first: effect
    finish_delay: min(place, len(self.finish_delays)) - 1 => 0
a kart finishes twice: availability _no_finish: if kart.place => if kart.place > 1
a finish that is undone ends the hold of the kart: red-loosened, hold-forgotten [green]
    _kart_undo_finish: 0 => 0 ¶ if kart.finish_due is None: ¶> self._unhold(kart) ¶>
        self._redirect(kart, now)
a finish that is undone sends the kart on: green-needs-grid, red-loosened, green-only-by-command
    [green]
    _kart_undo_finish: 0 => 0 ¶ if self.state is RED_FLAG: ¶> self._go(GREEN_GREEN, now)
later places stay when a finish is undone: effect [two in green]
    _kart_undo_finish: each.place -= 1 => pass
a place that was taken back counts for the next one: effect
    _kart_undo_finish: self.places_given -= 1 =>
a finish is undone when the order of FINISH was told: availability [green]
    _no_undo_finish: kart.number not in self.starters => False
a finish is undone without the statement that the kart has not finished: statement
    COMMANDS: f'{race.karts[command.kart]} has not finished' => ''
the race goes over while a finish is outstanding: sent-wrong, effect
    _race_over_due: or kart.finish_due is not None =>
the race goes over when the first kart has finished: sent-wrong, effect [two in green]
    _race_over_due: None: return None => None: ¶> continue
humans may be on the track while the race drives: track-access, availability
    _humans_allowed: in (GRID_ACTIVE, GREEN_GREEN) => is GRID_ACTIVE
the track stays open when the grid forms: track-open-in-motion, effect
    _grid_active: self.track_open = self.msr_used = False => self.msr_used = False
the track closes for the grid whoever has been let onto it since: as-seen
    _misnamed: and command.opening != self.opening => and command.opening > self.opening
an opening of the track is not counted: as-seen, effect
    _open_track: self._count_opening(f'by {command.official or "an official"}', now) =>
        self.track_open = True
a kart that was lost in a race goes home with all others: stuck, effect, sent-wrong, availability
    away_at_rest: self.lost_since is None and =>
a kart that was away when an official held it goes home with all others: alone-released,
    effect, sent-wrong, availability
    away_at_rest: (self.connected or self.held_alone) => self.connected
a kart that was away must be released alone: availability, effect, sent-wrong, as-seen
    _released_by_garage: or each.away_at_rest =>
the race waits for karts that were away when all were stopped: availability
    _waited_for: and not (kart.sent.is_red and kart.away_at_rest) =>
a kart lost in motion lets humans on the track: track-access, availability
    _danger: if kart.may_be_moving: return f'{kart} was lost in motion: use the MSR' => pass
a kart that was told to go counts as standing: doubt-unnoticed, effect
    _redirect: elif not self => elif state is not GREEN_GREEN and not self
a refused command takes GREEN_GREEN away: refused-changes
    _decide: answer = Answer(False, f'{command.kind.value} refused: {refusal}.') => answer =
        Answer(False, f'{command.kind.value} refused: {refusal}.') ¶ self.grid_was_last = False
a refusal does not name the kart: refusal-silent
    _no_green_green: f'{each}: {self._silence(each)}' => f'{self._silence(each)}'
looking at alerts acts: alerts-act
    alerts: alerts = [] => self.track_open = False ¶ alerts: list[Alert] = []
a lost kart raises no alert: effect, alerts _drop: or kart.doubt => and kart.may_be_moving
a silent kart in RED_FLAG raises no alert: alerts _current_alerts: flag_alert => ready_alert + 9.0
GREEN_GREEN is announced after another command: false-news
    _next: self._refusal(Command(following)) => ''
the race is said to be on when every kart stands: false-news [green]
    _next: standing = [kart for kart in racing if kart.stopped] => standing: list[Kart] = []
a kart connecting during a race is sent IN_GARAGE: sent-wrong, red-loosened, order-wrong, ack-deaf
    _redirect: self._commanded => IN_GARAGE if anew else self._commanded
a heat leaves the others in the race: heat-halved
    _set_heat: each.number => each.in_race or each.number
a heat releases the karts that it puts into the race: membership-loosens, hold-forgotten
    _set_heat: self._redirect => if each.in_race: ¶> self._unhold(each) ¶ self._redirect
a heat that takes a kart out forgets that it may be moving: doubt-forgotten [two]
    _set_heat: self._redirect => each.doubt = each.doubt if each.in_race else Doubt.NONE ¶
        self._redirect
a heat is put into a race that is under way: availability
    _no_set_heat: return f'the race is in {self.state.value}; a heat is put into the race in
        IN_GARAGE' => pass
a heat that the roster does not have empties the race: availability, heat-halved, effect
    _no_such_heat: def _no_such_heat(self, name: str) -> str: => def _no_such_heat(self, name: str)
        -> str: ¶> if name == 'no such heat': self.heats += (Heat(name, ()),)
a heat that is not in the roster is refused without those that are: refusal-silent
    _no_such_heat: ', '.join(f'"{heat.name}"' for heat in self.heats) => 'others'
the places are gone with IN_GARAGE: results, effect [green]
    _race_in_garage: finish_due = None => finish_due = None ¶ each.place = 0
the order of FINISH of a race that was stopped is never told: results
    _race_in_garage: self._tell_order_of_finish() # of a race that was stopped and never declared
        over => pass
the order of FINISH is told again with every RACE_OVER: results
    _tell_order_of_finish: self.starters = () =>
the order of FINISH leaves out who did not finish: results
    _tell_order_of_finish: not each.place => not each.place and each.in_race
a restart forgets that the order of FINISH was never told: restart
    recover: in (GREEN_GREEN, RED_FLAG) => is RED_FLAG
a kart that is held is given a place: availability
    _no_finish: if kart.hold is not None: return f'{kart} is held: {kart.hold_reason}' => pass
an unanswered stop leaves no doubt: doubt-unnoticed, alarm-cleared
    _redirect: elif not self => elif state is GREEN_GREEN and not self
a kart told to form the grid leaves no doubt: doubt-unnoticed
    _redirect: kart.doubt = max(kart.doubt, Doubt.GRID) => pass
a lost connection ends the doubt: effect, doubt-forgotten, drop-not-held, alerts
    _drop: kart.connected = False kart.acknowledged = False => kart.connected = kart.acknowledged =
        False ¶ kart.doubt = Doubt.NONE
a kart that is back counts as standing: effect, doubt-forgotten, alarm-cleared, drop-not-held,
    alerts, settle
    connected: if not kart.may_be_moving: kart.lost_since = None => kart.lost_since = None ¶
        kart.doubt = Doubt.NONE
a kart that is back ends the alarm of its loss: effect, alarm-cleared, alerts
    connected: if not kart.may_be_moving: kart.lost_since = None => kart.lost_since = None
the alarm of a kart lost in motion is told of missing karts only: alarm-cleared, alerts
    _current_alerts: if kart.may_be_moving => if kart.may_be_moving and not kart.connected
a kart outside the race that drops with a stop unanswered raises no alert: effect,
    alarm-cleared, alerts
    _drop: (under_way or kart.doubt) => under_way
any acknowledgement ends the doubt: doubt-forgotten, effect
    heard: if state.is_red: kart.settles_at = now + self.times.settle self._settle(kart, now) =>
        kart.settles_at = now + self.times.settle ¶ self._settle(kart, now)
the acknowledgement of a stop leaves the doubt: effect, stuck
    heard: state.is_red => state is RED_FLAG
a kart that says GREEN_GREEN unasked is not seen: doubt-unnoticed
    heard: not GREEN_GREEN => GRID_ACTIVE
a kart seen to move and lost comes back to be tested on: drop-not-held
    _drop: elif kart.may_be_moving: self._hold(kart, RED_RED, 'lost its connection while it may
        have been moving', now) => pass
a kart lost on the grid lets humans on the track: track-access, availability
    _danger: GRID => GRID and kart.in_race and self.state is IN_GARAGE
a kart in the garage that was seen to move lets humans on the track: track-access, availability,
    refusal-silent, restart
    _danger: may_be_moving else => hold else
the grid forms with a kart that was seen to move: availability [around]
    _doubtful: may_be_moving or => hold or
GREEN_GREEN counts the acknowledgement of a red: availability, green-needs-acks, refusal-silent
    [around]
    _no_green_green: _held(racing) => ''
IN_GARAGE does not wait for a lost kart: availability
    _waited_for: or (kart.in_race and not self.msr_used) =>
IN_GARAGE waits for lost karts in spite of the MSR: availability, stuck
    _waited_for: not self.msr_used => True
IN_GARAGE after the grid forgets a kart that was lost there: availability
    _no_in_garage: or (each.doubt and not each.connected) =>
a release by hand leaves the doubt: effect, stuck _release_kart: self._end_doubt(kart) =>
a kart that says another state stands by its acknowledgement: ack-stale
    heard: kart.acknowledged and state is not kart.sent => False
only what is heard under the present serial takes an acknowledgement back: ack-stale
    heard: kart.acknowledged and state is not kart.sent => kart.acknowledged and state is not
        kart.sent and serial == kart.serial
a kart that takes the acknowledgement of a stop back counts as standing: doubt-unnoticed
    heard: if kart.sent.is_red: kart.doubt = Doubt.MOVING => pass
IN_GARAGE releases a kart outside the race that was held alone: alone-released, as-seen, stuck
    _released_by_garage: (each.stands and (each.in_race or not each.held_alone)) => each.stands
ALL_KILL hides that a kart was held alone: effect, stop-idempotent
    _all_kill: self._hold(each, RED_RED, cause, now) => self._hold(each, RED_RED, cause, now) ¶
        each.held_alone = False
a kart held by ALL_KILL already is not held alone: effect
    _stop_kart: not kart.held_alone => kart.hold_reason == reason
a start need not be as the official saw it: as-seen
    _not_as_seen: concerned == command.karts => command.karts <= concerned
a kart is released whatever hold the official saw: as-seen _held_otherwise: is kart => or not kart
a start is announced for all karts of the roster: as-seen _started: racing => karts.values
a difference is not named: refusal-silent
    _not_as_seen: phrases.append(f'you did not name {_numbers(concerned - command.karts)}') =>
        phrases = ['it is for others']
a kart is released while another race control runs: availability, rival [around]
    _refusal: has_rival => has_rival and not command.kart
a stop is refused while another race control runs: availability, stop-refused
    _refusal: CATALOGUE[command.kind].loosens and self.has_rival => self.has_rival
another race control raises no alert: alerts
    _current_alerts: has_rival => has_rival and self.record_fails
a race starts without a record: no-record, availability, start-answer, start-first, false-news
    _no_record: not self.record_fails => True
a failing record raises no alert: alerts
    _current_alerts: if self.record_fails => if self.record_fails and self.has_rival
a release is taken right behind a stop: effect, pause, available-from
    command: self._pause(now + self.times.pause, 'a stop was sent just now') => pass
a stop to one kart lets a release through: effect, pause, available-from
    command: [command.kind].stop => [command.kind].stop and not command.kart
a release that came before a stop is taken when the pause is over: pause
    _refusal_of: kind, came => kind, max(came, self.paused_until)
a pause refuses what came after its end: availability, available-from _paused: < self => <= self
a pause refuses a stop: stop-refused, availability, available-from
    _paused: CATALOGUE[kind].loosens and =>
a pause lets one kart be released: pause, available-from
    _paused: and came => and kind is not CommandKind.KART_IN_GARAGE and came
what was sent while race control was held up is taken: pause, available-from, effect
    held_up: + pause =>
a stop cuts the pause short that a delay began: pause, available-from, effect [waits]
    _pause: until > self.paused_until => True
a pause is not announced: available-from availability: self._paused(kind, now) => ''
what the rules refuse is announced for the end of the pause: available-from
    availability: False, reason => False, reason, '', self.paused_until
in a pause it is told that the race may go home now: false-news [waits]
    _next: (following, now) => (following, now) and self.state is GRID_ACTIVE
karts start before it is on the disk: start-first
    command: not CATALOGUE[command.kind].needs_journal => self.record_fails or True
a start that was withdrawn goes out: start-first, green-needs-acks, green-needs-grid
    WHY_NO_START: StartPhase.WITHDRAWN: 'it was withdrawn while it waited for the record', } => }
a start that the disk did not take goes out: start-first, start-answer
    WHY_NO_START: StartPhase.FAILED: 'the record did not take it in time; send it again', =>
a start waits for the disk for ever: start-answer, start-first tick: until => until + 9.0
a start that was stopped meanwhile goes out when it is on the disk: green-needs-grid,
    green-needs-acks, start-first, start-other-grid, pause, no-record [waits]
    _end_of_start: self._refusal_of(start.command, start.came) => '' if phase == StartPhase.WRITTEN
        else self.record_fails
a start that waited while race control was held up goes out: pause [waits]
    _end_of_start: start.came => now + 9.0
what was written for another start starts karts: start-answer, start-first
    start_becomes: != number => < number
a second GREEN_GREEN takes the place of the one that waits: availability
    _no_green_green: self.start is not None => False
while a start waits a crash leaves the race on the grid: start-memory
    memory: if self.start is not None: return self.start.memory => pass
a start that is refused is waited for all the same: effect
    _end_of_start: self.start => if phase == StartPhase.WRITTEN: ¶> self.start
a restart forgets the karts that left the roster: restart
    recover: not (before.in_race or before.held or before.doubt) => True
a restart does not name the karts that left the roster: restart recover: in gone => in ()
a restart forgets a stop that was left unanswered: restart
    recover: doubt = before.doubt => doubt = min(before.doubt, Doubt.GRID)
a restart forgets who was on the grid: restart
    recover: doubt = before.doubt => doubt = Doubt.MOVING if before.doubt is Doubt.MOVING else
        Doubt.NONE
a restart forgets who was held alone: restart
    recover: kart.held_alone = before.held and before.held_alone =>
a restart that knows nothing begins in IN_GARAGE: restart
    recover: not LastRun.UNKNOWN and => not LastRun.UNKNOWN or memory is None and
a restart goes on where the race was: restart
    _lose_track: self._hold(kart, RED_RED, held, now) => pass
what is on the disk before GREEN_GREEN does not say that karts will move: restart
    command: Doubt.MOVING => kart.doubt
a kart without an inspection may join: uninspected, availability [uninspected outside]
    _no_join: self._uninspected([kart]) => ''
a kart without an inspection may start: uninspected, availability [uninspected]
    _no_grid_active: self._uninspected(racing) or =>
a heat may have a kart without an inspection: uninspected [uninspected outside]
    _no_such_heat: self._uninspected(self.karts[number] for number in heat.karts) => ''
the statement that the track is safe leaves the doubt of a restart: effect, stuck
    _race_in_garage: self.past_unknown = self.unstated = False => pass
an acknowledgement at once ends the doubt: settle, effect heard: + self.times.settle =>
the time to stand counts from the order: settle, effect [green]
    heard: settles_at = now + => settles_at = kart.sent_since +
the time to stand counts from when it is first looked at: effect heard: + self => + 2 * self
a word that was taken back ends the doubt later: settle, effect heard: kart.settles_at = None =>
a kart that is lost while it settles is taken to stand: settle, effect, doubt-forgotten
    _drop: kart.settles_at = None => pass
a new order lets the time to stand run on: settle, effect [green]
    _redirect: kart.settles_at = None =>
a kart stands while race control is held up and hears nothing: settle, effect [held up]
    held_up: kart.settles_at = now + self.times.settle => kart.settles_at += 0.0
every word said again begins the time to stand again: effect [unknown outside]
    heard: counts and not kart.acknowledged => counts and (not kart.acknowledged or
        kart.settles_at is not None)
the doubt never ends by standing: effect, stuck tick: self._settle(kart, now) =>
humans are allowed as soon as a kart has acknowledged: track-access, availability, refusal-silent
    _danger: stands => stopped
IN_GARAGE goes out as soon as every kart has acknowledged: availability, false-news
    answered: stands if self.sent.is_red else self.acknowledged => acknowledged
IN_GARAGE releases a kart that has not stood yet: as-seen, hold-forgotten, red-loosened [green]
    _released_by_garage: stands => stopped
a kart that has only just acknowledged is released alone without a word: statement
    _state_made_safe: stands => stopped
the alarm of a kart lost in motion ends with its acknowledgement: effect, alerts
    heard: self._settle => kart.lost_since = None ¶ self._settle
GREEN_GREEN while a kart taken off the grid has not answered: availability
    _doubtful: may_be_moving or (each.doubt and not each.in_race) => in_race and
        each.may_be_moving
GREEN_GREEN while a kart outside the race is lost on the grid: availability [two on the grid]
    _doubtful: or (each.doubt and not each.in_race) =>
GREEN_GREEN while a kart on the grid may be moving: availability [around]
    _doubtful: may_be_moving or (each.doubt and not each.in_race) => doubt and not each.in_race
GREEN_GREEN while a kart that left the grid has only just acknowledged: availability [two on the
    grid]
    _doubtful: each.may_be_moving or (each.doubt and not each.in_race) => (each.may_be_moving or
        (each.doubt and not each.in_race)) and not each.stopped
GREEN_GREEN does not name the kart in doubt: refusal-silent
    _doubtful: self._danger(each) => 'a kart may be moving'
GRID_ACTIVE while a kart outside the race may be moving: availability
    _no_grid_active: self._doubtful() or =>
the grid forms with a kart as which two programs connect: availability [network]
    _no_grid_active: or self._contested(racing) =>
a race starts with a kart as which two programs connect: availability, contested [network]
    _no_green_green: unfit := self._contested(racing) or => unfit :=
two programs of one kart raise no alert: alerts [network]
    _current_alerts: if kart.contested => if kart.contested and self.has_rival
GRID_ACTIVE that is given again clears the places: effect, finish-other, order-wrong, nobody-there,
    results [grid]
    _grid_active: return 'GRID_ACTIVE is the last command again; who has acknowledged it need not
        again' => self.places_given += 1
GRID_ACTIVE is not given again: availability
    _no_grid_active: not in (IN_GARAGE, GRID_ACTIVE) => is not IN_GARAGE
GRID_ACTIVE is given after a race that is over: availability, red-loosened
    _no_grid_active: not in (IN_GARAGE, GRID_ACTIVE) => is GREEN_GREEN
race control that is cut off goes on: cut-off, effect [network]
    cut_off: self._cut_off(reason, now) => pass
race control that is cut off takes the track for closed: cut-off, restart [network]
    _lose_track: self._count_opening(cause, now) => self.opening += 1
race control that is cut off leaves the use of the MSR in force: cut-off [network]
    _lose_track: self.msr_used = False => pass
race control that is cut off takes itself to know what happened: cut-off, restart [network]
    _lose_track: self.past_unknown = True => pass
a release that was sent before race control was cut off is taken: effect, available-from, pause
    [network and pauses]
    _cut_off: self._pause(now + self.times.pause, cause) => pass
every kart of the race that goes silent changes nothing: cut-off, effect [silence on the grid]
    disconnected: self._look_whether_all_went_silent(kart, now) => pass
one kart that goes silent in the garage is race control that is cut off: effect, sent-wrong
    [silence in the garage]
    _look_whether_all_went_silent: > in_garage => > 0
a kart that goes silent outside the race stops it: effect, sent-wrong [silence outside]
    _look_whether_all_went_silent: or not (lost.in_race or in_garage) =>
karts that are silent long since count: effect, sent-wrong [silence for long]
    _look_whether_all_went_silent: and each.went_silent_at >= now - LOST_AT_ONCE =>
a kart that is back counts as silent: effect, sent-wrong [silence in the garage]
    connected: kart.link = kart.went_silent_at = None => kart.link = None
karts that are silent in RED_RED take the use of the MSR back: effect [silence on the grid]
    _look_whether_all_went_silent: self.state is RED_RED or =>
the first start begins in RED_RED: restart
    recover: last_run is not LastRun.UNKNOWN => last_run in (LastRun.ENDED, LastRun.ENDED_OPEN)
the first start opens the track without a statement: restart, statement [first]
    recover: self.unstated = last_run is LastRun.NONE => pass
an official's statement is asked for at every opening: effect [first]
    _open_track: self.unstated = False => pass
any IN_GARAGE states that no race is under way anywhere: effect [first]
    _race_in_garage: if self.past_unknown => if True
an orderly end at the first start counts as proof: restart
    ends_as: if self.unstated: return LastRun.NONE => pass
an end with karts in doubt counts as an orderly one: restart
    ends_as: if not self.at_rest: return LastRun.UNKNOWN => pass
a proof is believed against what the record knows: restart
    recover: and (memory is None or memory.at_rest) =>
a stop to one kart that is not seen to move leaves no doubt: effect, alarm-cleared
    _stop_kart: self._doubt_that_it_stands(kart) =>
ALL_KILL leaves no doubt of a kart that was not seen to move: effect, stuck
    _all_kill: self._doubt_that_it_stands(each) =>
a kart that is covered stands with its first word: effect, availability, track-access, as-seen,
    statement
    stands: and self.settles_at is None =>
a release while race control is cut off: availability, cut-off [network]
    _refusal: and self.cut_off_by =>  and not self.cut_off_by and self.has_rival
race control that is cut off is so for ever: availability, effect, stuck [network]
    cut_off: self.cut_off_by = self.cut_off_by, reason => self.cut_off_by = self.cut_off_by, reason
        or self.cut_off_by
the command that settles what is not known is not named: track-access [unknown]
    _humans_allowed: reason, CommandKind.IN_GARAGE => reason, None
the first start lets humans near before anybody has spoken: track-access [first]
    track_access: and self.unstated => and self.unstated and self.track_open
one kart of two that goes silent is race control that is cut off: effect, sent-wrong [silence on
    the grid]
    _look_whether_all_went_silent: concerned = everyone => pass
a kart whose program boots calls for the MSR: alerts, alarm-cleared
    _current_alerts: if self._covered_by_statement(kart): continue # its program may boot, and
        nobody has seen it move => pass
the MSR is asked for to clear the track of karts that were not seen to move: use-msr
    alerts: use_msr = use_msr and any(each.doubt for each in self.karts.values()) => pass
GREEN_GREEN without a record: availability, no-record _no_green_green: self._no_record() => ''
GRID_ACTIVE without a record: availability _no_grid_active: or self._no_record() =>
a record that fails while a start waits does not stop it: start-first, no-record [waits around]
    _end_of_start: refusal = self._refusal_of(start.command, start.came) => trouble =
        self.record_fails ¶ if phase == StartPhase.WRITTEN: ¶> self.record_fails = '' ¶ refusal =
        self._refusal_of(start.command, start.came) ¶ self.record_fails = trouble
an orderly end forgets that the track was open: restart memory: self.track_open => False
a start after it does: restart
    recover: self._count_opening('before race control was restarted', now) => pass
a run of which nothing is known counts as ended well: restart
    recover: last_run is not LastRun.UNKNOWN and =>
a kart in doubt does not keep a restart from going home: restart at_rest: or kart.doubt =>
a restart does not hold the karts of which nothing is known: restart
    _lose_track: self._hold => if kart.doubt: ¶> self._hold
a kart that was lost before a restart raises no alarm: restart, alerts
    recover: if kart.doubt: kart.lost_since = now => pass
the statement answers for a kart that was known in doubt: availability, as-seen, hold-forgotten,
    track-access [crash]
    _covered_by_statement: doubt or kart.held_alone => held_alone
the statement answers for a kart that was lost on the grid: availability, as-seen, hold-forgotten,
    track-access [crash on the grid]
    _covered_by_statement: kart.doubt => kart.may_be_moving
the statement answers for a kart that was held alone: availability, as-seen, alone-released,
    hold-forgotten [unknown]
    _covered_by_statement: or kart.held_alone =>
the statement answers for absent karts without a restart: doubt-unnoticed
    _covered_by_statement: self.past_unknown and =>
after a restart nobody answers for a kart that never comes: effect, availability, as-seen, stuck
    [unknown]
    _covered_by_statement: not (kart.doubt or kart.held_alone) => False
IN_GARAGE after a restart does not wait for a connected kart outside: availability [unknown
    outside]
    _waited_for: (kart.in_race or (self.past_unknown and kart.sent.is_red)) => kart.in_race
IN_GARAGE always waits for connected karts outside the race: availability, false-news
    _waited_for: (self.past_unknown and kart.sent.is_red) => kart.sent.is_red
OPEN_TRACK after a restart before the statement: restart, track-access, availability
    _humans_allowed: past_unknown => past_unknown and self.over
a finish that is undone keeps its RED_FLAG: effect, sent-wrong [green]
    _kart_undo_finish: kart.finish_due = None =>
a finish that is undone cancels the RED_FLAG of another kart: finish-put-off [two in green]
    _kart_undo_finish: each.place -= 1 => each.place -= 1 ¶ each.finish_due = None
a finish that is undone puts the RED_FLAG of who moves up off: finish-put-off, effect [two in
    green]
    _kart_undo_finish: each.place -= 1 => each.place -= 1 ¶ each.finish_due = now + 9.0
a finish that is undone lifts the hold of a stop that came meanwhile: red-loosened, hold-forgotten
    [green]
    _kart_undo_finish: kart.finish_due = None => if kart.finish_due is not None: ¶>
        self._unhold(kart) ¶> self._redirect(kart, now)
a kart that moves on the grid raises no alert: alerts
    _current_alerts: in (IN_GARAGE, GRID_ACTIVE) => is IN_GARAGE
a kart that moves in the garage raises no alert: alerts
    _current_alerts: in (IN_GARAGE, GRID_ACTIVE) => is GRID_ACTIVE
a kart that moves unasked and says it again is no alert: alerts
    _current_alerts: (IN_GARAGE, GRID_ACTIVE) => (IN_GARAGE, GRID_ACTIVE) and not kart.acknowledged
a poor link raises no alert: alerts [around]
    _current_alerts: yield AlertKind.LINK_POOR, kart, None, text => pass
a poor link of a kart that is not in the race raises an alert: alerts [around]
    _current_alerts: kart.in_race and kart.link is not None => kart.link is not None
a poor link stops the kart: effect, sent-wrong [around]
    measured: kart.link_poor_at = now => self._hold(kart, RED_RED, 'poor link', now)
an order that has arrived counts as acknowledged: ack-from-nothing, effect [around]
    delivered: after = kart.delivered_at => kart.acknowledged = True ¶ after = kart.delivered_at
a change of state does not say what caused it: cause _go: or self._cause() =>
a change of state does not say who gave the command: cause _tell: by.official => ''
the cause does not name the official: cause
    _cause: f' by {self._by.official}' if self._by.official else =>
the cause is that of the last change: cause _go: why or => self.state_cause or why or
the MSR is asked for at once when a kart connects to a stop: alerts
    _current_alerts: kart.ordered_at if is_new else kart.sent_since => kart.sent_since
a kart that was lost in motion has its time again with every connection: alerts
    _current_alerts: is_new = kart.sent.is_red and kart.lost_since is None => is_new =
        kart.sent.is_red
the MSR is asked for when it was used: use-msr alerts: and not self.msr_used =>
the MSR is not asked for when a kart is lost in motion: use-msr
    MSR_ALERTS: AlertKind.RED_UNACKNOWLEDGED, AlertKind.LOST_IN_MOTION, =>
        AlertKind.RED_UNACKNOWLEDGED,
a track that officials opened is closed by a stop: effect, stop-idempotent
    _all_kill: self._hold(each, RED_RED, cause, now) => self._hold(each, RED_RED, cause, now) ¶
        self.track_open = False
a start goes out to a later grid: start-other-grid [a start alone]
    _grid_active: self.start = self.start._replace(phase=StartPhase.OUTLIVED) => pass
a race goes home from the grid with a kart that may be moving: availability
    _no_in_garage: may_be_moving or (each.doubt and not each.connected) => doubt and not
        each.connected
a race goes home from the grid with a kart that has an unanswered stop: availability
    _no_in_garage: each.may_be_moving => (each.may_be_moving and each.hold is None)
a race never goes home from the grid with a kart on it: availability, stuck
    _no_in_garage: may_be_moving or (each.doubt and not each.connected) => doubt
a race cannot go home without a record: availability [around]
    _no_in_garage: if not missing: return '' => if not missing: ¶> return self._no_record()
a FINISH of another run of race control is taken: finish-other [green]
    _no_finish: meant != (self.run, self => meant[1:] != (self
a FINISH of another race is taken: finish-other [green]
    _no_finish: self.number, kart => command.race, kart
a FINISH that was undone is taken again: finish-other [green]
    _no_finish: kart.attempt) => command.attempt)
an undone finish is no attempt: finish-other, availability [green]
    _kart_undo_finish: kart.attempt += 1 => pass
the attempts of a race go on in the next one: finish-other [an undone finish]
    _grid_active: each.place = each.attempt = 0 => each.place = 0
a FINISH that names no race is refused: availability [green]
    _no_finish: if command.run and meant => if meant
a FINISH counts as somebody who is there: nobody-there [people in green]
    _kart_finish: self.places_given += 1 => self.places_given += 1 ¶ self.nobody_since = None
a heat stays in the race with karts of another one: heat [heats]
    heat: and racing <= {*heat.karts} =>
a heat stays in the race without any kart: heat [heats]
    heat: if inside and racing => if inside
a race that nobody can stop goes on: nobody-there, effect [people in green]
    tick: self._go(RED_FLAG, now, NOBODY_THERE) => pass
the grid stays when nobody can stop it any more: nobody-there, effect, alerts [people on the grid]
    _unattended_since: in (GRID_ACTIVE, GREEN_GREEN) => is GREEN_GREEN
a race that nobody can stop goes on for longer than it may: nobody-there, effect [people in green]
    tick: since + limit => since + 2 * limit
a race is stopped as soon as nobody is there: effect, sent-wrong [people in green]
    tick: and now >= since + limit =>
a race is stopped though that is turned off: effect, sent-wrong [nobody told]
    tick: and limit and => and
a race is stopped for nobody where nobody ever was: nobody-there [people in green]
    attended: elif self.there.able => elif True
a screen that is back does not count: nobody-there [people in green]
    attended: self.nobody_since = None => pass
to hear again that nobody is there begins the time again: nobody-there [people in green]
    attended: elif self.there.able => elif self.there.able or self.nobody_since is not None
that nobody was there before the race stops it: nobody-there [a race after one without people]
    _grid_active: self.nobody_since = None # if nobody is there now, nobody was in this race yet =>
        pass
a screen that goes stops the race at once: there-acts [people in green]
    attended: self.nobody_since = now => self.nobody_since = now ¶ self._go(RED_FLAG, now, 'gone')
a screen that goes on the grid brings the karts home: there-acts [people on the grid]
    attended: self.nobody_since = now => self.nobody_since = now ¶ self._go(IN_GARAGE, now, 'gone')
a screen that is back starts the race again: there-acts, red-to-green, green-only-by-command,
    green-needs-grid, red-loosened [people in green]
    attended: self.nobody_since = None => if self.nobody_since is not None and self.state is
        RED_FLAG: ¶> self._go(GREEN_GREEN, now, 'back') ¶ self.nobody_since = None
GREEN_GREEN while nobody is there any more: nobody-there, availability [people on the grid]
    _no_green_green: self.nobody_since is not None => False
a start that waits goes out when the last screen has gone: nobody-there, start-first, start-answer
    [a start with people]
    _end_of_start: refusal = self._refusal_of(start.command, start.came) => since =
        self.nobody_since ¶ self.nobody_since = None ¶ refusal = self._refusal_of(start.command,
        start.came) ¶ self.nobody_since = since
a release that was sent before race control stopped the race is taken: effect, available-from,
    pause [an abandoned grid]
    tick: self._pause(now + self.times.pause, 'race control has just stopped the race') => pass
that nobody is there raises no alert: alerts [people in green]
    _current_alerts: self._unattended_since() => None
a button at fault raises no alert: alerts [people in green]
    _current_alerts: yield AlertKind.BUTTON_FAULT, None, None, text => pass
a button at fault stops the race: there-acts, effect [people in green]
    attended: self.there = there => self.there = there ¶ if there.button_fault: ¶>
        self._go(RED_RED, now, 'button')
"""
)
"""Each fault under what it would mean on the track."""


def search(rules: ModuleType) -> None:
    """Search all worlds."""
    for bound, options in WORLDS.values():
        oracle.Search(rules, **options).run(bound)


def search_nearest(rules: ModuleType) -> None:
    """Search the nearest states of all worlds."""
    for bound in NEAREST:
        for _, options in WORLDS.values():
            oracle.Search(rules, **options).run(bound)


def search_nearest_first(rules: ModuleType, begin: str) -> None:
    """Search all worlds: first the one to begin with, then the nearest states of each."""
    if begin:
        bound, options = WORLDS[begin]
        oracle.Search(rules, **options).run(bound)
    search_nearest(rules)
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
    search_for_none(module_with(race, 'class Race:\n', 'class Race:\n'))


@pytest.mark.parametrize('name', FAULTS)
def test_the_search_finds(name: str) -> None:
    fault = FAULTS[name]
    rules = module_with(race, fault.old, fault.new, fault.where)
    with pytest.raises(oracle.RuleBrokenError) as caught:
        search_nearest_first(rules, fault.begin)
    assert caught.value.name in fault.breaks, caught.value
